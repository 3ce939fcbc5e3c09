"""Meshes of Mitsuba's `.serialized` files, as its scenes name them, against what was written and what Mitsuba reads."""

from __future__ import annotations

import struct
import tracemalloc
import zlib
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from cases import for_each
from serialized_files import serialized

import clrender
from clrender.errors import SceneError
from clrender.meshes.data import MeshData
from clrender.meshes.read import read_serialized_mesh
from clrender.scene import Mesh

_draw: Final = np.random.default_rng(5)
SHEET: Final[dict[str, Any]] = {
    "vertices": [[0, 0, 0], [1, 0, 0], [1, 1, 0.3], [0, 1, 0]],
    "triangles": [[0, 1, 2], [0, 2, 3]],
    "normals": [[0, 0, 1], [0, 0.1, 1], [0.1, 0, 1], [0, 0, 1]],
    "uvs": [[0.1, 0.2], [0.9, 0.2], [0.9, 0.7], [0.1, 0.7]],
    "colors": [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]],
}
MESHES: Final[list[dict[str, Any]]] = [
    SHEET,
    {key: SHEET[key] for key in ("vertices", "triangles")} | {"double": True, "name": "\u00e4 b"},
    {
        "vertices": _draw.normal(size=(300, 3)),
        "triangles": _draw.integers(0, 300, (500, 3)),
        "uvs": _draw.random((300, 2)),
        "double": True,
    },
    {key: SHEET[key] for key in ("vertices", "triangles", "normals")} | {"flags": 0x10},
]


def read(folder: Path, data: bytes, index: int = 0) -> tuple[MeshData, bool]:
    (folder / "m.serialized").write_bytes(data)
    return read_serialized_mesh("m.serialized", folder, (), "here", index)


@for_each("version", [3, 4])
@for_each("index", range(len(MESHES)))
def test_meshes(tmp_path: Path, version: int, index: int) -> None:
    mesh, faceted = read(tmp_path, serialized(MESHES, version), index)
    wanted = MESHES[index]
    kind = np.float64 if wanted.get("double") else np.float32
    np.testing.assert_array_equal(mesh.vertices, np.array(wanted["vertices"], kind))
    np.testing.assert_array_equal(mesh.triangles, wanted["triangles"])
    assert mesh.vertices.dtype == kind and faceted == (index == 3)
    assert (mesh.normals is not None) == ("normals" in wanted) and (mesh.uvs is not None) == ("uvs" in wanted)
    if mesh.normals is not None:
        np.testing.assert_array_equal(mesh.normals, np.array(wanted["normals"], kind))
    if mesh.uvs is not None:
        np.testing.assert_array_equal(mesh.uvs, np.array(wanted["uvs"]).astype(np.float32)[wanted["triangles"]])


def scene(folder: Path, index: int, more: str = "", version: str = "3.0.0") -> clrender.Scene:
    (folder / "m.serialized").write_bytes(serialized(MESHES))
    shape = (
        f'<shape type="serialized"><string name="filename" value="m.serialized"/>'
        f'<integer name="{"shape_index" if version == "3.0.0" else "shapeIndex"}" value="{index}"/>{more}</shape>'
    )
    (folder / "scene.xml").write_text(f'<scene version="{version}">{shape}{shape}</scene>')
    return clrender.load(folder / "scene.xml")


def mesh_of(loaded: clrender.Scene) -> MeshData:
    assert isinstance(loaded.shapes[0], Mesh)
    return loaded.mesh(0)


def test_scenes_name_them(tmp_path: Path) -> None:
    """Both shapes share one mesh; what the file says of flat shading counts in scenes of 0.6 only."""
    loaded = scene(tmp_path, 0)
    assert [note for note in loaded.notes if "understood" in note] == []
    assert isinstance(loaded.shapes[1], Mesh) and mesh_of(loaded) is loaded.mesh(1)
    np.testing.assert_array_equal(mesh_of(loaded).normals, np.array(SHEET["normals"], np.float32))
    flat = scene(tmp_path, 0, '<boolean name="face_normals" value="true"/>')
    assert mesh_of(flat).normals is None
    assert mesh_of(scene(tmp_path, 3)).normals is not None
    assert mesh_of(scene(tmp_path, 3, version="0.6.0")).normals is None
    assert len(mesh_of(scene(tmp_path, 2)).triangles) == 500


def test_mitsuba_reads_the_same(tmp_path: Path) -> None:
    mitsuba = pytest.importorskip("mitsuba", reason="Mitsuba is a second opinion, 100 MB that no test needs")
    mitsuba.set_variant("scalar_rgb")
    for version in (3, 4):
        (tmp_path / "m.serialized").write_bytes(serialized(MESHES, version))
        for index in range(len(MESHES)):
            theirs = mitsuba.load_dict(
                {"type": "serialized", "filename": str(tmp_path / "m.serialized"), "shape_index": index}
            )
            ours, _ = read(tmp_path, serialized(MESHES, version), index)
            found = mitsuba.traverse(theirs)
            faces = np.array(found["faces"]).reshape(-1, 3)
            np.testing.assert_array_equal(faces, ours.triangles)
            np.testing.assert_array_equal(
                np.array(found["vertex_positions"], np.float32), ours.vertices.astype(np.float32).reshape(-1)
            )
            assert theirs.has_vertex_texcoords() == (ours.uvs is not None)
            if ours.uvs is not None:
                theirs_uvs = np.array(found["vertex_texcoords"], np.float32).reshape(-1, 2)
                np.testing.assert_array_equal(theirs_uvs[faces], ours.uvs)
            if ours.normals is not None:
                normals = np.array(found["vertex_normals"]).reshape(-1, 3)
                lengths = np.linalg.norm(ours.normals, axis=1, keepdims=True)
                np.testing.assert_allclose(normals, ours.normals / lengths, atol=1e-6)


