"""What a device holds of a film: units whose sums it keeps in its own memory, and copies of all that it has."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

__all__ = ["FilmCopy", "HeldUnit"]


@dataclass(frozen=True)
class HeldUnit:
    """Result of a unit, complete or stopped early, whose sums are added to those that its device holds.

    Attributes
    ----------
    done : (slot_count / BLOCK_SLOTS,) uint32
    rays, shadow_rays, deepest : int
        See `clrender.film.unit.UnitSums`.
    """

    done: npt.NDArray[np.uint32]
    rays: int
    shadow_rays: int
    deepest: int


@dataclass(frozen=True, eq=False)
class FilmCopy:
    """The sums of an image that a device held at one time, also those that it had been given before.

    Attributes
    ----------
    counts : (height, width) uint32
        Accepted samples.
    bands : list of (rows, width, 3, 2) uint64, or None
        See `clrender.film.Film.bands`. None where only the image was wanted.
    squares : list of (rows, width, 3, 4) uint64
        Empty without replicates.
    image : (height, width, 3) float32, or None
        The means of the pixels, if they were wanted.
    base : object
        `version` of the film that the device began with.
    seconds : float
        How long it took.
    version : object
        An object of its own.
    """

    counts: npt.NDArray[np.uint32]
    bands: list[npt.NDArray[np.uint64]] | None
    squares: list[npt.NDArray[np.uint64]]
    image: npt.NDArray[np.float32] | None
    base: object
    seconds: float = 0.0
    version: object = field(default_factory=object)
