"""Flattening against independent formulae: places, areas, normals, lights, camera."""

from __future__ import annotations

import math
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each
from numpy.typing import NDArray

from clrender import layout
from clrender import scene as scenes
from clrender.errors import SceneError, UsageError
from clrender.exact.angles import sin_cos_degrees
from clrender.flatten.alias import alias_table
from clrender.flatten.flat_scene import FlatScene, flatten

CAMERA = {"position": [0, 0, 5], "target": [0, 0, 0]}
UNIT_CUBE = {"type": "box", "size": [1, 1, 1]}
TETRAHEDRON = {"type": "tetrahedron", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]}


def flat(*shapes: dict[str, Any], lights: tuple[dict[str, Any], ...] = (), **more: Any) -> FlatScene:
    scene = scenes.Scene(camera=more.pop("camera", CAMERA), shapes=shapes, lights=lights, **more)
    return flatten(scene, 80, 40)


def corners(scene: FlatScene) -> NDArray[np.float64]:
    """(T, 3, 3): triangle, corner, axis."""
    vertices: NDArray[np.float64] = scene.arrays["vertices"].astype(np.float64)
    return np.asarray(vertices[scene.arrays["triangles"][: scene.triangle_count]], dtype=np.float64)


def crosses(scene: FlatScene) -> NDArray[np.float64]:
    p = corners(scene)
    return np.asarray(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), dtype=np.float64)


def volume(scene: FlatScene) -> float:
    """Signed: positive when the front sides are outside."""
    return float(np.einsum("ij,ij->i", corners(scene)[:, 0], crosses(scene)).sum() / 6.0)


def rotation(degrees: tuple[float, float, float]) -> NDArray[np.float64]:
    """Rodrigues' formula about x, then y, then z."""
    total = np.eye(3)
    for axis, angle in zip(np.eye(3), np.radians(degrees), strict=True):
        k = np.cross(axis, np.eye(3)).T
        total = (np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k) @ total
    return total


def test_arrays_are_what_the_kernels_expect() -> None:
    scene = flatten(scenes.load("room"), 320, 200)
    kinds = {"analytic_shapes": "AnalyticShape", "shapes": "Shape", "materials": "Material", "lights": "Light"}
    assert set(scene.arrays) == {
        *kinds,
        "vertices",
        "curve_rows",
        "grid_rows",
        "grid_words",
        "measured_rows",
        "measured_words",
        "normals",
        "triangles",
        "primitive_shape",
        "material_rows",
        "thin_film_rows",
        "hole_rows",
        "instance_rows",
        "instance_guides",
        "instance_motions",
        "motion_rows",
        "albedo_tables",
        "media_rows",
        "attribute_rows",
        "texture_rows",
        "texture_slots",
        "texel_values",
        "texels",
        "light_nodes",
        "light_order",
        "light_cones",
        "lamp_tables",
        "environment_map",
    }
    for name, array in scene.arrays.items():
        assert array.flags.c_contiguous and len(array) > 0
        if name in kinds:
            assert array.dtype == layout.dtype(kinds[name])
    assert scene.arrays["vertices"].dtype == np.dtype("<f4") and scene.arrays["triangles"].dtype == np.dtype("<u4")
    assert (scene.triangle_count, scene.analytic_count, scene.light_count) == (32, 3, 4)
    assert scene.camera.shape == (1,) and scene.camera.dtype == layout.dtype("Camera")
    assert scene.nbytes == sum(array.nbytes for array in scene.arrays.values()) + scene.camera.nbytes


def test_primitives_of_a_shape_are_contiguous_and_point_back() -> None:
    scene = flatten(scenes.load("room"), 320, 200)
    shapes, owner = scene.arrays["shapes"], scene.arrays["primitive_shape"]
    assert len(owner) == scene.triangle_count + scene.analytic_count
    for index, row in enumerate(shapes):
        own = np.flatnonzero(owner == index)
        assert own[0] == row["first_primitive"]
        assert (np.diff(own) == 1).all()
    lights = scene.arrays["lights"]
    for index, row in enumerate(shapes):
        if row["first_light"] != layout.NONE:
            own = np.flatnonzero(owner == index)
            some = lights[row["first_light"] : row["first_light"] + len(own)]
            assert some["primitive"].tolist() == own.tolist()


