"""Polygons as triangles: fans where a fan covers the polygon, ear clipping where none does.

Triangles with corners of a simple polygon that all turn the way the polygon does cover it exactly once: their
indicator functions add up to the polygon's winding number. That is what is tested here, in the plane of coordinates
that the polygon's vector area (Newell's normal) faces most.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError

__all__ = ["CORNER_LIMIT", "triangulate"]

CORNER_LIMIT: Final = 4096
"""Most corners of a polygon that needs ear clipping, which takes time in the square of them."""

_TOLERANCE: Final = 1e-6
"""Share of the polygon's area that a triangle may be turned over by: rounding of coordinates, not a concave corner."""
_CHUNK: Final = 2**20
_FAN_LIMIT: Final = 16
"""Corners up to which fans from each of them are tried."""


def triangulate(
    points: NDArray[np.floating], corners: NDArray[np.integer], sizes: NDArray[np.integer], label: str
) -> tuple[NDArray[np.int64], int]:
    """Split polygons into triangles that cover each of them once.

    Parameters
    ----------
    points : (V, 3) floating
    corners : (C,) integer
        Vertices of all polygons, one polygon after the other.
    sizes : (F,) integer
        Corners of each polygon, at least 3.
    label : str
        Start of an error message.

    Returns
    -------
    triangles : (C - 2 F, 3) int64
        Places in `corners`; triangles of a polygon together, polygons in order. A convex polygon is a fan from its
        first corner, and so is one whose outline crosses itself.
    crossed : int
        How many outlines cross themselves: no triangles cover those.

    Raises
    ------
    SceneError
        For a polygon of more than `CORNER_LIMIT` corners that no fan covers.
    """
    first_corner = np.cumsum(sizes) - sizes
    first_triangle = first_corner - 2 * np.arange(len(sizes))
    triangles = np.empty((int(np.sum(sizes)) - 2 * len(sizes), 3), np.int64)
    crossed = 0
    for size in np.unique(sizes):
        count = int(size)
        of_size = np.flatnonzero(sizes == count)
        fan = np.stack([np.zeros(count - 2, np.int64), np.arange(1, count - 1), np.arange(2, count)], axis=1)
        step = max(1, _CHUNK // count)
        for start in range(0, len(of_size), step):
            some = of_size[start : start + step]
            local = np.broadcast_to(fan, (len(some), count - 2, 3))
            if count > 3:
                places = first_corner[some, None] + np.arange(count)
                local, crossing = _split(points[corners[places]].astype(np.float64), fan, label)
                crossed += crossing
            rows = first_triangle[some, None] + np.arange(count - 2)
            triangles[rows] = first_corner[some, None, None] + local
    return triangles, crossed


def _split(outlines: NDArray[np.float64], fan: NDArray[np.int64], label: str) -> tuple[NDArray[np.int64], int]:
    """Triangles (F, n - 2, 3) of polygons of one size, and how many of them cross themselves.

    Parameters
    ----------
    outlines : (F, n, 3) float64
    fan : (n - 2, 3) int64
        The fan from corner 0.
    """
    flat, area = _projected(outlines)
    count = flat.shape[1]
    local = np.repeat(fan[None], len(flat), axis=0)
    left = np.flatnonzero(~_covers(flat, area, fan))
    for turn in range(1, count if count <= _FAN_LIMIT else 1):
        if not len(left):
            break
        turned = (fan + turn) % count
        good = _covers(flat[left], area[left], turned)
        local[left[good]] = turned
        left = left[~good]
    if len(left) and count > CORNER_LIMIT:
        what = f"has a concave polygon of {count} corners, but at most {CORNER_LIMIT} are split"
        raise SceneError(f"{label} {what}; export it as triangles")
    fans: list[int] = []
    for polygon in left:
        found = _ears(flat[polygon], float(area[polygon]))
        if found is not None:
            local[polygon] = found
        else:
            fans.append(int(polygon))
    # The two halves of a bow tie may cancel out; only what lies on a line has no area to cover at all.
    fans += np.flatnonzero(area == 0.0).tolist()
    return local, int((~_on_a_line(outlines[np.unique(np.array(fans, np.int64))])).sum())


def _projected(outlines: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Polygons along an axis, turning counter-clockwise: (F, n, 2), and twice their areas: (F,)."""
    with np.errstate(over="ignore", invalid="ignore"):  # coordinates out of range are refused by who asked
        relative = outlines - outlines[:, :1]
        normal = np.cross(relative[:, 1:-1], relative[:, 2:]).sum(axis=1)
    axis = np.argmax(np.abs(normal), axis=1)
    rows = np.arange(len(outlines))
    across, along = (axis + 1) % 3, (axis + 2) % 3
    flat = np.stack([relative[rows, :, across], relative[rows, :, along]], axis=2)
    flat[normal[rows, axis] < 0.0, :, 0] *= -1.0
    return flat, np.abs(normal[rows, axis])


def _on_a_line(outlines: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which of the polygons (F, n, 3) lie on a line."""
    with np.errstate(over="ignore", invalid="ignore"):
        relative = outlines - outlines[:, :1]
        lengths = (relative**2).sum(axis=2)
        longest = np.take_along_axis(relative, np.argmax(lengths, axis=1)[:, None, None], axis=1)
        across = np.abs(np.cross(relative, longest)).max(axis=(1, 2), initial=0.0)
        return np.asarray(across <= _TOLERANCE * lengths.max(axis=1, initial=0.0))


def _cross(a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]) -> NDArray[np.float64]:
    """Twice the signed area of triangles with corners (..., 2)."""
    with np.errstate(over="ignore", invalid="ignore"):
        ab, ac = b - a, c - a
        return np.asarray(ab[..., 0] * ac[..., 1] - ab[..., 1] * ac[..., 0])


def _covers(flat: NDArray[np.float64], area: NDArray[np.float64], fan: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Of which polygons the triangles all turn the right way."""
    areas = _cross(flat[:, fan[:, 0]], flat[:, fan[:, 1]], flat[:, fan[:, 2]])
    return np.asarray((areas >= -_TOLERANCE * area[:, None]).all(axis=1))


def _ears(outline: NDArray[np.float64], area: float) -> NDArray[np.int64] | None:
    """Triangles of a counter-clockwise polygon by ear clipping; None where its outline crosses itself.

    An ear is a corner that turns left and whose triangle no other corner lies in (G. H. Meisters 1975). Clipping one
    changes no corner but its two neighbours, so each step looks at these alone.
    """
    count = len(outline)
    before, after = np.roll(np.arange(count), 1), np.roll(np.arange(count), -1)
    turn = _cross(outline[before], outline, outline[after])
    # Only corners that do not turn left can lie in an ear. A corner that was one keeps to be one at most.
    reflex = turn <= 0.0
    ear = np.zeros(count, bool)

    def look(corner: int) -> None:
        a, b, c = outline[before[corner]], outline[corner], outline[after[corner]]
        turns = float(_cross(a, b, c))
        reflex[corner] = turns <= 0.0
        ear[corner] = turns > 0.0 and not _any_inside(outline[reflex], a, b, c)
        # A corner on a straight line, or one that comes back on itself, has no area: it may always go.
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
            if tried > alive:  # what lay in its triangle may be gone by now
                look(corner)
        a, c = int(before[corner]), int(after[corner])
        triangles.append((a, corner, c))
        after[a], before[c] = c, a
        ear[corner] = reflex[corner] = False
        alive -= 1
        look(a)
        look(c)
        corner = int(after[c])  # every other corner: slivers that all share one corner are avoided
    triangles.append((int(before[corner]), corner, int(after[corner])))
    found = np.array(triangles, np.int64)
    areas = _cross(outline[found[:, 0]], outline[found[:, 1]], outline[found[:, 2]])
    return found if (areas >= -_TOLERANCE * area).all() else None


def _any_inside(
    points: NDArray[np.float64], a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]
) -> bool:
    """Whether some point lies in a counter-clockwise triangle or on its rim, but not on a corner of it."""
    near = (_cross(a, b, points) >= 0.0) & (_cross(b, c, points) >= 0.0) & (_cross(c, a, points) >= 0.0)
    if not near.any():
        return False
    candidates = points[near]
    at_corner = (candidates == a).all(axis=1) | (candidates == b).all(axis=1) | (candidates == c).all(axis=1)
    return not bool(at_corner.all())
