"""Strands: their files, what is refused, how they become curves, and how they go from one place to another."""

from __future__ import annotations

import io
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each

import clrender
from clrender.curves import CurveData, read_curves
from clrender.errors import SceneError
from clrender.exporters import exported, exported_to_cycles, exported_to_luxcore, exported_to_mitsuba, scene_text
from clrender.flatten.bounds import scene_bounds
from clrender.flatten.curves import bezier_segments
from clrender.flatten.flat_scene import flatten
from clrender.flatten.ribbons import with_ribbons_as_meshes
from clrender.flatten.tubes import curve_mesh
from clrender.integrators import INTEGRATORS
from clrender.rendering.job import RenderJob
from clrender.scene import Curves, Mesh
from clrender.scene.portable import scene_from_portable, scene_to_portable

CAMERA: dict[str, Any] = {"position": [0.0, 0.0, 5.0], "target": [0.0, 0.0, 0.0]}
POINTS = [[0.0, 0.0, 0.0], [0.1, 0.5, 0.0], [0.0, 1.0, 0.1], [0.2, 1.5, 0.0], [0.3, 2.0, 0.3]]
ROWS = np.random.RandomState(3).uniform(0.0, 1.0, (3, 5, 4))


def described(**shape: Any) -> dict[str, Any]:
    given = {"type": "curves", "points": POINTS, "radius": 0.02, **shape}
    return {"camera": CAMERA, "shapes": [{key: value for key, value in given.items() if value is not None}]}


def scene_of(**shape: Any) -> clrender.Scene:
    return clrender.Scene(**described(**shape))


def npy(values: Any) -> bytes:
    file = io.BytesIO()
    np.save(file, values)
    return file.getvalue()


def read(folder: Path, name: str, data: bytes) -> CurveData:
    (folder / name).write_bytes(data)
    return read_curves(name, folder, (), "here")


def test_files_hold_strands(tmp_path: Path) -> None:
    whole = read(tmp_path, "a.npy", npy(ROWS))
    assert whole.counts.tolist() == [5, 5, 5] and np.array_equal(whole.points, ROWS[..., :3].reshape(-1, 3))
    assert whole.radii is not None and np.array_equal(whole.radii, ROWS[..., 3].ravel())
    bare = read(tmp_path, "b.npy", npy(ROWS[0, :, :3].astype(np.float32)))
    assert bare.radii is None and bare.counts.tolist() == [5]
    parted = np.concatenate([ROWS[0], [[np.nan] * 4], ROWS[1, :2], [[np.nan] * 4] * 2])
    assert read(tmp_path, "c.npy", npy(parted)).counts.tolist() == [5, 2]
    lines = ["\n".join(" ".join(map(repr, row)) for row in strand) for strand in ROWS.tolist()]
    text = read(tmp_path, "d.txt", ("\n\n" + "\n \n\r\n".join(lines) + "\n").encode())
    assert text.sha256() == whole.sha256()


@for_each(
    "name, data, text",
    [
        ("a.obj", b"", "is of no kind that can be read; curves may be .npy, .txt"),
        ("a.npy", npy(np.zeros((2, 3, 4, 4))), "holds float64 .2, 3, 4, 4., but must hold numbers"),
        ("a.npy", npy(np.zeros((2, 5))), "but must hold numbers of the shape"),
        ("a.npy", npy(np.zeros((0, 4))), "has no control points"),
        ("a.npy", npy(np.full((4, 3), np.inf)), "has inf in point 0"),
        ("a.npy", npy(np.array([[0, 0, 0, 1], [0, np.nan, 0, 1.0]])), "has nan in point 1"),
        ("a.npy", npy(np.array([[0, 0, 0, 1], [0, 0, 0, -1.0]])), "has the radius -1 at point 1"),
        ("a.npy", b"no numbers", "is no readable .npy file"),
        ("a.txt", b"0 0 0 1\n0 0 1\n", "line 2 has 3 numbers"),
        ("a.txt", b"0 0 0 1\n0 0 x 1\n", "line 2 has b'x'"),
        ("a.txt", b"0 0 0 1\n0 0 1-e 1\n", "has a word that is no number"),
        ("a.txt", b"\n\n", "has no control points"),
        ("a.txt", b"1 2\n", "line 1 has 2 numbers"),
    ],
)
def test_what_holds_none_is_refused(tmp_path: Path, name: str, data: bytes, text: str) -> None:
    with pytest.raises(SceneError, match=text):
        read(tmp_path, name, data)


