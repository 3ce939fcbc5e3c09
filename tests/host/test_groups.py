"""Groups and instances as data: what a scene file may say, what is kept once, and what becomes of it on the way."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from cases import for_each

from clrender import layout
from clrender.cli import main
from clrender.errors import SceneError
from clrender.exporters import exported
from clrender.flatten.assembly import assemble, numbers_written_out, written_out
from clrender.flatten.bounds import scene_bounds
from clrender.flatten.flat_scene import flatten
from clrender.flatten.instances import NUMBER_LIMIT
from clrender.importers.draft import Draft
from clrender.importers.instancing import share_meshes
from clrender.scene import MeshData, Scene, load
from clrender.scene.groups import TransformArray
from clrender.scene.portable import scene_from_portable, scene_to_portable

CAMERA = {"position": [0.0, 0.0, 5.0], "target": [0.0, 0.0, 0.0]}
CUBE = {"type": "box", "size": [1.0, 1.0, 1.0], "material": "grey"}
BALL = {"type": "sphere", "radius": 0.5, "material": "grey"}
LAMP = {"type": "quad", "origin": [0, 0, 0], "edge_u": [1, 0, 0], "edge_v": [0, 0, 1], "emission": [2.0, 2.0, 2.0]}
MATERIALS = {
    "grey": {"type": "lambert", "reflectance": [0.5] * 3},
    "glass": {"type": "dielectric", "ior": 1.5, "priority": 1},
}


def of(instance: dict[str, Any], *shapes: dict[str, Any], own: tuple[dict[str, Any], ...] = ()) -> Scene:
    groups = {"one": {"shapes": list(shapes or (CUBE,))}}
    placed = {"type": "instance", "group": "one", **instance}
    return Scene.model_validate({"camera": CAMERA, "materials": MATERIALS, "groups": groups, "shapes": [*own, placed]})


def matrices(count: int, seed: int = 1) -> npt.NDArray[np.float64]:
    random = np.random.default_rng(seed)
    turned, _ = np.linalg.qr(random.normal(size=(count, 3, 3)))
    return np.concatenate([turned * 0.3, random.uniform(-5.0, 5.0, (count, 3, 1))], axis=2)


def saved(path: Path, array: npt.NDArray[Any]) -> None:
    np.save(path, array)


def scene_file(folder: Path, **instance: Any) -> Path:
    placed = {"type": "instance", "group": "one", **instance}
    path = folder / "scene.json"
    content = {"camera": CAMERA, "materials": MATERIALS, "groups": {"one": {"shapes": [CUBE]}}, "shapes": [placed]}
    path.write_text(json.dumps(content))
    return path


@for_each(
    ("array", "sentence"),
    [
        (np.zeros((2, 3)), "holds an array (2, 3) of float64, but must hold (n, 3, 4) or (n, 4, 4) floating"),
        (np.ones((1, 3, 4), int), "but must hold (n, 3, 4) or (n, 4, 4) floating-point"),
        (np.zeros((0, 3, 4)), "holds an array (0, 3, 4)"),
        (np.stack([np.eye(4)[:3], np.full((3, 4), np.nan)]), '"places.npy"[1] holds a number that is not finite'),
        (np.stack([np.eye(4), np.ones((4, 4))]), '"places.npy"[1] does not end with the row [0, 0, 0, 1]'),
        (np.ones((1, 3, 4)), '"places.npy"[0] cannot be inverted'),
        (np.eye(4)[None, :3] * 1e11, '"places.npy"[0] scales by more than 1e+09'),
        (np.eye(4)[None, :3] * 1e-11, '"places.npy"[0] scales by more than 1e+09 or less than its inverse'),
    ],
)  # fmt: skip
def test_faulty_arrays_are_told(tmp_path: Path, array: npt.NDArray[Any], sentence: str) -> None:
    saved(tmp_path / "places.npy", array)
    with pytest.raises(SceneError) as told:
        load(scene_file(tmp_path, transforms="places.npy"))
    assert "shapes[0].transforms: " in str(told.value) and sentence in str(told.value).replace("'", '"')


@pytest.mark.parametrize(
    "data", [b"", b"no array", b"\x93NUMPY\x01\x00v\x00{'descr': '|O', 'fortran_order': False, 'shape': (1,), }"]
)
def test_files_that_are_no_arrays(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "places.npy").write_bytes(data)
    with pytest.raises(SceneError, match=r"is no sound NumPy file .*write it with numpy\.save"):
        load(scene_file(tmp_path, transforms="places.npy"))


@pytest.mark.parametrize(
    ("count", "sentence"), [(2**36, f"holds {2**36:,} transforms, but"), (2**20, "is no sound NumPy file")]
)
def test_a_file_that_promises_too_much_takes_no_memory(tmp_path: Path, count: int, sentence: str) -> None:
    with (tmp_path / "places.npy").open("wb") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": (count, 3, 4)})
    with pytest.raises(SceneError, match=sentence):
        load(scene_file(tmp_path, transforms="places.npy"))


def test_files_outside_are_refused(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    saved(tmp_path / "places.npy", matrices(2))
    with pytest.raises(SceneError, match="lies outside the scene's own folder"):
        load(scene_file(tmp_path / "in", transforms="../places.npy"))


@for_each(
    ("changed", "sentence"),
    [
        ({"group": "two"}, 'shapes[0].group names a group "two" that does not exist; known here: one'),
        ({"transform": {"scale": 2.0}, "transforms": "a.npy"}, "shapes[0].transform cannot be given together"),
        ({"transforms": []}, "shapes[0].transforms has too few entries"),
        ({"transforms": [[[1, 0, 0, 0]] * 4]}, "shapes[0].transforms[0]"),
        ({"transforms": 3}, "shapes[0].transforms is 3"),
        ({"material": "grey"}, "shapes[0].material is an unknown key"),
    ],
)
def test_faulty_instances_are_told(tmp_path: Path, changed: dict[str, Any], sentence: str) -> None:
    with pytest.raises(SceneError) as told:
        load(scene_file(tmp_path, **changed))
    assert sentence in str(told.value)


@pytest.mark.parametrize(
    ("shapes", "place"),
    [
        ([{**CUBE, "material": "gray"}], 'groups.one.shapes[0].material names a material "gray"'),
        ([CUBE, {"type": "instance", "group": "one"}], "groups.one.shapes[1].type"),
        ([], "groups.one.shapes has too few entries"),
        ([CUBE, {**CUBE, "interior": "air"}], "groups.one.shapes[1].interior names a medium"),
    ],
)
def test_faults_in_groups_are_told_with_their_place(tmp_path: Path, shapes: list[dict[str, Any]], place: str) -> None:
    path = scene_file(tmp_path)
    content = json.loads(path.read_text())
    content["groups"]["one"]["shapes"] = shapes
    path.write_text(json.dumps(content))
    with pytest.raises(SceneError) as told:
        load(path)
    assert place in str(told.value)


def test_spheres_are_not_stretched() -> None:
    flatten(of({"transform": {"scale": -2.0}}, BALL), 8, 8)
    with pytest.raises(SceneError, match=r"shapes\[0\]\.transform stretches a .* curve of the group .one."):
        flatten(of({"transform": {"scale": [1.0, 2.0, 1.0]}}, CUBE, BALL), 8, 8)
    several = [np.eye(4).tolist(), np.diag([1.0, 1.0, 1.1, 1.0]).tolist()]
    with pytest.raises(SceneError, match=r"shapes\[0\]\.transforms\[1\] stretches"):
        flatten(of({"transforms": several}, BALL), 8, 8)


def test_a_group_is_kept_once() -> None:
    scene = of({"transforms": "a.npy"}, own=(BALL,)).with_files(transforms={"a.npy": TransformArray(matrices(1000))})
    flat = flatten(scene, 8, 8)
    assert flat.triangle_count == 12 and flat.analytic_count == 1
    assert flat.instances.count == 1000 and flat.primitive_total == 12_001
    assert flatten(written_out(scene), 8, 8).triangle_count == 12_000


def test_primitives_are_numbered_as_if_written_out() -> None:
    scene = of({"transforms": "a.npy"}, BALL, CUBE, own=(CUBE, BALL))
    scene = scene.with_files(transforms={"a.npy": TransformArray(matrices(300))})
    flat = flatten(scene, 8, 8)
    first = flat.triangle_count + flat.analytic_count
    rows, instance = flat.instances.rows_of(np.arange(first + 300 * 13))
    np.testing.assert_array_equal(instance[:first], -1)
    np.testing.assert_array_equal(rows[:first], np.arange(first))
    np.testing.assert_array_equal(instance[first:], np.repeat(np.arange(300), 13))
    # The scene's own box and sphere come first: a group's triangles are rows 12 to 23, its sphere is row 25
    np.testing.assert_array_equal(rows[first:], np.tile([*range(12, 24), 25], 300))


def test_the_numbers_of_what_is_written_out() -> None:
    """Shapes of instances come after all others, whatever the order of the scene."""
    ball = {"type": "sphere", "radius": 1.0}
    group = {"g": {"shapes": [ball, ball]}}
    twice = np.stack([np.eye(4), np.eye(4)]).tolist()
    shapes = [{"type": "instance", "group": "g"}, ball, {"type": "instance", "group": "g", "transforms": twice}, ball]
    scene = Scene.model_validate({"camera": CAMERA, "groups": group, "shapes": shapes})
    found = [numbers_written_out(scene, index) for index in range(4)]
    assert found == [range(2, 4), range(1), range(4, 8), range(1, 2)]
    assert len(written_out(scene).shapes) == 8


def test_guides_find_every_instance() -> None:
    """Of groups of very different sizes, as the kernels look them up."""
    mesh = {"type": "mesh", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]] * 700}
    groups = {"large": {"shapes": [mesh]}, "small": {"shapes": [BALL]}}
    order = np.random.default_rng(3).integers(0, 2, 400)
    shapes = [{"type": "instance", "group": ("small", "large")[kind]} for kind in order]
    flat = flatten(
        Scene.model_validate({"camera": CAMERA, "materials": MATERIALS, "groups": groups, "shapes": shapes}), 8, 8
    )
    guides, words = flat.instances.guides.astype(np.int64), flat.instances.rows.view(np.uint32)
    firsts = words[1::2, layout.columns("PLACEMENT")["FIRST"]].astype(np.int64)
    numbers = np.arange(guides[0], guides[0] + flat.instances.primitive_count)
    bucket = (numbers - guides[0]) >> guides[1]
    low, high = guides[2:][bucket], guides[2:][bucket + 1]
    found = np.searchsorted(firsts, numbers, side="right") - 1
    assert (low <= found).all() and (found <= high).all()
    assert np.mean(high - low) < 2.0, "and need to look at few"


def test_what_shines_is_written_out() -> None:
    scene = of({"transforms": "a.npy"}, CUBE, LAMP, own=(BALL,)).with_files(
        transforms={"a.npy": TransformArray(matrices(50))}
    )
    assembly = assemble(scene)
    assert assembly.own_shapes == 51 and [len(each) for each in assembly.groups] == [1]
    assert {assembly.scene.place_of(index)[0] for index in range(1, 51)} == {"groups"}
    flat = flatten(scene, 8, 8)
    assert flat.light_count == 100 and flat.instances.primitive_count == 50 * 12
    power = flat.arrays["lights"]["radiance"][:100, 0]
    np.testing.assert_allclose(power, 2.0)


def many(count: int, places: int = 2, *shapes: dict[str, Any]) -> Scene:
    """So many groups, each with its places."""
    groups = {f"group {number}": {"shapes": list(shapes or (CUBE,))} for number in range(count)}
    maps = np.concatenate([matrices(places), np.broadcast_to([0.0, 0.0, 0.0, 1.0], (places, 1, 4))], axis=1).tolist()
    instances = [{"type": "instance", "group": group, "transforms": maps} for group in groups]
    return Scene.model_validate({"camera": CAMERA, "materials": MATERIALS, "groups": groups, "shapes": instances})


@pytest.mark.long
def test_many_small_groups_are_written_out() -> None:
    """Of more than 64; what can be told apart in an image stays what it was."""
    kept, written = assemble(many(64)), assemble(many(65))
    assert len(kept.groups) == 64 and kept.own_shapes == 0
    assert written.groups == () and written.own_shapes == 130 and len(written.group_of) == 0
    np.testing.assert_array_equal(written.seen_place, np.repeat(np.arange(65), 2))
    np.testing.assert_array_equal(written.seen_shape, np.arange(130))
    assert flatten(many(65), 8, 8).triangle_count == 130 * 12


@pytest.mark.parametrize(
    ("places", "shapes"),
    [
        (9, (CUBE,)),
        (4, (CUBE, BALL, BALL)),
        (2, ({"type": "mesh", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]] * 2049},)),
    ],
)
def test_large_groups_keep_their_trees(places: int, shapes: tuple[dict[str, Any], ...]) -> None:
    assembly = assemble(many(65, places, *shapes))
    assert len(assembly.groups) == 65 and assembly.own_shapes == 0 and len(assembly.group_of) == 65 * places


@pytest.mark.thorough
def test_too_many_primitives_are_told() -> None:
    faces = [[0, 1, 2]] * 20_000
    mesh = {"type": "mesh", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": faces}
    scene = of({"transforms": "a.npy"}, mesh)
    scene = scene.with_files(
        transforms={"a.npy": TransformArray(np.broadcast_to(np.eye(4)[:3], (NUMBER_LIMIT // 20_000 + 1, 3, 4)))}
    )
    with pytest.raises(SceneError, match="triangles with all instances counted, but 4,294,967,280 is the most"):
        flatten(scene, 8, 8)


def test_boxes_hold_their_instances() -> None:
    maps = matrices(500, 7) * 10.0 ** np.random.default_rng(8).uniform(-6.0, 3.0, (500, 1, 1))
    scene = of({"transforms": "a.npy"}, CUBE).with_files(transforms={"a.npy": TransformArray(maps)})
    boxes = flatten(scene, 8, 8).instances.boxes.astype(np.float64)
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    points = np.einsum("nij,kj->nki", maps[:, :, :3], corners) + maps[:, None, :, 3]
    reach = np.abs(points).max()
    assert (boxes[:, None, :3] < points).all() and (points < boxes[:, None, 3:]).all()
    room = np.maximum(points.min(axis=1) - boxes[:, :3], boxes[:, 3:] - points.max(axis=1))
    assert room.max() < 1e-4 * reach, "by no more than rounding"


def test_bounds_hold_instances() -> None:
    low, high = scene_bounds(of({"transform": {"translate": [7.0, 0.0, 0.0]}}, own=(BALL,)))
    np.testing.assert_allclose(low, [-0.5] * 3)
    np.testing.assert_allclose(high, [7.5, 0.5, 0.5])


def test_the_camera_may_be_in_an_instance_of_glass() -> None:
    glass = {**CUBE, "material": "glass", "size": [2.0, 2.0, 2.0]}
    around = of({"transform": {"translate": [0.0, 0.0, 5.0], "rotate_degrees": [0.0, 30.0, 0.0]}}, glass)
    assert flatten(around, 8, 8).camera["interior_first"][0] != 0
    beside = of({"transform": {"translate": [0.0, 3.0, 5.0]}}, glass)
    assert flatten(beside, 8, 8).camera["interior_first"][0] == 0


def test_hashes_tell_groups_and_places() -> None:
    base = of({"transforms": "a.npy"}).with_files(transforms={"a.npy": TransformArray(matrices(3))})
    same = of({"transforms": "b.npy"}).with_files(transforms={"b.npy": TransformArray(matrices(3))})
    moved = of({"transforms": "a.npy"}).with_files(transforms={"a.npy": TransformArray(matrices(3, 2))})
    other = of({"transforms": "a.npy"}, BALL).with_files(transforms={"a.npy": TransformArray(matrices(3))})
    assert base.sha256() == same.sha256()
    assert len({base.sha256(), moved.sha256(), other.sha256()}) == 3
    named = of({"transforms": "a.npy", "name": "trees"}).with_files(transforms={"a.npy": TransformArray(matrices(3))})
    assert named.sha256() == base.sha256(), "names are for mattes"


def test_groups_travel_and_are_written() -> None:
    mesh = {"type": "mesh", "file": "mesh"}
    triangle = MeshData(np.eye(3), np.array([[0, 1, 2]], np.uint32))
    scene = of({"transforms": "a.npy"}, CUBE, mesh).with_files(meshes={("mesh", None): triangle})
    scene = scene.with_files(transforms={"a.npy": TransformArray(matrices(5))})
    description, assets = scene_to_portable(scene)
    again = scene_from_portable(json.loads(json.dumps(description)), assets)
    assert again.sha256() == scene.sha256() and flatten(again, 8, 8).sha256 == flatten(scene, 8, 8).sha256
    export = exported(scene, "assets")
    assert sorted(Path(name).suffix for name in export.files) == [".npy", ".ply"]
    file = io.BytesIO()
    export.files[next(name for name in export.files if name.endswith(".npy"))](file)
    np.testing.assert_array_equal(np.load(io.BytesIO(file.getvalue())), matrices(5))


def test_convert_keeps_the_hash(tmp_path: Path) -> None:
    saved(tmp_path / "places.npy", matrices(4).astype(np.float32))
    path = scene_file(tmp_path, transforms="places.npy")
    with pytest.raises(SystemExit) as ended:
        main(["convert", str(path), str(tmp_path / "out.toml")])
    assert ended.value.code == 0
    assert load(tmp_path / "out.toml").sha256() == load(path).sha256()


def test_check_counts_all(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    saved(tmp_path / "places.npy", matrices(4))
    with pytest.raises(SystemExit):
        main(["check", str(scene_file(tmp_path, transforms="places.npy"))])
    told = capsys.readouterr().out
    assert "instances            4" in told and "48 primitives" in told


def draft(triangles: int, count: int) -> Draft:
    made = Draft()
    corners = np.tile(np.arange(3, dtype=np.uint32), (triangles, 1))
    made.meshes["bolt"] = MeshData(np.eye(3), corners)
    for number in range(count):
        where = {"translate": [float(number), 0.0, 0.0]} if number else {}
        shape = {"type": "mesh", "file": "bolt", "name": f"bolt {number % 2}", "transform": where}
        made.description["shapes"].append(shape)
    made.description["shapes"].append({"type": "mesh", "file": "bolt", "flip_normals": True})
    return made


def test_meshes_that_stand_there_many_times_are_kept_once() -> None:
    many = draft(2000, 100)
    share_meshes(many)
    shapes = many.description["shapes"]
    assert [shape["type"] for shape in shapes] == ["instance", "instance", "mesh"]
    assert [shape.get("name") for shape in shapes[:2]] == ["bolt 0", "bolt 1"]
    assert many.description["groups"] == {"bolt": {"shapes": [{"type": "mesh", "file": "bolt"}]}}
    offsets = many.places[shapes[1]["transforms"]].maps[:, 0, 3]
    np.testing.assert_array_equal(offsets, np.arange(1.0, 100.0, 2.0))


def test_a_motion_follows_the_transforms_of_instances() -> None:
    """As it follows those of shapes: it is not in the group, where it would be before them."""
    many = draft(2000, 100)
    keys = [{"time": 0.0}, {"time": 1.0, "rotate": [0.0, 90.0, 0.0]}]
    for shape in many.description["shapes"]:
        shape["motion"] = keys
    share_meshes(many)
    assert many.description["groups"] == {"bolt": {"shapes": [{"type": "mesh", "file": "bolt"}]}}
    assert [shape["motion"] for shape in many.description["shapes"]] == [keys] * 3


@pytest.mark.parametrize(("triangles", "count"), [(100, 100), (10**6, 1)])
def test_what_spares_little_stays_as_it_is(triangles: int, count: int) -> None:
    few = draft(triangles, count)
    shapes = list(few.description["shapes"])
    share_meshes(few)
    assert few.description["shapes"] == shapes and "groups" not in few.description
