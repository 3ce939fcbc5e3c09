"""Exact answers, in double precision: irradiance from polygons, spheres and disks, Fresnel's equations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = [
    "Floats",
    "disk_irradiance",
    "fresnel",
    "half_space_albedo",
    "lens_share",
    "mirrored",
    "polygon_irradiance",
    "refracted_cosine",
    "solid_angle",
    "sphere_irradiance",
]

Floats = npt.NDArray[np.float64]
Vector = Sequence[float]

_NODES: Final = 400


def polygon_irradiance(vertices: Sequence[Vector], point: Vector = (0, 0, 0), normal: Vector = (0, 1, 0)) -> float:
    """Irradiance from a convex polygon of radiance 1: Lambert's formula, of the part above the horizon.

    E = 1/2 sum of theta_k (n . g_k) over the edges, theta_k the angle an edge is seen under, g_k the unit normal of the
    plane through it and the point (Lambert 1760; Arvo 1995, eq. 3.1). No matter from which side the polygon is seen.
    """
    n = np.asarray(normal, np.float64) / np.linalg.norm(normal)
    corners = [np.asarray(v, np.float64) - np.asarray(point, np.float64) for v in vertices]
    above: list[Floats] = []
    for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
        da, db = float(a @ n), float(b @ n)
        if da >= 0.0:
            above.append(a)
        if (da > 0.0) != (db > 0.0) and da != db:
            above.append(a + (b - a) * (da / (da - db)))
    total = 0.0
    for a, b in zip(above, [*above[1:], *above[:1]], strict=True):
        cross = np.cross(a, b)
        size = float(np.linalg.norm(cross))
        if size > 0.0:
            total += math.atan2(size, float(a @ b)) * float(cross @ n) / size
    return abs(total) / 2.0


def sphere_irradiance(center: Vector, radius: float, point: Vector = (0, 0, 0), normal: Vector = (0, 1, 0)) -> float:
    """Irradiance from a sphere of radiance 1: pi (r/d)^2 cos(theta), by quadrature where the horizon cuts it."""
    to = np.asarray(center, np.float64) - np.asarray(point, np.float64)
    n = np.asarray(normal, np.float64) / np.linalg.norm(normal)
    distance = float(np.linalg.norm(to))
    sine, cosine = radius / distance, float(to @ n) / distance
    if cosine >= sine:
        return math.pi * sine * sine * cosine
    # Over the cone that the sphere fills: cos(angle to n) where positive. z along the axis, phi around it.
    least = math.sqrt(1.0 - sine * sine)
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    z = least + (1.0 - least) * (nodes + 1.0) / 2.0
    phi = (np.arange(4 * _NODES) + 0.5) * (2.0 * math.pi / (4 * _NODES))
    side = math.sqrt(max(1.0 - cosine * cosine, 0.0))
    above = np.maximum(z[:, None] * cosine + np.sqrt(1.0 - z[:, None] ** 2) * side * np.cos(phi)[None, :], 0.0)
    return float((weights @ above).sum() * (1.0 - least) / 2.0 * (2.0 * math.pi / (4 * _NODES)))


def disk_irradiance(
    center: Vector, disk_normal: Vector, radius: float, point: Vector = (0, 0, 0), normal: Vector = (0, 1, 0)
) -> float:
    """Irradiance from the front of a disk of radiance 1: the polygon formula for a circle's inscribed polygons.

    Their error falls with the square of the number of corners, so two of them extrapolate (Richardson) to 1e-9.
    """
    axis = np.asarray(disk_normal, np.float64) / np.linalg.norm(disk_normal)
    u = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.9 else [0.0, 1.0, 0.0])
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)

    def polygon(corners: int) -> float:
        turn = np.arange(corners) * (2.0 * math.pi / corners)
        ring = np.asarray(center) + radius * (np.cos(turn)[:, None] * u + np.sin(turn)[:, None] * v)
        return polygon_irradiance(ring.tolist(), point, normal)

    return (4.0 * polygon(2000) - polygon(1000)) / 3.0


def mirrored(vertices: Sequence[Vector], axis: int, plane: float) -> list[list[float]]:
    """The mirror image of points in the plane where the coordinate `axis` is `plane`."""
    image = np.array(vertices, np.float64)
    image[:, axis] = 2.0 * plane - image[:, axis]
    return [[float(x) for x in row] for row in image]


def refracted_cosine(cosine: npt.ArrayLike, eta: npt.ArrayLike) -> Floats:
    """Snell: cosine beyond a surface of relative index `eta`; 0 under total reflection."""
    mu, index = np.asarray(cosine, np.float64), np.asarray(eta, np.float64)
    return np.sqrt(np.maximum(1.0 - (1.0 - mu) * (1.0 + mu) / (index * index), 0.0))


def fresnel(cosine: npt.ArrayLike, eta: npt.ArrayLike) -> Floats:
    """Share of unpolarised light that a smooth boundary reflects; 1 under total reflection."""
    mu, index = np.asarray(cosine, np.float64), np.asarray(eta, np.float64)
    beyond = refracted_cosine(mu, index)
    perpendicular = (mu - index * beyond) / (mu + index * beyond)
    parallel = (index * mu - beyond) / (index * mu + beyond)
    return np.where(beyond > 0.0, (perpendicular**2 + parallel**2) / 2.0, 1.0)


def solid_angle(vertices: Sequence[Vector], point: Vector = (0, 0, 0)) -> float:
    """Of a triangle (Van Oosterom and Strackee 1983)."""
    a, b, c = (np.asarray(v, np.float64) - np.asarray(point, np.float64) for v in vertices)
    la, lb, lc = (float(np.linalg.norm(v)) for v in (a, b, c))
    below = la * lb * lc + float(a @ b) * lc + float(a @ c) * lb + float(b @ c) * la
    return 2.0 * abs(math.atan2(float(a @ np.cross(b, c)), below))


def lens_share(x: npt.ArrayLike) -> Floats:
    """Share of a unit disk where the first coordinate is below x."""
    clipped = np.clip(np.asarray(x, np.float64), -1.0, 1.0)
    return 0.5 + (clipped * np.sqrt(1.0 - clipped**2) + np.arcsin(clipped)) / math.pi


def half_space_albedo(alpha: float) -> float:
    """Share of light, entering by the cosine, that a half-space of isotropic scattering returns.

    1 - 2 √(1 - α) ∫ H(μ) μ dμ, and ln H(μ) = -μ/π ∫ ln(1 - α t cot t) / (cos² t + μ² sin² t) dt from 0 to π/2
    (Chandrasekhar, Radiative Transfer, 1960, V).
    """
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    turn, share = (nodes + 1.0) * math.pi / 4.0, weights * math.pi / 4.0
    mu, of_mu = (nodes[:, None] + 1.0) / 2.0, weights / 2.0
    logarithm = np.log(1.0 - alpha * turn / np.tan(turn))
    h = np.exp(-mu[:, 0] / math.pi * ((share * logarithm) / (np.cos(turn) ** 2 + (mu * np.sin(turn)) ** 2)).sum(axis=1))
    return float(1.0 - 2.0 * math.sqrt(1.0 - alpha) * (of_mu * mu[:, 0] * h).sum())
