"""Keys of a camera's motion, and where the camera is between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, TypeAlias

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, FailFast, Field

from clrender.exact.angles import arccosine
from clrender.exact.matrices import inner
from clrender.scene.motion import aligned, matrices_of, quaternion_of, slerp
from clrender.scene.poses import KEY_LIMIT, Seconds, ascending
from clrender.scene.values import Part, Vector

__all__ = ["CameraKey", "CameraMotion", "CameraTrack"]

_Floats = npt.NDArray[np.float64]


class CameraKey(Part):
    """Where a moving camera is at a time. Positions are interpolated linearly, and rotations along the shortest way."""

    time: Seconds = Field(description="seconds")
    position: Vector | None = Field(None, description="metres, world space; default: the camera's own")
    target: Vector | None = Field(None, description="the same of the point at the centre of the image")
    up: Vector | None = Field(None, description="the same of the up direction")


CameraMotion: TypeAlias = Annotated[
    tuple[CameraKey, ...], FailFast(), Field(max_length=KEY_LIMIT), AfterValidator(ascending)
]


@dataclass(frozen=True)
class CameraTrack:
    """The motion of a camera.

    Attributes
    ----------
    times : (n,) float64
        Of its keys, seconds.
    positions : (n, 3) float64
        World space, metres.
    rotations : (n, 4) float64
        Unit quaternions, the scalar last, of the rotations whose columns are right, up and backward.
    distances : (n,) float64
        To the targets, metres.
    """

    times: _Floats
    positions: _Floats
    rotations: _Floats
    distances: _Floats

    @classmethod
    def of(
        cls,
        times: Sequence[float],
        positions: Sequence[Vector],
        axes: Sequence[tuple[Vector, Vector, Vector]],
        distances: Sequence[float],
    ) -> CameraTrack:
        """The motion through poses: `axes` are right, up and forward, unit vectors; the others as in the attributes."""
        frames = [np.stack([right, up, -np.array(forward)], axis=1) for right, up, forward in axes]
        rotations = aligned(np.stack([quaternion_of(frame) for frame in frames]))
        return cls(np.array(times), np.array(positions), rotations, np.array(distances))

    def turning(self, index: int) -> float:
        """Angle by which the camera turns between a key and the next one, radians."""
        return 2.0 * arccosine(min(abs(float(inner(self.rotations[index], self.rotations[index + 1]))), 1.0))

    def at(self, times: _Floats) -> tuple[_Floats, _Floats, _Floats]:
        """Rotations, positions and distances of the target at times; shapes as in the attributes.

        Parameters
        ----------
        times : (n,) float64
            Seconds, ascending.
        """
        count = len(self.times)
        if count == 1:
            same = [np.repeat(each, len(times), axis=0) for each in (self.rotations, self.positions, self.distances)]
            return same[0], same[1], same[2]
        index = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, count - 2)
        shares = np.clip((times - self.times[index]) / (self.times[index + 1] - self.times[index]), 0.0, 1.0)
        rotations = np.empty((len(times), 4))
        for begin in np.unique(index).tolist():
            some = np.flatnonzero(index == begin)
            rotations[some] = slerp(self.rotations[begin], self.rotations[begin + 1], shares[some])
        rest = (1.0 - shares)[:, None]
        positions = rest * self.positions[index] + shares[:, None] * self.positions[index + 1]
        distances = rest[:, 0] * self.distances[index] + shares * self.distances[index + 1]
        return aligned(rotations), positions, distances

    def pose(self, time: float) -> tuple[Vector, Vector, Vector]:
        """Position, target and up direction at one time."""
        rotations, positions, distances = self.at(np.array([time]))
        frame, position = matrices_of(rotations[0]), positions[0]
        target = position - float(distances[0]) * frame[:, 2]
        return _vector(position), _vector(target), _vector(frame[:, 1])


def _vector(values: _Floats) -> Vector:
    x, y, z = values.tolist()
    return (x, y, z)
