"""Images with plugins: known answers, the same bits in all ways to compute them, and plugins beside everything else."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from plugin_files import GRAIN, MINNAERT, PAPER, SHIRLEY, WOOD, edited

import clrender
from clrender.errors import ClrenderError, UsageError
from clrender.scene import Scene

if TYPE_CHECKING:
    from clrender.device import Device

SIZE = (8, 8)
SKY = {"type": "environment", "radiance": (1.0, 1.0, 1.0)}
COLOR = (0.6, 0.5, 0.4)


def square(material: dict[str, Any], *lights: dict[str, Any], behind: bool = False, **others: Any) -> Scene:
    """A square in the plane z = 0, seen at an angle, from its front or its back."""
    z = -3.0 if behind else 3.0
    camera = {"position": (1.5, 0.0, z), "target": (0.0, 0.0, 0.0), "type": "orthographic", "height": 0.2}
    shape = {"type": "quad", "origin": (-2, -2, 0), "edge_u": (4, 0, 0), "edge_v": (0, 4, 0), "material": "given"}
    materials = {"given": material, **others}
    return Scene(camera=camera, materials=materials, shapes=[shape], lights=list(lights))


def sun(towards: tuple[float, float, float]) -> dict[str, Any]:
    return {"type": "directional", "direction": towards, "irradiance": (math.pi,) * 3}


def minnaert(**more: Any) -> dict[str, Any]:
    return {"type": "plugin", "plugin": "minnaert", "parameters": {"reflectance": COLOR, **more}}


@pytest.mark.thorough
@pytest.mark.parametrize("k", [1.0, 2.5])
@pytest.mark.parametrize("integrator", ["path", pytest.param("whitted", marks=pytest.mark.slow)])
def test_minnaert_in_the_sun(device: Device, k: float, integrator: str) -> None:
    """f = r (k + 1) / (2 pi) (cos i cos e)^(k - 1), and the radiance is f times the irradiance."""
    i, e = math.cos(math.radians(50.0)), 3.0 / math.hypot(3.0, 1.5)
    scene = square(minnaert(k=k), sun((math.sin(math.radians(50.0)), 0.0, -i)))
    image = clrender.render(scene, device=device, size=SIZE, spp=2, plugins=MINNAERT, integrator=integrator)
    expected = np.array(COLOR) * (k + 1.0) / 2.0 * (i * e) ** (k - 1.0) * i
    np.testing.assert_allclose(image.linear, np.broadcast_to(expected, image.linear.shape), rtol=3e-5)


@pytest.mark.thorough
@pytest.mark.parametrize("sampling", ["light", "bsdf", "mis"])
def test_minnaert_under_the_sky(device: Device, sampling: str) -> None:
    """The radiance is the albedo r (cos e)^(k - 1), which the layer shows."""
    image = clrender.render(
        square(minnaert(k=2.0), SKY), device=device, size=SIZE, spp=512, plugins=MINNAERT, sampling=sampling,
        aov=["albedo"], seed=3,
    )  # fmt: skip
    expected = np.array(COLOR) * 3.0 / math.hypot(3.0, 1.5)
    np.testing.assert_allclose(image.aovs["albedo"], np.broadcast_to(expected, image.linear.shape), rtol=1e-4)
    found = image.linear.reshape(-1, 3)
    error = found.std(axis=0) / math.sqrt(len(found)) + 1e-6
    assert (np.abs(found.mean(axis=0) - expected) < 4.0 * error + 1e-5).all()


@pytest.mark.thorough
def test_a_sheet_that_transmits(device: Device) -> None:
    paper = {"type": "plugin", "plugin": "paper", "parameters": {"tint": COLOR, "share": 0.25}}
    i = math.cos(math.radians(60.0))
    for behind in (False, True):
        lit = (math.sqrt(0.75), 0.0, i if behind else -i)
        for towards, share in ((lit, 0.75), ((lit[0], 0.0, -lit[2]), 0.25)):
            scene = square(paper, sun(towards), behind=behind)
            image = clrender.render(scene, device=device, size=SIZE, spp=2, plugins=PAPER)
            expected = np.broadcast_to(np.array(COLOR) * share * i, image.linear.shape)
            np.testing.assert_allclose(image.linear, expected, rtol=3e-5)


@pytest.mark.thorough
def test_a_back_may_be_black(device: Device) -> None:
    for two_sided in (True, False):
        scene = square({**minnaert(k=1.0), "two_sided": two_sided}, sun((0.0, 0.0, 1.0)), behind=True)
        image = clrender.render(scene, device=device, size=SIZE, spp=2, plugins=MINNAERT)
        np.testing.assert_allclose(
            image.linear, np.broadcast_to(np.array(COLOR) * two_sided, image.linear.shape), rtol=1e-5
        )


@pytest.mark.long
def test_textures_of_plugins_and_in_their_parameters(device: Device) -> None:
    """The albedo shows them: stripes over u and v of a square, in a Lambertian material and in a plugin's parameter."""
    grain = {"plugin": "grain", "transform": {"offset": [0.05, 0.0]}, "parameters": {"low": (0.1, 0.2, 0.3)}}
    by_plugin = {"type": "plugin", "plugin": "minnaert", "parameters": {"k": 1.0, "reflectance": grain}}
    image = {"type": "plugin", "plugin": "minnaert", "parameters": {"k": 1.0, "reflectance": {"ramp": [0.2, COLOR]}}}
    plain = {"type": "lambert", "reflectance": {"ramp": [0.2, COLOR]}}
    made = [
        clrender.render(
            square(material, SKY), device=device, size=SIZE, spp=1, plugins=[MINNAERT, GRAIN], aov=["albedo", "uv"]
        ).aovs
        for material in ({"type": "lambert", "reflectance": grain}, by_plugin, image, plain)
    ]
    u, v = made[0]["uv"][..., 0], made[0]["uv"][..., 1]
    at = np.mod(3.0 * (u + 0.05) + v, 1.0)[..., None]
    expected = np.array([0.1, 0.2, 0.3]) + at * (np.array([0.8, 0.7, 0.6]) - np.array([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(made[0]["albedo"], expected, atol=2e-6)
    np.testing.assert_allclose(made[1]["albedo"], expected, atol=2e-6)
    np.testing.assert_array_equal(made[2]["albedo"], made[3]["albedo"])
    assert np.ptp(made[3]["albedo"]) > 0.01


@pytest.mark.thorough
def test_a_texture_of_places_in_the_world(device: Device) -> None:
    """Rings around the y axis, wherever the origin of coordinates on the device is."""
    text = edited(WOOD, ("wood_noise(scale(position, splat(3.0f))) * p->bend", "splat(0.0f)"))
    camera = {"type": "orthographic", "height": 1.0, "up": (0.0, 0.0, -1.0)}
    shape = {"type": "quad", "origin": (-99, 0, 99), "edge_u": (198, 0, 0), "edge_v": (0, 0, -198), "material": "w"}
    wood = {"type": "lambert", "reflectance": {"plugin": "wood", "parameters": {"rings": 2.0}}}
    for x in (0.0, 21.5):
        scene = Scene(
            camera={**camera, "position": (x, 0.02, 0.0), "target": (x, 0.0, 0.0)},
            materials={"w": wood},
            shapes=[shape],
        )
        layers = clrender.render(scene, device=device, size=SIZE, spp=1, plugins=text, aov=["albedo", "position"]).aovs
        radius = np.hypot(layers["position"][..., 0], layers["position"][..., 2])
        ring = np.mod(2.0 * radius, 1.0)[..., None] ** 3
        early, late = np.array([0.64, 0.42, 0.22]), np.array([0.33, 0.17, 0.08])
        np.testing.assert_allclose(layers["albedo"], early + ring * (late - early), atol=2e-5)


def everything(**camera: Any) -> Scene:
    """Two BSDFs and two textures of plugins beside the tree's own materials, in all that materials occur in."""
    materials: dict[str, Any] = {
        "moon": {**minnaert(k=1.6), "normal_map": {"texture": "bent"}},
        "holes": {**minnaert(), "opacity": {"checker": [0.0, 1.0], "size": 0.2}},
        "gloss": {
            "type": "plugin",
            "plugin": "ashikhmin_shirley",
            "parameters": {"diffuse": {"plugin": "grain"}, "specular": [0.4, 0.3, 0.2], "n_u": 5.0, "n_v": 60.0},
            "anisotropy_rotation": 30.0,
        },
        "paper": {"type": "plugin", "plugin": "paper"},
        "wood": {"type": "principled", "base_color": {"plugin": "wood"}, "roughness": 0.3},
        "half": {"type": "mix", "materials": ["gloss", "wood"], "weight": 0.4},
        "both": {"type": "mix", "materials": ["moon", "half"]},
        "glass": {"type": "dielectric", "ior": 1.5, "roughness": 0.3},
        "mirror": {"type": "mirror"},
    }
    ball = {"type": "sphere", "radius": 0.45}
    shapes: list[dict[str, Any]] = [
        {"type": "quad", "origin": (-3, -0.5, 3), "edge_u": (6, 0, 0), "edge_v": (0, 0, -6), "material": "wood"},
        {**ball, "center": (-1.0, 0.0, 0.0), "material": "moon"},
        {**ball, "center": (0.0, 0.0, 0.0), "material": "both"},
        {**ball, "center": (1.0, 0.0, 0.0), "material": "gloss"},
        {**ball, "center": (0.5, 0.0, -1.0), "material": "glass"},
        {**ball, "center": (-0.5, 0.0, -1.0), "material": "mirror"},
        {"type": "quad", "origin": (-1, -0.5, 1), "edge_u": (1, 0, 0), "edge_v": (0, 1, 0), "material": "holes"},
        {"type": "quad", "origin": (0.2, -0.5, 1), "edge_u": (1, 0, 0), "edge_v": (0, 1, 0), "material": "paper"},
        {
            "type": "disk",
            "center": (0, 2, 0),
            "normal": (0, -1, 0),
            "radius": 0.5,
            "emission": (9, 9, 9),
            "material": "moon",
        },
        {
            "type": "instance",
            "group": "pair",
            "transforms": [[[0.4, 0, 0, -2], [0, 0.4, 0, -0.2], [0, 0, 0.4, 0], [0, 0, 0, 1]]],
        },
    ]
    pair = [
        {**ball, "material": "gloss"},
        {"type": "box", "center": (1, 0, 0), "size": (0.8, 0.8, 0.8), "material": "both"},
    ]
    made = Scene(
        camera={"position": (0.0, 1.0, 4.0), "target": (0.0, 0.0, 0.0), **camera},
        materials=materials, shapes=shapes, groups={"pair": {"shapes": pair}},
        lights=[{"type": "environment", "radiance": (0.4, 0.5, 0.6)}],
    )  # fmt: skip
    bent = np.full((2, 2, 3), (140, 120, 255), np.uint8)
    return made.with_arrays(textures={"bent": bent}).with_plugins([MINNAERT, SHIRLEY, PAPER, WOOD, GRAIN])


def hashed(device: Device, **settings: Any) -> str:
    image = clrender.render(everything(), device=device, size=(48, 32), spp=4, **settings)
    assert image.stats["nonfinite_samples"] == 0 and image.linear.mean() > 0.05
    return str(image.stats["image_sha256"])


@pytest.mark.long
def test_plugins_beside_everything_have_the_same_bits_in_all_ways(device: Device) -> None:
    """In one lane and in several, in stages, however the work is cut, and by a program for any scene."""
    one = hashed(device)
    assert hashed(device, samples_per_pass=1, tile=16) == one
    assert hashed(device, kernels="staged") == one
    if device.is_cpu:
        assert hashed(device, lanes=4) == one
    assert hashed(device, code="any") == one


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["path", "direct", "whitted", "bdpt", "photon", "reuse"])
def test_lanes_do_not_matter_to_any_integrator(device: Device, integrator: str) -> None:
    settings = {"integrator": integrator, **({"photons": 2048} if integrator == "photon" else {})}
    assert len({hashed(device, lanes=lanes, **settings) for lanes in (1, 8, 16)}) == 1


def test_a_plugin_that_cannot_be_compiled_is_told_at_its_own_line(device: Device) -> None:
    text = edited(MINNAERT, ("power(wo.z * wi.z, p->k - 1.0f)", "power(wo, p->k - 1.0f)"))
    line = text[: text.index("power(wo, p->k")].count("\n") + 1
    with pytest.raises(UsageError, match=rf"^plugin:{line}:\d+: .*the plugin cannot be compiled for"):
        clrender.render(square(minnaert(), SKY), device=device, size=SIZE, spp=1, plugins=text)
    whole = clrender.render(square(minnaert(), SKY), device=device, size=SIZE, spp=1, plugins=MINNAERT)
    assert whole.linear.any(), "the device still works"


@pytest.mark.thorough
def test_a_session_knows_other_texts_of_a_plugin(device: Device) -> None:
    """The arrays are the same, and the program is not."""
    darker = edited(MINNAERT, ("(0.5f * INV_PI) * limb", "(0.25f * INV_PI) * limb"))
    scene = square(minnaert(k=1.0), sun((0.0, 0.0, -1.0)))
    with clrender.Session(device, plugins=MINNAERT) as session:
        bright = session.render(scene, size=SIZE, spp=1)
        batch = session.render_batch(
            scene, [{"type": "orthographic", "height": 0.2}, {"type": "orthographic", "height": 0.3}], size=SIZE, spp=1
        )
        with pytest.raises(UsageError, match="whose text is another"):
            session.render(scene, size=SIZE, spp=1, plugins=darker)
    np.testing.assert_allclose(batch, np.broadcast_to(bright.linear, batch.shape), rtol=1e-6)
    with clrender.Session(device) as session:
        made = [session.render(scene, size=SIZE, spp=1, plugins=text).linear for text in (MINNAERT, darker, MINNAERT)]
        with pytest.raises(ClrenderError, match="which is not given"):
            session.render(scene, size=SIZE, spp=1)
    np.testing.assert_array_equal(made[0], bright.linear)
    np.testing.assert_array_equal(made[0], made[2])
    np.testing.assert_allclose(made[1], made[0] * 0.5, rtol=1e-5)