SOUND: Final = serialized([SHEET, SHEET])


def altered(**more: Any) -> bytes:
    return serialized([{**SHEET, **more}])


def raw(body: bytes, version: int = 4) -> bytes:
    return struct.pack("<HH", 0x041C, version) + zlib.compress(body) + struct.pack("<QI", 0, 1)


@for_each(
    ("data", "index", "words"),
    [
        (b"", 0, "is empty"),
        (b"\x1c", 0, "byte 0 does not begin one"),
        (b"ply\n" * 9, 0, "byte 0 does not begin one"),
        (struct.pack("<HH", 0x041C, 5) + SOUND[4:], 0, "of version 5"),
        (SOUND[:-9], 0, "it is truncated"),
        (SOUND[:-4] + struct.pack("<I", 2**32 - 1), 0, "ends in the number 4294967295"),
        (SOUND[:-4] + struct.pack("<I", 0), 0, "ends in the number 0"),
        (SOUND, 2, "holds 2 meshes, and none with the number 2"),
        (SOUND, -1, "holds 2 meshes, and none with the number -1"),
        (SOUND[:-20] + struct.pack("<QQI", 0, 2**64 - 2, 2), 1, "mesh 1 begins at byte 18446744073709551614"),
        (SOUND[:-20] + struct.pack("<QQI", 0, 1, 2), 0, "mesh 0 begins at byte 0, where it cannot"),
        (SOUND[:-20] + struct.pack("<QQI", 0, 8, 2), 1, "mesh 1 is no serialized mesh: byte 8"),
        (SOUND[:-20] + struct.pack("<QQI", 0, 40, 2), 0, "mesh 0 is truncated"),
        (SOUND[:60] + b"\xff\xff\xff" + SOUND[63:], 0, "mesh 0 is damaged"),
        (altered(triangles=[[0, 1, 2], [0, 4, 1]]), 0, "triangle 1 names vertex 4, but there are only 4"),
        (altered(flags=0x4), 0, "has the flags 0x100f"),
        (altered(flags=0x2000), 0, "has the flags 0x300b"),
        (altered(name="x" * 5000), 0, "name of more than 4096 bytes"),
        (altered(more=b"x"), 0, "holds more than it says"),
        (altered(vertices=[[0, np.nan, 0]] * 4), 0, "vertex 0 is (0, nan, 0)"),
        (altered(uvs=[[1e30, 0]] * 4), 0, "texture coordinate of size 1e+30"),
        (serialized([{"vertices": np.zeros((0, 3)), "triangles": []}]), 0, "holds 0 vertices"),
        (serialized([{"vertices": np.zeros((3, 3)), "triangles": []}]), 0, "holds 0 triangles"),
        (raw(struct.pack("<IBQQ", 0x1000, 0, 2**40, 1)), 0, "holds 1099511627776 vertices"),
        (raw(struct.pack("<IBQQ", 0x1000, 0, 2**27, 1)), 0, "is damaged: it says that its"),
        (raw(struct.pack("<IBQQ", 0x1000, 0, 3, 1)), 0, "holds less than it says"),
    ],
)
def test_faults(tmp_path: Path, data: bytes, index: int, words: str) -> None:
    with pytest.raises(SceneError) as error:
        read(tmp_path, data, index)
    message = str(error.value)
    assert message.startswith('here: "m.serialized"') and words in message and "\n" not in message, message


def test_what_is_not_finite(tmp_path: Path) -> None:
    """Also what is beyond single precision, which texture coordinates have."""
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, np.nan, 0]]
    mesh, _ = read(tmp_path, altered(vertices=points, triangles=[[0, 1, 2], [0, 2, 3]]), 0)
    assert mesh.triangles.tolist() == [[0, 1, 2]] and mesh.left_out == 1
    mesh, _ = read(tmp_path, altered(uvs=[[1e300, 0]] * 4, double=True), 0)
    assert mesh.uvs is not None and not mesh.uvs.any() and mesh.forgiven == 1


def test_bytes_behind_a_stream(tmp_path: Path) -> None:
    body = SOUND[: -(20 + (len(SOUND) - 20) // 2)]
    with pytest.raises(SceneError, match="bytes follow its zlib stream"):
        read(tmp_path, body + b"more" + struct.pack("<QI", 0, 1))


def test_a_bomb_takes_no_memory(tmp_path: Path) -> None:
    """Zeros that a thousandth of their size stands for are refused before they are inflated."""
    count = 2**24
    body = struct.pack("<IBQQ", 0x1000, 0, count, 1)
    packer = zlib.compressobj(9)
    packed = packer.compress(body) + b"".join(packer.compress(bytes(2**20)) for _ in range(12 * count >> 20))
    packed += packer.compress(bytes(12)) + packer.flush()
    data = struct.pack("<HH", 0x041C, 4) + packed + struct.pack("<QI", 0, 1)
    tracemalloc.start()
    with pytest.raises(SceneError, match="only hundredths are there"):
        read(tmp_path, data)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2**24
