"""STL files, ASCII and binary; corners with identical bits become shared vertices.

Format: 3D Systems, "StereoLithography Interface Specification" (1989). The order of corners decides which side is
outside.
"""

from __future__ import annotations

from typing import BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.meshes.data import TRIANGLE_LIMIT, MeshData
from clrender.meshes.stl_text import read_facets
from clrender.meshes.vertex_colors import VertexColors
from clrender.wording import counted, grouped

__all__ = ["read_stl"]

_HEAD: Final = 84
_FACET: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_CHUNK: Final = 2**16


def read_stl(file: BinaryIO, size: int, label: str, colors: VertexColors | None = None) -> MeshData:
    """Read an STL file.

    Parameters
    ----------
    file : binary file
        Positioned at its start.
    size : int
        Bytes.
    label : str
        Prefix of error messages.
    colors : VertexColors, optional
        Ignored: STL has no vertex colours.

    Returns
    -------
    MeshData
        Without normals; vertices float32, or float64 for an ASCII file, in the order of their first use.

    Raises
    ------
    SceneError
        If it is truncated or damaged.
    """
    del colors
    head = file.read(_HEAD)
    count = int.from_bytes(head[80:84], "little") if len(head) == _HEAD else -1
    warnings: list[str] = []
    faults: list[str] = []
    # Some binary files begin with "solid", too; the file size tells them apart
    if size == _HEAD + 50 * count or head.removeprefix(b"\xef\xbb\xbf").lstrip()[:5].lower() != b"solid":
        points, normals = _binary(file, size, count, head, label, warnings, faults)
    else:
        file.seek(0)
        points, normals = read_facets(file, label)
    if not len(points):
        raise SceneError(f"{label} holds no facets; a mesh needs some")
    against = _against(points, normals)
    if against:
        which = "one facet has a normal" if against == 1 else f"{against} facets have normals"
        warnings.append(f"{which} against the order of the corners, which alone counts")
    vertices, triangles = _shared(points)
    return MeshData(vertices, triangles, warning="; ".join(faults + warnings), forgiven=len(faults))


def _binary(
    file: BinaryIO, size: int, count: int, head: bytes, label: str, warnings: list[str], faults: list[str]
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Corners (F, 3, 3) and normals (F, 3) of the facets."""
    if count < 0:
        raise SceneError(f"{label} is no STL file: it has {counted(size, 'byte')}, but a binary one has 84 at least")
    whole, rest = divmod(size - _HEAD, 50)
    if size != _HEAD + 50 * count and whole and (rest == 0 or count <= whole):
        # Writers that do not know the number beforehand, or add something of their own
        known = whole if count == 0 or count > whole else count
        faults.append(f"says that it holds {counted(count, 'facet')}, but has bytes for {whole}: {known} are read")
        count = known
    if count > TRIANGLE_LIMIT:
        raise SceneError(f"{label} holds {counted(count, 'triangle')}, but at most {grouped(TRIANGLE_LIMIT)} are read")
    promised = _HEAD + 50 * count
    if size < promised:
        raise SceneError(
            f"{label} is truncated: {counted(count, 'facet is', 'facets are')} {counted(promised, 'byte')}, but it "
            f"has {size}; export it again"
        )
    points, normals = np.empty((count, 3, 3), np.float32), np.empty((count, 3), np.float32)
    colored = b"COLOR=" in head[:80]
    for start in range(0, count, _CHUNK):
        rows = np.frombuffer(file.read(50 * min(_CHUNK, count - start)), _FACET)
        if len(rows) != min(_CHUNK, count - start):
            raise SceneError(f"{label} is truncated: it has become shorter while it was read")
        points[start : start + len(rows)] = rows["corners"]
        normals[start : start + len(rows)] = rows["normal"]
        colored = colored or bool(rows["attribute"].any())
    if colored:
        warnings.append("colours of its facets are not read; give the shape a material")
    return points, normals


def _against(points: NDArray[np.floating], normals: NDArray[np.floating]) -> int:
    """How many of the given normals point to the back of their facet."""
    found = 0
    for start in range(0, len(points), _CHUNK):
        corners = points[start : start + _CHUNK].astype(np.float64)
        with np.errstate(over="ignore", invalid="ignore"):  # the caller rejects coordinates out of range
            across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            found += int(np.count_nonzero((across * normals[start : start + _CHUNK]).sum(axis=1) < 0.0))
    return found


def _shared(points: NDArray[np.floating]) -> tuple[NDArray[np.floating], NDArray[np.uint32]]:
    """Vertices that are unique bit by bit, and triangles of their indices."""
    flat = np.ascontiguousarray(points.reshape(-1, 3))
    words = flat.view(np.uint32 if flat.dtype == np.float32 else np.uint64).astype(np.uint64)
    # Sort by a hash of the bits (products with odd constants), then compare the bits themselves
    key = np.zeros(len(words), np.uint64)
    for column, odd in enumerate((0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9)):
        mixed = (words[:, column] ^ key) * np.uint64(odd)
        key = mixed ^ (mixed >> np.uint64(29))
    _, first, numbers = np.unique(key, return_index=True, return_inverse=True)
    numbers = numbers.reshape(-1)
    if not np.array_equal(words[first][numbers], words):
        _, first, numbers = np.unique(words, axis=0, return_index=True, return_inverse=True)
        numbers = numbers.reshape(-1)
    order = np.argsort(first, kind="stable")
    place = np.empty(len(order), np.uint32)
    place[order] = np.arange(len(order), dtype=np.uint32)
    return flat[first[order]], place[numbers].reshape(-1, 3)
