"""What scheduling knows of a worker: its name, that it can be set up, and that it then does units of work."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from clrender.film.unit import Unit, UnitSums

__all__ = ["Candidate", "Worker"]


class Worker(Protocol):
    """Whatever can do a unit."""

    def render(
        self, unit: Unit, on_slice: Callable[[int, int], None] | None, should_stop: Callable[[], bool] | None
    ) -> UnitSums:
        """Trace the samples of a unit.

        Parameters
        ----------
        unit : Unit
        on_slice : callable, optional
            Told now and then how many samples and rays were added since it was last told.
        should_stop : callable, optional
            When it says yes, what is done so far is returned.

        Raises
        ------
        ClrenderError
            When the device failed. The unit then counts as not done.
        """


@dataclass
class Candidate:
    """A device, here or on another machine, that may take part in a render.

    Attributes
    ----------
    name : str
        For messages and statistics.
    set_up : callable
        Compiles, uploads and builds what the render needs, and gives the worker. It is called in the worker's own
        thread: one device that fails there, with a `ClrenderError`, leaves the others to do the work.
    driver : str
        Whose compiler makes its programs: devices of one driver make the same mistakes. Known once it is set up.
    restart : callable, optional
        Before it is set up once more after a failure: forget what was on the device.
    pulse : callable, optional
        As `clrender.device.Device.pulse`; asked in any thread.
    lose : callable, optional
        A call never came back: ask the driver for nothing more.
    prove : callable, optional
        Do something whose result is known, and say whether that came out.
    present : callable, optional
        Whether it is there to be set up; asked until it is. Raises a `ClrenderError` when it never will be.
    give_up : callable, optional
        The work is done, or nobody wants it any more: whatever `set_up` is waiting for, it is to return at once.
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
