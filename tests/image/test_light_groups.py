"""Light groups add up to the image, and each is what its lights contribute."""

from __future__ import annotations

import itertools
import pickle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import clrender
from clrender.errors import SceneError, UsageError
from clrender.flatten.flat_scene import flatten
from clrender.flatten.light_groups import OTHERS, group_names, lit_by
from clrender.image.files import write_image
from clrender.rendering.light_groups import adding_up, group_channels
from clrender.scene import Scene

if TYPE_CHECKING:
    from clrender.device import Device

SIZE = (32, 24)
ROOM = [
    {"type": "quad", "origin": [-2, 0, 2], "edge_u": [4, 0, 0], "edge_v": [0, 0, -4], "material": "white"},
    {"type": "sphere", "center": [0.6, 0.5, 0.2], "radius": 0.5, "material": "glass"},
    {"type": "sphere", "center": [-0.7, 0.4, 0.0], "radius": 0.4, "material": "metal"},
]
LAMPS = [
    {"type": "quad", "origin": [-1, 2, 0], "edge_u": [0.5, 0, 0], "edge_v": [0, 0, 0.5], "emission": [9, 8, 7],
     "flip_normals": True, "light_group": "lamps"},
    {"type": "sphere", "center": [1.2, 1.6, 0.5], "radius": 0.15, "emission": {"checker": [20.0, 1.0]},
     "light_group": "ball"},
]  # fmt: skip
LIGHTS: list[dict[str, Any]] = [
    {"type": "point", "position": [0, 1.8, 1], "intensity": [2, 2, 3], "light_group": "lamps"},
    {
        "type": "spot",
        "position": [-1.5, 2, 1],
        "direction": [0.5, -1, -0.3],
        "intensity": [4, 1, 1],
        "cone_degrees": 50.0,
    },
    {"type": "directional", "direction": [0.2, -1, -0.4], "irradiance": [0.5, 0.5, 0.2], "light_group": "far"},
]


def described(around: dict[str, Any] | None = None, many: int = 0) -> Scene:
    lights = [*LIGHTS, *([around] if around else [])]
    more = [
        {"type": "point", "position": [0.1 * n - 1.0, 1.5, -1.0], "intensity": [0.1] * 3, "light_group": "many"}
        for n in range(many)
    ]
    scene = Scene(
        camera={"position": [0, 1.2, 4], "target": [0, 0.5, 0], "vertical_fov": 40.0},
        materials={
            "white": {"type": "lambert", "reflectance": [0.7, 0.7, 0.7]},
            "glass": {"type": "dielectric", "ior": 1.5},
            "metal": {"type": "conductor", "metal": "Au", "roughness": 0.3},
        },
        shapes=[*ROOM, *LAMPS],
        lights=[*lights, *more],
    )
    if (around or {}).get("file") != "sky":
        return scene
    return scene.with_arrays(environments={"sky": np.random.default_rng(1).random((8, 16, 3)).astype(np.float32)})


SKY = {"type": "environment", "file": "sky", "light_group": "sky"}
SUN = {"type": "sun_sky", "sun_direction": [0.4, 0.9, 0.5], "scale": 0.02, "light_group": "day"}
EVEN = {"type": "environment", "radiance": [0.3, 0.4, 0.5]}
WAYS: list[tuple[dict[str, Any] | None, int, dict[str, Any]]] = [
    (SKY, 0, {}),
    (SUN, 0, {"filter": "mitchell"}),
    (EVEN, 20, {"integrator": "direct"}),
    (None, 0, {"integrator": "whitted"}),
    (SKY, 0, {"integrator": "bdpt"}),
    (None, 20, {"integrator": "reuse"}),
    (EVEN, 0, {"integrator": "photon", "photons": 4000}),
    (SKY, 0, {"guiding": "on", "guiding_paths": 20000}),
    (SUN, 0, {"specular_chains": "on"}),
    (SKY, 0, {"crop": (5, 6, 20, 11), "kernels": "staged"}),
]


def check(session: clrender.Session, scene: Scene, how: dict[str, Any]) -> clrender.RenderedImage:
    """The image is that without groups, and all sums of the groups are the image."""
    image = session.render(scene, size=SIZE, spp=8, light_groups=True, **how)
    plain = session.render(scene, size=SIZE, spp=8, **how)
    np.testing.assert_array_equal(image.linear, plain.linear)
    assert list(image.light_groups) == image.stats["light_groups"]
    for order in itertools.islice(itertools.permutations(image.light_groups), 24):
        total = np.zeros_like(image.linear)
        for name in order:
            total = total + image.light_groups[name]
        if how.get("filter") == "mitchell":  # parts may be larger than the image
            np.testing.assert_allclose(total, image.linear, rtol=0.0, atol=1e-6)
        else:
            np.testing.assert_array_equal(total, image.linear)
    return image


def test_groups_add_up_to_the_image(device: Device) -> None:
    with clrender.Session(device.info.index) as session:
        image = check(session, described(SKY), {})
    assert list(image.light_groups) == ["ball", "far", "lamps", "sky", OTHERS]
    assert all(each.max() > 0.0 for each in image.light_groups.values())


@pytest.mark.long
@pytest.mark.parametrize(("around", "many", "how"), WAYS, ids=lambda each: str(each)[:30])
def test_groups_add_up_in_every_way(
    device: Device, around: dict[str, Any] | None, many: int, how: dict[str, Any]
) -> None:
    with clrender.Session(device.info.index) as session:
        check(session, described(around, many), how)


