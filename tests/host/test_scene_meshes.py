"""Mesh files in every form that is read, against the triangles that were written."""

from __future__ import annotations

import struct
import tracemalloc
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pytest
from cases import for_each
from special_files import special

from clrender.errors import SceneError
from clrender.files import named as named_files
from clrender.flatten.flat_scene import flatten
from clrender.meshes.data import MeshData
from clrender.meshes.read import read_mesh
from clrender.scene import Scene

POINTS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 0.5, 1)]
QUAD_AND_TRIANGLE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv .5 5e-1 1.\nf 1 2 3 4\nf 1 2 5\n"
FAN = [[0, 1, 2], [0, 2, 3], [0, 1, 4]]


def read(tmp_path: Path, name: str, data: str | bytes) -> MeshData:
    (tmp_path / name).write_bytes(data if isinstance(data, bytes) else data.encode())
    return read_mesh(name, tmp_path, (), "here")


def corners(mesh: MeshData) -> np.ndarray:
    return mesh.vertices[mesh.triangles].astype(np.float64)


EXPECTED = np.array(POINTS, dtype=np.float64)[np.array(FAN)]


@for_each(
    "text",
    [
        QUAD_AND_TRIANGLE,
        QUAD_AND_TRIANGLE.replace("\n", "\r\n"),
        QUAD_AND_TRIANGLE.replace(" ", "\t  "),
        QUAD_AND_TRIANGLE.rstrip("\n"),
        QUAD_AND_TRIANGLE.replace("f 1 2 3 4", "f 1 2 \\\n3 4"),
        QUAD_AND_TRIANGLE.replace("f 1 2 5", "f -5 -4 -1 # relative"),
        "mtllib no.mtl\no thing\n" + QUAD_AND_TRIANGLE.replace("f 1 2 5", "g other\nusemtl red\ns off\nf 1 2 5"),
        "vt 0 0\nvt 1 1\n" + QUAD_AND_TRIANGLE.replace("f 1 2 5", "f 1/1 2/2 5/1"),
        "vt 0 0\nvt 1 1\n" + QUAD_AND_TRIANGLE.replace("f 1 2 3 4", "f 1/1 2/2 3/1 4/2"),
        QUAD_AND_TRIANGLE.replace("f 1 2 3 4\n", "f 1 2 3\nf 1 3 4\n"),
        QUAD_AND_TRIANGLE.replace("v 0 0 0\n", "v 0 0 0 1.0 0.5 0.25\n").replace("v 1 0 0\n", "v 1 0 0 1 1 1\n"),
        "# comment \xff\n" + QUAD_AND_TRIANGLE,
        QUAD_AND_TRIANGLE.replace("f 1 2 3 4", "f 1/ 2// 3/ 4//"),
    ],
)
def test_obj(tmp_path: Path, text: str) -> None:
    mesh = read(tmp_path, "m.obj", text.encode("latin-1"))
    np.testing.assert_array_equal(corners(mesh), EXPECTED)
    assert mesh.normals is None and mesh.triangles.dtype == np.uint32


