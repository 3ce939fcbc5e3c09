"""A film in progress, which knows whether it is consistent, and counts rays in addition to samples."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from clrender.film.accumulate import Sums
from clrender.film.film import Film
from clrender.film.held import FilmCopy, HeldUnit
from clrender.film.unit import Unit, UnitSums

__all__ = ["RunningFilm"]


class RunningFilm(Film):
    """A film that may be copied at any time during a render.

    Parameters
    ----------
    width, height, request
        See `Film`.

    Attributes
    ----------
    changes : int
        Number of changes of its contents.
    rays, shadow_rays, max_depth : int
        Counts of its samples, as far as they were reported.
    """

    def __init__(self, width: int, height: int, request: Mapping[str, Any] | None = None) -> None:
        super().__init__(width, height, request)
        self.changes = 0
        self.rays = self.shadow_rays = self.max_depth = 0

    @property
    def samples_taken(self) -> int:
        """Samples taken so far, accepted or not, over all pixels of the image. Safe in any thread during a render."""
        with self._whole:
            return self.ledger.samples

    def take_up(self) -> dict[str, int]:
        """Resume a loaded film: take over, and return, the counts in its file's provenance."""
        told = {name: self.provenance.get(name) for name in ("rays", "shadow_rays", "max_depth")}
        counts = {name: value if isinstance(value, int) and value >= 0 else 0 for name, value in told.items()}
        self.rays, self.shadow_rays, self.max_depth = counts.values()
        return {"samples": self.ledger.samples, **counts}

    def account(self) -> dict[str, Any]:
        """Counts of the samples so far, for the provenance of a file."""
        samples = self.ledger.samples
        rays = {"rays": self.rays, "shadow_rays": self.shadow_rays, "max_depth": self.max_depth}
        return {"samples": samples, "nonfinite_samples": samples - self.samples, **rays}

    def commit(self, unit: Unit, result: UnitSums, part: Film | None = None) -> int:
        """See `Film.commit`."""
        with self._whole:
            samples = super().commit(unit, result, part)
            self._count(result)
        return samples

    def receive(self, delivered: FilmCopy, units: Sequence[tuple[Unit, HeldUnit]]) -> None:
        """See `Film.receive`."""
        with self._whole:
            super().receive(delivered, units)
            for _, result in units:
                self._count(result)

    def _count(self, result: UnitSums | HeldUnit) -> None:
        self.rays += result.rays
        self.shadow_rays += result.shadow_rays
        self.max_depth = max(self.max_depth, result.deepest)

    def copy_if_whole(self, other: RunningFilm) -> bool:
        """Copy the film and its counts of rays; returns False if an exception left a part of a unit in it."""
        with self._whole:
            if self._intact:
                self.copy_to(other)
                self._tell(other)
            return self._intact

    def as_received(self) -> RunningFilm:
        """A film with what a device has delivered so far, to be read only: it shares the arrays of this one.

        A device that holds the film delivers new arrays each time, so these do not change.
        """
        other = RunningFilm(self.width, self.height, self.request)
        with self._whole:
            self._share(other)
            self._tell(other)
        return other

    def _tell(self, other: RunningFilm) -> None:
        other.rays, other.shadow_rays, other.max_depth = self.rays, self.shadow_rays, self.max_depth
        other.changes = self.changes

    @property
    def intact(self) -> bool:
        """Whether no exception has left a part of a unit in the film."""
        with self._whole:
            return self._intact

    @contextmanager
    def _changing(self) -> Iterator[list[Sums]]:
        with super()._changing() as bands:
            yield bands
        self.changes += 1
