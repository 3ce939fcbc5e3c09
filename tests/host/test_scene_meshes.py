"""Mesh files in every form that is read, against the triangles that were written."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from clrender.errors import SceneError
from clrender.scene.mesh_io import MeshData, read_mesh

POINTS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 0.5, 1)]
QUAD_AND_TRIANGLE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv .5 5e-1 1.\nf 1 2 3 4\nf 1 2 5\n"
FAN = [[0, 1, 2], [0, 2, 3], [0, 1, 4]]


def read(tmp_path: Path, name: str, data: str | bytes) -> MeshData:
    (tmp_path / name).write_bytes(data if isinstance(data, bytes) else data.encode())
    return read_mesh(name, tmp_path, (), "here")


def corners(mesh: MeshData) -> np.ndarray:
    return mesh.vertices[mesh.triangles].astype(np.float64)


EXPECTED = np.array(POINTS, dtype=np.float64)[np.array(FAN)]


@pytest.mark.parametrize(
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
    body = (
        b"".join(struct.pack("<3f", *p) for p in POINTS)
        + struct.pack("<B3i", 3, 0, 1, 2)
        + struct.pack("<B3i", 4, 0, 1, 2)
    )
    with pytest.raises(SceneError, match="damaged"):
        read(tmp_path, "m.ply", ply("binary_little_endian").encode() + body)


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
