"""The part that runs inside a Dask worker: an actor that holds one job on the worker's device.

An actor is an object in the worker's process whose methods a client calls directly, without the scheduler. Dask never
repeats such a call by itself. Coroutine methods are answered even while another method computes.
"""

from __future__ import annotations

import functools
import os
import socket
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeVar

from clrender.device import Device
from clrender.device.team import DeviceTeam
from clrender.device.worker import DeviceWorker
from clrender.errors import ClrenderError, DeviceError, DeviceFailure, RenderError
from clrender.film.unit import Unit, UnitSums
from clrender.process.heap import return_large_blocks
from clrender.rendering.job import RenderJob
from clrender.rendering.session import Session
from clrender.scheduling.worker import Candidate

__all__ = ["Answer", "Described", "RemoteRenderer", "State"]

_MOST_ASSET_BYTES: Final = 2 << 30
"""Most bytes of assets that are kept for the next job."""

_Spec = tuple[str | int, ...] | None
_Method = TypeVar("_Method", bound=Callable[..., Any])


@dataclass(frozen=True)
class Described:
    """A worker's device after its set-up; for the attributes see `clrender.scheduling.member.Member`."""

    device: str
    driver: str
    version: str
    type: str
    host: str
    process: int
    build_seconds: float
    compile_seconds: float
    device_bytes: int


@dataclass(frozen=True)
class State:
    """State of a worker: any change of it is a sign of life.

    Attributes
    ----------
    calls : int
    compiling : bool
        See `clrender.device.Device.pulse`.
    busy_seconds : float
        Time in launches.
    """

    calls: int = 0
    compiling: bool = False
    busy_seconds: float = 0.0


@dataclass(frozen=True)
class Answer:
    """Result of a unit, and the state of the worker after it."""

    value: UnitSums
    state: State


def answered(method: _Method) -> _Method:
    """Return errors as answers, so that only the message is transferred and Dask reports no traceback."""

    @functools.wraps(method)
    def wrapped(*arguments: Any) -> Any:
        try:
            return method(*arguments)
        except ClrenderError as error:
            kind = next(
                each for each in (DeviceFailure, DeviceError, RenderError, ClrenderError) if isinstance(error, each)
            )
            return kind(str(error))
        except MemoryError:
            return DeviceFailure("there is not enough memory")
        except Exception as error:
            return RenderError(f"{type(error).__name__}: {error}")

    return wrapped  # type: ignore[return-value]


class _Kept:
    """State kept in the worker's process between jobs: a session, and assets by hash."""

    def __init__(self) -> None:
        self.assets: dict[str, bytes] = {}
        self._session: tuple[_Spec, Session] | None = None
        self._lock = threading.Lock()

    def take_session(self, spec: _Spec) -> Session:
        """The session of the last job if it is for the same device and not in use, else a new one."""
        with self._lock:
            kept, self._session = self._session, None
        if kept is not None and kept[0] == spec:
            return kept[1]
        if kept is not None:
            kept[1].close()
        return Session(None if spec is None else list(spec))

    def keep_session(self, spec: _Spec, session: Session) -> None:
        """Keep a session for the next job."""
        with self._lock:
            before, self._session = self._session, (spec, session)
        if before is not None:
            before[1].close()

    def keep_assets(self, hashes: Sequence[str]) -> None:
        """Drop all other assets, and these too if they are too large."""
        with self._lock:
            kept = {name: self.assets[name] for name in hashes if name in self.assets}
            self.assets = kept if sum(map(len, kept.values())) <= _MOST_ASSET_BYTES else {}


_KEPT: Final = _Kept()


class RemoteRenderer:
    """A job on the device of a worker's process.

    Parameters
    ----------
    spec : tuple of str or int, or None
        The device; see `Session`.
    """

    def __init__(self, spec: _Spec = None) -> None:
        return_large_blocks()
        self._spec = spec
        self._session: Session | None = None
        self._team: DeviceTeam | None = None
        self._device: Device | None = None
        self._worker: DeviceWorker | None = None
        self._prepared: tuple[str, Described] | None = None
        self._stopped = False

    def __del__(self) -> None:
        self._release()
        if self._session is not None:
            _KEPT.keep_session(self._spec, self._session)

    async def state(self) -> State:
        """State of the worker."""
        return self._state()

    def _state(self) -> State:
        calls, compiling = self._device.pulse() if self._device is not None else (0, False)
        return State(calls, compiling, self._worker.busy_seconds if self._worker is not None else 0.0)

    async def stop(self) -> None:
        """Stop units in progress, which then return partial results."""
        self._stopped = True

    async def lacks(self, hashes: Sequence[str]) -> list[str]:
        """Hashes of the assets that are missing here."""
        return [name for name in hashes if name not in _KEPT.assets]

    async def take(self, assets: Mapping[str, bytes]) -> None:
        """Receive assets, by hash."""
        _KEPT.assets.update({name: bytes(data) for name, data in assets.items()})

    @answered
    def prepare(self, text: str, hashes: Sequence[str], arrays_sha256: str) -> Described:
        """Set the device up for a job.

        Parameters
        ----------
        text : str
            Text of `RenderJob.to_json`.
        hashes : sequence of str
            Hashes of its assets, all of which are present.
        arrays_sha256 : str
            See `clrender.rendering.team.Cluster.team`.
        """
        if self._prepared is not None and self._prepared[0] == text:
            # Only the connection was lost, or the device is set up again
            self._worker = self._set_up()
            return self._prepared[1]
        self._release()
        job = RenderJob.from_json(text, _KEPT.assets)
        _KEPT.keep_assets(hashes)
        if self._session is None:
            self._session = _KEPT.take_session(self._spec)
        self._device = self._session.devices[0]
        if len(self._session.devices) > 1:
            raise DeviceError(
                f"a worker renders on one device, and here {len(self._session.devices)} are asked for; start a worker "
                "for each, with another CLRENDER_DEVICE"
            )
        before = self._device.compile_seconds
        self._team, here = self._session.team(job)
        if here != arrays_sha256:
            raise RenderError("the arrays made from the scene are others here, by another NumPy or processor")
        worker = self._worker = self._set_up()
        info = self._device.info
        described = Described(
            info.name,
            f"{info.platform} {info.driver}",
            info.version,
            info.type,
            socket.gethostname(),
            os.getpid(),
            worker.build_seconds,
            self._device.compile_seconds - before,
            self._device.allocated_bytes,
        )
        self._prepared = text, described
        return described

    @answered
    def render(self, unit: Unit) -> Answer:
        """Render the samples of a unit, or those until `stop`."""
        if self._worker is None:
            raise DeviceFailure("it is not set up")
        return Answer(self._worker.render(unit, None, lambda: self._stopped), self._state())

    @answered
    def prove(self) -> bool:
        """Whether the device passes the probe."""
        prove = self._candidate().prove
        return prove() if prove is not None else True

    @answered
    def restart(self) -> None:
        """Release everything on a device that failed."""
        if self._team is not None and (restart := self._candidate().restart) is not None:
            self._worker = None
            restart()

    def _set_up(self) -> DeviceWorker:
        worker = self._candidate().set_up()
        assert isinstance(worker, DeviceWorker)
        return worker

    def _candidate(self) -> Candidate:
        assert self._team is not None
        return self._team.candidates[0]

    def _release(self) -> None:
        team, self._team, self._worker, self._prepared = self._team, None, None, None
        if team is not None:
            team.__exit__()
