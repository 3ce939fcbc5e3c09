"""Writes Mitsuba's `.serialized` files."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

__all__ = ["serialized"]


def serialized(meshes: Sequence[Mapping[str, Any]], version: int = 4) -> bytes:
    """Such a file.

    Parameters
    ----------
    meshes : sequence of mapping
        Each has `vertices` and `triangles`, and may have `normals`, `uvs`, `colors` of the vertices, a `name`, more `flags`, whether it
        is `double`, and bytes that are written behind it (`more`).
    version : int
    """  # noqa: E501
    data, offsets = b"", []
    for mesh in meshes:
        offsets.append(len(data))
        kind = "<f8" if mesh.get("double") else "<f4"
        flags = mesh.get("flags", 0) | (0x2000 if mesh.get("double") else 0x1000)
        flags |= sum(bit for name, bit in (("normals", 1), ("uvs", 2), ("colors", 8)) if name in mesh)
        body = struct.pack("<I", flags)
        body += mesh.get("name", "mesh").encode() + b"\0" if version == 4 else b""
        body += struct.pack("<QQ", len(mesh["vertices"]), len(mesh["triangles"]))
        for name in ("vertices", "normals", "uvs", "colors"):
            body += np.asarray(mesh[name]).astype(kind).tobytes() if name in mesh else b""
        body += np.asarray(mesh["triangles"]).astype("<u4").tobytes() + mesh.get("more", b"")
        data += struct.pack("<HH", 0x041C, version) + zlib.compress(body)
    table = np.array(offsets, "<u8" if version == 4 else "<u4").tobytes()
    return data + table + struct.pack("<I", len(offsets))