def test_mutated_files_are_read_or_refused(tmp_path: Path) -> None:
    """In one sentence, and nothing else."""
    dice = random.Random(4)
    text = "\n".join(" ".join(f"{x:.3f}" for x in row) for row in ROWS[0].tolist()).encode()
    for name, whole in (("a.npy", npy(ROWS)), ("a.txt", text)):
        for _ in range(60):
            data = bytearray(whole)
            for _ in range(dice.choice((1, 1, 4, 20))):
                data[dice.randrange(len(data))] = dice.randrange(256)
            try:
                read(tmp_path, name, bytes(data[: dice.choice((len(data), len(data), dice.randrange(len(data))))]))
            except SceneError as error:
                assert "\n" not in str(error)


@for_each(
    "shape, text",
    [
        ({"points": None}, "needs either `file` or `points`"),
        ({"file": "a.npy"}, "needs either `file` or `points`"),
        ({"radius": None}, "radius is missing"),
        ({"radius": 0.0}, "radius is 0, which nothing"),
        ({"radius": -1.0}, "greater than or equal|not be negative|below 0|must be"),
        ({"radius": [0.1, 0.1, 0.2]}, "has 3 entries; give one, two for roots and tips, or 5"),
        ({"counts": [2, 2]}, "add up to 4, but the curves have 5 points"),
        ({"emission": 1.0}, "cannot shine|emission"),
        ({"interior": "fog"}, "have no inside"),
        ({"flip_normals": True}, "have no inside"),
        ({"transform": {"scale": [1.0, 2.0, 1.0]}}, "stretches a sphere, disk or curve unevenly"),
        ({"basis": "nurbs"}, "basis"),
        ({"profile": "square"}, "profile"),
    ],
)
def test_what_is_no_curve_is_refused(shape: dict[str, Any], text: str) -> None:
    with pytest.raises(SceneError, match=text):
        scene_of(**shape)


@for_each(
    "basis, counts, text",
    [
        ("bspline", [3, 2], "strand 0 has 3 control points, but curves of the basis bspline need at least 4"),
        ("bezier", [5], "strand 0 has 5 control points, but curves of the basis bezier need 4, 7, 10 and so on"),
        ("linear", [4, 1], "strand 1 has 1 control point, but curves of the basis linear need at least 2"),
        ("catmull-rom", [1, 4], "strand 0 has 1 control point, but"),
    ],
)
def test_strands_of_too_few_points_are_refused(basis: str, counts: list[int], text: str) -> None:
    with pytest.raises(SceneError, match=rf"shapes\[0\]: {text}"):
        flatten(scene_of(basis=basis, counts=counts), 8, 8)