def test_an_empty_scene_is_padded() -> None:
    scene = flat()
    assert all(len(array) == 1 for name, array in scene.arrays.items() if not name.startswith("instance_"))
    assert scene.instances.count == 0 and scene.arrays["instance_guides"][0] == layout.NONE
    assert (scene.triangle_count, scene.analytic_count, scene.light_count) == (0, 0, 0)
    assert scene.environment == layout.NONE


@for_each(
    ("shape", "area", "content"),
    [
        ({"type": "box", "center": [5, 0, 0], "size": [1, 2, 3]}, 22.0, 6.0),
        (TETRAHEDRON, 1.5 + math.sqrt(3) / 2, 1 / 6),
        (
            {**TETRAHEDRON, "vertices": [TETRAHEDRON["vertices"][i] for i in (1, 0, 2, 3)]},
            1.5 + math.sqrt(3) / 2,
            1 / 6,
        ),
        ({**UNIT_CUBE, "flip_normals": True}, 6.0, -1.0),
        ({**UNIT_CUBE, "transform": {"scale": [-1, 2, 3]}}, 22.0, 6.0),
        ({**UNIT_CUBE, "transform": {"scale": [-1, -2, -3], "rotate_degrees": [10, 20, 30]}}, 22.0, 6.0),
        ({**UNIT_CUBE, "flip_normals": True, "transform": {"scale": -1}}, 6.0, -1.0),
    ],
)
def test_areas_and_orientation(shape: dict[str, Any], area: float, content: float) -> None:
    scene = flat(shape)
    assert np.linalg.norm(crosses(scene), axis=1).sum() / 2 == pytest.approx(area, rel=1e-6)
    assert volume(scene) == pytest.approx(content, rel=1e-5)


def test_quad_and_triangle_face_as_the_contract_says() -> None:
    scene = flat(
        {"type": "quad", "origin": [1, 2, 3], "edge_u": [2, 0, 0], "edge_v": [0, 0, 3]},
        {"type": "triangle", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]]},
    )
    np.testing.assert_allclose(crosses(scene), [[0, -6, 0], [0, -6, 0], [0, 0, 1]])
    assert len(scene.arrays["vertices"]) == 7


@pytest.mark.parametrize("degrees", [(30.0, 0.0, 0.0), (0.0, 45.0, 0.0), (0.0, 0.0, -70.0), (12.0, -34.0, 56.0)])
def test_transform_is_scale_then_rotation_then_translation(degrees: tuple[float, float, float]) -> None:
    points = np.random.default_rng(3).uniform(-2, 2, (4, 3))
    scale, shift = np.array([0.5, 2.0, 3.0]), np.array([4.0, -5.0, 6.0])
    shape = {"type": "tetrahedron", "vertices": points.tolist()}
    transform = {"scale": scale.tolist(), "rotate_degrees": list(degrees), "translate": shift.tolist()}
    expected = (points * scale) @ rotation(degrees).T + shift
    np.testing.assert_allclose(
        flat({**shape, "transform": transform}).arrays["vertices"], expected, rtol=2e-7, atol=1e-6
    )
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation(degrees) * scale, shift
    for written in (matrix.tolist(), matrix.ravel().tolist()):
        scene = flat({**shape, "transform": {"matrix": written}})
        np.testing.assert_allclose(scene.arrays["vertices"], expected, rtol=2e-7, atol=1e-6)


