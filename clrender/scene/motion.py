"""Where what moves is at a time: keys of transforms and of cameras, interpolated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from clrender.exact.angles import angle_of, arccosine
from clrender.exact.elementary import sines_cosines
from clrender.exact.matrices import inner, product
from clrender.scene.poses import MotionKey
from clrender.scene.transforms import Affine, affine

if TYPE_CHECKING:
    from clrender.scene.values import Vector

__all__ = [
    "Path",
    "Track",
    "aligned",
    "matrices_of",
    "polar",
    "quaternion_of",
    "rests",
    "slerp",
]

_Floats = npt.NDArray[np.float64]
_NEWTON_STEPS: Final = 60
_CONVERGED: Final = 1e-15
"""Steps halve the stretch of a matrix until its axes differ little, and then square their difference from 1."""
_SMALL_ANGLE: Final = 1e-4
_HALF_DEGREE: Final = math.pi / 360.0


@dataclass(frozen=True)
class Path:
    """Maps at times: a point p goes to R S p + offset.

    Attributes
    ----------
    rotations : (n, 4) float64
        Unit quaternions R, the scalar last, each within half a turn of the one before.
    stretches : (n, 3, 3) float64
        Symmetric matrices S.
    offsets : (n, 3) float64
        Metres.
    """

    rotations: _Floats
    stretches: _Floats
    offsets: _Floats

    @property
    def linear(self) -> _Floats:
        """(n, 3, 3) products of R and S."""
        return product(matrices_of(self.rotations), self.stretches)


def matrices_of(quaternions: _Floats) -> _Floats:
    """Rotation matrices, (..., 3, 3), of unit quaternions (..., 4), the scalar last."""
    x, y, z, w = (quaternions[..., k] for k in range(4))
    rows = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternion_of(rotation: npt.ArrayLike) -> _Floats:
    """Unit quaternion, the scalar last and not negative, of a rotation matrix (Shepperd 1978).

    Parameters
    ----------
    rotation : (3, 3) floats
    """
    m = np.asarray(rotation, np.float64)
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    largest = int(np.argmax([m[0, 0], m[1, 1], m[2, 2], trace]))
    if largest == 3:
        found = np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], 1.0 + trace])
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        found = np.empty(4)
        found[i] = 1.0 + m[i, i] - m[j, j] - m[k, k]
        found[j], found[k] = m[j, i] + m[i, j], m[k, i] + m[i, k]
        found[3] = m[k, j] - m[j, k]
    return _units(found * (-1.0 if found[3] < 0.0 else 1.0))


def _units(vectors: _Floats) -> _Floats:
    return np.asarray(vectors / np.sqrt(inner(vectors, vectors))[..., None])


def polar(matrix: _Floats) -> tuple[_Floats, _Floats]:
    """Rotation and symmetric stretch whose product is a matrix of positive determinant.

    By Newton's method (Higham, "Computing the polar decomposition - with applications", 1986).

    Parameters
    ----------
    matrix : (3, 3) float64

    Returns
    -------
    rotation, stretch : (3, 3) float64
    """
    size = float(np.abs(matrix).max())
    rows = [[each / size for each in row] for row in matrix.tolist()]
    for _ in range(_NEWTON_STEPS):
        (a, b, c), (d, e, f), (g, h, i) = rows
        cofactors = (
            (e * i - f * h, f * g - d * i, d * h - e * g),
            (c * h - b * i, a * i - c * g, b * g - a * h),
            (b * f - c * e, c * d - a * f, a * e - b * d),
        )
        volume = a * cofactors[0][0] + b * cofactors[0][1] + c * cofactors[0][2]
        pairs = zip(rows, cofactors, strict=True)
        after = [[0.5 * (x + y / volume) for x, y in zip(row, column, strict=True)] for row, column in pairs]
        change = max(abs(x - y) for row, new in zip(rows, after, strict=True) for x, y in zip(row, new, strict=True))
        rows = after
        if change < _CONVERGED:
            break
    rotation = np.array(rows)
    stretch = product(rotation.T, matrix)
    return rotation, 0.5 * (stretch + stretch.T)


def slerp(a: _Floats, b: _Floats, shares: _Floats) -> _Floats:
    """Spherical linear interpolation of unit quaternions, along the shorter arc (Shoemake 1985).

    Parameters
    ----------
    a, b : (4,) float64
    shares : (n,) float64
        From `a`, 0, to `b`, 1.

    Returns
    -------
    (n, 4) float64
    """
    b = -b if float(inner(a, b)) < 0.0 else b
    # The angle from the lengths of sum and difference, which are exact for small ones
    half = 2.0 * angle_of(float(np.sqrt(inner(b - a, b - a))), float(np.sqrt(inner(a + b, a + b))))
    if half < _SMALL_ANGLE:
        return _units(a + shares[:, None] * (b - a))
    angles = np.concatenate([(1.0 - shares) * half, shares * half])
    first, second = np.split(sines_cosines(angles)[0], 2)
    return _units(first[:, None] * a + second[:, None] * b)


def _product_of_quaternions(a: _Floats, b: _Floats) -> _Floats:
    """The rotation `b` first, then `a`; (n, 4) each."""
    (ax, ay, az, aw), (bx, by, bz, bw) = a.T, b.T
    return np.stack(
        [
            (aw * bx + ax * bw) + (ay * bz - az * by),
            (aw * by + ay * bw) + (az * bx - ax * bz),
            (aw * bz + az * bw) + (ax * by - ay * bx),
            (aw * bw - ax * bx) - (ay * by + az * bz),
        ],
        axis=1,
    )


def _of_angles(degrees: _Floats) -> _Floats:
    """Quaternions (n, 4) of rotations about x, then y, then z, by (n, 3) degrees."""
    sines, cosines = sines_cosines(degrees * _HALF_DEGREE)
    about = []
    for axis in range(3):
        turned = np.zeros((len(degrees), 4))
        turned[:, axis], turned[:, 3] = sines[:, axis], cosines[:, axis]
        about.append(turned)
    return _product_of_quaternions(about[2], _product_of_quaternions(about[1], about[0]))


def rests(keys: Sequence[MotionKey], begin: float, end: float) -> Affine | None:
    """The map of a motion that does not change between two times; None if it does.

    Parameters
    ----------
    keys : sequence of MotionKey
        In the order of their times, at least one.
    begin, end : float
        Seconds.
    """
    times = [key.time for key in keys]
    if begin == end:
        return _map_at(tuple(keys), begin)
    first = max((index for index, time in enumerate(times) if time <= begin), default=0)
    last = min((index for index, time in enumerate(times) if time >= end), default=len(keys) - 1)
    same = affine(keys[first])
    return same if all(_equal(keys[first], key) for key in keys[first : last + 1]) else None


def _equal(a: MotionKey, b: MotionKey) -> bool:
    """Whether the motion rests between two keys: equal maps do not say so, as a rotation may be whole turns."""
    by_parts = a.matrix is None and b.matrix is None
    if by_parts:
        return (a.translate, a.rotate_degrees, a.scale) == (b.translate, b.rotate_degrees, b.scale)
    return affine(a) == affine(b)


@lru_cache(maxsize=4096)
def _map_at(keys: tuple[MotionKey, ...], time: float) -> Affine:
    """The map at one time; that of a key itself there, and before the first and after the last one."""
    before = [key for key in keys if key.time <= time]
    after = [key for key in keys if key.time >= time]
    if not before or not after or before[-1] is after[0]:
        return affine(before[-1] if before else after[0])
    if _equal(before[-1], after[0]):
        return affine(before[-1])
    track = Track(keys)
    path = track.at(np.array([time]))
    linear = (track.sign * path.linear[0]).tolist()
    rows: tuple[Vector, Vector, Vector] = tuple(tuple(row) for row in linear)  # type: ignore[assignment]
    return Affine(rows, tuple(path.offsets[0].tolist()))


class Track:
    """The motion of a transform.

    Parameters
    ----------
    keys : sequence of MotionKey
        In the order of their times, at least one.

    Attributes
    ----------
    times : (n,) float64
        Of its keys, seconds.
    sign : float
        -1 if its maps mirror, else 1: the factor of the linear part of the `Path`, whose determinant is positive.
    """

    def __init__(self, keys: Sequence[MotionKey]) -> None:
        self._keys = tuple(keys)
        self.times = np.array([key.time for key in keys])
        self.sign = -1.0 if affine(keys[0]).determinant < 0.0 else 1.0
        self._offsets = np.array([affine(key).offset for key in keys])
        self._degrees = np.array([key.rotate_degrees for key in keys])
        self._scales = self.sign * np.array([key.scale for key in keys])
        self._parts: dict[int, tuple[_Floats, _Floats]] = {}

    def _by_parts(self, index: int) -> bool:
        """Whether between this key and the next one translation, rotation and scale are interpolated."""
        return self._keys[index].matrix is None and self._keys[index + 1].matrix is None

    def _part(self, index: int) -> tuple[_Floats, _Floats]:
        """Quaternion and stretch of a key that has no part in an interpolation by parts."""
        if index not in self._parts:
            rotation, stretch = polar(self.sign * np.array(affine(self._keys[index]).linear))
            self._parts[index] = quaternion_of(rotation), stretch
        return self._parts[index]

    def turning(self, index: int) -> float:
        """Largest angle by which it turns between a key and the next one, radians."""
        if self._by_parts(index):
            turned = np.abs(self._degrees[index + 1] - self._degrees[index])
            return float(turned[0] + turned[1] + turned[2]) * 2.0 * _HALF_DEGREE
        a, b = self._part(index)[0], self._part(index + 1)[0]
        cosine = min(abs(float(inner(a, b))), 1.0)
        return 2.0 * arccosine(cosine)

    def at(self, times: _Floats) -> Path:
        """The maps at times.

        Parameters
        ----------
        times : (n,) float64
            Seconds, ascending.
        """
        count = len(self.times)
        index = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, max(count - 2, 0))
        rotations, stretches = np.empty((len(times), 4)), np.empty((len(times), 3, 3))
        offsets = np.empty((len(times), 3))
        for begin in np.unique(index).tolist():
            some = np.flatnonzero(index == begin)
            if count == 1:
                (rotations[some], stretches[some]), offsets[some] = self._part(0), self._offsets[0]
                continue
            span = self.times[begin + 1] - self.times[begin]
            shares = np.clip((times[some] - self.times[begin]) / span, 0.0, 1.0)
            between = shares[:, None]
            offsets[some] = _mixed(self._offsets, begin, between)
            if self._by_parts(begin):
                rotations[some] = _of_angles(_mixed(self._degrees, begin, between))
                scales = _mixed(self._scales, begin, between)
                stretches[some] = scales[:, :, None] * np.eye(3)
            else:
                (first, before), (last, after) = self._part(begin), self._part(begin + 1)
                rotations[some] = slerp(first, last, shares)
                stretches[some] = (1.0 - between[:, :, None]) * before + between[:, :, None] * after
        return Path(aligned(rotations), stretches, offsets)


def _mixed(values: _Floats, index: int, shares: _Floats) -> _Floats:
    return np.asarray((1.0 - shares) * values[index] + shares * values[index + 1])


def aligned(rotations: _Floats) -> _Floats:
    """Quaternions (n, 4), each of two for its rotation the one nearer to that before."""
    turned = inner(rotations[1:], rotations[:-1]) < 0.0
    signs = np.where(np.cumsum(turned) % 2 == 1, -1.0, 1.0)
    return np.concatenate([rotations[:1], rotations[1:] * signs[:, None]])