def test_obj_relative_indices_count_from_their_line(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 0 0\nv 6 0 0\nv 5 1 0\nf -3 -2 -1\n"
    mesh = read(tmp_path, "m.obj", text)
    assert corners(mesh)[:, 0, 0].tolist() == [0.0, 5.0]


@pytest.mark.parametrize("form", ["{0}//{1}", "{0}/1/{1}"])
def test_obj_normals(tmp_path: Path, form: str) -> None:
    faces = [[(1, 1), (2, 2), (3, 1)], [(1, 2), (3, 1), (4, 1)]]
    lines = [" ".join(form.format(*corner) for corner in face) for face in faces]
    head = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\nvn 0 1 0\n"
    mesh = read(tmp_path, "m.obj", head + "".join(f"f {line}\n" for line in lines))
    assert mesh.normals is not None
    np.testing.assert_array_equal(corners(mesh)[0], np.array(POINTS)[[0, 1, 2]])
    expected = np.array([[[0, 0, 1], [0, 1, 0], [0, 0, 1]], [[0, 1, 0], [0, 0, 1], [0, 0, 1]]])
    np.testing.assert_array_equal(mesh.normals[mesh.triangles], expected)


def ply(kind: str, extra: str = "", faces: str = "list uchar int vertex_indices", count: int = 2) -> str:
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    return (
        f"ply\nformat {kind} 1.0\ncomment made by hand\nelement vertex 5\n{axes}{extra}"
        f"element face {count}\nproperty {faces}\nend_header\n"
    )


def test_ply_ascii_of_mixed_polygons(tmp_path: Path) -> None:
    body = "".join(f"{x} {y} {z}\n" for x, y, z in POINTS) + "4 0 1 2 3\n3 0 1 4\n"
    np.testing.assert_array_equal(corners(read(tmp_path, "m.ply", ply("ascii") + body)), EXPECTED)


def test_ply_ascii_with_normals_colours_and_blank_lines(tmp_path: Path) -> None:
    extra = "".join(f"property float {n}\n" for n in ("nx", "ny", "nz")) + "property uchar red\n"
    body = "".join(f"{x} {y} {z} 0 0 2 255\n\n" for x, y, z in POINTS) + "4 0 1 2 3\n3 0 1 4\n"
    mesh = read(tmp_path, "m.ply", ply("ascii", extra) + body)
    np.testing.assert_array_equal(corners(mesh), EXPECTED)
    assert mesh.normals is not None
    np.testing.assert_array_equal(mesh.normals, np.tile([0, 0, 2], (5, 1)))


@pytest.mark.parametrize(("kind", "order"), [("binary_little_endian", "<"), ("binary_big_endian", ">")])
def test_ply_binary(tmp_path: Path, kind: str, order: str) -> None:
    body = b"".join(struct.pack(f"{order}3f", *p) for p in POINTS)
    body += b"".join(struct.pack(f"{order}B3i", 3, *face) for face in FAN)
    np.testing.assert_array_equal(corners(read(tmp_path, "m.ply", ply(kind, count=3).encode() + body)), EXPECTED)


def test_ply_binary_of_quads_with_unsigned_indices(tmp_path: Path) -> None:
    head = ply("binary_little_endian", "property uchar red\n", "list uint8 uint16 vertex_index", 1)
    body = b"".join(struct.pack("<3fB", *p, 9) for p in POINTS) + struct.pack("<B4H", 4, 0, 1, 2, 3)
    np.testing.assert_array_equal(corners(read(tmp_path, "m.ply", head.encode() + body)), EXPECTED[:2])


def test_ply_binary_with_a_damaged_count(tmp_path: Path) -> None:
    points = b"".join(struct.pack("<3f", *p) for p in POINTS)
    face = struct.pack("<B3i", 3, 0, 1, 2)
    for count in (4, 2, 200):
        damaged = points + face + bytes([count]) + face[1:]
        with pytest.raises(SceneError, match=r"truncated|left over|fewer than three"):
            read(tmp_path, "m.ply", ply("binary_little_endian").encode() + damaged)


def test_hash_is_of_the_triangles(tmp_path: Path) -> None:
    body = b"".join(struct.pack("<3f", *p) for p in POINTS) + b"".join(struct.pack("<B3i", 3, *face) for face in FAN)
    binary = read(tmp_path, "a.ply", ply("binary_little_endian", count=3).encode() + body)
    text = "".join(f"{x} {y} {z}\n" for x, y, z in POINTS) + "4 0 1 2 3\n3 0 1 4\n"
    assert binary.sha256() == read(tmp_path, "b.ply", ply("ascii") + text).sha256()


def test_links_within_the_folder_and_allowed_folders(tmp_path: Path) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    for folder in (here, there):
        folder.mkdir()
        (folder / "m.obj").write_text(QUAD_AND_TRIANGLE)
    (here / "link.obj").symlink_to("m.obj")
    (here / "out.obj").symlink_to(there / "m.obj")
    assert len(read_mesh("link.obj", here, (), "x").triangles) == 3
    assert len(read_mesh(str(here / "m.obj"), here, (), "x").triangles) == 3
    for name in ("out.obj", "../there/m.obj", str(there / "m.obj")):
        with pytest.raises(SceneError, match="outside"):
            read_mesh(name, here, (), "x")
        assert len(read_mesh(name, here, (there,), "x").triangles) == 3


# --- texts as other programs write them ------------------------------------------------------------------------------


@for_each(
    "data",
    [
        b"\xef\xbb\xbf" + QUAD_AND_TRIANGLE.encode(),
        b"\f\n" + QUAD_AND_TRIANGLE.replace("v 1 0 0", "\fv 1 0 0").encode(),
        QUAD_AND_TRIANGLE.replace("v 1 0 0", "v\v1 0\f0").encode(),
        QUAD_AND_TRIANGLE.replace("\n", "\r").encode(),
        QUAD_AND_TRIANGLE.encode() + b"\\",
        b"# C:\\meshes\\\n" + QUAD_AND_TRIANGLE.encode(),
        QUAD_AND_TRIANGLE.replace("f 1 2 3 4", "f 1 2 \\\r\n3 \\\r\n4").encode(),
        QUAD_AND_TRIANGLE.replace("f 1 2 3 4", "f 1// 2 3/ 4").encode(),
        QUAD_AND_TRIANGLE.replace("v .5 5e-1 1.", "v +0.5 .05e+1 100000000000000000000e-20").encode(),
    ],
)
def test_obj_dialects(tmp_path: Path, data: bytes) -> None:
    np.testing.assert_array_equal(corners(read(tmp_path, "m.obj", data)), EXPECTED)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-32"])
def test_texts_of_wide_characters_are_named(tmp_path: Path, encoding: str) -> None:
    with pytest.raises(SceneError, match=r"UTF-16; save it as UTF-8|is no text file: it holds zero bytes"):
        read(tmp_path, "m.obj", QUAD_AND_TRIANGLE.encode(encoding))


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("v 0 0 0\nv 1 \\\n0 0\nv 0 1 oops\n", 4),
        ("v 0 0 0\r\nv 1 \\\r\n0 \\\r\n0\r\nv 0 1 \\\r\noops\r\n", 5),
        ("\f\n\v\nv 1 0 oops\n", 3),
        ("v 0 0 0\n" * 300_000 + "v 0 \\\n0 0\nv 0 0 1.2.3\n", 300_003),
        ("v 0 0 0\n" * 300_000 + "f 1 2 3\nf 1 2\\\n 3\nf 1 2-3\n", 300_004),
        ("v 0 0 0\n" * 9 + "f 1/1/ 2/2/ 3/3/\nf 1/1/ 2/2/ 3//\nf 1/1/1/1 2 3\n", 12),
        ("v 0 0 0\n" * 9 + "f 1 2 3\nf 1 2 1e3\n", 11),
    ],
)
def test_obj_errors_name_the_line(tmp_path: Path, text: str, line: int) -> None:
    with pytest.raises(SceneError, match=rf"line {line} "):
        read(tmp_path, "m.obj", text)


