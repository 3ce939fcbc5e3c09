"""Motions as kernels read them (kernels/geometry/motion.h): knots in time, and boxes of what moves between them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.errors import SceneError
from clrender.exact.elementary import angles_of
from clrender.exact.matrices import determinant, inner, product
from clrender.scene.motion import aligned, matrices_of, polar, quaternion_of
from clrender.wording import grouped, place

if TYPE_CHECKING:
    from collections.abc import Sequence

    from clrender.scene.camera import Camera
    from clrender.scene.description import Scene
    from clrender.scene.motion import Track

__all__ = [
    "NO_MOTION",
    "Knots",
    "camera_knots",
    "knot_rows",
    "knots_of",
    "light_knot_rows",
    "placed_knots",
    "swept_boxes",
]

_Floats = NDArray[np.float64]
_TURN: Final = math.radians(5.0)
"""Largest angle between two knots: quaternions interpolated linearly are early or late by less than 3e-6 of it."""
_SMALL_TURN: Final = math.radians(0.5)
"""The same where a motion is that of another motion: an arc of this angle is from its chord by 1e-5 of its radius."""
_EVEN: Final = 1e-9
_MOST: Final = 2**16
_NEGLIGIBLE: Final = 1e-12
"""Parts of quaternions and stretches that are rounding errors; squares of such may be below the smallest float."""
_COLUMNS: Final = layout.columns("MOTION")
_SAGITTA: Final = 0.15
_SHEARED: Final = 0.26
_ROUNDED: Final = 64.0 * 2.0**-24
"""Bounds of a point's distance from the straight way between two knots; see `swept_boxes`."""


@dataclass(frozen=True)
class Knots:
    """A motion while the shutter is open: a point p goes to R S p + offset, from one knot to the next.

    Attributes
    ----------
    shares : (K,) float64
        Times, as shares of the interval: the first is 0, the last 1.
    rotations : (K, 4) float64
        Unit quaternions R, the scalar last, each within half a turn of the one before.
    stretches : (K, 3, 3) float64
        Symmetric matrices S of positive determinant.
    offsets : (K, 3) float64
        World space, metres.
    before : (1, 3, 4) float64
        What is mapped before: the identity, or a reflection in the origin where the motion mirrors.
    """

    shares: _Floats
    rotations: _Floats
    stretches: _Floats
    offsets: _Floats
    before: _Floats

    @property
    def linear(self) -> _Floats:
        """(K, 3, 3) products of R and S."""
        return product(matrices_of(self.rotations), self.stretches)

    @property
    def condition(self) -> float:
        """Largest condition number of its stretches, in the Frobenius norm; 3 for rigid motions."""
        a, b, c = (self.stretches[:, row] for row in range(3))
        cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
        volume = inner(a, cofactors[:, 0])
        norms = [np.sqrt((each * each).sum(axis=(1, 2))) for each in (self.stretches, cofactors)]
        return float((norms[0] * norms[1] / volume).max())


NO_MOTION: Final = Knots(
    np.array([0.0, 1.0]),
    np.array([[0.0, 0.0, 0.0, 1.0]] * 2),
    np.array([np.eye(3)] * 2),
    np.zeros((2, 3)),
    np.eye(4)[None, :3],
)
"""Of what stays in its place while its form changes."""


class _Turning(Protocol):
    """What has keys, and turns between them."""

    @property
    def times(self) -> _Floats: ...

    def turning(self, index: int) -> float: ...


def _moments(track: _Turning, begin: float, end: float, turn: float = _TURN) -> _Floats:
    """Times of knots, seconds: both ends, the keys between them, and as many more as turns of that angle need."""
    keys = track.times
    stops = [begin, *keys[(keys > begin) & (keys < end)].tolist(), end]
    moments = [begin]
    for first, last in pairwise(stops):
        index = int(np.searchsorted(keys, first, side="right")) - 1
        pieces = 1
        if 0 <= index < len(keys) - 1:
            share = (last - first) / float(keys[index + 1] - keys[index])
            pieces = max(1, math.ceil(track.turning(index) * share / turn))
        if len(moments) + pieces > _MOST:
            raise ValueError(
                f"turns too often while the shutter is open: more than {grouped(_MOST)} times by "
                f"{math.degrees(turn):g} degrees"
            )
        moments += [first + (last - first) * step / pieces for step in range(1, pieces)] + [last]
    return np.array(moments)


