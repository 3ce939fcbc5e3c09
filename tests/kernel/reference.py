"""What rays hit, in double precision, and how far a kernel in single precision may be from it.

The bounds follow from the kernels' arithmetic; EPS is 2^-24, one rounding, and `a` a vertex or centre relative to the
ray's origin, which the kernels round once by component.

**Triangles** (kernels/geometry/triangle.inc). The sheared vertex p = a.xy - s a.z has |error| <= EPS |a.x| (of a) + 4
EPS |s a.z| (1 of a.z, 3 of s = d.x (1/d.z)) + EPS |p|, and |s| <= 1, so at most 6 EPS R along both axes with R the
largest coordinate of the three a, and less than 9 EPS R across. The signs of the edge functions are exact, so the
kernel decides exactly about a triangle whose corners are at most `reach` = 9 EPS R out of place: it must hit where
the ray passes inside by more than that, and must miss where it passes outside by more. The depth is a mean of a.z
with weights that are off by few EPS: 12 EPS R, 4 more for the weights that the box is met with, 5 for the box itself,
at most 24 EPS R; and as the corners may be out of place by `reach`, that times the plane's slope. The depth also lies
between the corners' own.

**Spheres** (sphere.inc). The line's distance from the centre is off by EPS |a| (of a), EPS |g|, 8 EPS |a| along the
ray, which adds less than itself, and 3 EPS of both squares: `reach` = 10 EPS (|a| + r). Half the chord moves with it.
The middle is off by 9 EPS |a|; the root far from the origin of the ray by both; |a|² - r² by 6 EPS (|a|² + r²), and
the other root is that over the first one.

**Disks** (sphere.inc). a·n is off by 4 EPS Σ|aᵢ nᵢ|, d·n by 3 EPS Σ|dᵢ nᵢ|; the distance by the quotient's error, the
point by that times |d| and EPS (|a| + |p|), the comparison by 3 EPS r.

Where a ray passes a sphere or a disk closer to its rim than that, the kernel may say either, and the distance is only
known to lie in the box.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from kernel_support import Rays

__all__ = ["EPS", "Candidates", "disks", "spheres", "triangles"]

EPS = 2.0**-24

Floats = npt.NDArray[np.float64]
Masks = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Candidates:
    """Every ray against every primitive of a kind, (rays, primitives) each.

    Attributes
    ----------
    sure : bool
        The kernel has to hit it.
    possible : bool
        The kernel may hit it.
    distance, tolerance : float64
        Of the hit, in multiples of the direction. Not a number where nothing is possible.
    low, high : float64
        The distance has to be within these, tolerance or not.
    loose : bool
        Only `low` and `high` count.
    """

    sure: Masks
    possible: Masks
    distance: Floats
    tolerance: Floats
    low: Floats
    high: Floats
    loose: Masks


def _relative(points: npt.NDArray[np.float32], rays: Rays) -> Floats:
    return points[None].astype(np.float64) - rays.origins[:, None].astype(np.float64)


def triangles(rays: Rays, corners: npt.NDArray[np.float32]) -> Candidates:
    """Candidates of (t, 3, 3) triangles."""
    d = rays.directions.astype(np.float64)
    size = np.abs(d)
    main = np.where((size[:, 0] > size[:, 1]) & (size[:, 0] > size[:, 2]), 0, np.where(size[:, 1] > size[:, 2], 1, 2))
    turn = (main[:, None] + [1, 2, 0]) % 3
    d = np.take_along_axis(d, turn, 1)
    turned = [np.take_along_axis(_relative(corners[:, k], rays), turn[:, None], 2) for k in range(3)]
    far = np.max([np.abs(a).max(2) for a in turned], axis=0)
    depth = np.stack([a[..., 2] for a in turned])
    with np.errstate(all="ignore"):
        flat = [a[..., :2] - a[..., 2:] * (d[:, :2] / d[:, 2:])[:, None] for a in turned]
        p, q, r = flat
        u, v, w = (_cross(a, b) for a, b in ((r, q), (p, r), (q, p)))
        area = u + v + w
        inside = ((np.minimum(np.minimum(u, v), w) >= 0) | (np.maximum(np.maximum(u, v), w) <= 0)) & (area != 0)
        edge = np.minimum(np.minimum(_to_segment(p, q), _to_segment(q, r)), _to_segment(r, p))
        z = (u * depth[0] + v * depth[1] + w * depth[2]) / area
        slope_vector = (depth[1] - depth[0])[..., None] * (r - p) - (depth[2] - depth[0])[..., None] * (q - p)
        slope = np.linalg.norm(slope_vector, axis=-1) / np.abs(area)
        reach, rounding = 9 * EPS * far, 24 * EPS * far
        per = np.abs(d[:, 2:])
        forward = np.sign(d[:, 2:])
        tolerance = (rounding + reach * slope) / per
        distance = z / d[:, 2:]
        ends = np.sort(np.stack([depth.min(0) * forward, depth.max(0) * forward]), axis=0)
        low, high = (ends[0] - rounding) / per, (ends[1] + rounding) / per
        sure = inside & (edge > reach) & (distance > tolerance)
    possible = (inside | (edge <= reach)) & (high > 0)
    loose = ~np.isfinite(distance) | ~np.isfinite(tolerance)
    return Candidates(sure, possible, distance, tolerance, low, high, loose)


def _cross(a: Floats, b: Floats) -> Floats:
    result: Floats = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return result


def _to_segment(p: Floats, q: Floats) -> Floats:
    """Distance of the origin from a segment."""
    along = q - p
    length2 = (along**2).sum(-1)
    t = np.clip(-(p * along).sum(-1) / np.where(length2 > 0, length2, 1.0), 0.0, 1.0)
    result: Floats = np.linalg.norm(p + t[..., None] * along, axis=-1)
    return result


def _in_box(rays: Rays, center: Floats, radius: Floats, slack: Floats) -> tuple[Floats, Floats]:
    """Distances at which a ray enters and leaves the cube around a sphere, made larger by `slack`."""
    d = rays.directions.astype(np.float64)[:, None]
    half = (radius * (1 + 4e-6) + slack + 4 * EPS * np.abs(center).max(-1))[..., None]
    with np.errstate(all="ignore"):
        a, b = (_relative(center.astype(np.float32), rays) + s * half for s in (-1, 1))
        enter, leave = np.minimum(a / d, b / d), np.maximum(a / d, b / d)
    enter, leave = np.where(d == 0, -np.inf, enter), np.where(d == 0, np.inf, leave)
    return enter.max(-1) - np.abs(enter.max(-1)) * 4e-6, leave.min(-1) + np.abs(leave.min(-1)) * 4e-6


def spheres(rays: Rays, rounds: npt.NDArray[np.void]) -> Candidates:
    """Candidates of spheres."""
    place, r = rounds["center_radius"][:, :3], rounds["center_radius"][:, 3].astype(np.float64)[None]
    d = rays.directions.astype(np.float64)
    length = np.linalg.norm(d, axis=1)[:, None]
    to = _relative(place, rays)
    off = np.linalg.norm(to, axis=2)
    unit = (d / length)[:, None]
    middle = (to * unit).sum(2)
    b = np.linalg.norm(np.cross(to, unit), axis=2)
    reach = 10 * EPS * (off + r)

    def half_chord(beside: Floats) -> Floats:
        result: Floats = np.sqrt(np.maximum(r**2 - beside**2, 0.0))
        return result

    h = half_chord(b)
    h_error = np.maximum(half_chord(np.maximum(b - reach, 0)) - h, h - half_chord(b + reach))
    outside, outside_error = off**2 - r**2, 6 * EPS * (off**2 + r**2)
    first = np.where(middle >= 0, middle + h, middle - h)
    first_error = h_error + 9 * EPS * off + 4 * EPS * r + 6 * EPS * np.abs(first)
    with np.errstate(all="ignore"):
        other = outside / first
        other_error = outside_error / np.abs(first) + np.abs(other) * (first_error / np.abs(first) + 10 * EPS)
    ahead, within = outside > outside_error, outside < -outside_error
    use_other = np.where(within, middle < 0, True)
    root = np.where(use_other, other, first)
    error = np.where(use_other, other_error, first_error)
    clear = np.abs(middle) > 10 * EPS * off
    sure = (b < r - reach) & (root > error) & (within | (ahead & (middle > 0) & clear))
    possible = (b <= r + reach) & ~(ahead & (middle < 0) & clear)
    low, high = _in_box(rays, place.astype(np.float64), r, reach)
    # On the rim, or with the origin on the surface, it may be either root, or be cut off by the box.
    loose = ~sure
    return Candidates(sure, possible, root / length, error / length, low, high, loose)


def disks(rays: Rays, rounds: npt.NDArray[np.void]) -> Candidates:
    """Candidates of disks."""
    place, r = rounds["center_radius"][:, :3], rounds["center_radius"][:, 3].astype(np.float64)[None]
    n = rounds["normal"][:, :3].astype(np.float64)[None]
    d = rays.directions.astype(np.float64)[:, None]
    length = np.linalg.norm(d, axis=2)
    to = _relative(place, rays)
    off = np.linalg.norm(to, axis=2)
    with np.errstate(all="ignore"):
        slope, slope_error = (d * n).sum(2), 3 * EPS * np.abs(d * n).sum(2)
        distance = (to * n).sum(2) / slope
        error = 4 * EPS * np.abs(to * n).sum(2) + np.abs(distance) * slope_error
        room = np.abs(slope) - slope_error
        error = np.where(room > 0, error / room, np.inf) + EPS * np.abs(distance)
        point = np.linalg.norm(distance[..., None] * d - to, axis=2)
        reach = error * length + EPS * (off + point) + 3 * EPS * r
        sure = (point < r - reach) & (distance > error)
        possible = (point <= r + reach) | ~np.isfinite(reach)
    low, high = _in_box(rays, place.astype(np.float64), r, np.where(np.isfinite(reach), np.minimum(reach, r), r))
    return Candidates(sure, possible & (high > 0), distance, error, low, high, ~sure)
