"""The devices of a render as a team of workers, each set up once and all released together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from clrender.device.kernel_build import most_lanes
from clrender.device.worker import DeviceWorker
from clrender.errors import UsageError
from clrender.process.memory import unit_slots
from clrender.scheduling.member import Member
from clrender.scheduling.worker import Candidate

if TYPE_CHECKING:
    from clrender.device.device import Device
    from clrender.settings import RenderSettings

__all__ = ["DeviceTeam", "check_lanes", "member", "most_slots"]


_SUMS_BYTES: Final = 96
"""Bytes of a slot in the largest buffer: the sums of its squared replicates."""


def most_slots(devices: Sequence[Device], limit: int | None, replicates: bool = False) -> int:
    """Most slots of a unit that fit on every device, if each may use `limit` bytes (None: no limit)."""
    room = min((device.max_allocation_bytes // _SUMS_BYTES for device in devices), default=1 << 31)
    allowed = unit_slots(limit, replicates)
    return room if allowed is None else min(room, allowed)


class DeviceTeam:
    """A `clrender.rendering.team.Team` of this process's devices; on exit it releases its workers.

    Parameters
    ----------
    devices : sequence of Device
    make : callable
        Sets a device up for the render.
    restart : callable, optional
        Resets a device that failed, so that it can be set up again.
    prove : callable, optional
        Has a device compute something with a known result; returns whether it is correct.
    """

    limits = None

    def __init__(
        self,
        devices: Sequence[Device],
        make: Callable[[Device], DeviceWorker],
        restart: Callable[[Device], None] | None = None,
        prove: Callable[[Device], bool] | None = None,
    ) -> None:
        self._devices = devices
        self._make = make
        self._restart = restart
        self._prove = prove
        self._made: dict[int, DeviceWorker] = {}

    def __enter__(self) -> DeviceTeam:
        return self

    def __exit__(self, *details: Any) -> None:
        while self._made:
            number, worker = self._made.popitem()
            if not self._devices[number].lost:
                worker.release()

    @property
    def candidates(self) -> list[Candidate]:
        """Candidates in the order of the devices. A candidate that is set up twice returns the same worker."""
        return [self._candidate(number, device) for number, device in enumerate(self._devices) if not device.lost]

    @property
    def workers(self) -> dict[int, DeviceWorker]:
        """The workers that could be set up, by the index of their device."""
        return dict(self._made)

    def members(self) -> list[Member | None]:
        """See `clrender.rendering.team.Team.members`; none is None here."""
        return [member(device, self._made.get(number)) for number, device in enumerate(self._devices)]

    def stats(self) -> Mapping[str, Any]:
        """No further entries for the statistics."""
        return {}

    def _candidate(self, number: int, device: Device) -> Candidate:
        return Candidate(
            device.info.title,
            partial(self._worker, number, device),
            driver=f"{device.info.platform} {device.info.version} {device.info.driver}",
            restart=partial(self._start_over, number, device),
            pulse=device.pulse,
            lose=device.lose,
            prove=None if self._prove is None else partial(self._prove, device),
        )

    def _worker(self, number: int, device: Device) -> DeviceWorker:
        if number not in self._made:
            worker = self._make(device)
            if device.lost:
                return worker  # the call returned too late, and another thread may use the device now
            self._made[number] = worker
        return self._made[number]

    def _start_over(self, number: int, device: Device) -> None:
        worker = self._made.pop(number, None)
        if worker is not None:
            worker.release()
        if self._restart is not None:
            self._restart(device)


def member(device: Device, worker: DeviceWorker | None = None) -> Member:
    """The entry of a device in the statistics."""
    info, driver = device.info, f"{device.info.platform} {device.info.driver}"
    busy, build = (worker.busy_seconds, worker.build_seconds) if worker is not None else (0.0, 0.0)
    return Member(info.name, driver, info.type, busy, build, device.compile_seconds, device.allocated_bytes)


def check_lanes(settings: RenderSettings, devices: Sequence[Device]) -> None:
    """Check that no device supports fewer lanes than requested.

    Raises
    ------
    UsageError
    """
    for device in devices:
        if (settings.lanes or 1) > (limit := most_lanes(device)):
            raise UsageError(
                f"lanes is {settings.lanes}; {device.info.title} takes at most {limit}: leave it out, or choose "
                "another device"
            )
