"""The devices of a session as a team of workers for one job, with the same interface as the workers of a cluster."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from clrender.device import Device
from clrender.device.preparation import Prepared
from clrender.device.probe import passes_probe
from clrender.device.worker import DeviceWorker, LaunchConfig, most_lanes
from clrender.errors import UsageError
from clrender.scheduling.cluster import Member
from clrender.scheduling.pool import WorkerPool
from clrender.scheduling.worker import Candidate

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from clrender.session import Session
    from clrender.settings import RenderSettings

__all__ = ["DeviceTeam", "check_lanes", "member"]


class DeviceTeam:
    """A `clrender.scheduling.cluster.Team` and a context manager; on exit it releases its workers.

    Parameters
    ----------
    session : Session
    prepared : Prepared
        The integrator's scene and kernels, after its preparation.
    settings : (1,) `Settings`
    launch : LaunchConfig
    on_ready : callable
        Called, in any thread, after each device is set up.
    """

    limits = None

    def __init__(
        self,
        session: Session,
        prepared: Prepared,
        settings: npt.NDArray[np.void],
        launch: LaunchConfig,
        on_ready: Callable[[], None],
    ) -> None:
        self._devices = session.devices
        make = partial(
            session.worker,
            flat=prepared.flat,
            settings=settings,
            pipeline=prepared.pipeline,
            launch=launch,
            on_device=prepared.on_device,
        )

        def ready(device: Device) -> DeviceWorker:
            worker = make(device)
            on_ready()
            return worker

        self._pool = WorkerPool(self._devices, ready, session.restart, passes_probe)

    def __enter__(self) -> DeviceTeam:
        return self

    def __exit__(self, *details: Any) -> None:
        self._pool.__exit__(*details)

    @property
    def candidates(self) -> Sequence[Candidate]:
        """One candidate for each device."""
        return self._pool.candidates

    def members(self) -> list[Member | None]:
        """See `clrender.scheduling.cluster.Team.members`; none is None here."""
        workers = self._pool.workers
        return [member(device, workers.get(number)) for number, device in enumerate(self._devices)]

    def stats(self) -> Mapping[str, Any]:
        """No further entries for the statistics."""
        return {}


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
