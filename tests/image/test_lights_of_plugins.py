"""Lights of plugins: against point lights and spots, integrals of their formulas, and the same bits in all ways."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from plugin_files import CORNER, EVEN, LED, SEARCHLIGHT, SPOT, edited

import clrender
from clrender.errors import SceneError
from clrender.scene import Scene

if TYPE_CHECKING:
    import numpy.typing as npt

    from clrender.device import Device

    Floats = npt.NDArray[np.float64]

COLOR = (3.0, 2.0, 1.0)
AT: dict[str, Any] = {"position": (1.0, 1.6, 1.0), "direction": (-0.7, -0.9, -0.8)}
SPREAD, BLEND = 1.0 - math.cos(math.radians(35.0)), 0.6
TURN: list[dict[str, Any]] = [
    {"time": 0.0},
    {"time": 1.0, "translate": [-0.4, 0.2, 0.1], "rotate_degrees": [10.0, 25.0, -10.0]},
]
PLUGINS = (EVEN, SPOT, CORNER, LED, SEARCHLIGHT)


def corner(*lights: dict[str, Any], **more: Any) -> Scene:
    """A ball in the corner of two walls and a floor."""
    wide = {"type": "quad", "edge_u": (4, 0, 0), "material": "grey"}
    grey = {"type": "lambert", "reflectance": (0.6, 0.5, 0.4)}
    camera = {"position": (0.5, 1.2, 3.5), "target": (0.0, 0.4, 0.0), "vertical_fov": 40.0}
    shapes = [
        {**wide, "origin": (-2, 0, 2), "edge_v": (0, 0, -4)},
        {**wide, "origin": (-2, 0, -1.5), "edge_v": (0, 3, 0)},
        {"type": "sphere", "center": (0.0, 0.5, 0.0), "radius": 0.5, "material": "grey"},
    ]
    camera |= more.pop("camera", {})
    made = Scene(camera=camera, materials={"grey": grey}, shapes=shapes, lights=list(lights), **more)
    return made.with_plugins(PLUGINS)


def spot(**more: Any) -> dict[str, Any]:
    return {"type": "spot", **AT, "intensity": COLOR, "cone_degrees": 70.0, "blend": BLEND, **more}


def given(**more: Any) -> dict[str, Any]:
    """The same as a plugin's formula."""
    numbers = {"color": COLOR, "spread": SPREAD, "blend": BLEND}
    return {"type": "plugin", "plugin": "cone", "parameters": numbers, **AT, **more}


def test_a_constant_formula_is_a_point_light_bit_for_bit(device: Device) -> None:
    point = {"type": "point", "position": AT["position"], "intensity": COLOR}
    even = {"type": "plugin", "plugin": "even", "parameters": {"color": COLOR}, **AT}
    scaled = {"type": "plugin", "plugin": "even", "scale": COLOR, **AT}
    with clrender.Session(device) as session:
        found = [session.render(corner(each), size=(32, 24), spp=4).linear for each in (point, even, scaled)]
    assert found[0].mean() > 0.01
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])


