"""What each worker put into a film, so that it can be taken out again when it turns out to be wrong."""

from __future__ import annotations

from typing import Final

from clrender.film import Film
from clrender.film.unit import Unit, UnitSums

__all__ = ["MOST_BYTES", "Contributions"]

MOST_BYTES: Final = 2 << 30
"""Films of single workers may take so much in all, unless less is allowed."""


class Contributions:
    """Beside a film, one for each worker with what that worker put in.

    Sums are exact, so subtracting a worker's film leaves, to the bit, what the others did. Where these films would take
    too much memory, nobody's samples are told apart: whoever is found wrong, all is then done again. That takes one
    film where some samples are from before, and else none.

    Parameters
    ----------
    film : Film
        It may hold other samples already.
    workers : int
    most_bytes : int
        Memory that films of single workers may take.
    """

    def __init__(self, film: Film, workers: int, most_bytes: int = MOST_BYTES) -> None:
        self._film = film
        self._shared = film.width * film.height * film.pixel_bytes * workers > most_bytes
        self._all = self._shared and not film.ledger.samples
        self._apart: dict[int, Film] = {}
        self._units: dict[int, list[Unit]] = {number: [] for number in range(workers)}

    def commit(self, worker: int, unit: Unit, result: UnitSums) -> int:
        """Put what a worker did into the film, as `Film.commit` does, and note it."""
        key = 0 if self._shared else worker
        if key not in self._apart and not self._all:
            self._apart[key] = Film(self._film.width, self._film.height, self._film.request)
        samples = self._film.commit(unit, result, self._apart.get(key))
        self._units[worker].append(unit)
        return samples

    def withdraw(self, worker: int) -> dict[int, list[Unit]]:
        """Take what a worker did out of the film; gives the units that are to be done again, by who had done them."""
        apart = self._film if self._all else self._apart.pop(0 if self._shared else worker, None)
        if apart is not None:
            self._film.take_out(apart)
        gone = dict.fromkeys(self._units if self._shared else [worker])
        units = {number: self._units[number] for number in gone}
        self._units.update((number, []) for number in gone)
        return units