def test_quarter_turns_are_exact() -> None:
    assert [sin_cos_degrees(a) for a in (0.0, 90.0, -90.0, 540.0)] == [(0, 1), (1, 0), (-1, 0), (0, -1)]
    for angle in np.random.default_rng(1).uniform(-720, 720, 200):
        sine, cosine = sin_cos_degrees(float(angle))
        assert sine == pytest.approx(math.sin(math.radians(angle)), abs=1e-14)
        assert cosine == pytest.approx(math.cos(math.radians(angle)), abs=1e-14)


def test_rounds() -> None:
    turn = {"rotate_degrees": [0, 0, 90], "translate": [1, 0, 0], "scale": 2.0}
    scene = flat(
        {"type": "sphere", "center": [1, 2, 3], "radius": 0.5, "transform": turn},
        {"type": "sphere", "radius": 1, "flip_normals": True, "transform": {"scale": [-1, 1, 1]}},
        {"type": "disk", "center": [0, 0, 1], "normal": [0, 3, 0], "radius": 0.5, "transform": turn},
        {"type": "disk", "normal": [0, 0, 2], "radius": 1, "flip_normals": True},
        {"type": "disk", "normal": [1, 0, 0], "radius": 1, "transform": {"matrix": np.diag([-1, 1, 1, 1]).tolist()}},
    )
    analytic_shapes = scene.arrays["analytic_shapes"]
    np.testing.assert_allclose(analytic_shapes["center_radius"][0], [-3, 2, 6, 1], atol=1e-6)
    np.testing.assert_allclose(analytic_shapes["normal"][:2], [[0, 0, 0, 1], [0, 0, 0, -1]])
    np.testing.assert_allclose(analytic_shapes["center_radius"][2], [1, 0, 2, 1], atol=1e-6)
    np.testing.assert_allclose(analytic_shapes["normal"][2:], [[-1, 0, 0, 0], [0, 0, -1, 0], [-1, 0, 0, 0]], atol=1e-7)
    assert scene.arrays["shapes"]["first_primitive"].tolist() == [0, 1, 2, 3, 4]


def test_materials() -> None:
    materials = {
        "dark": {"type": "lambert", "reflectance": [0.1, 0.2, 0.3]},
        "white": {"type": "lambert", "reflectance": [1, 1, 1]},
        "mirror": {"type": "mirror", "reflectance": [0.9, 0.8, 0.7], "termination": 0.25},
        "glass": {"type": "dielectric", "ior": 1.5, "exterior_ior": 1.2},
    }
    scene = flat({**UNIT_CUBE, "material": "mirror"}, UNIT_CUBE, materials=materials)
    rows = scene.arrays["materials"]
    expected = [(0.1, 0.2, 0.3, 0.7), (1, 1, 1, 0), (0.9, 0.8, 0.7, 0.25), (1, 1, 1, 0), (0, 0, 0, 0.999)]
    np.testing.assert_allclose(rows["color"], expected, rtol=1e-6)
    assert rows["kind"].tolist() == [0, 0, 1, 2, 0]
    assert rows["ior"][3] == np.float32(1.25)
    assert scene.arrays["shapes"]["material"].tolist() == [2, 4]


def test_camera_spans_the_field_of_view() -> None:
    camera = {
        "position": [1, 2, 3],
        "target": [1, 2, -7],
        "vertical_fov": 60,
        "aperture_radius": 0.1,
        "focus_distance": 4,
    }
    (row,) = flat(camera=camera).camera
    half = 4 * math.tan(math.radians(30))
    np.testing.assert_allclose(row["origin"][:3], [1, 2, 3])
    np.testing.assert_allclose(row["corner"][:3], [-2 * half, half, -4], rtol=1e-6)
    np.testing.assert_allclose(row["right"][:3], [4 * half, 0, 0], rtol=1e-6)
    np.testing.assert_allclose(row["down"][:3], [0, -2 * half, 0], rtol=1e-6)
    np.testing.assert_allclose(row["lens_u"][:3], [0.1, 0, 0], rtol=1e-6)
    np.testing.assert_allclose(row["lens_v"][:3], [0, 0.1, 0], rtol=1e-6)


