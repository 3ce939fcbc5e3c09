"""One worker of a cluster as scheduling sees it: what it is sent, and what it does."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from clrender.cluster.connection import Connection
from clrender.cluster.remote import Described
from clrender.errors import ClrenderError, DeviceFailure
from clrender.film.unit import Unit, UnitSums
from clrender.scheduling.cluster import Member
from clrender.scheduling.worker import Candidate

if TYPE_CHECKING:
    from clrender.cluster.dask_cluster import DaskTeam, Peer

__all__ = ["JobPayload", "WorkerProxy"]


@dataclass(frozen=True)
class JobPayload:
    """A job on its way to workers.

    Attributes
    ----------
    text, assets
        Of `RenderJob.to_json`.
    arrays_sha256 : str
        Hash of the arrays that its scene is here.
    width, height : int
    """

    text: str
    assets: Mapping[str, bytes]
    arrays_sha256: str
    width: int
    height: int


class WorkerProxy:
    """What stands for one worker of the cluster here, or for one that may join.

    Parameters
    ----------
    team : DaskTeam
    payload : JobPayload
    on_ready : callable

    Attributes
    ----------
    candidate : Candidate
    peer : Peer or None
        Whom it stands for.
    described : Described or None
        Once it was set up.
    sent_bytes, received_bytes : int
        Assets and job; sums of units.
    lost : int
        How often it broke off, or did not answer.
    """

    def __init__(self, team: DaskTeam, payload: JobPayload, on_ready: Callable[[], None]) -> None:
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
        )

    @property
    def lost(self) -> int:
        return self._connection.lost

    def assign(self, peer: Peer) -> None:
        """Stand for this worker from now on."""
        self.peer = peer
        self.candidate.name = peer.title

    def member(self) -> Member | None:
        """What the statistics say of the worker; None where none was ever set up."""
        it = self.described
        if it is None:
            return None
        seconds = (self._connection.state.busy_seconds, it.build_seconds, it.compile_seconds)
        return Member(it.device, it.driver, it.type, *seconds, it.device_bytes, f"{self.candidate.name} ({it.host})")

    def release(self) -> None:
        """Let the worker go."""
        self._connection.close()

    # What scheduling calls, in the worker's own thread

    def _present(self) -> bool:
        """Whether the scheduler knows it, and nothing says that it would not answer."""
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
        # It is waited for: what is half done proves nothing
        return bool(self._connection.call("prove", should_stop=lambda: False))

    def _restart(self) -> None:
        if self.peer is not None and self._connection.leads_to(self.peer):
            self._connection.call("restart")

    def render(
        self, unit: Unit, on_slice: Callable[[int, int], None] | None, should_stop: Callable[[], bool] | None
    ) -> UnitSums:
        """As of `clrender.scheduling.worker.Worker.render`; samples are told of when the unit is done."""
        result = self._connection.call("render", unit, should_stop=should_stop)
        if not isinstance(result, UnitSums):
            return UnitSums.nothing(unit)
        arrays = (getattr(result, field.name) for field in fields(result))
        self.received_bytes += sum(each.nbytes for each in arrays if isinstance(each, np.ndarray))
        if on_slice is not None:
            pixels = unit.pixels(self._payload.width, self._payload.height)
            on_slice(int((pixels * result.done).sum()), result.rays)
        return result
