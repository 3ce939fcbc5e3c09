"""What the statistics of a render say of a worker."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Member"]


@dataclass(frozen=True)
class Member:
    """Entry of a worker in the statistics of a render, in addition to its tally.

    Attributes
    ----------
    name, driver, type : str
        Name, driver and type of its device.
    busy_seconds, build_seconds, compile_seconds : float
    device_bytes : int
        Memory allocated on the device.
    host : str
        Machine, if it is not this one or there are several processes.
    """

    name: str
    driver: str
    type: str
    busy_seconds: float = 0.0
    build_seconds: float = 0.0
    compile_seconds: float = 0.0
    device_bytes: int = 0
    host: str = ""
