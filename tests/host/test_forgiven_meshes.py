"""Faults of PLY, STL and pbrt files that leave no doubt about the image, or for which a part is left out."""

from __future__ import annotations

import gzip
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each
from PIL import Image

import clrender
from clrender.errors import SceneError
from clrender.meshes.data import MeshData
from clrender.meshes.read import read_mesh

HEAD = b"ply\nformat %b 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
FACE = b"element face 2\nproperty list uchar int vertex_indices\nend_header\n"
POINTS = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], "<f4")
FACES = ((0, 1, 2), (0, 2, 3))
TEXT = b"0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"


def read(folder: Path, name: str, data: bytes) -> MeshData:
    (folder / name).write_bytes(data)
    return read_mesh(name, folder, (), "here")


def sound(folder: Path) -> MeshData:
    return read(folder, "sound.ply", HEAD % b"ascii" + FACE + TEXT)


def forgiven_alone(path: Path, count: int) -> None:
    """So many faults of a mesh are counted, each once, and refuse it where that is asked for."""
    assert clrender.load(path).faults == {"forgiven": count, "left_out": 0}
    if count:
        with pytest.raises(SceneError, match=rf"{path.name}: shapes\[0\]: .*; export it again$"):
            clrender.load(path, strict=True)
    else:
        clrender.load(path, strict=True)


def binary_faces() -> bytes:
    return b"".join(struct.pack("<B3i", 3, *face) for face in FACES)


# --- PLY --------------------------------------------------------------------------------------------------------------


@for_each("ending", [b"\r", b"\r\n"])
def test_lines_of_a_header_may_end_otherwise(tmp_path: Path, ending: bytes) -> None:
    wanted = sound(tmp_path).sha256()
    header = (HEAD % b"binary_little_endian" + FACE).replace(b"\n", ending)
    assert read(tmp_path, "a.ply", header + POINTS.tobytes() + binary_faces()).sha256() == wanted
    assert read(tmp_path, "b.ply", (HEAD % b"ascii" + FACE + TEXT).replace(b"\n", ending)).sha256() == wanted


def test_a_comment_without_the_word(tmp_path: Path) -> None:
    header = HEAD.replace(b"element vertex", b"Made by an old exporter\nelement vertex")
    mesh = read(tmp_path, "a.ply", header % b"ascii" + FACE + TEXT)
    assert mesh.sha256() == sound(tmp_path).sha256() and "1 line of its header is not known to PLY" in mesh.warning
    forgiven_alone(tmp_path / "a.ply", 1)
    with pytest.raises(SceneError, match="has a header line that cannot be read"):
        read(tmp_path, "b.ply", HEAD % b"ascii" + b"element face\n" + FACE + TEXT)


@for_each(
    ("strips", "wanted"),
    [
        ([[0, 1, 3, 2]], [(0, 1, 3), (1, 2, 3)]),
        ([[0, 1, 3, -1, 1, 2, 3]], [(0, 1, 3), (1, 2, 3)]),
        ([[0, 1, 3], [-1, 1, 2, 3, -1]], [(0, 1, 3), (1, 2, 3)]),
        ([[0, 1, 3, 3, 2, 1]], [(0, 1, 3), (3, 1, 2)]),
    ],
)
def test_strips_of_triangles(tmp_path: Path, strips: list[list[int]], wanted: list[tuple[int, int, int]]) -> None:
    """Every other triangle is turned; those of two equal corners only turn the next."""
    header = b"element tristrips %d\nproperty list int int vertex_indices\nend_header\n" % len(strips)
    text = TEXT[: TEXT.index(b"3 0 1 2")] + b"".join(
        b"%d %b\n" % (len(s), " ".join(map(str, s)).encode()) for s in strips
    )
    found = {
        tuple(np.roll(row, -int(np.argmin(row))))
        for row in read(tmp_path, "a.ply", HEAD % b"ascii" + header + text).triangles
    }
    assert found == {tuple(np.roll(row, -int(np.argmin(row)))) for row in np.array(wanted)}
    rows = b"".join(struct.pack(f"<i{len(s)}i", len(s), *s) for s in strips)
    mesh = read(tmp_path, "b.ply", HEAD % b"binary_little_endian" + header + POINTS.tobytes() + rows)
    assert len(mesh.triangles) == len(wanted)


