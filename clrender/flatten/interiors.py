"""Which media contain a point: the interior lists of the camera, where paths begin, and of lights."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.exact.elementary import angles_of
from clrender.exact.matrices import inner, length, lengths, product, total
from clrender.flatten.lamps import POINT_KINDS

if TYPE_CHECKING:
    from clrender.flatten.instances import FlatInstances

__all__ = [
    "LIST_LENGTH",
    "has_volumes",
    "media_around",
    "media_in_box",
    "media_with_lights",
    "medium_of_primitives",
    "open_media",
    "packed",
    "winding_number",
]

_Arrays: TypeAlias = Mapping[str, NDArray[Any]]
_CHUNK: Final = 2**18
_OPEN: Final = 1e-3
"""Share of a surface's area that a hole must have to be told from rounding."""

LIST_LENGTH: Final = 8
"""Most nested media that a path tracks: ``INTERIOR_ENTRIES`` of ``kernels/material/interior.h``."""


def media_around(
    arrays: _Arrays, triangle_count: int, point: NDArray[np.float64], instances: FlatInstances | None = None
) -> list[int]:
    """Media whose volumes contain a point, each as often as its shapes enclose it; the effective one comes first.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        See `clrender.flatten.flat_scene.FlatScene`.
    triangle_count : int
    point : (3,) float64
        Relative to the arrays' origin, metres.
    instances : FlatInstances, optional
        Instances of the scene; without them all primitives are in world space.

    Returns
    -------
    list of int
        Rows of ``media_rows``. A volume contains the points with winding number at least 1, with the surfaces' backs
        towards them. For surfaces with holes the winding number is rounded.
    """
    if len(arrays["media_rows"]) == 1:
        return []
    medium_of = medium_of_primitives(arrays)
    found: list[tuple[int, float, int]] = []
    unranked = int(arrays["media_rows"][0, 4].view(np.uint32))
    for some, at, scale in _spaces(medium_of, triangle_count, point, instances):
        for medium in np.unique(medium_of[some]).tolist():
            primitives = some[medium_of[some] == medium]
            low, high = _box(arrays, triangle_count, primitives)
            if medium == 0 or not ((low <= at) & (at <= high)).all():
                continue
            turns = winding_number(arrays, primitives[primitives < triangle_count], at)
            turns += _round_turns(arrays, primitives[primitives >= triangle_count] - triangle_count, at)
            # Without priorities the smallest volume counts as the innermost
            place = (medium, 0.0) if medium > unranked else (0, -float((high - low).prod()) * scale)
            found += [(*place, medium)] * max(0, math.floor(turns + 0.5))
    return [medium for _, _, medium in sorted(found, reverse=True)]


def media_in_box(
    arrays: _Arrays,
    triangle_count: int,
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    instances: FlatInstances | None = None,
) -> bool:
    """Whether the surface of any medium may be in a box, judged by the boxes of primitives and instances.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        See `clrender.flatten.flat_scene.FlatScene`.
    triangle_count : int
    low, high : (3,) float64
        Relative to the arrays' origin, metres.
    instances : FlatInstances, optional
        See `media_around`.
    """
    if len(arrays["media_rows"]) == 1:
        return False
    with_medium = np.flatnonzero(medium_of_primitives(arrays))
    if instances is not None and instances.count:
        number = np.where(with_medium < triangle_count, with_medium, with_medium - triangle_count)
        own = np.where(with_medium < triangle_count, instances.own_triangles, instances.own_analytic)
        if (number >= own).any() and _meets(instances.boxes[:, :3], instances.boxes[:, 3:], low, high):
            return True
        with_medium = with_medium[number < own]
    for start in range(0, len(with_medium), _CHUNK):
        some = with_medium[start : start + _CHUNK]
        corners = arrays["vertices"][arrays["triangles"][some[some < triangle_count]]]
        rows = arrays["analytic_shapes"]["center_radius"][some[some >= triangle_count] - triangle_count]
        if _meets(corners.min(axis=1), corners.max(axis=1), low, high):
            return True
        if _meets(rows[:, :3] - rows[:, 3:], rows[:, :3] + rows[:, 3:], low, high):
            return True
    return False


def _meets(lows: NDArray[Any], highs: NDArray[Any], low: NDArray[np.float64], high: NDArray[np.float64]) -> bool:
    """Whether any of some boxes meets another one."""
    return bool(((lows <= high) & (low <= highs)).all(axis=1).any())


