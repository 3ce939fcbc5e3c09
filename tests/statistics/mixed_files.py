"""The files that mixed scenes name: small pictures, environment maps, meshes, a lamp and places of instances."""

from __future__ import annotations

import io
import math
import struct
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
from measured_files import rgl_fields, tensor_bytes
from PIL import Image

from clrender.exporters.grid_vol import write_vol
from clrender.grids import GridData
from clrender.image.exr_write import write_exr
from clrender.image.radiance_hdr import write_hdr

__all__ = ["COLOR_PICTURES", "NUMBER_PICTURES", "SMOOTH_MESHES", "files", "written"]

COLOR_PICTURES = ("colors.png", "colors.webp", "colors.jpg", "colors.exr", "colors.hdr")
"""Pictures of colours from 0.1 to 0.9, in each format that is read."""
NUMBER_PICTURES = ("numbers.png", "alpha.png", "colors.exr")
"""Pictures whose channels serve as numbers."""
SMOOTH_MESHES = ("smooth.obj", "smooth.ply")
"""Coarse spheres of radius 1 with interpolated normals."""

_LAMP = b"IESNA:LM-63-2002\nTILT=NONE\n1 -1 683 4 2 1 2 0 0 0\n1 1 80\n0 30 60 90\n0 180\n9 8 5 0\n6 7 5 1\n"

Bytes = npt.NDArray[np.uint8]


@cache
def files() -> dict[str, bytes]:
    """All files by name.

    Returns
    -------
    dict of str to bytes
    """
    random = np.random.RandomState(39)
    colors = random.randint(30, 230, (4, 4, 3)).astype(np.uint8)
    linear = (colors / np.float32(255)).astype(np.float32)
    alpha = np.dstack([colors, np.kron([[255, 0], [128, 255]], np.ones((2, 2)))]).astype(np.uint8)
    bent = np.dstack([random.randint(88, 168, (4, 4, 2)), np.full((4, 4), 255)]).astype(np.uint8)
    around = (0.3 + random.uniform(0.0, 1.5, (8, 16, 3))).astype(np.float32)
    return {
        "colors.png": _picture(colors),
        "inverse.png": _picture(255 - colors),
        "colors.webp": _picture(colors, "WEBP", lossless=True),
        "colors.jpg": _picture(colors, "JPEG", quality=95),
        "colors.exr": _exr(linear),
        "colors.hdr": _hdr(linear),
        "numbers.png": _picture(colors[:, :, 0]),
        "alpha.png": _picture(alpha),
        "white.png": _picture(np.full((2, 2, 3), 255, np.uint8)),
        "flat.png": _picture(np.full((2, 2, 3), (128, 128, 255), np.uint8)),
        "bent.png": _picture(bent),
        "heights.png": _picture(random.randint(0, 255, (4, 4)).astype(np.uint8)),
        "around.hdr": _hdr(around),
        "around.exr": _exr(around),
        "around.png": _picture(np.kron(colors, np.ones((2, 4, 1))).astype(np.uint8)),
        "white.exr": _exr(np.ones((8, 16, 3), np.float32)),
        "lamp.ies": _LAMP,
        "smooth.obj": _obj(8, 6),
        "smooth.ply": _ply(7, 5),
        "block.stl": _stl(),
        "places.npy": _npy(),
        "paint.bsdf": tensor_bytes(rgl_fields(0.5, side=8, views=4)),
        "brushed.bsdf": tensor_bytes(rgl_fields(0.35, 5, spectral=True, side=8, views=4)),
        **_clouds(),
        **_strands(),
    }


def _clouds() -> dict[str, bytes]:
    """The same densities in two formats, of which some are 0; and shares, of one channel and of three."""
    values = np.random.RandomState(40).uniform(-0.5, 2.0, (5, 6, 7)).clip(0.0).astype(np.float32)
    file, other = io.BytesIO(), io.BytesIO()
    np.save(file, values)
    write_vol(other, GridData(values), [1.0])
    shares, colors = io.BytesIO(), io.BytesIO()
    np.save(shares, np.random.RandomState(42).uniform(0.1, 1.0, (3, 4, 2)).astype(np.float32))
    write_vol(colors, GridData(np.random.RandomState(43).uniform(0.0, 1.0, (2, 3, 4, 3)).astype(np.float32)), [1.0] * 3)
    made = {"cloud.npy": file, "cloud.vol": other, "shares.npy": shares, "shares.vol": colors}
    return {name: each.getvalue() for name, each in made.items()}


