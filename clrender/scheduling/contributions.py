"""Per-worker contributions to a film, which can be subtracted again if a worker turns out to be wrong."""

from __future__ import annotations

from typing import Final

from clrender.film import Film
from clrender.film.unit import Unit, UnitSums

__all__ = ["MOST_BYTES", "Contributions"]

MOST_BYTES: Final = 2 << 30
"""Default limit of the memory of all per-worker films together, bytes."""


class Contributions:
    """One additional film per worker, with that worker's contributions to the main film.

    Sums are exact, so subtracting a worker's film leaves exactly the sums of the others. If these films would take too
    much memory, contributions are not separated: if any worker is found wrong, all units are rendered again. This takes
    one additional film if the main film held samples before, else none.

    Parameters
    ----------
    film : Film
        The main film; it may already hold other samples.
    workers : int
        Number of workers.
    most_bytes : int
        Memory that the per-worker films may take.
    """

    def __init__(self, film: Film, workers: int, most_bytes: int = MOST_BYTES) -> None:
        self._film = film
        self._shared = film.width * film.height * film.pixel_bytes * workers > most_bytes
        self._all = self._shared and not film.ledger.samples
        self._apart: dict[int, Film] = {}
        self._units: dict[int, list[Unit]] = {number: [] for number in range(workers)}

    def commit(self, worker: int, unit: Unit, result: UnitSums) -> int:
        """Commit a worker's unit to the film, and record it; returns the samples, as `Film.commit`."""
        key = 0 if self._shared else worker
        if key not in self._apart and not self._all:
            self._apart[key] = Film(self._film.width, self._film.height, self._film.request)
        samples = self._film.commit(unit, result, self._apart.get(key))
        self._units[worker].append(unit)
        return samples

    def withdraw(self, worker: int) -> dict[int, list[Unit]]:
        """Subtract a worker's contributions from the film; returns the units to render again, by their workers."""
        apart = self._film if self._all else self._apart.pop(0 if self._shared else worker, None)
        if apart is not None:
            self._film.take_out(apart)
        gone = dict.fromkeys(self._units if self._shared else [worker])
        units = {number: self._units[number] for number in gone}
        self._units.update((number, []) for number in gone)
        return units