def knots_of(track: Track, scene: Scene, index: int, table: str = "shapes") -> Knots:
    """Knots of a motion, over the interval of the scene's camera.

    Parameters
    ----------
    track : Track
    scene : Scene
    index : int
        Of the shape or light, for messages.
    table : str
        Which of both.

    Raises
    ------
    SceneError
        It turns too often.
    """
    begin, end = scene.camera.interval
    try:
        moments = _moments(track, begin, end)
    except ValueError as error:
        raise SceneError(f"{scene.source}: {place((table, index, 'motion'))} {error}; close it sooner") from None
    path = track.at(moments)
    shares = np.clip((moments - begin) / (end - begin), 0.0, 1.0)
    before = np.concatenate([track.sign * np.eye(3), np.zeros((3, 1))], axis=1)[None]
    return Knots(shares, path.rotations, path.stretches, path.offsets, before)


def placed_knots(
    inner_track: Track, map_: NDArray[np.float64], outer_track: Track | None, scene: Scene, index: int
) -> Knots:
    """Knots of what moves in a group: its own motion, then where an instance is, and then the motion of that.

    Between two knots rotations, stretches and translations are interpolated, which is this way if the map of the
    instance is a similarity and rests. Else knots are so close that offsets leave it by less than 1e-5 of their length.

    Parameters
    ----------
    inner_track : Track
        Its own.
    map_ : (3, 4) float64
        From the space of the group.
    outer_track : Track or None
        Of the instance.
    scene : Scene
    index : int
        Of the instance, for messages.

    Raises
    ------
    SceneError
        It turns too often.
    """
    begin, end = scene.camera.interval
    linear, offset = map_[:, :3], map_[:, 3]
    mirrors = -1.0 if determinant(linear) < 0.0 else 1.0
    turn, stretch = polar(mirrors * linear)
    even = float(np.abs(stretch - stretch[0, 0] * np.eye(3)).max()) <= _EVEN * float(stretch[0, 0])
    simple = outer_track is None and even
    try:
        moments = _moments(inner_track, begin, end, _TURN if simple else _SMALL_TURN)
        if outer_track is not None:
            moments = np.union1d(moments, _moments(outer_track, begin, end, _SMALL_TURN))
    except ValueError as error:
        text = f"places what {error}; close camera.shutter sooner"
        raise SceneError(f"{scene.source}: {place(('shapes', index))} {text}") from None
    path = inner_track.at(moments)
    offsets = inner(linear, path.offsets[:, None, :]) + offset
    sign = mirrors * inner_track.sign
    if simple:
        first = np.broadcast_to(quaternion_of(turn), path.rotations.shape)
        rotations, stretches = _composed(first, path.rotations), stretch[0, 0] * path.stretches
    else:
        whole = product(linear, inner_track.sign * path.linear)
        if outer_track is not None:
            outer_path = outer_track.at(moments)
            around = outer_track.sign * outer_path.linear
            whole, offsets = product(around, whole), inner(around, offsets[:, None, :]) + outer_path.offsets
            sign *= outer_track.sign
        parts = [polar(sign * each) for each in whole]
        rotations = np.stack([quaternion_of(rotation) for rotation, _ in parts])
        stretches = np.stack([stretched for _, stretched in parts])
    shares = np.clip((moments - begin) / (end - begin), 0.0, 1.0)
    before = np.concatenate([sign * np.eye(3), np.zeros((3, 1))], axis=1)[None]
    return Knots(shares, aligned(rotations), stretches, offsets, before)


def camera_knots(camera: Camera, source: str) -> Knots | None:
    """Knots of a camera that moves: rotations from where it is when the shutter opens, and its positions.

    Parameters
    ----------
    camera : Camera
    source : str
        Name of the scene in messages.

    Returns
    -------
    Knots or None
        None if it rests.

    Raises
    ------
    SceneError
        It turns too often.
    """
    track = camera.track
    if track is None:
        return None
    begin, end = camera.interval
    try:
        moments = _moments(track, begin, end)
    except ValueError as error:
        raise SceneError(f"{source}: camera.motion {error}; close it sooner") from None
    rotations, positions, _ = track.at(moments)
    x, y, z, w = rotations[0]
    back = np.broadcast_to(np.array([-x, -y, -z, w]), rotations.shape)
    turned = aligned(_composed(rotations, back))
    shares = np.clip((moments - begin) / (end - begin), 0.0, 1.0)
    same = np.broadcast_to(np.eye(3), (len(moments), 3, 3))
    return Knots(shares, turned, same, positions, np.eye(4)[None, :3])


def _composed(a: _Floats, b: _Floats) -> _Floats:
    """Quaternions (n, 4) of the rotations `b` first, then `a`."""
    (ax, ay, az, aw), (bx, by, bz, bw) = a.T, b.T
    parts = [
        (aw * bx + ax * bw) + (ay * bz - az * by),
        (aw * by + ay * bw) + (az * bx - ax * bz),
        (aw * bz + az * bw) + (ax * by - ay * bx),
        (aw * bw - ax * bx) - (ay * by + az * bz),
    ]
    return np.stack(parts, axis=1)


