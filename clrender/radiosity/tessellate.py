"""Spheres and disks as triangles of about the size of patches."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.angles import sin_cos_degrees
from clrender.radiosity.vectors import cross, dot

__all__ = ["disk_triangles", "sphere_triangles"]

_LEAST_LEVEL: Final = 2
_MOST_LEVEL: Final = 7
_LEAST_SIDES: Final = 24
_MOST_SIDES: Final = 512

_Floats = NDArray[np.float64]


def sphere_triangles(center: _Floats, radius: float, inward: bool, size: float) -> _Floats:
    """A sphere as an icosphere of the same area: it lies outside the sphere at its corners and inside between them.

    Parameters
    ----------
    center : (3,) float64
    radius : float
    inward : bool
        The front side is inside.
    size : float
        Approximate area of a triangle.

    Returns
    -------
    (n, 3, 3) float64
        Corners, counter-clockwise seen from the front.
    """
    level, area = _LEAST_LEVEL, 4.0 * math.pi * radius * radius
    while level < _MOST_LEVEL and area / (20 * 4**level) > 1.5 * size:
        level += 1
    corners = _icosphere(level)
    triangles: _Floats = center + radius * (corners[:, ::-1] if inward else corners)
    return triangles


@lru_cache(maxsize=8)
def _icosphere(level: int) -> _Floats:
    """Icosphere of area 4 pi, (n, 3, 3), counter-clockwise seen from outside."""
    golden = (1.0 + math.sqrt(5.0)) / 2.0
    axes = [(0, 1, 2), (1, 2, 0), (2, 0, 1)]
    points = np.zeros((12, 3))
    for number, (x, y, z) in enumerate(axes):
        for k, (one, other) in enumerate(((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0))):
            points[number * 4 + k, [x, y, z]] = 0.0, one, other * golden
    edge = 2.0 + 1e-9
    faces = []
    for i in range(12):
        for j in range(i + 1, 12):
            for k in range(j + 1, 12):
                p, q, r = points[i], points[j], points[k]
                if max(_length(p - q), _length(q - r), _length(r - p)) <= edge:
                    faces.append((i, j, k) if _volume(p, q, r) > 0.0 else (i, k, j))
    corners = _on_sphere(points[np.array(faces)])
    for _ in range(level):
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        ab, bc, ca = (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        corners = _on_sphere(np.stack([np.stack(part, axis=1) for part in parts], axis=1).reshape(-1, 3, 3))
    total = float(sum(_length(cross(t[1] - t[0], t[2] - t[0])) for t in corners)) / 2.0
    grown: _Floats = corners * math.sqrt(4.0 * math.pi / total)
    return grown


def disk_triangles(center: _Floats, radius: float, normal: _Floats, size: float) -> _Floats:
    """A disk as a regular polygon of the same area, divided into sectors.

    Parameters
    ----------
    center : (3,) float64
    radius : float
    normal : (3,) float64
        Unit, on the front side.
    size : float
        Approximate area of a triangle; `Patches.bisected` divides larger ones.

    Returns
    -------
    (n, 3, 3) float64
    """
    sides = int(min(max(math.sqrt(math.pi * radius * radius / size) * 3.0, _LEAST_SIDES), _MOST_SIDES))
    corners = [sin_cos_degrees(360.0 * k / sides) for k in range(sides)]
    grown = radius * math.sqrt(2.0 * math.pi / sides / corners[1][0])
    helper = np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.5 else np.array([0.0, 1.0, 0.0])
    u = cross(normal, helper)
    u = u / _length(u)
    v = cross(normal, u)
    rim = [center + grown * (cosine * u + sine * v) for sine, cosine in corners]
    return np.array([(center, rim[k], rim[(k + 1) % sides]) for k in range(sides)])


def _on_sphere(points: _Floats) -> _Floats:
    result: _Floats = points / np.sqrt(dot(points, points))[..., None]
    return result


def _length(a: _Floats) -> float:
    return math.sqrt(float(dot(a, a)))


def _volume(a: _Floats, b: _Floats, c: _Floats) -> float:
    return float(dot(cross(a, b), c))
