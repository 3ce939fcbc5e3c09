"""What each worker put into a film, so that it can be taken out again when it turns out to be wrong."""

from __future__ import annotations

from typing import Final

from clrender.film import Film
from clrender.film.unit import Unit, UnitSums

__all__ = ["Contributions"]

_MOST_BYTES: Final = 2 << 30
"""Films of single workers may take so much in all. Beyond, one film holds what came from any of them."""


class Contributions:
    """Beside a film, one for each worker with what that worker put in.

    Sums are exact, so subtracting a worker's film leaves, to the bit, what the others did. Where these films would take
    too much memory, there is one for all workers: whoever is found wrong, all is then done again.

    Parameters
    ----------
    film : Film
        It may hold other samples already.
    workers : int
    """

    def __init__(self, film: Film, workers: int) -> None:
        self._film = film
        self._shared = film.width * film.height * film.pixel_bytes * workers > _MOST_BYTES
        self._apart: dict[int, Film] = {}
        self._units: dict[int, list[Unit]] = {number: [] for number in range(workers)}

    def add(self, worker: int, unit: Unit, result: UnitSums) -> None:
        """Note what a worker put into the film."""
        key = 0 if self._shared else worker
        if key not in self._apart:
            self._apart[key] = Film(self._film.width, self._film.height, self._film.request)
        self._apart[key].commit(unit, result)
        self._units[worker].append(unit)

    def withdraw(self, worker: int) -> dict[int, list[Unit]]:
        """Take what a worker did out of the film; gives the units that are to be done again, by who had done them."""
        apart = self._apart.pop(0 if self._shared else worker, None)
        if apart is not None:
            self._film.take_out(apart)
        gone = dict.fromkeys(self._units if self._shared else [worker])
        units = {number: self._units[number] for number in gone}
        self._units.update((number, []) for number in gone)
        return units