@pytest.mark.long
def test_groups_of_a_checkpoint_that_is_complete(device: Device, tmp_path: Path) -> None:
    """Are guided as its image was."""
    how: dict[str, Any] = {"size": SIZE, "spp": 8, "light_groups": True, "guiding": "on", "guiding_paths": 4096}
    with clrender.Session(device) as session:
        made = [
            session.render(described(), **how, checkpoint=tmp_path / "a.film", resume=resume)
            for resume in (False, True)
        ]
    for name, part in made[0].light_groups.items():
        np.testing.assert_array_equal(made[1].light_groups[name], part)


@pytest.mark.parametrize("around", [pytest.param(SKY, marks=pytest.mark.long), SUN], ids=["sky", "sun"])
def test_a_group_is_what_its_lights_contribute(device: Device, around: dict[str, Any]) -> None:
    """The same as a scene that has no other lights, but for the noise of the light samples."""
    scene = described(around)
    with clrender.Session(device.info.index) as session:
        images = [
            session.render(scene, size=(8, 6), spp=256, light_groups=True, seed=seed, max_depth=3) for seed in range(4)
        ]
        for name in images[0].light_groups:
            dark = [{key: value for key, value in each.items() if key != "emission"} for each in LAMPS]
            shapes = [lamp if lamp["light_group"] == name else off for lamp, off in zip(LAMPS, dark, strict=True)]
            lights = [each for each in (*LIGHTS, around) if each.get("light_group", OTHERS) == name]
            alone = scene.changed(shapes=[*ROOM, *shapes], lights=lights)
            found = [session.render(alone, size=(8, 6), spp=256, seed=9 + n, max_depth=3).linear for n in range(4)]
            means = [float(np.mean(each)) for each in found]
            parts = [float(image.light_groups[name].mean()) for image in images]
            error = np.hypot(np.std(means, ddof=1), np.std(parts, ddof=1)) / 2.0
            assert abs(np.mean(means) - np.mean(parts)) < 6.0 * error + 2e-3 * np.mean(means), name


def test_groups_in_files(device: Device, tmp_path: Path) -> None:
    with clrender.Session(device.info.index) as session:
        image = session.render(described(SKY), size=SIZE, spp=4, light_groups=True)
    image.save(tmp_path / "a.exr", exr_type="half")
    import OpenEXR

    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        channels = {name: channel.pixels for name, channel in file.channels().items()}
    for number, letter in enumerate("RGB"):
        parts = [channels[f"light.{name}.{letter}"] for name in image.light_groups]
        assert {each.dtype for each in parts} == {np.dtype(np.float32)}
        np.testing.assert_array_equal(np.sum(parts, axis=0), image.linear[..., number])


@pytest.mark.parametrize("name", ["", "x" * 61, "a\x00b", "a\nb"])
def test_names_that_no_layer_can_have_are_refused(name: str) -> None:
    with pytest.raises(SceneError, match=r"lights\[0\]\.light_group is .*, but must be a text of 1 to 60 printable"):
        described().changed({"lights[0].light_group": name})


def test_the_longest_names_are_channels(tmp_path: Path) -> None:
    image = np.ones((2, 2, 3), np.float32)
    groups = {"\U0001f4a1" * 60: image, "\U0001f4a1" * 59 + "b": image}
    write_image(tmp_path / "a.exr", image, channels=group_channels(groups))
    import OpenEXR

    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        assert set(file.channels()) == {"R", "G", "B", *group_channels(groups)}


def test_names_of_groups_change_no_hash() -> None:
    scene = described(SKY)
    plain = scene.changed({f"lights[{n}].light_group": None for n in (0, 2, 3)})
    assert scene.sha256() == plain.changed({"shapes[3].light_group": None}).sha256()
    job = clrender.RenderJob.of(scene, size=SIZE, light_groups=True)
    assert job.sha256() == clrender.RenderJob.of(scene, size=SIZE).sha256()
    text, assets = job.to_json()
    assert clrender.RenderJob.from_json(text, assets).light_groups
    assert pickle.loads(pickle.dumps(job)).light_groups


def test_sampling_does_not_change_with_the_group() -> None:
    flat = flatten(described(SKY, 20), 8, 8)
    assert group_names(flat) == ["ball", "far", "lamps", "many", "sky", OTHERS]
    for name in group_names(flat):
        part = lit_by(flat, name)
        for key in ("probability", "alias", "alias_threshold", "place", "kind"):
            np.testing.assert_array_equal(part.arrays["lights"][key], flat.arrays["lights"][key])
        assert part.features == flat.features and part.arrays_sha256 != flat.arrays_sha256


def test_sums_are_exact() -> None:
    rng = np.random.default_rng(2)
    whole = (10.0 ** rng.uniform(-9.0, 9.0, (50, 40, 3))).astype(np.float32)
    whole[0] = 0.0
    shares = rng.dirichlet([0.3] * 5, (50, 40, 3))
    parts = {f"{n}": (whole * shares[..., n]).astype(np.float32) for n in range(5)}
    rounded = adding_up(whole, parts)
    for order in itertools.permutations(rounded):
        total = np.zeros_like(whole)
        for name in order:
            total = total + rounded[name]
        np.testing.assert_array_equal(total, whole)
    for name, part in parts.items():
        assert (np.abs(rounded[name].astype(np.float64) - part) <= 4.0 * np.spacing(whole)).all()


def test_radiosity_has_no_light_groups() -> None:
    with pytest.raises(
        UsageError, match="the integrator radiosity solves for all light at once; leave one of them out"
    ):
        clrender.RenderJob.of(clrender.load("cornell"), integrator="radiosity", light_groups=True)
