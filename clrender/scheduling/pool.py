"""The devices of a render as workers, each set up once and all released together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from clrender.scheduling.worker import Candidate

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.device.worker import DeviceWorker

__all__ = ["WorkerPool"]


class WorkerPool:
    """Workers on some devices; a context manager that releases those that were made.

    Parameters
    ----------
    devices : sequence of Device
    make : callable
        Sets a device up for the render.

    Attributes
    ----------
    candidates : list of Candidate
        In the order of the devices. A candidate that is asked again gives the worker it made.
    """

    def __init__(self, devices: Sequence[Device], make: Callable[[Device], DeviceWorker]) -> None:
        self._make = make
        self._made: dict[int, DeviceWorker] = {}
        self.candidates = [
            Candidate(device.info.title, partial(self._worker, number, device)) for number, device in enumerate(devices)
        ]

    def __enter__(self) -> WorkerPool:
        return self

    def __exit__(self, *details: Any) -> None:
        while self._made:
            self._made.popitem()[1].release()

    @property
    def workers(self) -> dict[int, DeviceWorker]:
        """Those that could be set up, by the place of their device."""
        return dict(self._made)

    def _worker(self, number: int, device: Device) -> DeviceWorker:
        if number not in self._made:
            self._made[number] = self._make(device)
        return self._made[number]