def test_files_of_too_few_points_are_named(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("0 0 0\n")
    scene = scene_of(points=None, file="a.txt", basis="linear").placed("scene", tmp_path)
    with pytest.raises(SceneError, match=r'shapes\[0\]\.file: "a\.txt": strand 0 has 1 control point'):
        flatten(scene, 8, 8)
    (tmp_path / "a.txt").write_text("0 0 0 0\n1 0 0 0\n")
    scene = scene_of(points=None, file="a.txt", radius=None, basis="linear").placed("scene", tmp_path)
    with pytest.raises(SceneError, match=r'shapes\[0\]\.file: "a\.txt": all radii of its file are 0'):
        flatten(scene, 8, 8)


@for_each(
    "material, text",
    [
        ({"type": "dielectric", "ior": 1.5}, "names .m., which has an inside"),
        ({"type": "principled", "transmission": 1.0}, "which has an inside"),
        ({"type": "subsurface", "reflectance": [0.5] * 3, "radius": [0.1] * 3}, "which has an inside|"),
        ({"type": "principled", "emission": [1.0] * 3}, "which shines"),
    ],
)
def test_materials_with_an_inside_are_refused(material: dict[str, Any], text: str) -> None:
    with pytest.raises(SceneError, match=text):
        clrender.Scene(**described(material="m"), materials={"m": material})
    if text.endswith("inside"):
        mixed = {"m": {"type": "mix", "materials": ["a", "b"]}, "a": material, "b": {"type": "mirror"}}
        with pytest.raises(SceneError, match=text):
            clrender.Scene(**described(material="m"), materials=mixed)


def test_radiosity_takes_no_curves() -> None:
    assert not INTEGRATORS["radiosity"].curves
    with pytest.raises(SceneError, match=r"shapes\[0\]: the integrator radiosity takes no curves"):
        RenderJob.of(scene_of(), size=(8, 8), spp=1, integrator="radiosity")


@pytest.mark.parametrize("basis", ["bspline", "bezier", "catmull-rom", "linear"])
def test_curves_of_a_basis(basis: str) -> None:
    """Against the definitions: blossoms, points that are met, and tangents there."""
    points = np.random.RandomState(1).uniform(0.2, 1.0, (7, 4))
    controls, strand = bezier_segments(points, np.array([7]), basis, "here")
    assert (strand == 0).all()
    begins, ends, slopes = controls[:, 0], controls[:, 3], 3.0 * (controls[:, 1] - controls[:, 0])
    assert ends[:-1] == pytest.approx(begins[1:])
    if basis == "bspline":
        assert len(controls) == 4
        assert begins == pytest.approx((points[:4] + 4.0 * points[1:5] + points[2:6]) / 6.0)
        assert slopes == pytest.approx((points[2:6] - points[:4]) / 2.0)
        curvature = 6.0 * (controls[:, 0] - 2.0 * controls[:, 1] + controls[:, 2])
        assert curvature == pytest.approx(points[:4] - 2.0 * points[1:5] + points[2:6])
    elif basis == "bezier":
        assert np.array_equal(controls, [points[:4], points[3:]])
    else:
        assert np.array_equal(begins, points[:-1]) and np.array_equal(ends, points[1:])
        if basis == "linear":
            assert slopes == pytest.approx(np.diff(points, axis=0))
        else:
            assert slopes[1:] == pytest.approx((points[2:] - points[:-2]) / 2.0)


def test_curves_are_cut_where_they_turn() -> None:
    arch = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, 0.0, 0.0]]
    straight = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 2.0, 0.0], [0.0, 3.0, 0.0]]
    assert flatten(scene_of(points=straight, basis="bezier"), 8, 8).analytic_count == 1
    cut = flatten(scene_of(points=arch, basis="bezier"), 8, 8)
    assert 4 <= cut.analytic_count <= 32
    rows = cut.arrays["curve_rows"].reshape(-1, 4, 4)
    assert rows[:-1].sum(axis=1) == pytest.approx(rows[1:, 0], abs=1e-6), "each goes on where the last one ends"
    doubled = [[0.0, 0.0, 0.0]] * 2 + [[0.0, 1.0, 0.0]] * 2
    assert flatten(scene_of(points=doubled, basis="bezier"), 8, 8).analytic_count >= 1


def test_radii_from_root_to_tip() -> None:
    flat = flatten(scene_of(radius=[0.1, 0.02], basis="linear"), 8, 8)
    rows = flat.arrays["curve_rows"].reshape(-1, 4, 4)
    assert rows[:, 0, 3] == pytest.approx([0.1, 0.08, 0.06, 0.04])
    given = flatten(scene_of(radius=[0.1, 0.2, 0.0, 0.1, 0.3], basis="linear"), 8, 8)
    assert given.arrays["curve_rows"].reshape(-1, 4, 4)[:, 0, 3] == pytest.approx([0.1, 0.2, 0.0, 0.1])
    twice = flatten(scene_of(transform={"scale": 2.0}, basis="linear"), 8, 8)
    assert twice.arrays["curve_rows"].reshape(-1, 4, 4)[:, 0, 3] == pytest.approx(0.04)


def test_a_file_without_radii_needs_one(tmp_path: Path) -> None:
    bare = {"file": "a.npy", "points": None, "radius": None}
    scene = scene_of(**bare).with_arrays(curves={"a.npy": ROWS[..., :3]})
    with pytest.raises(SceneError, match=r"shapes\[0\].radius is missing, and its file has none"):
        flatten(scene, 8, 8)
    flatten(scene_of(**{**bare, "radius": 0.1}).with_arrays(curves={"a.npy": ROWS[..., :3]}), 8, 8)
    with pytest.raises(SceneError, match="has 7 entries; give one, two for roots and tips, or 15"):
        flatten(scene_of(**{**bare, "radius": [0.1] * 7}).with_arrays(curves={"a.npy": ROWS[..., :3]}), 8, 8)
    with pytest.raises(SceneError, match="all radii of its file are 0"):
        flatten(scene_of(**bare).with_arrays(curves={"a.npy": ROWS * [1.0, 1.0, 1.0, 0.0]}), 8, 8)