def test_lists_of_vertices_are_skipped(tmp_path: Path) -> None:
    """Wherever they stand among the numbers."""
    wanted = sound(tmp_path).sha256()
    extra = HEAD.replace(
        b"property float z", b"property list ushort float descriptor\nproperty float z\nproperty uchar kind"
    )
    rows = b"".join(struct.pack(f"<2fH{i}ffB", *POINTS[i, :2], i, *range(i), 0.0, 7) for i in range(4))
    assert read(tmp_path, "a.ply", extra % b"binary_little_endian" + FACE + rows + binary_faces()).sha256() == wanted
    text = b"".join(b"%d %d %d %b 0 7\n" % (*POINTS[i, :2].astype(int), i, b"1 " * i) for i in range(4))
    assert read(tmp_path, "b.ply", extra % b"ascii" + FACE + text + TEXT[TEXT.index(b"3 0 1 2") :]).sha256() == wanted
    with pytest.raises(SceneError, match="truncated"):
        read(tmp_path, "c.ply", extra % b"binary_little_endian" + FACE + rows)


def test_a_packed_file(tmp_path: Path) -> None:
    data = HEAD % b"binary_little_endian" + FACE + POINTS.tobytes() + binary_faces()
    packed = gzip.compress(data)
    assert read(tmp_path, "a.ply.gz", packed).sha256() == sound(tmp_path).sha256()
    for broken in (packed[:-20], packed[:60] + b"xxxx" + packed[64:], b"no gzip", gzip.compress(data[:-3])):
        with pytest.raises(SceneError, match=r"a\.ply\.gz\".*(is damaged|is truncated)"):
            read(tmp_path, "a.ply.gz", broken)
    (tmp_path / "s.pbrt").write_text(f'{BEGIN}Shape "plymesh" "string filename" "b.ply.gz"\n')
    (tmp_path / "b.ply.gz").write_bytes(packed)
    assert len(clrender.load(tmp_path / "s.pbrt").shapes) == 1


@for_each("value", [b"nan", b"inf"])
def test_normals_that_are_not_finite(tmp_path: Path, value: bytes) -> None:
    head = HEAD % b"ascii" + b"property float nx\nproperty float ny\nproperty float nz\n" + FACE
    rows = b"0 0 0 0 0 1\n1 0 0 %b 0 1\n1 1 0 0 0 1\n0 1 0 0 0 1\n3 0 1 2\n3 0 2 3\n"
    mesh = read(tmp_path, "a.ply", head + rows % value)
    zero = read(tmp_path, "b.ply", head + rows.replace(b"%b 0 1", b"0 0 0"))
    assert mesh.sha256() == zero.sha256() and "1 normals are not finite" in mesh.warning
    forgiven_alone(tmp_path / "a.ply", 1)
    forgiven_alone(tmp_path / "b.ply", 0)
    (tmp_path / "s.pbrt").write_text(BEGIN + 2 * 'Shape "plymesh" "string filename" "a.ply"\n')
    forgiven_alone(tmp_path / "s.pbrt", 1)


LEFT_OUT = {"forgiven": 0, "left_out": 1}
OBJ = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv {} 1 0\nvt {} 0\nvn 0 {} 1\n"


@for_each("value", ["nan", "-nan", "inf", "-nan(ind)", "1e999"])
def test_what_is_not_finite_in_an_obj_file(tmp_path: Path, value: str) -> None:
    wanted = read(tmp_path, "w.obj", OBJ.format(0, 0, 0).encode() + b"f 1 2 3\n")
    (tmp_path / "a.obj").write_text(OBJ.format(value, 0, 0) + "f 1 5 3 4\nf 1 2 3\n")
    mesh = read_mesh("a.obj", tmp_path, (), "here")
    np.testing.assert_array_equal(mesh.vertices[mesh.triangles], wanted.vertices[wanted.triangles])
    scene = clrender.load(tmp_path / "a.obj")
    assert scene.faults == LEFT_OUT and any("line 5 has a number that is not finite" in each for each in scene.notes)
    with pytest.raises(SceneError, match="line 5 has a number that is not finite"):
        clrender.load(tmp_path / "a.obj", strict=True)
    (tmp_path / "b.obj").write_text(OBJ.format(0, value, value) + "f 1/1/1 2/1/1 3/1/1\n")
    zero = read(tmp_path, "z.obj", b"v 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvn 0 0 0\nf 1/1/1 2/1/1 3/1/1\n")
    mesh = read_mesh("b.obj", tmp_path, (), "here")
    np.testing.assert_array_equal(mesh.uvs, zero.uvs)
    assert mesh.normals is None or not mesh.normals.any()
    assert clrender.load(tmp_path / "b.obj").faults == {"forgiven": 2, "left_out": 0}
    with pytest.raises(SceneError, match='holds no face that can be drawn: line 1 has a number that is not finite: "v'):
        read(tmp_path, "c.obj", f"v {value} 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n".encode())
    with pytest.raises(SceneError, match="is not a position or normal of 3 numbers"):
        read(tmp_path, "d.obj", f"v {value} 0 none\nv 1 0 0\nv 1 1 0\nf 1 2 3\n".encode())


