"""What touches is moved apart by a few roundings, by rule; what no rule decides is told."""

from __future__ import annotations

import tracemalloc
from typing import Any

import numpy as np
import pytest

import clrender
from clrender.flatten import faces, shape_faces, touching
from clrender.flatten import near_pairs as near_pairs_module
from clrender.flatten.attributes import COLORS
from clrender.flatten.flat_scene import flatten
from clrender.flatten.near_pairs import near_pairs

CAMERA = {"position": [0.0, 1.0, 5.0], "target": [0.0, 0.0, 0.0]}
MATERIALS: dict[str, Any] = {
    "grey": {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]},
    "red": {"type": "lambert", "reflectance": [0.5, 0.1, 0.1]},
    "glass": {"type": "dielectric", "ior": 1.5},
    "leaf": {"type": "lambert", "reflectance": [0.5, 0.5, 0.5], "opacity": 0.5},
}
FLOOR: dict[str, Any] = {
    "type": "quad",
    "origin": [-6, 0, 6],
    "edge_u": [12, 0, 0],
    "edge_v": [0, 0, -12],
    "material": "grey",
}
RUG = {**FLOOR, "origin": [-1, 0, 1], "edge_u": [2, 0, 0], "edge_v": [0, 0, -2], "material": "red"}
CUBE: dict[str, Any] = {"type": "box", "center": [0, 0.5, 0], "size": [1, 1, 1]}


def flat_of(*shapes: dict[str, Any], **more: Any) -> Any:
    return flatten(clrender.Scene(camera=CAMERA, shapes=shapes, materials=MATERIALS, **more), 8, 8)


def told(*shapes: dict[str, Any]) -> list[str]:
    return [text for text in flat_of(*shapes).warnings if "coincide" in text]


@pytest.mark.parametrize("first", [0, 1])
def test_a_rug_in_the_floor_is_told(first: int) -> None:
    shapes = [FLOOR, RUG] if first == 0 else [RUG, FLOOR]
    (text,) = told(*shapes)
    assert text.startswith("Scene: shapes[0] and shapes[1]: their faces coincide, and either may be seen")


@pytest.mark.parametrize(
    "shapes",
    [
        [FLOOR, {**RUG, "material": "grey"}],  # looks like the floor
        [FLOOR, {**RUG, "origin": [-1, 1e-4, 1]}],  # lies on it
        [FLOOR, {**CUBE, "material": "red"}],  # stands on it: nobody sees between
        [FLOOR, {**RUG, "material": "leaf"}],  # may let light through
        [FLOOR, {**FLOOR, "origin": [6, 0, 6], "material": "red"}],  # beside it
        [FLOOR, {**RUG, "emission": [1, 1, 1]}, {**CUBE, "material": "glass"}],  # decided
    ],
    ids=["same material", "on it", "standing", "masked", "beside", "by rule"],
)
def test_what_is_decided_or_harmless_is_not_told(shapes: list[dict[str, Any]]) -> None:
    assert told(*shapes) == []


@pytest.mark.parametrize("inner", [[0.5, 1.0, 0.5], [1, 1, 1]])
def test_glass_in_glass_with_shared_faces_is_told(inner: list[float]) -> None:
    shapes = [{**CUBE, "material": "glass"}, {**CUBE, "size": inner, "material": "glass"}]
    (text,) = told(FLOOR, *shapes)
    assert text.startswith("Scene: shapes[1] and shapes[2]: faces of two dielectrics or media coincide")


def test_only_what_touches_moves() -> None:
    alone, lifted = flat_of(FLOOR, {**CUBE, "center": [0, 0.6, 0], "material": "glass"}), flat_of(FLOOR)
    assert alone.triangle_count == 14 and lifted.triangle_count == 2
    touched = flat_of(FLOOR, {**CUBE, "material": "glass"})
    assert touched.triangle_count == 16, "the floor's two triangles are there twice"
    heights = touched.arrays["vertices"][touched.arrays["triangles"][:4]][..., 1]
    assert sorted(np.sign(heights.max(axis=1)).tolist()) == [-1.0, -1.0, 1.0, 1.0]
    assert (heights == heights[:, :1]).all() and 0.0 < np.abs(heights).max() < 1e-4
    box = touched.arrays["vertices"][touched.arrays["triangles"][4:]]
    before = alone.arrays["vertices"][alone.arrays["triangles"][2:]]
    np.testing.assert_allclose(box + np.array([0, 0.1, 0], np.float32), before, atol=1e-6)
    assert touched.arrays["primitive_shape"].tolist() == [0] * 4 + [1] * 12


def test_copies_keep_their_attributes_and_normals() -> None:
    corners = [[-6, 0, 6], [6, 0, 6], [6, 0, -6], [-6, 0, -6]]
    mesh = {
        "type": "mesh",
        "vertices": corners,
        "faces": [[0, 1, 2], [0, 2, 3]],
        "uvs": [[0, 0], [1, 0], [1, 1], [0, 1]],
        "colors": [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]],
        "material": "grey",
    }
    alone, touched = flat_of(mesh), flat_of(mesh, {**CUBE, "material": "glass"})
    before, after = (flat.arrays["attribute_rows"] for flat in (alone, touched))
    for copy, original in ((0, 0), (1, 0), (2, 1), (3, 1)):
        np.testing.assert_array_equal(after[copy, :6], before[original, :6])
        colors = [rows[int(rows[at, COLORS].view(np.uint32))] for rows, at in ((after, copy), (before, original))]
        np.testing.assert_array_equal(colors[0], colors[1])
    assert before[:, COLORS].any()