def test_camera_frame_is_orthogonal_and_right_handed() -> None:
    camera = {"position": [1, -2, 3], "target": [-4, 5, 0.5], "up": [0.3, 1, 0.2], "vertical_fov": 35}
    (row,) = flat(camera=camera).camera
    corner, right, down = (row[name][:3].astype(np.float64) for name in ("corner", "right", "down"))
    forward = np.array([-5, 7, -2.5]) / np.linalg.norm([-5, 7, -2.5])
    middle = corner + right / 2 + down / 2
    np.testing.assert_allclose(middle, np.array([-5, 7, -2.5]), rtol=1e-5)
    np.testing.assert_allclose(
        right / np.linalg.norm(right), np.cross(forward, -down / np.linalg.norm(down)), atol=1e-6
    )
    assert np.linalg.norm(right) == pytest.approx(2 * np.linalg.norm(down), rel=1e-6)
    assert -down @ np.array([0.3, 1, 0.2]) > 0


def test_light_probabilities_follow_power() -> None:
    scene = flat(
        {**UNIT_CUBE, "emission": [1, 2, 3]},
        {"type": "sphere", "center": [3, 0, 0], "radius": 0.5, "emission": [4, 0, 0]},
        {"type": "disk", "center": [0, 3, 0], "normal": [0, 1, 0], "radius": 0.5, "emission": [0, 5, 0]},
        {**UNIT_CUBE, "emission": [0, 0, 0]},
        lights=(
            {"type": "point", "position": [0, 0, 9], "intensity": [1, 1, 1]},
            {"type": "point", "position": [0, 0, 9], "intensity": [0, 0, 0]},
            {"type": "directional", "direction": [0, -3, 4], "irradiance": [2, 2, 2]},
            {"type": "environment", "radiance": [0.5, 0.5, 0.5]},
        ),
    )
    lights = scene.arrays["lights"]
    assert lights["kind"].tolist() == [layout.LIGHT_AREA_TRIANGLE] * 12 + [
        layout.LIGHT_AREA_SPHERE,
        layout.LIGHT_AREA_DISK,
        layout.LIGHT_POINT,
        layout.LIGHT_DIRECTIONAL,
        layout.LIGHT_ENVIRONMENT,
    ]
    assert (scene.environment, scene.light_count) == (16, 17)
    low, high = np.array([-0.5, -0.5, -0.5]), np.array([3.5, 3.5, 0.5])
    radius = float(np.linalg.norm(high - low) / 2)
    cube = math.pi * 0.5 * (0.2126 + 2 * 0.7152 + 3 * 0.0722)
    expected = [cube] * 12
    expected += [math.pi * math.pi * 4 * 0.2126, math.pi * math.pi * 0.25 * 5 * 0.7152, 4 * math.pi]
    expected += [2 * math.pi * radius**2, 0.5 * 4 * math.pi**2 * radius**2]
    np.testing.assert_allclose(lights["probability"], np.array(expected) / sum(expected), rtol=1e-5)
    np.testing.assert_allclose(lights["position"][15], [0, -0.6, 0.8, 0], rtol=1e-6)
    assert lights["primitive"].tolist() == [*range(12), 24, 25, *[layout.NONE] * 3]
    assert scene.arrays["shapes"]["first_light"].tolist() == [0, 12, 13, layout.NONE]


@for_each("count", [1, 2, 3, 10, 1000, 100_000])
@for_each("spread", [0.0, 1.0, 12.0])
def test_alias_table_reproduces_probabilities(count: int, spread: float) -> None:
    power = np.exp(spread * np.random.default_rng(count).standard_normal(count))
    probability, threshold, alias = alias_table(power)
    threshold32 = threshold.astype(np.float32).astype(np.float64)
    drawn = threshold32 + np.bincount(alias, weights=1.0 - threshold32, minlength=count)
    np.testing.assert_allclose(drawn / count, probability, rtol=2e-6, atol=1e-12)
    assert probability.sum() == pytest.approx(1.0, abs=1e-12)
    assert (threshold >= 0).all() and (threshold <= 1).all() and (probability > 0).all()
    floored = np.maximum(power, 1e-6 * power.mean())
    np.testing.assert_allclose(probability, floored / floored.sum(), rtol=1e-12)


