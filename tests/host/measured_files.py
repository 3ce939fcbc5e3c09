"""Files of measured reflectance of known surfaces, written by the specifications of the RGL and MERL databases."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_KINDS = {"u1": 1, "<f4": 10, "<f8": 11}
_SCALES = (1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0)


def write_tensors(path: Path, fields: Mapping[str, NDArray[Any]]) -> Path:
    """Write a file of named arrays."""
    path.write_bytes(tensor_bytes(fields))
    return path


def tensor_bytes(fields: Mapping[str, NDArray[Any]]) -> bytes:
    """A file of named arrays, each at a multiple of eight bytes."""
    names = {name: name.encode() for name in fields}
    at = 12 + 2 + 4 + sum(2 + len(names[n]) + 2 + 1 + 8 + 8 * a.ndim for n, a in fields.items())
    head, body = b"tensor_file\0" + struct.pack("<BBI", 1, 0, len(fields)), b""
    for name, array in fields.items():
        body += b"\0" * (-(at + len(body)) % 8)
        kind = _KINDS[array.dtype.newbyteorder("<").str if array.dtype.itemsize > 1 else "u1"]
        head += struct.pack("<H", len(names[name])) + names[name]
        head += struct.pack("<HBQ", array.ndim, kind, at + len(body)) + struct.pack(f"<{array.ndim}Q", *array.shape)
        body += np.ascontiguousarray(array).tobytes()
    return head + body


def rgl_fields(
    alpha: float = 0.4, phis: int = 1, spectral: bool = False, side: int = 32, views: int = 8
) -> dict[str, NDArray[Any]]:
    """Tables of a rough surface: GGX facets, twice as rough across if there are several azimuths, of a warm colour."""
    theta = np.linspace(0.0, np.pi / 2.0, views)
    phi = np.zeros(1) if phis == 1 else np.linspace(-np.pi, np.pi, phis)
    square = np.linspace(0.0, 1.0, side)
    x, y = np.meshgrid(square, square)
    across = alpha if phis == 1 else 2.0 * alpha
    normals = _half_vectors(x, y)
    facets = _ggx(normals, alpha, across)
    wo = np.stack([_direction(t, p) for p in phi for t in theta]).reshape(len(phi), len(theta), 3)
    projected = np.array([[_projected(_direction(u * u * np.pi / 2.0, (2.0 * v - 1.0) * np.pi), alpha, across)
                           for u in square] for v in square])  # fmt: skip
    toward = np.maximum(np.einsum("ptk,yxk->ptyx", wo, normals), 0.0)
    area = x * np.sqrt(1.0 - normals[..., 2] ** 2)
    vndf = toward * facets * area
    vndf += 1e-4 * vndf.mean(axis=(2, 3), keepdims=True)
    shape = np.broadcast_shapes(vndf.shape)
    level = 0.3 + 0.5 * x * (1.0 - 0.3 * np.cos(2.0 * np.pi * y))
    gray = np.broadcast_to(level * (1.0 - 0.2 * np.linspace(0, 1, len(theta))[None, :, None, None]), shape)
    fields = {
        "description": np.frombuffer(b"a rough surface", np.uint8),
        "theta_i": theta.astype(np.float32),
        "phi_i": phi.astype(np.float32),
        "ndf": facets.astype(np.float32),
        "sigma": projected.astype(np.float32),
        "vndf": vndf.astype(np.float32),
        "luminance": gray.astype(np.float32),
        "jacobian": np.ones(1, np.uint8),
    }
    if spectral:
        wavelengths = np.linspace(360.0, 830.0, 48)
        warm = 0.4 + 0.5 * (wavelengths - 360.0) / 470.0
        fields["wavelengths"] = wavelengths.astype(np.float32)
        fields["spectra"] = (gray[:, :, None] * warm[None, None, :, None, None]).astype(np.float32)
    else:
        fields["rgb"] = np.stack([gray, 0.8 * gray, 0.5 * gray], axis=2).astype(np.float32)
    return fields


def part_of(fields: Mapping[str, NDArray[Any]], azimuths: int) -> dict[str, NDArray[Any]]:
    """The first azimuths of a surface that looks the same from others."""
    seen = {"phi_i", "vndf", "luminance", "spectra", "rgb"}
    return {name: array[:azimuths] if name in seen else array for name, array in fields.items()}


def gray(fields: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The same with spectra that are constant."""
    level = fields["luminance"][:, :, None] * np.float32(0.7)
    return {**fields, "spectra": np.repeat(level, len(fields["wavelengths"]), axis=2)}


def write_merl(path: Path, reflectance: Callable[[Any, Any, Any], Any]) -> Path:
    """A file of 1/sr as a function of the half vector's polar angle, the difference's, and its turn, all radians."""
    half = (np.arange(90) + 0.5) ** 2 / 90.0**2 * np.pi / 2.0
    difference, turn = (np.arange(90) + 0.5) / 90.0 * np.pi / 2.0, (np.arange(180) + 0.5) / 180.0 * np.pi
    values = np.broadcast_to(
        reflectance(half[:, None, None, None], difference[:, None, None], turn[:, None]), (90, 90, 180, 3)
    )
    planes = np.stack([values[..., k] / _SCALES[k] for k in range(3)])
    path.write_bytes(np.array([90, 90, 180], "<i4").tobytes() + np.ascontiguousarray(planes, "<f8").tobytes())
    return path


def _direction(theta: float, phi: float) -> Floats:
    return np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])


def _half_vectors(x: Floats, y: Floats) -> Floats:
    theta, phi = x * x * np.pi / 2.0, (2.0 * y - 1.0) * np.pi
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


def _ggx(m: Floats, along: float, across: float) -> Floats:
    stretched = (m[..., 0] / along) ** 2 + (m[..., 1] / across) ** 2 + m[..., 2] ** 2
    return np.asarray(1.0 / (np.pi * along * across * stretched**2))


def _projected(w: Floats, along: float, across: float) -> float:
    """∫ D(m) (w·m)⁺ dm, in closed form (Heitz 2014)."""
    return float((w[2] + np.sqrt((along * w[0]) ** 2 + (across * w[1]) ** 2 + w[2] ** 2)) / 2.0)
