"""Refuses OpenCL in a process that was forked from one that uses it.

Drivers have threads and locks, and after a fork the child has the locks without the threads: it would wait for ever.
"""

from __future__ import annotations

import os
from typing import Final

from clrender.errors import DeviceError

__all__ = ["driver_loads", "refuse_forked"]

_users: Final[set[int]] = set()
"""Process that has loaded a driver. A forked child inherits it."""


def driver_loads() -> None:
    """Note that this process loads a driver."""
    _users.add(os.getpid())


def refuse_forked() -> None:
    """Check that this process is no child of one that had loaded a driver.

    Raises
    ------
    DeviceError
    """
    if _users and os.getpid() not in _users:
        raise DeviceError(
            "this process was forked from one that had used OpenCL, whose drivers do not survive that; start it by "
            'multiprocessing.get_context("spawn"), or fork it before the first render'
        )