def _strands() -> dict[str, bytes]:
    """B-splines in two formats, of two and three strands."""
    dice = np.random.RandomState(41)
    rows = np.cumsum(dice.uniform(-0.5, 0.6, (3, 6, 4)), axis=1)
    rows[..., 3] = dice.uniform(0.02, 0.08, (3, 6))
    file = io.BytesIO()
    np.save(file, rows[:2].astype(np.float32))
    lines = ["\n".join(" ".join(map(repr, row)) for row in strand) for strand in rows.round(4).tolist()]
    return {"strands.npy": file.getvalue(), "strands.txt": "\n\n".join(lines).encode()}


def _picture(pixels: Bytes, name: str = "PNG", **options: object) -> bytes:
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, name, **options)
    return file.getvalue()


def _hdr(pixels: npt.NDArray[np.float32]) -> bytes:
    file = io.BytesIO()
    write_hdr(file, pixels)
    return file.getvalue()


def _exr(pixels: npt.NDArray[np.float32]) -> bytes:
    file = io.BytesIO()
    write_exr(file, pixels, {}, {})
    return file.getvalue()


def _globe(
    around: int, levels: int
) -> tuple[list[tuple[float, float, float]], list[tuple[float, float]], list[list[int]]]:
    """Points of a sphere, their texture coordinates, and faces whose fronts are outside."""
    points, uvs, faces = [], [], []
    for j in range(levels + 1):
        for i in range(around + 1):
            turn, rise = 2.0 * math.pi * (i % around) / around, math.pi * (j / levels - 0.5)
            level = 0.0 if j in (0, levels) else math.cos(rise)
            points.append((level * math.sin(turn), math.sin(rise), level * math.cos(turn)))
            uvs.append((i / around, j / levels))
    for j in range(levels):
        for i in range(around):
            a, b = j * (around + 1) + i, (j + 1) * (around + 1) + i
            faces += [[a, a + 1, b + 1]] if j > 0 else []
            faces += [[a, b + 1, b]] if j < levels - 1 else []
    return points, uvs, faces


def _obj(around: int, levels: int) -> bytes:
    points, uvs, faces = _globe(around, levels)
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in points]
    lines += [f"vn {x:.9g} {y:.9g} {z:.9g}" for x, y, z in points]
    lines += [f"vt {u:.9g} {v:.9g}" for u, v in uvs]
    lines += ["f " + " ".join(f"{k + 1}/{k + 1}/{k + 1}" for k in face) for face in faces]
    return ("\n".join(lines) + "\n").encode()


def _ply(around: int, levels: int) -> bytes:
    points, uvs, faces = _globe(around, levels)
    names = ("x", "y", "z", "nx", "ny", "nz", "u", "v", "red", "green", "blue")
    head = ["ply", "format ascii 1.0", f"element vertex {len(points)}", *(f"property float {name}" for name in names)]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    rows = [
        " ".join(f"{number:.9g}" for number in (*point, *point, *uv, 1.0 - 0.5 * uv[0], 0.5 + 0.5 * uv[1], 0.75))
        for point, uv in zip(points, uvs, strict=True)
    ]
    rows += [f"3 {a} {b} {c}" for a, b, c in faces]
    return ("\n".join([*head, *rows]) + "\n").encode()


def _stl() -> bytes:
    """A cube from -1 to 1."""
    triangles = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            corners = []
            for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                corner = [0.0, 0.0, 0.0]
                corner[axis], corner[(axis + 1) % 3], corner[(axis + 2) % 3] = side, u * side, v
                corners.append(corner)
            triangles += [[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]]
    data = bytearray(80) + struct.pack("<I", len(triangles))
    for triangle in triangles:
        data += struct.pack("<12f", 0, 0, 0, *(number for corner in triangle for number in corner)) + b"\0\0"
    return bytes(data)


def _npy() -> bytes:
    """Two transforms that mirror and stretch."""
    file = io.BytesIO()
    first = [[0.3, 0.1, 0.0, -0.7], [0.0, -0.2, 0.1, 0.6], [0.05, 0.0, 0.25, 0.5]]
    second = [[0.2, 0.0, 0.1, 0.8], [0.0, 0.3, 0.0, -0.6], [-0.1, 0.1, 0.2, 0.4]]
    np.save(file, np.array([first, second]))
    return file.getvalue()


def written(folder: Path) -> Path:
    """The folder, after writing all files into it."""
    for name, data in files().items():
        (folder / name).write_bytes(data)
    return folder