def test_mesh_normals_and_degenerate_triangles() -> None:
    scene = flat(
        {
            "type": "mesh",
            "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]],
            "faces": [[0, 1, 2], [0, 1, 3], [1, 2, 2], [0, 2, 1]],
        },
        lights=(SKY,),
    )
    assert scene.triangle_count == 2
    assert scene.arrays["triangles"].tolist() == [[0, 1, 2], [0, 2, 1]]
    assert len(scene.warnings) == 1 and "2 of 4 triangles" in scene.warnings[0]
    assert scene.arrays["normals"].shape == (1, 3)


def test_smooth_normals_are_carried_like_normals(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 5 5 5\nvn 3 0 3\nvn 0 0 2\nvn 0 0 0\nf 1//1 2//2 3//3\nf 1//1 3//3 2//2\n"
    )
    text = '{"camera": {"position": [0,0,5], "target": [0,0,0]}, "shapes": [%s, {"type": "sphere", "radius": 1}]}'
    mesh = '{"type": "mesh", "file": "m.obj", "flip_normals": %s, "transform": {"scale": [2, 1, -1]}}'
    for flip, sign in (("false", 1.0), ("true", -1.0)):
        path = tmp_path / "s.json"
        path.write_text(text % (mesh % flip))
        scene = flatten(scenes.load(path), 8, 8)
        assert scene.arrays["shapes"]["flags"].tolist() == [layout.SHAPE_SMOOTH, 0]
        expected = sign * np.array([[1 / math.sqrt(5), 0, -2 / math.sqrt(5)], [0, 0, -1]])
        np.testing.assert_allclose(scene.arrays["normals"][:2], expected, atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(scene.arrays["normals"], axis=1), 1.0, atol=1e-6)


def test_hash_changes_with_content_only() -> None:
    first, again = flat(UNIT_CUBE), flat(UNIT_CUBE)
    assert first.sha256 == again.sha256
    assert flat({**UNIT_CUBE, "flip_normals": True}).sha256 != first.sha256
    assert flat(UNIT_CUBE, camera={**CAMERA, "position": [0, 0, 6]}).sha256 != first.sha256


def test_wrong_size_is_refused() -> None:
    with pytest.raises(UsageError, match="0x5"):
        flatten(scenes.load("room"), 0, 5)


def test_too_small_for_single_precision() -> None:
    with pytest.raises(SceneError, match=r"shapes\[0\] is degenerate"):
        flat({**UNIT_CUBE, "size": [1e-12, 1e-12, 1e-12]})


def test_millions_of_triangles_stay_lean(tmp_path: Path) -> None:
    """Half a million here: peak memory within three times the arrays that come out, plus what the file holds."""
    side = 500
    i, j = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    corner = (i * (side + 1) + j).ravel()
    faces = np.empty(2 * side * side, dtype=[("n", "u1"), ("c", "<i4", 3)])
    faces["n"] = 3
    faces["c"][0::2] = np.stack([corner, corner + 1, corner + side + 2], axis=1)
    faces["c"][1::2] = np.stack([corner, corner + side + 2, corner + side + 1], axis=1)
    x, y = np.meshgrid(np.arange(side + 1.0), np.arange(side + 1.0), indexing="ij")
    vertices = np.stack([x.ravel(), y.ravel(), np.sin(x * y).ravel()], axis=1).astype("<f4")
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
    header += "property float x\nproperty float y\nproperty float z\n"
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "grid.ply").write_bytes(header.encode() + vertices.tobytes() + faces.tobytes())
    (tmp_path / "s.json").write_text(
        '{"camera": {"position": [0,0,5], "target": [0,0,0]}, "shapes": [{"type": "mesh", "file": "grid.ply"}], '
        '"lights": [{"type": "environment", "radiance": [1,1,1]}]}'
    )
    tracemalloc.start()
    scene = flatten(scenes.load(tmp_path / "s.json"), 8, 8)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert scene.triangle_count == 2 * side * side and not scene.warnings
    assert scene.arrays["triangles"].tolist()[:2] == [[0, 1, side + 2], [0, side + 2, side + 1]]
    np.testing.assert_array_equal(scene.arrays["vertices"], vertices)
    chunks = 64 * 2**20
    assert peak < 3 * scene.nbytes + vertices.nbytes + faces.nbytes + chunks


