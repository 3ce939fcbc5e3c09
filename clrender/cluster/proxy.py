"""Proxy of one worker of a cluster for the scheduler: sends jobs and units, and receives results."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from clrender.cluster.connection import Connection
from clrender.cluster.remote import Described
from clrender.errors import ClrenderError, DeviceFailure
from clrender.film.unit import Unit, UnitSums
from clrender.scheduling.member import Member
from clrender.scheduling.worker import Candidate

if TYPE_CHECKING:
    from distributed import Client

    from clrender.cluster.peer import Peer

__all__ = ["JobPayload", "WorkerProxy"]


@dataclass(frozen=True)
class JobPayload:
    """A job in serialized form, for workers.

    Attributes
    ----------
    text, assets
        Results of `RenderJob.to_json`.
    arrays_sha256 : str
        Hash of the scene's arrays on this machine.
    width, height : int
    """

    text: str
    assets: Mapping[str, bytes]
    arrays_sha256: str
    width: int
    height: int


class ProxyCluster(Protocol):
    """What a proxy has to know of its cluster; see `clrender.cluster.dask_cluster.DaskCluster`."""

    @property
    def client(self) -> Client: ...

    @property
    def spec(self) -> Any: ...

    @property
    def address(self) -> str: ...

    @property
    def peers(self) -> Mapping[str, Peer]: ...


class ProxyTeam(Protocol):
    """What a proxy asks of its team; see `clrender.cluster.dask_cluster.DaskTeam`."""

    @property
    def cluster(self) -> ProxyCluster: ...

    def active(self) -> None: ...

    def assign_newcomer(self, proxy: WorkerProxy) -> None: ...

    def check(self) -> None: ...

    def refuse(self, peer: Peer, why: str) -> None: ...


class WorkerProxy:
    """Local proxy of one worker of the cluster, or of one that may join.

    Parameters
    ----------
    team : ProxyTeam
    payload : JobPayload
    on_ready : callable

    Attributes
    ----------
    candidate : Candidate
    peer : Peer or None
        The worker that it is assigned to.
    described : Described or None
        Description of the worker's device, after its set-up.
    sent_bytes, received_bytes : int
        Bytes of assets and job; bytes of sums of units.
    lost : int
        Number of times that the connection broke or the worker did not answer.
    """

    def __init__(self, team: ProxyTeam, payload: JobPayload, on_ready: Callable[[], None]) -> None:
        self._team = team
        self._payload = payload
        self._on_ready = on_ready
        self.peer: Peer | None = None
        self.described: Described | None = None
        self.sent_bytes = self.received_bytes = 0
        cluster = team.cluster
        self._connection = Connection(cluster.client, cluster.spec, lambda: cluster.peers, team.active)
        self.candidate = Candidate(
            f"a worker that may join {cluster.address}",
            self._set_up,
            restart=self._restart,
            pulse=lambda: (self._connection.state.calls, self._connection.state.compiling),
            lose=self._connection.give_up,
            prove=self._prove,
            present=self._present,
            give_up=self._connection.give_up,
            elsewhere=True,
        )

    @property
    def lost(self) -> int:
        return self._connection.lost

    def assign(self, peer: Peer) -> None:
        """Assign the proxy to a worker."""
        self.peer = peer
        self.candidate.name = peer.title

    def member(self) -> Member | None:
        """The worker's entry in the statistics; None if it was never set up."""
        it = self.described
        if it is None:
            return None
        seconds = (self._connection.state.busy_seconds, it.build_seconds, it.compile_seconds)
        return Member(it.device, it.driver, it.type, *seconds, it.device_bytes, f"{self.candidate.name} ({it.host})")

    def release(self) -> None:
        """Release the worker."""
        self._connection.close()

    # Called by the scheduler, in the worker's own thread

    def _present(self) -> bool:
        """Whether Dask's scheduler lists the worker, and it can be called."""
        if self.peer is None:
            self._team.assign_newcomer(self)
        peer = None if self.peer is None else self._team.cluster.peers.get(self.peer.key)
        if peer is not None and self._connection.is_open(peer):
            self.assign(peer)
            return True
        self._team.check()
        return False

    def _set_up(self) -> WorkerProxy:
        peer, connection, payload = self.peer, self._connection, self._payload
        assert peer is not None
        try:
            connection.connect(peer)
            hashes = sorted(payload.assets)
            for name in connection.call("lacks", hashes) or []:
                connection.call("take", {name: payload.assets[name]})
                self.sent_bytes += len(payload.assets[name])
            described: Described | None = connection.call("prepare", payload.text, hashes, payload.arrays_sha256)
            self.sent_bytes += len(payload.text)
        except ClrenderError as error:
            if not isinstance(error, DeviceFailure):
                self._team.refuse(peer, str(error))
            raise
        if described is not None:
            self.described = described
            self.candidate.driver = f"{described.driver} {described.version}"
            self._on_ready()
        return self

    def _prove(self) -> bool:
        # Never stopped early: a partial probe proves nothing
        return bool(self._connection.call("prove", should_stop=lambda: False))

    def _restart(self) -> None:
        if self.peer is not None and self._connection.leads_to(self.peer):
            self._connection.call("restart")

    def render(
        self, unit: Unit, on_slice: Callable[[int, int], None] | None, should_stop: Callable[[], bool] | None
    ) -> UnitSums:
        """See `clrender.scheduling.worker.Worker.render`; `on_slice` is called only once, when the unit is done."""
        result = self._connection.call("render", unit, should_stop=should_stop)
        if not isinstance(result, UnitSums):
            return UnitSums.nothing(unit)
        arrays = (getattr(result, field.name) for field in fields(result))
        self.received_bytes += sum(each.nbytes for each in arrays if isinstance(each, np.ndarray))
        if on_slice is not None:
            pixels = unit.pixels(self._payload.width, self._payload.height)
            on_slice(int((pixels * result.done).sum()), result.rays)
        return result