def _spaces(
    medium_of: NDArray[np.uint32], triangle_count: int, point: NDArray[np.float64], instances: FlatInstances | None
) -> Iterator[tuple[NDArray[np.intp], NDArray[np.float64], float]]:
    """Primitives with media that may enclose a point, the point in their space, and the space's scale of volumes.

    Yields first those in world space, then those of each instance whose box contains the point.
    """
    with_medium = np.flatnonzero(medium_of)
    if instances is None or not instances.count:
        yield with_medium, point, 1.0
        return
    number = np.where(with_medium < triangle_count, with_medium, with_medium - triangle_count)
    own = np.where(with_medium < triangle_count, instances.own_triangles, instances.own_analytic)
    yield with_medium[number < own], point, 1.0
    if not (number >= own).any():
        return
    inside = ((instances.boxes[:, :3] <= point) & (point <= instances.boxes[:, 3:])).all(axis=1)
    for instance in np.flatnonzero(inside).tolist():
        group = instances.groups[instances.group_of[instance]]
        triangles = range(group.first_triangle, group.first_triangle + group.triangle_count)
        analytic = range(group.first_analytic, group.first_analytic + group.analytic_count)
        of_group = np.concatenate([np.arange(some.start, some.stop, dtype=np.intp) for some in (triangles, analytic)])
        to_object = instances.rows[2 * instance, :12].reshape(3, 4).astype(np.float64)
        x, y, z = (row[:3] for row in to_object)
        volume = abs(float((np.cross(x, y) * z).sum()))
        yield of_group, (to_object[:, :3] * point).sum(axis=1) + to_object[:, 3], 1.0 / volume


def media_with_lights(
    arrays: _Arrays, triangle_count: int, light_count: int, instances: FlatInstances | None = None
) -> set[int]:
    """Media that contain a light, judged by a few points of each light.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        See `clrender.flatten.flat_scene.FlatScene`.
    triangle_count, light_count : int

    Returns
    -------
    set of int
        Rows of ``media_rows``.
    """
    around = _media_around_lights(arrays, triangle_count, light_count, instances)
    return set().union(*(media for _, media in around))


def _media_around_lights(
    arrays: _Arrays, triangle_count: int, light_count: int, instances: FlatInstances | None
) -> Iterator[tuple[int, list[int]]]:
    """Each light with the media around one of its points, for all points that may be in a medium."""
    low, high = _box(arrays, triangle_count, np.flatnonzero(medium_of_primitives(arrays)))
    if instances is not None and instances.count:
        low, high = (
            np.minimum(low, instances.boxes[:, :3].min(axis=0)),
            np.maximum(high, instances.boxes[:, 3:].max(axis=0)),
        )
    for number, light in enumerate(arrays["lights"][:light_count]):
        points = _shining_points(arrays, triangle_count, light)
        near = ((low <= points) & (points <= high)).all(axis=1)
        for point in points[near]:
            yield number, media_around(arrays, triangle_count, point, instances)


def _shining_points(arrays: _Arrays, triangle_count: int, light: np.void) -> NDArray[np.float64]:
    """(n, 3) points slightly in front of a light's surface; none for infinitely distant lights."""
    if light["kind"] in POINT_KINDS:
        return np.asarray(light["position"][:3], np.float64)[None]
    if light["kind"] not in (layout.LIGHT_AREA_TRIANGLE, layout.LIGHT_AREA_SPHERE, layout.LIGHT_AREA_DISK):
        return np.zeros((0, 3))
    if light["primitive"] < triangle_count:
        a, b, c = arrays["vertices"][arrays["triangles"][light["primitive"]]].astype(np.float64)
        normal = np.cross(b - a, c - a)
        inwards = np.array([[0.98, 0.01, 0.01], [0.01, 0.98, 0.01], [0.01, 0.01, 0.98], [1 / 3, 1 / 3, 1 / 3]])
        away = 1e-4 * normal / math.sqrt(length(normal))
        return np.asarray(product(inwards, np.stack([a, b, c])) + away)
    row = arrays["analytic_shapes"][light["primitive"] - triangle_count]
    center, radius = row["center_radius"][:3].astype(np.float64), float(row["center_radius"][3])
    if row["normal"][3] == 0.0:
        return np.asarray(center + 1e-4 * radius * row["normal"][:3])[None]
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    return np.asarray(center + radius * (1.0 + 1e-4 * float(row["normal"][3])) * axes)