QUAD_OBJ = """v -1 -1 0
v 1 -1 0
v 1 1 0
v -1 1 0
vn 0.6 0 0.8
vn 0 0 1
vn -0.6 0 0.8
vn 0 0.6 0.8
"""
WINDINGS = {"right": "f 1//1 2//2 3//3\nf 1//1 3//3 4//4\n", "inverted": "f 3//3 2//2 1//1\nf 4//4 3//3 1//1\n",
            "one of two": "f 1//1 2//2 3//3\nf 4//4 3//3 1//1\n"}  # fmt: skip


@pytest.mark.parametrize(("winding", "turned"), [("right", 0), ("inverted", 2), ("one of two", 1)])
def test_normals_against_the_winding_are_told(tmp_path: Path, winding: str, turned: int) -> None:
    (tmp_path / "q.obj").write_text(QUAD_OBJ + WINDINGS[winding])
    shape: dict[str, Any] = {"type": "mesh", "file": "q.obj"}
    scene = scenes.Scene(camera=CAMERA, shapes=(shape,), lights=(SKY,)).placed("scene", tmp_path)
    warnings = flatten(scene, 8, 8).warnings
    assert len(warnings) == (1 if turned else 0)
    if turned:
        assert f"shapes[0]: the normals of {turned} of 2 triangles point to their backs and were turned" in warnings[0]


GLASS: dict[str, dict[str, Any]] = {
    "glass": {"type": "dielectric", "ior": 1.5},
    "same": {"type": "dielectric", "ior": 1.3, "exterior_ior": 1.3},
}
POINT: dict[str, Any] = {"type": "point", "position": [0, 2, 0], "intensity": [1, 1, 1]}
SKY: dict[str, Any] = {"type": "environment", "radiance": [1, 1, 1]}


def test_a_scene_without_light_is_told() -> None:
    ball: dict[str, Any] = {"type": "sphere", "center": [0, 0, 0], "radius": 1}
    (told,) = flat(ball).warnings
    assert told == "Scene: nothing in it emits light, so its image is black; add `[[lights]]`, or `emission` to a shape"
    assert flat(ball, lights=({**POINT, "intensity": [0, 0, 0]},)).warnings == (told,)
    assert flat(ball, lights=({**SKY, "radiance": [0, 0, 0]},)).warnings == (told,)
    for light in (
        {"lights": (POINT,)},
        {"lights": (SKY,)},
        {"materials": {"lamp": {"type": "principled", "emission": [1, 0, 0]}}},
    ):
        shape = {**ball, "material": "lamp"} if "materials" in light else ball
        assert flat(shape, **light).warnings == ()
    assert flat({**ball, "emission": [0, 1, 0]}).warnings == ()


def test_light_that_glass_keeps_from_most_integrators_is_told() -> None:
    ball: dict[str, Any] = {"type": "sphere", "center": [0, 0, 0], "radius": 1}
    found = flat({**ball, "material": "glass"}, lights=(POINT,), materials=GLASS)
    (told,) = found.messages
    text = "point lights, through the dielectric 'glass': only the integrators bdpt and photon find it, and path with"
    assert text in told and text in found.lost_by("path", False) and text in found.lost_by("whitted", False)
    assert found.lost_by("photon", False) == found.lost_by("path", True) == found.lost_by("bdpt", True) == ""
    assert "what is seen in mirrors or through glass lacks it" in found.lost_by("bdpt", False)
    assert flat({**ball, "material": "glass"}, lights=(SKY,), materials=GLASS).messages == []
    assert flat(ball, lights=(POINT,), materials=GLASS).messages == []
    assert flat({**ball, "material": "same"}, lights=(POINT,), materials=GLASS).messages == []


