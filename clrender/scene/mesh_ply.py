"""PLY files, ASCII and binary: positions, normals, texture coordinates, colours and faces of any size.

Format: G. Turk, "The PLY Polygon File Format" (1994). All that is read streams by: memory goes to the mesh alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.scene.mesh_data import TRIANGLE_LIMIT, MeshData, crossed_warning
from clrender.scene.ply_ascii import AsciiRecords
from clrender.scene.ply_binary import BinaryRecords
from clrender.scene.ply_header import Element, read_header
from clrender.scene.ply_records import Lists
from clrender.scene.polygons import triangulate
from clrender.scene.vertex_colors import VertexColors, linear_colors

__all__ = ["read_ply"]

_UVS: Final = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
"""Names that programs give to texture coordinates."""
_NORMAL: Final = ("nx", "ny", "nz")
_COLOR: Final = ("red", "green", "blue")
_LARGEST: Final = {"u1": 255.0, "u2": 65535.0, "f4": 1.0, "f8": 1.0}
"""What a colour of each type has at most."""


def read_ply(file: BinaryIO, size: int, label: str, colors: VertexColors | None = None) -> MeshData:
    """Read a PLY file, with polygons split into triangles.

    Parameters
    ----------
    file : binary file
        At its start.
    size : int
        Bytes.
    label : str
        Start of an error message.
    colors : VertexColors, optional
        Read colours of vertices, if it has any, encoded like this; auto: of whole numbers sRGB, of floats linear.

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
    held = {entry.name for entry in vertex.properties}
    uv = next((pair for pair in _UVS if held >= set(pair)), ())
    normal, color = (
        names if wanted and held >= set(names) else () for names, wanted in ((_NORMAL, True), (_COLOR, colors))
    )
    columns = ["x", "y", "z", *normal, *uv, *color]
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

    def part(names: Sequence[str]) -> NDArray[np.floating] | None:
        first = columns.index(names[0]) if names else 0
        return table[:, first : first + len(names)] if names else None

    shades = part(color)
    linear = None if shades is None or colors is None else _linear(shades, vertex, colors, label)
    return _mesh(table, *lists, part(normal), part(uv), linear, label)


def _linear(colors: NDArray[np.floating], vertex: Element, encoding: VertexColors, label: str) -> NDArray[np.float32]:
    kinds = {entry.kind for entry in vertex.properties if entry.name in _COLOR}
    kind = min(kinds)
    if len(kinds) > 1 or kind not in _LARGEST:
        raise SceneError(f"{label} has colours that are not all uchar, ushort or float; export them as uchar")
    return linear_colors(colors / _LARGEST[kind], encoding == "srgb" or (encoding == "auto" and kind[0] == "u"), label)


def _mesh(
    table: NDArray[np.floating],
    corners: NDArray[np.int64],
    sizes: NDArray[np.int64],
    normals: NDArray[np.floating] | None,
    uvs: NDArray[np.floating] | None,
    colors: NDArray[np.float32] | None,
    label: str,
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
    normals = None if normals is None else np.ascontiguousarray(normals)
    faces = corners.reshape(-1, 3).astype(np.uint32)
    with np.errstate(over="ignore"):  # what float32 cannot hold is infinite, and refused with its place
        of_corners = None if uvs is None else uvs.astype(np.float32)[faces]
    shades = None if colors is None else colors[faces]
    return MeshData(vertices, faces, normals, crossed_warning(crossed), of_corners, colors=shades)