def test_strands_go_to_other_processes_and_files(tmp_path: Path) -> None:
    scene = scene_of(file="a.npy", points=None, radius=None).with_arrays(curves={"a.npy": ROWS})
    again = scene_from_portable(*scene_to_portable(scene))
    assert again.sha256() == scene.sha256()
    export = exported(scene, "files")
    for name, write in export.files.items():
        (tmp_path / "out" / name).parent.mkdir(parents=True, exist_ok=True)
        with (tmp_path / "out" / name).open("wb") as file:
            write(file)
    (tmp_path / "out" / "b.toml").write_bytes(scene_text(export.description, ".toml", "a test"))
    assert clrender.load(tmp_path / "out" / "b.toml").sha256() == scene.sha256()
    moved = scene_of(file="a.npy", points=None, radius=None).with_arrays(curves={"a.npy": ROWS * 1.5})
    assert moved.sha256() != scene.sha256()
    with pytest.raises(SceneError, match=r"curves: .a.npy. holds float64 \(2,\), but must hold numbers"):
        scene.with_arrays(curves={"a.npy": [1.0, 2.0]})


@for_each("counts", [[16, -1], [2**62] * 4 + [15], [0, 15], [5, 5], 15, [[5, 5, 5]], []])
def test_assets_of_wrong_lengths_are_refused(counts: Any) -> None:
    scene = scene_of(file="a.npy", points=None, radius=None).with_arrays(curves={"a.npy": ROWS})
    text, _ = scene_to_portable(scene)
    rows, lengths = ROWS.reshape(-1, 4), np.array(counts, np.int64)
    name = CurveData(np.ascontiguousarray(rows[:, :3]), np.ascontiguousarray(rows[:, 3]), lengths).sha256()
    text["shapes"][0]["file"] = f"sha256:{name}"
    archive = io.BytesIO()
    np.savez(archive, rows=rows, counts=lengths)
    with pytest.raises(SceneError, match=r"not as long as it says|no list of points or of lengths"):
        scene_from_portable(text, {name: archive.getvalue()})


def test_exporters_tell_of_curves() -> None:
    scene = scene_of(basis="bspline")
    mitsuba = exported_to_mitsuba(scene, "files")
    assert b"bsplinecurve" in mitsuba.text and not any("roundness" in note for note in mitsuba.notes)
    for export in (exported_to_mitsuba(scene_of(basis="catmull-rom"), "f"), exported_to_luxcore(scene, "f")):
        assert any("roundness of curves" in note for note in export.notes)
    assert any("roundness of curves" in note for note in exported_to_cycles(scene, "f").notes)


@for_each(("material", "kind"), [("lambert", "ply"), ("hair", "bsplinecurve")])
def test_textures_along_curves_of_mitsuba(material: str, kind: str) -> None:
    """Mitsuba's run along all strands of a file, so that they are triangles."""
    reflectance = {"ramp": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]}
    scene = clrender.Scene(
        materials={"m": {"type": material, "reflectance": reflectance}}, **described(material="m", basis="bspline")
    )
    export = exported_to_mitsuba(scene, "files")
    assert f'<shape type="{kind}"'.encode() in export.text


def test_tubes_are_closed_and_as_large_as_strands() -> None:
    shape = scene_of(points=[[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 2.0, 0.0]], basis="linear", radius=0.1).shapes[0]
    assert isinstance(shape, Curves)
    data = CurveData(np.array(shape.points), None, np.array([3]))
    mesh = curve_mesh(shape, data, around=96)
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a) / 2.0
    assert normals.sum(axis=0) == pytest.approx(0.0, abs=1e-12)
    assert (normals * a).sum() / 3.0 == pytest.approx(np.pi * 0.01 * 2.0, rel=2e-3), "its volume, from outside"
    assert mesh.normals is not None
    assert ((mesh.normals[mesh.triangles[:-190, 0]] * normals[:-190]).sum(axis=1) > 0.0).all()