def test_light_that_fog_keeps_out_is_told() -> None:
    ball: dict[str, Any] = {"type": "sphere", "center": [0, 0, 0], "radius": 1}
    thick: dict[str, Any] = {"absorption": [0.1, 0.0, 0.2], "scattering": [0.0, 0.3, 0.0]}
    (told,) = flat(ball, lights=(SKY, POINT), media={"mist": thick}, fog="mist").warnings
    text = "the medium 'mist' extends to infinity, and no light of environment lights passes it"
    assert told == f"Scene: fog: {text}; for haze below a sky, give a large box an `interior` instead"
    assert flat(ball, lights=(POINT,), media={"mist": thick}, fog="mist").warnings == ()
    assert flat(ball, lights=(SKY,), media={"mist": {**thick, "scattering": 0.0}}, fog="mist").warnings == ()


def test_what_does_not_bend_light_is_no_boundary() -> None:
    shapes: list[dict[str, Any]] = [{"type": "sphere", "center": [0, 0, 0], "radius": 1}, UNIT_CUBE]
    none = flat(*({**shape, "material": "same"} for shape in shapes), materials=GLASS)
    assert (none.triangle_count, none.analytic_count) == (0, 0)
    shining = flat(*({**shape, "material": "same", "emission": [1, 1, 1]} for shape in shapes), materials=GLASS)
    assert (shining.triangle_count, shining.analytic_count, shining.light_count) == (12, 1, 13)
    after = flat({**shapes[0], "material": "same"}, {**shapes[0], "material": "glass"}, UNIT_CUBE, materials=GLASS)
    assert after.arrays["primitive_shape"].tolist() == [2] * 12 + [1]
    assert after.arrays["shapes"]["first_primitive"][1:].tolist() == [12, 0]


def test_the_film_takes_what_a_scene_may_shine_with() -> None:
    from clrender.film.fixed_point import SAMPLE_LIMIT_BITS
    from clrender.scene.values import POWER_LIMIT

    assert POWER_LIMIT < 2.0**SAMPLE_LIMIT_BITS
    with pytest.raises(SceneError, match="emission"):
        flat({**UNIT_CUBE, "emission": [POWER_LIMIT * 1.01, 0, 0]})