def test_its_frame_is_right_up_and_forwards(device: Device) -> None:
    """As seen along its direction: +x of a light that looks along -z is +x of the world, if its up is +y."""
    light = {"type": "plugin", "plugin": "corner", "position": (0.0, 0.0, 0.0), "direction": (0.0, 0.0, -2.0)}
    wall = {"type": "quad", "origin": (-1, -1, -1), "edge_u": (2, 0, 0), "edge_v": (0, 2, 0), "material": "white"}
    scene = Scene(
        camera={"position": (0, 0, 2), "target": (0, 0, 0), "type": "orthographic", "height": 2.0},
        materials={"white": {"type": "lambert", "reflectance": 1.0}},
        shapes=[wall],
        lights=[light],
    )
    found = clrender.render(scene, plugins=CORNER, device=device, size=(32, 32), spp=64, integrator="direct").linear
    x = (np.arange(32) + 0.5) / 16.0 - 1.0
    place = np.stack(np.broadcast_arrays(x[None, :], -x[:, None], 1.0), axis=-1)
    length = np.linalg.norm(place, axis=-1, keepdims=True)
    lit = (place > 0.0).all(axis=-1, keepdims=True)
    exact = np.where(lit, place / length / length**3 / math.pi, 0.0)
    np.testing.assert_allclose(found[1:-1, 1:-1], exact[1:-1, 1:-1], rtol=0.03, atol=1e-6)
    turned = {**light, "up": (0.0, -3.0, 0.0)}
    other = clrender.render(
        scene.changed({"lights": [turned]}), plugins=CORNER, device=device, size=(32, 32), spp=64, integrator="direct"
    )
    np.testing.assert_allclose(other.linear[::-1, ::-1][1:-1, 1:-1], exact[1:-1, 1:-1], rtol=0.03, atol=1e-6)


# --- against the formula that is built in --------------------------------------------------------------------------


def tiles(session: clrender.Session, scene: Scene, first: int, **settings: Any) -> Floats:
    """Means of twelve tiles over ten seeds, and of the image, (10, 13)."""
    rows = []
    for seed in range(first, first + 10):
        image = session.render(scene, size=(32, 24), spp=32, seed=seed, **settings)
        parts = image.linear.mean(axis=2).reshape(3, 8, 4, 8).mean(axis=(1, 3)).ravel()
        rows.append([*parts, parts.mean()])
    return np.array(rows, np.float64)


def assert_agree(session: clrender.Session, one: Scene, other: Scene, **settings: Any) -> None:
    """t-tests of the means of tiles and of the image, 1 % for all of them, by Sidak's correction."""
    from scipy import stats

    first, second = tiles(session, one, 0, **settings), tiles(session, other, 100, **settings)
    p = stats.ttest_ind(first, second, equal_var=False).pvalue
    assert np.nanmin(p) > -math.expm1(math.log1p(-0.01) / len(p)), (settings, p)
    assert first.mean() > 5e-3 and abs(first.mean() / second.mean() - 1.0) < 0.05, (first.mean(), second.mean())


@pytest.mark.long
@pytest.mark.parametrize(
    "settings",
    [
        {"integrator": "path"},
        {"integrator": "path", "spectral": True},
        {"integrator": "path", "kernels": "staged"},
        {"integrator": "path", "guiding": "on", "guiding_paths": 4096},
        {"integrator": "direct"},
        {"integrator": "whitted"},
        {"integrator": "bdpt"},
        {"integrator": "photon", "photons": 65536},
        {"integrator": "reuse"},
        {"integrator": "reuse", "spectral": True},
    ],
    ids=str,
)
def test_the_formula_of_a_spot_is_a_spot(device: Device, settings: dict[str, Any]) -> None:
    with clrender.Session(device) as session:
        assert_agree(session, corner(spot()), corner(given()), **settings)


@pytest.mark.long
def test_its_scale_may_be_a_spectrum(device: Device) -> None:
    """As the intensity of a point light: of a grey formula it is that of the lamp, wavelength by wavelength."""
    spectrum = {"illuminant": "FL11", "scale": 2.0}
    point = {"type": "point", "position": AT["position"], "intensity": spectrum}
    even = {"type": "plugin", "plugin": "even", "scale": spectrum, **AT}
    with clrender.Session(device) as session:
        found = [session.render(corner(each), size=(32, 24), spp=4, spectral=True).linear for each in (point, even)]
    assert found[0].mean() > 0.01
    np.testing.assert_array_equal(found[0], found[1])


