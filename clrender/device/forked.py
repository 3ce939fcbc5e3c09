"""Refuses OpenCL in a process that was forked from one that uses it.

Drivers have threads and locks, and after a fork the child has the locks without the threads: it would wait for ever.
"""

from __future__ import annotations

import os

from clrender.errors import DeviceError

__all__ = ["driver_loads", "refuse_forked"]

_loaded = False
_forked = False


def driver_loads() -> None:
    """Note that this process loads a driver."""
    global _loaded
    _loaded = True


def refuse_forked() -> None:
    """Check that this process is no child of one that had loaded a driver.

    Raises
    ------
    DeviceError
    """
    if _forked:
        raise DeviceError(
            "this process was forked from one that had used OpenCL, whose drivers do not survive that; start it by "
            'multiprocessing.get_context("spawn"), or fork it before the first render'
        )


def _in_child() -> None:
    global _forked
    _forked = _forked or _loaded


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_in_child)