@pytest.mark.parametrize("counts", [(1, 1), (3, 500), (400, 700)])
def test_near_pairs_are_all_pairs(counts: tuple[int, int]) -> None:
    random = np.random.default_rng(1)
    first, second = (
        np.concatenate([low, low + random.random((n, 3)) * 0.1], axis=1)
        for n, low in ((n, random.random((n, 3))) for n in counts)
    )
    found = near_pairs(first, second, 1 << 20)
    assert found is not None
    every = ((first[:, None, :3] <= second[:, 3:]) & (second[:, :3] <= first[:, None, 3:])).all(axis=2)
    assert sorted(zip(*(each.tolist() for each in found), strict=True)) == [
        tuple(x) for x in np.argwhere(every).tolist()
    ]
    assert counts[0] < 100 or near_pairs(first, second, 10) is None


@pytest.mark.parametrize("seed", range(4))
def test_few_faces_touch_as_among_many(monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    """All pairs of few faces are looked at, and those of many by the boxes of their shapes: in the same order."""
    random = np.random.default_rng(seed)
    corners = random.integers(-2, 3, (60, 3, 3)).astype(np.float64)
    corners[..., 2] = random.integers(0, 2, (60, 1))
    numbers = np.arange(60)
    some = faces.Faces(corners, numbers, random.integers(0, 9, 60), np.ones(60))
    few = faces.coplanar_among(some)
    monkeypatch.setattr(faces, "_FEW", 0)
    monkeypatch.setattr(near_pairs_module, "_FEW", 0)
    many = faces.coplanar_among(some)
    assert few is not None and many is not None and len(few.first) > 50
    for name in faces.Contacts.__annotations__:
        np.testing.assert_array_equal(getattr(few, name), getattr(many, name))


def test_cross_products_have_the_bits_of_numpy() -> None:
    a, b = np.random.default_rng(3).normal(size=(2, 1000, 3))
    np.testing.assert_array_equal(faces.cross(a, b), np.cross(a, b))


def test_boxes_that_all_overlap_take_little_memory() -> None:
    """As those of faces do that are small against the largest coordinate beside them."""
    boxes = np.tile(np.array([[-1.0, -1.0, -1.0, 1.0, 1.0, 1.0]]), (3000, 1))
    tracemalloc.start()
    assert near_pairs(boxes, boxes, 1 << 21) is None
    assert tracemalloc.get_traced_memory()[1] < 200e6
    tracemalloc.stop()


def test_of_many_triangles_those_that_touch_are_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    lamp = {**RUG, "origin": [3, 0, 3], "emission": [1, 1, 1]}
    step = {**CUBE, "center": [0, -0.5, 0], "size": [12, 1, 12], "material": "red"}
    for shapes in ([FLOOR, {**CUBE, "material": "glass"}, lamp], [lamp, {**CUBE, "material": "glass"}, step]):
        vertices = []
        for many, choices in ((1 << 16, 32), (1, 32), (1, 3), (1, 1)):
            monkeypatch.setattr(shape_faces, "_MANY", many)
            monkeypatch.setattr(shape_faces, "_CHOICES", choices)
            monkeypatch.setattr(shape_faces, "SIMPLE", 12 if many > 1 else 1)
            vertices.append(flat_of(*shapes).arrays["vertices"])
        for other in vertices[1:]:
            np.testing.assert_array_equal(vertices[0], other)


def test_what_is_known_to_touch_is_what_would_be_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of scenes after each other as an editor makes them, bit for bit; it is looked for only where it may differ."""
    camera = {"position": [0, 1, 4], "target": [0, 0, 0]}
    materials: dict[str, Any] = {name: {"type": "lambert", "reflectance": [0.5] * 3} for name in ("white", "grey")}
    quad = {"type": "quad", "edge_u": [1, 0, 0], "edge_v": [0, 0, -1]}
    described: dict[str, Any] = {
        "camera": camera,
        "materials": {**materials, "glass": {"type": "dielectric", "ior": 1.5}},
        "shapes": [
            {**quad, "origin": [0, 0, 0], "material": "white"},
            {**quad, "origin": [0.2, 0, 0.2], "emission": [1, 1, 1]},
            {**CUBE, "material": "glass"},
            {"type": "sphere", "center": [3, 0, 0], "radius": 0.5, "material": "grey"},
        ],
    }
    first = clrender.Scene.model_validate(described)
    scenes = [
        first,
        first.changed({"materials.white.reflectance": (0.1, 0.2, 0.3)}),
        first.changed({"shapes[1].emission": (2.0, 3.0, 4.0)}),
        first.changed({"shapes[1].emission": (0.0, 0.0, 0.0)}),  # it is a lamp no more
        first.changed({"shapes[3].radius": 0.4}),
        first.changed({"shapes[0].material": "grey"}),
        first.changed({"materials.white": {"type": "dielectric", "ior": 1.3}}),
        first.with_checked(camera=first.camera.changed({"position": (0.0, 40.0, 400.0)})),
        first,
    ]
    found, real = list[int](), touching.moves

    def counted(*arguments: Any) -> touching.Moves:
        found.append(1)
        return real(*arguments)

    monkeypatch.setattr(touching, "moves", counted)
    known, counts = touching.KnownMoves(), list[int]()
    for scene in scenes:
        before = len(found)
        a = flatten(scene, 8, 8, known=known)
        counts.append(len(found) - before)
        b = flatten(scene, 8, 8)
        assert a.camera_free == b.camera_free and a.warnings == b.warnings
        assert all(array.tobytes() == b.arrays[name].tobytes() for name, array in a.arrays.items())
    assert counts == [1, 0, 0, 1, 1, 1, 1, 1, 1]