@pytest.mark.long
@pytest.mark.parametrize("sampler", ["bvh", "power", "uniform"])
def test_many_of_them_among_other_lights(device: Device, sampler: str) -> None:
    """Whichever way lights are chosen: some of them narrow, some dark towards the scene."""
    rng = np.random.default_rng(5)
    pairs: list[list[dict[str, Any]]] = [[], []]
    for _ in range(8):
        where = {"position": tuple(rng.uniform((-1, 1, -0.5), (1, 2, 1))), "direction": tuple(rng.uniform(-1, 1, 3))}
        for made, one in zip(pairs, (spot(**where), given(**where)), strict=True):
            made.append(one)
    glow = {"type": "environment", "radiance": (0.02, 0.02, 0.02)}
    with clrender.Session(device) as session:
        assert_agree(session, *(corner(*each, glow) for each in pairs), light_sampler=sampler)


@pytest.mark.long
def test_the_cones_of_the_light_bvh_hide_no_light(device: Device) -> None:
    """The choice with a bound against one without, of lamps that shine into half-spaces and narrow cones."""
    rng = np.random.default_rng(6)
    lights = [
        {
            "type": "plugin",
            "plugin": ("led", "searchlight")[number % 2],
            "parameters": ({}, {"power": 1.0, "divergence": 20.0})[number % 2],
            "position": tuple(rng.uniform((-1, 1, -0.5), (1, 2, 1))),
            "direction": tuple(rng.uniform(-1, 1, 3)),
        }
        for number in range(10)
    ]
    from scipy import stats

    with clrender.Session(device) as session:
        one, other = (
            tiles(session, corner(*lights), first, light_sampler=sampler)
            for first, sampler in ((0, "bvh"), (100, "uniform"))
        )
    assert stats.ttest_ind(one, other, equal_var=False).pvalue.min() > -math.expm1(math.log1p(-0.01) / 13)
    assert one.std(axis=0).sum() < other.std(axis=0).sum()


@pytest.mark.long
@pytest.mark.parametrize("settings", [{"specular_chains": "on"}, {"integrator": "bdpt"}], ids=str)
def test_through_glass(device: Device, settings: dict[str, Any]) -> None:
    glass = {"grey": {"type": "lambert", "reflectance": (0.6, 0.5, 0.4)}, "glass": {"type": "dielectric", "ior": 1.5}}
    scenes = []
    for light in (spot(), given()):
        scene = corner(light)
        shapes = (*scene.shapes[:2], scene.shapes[2].with_checked(material="glass"))
        scenes.append(scene.changed({"materials": glass}).with_checked(shapes=shapes))
    with clrender.Session(device) as session:
        assert_agree(session, *scenes, **settings)


@pytest.mark.long
@pytest.mark.parametrize("integrator", ["path", "bdpt"])
def test_it_moves_as_a_spot_does(device: Device, integrator: str) -> None:
    camera = {"shutter": (0.0, 1.0)}
    scenes = [corner(each(motion=TURN), camera=camera) for each in (spot, given)]
    with clrender.Session(device) as session:
        assert_agree(session, *scenes, integrator=integrator)
        assert_agree(session, *scenes, integrator=integrator, light_sampler="power")


@pytest.mark.long
@pytest.mark.parametrize("integrator", ["path", "bdpt"])
def test_in_a_medium(device: Device, integrator: str) -> None:
    fog = {"media": {"haze": {"scattering": 0.3, "absorption": 0.05}}, "fog": "haze"}
    with clrender.Session(device) as session:
        assert_agree(session, *(corner(each(), **fog) for each in (spot, given)), integrator=integrator)


@pytest.mark.long
def test_its_light_is_in_its_group(device: Device) -> None:
    lights = [given(light_group="key"), spot(position=(-1.0, 1.5, 1.0))]
    image = clrender.render(corner(*lights), device=device, size=(32, 24), spp=64, light_groups=True)
    alone = clrender.render(corner(given()), device=device, size=(32, 24), spp=64)
    assert abs(float(image.light_groups["key"].mean()) / float(alone.linear.mean()) - 1.0) < 0.02


# --- energies ------------------------------------------------------------------------------------------------------