def knot_rows(
    motions: Sequence[Knots], origin: tuple[float, float, float]
) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Rows of knots for the kernels.

    Parameters
    ----------
    motions : sequence of Knots
    origin : (3,) float
        World space, metres: origin of the coordinates on the device.

    Returns
    -------
    rows : (K, 16) float32
        Those of each motion, one after the other; one row of zeros if there are none.
    places : (n, 2) uint32
        Of each motion, its first row, and the number of ways between its knots.
    """
    rows, places, total = [], [], 0
    for knots in motions:
        row = np.zeros((len(knots.shares), 16))
        row[:, _COLUMNS["ROTATION"] : _COLUMNS["ROTATION"] + 4] = _without_errors(knots.rotations)
        row[:, _COLUMNS["OFFSET"] : _COLUMNS["OFFSET"] + 3] = knots.offsets - np.array(origin)
        some = np.stack([knots.stretches[:, i, k] for i, k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))], axis=1)
        row[:, _COLUMNS["STRETCH"] : _COLUMNS["STRETCH"] + 6] = _without_errors(some)
        row[:, _COLUMNS["TIME"]] = knots.shares
        row[:-1, _COLUMNS["INVERSE_SPAN"]] = 1.0 / np.diff(knots.shares)
        rows.append(row)
        places.append((total, len(row) - 1))
        total += len(row)
    if not rows:
        return np.zeros((1, 16), np.float32), np.zeros((0, 2), np.uint32)
    return np.concatenate(rows).astype(np.float32), np.array(places, np.uint32)


def light_knot_rows(
    motions: Sequence[Knots], origin: tuple[float, float, float]
) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Rows of knots of lights, the first of each with the number of ways between them.

    Parameters
    ----------
    motions : sequence of Knots
    origin : (3,) float
        See `knot_rows`.

    Returns
    -------
    rows : (K, 16) float32
        Of no motion, none.
    firsts : (n,) uint32
        Of each motion, its first row.
    """
    rows, places = knot_rows(motions, origin)
    rows = rows[: len(rows) if motions else 0]
    rows.view(np.uint32)[places[:, 0], _COLUMNS["SEGMENTS"]] = places[:, 1]
    return rows, places[:, 0]


def _without_errors(values: _Floats) -> _Floats:
    largest = np.abs(values).max(axis=1, keepdims=True)
    return np.where(np.abs(values) > _NEGLIGIBLE * largest, values, 0.0)


def swept_boxes(knots: Knots, low: _Floats, high: _Floats) -> tuple[_Floats, _Floats]:
    """Boxes of all places to which a motion takes the points of boxes.

    Between two knots a rotation R(f) is from the mean of both by at most θ²/8, θ being the angle between them, and
    early or late by less than θ³/60; and with the stretch S(f), R(f) S(f) p is from the straight way by at most
    (θ²/8 |S| + θ |dS| / 4) |p|.

    Parameters
    ----------
    knots : Knots
    low, high : (n, 3) float64
        Before the motion.

    Returns
    -------
    low, high : (n, 3) float64
        World space, metres.
    """
    linear = knots.linear
    middle, half = (low + high) / 2.0, (high - low) / 2.0
    size = np.sqrt(inner(np.abs(middle) + half, np.abs(middle) + half))
    centers = inner(middle[None, :, None, :], linear[:, None, :, :]) + knots.offsets[:, None, :]
    extents = inner(half[None, :, None, :], np.abs(linear)[:, None, :, :])
    lows, highs = centers - extents, centers + extents
    beside = np.max(_beside(knots), initial=0.0) * size[:, None]
    reach = np.maximum(np.abs(lows), np.abs(highs)).max(axis=0) + size[:, None]
    room = beside + _ROUNDED * reach
    return lows.min(axis=0) - room, highs.max(axis=0) + room


def _beside(knots: Knots) -> _Floats:
    """(K - 1,) how far a point at distance 1 is from the straight way between two knots, at most."""
    a, b = knots.rotations[:-1], knots.rotations[1:]
    angle = 4.0 * angles_of(np.sqrt(inner(b - a, b - a)), np.sqrt(inner(a + b, a + b)))
    stretch = np.sqrt((knots.stretches * knots.stretches).sum(axis=(1, 2)))
    step = knots.stretches[1:] - knots.stretches[:-1]
    change = np.sqrt((step * step).sum(axis=(1, 2)))
    most = np.maximum(stretch[:-1], stretch[1:])
    return np.asarray(_SAGITTA * angle * angle * most + _SHEARED * angle * change)