def test_bounds_hold_the_strands() -> None:
    low, high = scene_bounds(scene_of(basis="linear"))
    points = np.array(POINTS)
    assert low == pytest.approx(points.min(axis=0) - 0.02, abs=1e-5)
    assert high == pytest.approx(points.max(axis=0) + 0.02, abs=1e-5)


BLADE: dict[str, Any] = {"profile": "ribbon", "basis": "linear", "points": [[0, 0, 0], [0, 1, 0], [0, 2, 0]]}


def test_ribbons_are_flat_strips_that_face_their_normals() -> None:
    scene = scene_of(**BLADE, radius=[0.2, 0.0], normals=[[0.0, 0.0, 3.0]])
    (shape,) = with_ribbons_as_meshes(scene).shapes
    assert isinstance(shape, Mesh) and shape.file is not None
    mesh = with_ribbons_as_meshes(scene).mesh(0)
    assert mesh.normals is not None and np.allclose(mesh.normals, [0.0, 0.0, 1.0], atol=1e-6)
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    areas = np.cross(b - a, c - a) / 2.0
    assert areas.sum(axis=0) == pytest.approx([0.0, 0.0, 0.4]), "half of the height times the width at the root"
    assert mesh.uvs is not None and mesh.uvs.min() == 0.0 and mesh.uvs.max() == 1.0
    free = with_ribbons_as_meshes(scene_of(**BLADE, radius=0.1)).mesh(0)
    assert free.vertices.shape == (34, 3) and np.isfinite(free.vertices).all()


def test_normals_of_ribbons_turn_from_point_to_point(tmp_path: Path) -> None:
    rows = np.array([[0, 0, 0, 0.1, 0, 0, 1], [0, 1, 0, 0.1, 1, 0, 0], [0, 2, 0, 0.1, 0, 0, -1]], np.float64)
    np.save(tmp_path / "a.npy", rows)
    scene = scene_of(file="a.npy", profile="ribbon", basis="linear", points=None, radius=None)
    made = with_ribbons_as_meshes(scene.placed("test", tmp_path, ()))
    normals = made.mesh(0).normals
    assert normals is not None
    for at, wanted in ((0, [0, 0, 1]), (16, [1, 0, 0]), (32, [0, 0, -1])):
        assert normals[at] == pytest.approx(wanted, abs=1e-6)
    text, assets = scene_to_portable(scene.placed("test", tmp_path, ()))
    assert scene_from_portable(text, assets).sha256() == scene.placed("test", tmp_path, ()).sha256()
    export = exported(scene.placed("test", tmp_path, ()), "files")
    with export.written(tmp_path / "b.toml"):
        (tmp_path / "b.toml").write_bytes(scene_text(export.description, ".toml", "a test"))
    assert clrender.load(tmp_path / "b.toml").sha256() == scene.placed("test", tmp_path, ()).sha256()


@for_each(
    ("keys", "said"),
    [
        ({"profile": "round", "normals": [[0, 1, 0]]}, r"normals are for ribbons; give profile"),
        ({"normals": [[0, 0, 0]]}, r"normals\[0\] is zero, which has no direction"),
        ({"normals": [[0, 1, 0]] * 2}, r"normals has 2 entries; give one, or 3"),
    ],
)
def test_refused_normals(keys: dict[str, Any], said: str) -> None:
    with pytest.raises(SceneError, match=said):
        scene_of(**{**BLADE, "radius": 0.1, **keys})


def test_ribbons_of_files_have_a_normal_for_each_point(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([[0.0, 0, 0, 0.1], [0, 1, 0, 0.1]]))
    scene = scene_of(file="a.npy", profile="ribbon", basis="linear", points=None, radius=None, normals=[[0, 0, 1]] * 3)
    with pytest.raises(SceneError, match=r"shapes\[0\]\.normals has 3 entries; give one, or 2"):
        flatten(scene.placed("test", tmp_path, ()), 8, 8)
    with pytest.raises(SceneError, match="has no direction as the normal of point 1"):
        CurveData.checked(np.array([[0.0, 0, 0, 1, 0, 0, 1], [1, 0, 0, 1, 0, 0, 0]]), np.array([2]), "here")