def led_power() -> float:
    """Of the defaults: the integral of the formula over the hemisphere, W."""
    steps = 20000
    angle = (np.arange(steps) + 0.5) / steps * (math.pi / 2.0)
    degrees = np.degrees(angle)
    said = 2.0 ** -((degrees / 35.0) ** 2) + 0.5 * 2.0 ** -(((degrees - 60.0) / 12.0) ** 2)
    return float((said * 2.0 * math.pi * np.sin(angle)).sum() * (math.pi / 2.0) / steps)


@pytest.mark.long
@pytest.mark.parametrize("integrator", ["path", "bdpt", "photon"])
@pytest.mark.parametrize("name", ["led", "searchlight"])
def test_a_closed_sphere_gets_the_integral_of_the_formula(device: Device, name: str, integrator: str) -> None:
    """An integrating sphere of reflectance r: seen from its middle the mean radiance is r Φ / (π A (1 - r))."""
    share, radius = 0.5, 2.0
    numbers = {"led": {}, "searchlight": {"power": 3.0, "divergence": 15.0}}[name]
    power = led_power() if name == "led" else 3.0
    light = {"type": "plugin", "plugin": name, "position": (0, 0, 0), "direction": (1, -1, 0.5), "parameters": numbers}
    scene = Scene(
        camera={"type": "panoramic", "position": (0, 0, 0), "target": (0, 0, -1)},
        materials={"white": {"type": "lambert", "reflectance": share}},
        shapes=[{"type": "sphere", "radius": radius, "material": "white"}],
        lights=[light],
    )
    image = clrender.render(
        scene, plugins=[LED, SEARCHLIGHT], device=device, size=(128, 64), spp=64, integrator=integrator
    )
    weights = np.sin((np.arange(64) + 0.5) / 64 * math.pi)
    seen = (image.linear[..., 1].mean(axis=1) * weights).sum() / weights.sum()
    exact = share * power / (math.pi * 4.0 * math.pi * radius * radius * (1.0 - share))
    assert seen == pytest.approx(exact, rel=3e-3)


# --- the same bits -------------------------------------------------------------------------------------------------


def everything(media: bool = True) -> Scene:
    """Three plugins in seven lights beside others, some of which move, in haze."""
    led = {"type": "plugin", "plugin": "led", "direction": (0.3, -1.0, 0.2)}
    beam = {"type": "plugin", "plugin": "searchlight", "parameters": {"power": 2.0, "divergence": 6.0}, **AT}
    lights = [
        *({**led, "position": (x, 1.8, z)} for x in (-1.0, 1.0) for z in (-0.8, 0.5)),
        {**led, "position": (0.0, 2.0, 0.0), "motion": TURN, "up": (0.0, 0.3, 1.0)},
        beam,
        given(motion=TURN, position=(-1.0, 1.5, 1.0)),
        spot(),
        {"type": "point", "position": (0.0, 1.0, 1.0), "intensity": (0.1, 0.1, 0.1)},
        {"type": "environment", "radiance": (0.05, 0.05, 0.08)},
    ]
    fog = {"media": {"haze": {"scattering": 0.1, "absorption": 0.05}}, "fog": "haze"}
    return corner(*lights, camera={"shutter": (0.0, 1.0)}, **(fog if media else {}))


def hashed(device: Device, **settings: Any) -> str:
    scene = everything(media=settings.get("integrator") not in ("whitted", "reuse"))
    image = clrender.render(scene, device=device, size=(32, 24), spp=4, **settings)
    assert image.stats["nonfinite_samples"] == 0 and image.linear.mean() > 0.01
    return str(image.stats["image_sha256"])


