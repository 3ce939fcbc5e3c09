"""Interface of workers to the scheduler: candidates with a name and a set-up, and workers that render units."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Protocol, TypeGuard

from clrender.film import Film
from clrender.film.held import FilmCopy, HeldUnit
from clrender.film.unit import Unit, UnitSums

__all__ = ["Candidate", "HoldingWorker", "Worker", "can_hold"]


class Worker(Protocol):
    """An object that can render a unit."""

    def render(
        self, unit: Unit, on_slice: Callable[[int, int], None] | None, should_stop: Callable[[], bool] | None
    ) -> UnitSums:
        """Trace the samples of a unit.

        Parameters
        ----------
        unit : Unit
        on_slice : callable, optional
            Called now and then with the numbers of samples and rays since the last call.
        should_stop : callable, optional
            If it returns True, the result so far is returned.

        Raises
        ------
        ClrenderError
            When the device failed. The unit is then not done.
        """


class HoldingWorker(Worker, Protocol):
    """A worker that can keep the sums of its units, and deliver them all at once."""

    def hold(self, film: Film) -> bool:
        """Prepare for `render_held`, with the samples of a film; returns whether that is possible."""

    def render_held(
        self, unit: Unit, on_slice: Callable[[int, int], None] | None, should_stop: Callable[[], bool] | None
    ) -> HeldUnit:
        """Trace the samples of a unit like `render`, and add their sums to those that are held."""

    def copy_held(self, *, sums: bool, image: bool, last: bool) -> FilmCopy:
        """Copy what is held; `sums` and `image` tell what is wanted besides the counts.

        After the last copy nothing is held any more.
        """


@cache
def _holds(kind: type) -> bool:
    return all(hasattr(kind, name) for name in ("hold", "render_held", "copy_held"))


def can_hold(worker: Worker) -> TypeGuard[HoldingWorker]:
    """Whether a worker can keep the sums of its units; once looked up for its type, as it is asked for each image."""
    return _holds(type(worker))


@dataclass
class Candidate:
    """A device, here or on another machine, that may take part in a render.

    Attributes
    ----------
    name : str
        Name in messages and statistics.
    set_up : callable
        Compiles, uploads and builds what the render needs, and returns the worker. It is called in the worker's own
        thread, so if a device fails there with a `ClrenderError`, the others still do the work.
    driver : str
        Driver that compiles its programs: devices of one driver share its errors. Known after the set-up.
    restart : callable, optional
        Called before a new set-up after a failure: releases everything on the device.
    pulse : callable, optional
        See `clrender.device.Device.pulse`; called in any thread.
    lose : callable, optional
        Called when a driver call did not return: the driver must not be called again.
    prove : callable, optional
        Computes something with a known result, and returns whether it is correct.
    present : callable, optional
        Whether the device is present and can be set up; polled until it is. Raises a `ClrenderError` if it never will
        be.
    give_up : callable, optional
        Called when the work is done or no longer needed: `set_up` must stop waiting and return at once.
    elsewhere : bool
        Whether it computes in another process.
    """

    name: str
    set_up: Callable[[], Worker]
    driver: str = ""
    restart: Callable[[], None] | None = None
    pulse: Callable[[], tuple[int, bool]] | None = None
    lose: Callable[[], None] | None = None
    prove: Callable[[], bool] | None = None
    present: Callable[[], bool] | None = None
    give_up: Callable[[], None] | None = None
    elsewhere: bool = False
