"""PLY files, ASCII and binary: positions, normals, texture coordinates, colours and faces of any size.

Format: G. Turk, "The PLY Polygon File Format" (1994). Files are streamed: only the mesh is held in memory.
"""

from __future__ import annotations

import gzip
import io
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.meshes.data import TRIANGLE_LIMIT, MeshData, crossed_warning
from clrender.meshes.ply_ascii import AsciiRecords
from clrender.meshes.ply_binary import BinaryRecords
from clrender.meshes.ply_header import Element, PlyHeader, Property, read_header
from clrender.meshes.ply_records import Lists
from clrender.meshes.polygons import triangulate
from clrender.meshes.vertex_colors import VertexColors, linear_colors
from clrender.wording import counted, grouped

__all__ = ["READ_OF_FACES", "READ_OF_VERTICES", "has_colors", "read_packed_ply", "read_ply"]

_UVS: Final = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
"""Names of texture coordinates in various programs."""
_NORMAL: Final = ("nx", "ny", "nz")
_COLOR: Final = ("red", "green", "blue")
_CORNERS: Final = {"texcoord": 2, "texcoord_1": 2, "corner_colors": 3, "corner_tangents": 4}
"""Lists of numbers for the corners of a face, and how many numbers each corner has. The first is MeshLab's; the others
are our own: a second set of texture coordinates, linear colours, and tangents with their handedness."""
READ_OF_VERTICES: Final = frozenset(("x", "y", "z", *_NORMAL, *_COLOR, *(name for pair in _UVS for name in pair)))
"""Vertex properties that are read."""
READ_OF_FACES: Final = frozenset(("vertex_indices", "vertex_index", *_CORNERS))
"""Face properties that are read."""
_UNPACKED_LIMIT: Final = 2**32
"""Largest file that is unpacked, bytes: it is held in memory."""
_LARGEST: Final = {"u1": 255.0, "u2": 65535.0, "f4": 1.0, "f8": 1.0}
"""Largest colour value of each type."""


def read_ply(file: BinaryIO, size: int, label: str, colors: VertexColors | None = None) -> MeshData:
    """Read a PLY file, with polygons split into triangles.

    Parameters
    ----------
    file : binary file
        Positioned at its start.
    size : int
        Bytes.
    label : str
        Prefix of error messages.
    colors : VertexColors, optional
        Also read vertex colours, if any, with this encoding; auto: integers are sRGB, floats linear.

    Raises
    ------
    SceneError
        If it is truncated, damaged or not a mesh.
    """
    header = read_header(file, label)
    least = header.size + sum(element.least_bytes for element in header.elements)
    if header.encoding != "ascii" and size < least:
        raise SceneError(
            f"{label} is truncated: it has {counted(size, 'byte')}, but its header promises at least {least}"
        )
    vertex, face = header.element("vertex"), header.surface
    assert vertex is not None and face is not None
    held = {entry.name for entry in vertex.properties if not entry.count_kind}
    uv = next((pair for pair in _UVS if held >= set(pair)), ())
    normal, color = (
        names if wanted and held >= set(names) else () for names, wanted in ((_NORMAL, True), (_COLOR, colors))
    )
    columns = ["x", "y", "z", *normal, *uv, *color]
    ascii_file = header.encoding == "ascii"
    reader = AsciiRecords(file, header, label) if ascii_file else BinaryRecords(file, header, size, label)
    table = np.empty((0, 3), np.float32)
    index = face.index_list
    assert index is not None
    strips = face.name == "tristrips"
    wanted = [entry for entry in face.lists if _of_corners(entry, colors is not None) and not strips]
    lists: list[Lists] = []
    for element in header.elements:
        if element is vertex:
            table = reader.columns(element, columns)
        elif element is face:
            lists = reader.lists(element, [index, *wanted])
        else:
            reader.skip(element)
    reader.end()

    def part(names: Sequence[str]) -> NDArray[np.floating] | None:
        first = columns.index(names[0]) if names else 0
        return table[:, first : first + len(names)] if names else None

    shades = part(color)
    linear = None if shades is None or colors is None else _linear(shades, vertex, colors, label)
    corners = {entry.name: found for entry, found in zip(wanted, lists[1:], strict=True)}
    indices, sizes = _of_strips(*lists[0]) if strips else lists[0]
    mesh = _mesh(table, indices, sizes, part(normal), part(uv), linear, corners, label)
    if header.unknown:
        text = (
            f"{counted(header.unknown, 'line of its header is', 'lines of its header are')} not known to PLY, "
            "and not read"
        )
        mesh = replace(mesh, warning="; ".join(each for each in (text, mesh.warning) if each), forgiven=1)
    return mesh


def read_packed_ply(file: BinaryIO, size: int, label: str, colors: VertexColors | None = None) -> MeshData:
    """Read a PLY file that gzip packed; for the parameters see `read_ply`.

    Raises
    ------
    SceneError
        If it is damaged, or unpacked larger than mesh files may be.
    """
    try:
        with gzip.GzipFile(fileobj=file) as packed:
            data = packed.read(_UNPACKED_LIMIT + 1)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise SceneError(f"{label} is damaged: {error}; pack it again") from None
    if len(data) > _UNPACKED_LIMIT:
        raise SceneError(f"{label} has more than {counted(_UNPACKED_LIMIT, 'byte')} when unpacked; unpack and split it")
    return read_ply(io.BytesIO(data), len(data), label, colors)


