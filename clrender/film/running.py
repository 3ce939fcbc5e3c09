"""A film in the making, which knows whether it is whole, and counts rays as it counts samples."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from clrender.errors import UsageError
from clrender.film.film import Film
from clrender.film.unit import Unit, UnitSums

__all__ = ["RunningFilm"]


class RunningFilm(Film):
    """A film that may be copied at any moment of a render.

    Parameters
    ----------
    width, height, request
        As of `Film`.

    Attributes
    ----------
    changes : int
        How often something came in.
    rays, shadow_rays, max_depth : int
        Of the samples in it, as far as those who brought them said.
    """

    def __init__(self, width: int, height: int, request: Mapping[str, Any] | None = None) -> None:
        super().__init__(width, height, request)
        self.changes = 0
        self.rays = self.shadow_rays = self.max_depth = 0
        self._intact = True

    @property
    def samples_taken(self) -> int:
        """Samples taken so far, accepted or not, over all pixels of the image; any thread may ask during a render."""
        with self._whole:
            return self.ledger.samples

    def take_up(self) -> dict[str, int]:
        """Go on from what the film was loaded with: what its file says of its samples counts, and is returned."""
        told = {name: self.provenance.get(name) for name in ("rays", "shadow_rays", "max_depth")}
        counts = {name: value if isinstance(value, int) and value >= 0 else 0 for name, value in told.items()}
        self.rays, self.shadow_rays, self.max_depth = counts.values()
        return {"samples": self.ledger.samples, **counts}

    def account(self) -> dict[str, Any]:
        """What a file says of the samples so far."""
        samples = self.ledger.samples
        rays = {"rays": self.rays, "shadow_rays": self.shadow_rays, "max_depth": self.max_depth}
        return {"samples": samples, "nonfinite_samples": samples - self.samples, **rays}

    def commit(self, unit: Unit, result: UnitSums, part: Film | None = None) -> int:
        """As of `Film.commit`."""
        with self._changing():
            samples = super().commit(unit, result, part)
            self.rays += result.rays
            self.shadow_rays += result.shadow_rays
            self.max_depth = max(self.max_depth, result.deepest)
        return samples

    def take_out(self, other: Film) -> None:
        """As of `Film.take_out`; of rays it is not known whose they were."""
        with self._changing():
            super().take_out(other)

    def copy_if_whole(self, other: RunningFilm) -> bool:
        """`Film.copy_to`, and the counts of rays; not, where an exception left a part of a unit in the film."""
        with self._whole:
            if self._intact:
                self.copy_to(other)
                other.rays, other.shadow_rays, other.max_depth = self.rays, self.shadow_rays, self.max_depth
                other.changes = self.changes
            return self._intact

    @property
    def intact(self) -> bool:
        """Whether no exception has left a part of a unit in it."""
        with self._whole:
            return self._intact

    @contextmanager
    def _changing(self) -> Iterator[None]:
        """What changes the film; nobody copies meanwhile, nor after an exception."""
        with self._whole:
            self._intact = False
            try:
                yield
            except UsageError:  # the film was left as it was
                self._intact = True
                raise
            self.changes += 1
            self._intact = True
