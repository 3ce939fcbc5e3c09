"""PLY files, ASCII and binary: positions, normals, texture coordinates and faces of any size.

Format: G. Turk, "The PLY Polygon File Format" (1994). All that is read streams by: memory goes to the mesh alone.
"""

from __future__ import annotations

from typing import BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.scene.mesh_data import TRIANGLE_LIMIT, MeshData, crossed_warning
from clrender.scene.ply_ascii import AsciiRecords
from clrender.scene.ply_binary import BinaryRecords
from clrender.scene.ply_header import read_header
from clrender.scene.ply_records import Lists
from clrender.scene.polygons import triangulate

__all__ = ["read_ply"]

_UVS: Final = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
"""Names that programs give to texture coordinates."""


def read_ply(file: BinaryIO, size: int, label: str) -> MeshData:
    """Read a PLY file, with polygons split into triangles.

    Parameters
    ----------
    file : binary file
        At its start.
    size : int
        Bytes.
    label : str
        Start of an error message.

    Raises
    ------
    SceneError
        If it is truncated, damaged or not a mesh.
    """
    header = read_header(file, label)
    least = header.size + sum(element.least_bytes for element in header.elements)
    if header.encoding != "ascii" and size < least:
        raise SceneError(f"{label} is truncated: it has {size} bytes, but its header promises at least {least}")
    vertex, face = header.element("vertex"), header.element("face")
    assert vertex is not None and face is not None
    normal = ["nx", "ny", "nz"]
    held = {entry.name for entry in vertex.properties}
    uv = next((pair for pair in _UVS if held >= set(pair)), ())
    columns = ["x", "y", "z", *(normal if held >= set(normal) else ()), *uv]
    ascii_file = header.encoding == "ascii"
    reader = AsciiRecords(file, header, label) if ascii_file else BinaryRecords(file, header, size, label)
    table = np.empty((0, 3), np.float32)
    lists: Lists = np.empty(0, np.int64), np.empty(0, np.int64)
    for element in header.elements:
        if element is vertex:
            table = reader.columns(element, columns)
        elif element is face:
            lists = reader.lists(element)
        else:
            reader.skip(element)
    reader.end()
    return _mesh(table, *lists, columns, label)


def _mesh(
    table: NDArray[np.floating], corners: NDArray[np.int64], sizes: NDArray[np.int64], columns: list[str], label: str
) -> MeshData:
    if (sizes < 3).any():
        raise SceneError(f"{label}: face {int(np.argmax(sizes < 3))} has fewer than three vertices")
    total = len(corners) - 2 * len(sizes)
    if total > TRIANGLE_LIMIT:
        raise SceneError(f"{label} holds {total} triangles, but at most {TRIANGLE_LIMIT} are read")
    low, high = int(corners.min()), int(corners.max())
    if low < 0 or high >= len(table):
        wrong = low if low < 0 else high
        raise SceneError(f"{label} has a face that names vertex {wrong}, but only 0 to {len(table) - 1} exist")
    vertices = np.ascontiguousarray(table[:, :3])
    crossed = 0
    if (sizes > 3).any():
        triangles, crossed = triangulate(vertices, corners, sizes, label)
        corners = corners[triangles]
    normals = np.ascontiguousarray(table[:, 3:6]) if "nx" in columns else None
    faces = corners.reshape(-1, 3).astype(np.uint32)
    uvs = None
    if len(columns) not in (3, 6):
        with np.errstate(over="ignore"):  # what float32 cannot hold is infinite, and refused with its place
            uvs = table[:, -2:].astype(np.float32)[faces]
    return MeshData(vertices, faces, normals, crossed_warning(crossed), uvs)
