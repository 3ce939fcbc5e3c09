"""Refuses OpenCL in a process that was forked from one that uses it.

Drivers have threads and locks, and after a fork the child has the locks without the threads: it would wait for ever.
"""

from __future__ import annotations

import os

from clrender.errors import DeviceError

__all__ = ["driver_loads", "refuse_forked"]


class _Process:
    """What this process inherited, and what it did itself. To ask for its number at each call takes a system call."""

    def __init__(self) -> None:
        self.uses_drivers = self.was_forked = False

    def forked(self) -> None:
        """Note that it is a forked child, if its parent had loaded a driver."""
        self.was_forked = self.uses_drivers or self.was_forked
        self.uses_drivers = False


_process = _Process()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_process.forked)


def driver_loads() -> None:
    """Note that this process loads a driver."""
    _process.uses_drivers = True


def refuse_forked() -> None:
    """Check that this process is no child of one that had loaded a driver.

    Raises
    ------
    DeviceError
    """
    if _process.was_forked:
        raise DeviceError(
            "this process was forked from one that had used OpenCL, whose drivers do not survive that; start it by "
            'multiprocessing.get_context("spawn"), or fork it before the first render'
        )