@pytest.mark.long
def test_the_same_bits_in_all_ways(device: Device) -> None:
    one = hashed(device)
    assert hashed(device, samples_per_pass=1, tile=16) == one
    assert hashed(device, kernels="staged") == one
    if device.is_cpu:
        assert hashed(device, lanes=4) == one


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["path", "direct", "whitted", "bdpt", "photon", "reuse"])
def test_lanes_do_not_matter(device: Device, integrator: str) -> None:
    settings = {"integrator": integrator, **({"photons": 2048} if integrator == "photon" else {})}
    assert len({hashed(device, lanes=lanes, **settings) for lanes in (1, 4, 8, 16)}) == 1


# --- faulty ones ---------------------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_a_formula_without_an_intensity_is_refused(device: Device) -> None:
    """Where that is seen when its power is measured: before anything is rendered."""
    light = {"type": "plugin", "plugin": "even", **AT}
    for said, words in (
        ("sub(p->color, vec3_all(1.5f))", r"gives the intensity -0\.5 W/sr"),
        ("scale(p->color, root(direction.z) - direction.z * 1.0e30f * 1.0e30f)", "gives the intensity -?(inf|nan)"),
    ):
        scene = corner(light).changed({"lights": [light]})
        bare = Scene(camera=scene.camera, materials=scene.materials, shapes=scene.shapes, lights=scene.lights)
        with pytest.raises(SceneError, match=rf"lights\[0\]: the plugin even {words} .*from 0 to 1e\+12"):
            clrender.render(bare, plugins=edited(EVEN, ("return p->color", f"return {said}")), device=device, spp=1)


def with_text(text: str, light: dict[str, Any], ball: bool = False) -> Scene:
    """The corner with another text of the plugin `even`; its light in a ball of glass, if asked for."""
    whole = corner(light)
    made = Scene(camera=whole.camera, materials=whole.materials, shapes=whole.shapes, lights=whole.lights)
    glass = {**dict(made.materials), "glass": {"type": "dielectric", "ior": 1.5}}
    bulb = {"type": "sphere", "center": light["position"], "radius": 0.2, "material": "glass"}
    if ball:
        made = made.changed({"materials": glass, "shapes": [*made.shapes, bulb]})
    return made.with_plugins(text)


@pytest.mark.long
@pytest.mark.parametrize("integrator", ["path", "bdpt"])
def test_what_the_grid_has_not_seen_is_made_harmless(device: Device, integrator: str) -> None:
    """A negative number and one that is none in a band behind the light, between the last two rings."""
    wrong = "direction.x > 0.0f ? splat(-9.0f) : splat(FAR) * splat(FAR) * splat(0.0f)"
    wrong = f"vec3_of({wrong}, splat(9.0f), splat(0.0f))"
    band = f"choose((direction.z > -0.95f) & (direction.z < -0.89f), {wrong}, p->color)"
    text = edited(EVEN, ("return p->color", f"return {band}"))
    light = {"type": "plugin", "plugin": "even", **AT, "direction": (0.7, 0.9, 0.8)}
    image = clrender.render(with_text(text, light), device=device, size=(64, 48), spp=16, integrator=integrator)
    assert image.stats["nonfinite_samples"] == 0 and np.isfinite(image.linear).all() and image.linear.min() >= 0.0


@pytest.mark.long
@pytest.mark.parametrize("integrator", ["bdpt", "photon"])
def test_samples_that_the_density_excludes_carry_nothing(device: Device, integrator: str) -> None:
    """In a bulb of glass only what starts at the light leaves it: with a density of 0 everywhere nothing does."""
    sample = "static vec3 even_sample(const EvenParameters* p, vfloat u, vfloat v) { return warp_sphere(u, v); }\n"
    pdf = "static vfloat even_pdf(const EvenParameters* p, vec3 direction) { return splat(VALUE); }\n"
    light = {"type": "plugin", "plugin": "even", **AT}
    means = []
    for value in ("-1.0f", "0.25f * INV_PI"):
        scene = with_text(EVEN + sample + pdf.replace("VALUE", value), light, ball=True)
        means.append(clrender.render(scene, device=device, size=(32, 24), spp=16, integrator=integrator).linear.mean())
    assert means[0] == 0.0 < means[1]
