"""What rays hit, in double precision, and how far a kernel in single precision may be from it.

The bounds follow from the kernels' arithmetic; EPS is 2^-24, one rounding, and `a` a vertex or centre relative to the
ray's origin, which the kernels round once by component.

**Triangles** (kernels/geometry/triangle.inc). With s = |a|_1, m the largest component of the direction, e the largest
one of the edges: the weights are off by less than 10 EPS m e (s + 6 e) and the determinant's error, and the kernel
allows for that much, so it must hit where the exact weights are not negative, and must miss where one is below twice
that. A component of the normal is off by 2 EPS of its own and by what rounding took from one edge, times the other,
twice; the determinant by the sum of that over the components and 3 EPS of their magnitudes, times m; the distance times
the determinant by the normal's error times s, and 4 EPS of its terms. Where the determinant is twice its error or less,
give or take, the triangle is seen edge-on and is not there; beside the triangle, the distance may be that of the box.

Triangles 2k and 2k + 1 that are a parallelogram but for a gap of 8 EPS of the largest coordinate are tested as one, of
the edges AB and AD: the gap moves weights and determinant by 2 m e gap and the plane by the gap, and which of the two
is hit is told by a difference of two weights.

Those that are a rectangle square to an axis are tested as that (rectangle.inc): the distance is off by 3 EPS of its
own, the place along a side by 5 EPS (|a| + half the side), and by EPS of the centre's coordinate, to which half the
side is rounded up; a ray that passes beside it by twice that may hit. There is no edge-on: of a ray across the axis
the distance is that of the plane.

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
    d = rays.directions.astype(np.float64)[:, None]
    corners = _turned(corners)
    vertices = corners.astype(np.float64)
    ab, ac = vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0]
    normal = np.cross(ab, ac)
    to = _relative(corners[:, 0], rays)
    away, main = np.abs(to).sum(2), np.abs(d).max(2)
    across = np.cross(to, d)
    determinant = (normal * d).sum(2)
    sign = np.where(determinant < 0, -1.0, 1.0)
    b, c = (across * ac).sum(2) * sign, -(across * ab).sum(2) * sign
    rest = np.abs(determinant) - b - c

    ab, ac, gap = _tested(vertices)
    size_ab, size_ac = np.abs(ab).max(1), np.abs(ac).max(1)
    lost = [np.abs(edge - edge.astype(np.float32)).max(1) for edge in (ab, ac)]
    edges = 2 * (lost[0] * size_ac + lost[1] * size_ab)
    unsure = (3 * edges + 5 * EPS * np.abs(normal).sum(1)) * main
    moved = 2 * gap * np.maximum(size_ab, size_ac) * main
    edge_on = (2.125 * unsure + moved) * (1 + 16 * EPS) + 1e-36
    unsure = unsure + moved
    # Of a parallelogram both weights reach over the whole: a half's may be those of the other side as well.
    reach = 5 * EPS * (main * away + 1.5 * np.abs(across).sum(2))
    allowed_b, allowed_c = (
        (reach * np.where(gap > 0, np.maximum(size_ab, size_ac), size) + edge_on) * np.where(gap > 0, 2, 1)
        for size in (size_ac, size_ab)
    )
    with np.errstate(all="ignore"):
        distance = (to * normal).sum(2) / determinant
        flat_error = edges * away + 6 * EPS * (np.abs(to) * np.abs(normal)).sum(2) + gap * np.abs(normal).sum(1)
        error = (flat_error + np.abs(distance) * unsure) / (np.abs(determinant) - unsure)
        tolerance = error + 8 * EPS * np.abs(distance) + 1e-37
    inside = (b >= 0) & (c >= 0) & (rest >= 0)
    sure = inside & (np.abs(determinant) - unsure > edge_on) & (distance > tolerance)
    near = (b >= -2 * allowed_b) & (c >= -2 * allowed_c) & (rest >= -2 * (allowed_b + allowed_c))
    possible = near & (np.abs(determinant) + unsure > edge_on)
    nothing = np.zeros_like(distance)
    found = Candidates(sure, possible, distance, tolerance, nothing, nothing + np.inf, ~inside)
    for pair in _rectangles(corners):
        _rectangle(rays, corners[2 * pair : 2 * pair + 2], 2 * pair, found)
    return found


def _rectangles(corners: npt.NDArray[np.float32]) -> list[int]:
    """Which pairs of triangles 2k and 2k + 1 are rectangles square to an axis."""
    first, second = corners[: len(corners) // 2 * 2 : 2], corners[1::2]
    shared = (first[:, 0] == second[:, 0]).all(1) & (first[:, 2] == second[:, 1]).all(1)
    around = np.stack([first[:, 0], first[:, 1], first[:, 2], second[:, 2]], 1)
    steps = np.roll(around, -1, axis=1) != around
    sides = (steps.sum(2) == 1).all(1) & (steps.any(1).sum(1) == 2)
    return [int(k) for k in np.flatnonzero(shared & sides)]


def _rectangle(rays: Rays, pair: npt.NDArray[np.float32], number: int, found: Candidates) -> None:
    """Put down what may be hit of a rectangle in the columns of its two triangles."""
    d, origin = rays.directions.astype(np.float64), rays.origins.astype(np.float64)
    corners = pair.astype(np.float64)
    low, high = corners.min((0, 1)), corners.max((0, 1))
    axis = int(np.flatnonzero(low == high)[0])
    sides = [k for k in range(3) if k != axis]
    middle, half = (low + high) / 2, (high - low) / 2
    with np.errstate(all="ignore"):
        distance = (middle[axis] - origin[:, axis]) / d[:, axis]
        place = origin + distance[:, None] * d - middle
    beside = np.abs(place[:, sides]) - half[sides]
    room = 2 * EPS * (5 * (np.abs(origin - middle) + half) + 4 * half + np.abs(middle))[:, sides]
    met = np.isfinite(distance) & (beside <= room).all(1)
    # Twice the area of the triangle that the point makes with the diagonal, above zero on the triangle's own side.
    along = pair[0, 2].astype(np.float64) - pair[0, 0]
    for k, corner in enumerate((corners[0, 1], corners[1, 2])):
        own = np.cross(along, corner - corners[0, 0])[axis]
        with np.errstate(invalid="ignore"):
            side = (along[sides[0]] * place[:, sides[1]] - along[sides[1]] * place[:, sides[0]]) * (
                1 if axis != 1 else -1
            )
        side = side * np.sign(own)
        doubt = np.abs(along[sides[0]]) * room[:, 1] + np.abs(along[sides[1]]) * room[:, 0]
        tolerance = 8 * EPS * np.abs(distance) + 1e-37
        inside = met & (beside <= 0).all(1) & (side >= 0)
        column = number + k
        found.sure[:, column] = inside & (distance > tolerance)
        found.possible[:, column] = met & (side >= -doubt)
        found.distance[:, column], found.tolerance[:, column] = distance, tolerance
        found.loose[:, column] = ~(met & (beside <= 0).all(1))


def _turned(corners: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """The triangles with the vertex first that the kernels have first."""
    ab, bc, ca = np.abs(corners - np.roll(corners, -1, axis=1)).max(2).T
    turns = (bc * 4 < np.maximum(ab, ca)) & (_tested(corners.astype(np.float64))[2] == 0)
    return np.where(turns[:, None, None], np.roll(corners, -1, axis=1), corners)


def _tested(vertices: Floats) -> tuple[Floats, Floats, Floats]:
    """Edges that each triangle is tested by, and the gap of the pair that it belongs to; 0 when it belongs to none."""
    ab, ac = vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0]
    gap = np.zeros(len(vertices))
    first, second = vertices[: len(vertices) // 2 * 2 : 2], vertices[1::2]
    shared = (first[:, 0] == second[:, 0]).all(1) & (first[:, 2] == second[:, 1]).all(1)
    off = np.abs(first[:, 1] - first[:, 0] - first[:, 2] + second[:, 2]).sum(1)
    largest = np.maximum(np.abs(first).max((1, 2)), np.abs(second).max((1, 2)))
    pair = np.flatnonzero(shared & (off <= 8.01 * EPS * largest))
    for half in (0, 1):
        ab[2 * pair + half] = first[pair, 1] - first[pair, 0]
        ac[2 * pair + half] = second[pair, 2] - second[pair, 0]
        gap[2 * pair + half] = np.maximum(off[pair], 1e-300)
    return ab, ac, gap


def _in_box(rays: Rays, center: Floats, radius: Floats, slack: Floats) -> tuple[Floats, Floats]:
    """Distances at which a ray enters and leaves the cube around a sphere, made larger by `slack`."""
    d = rays.directions.astype(np.float64)[:, None]
    half = (radius * (1 + 4e-6) + slack + 4 * EPS * np.abs(center).max(-1))[..., None]
    with np.errstate(all="ignore"):
        a, b = (_relative(center.astype(np.float32), rays) + s * half for s in (-1, 1))
        enter, leave = np.minimum(a / d, b / d), np.maximum(a / d, b / d)
    enter, leave = np.where(d == 0, -np.inf, enter), np.where(d == 0, np.inf, leave)
    return enter.max(-1) - np.abs(enter.max(-1)) * 4e-6, leave.min(-1) + np.abs(leave.min(-1)) * 4e-6


def spheres(rays: Rays, analytic_shapes: npt.NDArray[np.void]) -> Candidates:
    """Candidates of spheres."""
    place, r = analytic_shapes["center_radius"][:, :3], analytic_shapes["center_radius"][:, 3].astype(np.float64)[None]
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


def disks(rays: Rays, analytic_shapes: npt.NDArray[np.void]) -> Candidates:
    """Candidates of disks."""
    place, r = analytic_shapes["center_radius"][:, :3], analytic_shapes["center_radius"][:, 3].astype(np.float64)[None]
    n = analytic_shapes["normal"][:, :3].astype(np.float64)[None]
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