def test_triangles_with_a_corner_that_is_not_finite(tmp_path: Path) -> None:
    """And texture coordinates; a mesh of nothing else is refused."""
    points = POINTS.copy()
    points[3, 1] = np.nan
    face = FACE.replace(b"end_header", b"property list uchar float texcoord\nend_header")
    corners = [struct.pack("<B3iB6f", 3, *each, 6, 0, 0, 1, 0, 1, np.inf) for each in FACES]
    (tmp_path / "a.ply").write_bytes(HEAD % b"binary_little_endian" + face + points.tobytes() + b"".join(corners))
    mesh = read_mesh("a.ply", tmp_path, (), "here")
    assert mesh.triangles.tolist() == [[0, 1, 2]] and mesh.uvs is not None and mesh.uvs.shape == (1, 3, 2)
    np.testing.assert_array_equal(mesh.uvs[0], [(0, 0), (1, 0), (0, 0)])
    assert (mesh.forgiven, mesh.left_out) == (1, 1) and np.isfinite(mesh.vertices).all()
    assert clrender.load(tmp_path / "a.ply").faults == {"forgiven": 1, "left_out": 1}
    own = '[camera]\nposition = [0, 0, 3]\ntarget = [0, 0, 0]\n[[shapes]]\ntype = "mesh"\nfile = "a.ply"\n'
    (tmp_path / "own.toml").write_text(
        own + 'material = "m"\n[materials.m]\ntype = "lambert"\nreflectance = [0.5, 0.5, 0.5]\n'
    )
    with pytest.raises(SceneError, match=r'own\.toml: shapes\[0\]\.file: "a\.ply": .*left out; export it again'):
        clrender.load(tmp_path / "own.toml")
    for faces in ((FACES[1], FACES[1]), ((0, 3, 1), (3, 2, 1))):
        data = b"".join(struct.pack("<B3i", 3, *each) for each in faces)
        with pytest.raises(SceneError, match=r"vertex 3 is \(0, nan, 0\), but must be finite"):
            read(tmp_path, "b.ply", HEAD % b"binary_little_endian" + FACE + points.tobytes() + data)
    # A quad is cut along a diagonal by where its corners are
    quad = HEAD % b"ascii" + FACE.replace(b"face 2", b"face 1") + b"0 0 0\n1 0 0\n1 1 0\n0 nan 0\n4 0 1 2 3\n"
    assert 0 < len(read(tmp_path, "c.ply", quad).triangles) < 3
    stl = bytearray(binary_stl(2))
    stl[84 + 12 : 84 + 16] = struct.pack("<f", np.nan)
    assert len(read(tmp_path, "d.stl", bytes(stl)).triangles) == 1


def test_the_picture_of_a_comment(tmp_path: Path) -> None:
    """As MeshLab writes it, beside texture coordinates of corners."""
    Image.new("RGB", (2, 2), (200, 30, 30)).save(tmp_path / "a picture.png")
    face = FACE.replace(b"end_header", b"property list uchar float texcoord\nend_header")
    head = HEAD.replace(b"element vertex", b"comment TextureFile %b\nelement vertex")
    rows = TEXT.replace(b"3 0 1 2", b"3 0 1 2 6 0 0 1 0 1 1").replace(b"3 0 2 3", b"3 0 2 3 6 0 0 1 1 0 1")
    path = tmp_path / "m.ply"
    path.write_bytes(head % (b"ascii", b"a picture.png") + face + rows)
    made: Any = next(iter(clrender.load(path).materials.values()))
    assert made.reflectance.texture == "a picture.png"
    path.write_bytes(head % (b"ascii", b"none.png") + face + rows)
    assert any("none.png" in note and note.endswith(": left out") for note in clrender.load(path).notes)
    with pytest.raises(SceneError, match=r"none\.png"):
        clrender.load(path, strict=True)