def _of_strips(entries: NDArray[np.int64], sizes: NDArray[np.int64]) -> Lists:
    """Triangles of strips, which -1 separates within a list: every other one is turned."""
    ends = np.cumsum(sizes)[:-1]
    # A separator between lists as well; then three entries in a row without one are a triangle
    joined = np.insert(entries, ends, -1)
    place = np.arange(len(joined))
    began = np.maximum.accumulate(np.where(joined < 0, place + 1, 0)) if len(joined) else place
    a, b, c = joined[:-2], joined[1:-1], joined[2:]
    whole = (a >= 0) & (b >= 0) & (c >= 0) & (a != b) & (b != c) & (a != c)
    odd = ((place - began)[:-2] % 2 == 1)[:, None]
    triangles = np.where(odd, np.stack([a, c, b], axis=1), np.stack([a, b, c], axis=1))[whole]
    return triangles.reshape(-1), np.full(len(triangles), 3, np.int64)


def has_colors(header: PlyHeader) -> bool:
    """Whether the vertices, or the corners of faces, have colours."""
    vertex, face = header.element("vertex"), header.surface
    names = set() if vertex is None else {entry.name for entry in vertex.properties}
    return names >= set(_COLOR) or any(entry.name == "corner_colors" for entry in (face.lists if face else ()))


def _of_corners(entry: Property, colors: bool) -> bool:
    return entry.name in _CORNERS and entry.kind[0] == "f" and (colors or entry.name != "corner_colors")


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
    of_corners: Mapping[str, Lists],
    label: str,
) -> MeshData:
    if not len(sizes):
        raise SceneError(f"{label} has no face element with anything in it; a mesh needs vertices and faces")
    if (sizes < 3).any():
        raise SceneError(f"{label}: face {int(np.argmax(sizes < 3))} has fewer than three vertices")
    total = len(corners) - 2 * len(sizes)
    if total > TRIANGLE_LIMIT:
        raise SceneError(f"{label} holds {counted(total, 'triangle')}, but at most {grouped(TRIANGLE_LIMIT)} are read")
    low, high = int(corners.min()), int(corners.max())
    if low < 0 or high >= len(table):
        wrong = low if low < 0 else high
        raise SceneError(f"{label} has a face that names vertex {wrong}, but only 0 to {len(table) - 1} exist")
    vertices = np.ascontiguousarray(table[:, :3])
    places, crossed = None, 0
    if (sizes > 3).any():
        places, crossed = triangulate(vertices, corners, sizes, label)
    normals = None if normals is None else np.ascontiguousarray(normals)
    with np.errstate(over="ignore"):  # values too large for float32 become infinite and are rejected later
        by_name = {"texcoord": None if uvs is None else uvs.astype(np.float32)[corners]}
    shades = None if colors is None else colors[corners]
    by_name |= {"texcoord_1": None, "corner_colors": shades, "corner_tangents": None}
    warnings = [crossed_warning(crossed)]
    for name, (entries, counts) in of_corners.items():
        found, warning = _corner_table(name, entries, counts, sizes, label)
        warnings.append(warning)
        by_name[name] = by_name[name] if found is None else found
    faces = corners.reshape(-1, 3) if places is None else corners[places]
    uvs, uvs_1, shades, tangents = (
        None if each is None else each.reshape(-1, 3, each.shape[1]) if places is None else each[places]
        for each in by_name.values()
    )
    text = "; ".join(each for each in warnings if each)
    return MeshData(vertices, faces.astype(np.uint32), normals, text, uvs, uvs_1, shades, tangents)


def _corner_table(
    name: str, entries: NDArray[np.floating], counts: NDArray[np.int64], sizes: NDArray[np.int64], label: str
) -> tuple[NDArray[np.float32] | None, str]:
    """Numbers of all corners, (C, 2 or 3), from face lists, or None if no face has them; and a warning."""
    width = _CORNERS[name]
    with np.errstate(over="ignore"):
        values = entries.astype(np.float32)
    held = counts == width * sizes
    if not held.any():
        return None, f"lists {name} of its faces have not {width} numbers for each corner, and are not read"
    if name == "corner_colors" and not ((values >= 0.0) & (values <= 1.0)).all():
        raise SceneError(f"{label} has colours of corners that are not from 0 to 1; export it again")
    if held.all():
        return values.reshape(-1, width), ""
    table = np.zeros((int(sizes.sum()), width), np.float32)
    table[np.repeat(held, sizes)] = values[np.repeat(held, counts)].reshape(-1, width)
    return (
        table,
        f"{counted(int((~held).sum()), 'face has', 'faces have')} no list {name} of {counted(width, 'number')} for "
        "each corner, and got zeros",
    )
