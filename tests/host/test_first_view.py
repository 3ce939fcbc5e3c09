"""The first view of a model without a camera: from which side, of what, and how bright."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each
from gltf_files import Model

import clrender
from clrender.image.exposure import photographic_shutter, photographic_stops
from clrender.importers.surface_points import surface_points
from clrender.scene import Scene

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
FACES = {
    "left": (0, 1, 3, 2),
    "right": (4, 6, 7, 5),
    "bottom": (0, 4, 5, 1),
    "top": (2, 3, 7, 6),
    "back": (0, 2, 6, 4),
    "front": (1, 5, 7, 3),
}
"""Of a box with y up and z to the front; indices into CORNERS."""


def room(*open_sides: str, up: str = "y") -> str:
    """OBJ text of a box that lacks some sides, with a smaller box on its floor."""
    lines = []
    for number, (size, at) in enumerate((((4.0, 3.0, 4.0), (-2.0, 0.0, -2.0)), ((1.0, 1.0, 1.0), (-0.5, 0.0, -0.5)))):
        for x, y, z in CORNERS * size + np.array(at):
            lines.append(f"v {x} {y} {z}" if up == "y" else f"v {x} {-z} {y}")
        for name, face in FACES.items():
            if number or name not in open_sides:
                lines.append("f " + " ".join(str(8 * number + corner + 1) for corner in face))
    return "\n".join(lines)


def loaded(folder: Path, text: str, **how: Any) -> Scene:
    (folder / "model.obj").write_text(text)
    return clrender.load(folder / "model.obj", **how)


def toward(scene: Scene) -> np.ndarray[Any, Any]:
    way = np.array(scene.camera.target) - np.array(scene.camera.position)
    unit: np.ndarray[Any, Any] = way / np.linalg.norm(way)
    return unit


@for_each("up", ["y", "z"])
@for_each(
    ("side", "to"),
    [("right", (1.0, 0.0, 0.0)), ("left", (-1.0, 0.0, 0.0)), ("back", (0.0, 0.0, -1.0)), ("front", (0.0, 0.0, 1.0))],
)
def test_a_room_is_seen_through_its_open_side(tmp_path: Path, up: str, side: str, to: tuple[float, ...]) -> None:
    scene = loaded(tmp_path, room(side, up=up), up=up)
    x, y, z = to
    assert np.dot(toward(scene), to if up == "y" else (x, -z, y)) < -0.85
    assert side in scene.notes[0]


def test_a_room_without_a_ceiling_is_seen_from_above(tmp_path: Path) -> None:
    assert toward(loaded(tmp_path, room("top")))[1] < -0.9


@for_each("text", [room(), room("bottom"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3"])
def test_what_hides_no_more_from_the_front_is_seen_from_there(tmp_path: Path, text: str) -> None:
    scene = loaded(tmp_path, text)
    assert "from the front, a little from above" in scene.notes[0]
    np.testing.assert_allclose(-toward(scene), np.array((0.45, 0.35, 1.0)) / math.hypot(0.45, 0.35, 1.0), atol=1e-12)


def plate(number: int, half: float, z: float) -> str:
    """OBJ text of a square that faces the front."""
    corners = "".join(f"v {x} {y} {z}\n" for x, y in ((-half, -half), (half, -half), (half, half), (-half, half)))
    return corners + "f " + " ".join(str(4 * number + corner) for corner in (1, 2, 3, 4)) + "\n"


def test_what_hides_a_little_more_from_the_front_is_seen_from_there(tmp_path: Path) -> None:
    """A plate hides a sixth of all, which is seen from the left."""
    scene = loaded(tmp_path, plate(0, 3.0**0.5 / 2.0, 0.0) + plate(1, 0.4, 0.6))
    assert "from the front, a little from above" in scene.notes[0]


def test_some_triangles_stand_for_many(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("clrender.importers.surface_points._MOST_TRIANGLES", 64)
    many = "o many\n" + "".join(f"v {x} {y} 0\n" for y in range(21) for x in range(21))
    many += "".join(f"f {k} {k + 1} {k + 22} {k + 21}\n" for k in range(1, 420) if k % 21)
    scene = loaded(tmp_path, many + "o one\nv 100 0 0\nv 120 0 0\nv 120 20 0\nv 100 20 0\nf -4 -3 -2 -1\n")
    points = surface_points(scene)
    assert points.area == pytest.approx(800.0, rel=0.02)
    assert len(points.corners) < 100
    assert np.mean(points.positions[:, 0] > 50.0) == pytest.approx(0.5, abs=0.01)


def test_points_are_spread_by_area_over_instances_and_stand_for_all_of_it(tmp_path: Path) -> None:
    model = Model()
    mesh = model.quad()
    model.node(mesh=mesh)
    model.node(mesh=mesh, translation=[10, 0, 0], scale=[3, 1, 1])
    points = surface_points(clrender.load(model.write(tmp_path / "a.gltf")))
    assert points.area == pytest.approx(16.0)
    x = points.positions[:, 0]
    assert np.mean(x > 5.0) == pytest.approx(0.75, abs=1e-3)
    assert np.histogram(x[x > 5.0], 10, (7.0, 13.0))[0] == pytest.approx(0.075 * len(x), rel=0.05)
    np.testing.assert_allclose(points.normals, np.broadcast_to((0.0, 0.0, 1.0), points.normals.shape))


@for_each(
    ("shape", "area", "reach"),
    [
        ({"type": "sphere", "center": [1.0, 2.0, 3.0], "radius": 2.0}, 16.0 * math.pi, 2.0),
        ({"type": "disk", "center": [1.0, 2.0, 3.0], "normal": [0.0, 3.0, 4.0], "radius": 2.0}, 4.0 * math.pi, 2.0),
        ({"type": "box", "center": [1.0, 2.0, 3.0], "size": [2.0, 2.0, 2.0]}, 24.0, math.sqrt(3.0)),
    ],
)
def test_points_lie_on_every_kind_of_shape(shape: dict[str, Any], area: float, reach: float) -> None:
    points = surface_points(Scene(camera={"position": [0, 0, 9], "target": [0, 0, 0]}, shapes=[shape]))
    assert points.area == pytest.approx(area, rel=1e-3)
    away = points.positions - (1.0, 2.0, 3.0)
    assert np.sqrt((away**2).sum(axis=1)).max() == pytest.approx(reach, rel=0.02)
    if shape["type"] == "disk":
        assert np.abs(away @ (0.0, 0.6, 0.8)).max() < 1e-6
        assert np.abs(np.abs(points.normals @ (0.0, 0.6, 0.8)) - 1.0).max() < 1e-6
    if shape["type"] == "sphere":
        assert (np.sum(points.normals * away, axis=1) > 1.9).all()


def test_what_is_transparent_is_not_framed(tmp_path: Path) -> None:
    far = "\n".join(f"v {100 * x} {100 * y} {100 * z}" for x, y, z in CORNERS)
    hull = "\n".join("usemtl none\nf " + " ".join(str(corner + 1) for corner in face) for face in FACES.values())
    (tmp_path / "model.mtl").write_text("newmtl none\nd 0\nnewmtl some\nd 1\n")
    near = "\nusemtl some\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 9 10 11"
    scene = loaded(tmp_path, f"mtllib model.mtl\n{far}\n{hull}{near}")
    assert np.linalg.norm(np.array(scene.camera.position) - np.array(scene.camera.target)) < 5.0


@for_each("size", [(1.0, 1.0, 1.0), (8.0, 1.0, 1.0), (1.0, 8.0, 1.0), (1.0, 1.0, 8.0), (3.0, 2.0, 0.0)])
def test_a_box_fills_the_image_and_all_of_it_is_there(tmp_path: Path, size: tuple[float, ...]) -> None:
    corners = "\n".join(f"v {x} {y} {z}" for x, y, z in CORNERS * size)
    faces = FACES.values() if size[2] else [FACES["front"]]
    scene = loaded(tmp_path, corners + "".join("\nf " + " ".join(str(c + 1) for c in face) for face in faces))
    view, camera = toward(scene), scene.camera
    right = np.cross(view, camera.up)
    right /= np.linalg.norm(right)
    away = CORNERS * size - np.array(camera.position)
    slope = math.tan(math.radians(camera.vertical_fov) / 2.0)
    across, up = (np.abs(away @ axis) / (away @ view) / slope for axis in (right, np.cross(right, view)))
    assert 0.85 < max(across.max(), up.max()) < 1.0


def lit(folder: Path, radiance: float, **how: Any) -> Scene:
    """An open room with a lamp below its ceiling, in whose radiance it is."""
    (folder / "model.mtl").write_text(f"newmtl lamp\nKd 0 0 0\nKe {radiance} {radiance} {radiance}\n")
    lamp = "\nusemtl lamp\nv -0.5 2.9 -0.5\nv 0.5 2.9 -0.5\nv 0.5 2.9 0.5\nv -0.5 2.9 0.5\nf 17 18 19 20"
    return loaded(folder, f"mtllib model.mtl\n{room('front')}{lamp}", **how)


@for_each(("radiance", "words"), [(1e-4, "dim"), (0.05, "dim"), (2e3, "bright"), (1e8, "bright")])
def test_lights_of_any_strength_make_a_picture(tmp_path: Path, radiance: float, words: str) -> None:
    scene = lit(tmp_path, radiance)
    assert any(words in note for note in scene.notes)
    stops = photographic_stops(**(scene.camera.exposure or {}))
    assert 30.0 < radiance * 2.0**stops < 80.0
    assert scene.lights == ()


def test_twice_the_light_is_one_stop_less(tmp_path: Path) -> None:
    stops = [photographic_stops(**(lit(tmp_path, radiance).camera.exposure or {})) for radiance in (1e-3, 2e-3, 0.256)]
    assert stops[0] - stops[1] == pytest.approx(1.0)
    assert stops[0] - stops[2] == pytest.approx(8.0)


@for_each("how", [{}, {"environment": 1.0}])
def test_usual_lights_and_surroundings_are_not_exposed(tmp_path: Path, how: dict[str, Any]) -> None:
    assert lit(tmp_path, 1e-3 if how else 15.0, **how).camera.exposure is None


@for_each(("candela", "exposed"), [(50.0, True), (683.0 * 20.0, False), (1e9, True)])
def test_gltf_with_a_camera_of_its_own_is_exposed_too(tmp_path: Path, candela: float, exposed: bool) -> None:
    model = Model()
    model.node(mesh=model.quad())
    perspective = {"yfov": 0.7, "znear": 0.1, "aspectRatio": 1.5}
    model.node(camera=model.add("cameras", {"type": "perspective", "perspective": perspective}), translation=[0, 0, 4])
    model.extend("KHR_lights_punctual")
    lights = [{"type": "point", "intensity": candela}]
    model.root["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
    model.node(extensions={"KHR_lights_punctual": {"light": 0}}, translation=[0, 2, 3])
    scene = clrender.load(model.write(tmp_path / "a.gltf"))
    assert scene.camera.position == (0.0, 0.0, 4.0)
    assert (scene.camera.exposure is not None) is exposed


@for_each("stops", [-7, 0, 12])
def test_shutter_times_are_of_their_stops(stops: int) -> None:
    assert photographic_stops(4.0, photographic_shutter(stops, 4.0)) == pytest.approx(stops, abs=1e-12)


def test_shutter_times_stay_within_what_is_allowed() -> None:
    assert photographic_shutter(200, 4.0) == 1e6
    assert photographic_shutter(-200, 4.0) == 1e-6