def test_materials_that_need_them_have_rows() -> None:
    described = {
        "camera": {"position": (0, 0, 3), "target": (0, 0, 0)},
        "materials": {
            "plain": {"type": "lambert", "reflectance": (0.5, 0.5, 0.5)},
            "gold": {"type": "conductor", "metal": "Au", "roughness": 0.5},
            "clay": {"type": "oren_nayar", "reflectance": (0.5, 0.4, 0.3), "roughness": 0.75},
            "frosted": {"type": "dielectric", "ior": 1.5, "exterior_ior": 1.2, "roughness": 0.4},
            "card": {"type": "lambert", "reflectance": (0.5, 0.5, 0.5), "two_sided": False},
            "both": {"type": "mix", "materials": ("gold", "clay"), "weight": 0.25},
            "glass": {"type": "dielectric", "ior": 1.5},
            "paint": {"type": "principled", "coat": 0.5, "anisotropy_rotation": -90},
        },
    }
    arrays = flatten(scenes.Scene.model_validate(described), 8, 8).arrays
    materials, rows = arrays["materials"], arrays["material_rows"].reshape(-1, 32)
    assert materials["kind"].tolist() == [0, *[layout.MATERIAL_BY_ROW] * 5, 2, layout.MATERIAL_BY_ROW]
    assert materials["row"].tolist() == [0, 1, 2, 3, 4, 5, 0, 7]
    assert materials["ior"].tolist() == pytest.approx([1, 1, 1, 1.25, 1, 1, 1.5, 1.5])
    assert rows[:, 0].view(np.uint32).tolist() == [0, 4, 3, 2, 0, 6, 2, 5]
    assert rows[[1, 3, 7], 4].tolist() == pytest.approx([0.5, 0.4, 0.5])
    assert rows[2, 12] == 0.75 and rows[3, 6] == pytest.approx(1.25) and rows[7, 13] == 0.5
    assert rows[4, 15].view(np.uint32) == layout.MATERIAL_FLAG_ONE_SIDED
    assert rows[5, 1] == 0.25 and rows[5, 2:4].view(np.uint32).tolist() == [1, 2]
    assert rows[7, 16 + 5] == 0.75  # a quarter turn back, in turns
    assert len(arrays["albedo_tables"]) == layout.ALBEDO_END
    # Straight back, gold reflects ((n - 1)² + k²) / ((n + 1)² + k²)
    n, k = 0.21, 3.272
    assert materials["color"][1][0] == pytest.approx(((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2), rel=1e-6)
    assert rows[1, 1] == materials["color"][1][0] and (rows[1, 28:31] > 0.0).all()


def test_simple_materials_have_no_rows() -> None:
    described = {
        "camera": {"position": (0, 0, 3), "target": (0, 0, 0)},
        "materials": {
            "white": {"type": "lambert", "reflectance": (0.5, 0.5, 0.5)},
            "mirror": {"type": "mirror"},
            "glass": {"type": "dielectric", "ior": 1.5, "roughness": 0.03},
        },
    }
    arrays = flatten(scenes.Scene.model_validate(described), 8, 8).arrays
    assert arrays["materials"]["kind"].tolist() == [0, 1, 2]
    assert arrays["materials"]["ior"].tolist() == [1.0, 1.0, 1.5]
    assert arrays["material_rows"].shape == (1, 16) and len(arrays["albedo_tables"]) == 1


def test_tables_of_beckmann_are_there_where_it_scatters_more_than_once() -> None:
    for multiple in (True, False):
        facets = {"microfacets": "beckmann", "multiple_scattering": multiple, "roughness": 0.4}
        for kind in ({"type": "conductor", "metal": "Au"}, {"type": "dielectric", "ior": 1.5}):
            described = {"camera": {"position": (0, 0, 3), "target": (0, 0, 0)}, "materials": {"m": {**kind, **facets}}}
            tables = flatten(scenes.Scene.model_validate(described), 8, 8).arrays["albedo_tables"]
            assert len(tables) == (layout.ALBEDO_TURNED_GLASS if multiple else layout.ALBEDO_END)
    for name, end in (("beckmann", layout.ALBEDO_TURNED_GLASS), ("ggx", layout.ALBEDO_END)):
        plastic = {"type": "principled", "microfacets": name}
        described = {"camera": {"position": (0, 0, 3), "target": (0, 0, 0)}, "materials": {"m": plastic}}
        assert len(flatten(scenes.Scene.model_validate(described), 8, 8).arrays["albedo_tables"]) == end


def test_tables_of_anisotropic_glass_are_there_where_it_is_solid() -> None:
    for more, end in (
        ({}, layout.ALBEDO_TURNED_GLASS_END),
        ({"thin": True}, layout.ALBEDO_END),
        ({"anisotropy": 0.0}, layout.ALBEDO_END),
    ):
        glass = {"type": "principled", "transmission": 0.5, "anisotropy": 0.5, **more}
        described = {"camera": {"position": (0, 0, 3), "target": (0, 0, 0)}, "materials": {"m": glass}}
        assert len(flatten(scenes.Scene.model_validate(described), 8, 8).arrays["albedo_tables"]) == end