# --- STL --------------------------------------------------------------------------------------------------------------

STL = (
    b"solid a\n"
    + b"".join(
        b" facet normal 0 0 1\n  outer loop\n"
        + b"".join(b"   vertex %d %d 0\n" % tuple(POINTS[i, :2].astype(int)) for i in face)
        + b"  endloop\n endfacet\n"
        for face in FACES
    )
    + b"endsolid a\n"
)


def binary_stl(count: int) -> bytes:
    facets = b"".join(struct.pack("<12fH", 0, 0, 1, *POINTS[list(face)].reshape(-1), 0) for face in FACES)
    return bytes(80) + struct.pack("<I", count) + facets


@for_each(
    ("data", "words"),
    [
        (b"\xef\xbb\xbf" + STL, ""),
        (STL.replace(b"facet normal 0 0 1", b"facet"), ""),
        (binary_stl(0), "says that it holds 0 facets, but has bytes for 2"),
        (binary_stl(3), "says that it holds 3 facets, but has bytes for 2"),
        (binary_stl(2) + b"made by hand", "says that it holds 2 facets, but has bytes for 2"),
    ],
)
def test_stl_files(tmp_path: Path, data: bytes, words: str) -> None:
    mesh, wanted = read(tmp_path, "a.stl", data), read(tmp_path, "b.stl", binary_stl(2))
    np.testing.assert_array_equal(mesh.vertices[mesh.triangles], wanted.vertices[wanted.triangles])
    assert words in mesh.warning and bool(mesh.warning) == bool(words)
    forgiven_alone(tmp_path / "a.stl", 1 if words else 0)


# --- pbrt -------------------------------------------------------------------------------------------------------------

BEGIN = 'LookAt 0 0 5 0 0 0 0 1 0\nCamera "perspective"\nWorldBegin\nLightSource "infinite"\n'
BALL = 'Shape "sphere"\n'
FLAT = 'Shape "trianglemesh" "point3 P" [0 0 0 1 0 0 2 0 0] "integer indices" [0 1 2]\n'
SQUASH = "ConcatTransform [0 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1]\n"


@for_each(
    ("more", "words"),
    [
        ("ActiveTransform All\n" + BALL, ""),
        ("ActiveTransform StartTime\nActiveTransform All\n" + BALL, ""),
        (f"AttributeBegin\n{SQUASH}AttributeEnd\n{BALL}", ""),
        (f"AttributeBegin\n{SQUASH}{BALL}AttributeEnd\n{BALL}", "line 7: the shape's transform cannot be inverted"),
        (FLAT + BALL, 'the mesh "mesh 1" has no triangle with an area'),
    ],
)
def test_pbrt_files(tmp_path: Path, more: str, words: str) -> None:
    (tmp_path / "s.pbrt").write_text(BEGIN + BALL)
    wanted = clrender.load(tmp_path / "s.pbrt")
    (tmp_path / "a.pbrt").write_text(BEGIN + more)
    scene = clrender.load(tmp_path / "a.pbrt")
    assert scene.sha256() == wanted.sha256()
    assert words in " ".join(scene.notes)
    if "inverted" in words or "area" in words:
        with pytest.raises(SceneError, match=r"cannot be inverted|no triangle with an area"):
            clrender.load(tmp_path / "a.pbrt", strict=True)


@for_each(
    "placed", ['LightSource "distant"\n', 'Shape "sphere"\nObjectBegin "a"\nObjectEnd\nCoordSysTransform "none"\n']
)
def test_what_needs_an_inverse_transform_is_refused(tmp_path: Path, placed: str) -> None:
    (tmp_path / "a.pbrt").write_text(BEGIN + SQUASH + placed)
    with pytest.raises(SceneError, match=r"line \d+: the (transform cannot be inverted|coordinate system)"):
        clrender.load(tmp_path / "a.pbrt")