def test_numbers_are_correctly_rounded(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    values = np.concatenate([rng.normal(size=300), 10.0 ** rng.uniform(-12, 11, 300), [0.0, -0.0, 1e-300]])
    forms = ["%.6f", "%.17g", "%.3e", "%.0f", "%.12f", "%.15g", "%+.4f"]
    for form in forms:
        words = [form % value for value in values]
        rows = "".join(f"v {' '.join(words[i : i + 3])}\n" for i in range(0, len(words), 3))
        mesh = read(tmp_path, "m.obj", rows + "f 1 2 3\n")
        expected = np.array([float(word) for word in words])
        assert mesh.vertices.ravel().tobytes() == expected.tobytes()


def test_words_that_hold_two_numbers_or_none(tmp_path: Path) -> None:
    # Each line has three blanks, and the numbers in both together are six.
    for lines in ("v 1.2.3 4 5\nv . 1 2\n", "v 1-2 3 4\nv - 1 2\n", "v .-1 2 3\nv 1 2 3\n", "v 1_0 2 3\nv 0x1 2 3\n"):
        with pytest.raises(SceneError, match="line 1 "):
            read(tmp_path, "m.obj", lines + "f 1 2 3\n")
    for face in ("f 1//2//3 4 5", "f 1-2//3 4// 5//6", "f 1/-/3 2/1/1 3/1/1", "f /1 2 3", "f 1///1 2 3"):
        with pytest.raises(SceneError, match="line 7 "):
            read(tmp_path, "m.obj", "v 0 0 0\n" * 5 + "vn 0 0 1\n" + face + "\n")


def test_obj_concave_polygon_has_its_own_area(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 1 .25 0\nv .25 .25 0\nv .25 1 0\nv 0 1 0\n"
    for face in ("1 2 3 4 5 6", "2 3 4 5 6 1", "5 6 1 2 3 4", "6 5 4 3 2 1"):
        a, b, c = np.moveaxis(corners(read(tmp_path, "m.obj", text + f"f {face}\n")), 1, 0)
        assert np.abs(np.cross(b - a, c - a)[:, 2]).sum() / 2 == 0.4375


def test_a_polygon_that_crosses_itself_is_told(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 1 1 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 4\nf 1 3 2\n")
    scene = Scene(
        camera={"position": (0, 0, 5), "target": (0, 0, 0)},
        shapes=({"type": "mesh", "file": "m.obj"},),
        lights=({"type": "environment", "radiance": (1, 1, 1)},),
    )
    warnings = flatten(scene.placed("s", tmp_path), 8, 8).warnings
    assert warnings == (
        "s: shapes[0]: one polygon crosses its own outline and cannot be covered once; check the model there",
    )


def test_obj_vertex_with_two_normals_beside_vertices_with_one(tmp_path: Path) -> None:
    head = "".join(f"v {x} {y} {z}\n" for x, y, z in POINTS) + "vn 0 0 1\nvn 1 0 0\n"
    mesh = read(tmp_path, "m.obj", head + "f 1//1 2//1 3//1\nf 1//2 3//1 4//1\n")
    assert mesh.normals is not None and len(mesh.vertices) == 5
    np.testing.assert_array_equal(corners(mesh), np.array(POINTS)[[[0, 1, 2], [0, 2, 3]]])
    assert mesh.normals[mesh.triangles][:, 0].tolist() == [[0, 0, 1], [1, 0, 0]]


# --- PLY -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("count", [3, 100_003])
def test_ply_binary_of_triangles_and_quads(tmp_path: Path, order: str, count: int) -> None:
    faces = [[0, 1, 2, 3] if i % 3 == 0 or 5000 < i < 9000 else [0, 1, 4] for i in range(count)]
    kind = "binary_little_endian" if order == "<" else "binary_big_endian"
    head = ply(kind, "", "list uchar int vertex_indices\nproperty uchar red", count)
    body = b"".join(struct.pack(f"{order}3f", *p) for p in POINTS)
    body += b"".join(struct.pack(f"{order}B{len(face)}iB", len(face), *face, 7) for face in faces)
    mesh = read(tmp_path, "m.ply", head.encode() + body)
    expected = [triangle for face in faces for triangle in ([face[:3]] if len(face) == 3 else FAN[:2])]
    np.testing.assert_array_equal(mesh.triangles, expected)


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian"])
def test_ply_with_other_elements_and_lists(tmp_path: Path, kind: str) -> None:
    # Texture coordinates before the indices, an element nobody asked for in the middle, edges at the end.
    head = (
        f"ply\nformat {kind} 1.0\ncomment end_header\ncomment property float x\nelement vertex 5\n"
        "property float x\nproperty float y\nproperty float z\nelement strip 2\nproperty list ushort short a\n"
        "element face 2\nproperty uchar red\nproperty list uchar float texcoord\nproperty list int uint vertex_index\n"
        "element edge 1\nproperty int a\nproperty int b\nend_header\n"
    )
    faces = [[0, 1, 2, 3], [0, 1, 4]]
    if kind == "ascii":
        body = "".join(f"{x} {y} {z}\n" for x, y, z in POINTS).encode() + b"2 5 6\n0\n"
        body += b"".join(b"9 2 .5 .5 %d %b\n" % (len(f), " ".join(map(str, f)).encode()) for f in faces) + b"0 1\n"
    else:
        body = b"".join(struct.pack("<3f", *p) for p in POINTS) + struct.pack("<HhhH", 2, 5, 6, 0)
        body += b"".join(struct.pack(f"<BB2fi{len(f)}I", 9, 2, 0.5, 0.5, len(f), *f) for f in faces)
        body += struct.pack("<ii", 0, 1)
    np.testing.assert_array_equal(corners(read(tmp_path, "m.ply", head.encode() + body)), EXPECTED)


def test_ply_ascii_keeps_the_width_the_header_declares(tmp_path: Path) -> None:
    body = "0.1 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n4 0 1 2 3\n3 0 1 4\n"
    single = read(tmp_path, "m.ply", ply("ascii") + body)
    double = read(tmp_path, "m.ply", ply("ascii").replace("float", "double") + body)
    assert single.vertices.dtype == np.float32 and single.vertices[0, 0] == np.float32(0.1)
    assert double.vertices.dtype == np.float64 and double.vertices[0, 0] == 0.1


def test_ply_lists_that_ask_for_too_much_end_soon(tmp_path: Path) -> None:
    head = ply("binary_little_endian", "", "list uint int vertex_indices").encode()
    body = b"".join(struct.pack("<3f", *p) for p in POINTS)
    for count in (2**32 - 1, 2**31, 10**6):
        with pytest.raises(SceneError, match="truncated"):
            faces = struct.pack("<I3i", 3, 0, 1, 2) + struct.pack("<I", count) + bytes(9)
            read(tmp_path, "m.ply", head + body + faces)
    with pytest.raises(SceneError, match="has -1 entries"):
        signed = head.replace(b"list uint", b"list char")
        read(tmp_path, "m.ply", signed + body + struct.pack("<b3i", 3, 0, 1, 2) + b"\xff" * 13)


# --- files that are none ---------------------------------------------------------------------------------------------


def test_meshes_stream(tmp_path: Path) -> None:
    # A file of 40 MiB that holds one triangle takes a few MiB.
    with (tmp_path / "m.obj").open("wb") as file:
        file.write(b"v 0 0 0\nv 1 0 0\nv 0 1 0\n")
        for _ in range(40):
            file.write(b"# nothing at all\n" * (2**20 // 17))
        file.write(b"f 1 2 3\n")
    read(tmp_path, "n.obj", QUAD_AND_TRIANGLE)
    tracemalloc.start()
    try:
        assert len(read_mesh("m.obj", tmp_path, (), "x").triangles) == 1
        assert tracemalloc.get_traced_memory()[1] < 30 << 20
    finally:
        tracemalloc.stop()


@for_each("kind", ["pipe", "socket", "device", "folder"])
@for_each("ending", [".ply", ".obj"])
def test_what_is_no_file_is_refused_at_once(tmp_path: Path, kind: str, ending: str) -> None:
    path = tmp_path / f"m{ending}"
    with special(path, kind):
        names = [path.name, str(path)]
        for name in names:
            with pytest.raises(SceneError, match=r"only regular files are read|is a folder"):
                read_mesh(name, tmp_path, (Path("/dev"),), "x")


def test_a_link_put_in_the_way_between_check_and_opening_is_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    for folder in (here / "sub", there):
        folder.mkdir(parents=True)
        (folder / "m.obj").write_text(QUAD_AND_TRIANGLE)
    real = named_files.open_scene_file

    def swapped(path: Path, label: str, limit: int, beneath: Path | None = None) -> tuple[BinaryIO, int]:
        (here / "sub").rename(here / "old")
        (here / "sub").symlink_to(there)
        return real(path, label, limit, beneath)

    monkeypatch.setattr(named_files, "open_scene_file", swapped)
    with pytest.raises(SceneError, match="cannot be opened"):
        read_mesh("sub/m.obj", here, (), "x")
