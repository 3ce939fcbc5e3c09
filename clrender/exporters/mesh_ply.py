"""Meshes as binary PLY files that `clrender.meshes.ply` reads with the same bits."""

from __future__ import annotations

from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.meshes.data import MeshData

__all__ = ["write_ply"]

_CHUNK: Final = 2**16
_CORNERS: Final = (
    ("texcoord", "uvs", 6),
    ("texcoord_1", "uvs_1", 6),
    ("corner_colors", "colors", 9),
    ("corner_tangents", "tangents", 12),
)
"""Face lists, their arrays, and how many numbers each triangle has."""


def write_ply(file: IO[bytes], mesh: MeshData) -> None:
    """Write a mesh: positions and normals in their own precision, all else as face lists."""
    vectors = [(names, array) for names, array in (("x y z", mesh.vertices), ("nx ny nz", mesh.normals))]
    fields: list[tuple[str, Any]] = []
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(mesh.vertices)}"]
    for names, array in vectors:
        if array is not None:
            single = array.dtype.itemsize == 4
            header += [f"property {'float' if single else 'double'} {name}" for name in names.split()]
            fields.append((names, "<f4" if single else "<f8", 3))  # type: ignore[arg-type]
    header.append(f"element face {len(mesh.triangles)}")
    header.append("property list uchar uint vertex_indices")
    lists: list[tuple[str, NDArray[Any], int]] = [("vertex_indices", mesh.triangles, 3)]
    of_faces: list[Any] = [("count vertex_indices", "u1"), ("vertex_indices", "<u4", 3)]
    for name, attribute, count in _CORNERS:
        array = getattr(mesh, attribute)
        if array is not None:
            header.append(f"property list uchar float {name}")
            lists.append((name, array, count))
            of_faces += [(f"count {name}", "u1"), (name, "<f4", count)]
    file.write("\n".join([*header, "end_header\n"]).encode("ascii"))
    for start in range(0, len(mesh.vertices), _CHUNK):
        rows = np.zeros(len(mesh.vertices[start : start + _CHUNK]), np.dtype(fields))
        for names, array in vectors:
            if array is not None:
                rows[names] = array[start : start + _CHUNK]
        file.write(rows.tobytes())
    for start in range(0, len(mesh.triangles), _CHUNK):
        rows = np.zeros(len(mesh.triangles[start : start + _CHUNK]), np.dtype(of_faces))
        for name, numbers, count in lists:
            rows[f"count {name}"] = count
            rows[name] = numbers[start : start + _CHUNK].reshape(-1, count)
        file.write(rows.tobytes())