def open_media(arrays: _Arrays, triangle_count: int) -> list[int]:
    """Media whose surfaces have a hole: the normals of a closed surface, by area, add up to nothing.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        See `clrender.flatten.flat_scene.FlatScene`.
    triangle_count : int

    Returns
    -------
    list of int
        Rows of ``media_rows``.
    """
    medium_of = medium_of_primitives(arrays)
    corners = arrays["vertices"][arrays["triangles"][:triangle_count]].astype(np.float64)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    rows = arrays["analytic_shapes"][: len(medium_of) - triangle_count]
    radius, normal = rows["center_radius"][:, 3:].astype(np.float64), rows["normal"].astype(np.float64)
    disks = np.where(normal[:, 3:] == 0.0, math.pi * radius * radius * normal[:, :3], 0.0)
    areas = np.concatenate([np.cross(first, second) / 2.0, disks])
    found = []
    for medium in np.unique(medium_of[medium_of != 0]).tolist():
        own = areas[medium_of == medium]
        # In a fixed order: the sums decide about bits
        sums = [math.fsum(column) for column in own.T.tolist()]
        total = math.sqrt(sum(each * each for each in sums))
        whole = math.fsum(np.sqrt((own * own).sum(axis=1)).tolist())
        if total > _OPEN * whole:
            found.append(medium)
    return found


def packed(media: list[int]) -> tuple[int, int]:
    """The list as the kernels store it: two words with a byte for each of the first `LIST_LENGTH` media."""
    entries = [*media[:LIST_LENGTH], *[0] * (LIST_LENGTH - len(media))]
    return int.from_bytes(bytes(entries[:4]), "big"), int.from_bytes(bytes(entries[4:]), "big")


def medium_of_primitives(arrays: _Arrays) -> NDArray[np.uint32]:
    """The medium behind each primitive's front, (T + R,) uint32; 0: none."""
    medium: NDArray[np.uint32] = arrays["materials"]["medium"][arrays["shapes"]["material"]]
    return medium[arrays["primitive_shape"]]


def has_volumes(arrays: _Arrays) -> bool:
    """Whether there are shapes whose medium paths have to know that begin inside."""
    return len(arrays["media_rows"]) > 1 and bool(medium_of_primitives(arrays).any())


def _box(
    arrays: _Arrays, triangle_count: int, primitives: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Bounding box of some primitives."""
    corners = arrays["vertices"][arrays["triangles"][primitives[primitives < triangle_count]].reshape(-1)]
    spheres = arrays["analytic_shapes"]["center_radius"][primitives[primitives >= triangle_count] - triangle_count]
    spheres = spheres.astype(np.float64)
    points = np.concatenate([corners, spheres[:, :3] - spheres[:, 3:], spheres[:, :3] + spheres[:, 3:]])
    if not len(points):
        return np.full(3, np.inf), np.full(3, -np.inf)
    return points.min(axis=0), points.max(axis=0)


def winding_number(arrays: _Arrays, triangles: NDArray[np.intp], point: NDArray[np.float64]) -> float:
    """Winding number of triangles about a point, with their backs to it: the sum of their solid angles over 4π.

    The solid angle is that of van Oosterom and Strackee (IEEE Trans. Biomed. Eng. 30(2), 1983).
    """
    turns = 0.0
    for start in range(0, len(triangles), _CHUNK):
        corners = arrays["triangles"][triangles[start : start + _CHUNK]]
        a, b, c = (arrays["vertices"][corners[:, i]].astype(np.float64) - point for i in range(3))
        x, y, z = (lengths(v) for v in (a, b, c))
        volume = inner(a, np.cross(b, c))
        below = x * y * z + inner(a, b) * z + inner(b, c) * x + inner(c, a) * y
        turns += float(total(angles_of(volume, below))) / (2.0 * math.pi)
    return turns


def _round_turns(arrays: _Arrays, places: NDArray[np.intp], point: NDArray[np.float64]) -> float:
    """Like `winding_number`, for spheres; a disk has no inside."""
    rows = arrays["analytic_shapes"][places]
    sphere = rows[rows["normal"][:, 3] != 0.0]
    away = sphere["center_radius"][:, :3].astype(np.float64) - point
    radius = sphere["center_radius"][:, 3].astype(np.float64)
    inside = inner(away, away) < radius * radius
    return float(sphere["normal"][:, 3][inside].sum())
