"""Bidirectional paths against those from the camera: each way to make them alone, every camera, filter and light."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from compiled_support import compile_with
from parts_support import apart, judge, rendered
from PIL import Image
from render_support import disk, lambert, quad, scene, sphere, triangle

import clrender
from clrender.image.files import write_image
from clrender.scene import Scene

if TYPE_CHECKING:
    from clrender.device import Device

ROUGH: Final = {"type": "principled", "base_color": [0.8, 0.6, 0.3], "metallic": 0.6, "roughness": 0.5, "coat": 0.4}
CLAY: Final = {"type": "oren_nayar", "reflectance": [0.5, 0.6, 0.7], "roughness": 0.6}
GLASS: Final = {"type": "dielectric", "ior": 1.4, "roughness": 0.5}
PAINT: Final = lambert((0.7, 0.3, 0.2))
MATERIALS: Final[dict[str, Any]] = {"white": lambert(0.7), "red": PAINT, "rough": ROUGH, "glass": GLASS, "clay": CLAY}


@pytest.fixture(scope="module")
def session(device: Device) -> Iterator[clrender.Session]:
    """One device for all tests."""
    with clrender.Session(device.info.index) as made:
        yield made


def plates(camera: Mapping[str, Any] | None = None) -> Scene:
    """Plates, balls and lights that are nowhere near each other: every way to join paths has a finite variance."""
    shapes = [
        quad((-2, 0, 2), (4, 0, 0), (0, 0, -4), material="white"),
        quad((-2, 0.5, -2.6), (4, 0, 0), (0, 2, 0), material="rough"),
        sphere((0.9, 1.3, 0.2), 0.4, material="clay"),
        sphere((-1.0, 1.4, 0.1), 0.4, material="red"),
        quad((-1, 3.2, 1), (0, 0, -2), (2, 0, 0), emission=6.0),
        sphere((1.9, 2.2, 1.2), 0.2, emission=9.0),
    ]
    what = scene(shapes, (), None, **MATERIALS)
    seen = {} if (camera or {}).get("type") in ("orthographic", "panoramic", "intrinsics") else {"vertical_fov": 48.0}
    placed = {"position": [0.2, 1.6, 4.2], "target": [0.0, 1.1, 0.0], **seen, **(camera or {})}
    return what.model_copy(update={"camera": type(what.camera).model_validate(placed)})


@pytest.mark.parametrize(
    ("side", "counts"),
    [
        ("CAMERA", (2,)),
        pytest.param("CAMERA", (1, 3), marks=pytest.mark.long),
        pytest.param("LIGHT", (0, 1, 2), marks=pytest.mark.long),
    ],
)
def test_each_way_alone_finds_all(
    device: Device, session: clrender.Session, monkeypatch: pytest.MonkeyPatch, side: str, counts: tuple[int, ...]
) -> None:
    """All ways with 1, 2 or 3 vertices of the camera, or with 0, 1 or 2 of the light, count in full, and no others."""
    what, more = plates(), {"spp": 48, "max_depth": 4}
    truth = rendered(session, what, 1000, {**more, "integrator": "path", "spp": 128})
    found = []
    for count in counts:
        compile_with(monkeypatch, **{f"ONLY_{side}_VERTICES": f"{count}u"})
        with clrender.Session(device.info.index) as own:  # the session of all tests keeps its workers
            shown = rendered(own, what, 1, {**more, "integrator": "bdpt"})
        found.append((f"{count} of {side}", apart(truth, shown)))
    judge(found)


BARREL: Final = {"model": "brown-conrady", "k": [-0.3, 0.1, 0.0, 0.05], "p": [0.01, -0.02]}
CAMERAS: Final[Mapping[str, dict[str, Any]]] = {
    "pinhole": {},
    "lens": {"aperture_radius": 0.2, "focus_distance": 3.5, "blades": 5},
    "parallel": {"type": "orthographic", "height": 3.0},
    "parallel with lens": {"type": "orthographic", "height": 3.0, "aperture_radius": 0.15},
    "panoramic": {"type": "panoramic", "position": [0.1, 1.2, 1.2]},
    "fisheye": {"type": "fisheye", "vertical_fov": 150.0, "position": [0.1, 1.2, 1.6]},
    "mirrored": {"mirrored": True},
    "shifted": {"lens_shift": [0.2, -0.1]},
    "calibrated": {"type": "intrinsics", "fx": 90.0, "skew": 4.0, "resolution": [64, 64], "distortion": BARREL},
    "calibrated with lens": {
        "type": "intrinsics", "fx": 90.0, "resolution": [64, 64], "distortion": BARREL, "aperture_radius": 0.2,
        "focus_distance": 3.5,
    },
    "calibrated fisheye": {
        "type": "intrinsics", "fx": 25.0, "cy": 35.0, "resolution": [64, 64], "position": [0.1, 1.2, 1.6],
        "distortion": {"model": "kannala-brandt", "k": [0.05, -0.02]},
    },
}  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize(
    "pixel_filter",
    [{"filter": "box"}, {"filter": "mitchell"}, {"filter": "gaussian", "filter_radius": 3.0}],
    ids=lambda each: each["filter"],
)
def test_cameras_see_what_light_paths_bring(
    device: Device, session: clrender.Session, monkeypatch: pytest.MonkeyPatch, pixel_filter: dict[str, Any]
) -> None:
    """By splats alone: where they land, how they count, and how pixels that a filter reaches share them.

    A density that is 5 % too large is found.
    """
    found, pictures = [], {name: plates(camera) for name, camera in CAMERAS.items()}
    more = {"max_depth": 2, **pixel_filter}
    truth = {name: rendered(session, what, 1000, {**more, "spp": 256}) for name, what in pictures.items()}
    compile_with(monkeypatch, ONLY_CAMERA_VERTICES="1u")
    with clrender.Session(device.info.index) as own:
        for name, what in pictures.items():
            shown = rendered(own, what, 1, {**more, "integrator": "bdpt", "spp": 256})
            found.append((name, apart(truth[name], shown)))
    judge(found)


def lights(folder: Path) -> dict[str, tuple[list[dict[str, Any]], list[dict[str, Any]]]]:
    """Shapes and lights by name; their files are written into `folder`."""
    head = "IESNA91\nTILT=NONE\n1 -1 1 3 2 1 2 0 0 0\n1 1 1\n"
    (folder / "lamp.ies").write_text(head + "0 50 90\n0 180\n900 700 100\n900 200 50\n")
    Image.fromarray(np.arange(90, dtype=np.uint8).reshape(5, 6, 3)).save(folder / "slide.png")
    sky = np.full((8, 16, 3), 0.2, np.float32)
    sky[2, 4] = 20.0
    write_image(folder / "sky.exr", sky)
    at = {"position": [0.5, 3.0, 0.8], "direction": [-0.2, -1.0, -0.1]}
    return {
        "point": ([], [{"type": "point", "position": [0.5, 3.0, 0.8], "intensity": [9, 8, 7]}]),
        "spot": ([], [{"type": "spot", **at, "intensity": [30, 30, 20], "cone_degrees": 60.0, "blend": 0.5}]),
        "ies": ([], [{"type": "ies", **at, "file": "lamp.ies", "scale": 0.02}]),
        "projector": ([], [{"type": "projector", **at, "file": "slide.png", "vertical_fov": 60.0, "scale": 0.1}]),
        "directional": ([], [{"type": "directional", "direction": [0.3, -1, -0.2], "irradiance": [2, 2, 2]}]),
        "sun and sky": ([], [{"type": "sun_sky", "sun_direction": [0.4, 0.9, 0.5], "scale": 1e-4}]),
        "even sky": ([], [{"type": "environment", "radiance": [0.5, 0.6, 0.7]}]),
        "picture": ([], [{"type": "environment", "file": "sky.exr"}]),
        "triangle": ([triangle([(-1, 3, 0), (0, 3.1, 1), (1, 2.9, 0)], emission=5.0)], []),
        "disk": ([disk((0.2, 3.0, 0.4), (0.1, -1, 0), 0.5, emission=5.0)], []),
        "ball": ([sphere((0.5, 2.9, 0.6), 0.25, emission=20.0)], []),
        "dome": ([sphere((0.0, 1.0, 0.0), 6.0, emission=0.5, flip_normals=True)], []),
        "texture": ([quad((-1, 3.2, 1), (0, 0, -2), (2, 0, 0), emission={"checker": [8.0, 0.5]})], []),
        "many": (
            [sphere((-1.8 + 0.9 * n, 2.9, 0.6), 0.1, emission=10.0 + 20.0 * n) for n in range(4)],
            [{"type": "point", "position": [-1.0, 2.5, 1.0], "intensity": [4, 2, 1]}],
        ),
    }  # fmt: skip


@pytest.mark.long
def test_lights_of_every_kind(session: clrender.Session, tmp_path: Path) -> None:
    """All ways together, by their weights."""
    found = []
    for name, (shapes, given) in lights(tmp_path).items():
        what = lit(tmp_path, shapes, given)
        truth = rendered(session, what, 1000, {"spp": 96, "max_depth": 3})
        shown = rendered(session, what, 1, {"spp": 32, "max_depth": 3, "integrator": "bdpt"})
        found.append((name, apart(truth, shown)))
    judge(found)


def lit(folder: Path, shapes: list[dict[str, Any]], given: list[dict[str, Any]]) -> Scene:
    """A few surfaces under these lights."""
    around = [
        quad((-2, 0, 2), (4, 0, 0), (0, 0, -4), material="white"),
        quad((-2, 0.0, -2.0), (4, 0, 0), (0, 2, 0), material="rough"),
        sphere((0.7, 0.7, 0.2), 0.5, material="glass"),
        sphere((-0.8, 0.6, 0.1), 0.5, material="red"),
    ]
    camera = {"position": [0.2, 1.6, 4.2], "target": [0.0, 0.8, 0.0], "vertical_fov": 45.0}
    content = {"camera": camera, "materials": MATERIALS, "shapes": [*around, *shapes], "lights": given}
    return Scene.model_validate(content).placed("here", folder)


@pytest.mark.long
def test_light_paths_begin_in_the_media_around_their_lights(session: clrender.Session) -> None:
    """A lamp in a cloud, and one in a ball of coloured glass, whose light the camera finds from outside of them."""
    media = {"smoke": {"scattering": [0.5, 0.4, 0.3], "absorption": 0.1, "g": 0.3}}
    glass = {
        "type": "dielectric",
        "ior": 1.5,
        "roughness": 0.6,
        "priority": 1,
        "attenuation_color": [0.9, 0.5, 0.2],
        "attenuation_distance": 0.3,
    }
    shapes = [
        quad((-3, 0, 3), (6, 0, 0), (0, 0, -6), material="white"),
        {"type": "box", "center": [-0.8, 1.0, 0.0], "size": [1.4, 1.4, 1.4], "interior": "smoke"},
        sphere((-0.8, 1.0, 0.0), 0.2, emission=12.0),
        sphere((1.2, 1.0, 0.0), 0.6, material="glass"),
        sphere((1.2, 1.0, 0.0), 0.15, emission=20.0),
    ]
    camera = {"position": [0.2, 1.6, 4.2], "target": [0.0, 0.8, 0.0], "vertical_fov": 45.0}
    content = {"camera": camera, "materials": {**MATERIALS, "glass": glass}, "shapes": shapes, "media": media}
    what = Scene.model_validate(content)
    truth = rendered(session, what, 1000, {"spp": 128, "max_depth": 4})
    shown = rendered(session, what, 1, {"spp": 32, "max_depth": 4, "integrator": "bdpt"})
    judge([("media", apart(truth, shown))])
