"""Shadow catchers: the camera sees nothing where they are, all else sees them, and a background gets their shadows."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

import clrender
from clrender.cli import main
from clrender.errors import SceneError, UsageError
from clrender.flatten.flat_scene import flatten
from clrender.rendering.shadow_catchers import caught, whole_and_bare
from clrender.scene import Scene

if TYPE_CHECKING:
    from clrender.device import Device

_Table = dict[str, Any]
_Image = npt.NDArray[np.float32]

SIZE = (40, 32)
FLOOR = {"type": "quad", "origin": [-30, 0, 30], "edge_u": [60, 0, 0], "edge_v": [0, 0, -60], "material": "grey"}
BALL = {"type": "sphere", "center": [0.0, 0.7, 0.0], "radius": 0.5, "material": "red"}
MIRROR = {"type": "sphere", "center": [1.0, 0.5, 0.0], "radius": 0.4, "material": "mirror"}
POINT = {"type": "point", "position": [1.5, 4.0, 1.0], "intensity": [30.0, 30.0, 30.0]}
SKY = {"type": "environment", "radiance": [0.3, 0.4, 0.6]}
INTEGRATORS = ("path", "direct", "whitted", "bdpt", "photon", "reuse")


def scene_of(*shapes: _Table, lights: tuple[_Table, ...] = (POINT, SKY), **more: Any) -> Scene:
    return Scene.model_validate(
        {
            "camera": {"position": [0.0, 2.0, 5.0], "target": [0.0, 0.5, 0.0], "vertical_fov": 40.0},
            "materials": {
                "grey": {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]},
                "red": {"type": "lambert", "reflectance": [0.8, 0.1, 0.1]},
                "mirror": {"type": "mirror"},
                "net": {"type": "lambert", "reflectance": [0.5, 0.5, 0.5], "opacity": 0.4},
            },
            "shapes": list(shapes),
            "lights": list(lights),
            **more,
        }
    )


def catching(shape: _Table) -> _Table:
    return {**shape, "shadow_catcher": True}


def rendered(device: Device, scene: Scene, **more: Any) -> clrender.RenderedImage:
    settings: _Table = {"spp": 16, "size": SIZE, **more}
    if settings.get("integrator") == "photon":
        settings["photons"] = 2000
    return clrender.render(scene, device=device, **settings)


FOG = {"media": {"mist": {"absorption": [0.02] * 3, "scattering": [0.1] * 3}}, "fog": "mist"}


@pytest.mark.parametrize(
    ("integrator", "more"),
    [
        pytest.param("path", {}, id="path"),
        pytest.param("path", FOG, id="path in fog", marks=pytest.mark.long),
        *(pytest.param(name, {}, id=name, marks=pytest.mark.long) for name in INTEGRATORS[1:]),
        *(pytest.param(n, FOG, id=f"{n} in fog", marks=pytest.mark.slow) for n in ("bdpt", "photon", "direct")),
    ],
)
def test_what_is_black_may_as_well_be_held_out(device: Device, integrator: str, more: _Table) -> None:
    """A floor without a material is black to the camera, and to all else, whether it catches shadows or not."""
    black = {key: value for key, value in FLOOR.items() if key != "material"}
    lights = (POINT,) if more or integrator == "whitted" else (POINT, SKY)
    seen, held = (
        rendered(
            device,
            scene_of(floor, BALL, MIRROR, lights=lights, **more).with_hidden_environment(),
            integrator=integrator,
        )
        for floor in (black, catching(black))
    )
    if integrator == "reuse":  # whose pixels share what their neighbours found
        assert abs(seen.linear.mean() / held.linear.mean() - 1.0) < 0.02
        return
    np.testing.assert_allclose(held.linear, seen.linear, rtol=2e-5, atol=1e-6)
    assert held.linear.max() > 0.1 and (held.linear == seen.linear).mean() > 0.95


@pytest.mark.long
def test_one_field_guides_the_image_and_its_shadows(device: Device) -> None:
    """So that all are of the same samples, and what is solid stays so."""
    how: _Table = {"guiding": "on", "guiding_paths": 4096, "aov": ("alpha", "instance")}
    image = rendered(device, scene_of(catching(FLOOR), BALL), **how)
    assert image.alpha is not None
    solid = (image.mask("instance") == image.labels["instance"][-1].number) & (image.aovs["instance"][..., 1] == 1.0)
    assert solid.sum() > 20 and (image.alpha[solid] == 1.0).all()


@pytest.mark.parametrize(
    "integrator", [pytest.param(name, marks=() if name == "path" else pytest.mark.long) for name in INTEGRATORS]
)
def test_the_camera_sees_none_of_it(device: Device, integrator: str) -> None:
    """Not by its rays, nor by the paths of light of bdpt; a mirror shows it as ever."""
    assert not rendered(device, scene_of(catching(FLOOR)), integrator=integrator).linear.any()
    only, whole = (
        rendered(device, scene_of(floor, MIRROR, lights=(POINT,)), integrator=integrator, aov="instance")
        for floor in (catching(FLOOR), FLOOR)
    )
    number, share = np.moveaxis(only.aovs["instance"], 2, 0)
    mirror = (number == 2.0) & (share == 1.0)
    assert 15 < mirror.sum() < 0.2 * mirror.size and not only.linear[(number == 0.0) & (share == 0.0)].any()
    if integrator not in ("reuse", "bdpt"):
        np.testing.assert_allclose(only.linear[mirror], whole.linear[mirror], rtol=1e-5)


def test_layers_see_what_is_around_it(device: Device) -> None:
    layers = ("alpha", "depth", "instance", "shadow_catcher")
    image = rendered(device, scene_of(catching(FLOOR), BALL), aov=layers, spp=32)
    depth, instance = image.aovs["depth"][..., 0], image.mask("instance")
    assert np.isinf(depth[-1]).all() and np.isfinite(depth).any() and set(np.unique(instance)) == {0, 2}
    assert list(image.aovs) == list(layers)
    assert all(layer[..., 0].flags.c_contiguous for layer in image.aovs.values()), "what is written is not copied"


def test_a_shadow_is_where_it_must_be(device: Device) -> None:
    """A black disk before a point light: behind it no light, around it all of it, to the bit."""
    disk = {"type": "disk", "center": [0.0, 1.0, 0.0], "normal": [0.0, 1.0, 0.0], "radius": 0.5}
    light = {"type": "point", "position": [0.0, 3.0, 0.0], "intensity": [20.0, 20.0, 20.0]}
    camera = {
        "type": "orthographic",
        "position": [0.0, 0.5, 0.0],
        "target": [0.0, 0.0, 0.0],
        "up": [0, 0, 1],
        "height": 4.0,
    }
    scene = scene_of(catching(FLOOR), disk, lights=(light,), camera=camera)
    image = rendered(device, scene, size=(64, 64), aov="shadow_catcher", spp=16)
    factor, alpha = image.aovs["shadow_catcher"], image.alpha
    assert alpha is not None and not image.linear.any()
    x, y = np.meshgrid((np.arange(64) + 0.5) / 16.0 - 2.0, (np.arange(64) + 0.5) / 16.0 - 2.0)
    away = np.hypot(x, y) - 0.75  # the shadow's radius on the floor
    assert (factor[away > 0.1] == 1.0).all() and (factor[away < -0.1] == 0.0).all()
    assert (alpha[away > 0.1] == 0.0).all() and (alpha[away < -0.1] == 1.0).all()
    assert 0.0 < factor[np.abs(away) < 0.03].mean() < 1.0


@pytest.mark.parametrize("integrator", ["path", pytest.param("bdpt", marks=pytest.mark.slow)])
def test_over_the_bare_floor_it_is_the_whole_scene(device: Device, integrator: str) -> None:
    """A photograph of the floor with what is added comes out as a photograph with the objects there."""
    scene = scene_of(catching(FLOOR), BALL, MIRROR, catching({**BALL, "center": [-1.2, 0.5, 0.0]}))
    more: _Table = {"integrator": integrator, "spp": 64}
    image = rendered(device, scene, aov="shadow_catcher", **more)
    whole, bare = (rendered(device, each, seed=1, **more) for each in whole_and_bare(scene))
    over = image.linear + image.aovs["shadow_catcher"] * bare.linear
    noise = np.abs(over - whole.linear).mean() / whole.linear.mean()
    assert abs(over.mean() / whole.linear.mean() - 1.0) < 0.02 and noise < 0.2


def test_colours_of_objects_fall_onto_the_background(device: Device) -> None:
    factor = rendered(device, scene_of(catching(FLOOR), BALL, lights=(SKY,)), aov="shadow_catcher", spp=256).aovs[
        "shadow_catcher"
    ]
    below = factor[20:26, 12:28]
    assert below[..., 0].mean() > below[..., 2].mean() + 0.02, "red from the ball"


@pytest.mark.long
def test_instances_and_holes(device: Device) -> None:
    """In a group, and where half of it is not there."""
    group = {"ground": {"shapes": [catching(FLOOR)]}}
    placed = {"type": "instance", "group": "ground"}
    plain, instanced = (
        rendered(device, scene_of(floor, BALL, groups=group), aov="shadow_catcher", spp=64)
        for floor in (catching(FLOOR), placed)
    )
    np.testing.assert_allclose(plain.linear.mean(), instanced.linear.mean(), rtol=0.02)
    ours, theirs = (each.aovs["shadow_catcher"].mean() for each in (plain, instanced))
    assert abs(ours - theirs) < 0.01
    below = {**FLOOR, "origin": [-30, -0.5, 30], "material": "grey"}
    image = rendered(device, scene_of(catching({**FLOOR, "material": "net"}), below, lights=(POINT,)), spp=64)
    through = rendered(device, scene_of({**FLOOR, "material": "net"}, below, lights=(POINT,)), spp=64)
    assert 0.3 < image.linear.mean() / through.linear.mean() < 0.75, "0.6 of the rays see what is below"


def test_what_a_background_is_multiplied_by() -> None:
    """Known numbers: a pixel of sky, one of catcher, half and half, one of object, and one that no light reaches."""
    one = np.ones((1, 1, 3), np.float32)

    def of(image: float, alpha: float, whole: tuple[float, float], bare: tuple[float, float]) -> tuple[float, float]:
        pairs = [(one * radiance, one[..., 0] * share) for radiance, share in (whole, bare)]
        factor, covered = caught(one * image, one[..., 0] * alpha, *pairs)
        return float(factor[0, 0, 0]), float(covered[0, 0])

    assert of(0.0, 0.0, (0.0, 0.0), (0.0, 0.0)) == (1.0, 0.0)
    assert of(0.0, 0.0, (0.25, 1.0), (0.5, 1.0)) == (0.5, 0.5)
    assert of(0.0, 0.0, (0.125, 0.5), (0.25, 0.5)) == (0.75, 0.25)
    assert of(2.0, 1.0, (2.0, 1.0), (0.5, 1.0)) == (0.0, 1.0)
    assert of(0.0, 0.0, (0.0, 1.0), (0.0, 1.0)) == (1.0, 0.0), "no light, no shadow"
    assert of(0.0, 0.0, (1.0, 1.0), (0.5, 1.0)) == (2.0, 0.0), "lighter than before"
    assert of(1.0, 0.5, (1.25, 1.0), (0.5, 1.0)) == (0.5, 0.5), "half of it an object, the other half not darkened"


def test_lamps_stay_and_other_shapes_go() -> None:
    lamp = {**BALL, "emission": [1.0, 1.0, 1.0]}
    groups = {"both": {"shapes": [lamp, MIRROR]}, "dark": {"shapes": [MIRROR]}}
    placed = [{"type": "instance", "group": name} for name in groups]
    whole, bare = whole_and_bare(scene_of(catching(FLOOR), BALL, lamp, *placed, groups=groups))
    assert [len(each.shapes) for each in (whole, bare)] == [5, 3]
    assert len(bare.groups["both"].shapes) == 1 and "dark" not in bare.groups
    assert not whole.has_shadow_catchers and not bare.has_shadow_catchers
    assert whole.environment is not None and not whole.environment.visible_to_camera


@pytest.mark.parametrize(
    ("shapes", "words"),
    [
        (
            [{**FLOOR, "shadow_catcher": True, "emission": [1, 1, 1]}],
            "is given for what shines, and its own light is no shadow",
        ),
        ([{**FLOOR, "shadow_catcher": True, "visible_to_camera": False}], "what the camera does not see"),
    ],
)
def test_what_is_refused(shapes: list[_Table], words: str) -> None:
    with pytest.raises((SceneError, ValueError), match=words):
        scene_of(*shapes)


def test_jobs_say_what_they_lack() -> None:
    with pytest.raises(UsageError, match="the layer shadow_catcher needs a shape with shadow_catcher = true"):
        clrender.RenderJob.of(scene_of(FLOOR), aov=("shadow_catcher",))
    with pytest.raises(SceneError, match=r"shapes\[0\].shadow_catcher is true, which the integrator radiosity"):
        clrender.RenderJob.of(scene_of(catching(FLOOR)), integrator="radiosity")
    assert clrender.RenderJob.of(scene_of(FLOOR), aov="alpha").aov == ("alpha",)
    job = clrender.RenderJob.of(scene_of(catching(FLOOR)), aov="alpha")
    assert set(job.aov) == {"alpha", "shadow_catcher"}
    again = clrender.RenderJob.from_json(*job.to_json())
    assert again.aov == job.aov


def test_hashes_of_scenes_without_are_what_they_were() -> None:
    plain, said = scene_of(FLOOR, BALL), scene_of({**FLOOR, "shadow_catcher": False}, BALL)
    assert plain.sha256() == said.sha256() != scene_of(catching(FLOOR), BALL).sha256()
    ours, theirs = (flatten(each, 8, 8).arrays_sha256 for each in (plain, scene_of(catching(FLOOR), BALL)))
    assert ours != theirs


@pytest.mark.long
@pytest.mark.parametrize("more", [{"lanes": 1}, {"lanes": 8, "tile": 16}, {"kernels": "staged"}], ids=str)
def test_the_bits_do_not_depend_on_lanes_and_stages(device: Device, more: _Table) -> None:
    scene = scene_of(catching(FLOOR), BALL, MIRROR, catching({**BALL, "center": [-1.2, 0.5, 0.0], "material": "net"}))
    images = [rendered(device, scene, spp=4, aov="alpha", **settings) for settings in ({}, more)]
    assert images[0].stats["image_sha256"] == images[1].stats["image_sha256"]
    assert images[0].aovs["shadow_catcher"].tobytes() == images[1].aovs["shadow_catcher"].tobytes()


def test_pngs_darken_what_is_behind_them(device: Device, tmp_path: Path) -> None:
    """From the command line, and the batch of Python."""
    (tmp_path / "s.toml").write_text(
        """
        [camera]
        position = [0, 2, 5]
        target = [0, 0.5, 0]
        [materials.grey]
        type = "lambert"
        reflectance = [0.5, 0.5, 0.5]
        [[shapes]]
        type = "quad"
        origin = [-30, 0, 30]
        edge_u = [60, 0, 0]
        edge_v = [0, 0, -60]
        material = "grey"
        shadow_catcher = true
        [[shapes]]
        type = "sphere"
        center = [0, 0.7, 0]
        radius = 0.5
        material = "grey"
        [[lights]]
        type = "point"
        position = [1.5, 4, 1]
        intensity = [30, 30, 30]
        """
    )
    arguments = ["render", str(tmp_path / "s.toml"), "-o", str(tmp_path / "s.png"), "--alpha", "--size", "40x32"]
    with pytest.raises(SystemExit, match="0"):
        main([*arguments, "--spp", "16", "-d", str(device.info.index)])
    pixels = np.asarray(Image.open(tmp_path / "s.png"))
    dark = (pixels[..., :3] == 0).all(axis=2) & (pixels[..., 3] > 200)
    assert dark.sum() > 8 and (pixels[0, :, 3] == 0).all(), "a black shadow, and nothing far away"
    scene = clrender.load(str(tmp_path / "s.toml"))
    ours = clrender.render(scene, size=(40, 32), spp=16, aov="alpha", device=device)
    batch = clrender.render_batch(scene, [scene.camera], size=(40, 32), spp=16, aov="alpha", device=device)
    assert ours.alpha is not None and batch[0, ..., 3].tobytes() == ours.alpha.tobytes()
    assert clrender.verify(tmp_path / "s.png", scene=scene, device=device).sound


def test_a_render_that_was_stopped_has_none(device: Device) -> None:
    told: list[str] = []
    with clrender.Session(device, notify=told.append) as session:
        calls = iter([False] * 3)
        image = session.render(
            scene_of(catching(FLOOR), BALL), spp=4096, size=(64, 64), aov="alpha", should_stop=lambda: next(calls, True)
        )
    assert image.interrupted and "shadow_catcher" not in image.aovs
    assert any("no layer of shadow catchers" in line for line in told)
