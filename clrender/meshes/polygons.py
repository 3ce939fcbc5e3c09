"""Triangulation of polygons: by fans if a fan covers the polygon, else by ear clipping.

Triangles of a simple polygon's corners that all have the polygon's orientation cover it exactly once: their indicator
functions add up to its winding number. This is tested here in the coordinate plane that the polygon's vector area
(Newell's normal) faces most.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.wording import grouped

__all__ = ["CORNER_LIMIT", "triangulate"]

CORNER_LIMIT: Final = 4096
"""Most corners of a polygon that needs ear clipping, which takes quadratic time."""

_TOLERANCE: Final = 1e-6
"""Fraction of the polygon's area by which a triangle may be inverted, due to rounding and not a concave corner."""
_CHUNK: Final = 2**18
_FAN_LIMIT: Final = 16
"""Most corners of a polygon for which a fan from each corner is tried."""


def triangulate(
    points: NDArray[np.floating], corners: NDArray[np.integer], sizes: NDArray[np.integer], label: str
) -> tuple[NDArray[np.int64], int]:
    """Triangulate polygons.

    Parameters
    ----------
    points : (V, 3) floating
    corners : (C,) integer
        Concatenated vertex indices of all polygons.
    sizes : (F,) integer
        Number of corners of each polygon, at least 3.
    label : str
        Prefix of error messages.

    Returns
    -------
    triangles : (C - 2 F, 3) int64
        Indices into `corners`; grouped by polygon, in order. A convex polygon is a fan from its first corner, and so is
        one whose outline crosses itself.
    crossed : int
        Number of outlines that cross themselves, which no triangles cover exactly.

    Raises
    ------
    SceneError
        For a polygon of more than `CORNER_LIMIT` corners that no fan covers.
    """
    first_corner = np.cumsum(sizes) - sizes
    first_triangle = first_corner - 2 * np.arange(len(sizes))
    triangles = np.empty((int(np.sum(sizes)) - 2 * len(sizes), 3), np.int64)
    coordinates = np.ascontiguousarray(points.T, np.float64)
    crossed = 0
    for count in np.flatnonzero(np.bincount(sizes)).tolist():
        of_size = np.flatnonzero(sizes == count)
        fan = np.stack([np.zeros(count - 2, np.int64), np.arange(1, count - 1), np.arange(2, count)], axis=1)
        step = max(1, _CHUNK // count)
        for start in range(0, len(of_size), step):
            some = of_size[start : start + step]
            first, rows = first_corner[some, None], first_triangle[some, None] + np.arange(count - 2)
            triangles[rows] = first[:, None] + fan
            if count > 3:
                polygons = corners[first + np.arange(count)]
                others, local, crossing = _other_triangles(coordinates, polygons, fan, label)
                triangles[rows[others]] = first[others, None] + local
                crossed += crossing
    return triangles, crossed


def _other_triangles(
    coordinates: NDArray[np.float64], polygons: NDArray[np.integer], fan: NDArray[np.int64], label: str
) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """Polygons of one size that the fan from corner 0 does not cover, and triangles that do.

    Parameters
    ----------
    coordinates : (3, V) float64
    polygons : (F, n) integer
        Vertex indices.
    fan : (n - 2, 3) int64
        The fan from corner 0.

    Returns
    -------
    others : (k,) int64
    triangles : (k, n - 2, 3) int64
        Their triangles; the fan for those that cross themselves.
    crossed : int
        Number of polygons that cross themselves.
    """
    count = polygons.shape[1]
    signed, axis, turns, area = _fan_areas(coordinates, polygons)
    others = left = np.flatnonzero(~_covered(signed, area))
    local = np.repeat(fan[None], len(others), axis=0)
    flat = _projected(coordinates, polygons[others], axis[others], turns[others])
    for turn in range(1, count if count <= _FAN_LIMIT else 1):
        if not len(left):
            break
        turned, at = (fan + turn) % count, np.searchsorted(others, left)
        good = _covered(_areas(flat[at], turned).T, area[left])
        local[at[good]] = turned
        left = left[~good]
    if len(left) and count > CORNER_LIMIT:
        what = f"has a concave polygon of {count} corners, but at most {grouped(CORNER_LIMIT)} are split"
        raise SceneError(f"{label} {what}; export it as triangles")
    fans: list[int] = []
    for polygon, at_one in zip(left.tolist(), np.searchsorted(others, left).tolist(), strict=True):
        found = _ears(flat[at_one], float(area[polygon]))
        if found is not None:
            local[at_one] = found
        else:
            fans.append(polygon)
    # The two halves of a bow tie may cancel out; only collinear polygons have no area to cover.
    fans += np.flatnonzero(area == 0.0).tolist()
    doubtful = coordinates.T[polygons[np.unique(np.array(fans, np.int64))]]
    return others, local, int((~_on_a_line(doubtful)).sum())


def _fan_areas(
    coordinates: NDArray[np.float64], polygons: NDArray[np.integer]
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Areas of the triangles of polygons' fans from corner 0, projected along each polygon's dominant axis.

    Parameters
    ----------
    coordinates : (3, V) float64
    polygons : (F, n) integer

    Returns
    -------
    signed : (n - 2, F) float64
        Twice the areas; below 0: inverted.
    axis : (F,) int64
        Largest component of Newell's normal, the sum of the vector areas.
    turns : (F,) float64
        -1 if that component is negative: the polygon is clockwise.
    area : (F,) float64
        Magnitude of that component.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # the caller rejects coordinates out of range
        corners = [each[np.ascontiguousarray(polygons.T)] for each in coordinates]  # contiguous for NumPy's loops
        x, y, z = (each[1:] - each[0] for each in corners)
        parts = [a[:-1] * b[1:] - b[:-1] * a[1:] for a, b in ((y, z), (z, x), (x, y))]
        normal = [part.sum(axis=0) for part in parts]
    sizes = [np.abs(each) for each in normal]
    # The first of the largest; NaN counts as largest, as in numpy.argmax
    axis = np.argmax(sizes, axis=0)
    signed, along = parts[0], normal[0]
    for k in (1, 2):
        chosen = axis == k
        along = np.where(chosen, normal[k], along)
        signed = np.where(chosen, parts[k], signed)
    turns = np.where(along < 0.0, -1.0, 1.0)
    return signed * turns, axis, turns, np.abs(along)


def _projected(
    coordinates: NDArray[np.float64],
    polygons: NDArray[np.integer],
    axis: NDArray[np.int64],
    turns: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Polygons projected along an axis, counter-clockwise: (F, n, 2)."""
    across, along = (coordinates[((axis + k) % 3)[:, None], polygons] for k in (1, 2))
    with np.errstate(over="ignore", invalid="ignore"):
        return np.stack([(across - across[:, :1]) * turns[:, None], along - along[:, :1]], axis=2)


def _on_a_line(outlines: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which of the polygons (F, n, 3) are collinear."""
    with np.errstate(over="ignore", invalid="ignore"):
        relative = outlines - outlines[:, :1]
        lengths = (relative * relative).sum(axis=2)
        longest = np.take_along_axis(relative, np.argmax(lengths, axis=1)[:, None, None], axis=1)
        across = np.abs(np.cross(relative, longest)).max(axis=(1, 2), initial=0.0)
        return np.asarray(across <= _TOLERANCE * lengths.max(axis=1, initial=0.0))


def _cross(a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]) -> NDArray[np.float64]:
    """Twice the signed area of triangles with corners (..., 2)."""
    with np.errstate(over="ignore", invalid="ignore"):
        ab, ac = b - a, c - a
        return np.asarray(ab[..., 0] * ac[..., 1] - ab[..., 1] * ac[..., 0])


def _areas(flat: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    """Twice the signed areas of the same triangles of all polygons: (F, k)."""
    return _cross(flat[:, triangles[:, 0]], flat[:, triangles[:, 1]], flat[:, triangles[:, 2]])


def _covered(areas: NDArray[np.float64], area: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which polygons have triangles, of signed areas (k, F), that all have the right orientation."""
    return np.asarray((areas >= -_TOLERANCE * area).all(axis=0))


def _ears(outline: NDArray[np.float64], area: float) -> NDArray[np.int64] | None:
    """Triangles of a counter-clockwise polygon by ear clipping; None if its outline crosses itself.

    An ear is a convex corner whose triangle contains no other corner (G. H. Meisters 1975). Clipping one changes only
    its two neighbours, so each step examines only these.
    """
    count = len(outline)
    before, after = np.roll(np.arange(count), 1), np.roll(np.arange(count), -1)
    turn = _cross(outline[before], outline, outline[after])
    # Only reflex corners can lie in an ear. Clipping never makes another corner reflex.
    reflex = turn <= 0.0
    ear = np.zeros(count, bool)

    def look(corner: int) -> None:
        a, b, c = outline[before[corner]], outline[corner], outline[after[corner]]
        turns = float(_cross(a, b, c))
        reflex[corner] = turns <= 0.0
        ear[corner] = turns > 0.0 and not _any_inside(outline[reflex], a, b, c)
        # A collinear corner, or a spike, has no area: it may always be clipped.
        ear[corner] |= abs(turns) <= 1e-15 * area

    for corner in range(count):
        look(corner)
    triangles, corner = [], 0
    alive = count
    while alive > 3:
        tried = 0
        while not ear[corner]:
            corner, tried = int(after[corner]), tried + 1
            if tried > 2 * alive:
                return None
            if tried > alive:  # corners in its triangle may be gone by now
                look(corner)
        a, c = int(before[corner]), int(after[corner])
        triangles.append((a, corner, c))
        after[a], before[c] = c, a
        ear[corner] = reflex[corner] = False
        alive -= 1
        look(a)
        look(c)
        corner = int(after[c])  # every other corner: avoids slivers that all share one corner
    triangles.append((int(before[corner]), corner, int(after[corner])))
    found = np.array(triangles, np.int64)
    areas = _cross(outline[found[:, 0]], outline[found[:, 1]], outline[found[:, 2]])
    return found if (areas >= -_TOLERANCE * area).all() else None


def _any_inside(
    points: NDArray[np.float64], a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]
) -> bool:
    """Whether some point lies in a counter-clockwise triangle or on its edges, but not on a corner."""
    near = (_cross(a, b, points) >= 0.0) & (_cross(b, c, points) >= 0.0) & (_cross(c, a, points) >= 0.0)
    if not near.any():
        return False
    candidates = points[near]
    at_corner = (candidates == a).all(axis=1) | (candidates == b).all(axis=1) | (candidates == c).all(axis=1)
    return not bool(at_corner.all())
