"""PLY and STL files as scenes, and STL meshes that scenes name."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from cases import for_each

import clrender
from clrender.errors import SceneError
from clrender.flatten.flat_scene import flatten
from clrender.meshes.data import MeshData
from clrender.meshes.read import read_mesh
from clrender.scene import Mesh, Scene

CUBE = np.array([[x, y, z] for x in (0.0, 0.1) for y in (0.0, 1 / 3) for z in (-0.0, 1e-5)], np.float32)
TRIANGLES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]])


def ascii_stl(points: np.ndarray, triangles: np.ndarray) -> str:
    facets = ""
    for triangle in triangles:
        lines = "".join(f"      vertex {' '.join(f'{float(x)!r}' for x in points[i])}\n" for i in triangle)
        facets += f"  facet normal 0 0 0\n    outer loop\n{lines}    endloop\n  endfacet\n"
    return f"solid a cube\n{facets}endsolid a cube\n"


def binary_stl(points: np.ndarray, triangles: np.ndarray, head: bytes = b"", attribute: int = 0) -> bytes:
    facets = b"".join(struct.pack("<12fH", 0, 0, 0, *points[t].ravel().tolist(), attribute) for t in triangles)
    return head.ljust(80) + struct.pack("<I", len(triangles)) + facets


def read(folder: Path, data: str | bytes, name: str = "m.stl") -> MeshData:
    (folder / name).write_bytes(data if isinstance(data, bytes) else data.encode())
    return read_mesh(name, folder, (), "here")


# --- STL --------------------------------------------------------------------------------------------------------------


@for_each(
    "data",
    [
        binary_stl(CUBE, TRIANGLES),
        binary_stl(CUBE, TRIANGLES, b"solid but binary"),
        ascii_stl(CUBE, TRIANGLES),
        ascii_stl(CUBE, TRIANGLES).upper().replace("E-", "e-"),
        ascii_stl(CUBE, TRIANGLES).replace("\n", "\r\n"),
        ascii_stl(CUBE, TRIANGLES).replace("solid a cube", "solid facet normal 1 2 3"),
        "solid\nendsolid\n" + ascii_stl(CUBE, TRIANGLES),
        ascii_stl(CUBE, TRIANGLES).replace("normal 0 0 0", "normal nan -nan 0"),
    ],
)
def test_stl(tmp_path: Path, data: str | bytes) -> None:
    mesh = read(tmp_path, data)
    np.testing.assert_array_equal(mesh.vertices[mesh.triangles].astype(np.float32), CUBE[TRIANGLES])
    assert len(mesh.vertices) == 8 and mesh.normals is None and mesh.warning == ""


def test_stl_shares_vertices_of_equal_bits_only(tmp_path: Path) -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-0.0, 0, 0], [1, 0, 0], [0, -1, 0]], np.float32)
    mesh = read(tmp_path, binary_stl(points, np.array([[0, 1, 2], [3, 4, 5]])))
    assert len(mesh.vertices) == 5 and mesh.triangles.tolist() == [[0, 1, 2], [3, 1, 4]]
    assert np.signbit(mesh.vertices[3, 0]) and not np.signbit(mesh.vertices[0, 0])


def test_stl_of_many_facets(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    points = rng.normal(size=(50_000, 3)).astype(np.float32)
    triangles = rng.integers(0, len(points), (100_000, 3))
    mesh = read(tmp_path, binary_stl(points, triangles))
    np.testing.assert_array_equal(mesh.vertices[mesh.triangles], points[triangles])
    assert len(mesh.vertices) == len(np.unique(triangles))
    text = read(tmp_path, ascii_stl(points, triangles[:20_000]), "t.stl")
    np.testing.assert_array_equal(text.vertices[text.triangles], points[triangles[:20_000]])


def test_stl_colours_and_normals_are_told(tmp_path: Path) -> None:
    for data in (binary_stl(CUBE, TRIANGLES, attribute=0x8123), binary_stl(CUBE, TRIANGLES, b"x COLOR=abcd")):
        assert read(tmp_path, data).warning == "colours of its facets are not read; give the shape a material"
    turned = ascii_stl(CUBE, TRIANGLES).replace("normal 0 0 0", "normal 1 0 0", 1)
    assert read(tmp_path, turned).warning.startswith("one facet has a normal against the order")


@for_each(
    ("data", "expected"),
    [
        (binary_stl(CUBE, TRIANGLES)[:-1], "is truncated: 6 facets are 384 bytes, but it has 383"),
        (b"x" * 20, "is no STL file: it has 20 bytes"),
        (binary_stl(CUBE, TRIANGLES[:0]), "holds no facets"),
        (b"solid x\nendsolid x\n".ljust(90), "holds no facets"),
        (binary_stl(np.full_like(CUBE, np.inf), TRIANGLES[2:3]), "must be finite"),
        (ascii_stl(CUBE, TRIANGLES).replace("endloop", "endlop", 2).encode(), 'line 7 has "endlop" where endloop must'),
        (
            ascii_stl(CUBE, TRIANGLES).replace("vertex 0.0", "vertex x", 1).encode(),
            'line 4 has "x" where a number must',
        ),
        (ascii_stl(CUBE, TRIANGLES)[:-40].encode(), "the file ends within a facet"),
        (ascii_stl(CUBE, TRIANGLES * 0).replace("0.0", "1e999").encode(), 'has "1e999" where a number must stand'),
        (b"", "is empty"),
    ],
)
def test_stl_that_is_refused(tmp_path: Path, data: bytes, expected: str) -> None:
    with pytest.raises(SceneError) as error:
        read(tmp_path, data)
    assert expected in str(error.value) and "\n" not in str(error.value), str(error.value)


def test_stl_as_scene_and_in_one(tmp_path: Path) -> None:
    (tmp_path / "m.STL").write_bytes(binary_stl(CUBE, TRIANGLES))
    scene = clrender.load(tmp_path / "m.STL")
    assert flatten(scene, 8, 8).triangle_count == 6 and any("no camera" in note for note in scene.notes)
    named = Scene(camera={"position": (0, 0, 5), "target": (0, 0, 0)}, shapes=({"type": "mesh", "file": "m.STL"},))
    assert flatten(named.placed("s", tmp_path), 8, 8).triangle_count == 6


# --- PLY --------------------------------------------------------------------------------------------------------------

HEAD = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n{}"
POINTS = ["0 0 0", "1 0 0", "1 1 0", "0 1 0"]


def ply(folder: Path, vertex: str, values: list[str], face: str, faces: list[str], more: str = "") -> Scene:
    head = HEAD.format(vertex) + f"element face {len(faces)}\nproperty list uchar int vertex_indices\n{face}{more}"
    rows = [f"{point} {value}" for point, value in zip(POINTS, values, strict=True)]
    (folder / "m.ply").write_text("\n".join([head + "end_header", *rows, *faces, ""]))
    return clrender.load(folder / "m.ply")


def test_ply_colours_of_vertices(tmp_path: Path) -> None:
    kinds = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    scene = ply(tmp_path, kinds, ["255 0 0", "0 255 0", "0 0 255", "0 0 0"], "", ["4 0 1 2 3"])
    shape, mesh = scene.shapes[0], scene.mesh(0)
    assert isinstance(shape, Mesh) and shape.vertex_colors == "auto" and mesh.colors is not None
    np.testing.assert_array_equal(mesh.colors[0], np.eye(3))
    assert next(iter(scene.materials.values())).reflectance == (1, 1, 1)  # type: ignore[union-attr]


def test_ply_corners_of_faces(tmp_path: Path) -> None:
    lists = "".join(f"property list uchar float {name}\n" for name in ("texcoord", "texcoord_1", "corner_colors"))
    face = "4 0 1 2 3 8 0 0 1 0 1 1 0 1 8 5 5 6 5 6 6 5 6 12 1 0 0 0 1 0 0 0 1 .5 .5 .5"
    mesh = ply(tmp_path, "", [""] * 4, lists, [face]).mesh(0)
    assert mesh.uvs is not None and mesh.uvs_1 is not None and mesh.colors is not None
    assert mesh.uvs.tolist() == [[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]]
    assert (mesh.uvs_1 - 5).tolist() == mesh.uvs.tolist()
    assert mesh.colors.tolist() == [[[1, 0, 0], [0, 1, 0], [0, 0, 1]], [[1, 0, 0], [0, 0, 1], [0.5, 0.5, 0.5]]]


def test_ply_faces_without_their_lists(tmp_path: Path) -> None:
    lists = "property list uchar float texcoord\n"
    some = ply(tmp_path, "", [""] * 4, lists, ["3 0 1 2 6 0 0 1 0 1 1", "3 0 2 3 0"]).mesh(0)
    assert some.uvs is not None and not some.uvs[1].any() and "1 face has no list texcoord" in some.warning
    none = ply(tmp_path, "", [""] * 4, lists, ["3 0 1 2 2 0 0", "3 0 2 3 0"]).mesh(0)
    assert none.uvs is None and "lists texcoord of its faces have not 2 numbers" in none.warning


def test_ply_names_what_it_leaves_out(tmp_path: Path) -> None:
    scene = ply(
        tmp_path,
        "property uchar alpha\n",
        ["9"] * 4,
        "property uchar red\n",
        ["3 0 1 2 9"],
        "element edge 0\nproperty int a\n",
    )
    said = "\n".join(scene.notes)
    for expected in ('of its vertices "alpha" is not read', 'of its faces "red" is not read', 'element "edge" is not'):
        assert expected in said


@for_each("ending", [".obj", ".ply", ".stl"])
@for_each("data", [b"", b"\0" * 100, b"\xff\xfe" + b"a" * 100])
def test_files_that_are_none(tmp_path: Path, ending: str, data: bytes) -> None:
    path = tmp_path / f"m{ending}"
    path.write_bytes(data)
    with pytest.raises(SceneError, match=path.name):
        clrender.load(path)
    with pytest.raises(SceneError, match="does not exist"):
        clrender.load(tmp_path / f"none{ending}")


# --- up ---------------------------------------------------------------------------------------------------------------


def test_the_upward_axis_of_models(tmp_path: Path) -> None:
    """That of STL is z unless told otherwise; camera and light turn with it, the model stays as it is."""
    (tmp_path / "m.stl").write_bytes(binary_stl(CUBE, TRIANGLES))
    path = tmp_path / "m.stl"
    above, level = clrender.load(path), clrender.load(path, up="y")
    assert above.camera.up == (0.0, 0.0, 1.0) and level.camera.up == (0.0, 1.0, 0.0)
    assert clrender.load(path, up="z").sha256() == above.sha256() != level.sha256()
    ways = [np.subtract(each.camera.position, each.camera.target) for each in (above, level)]
    (x, y, z), other = (way / np.linalg.norm(way) for way in ways)  # as far away as each view of it needs
    np.testing.assert_allclose((x, z, -y), other, rtol=1e-12)
    first, second = (each.environment_picture() for each in (above, level))
    assert first is not None and second is not None
    # At +y is the first row, +z is the middle column
    assert abs(first.pixels[31:33, 63:65].mean() - second.pixels[0].mean()) < 0.02
    below = (first.pixels[31:33, [0, -1]].mean(), second.pixels[-1].mean())
    assert abs(below[0] - below[1]) < 0.02 and second.pixels[0].mean() > below[1] + 0.2
    assert any("z is up" in note for note in above.notes) and not any("is up" in note for note in level.notes)
    with pytest.raises(SceneError, match=r"takes no up, which is for \.obj and \.ply and \.stl"):
        clrender.load("room", up="z")
    with pytest.raises(SceneError, match="up is 'x'; it must be y or z"):
        clrender.load(path, up="x")
