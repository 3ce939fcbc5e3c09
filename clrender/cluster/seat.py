"""One worker of a cluster as scheduling sees it: its place in a team, what it is sent, and what it does."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from clrender.cluster.line import Line
from clrender.cluster.remote import Described
from clrender.errors import ClrenderError, DeviceFailure
from clrender.film.unit import Unit, UnitSums
from clrender.scheduling.cluster import Member
from clrender.scheduling.worker import Candidate

if TYPE_CHECKING:
    from clrender.cluster.opened import DaskTeam, Peer

__all__ = ["Parcel", "Seat"]


@dataclass(frozen=True)
class Parcel:
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


class Seat:
    """A place for a worker in a team.

    Parameters
    ----------
    team : DaskTeam
    parcel : Parcel
    on_ready : callable

    Attributes
    ----------
    candidate : Candidate
    peer : Peer or None
        Who sits here.
    described : Described or None
        Once it was set up.
    sent_bytes, received_bytes : int
        Assets and job; sums of units.
    lost : int
        How often it broke off, or did not answer.
    """

    def __init__(self, team: DaskTeam, parcel: Parcel, on_ready: Callable[[], None]) -> None:
        self._team = team
        self._parcel = parcel
        self._on_ready = on_ready
        self.peer: Peer | None = None
        self.described: Described | None = None
        self.sent_bytes = self.received_bytes = 0
        cluster = team.cluster
        self._line = Line(cluster.client, cluster.spec, lambda: cluster.peers, team.active)
        self.candidate = Candidate(
            f"a worker that may join {cluster.address}",
            self._set_up,
            restart=self._restart,
            pulse=lambda: (self._line.state.calls, self._line.state.compiling),
            lose=self._line.give_up,
            prove=lambda: bool(self._line.call("prove", should_stop=lambda: False)),  # what is half done proves nothing
            present=self._present,
            give_up=self._line.give_up,
        )

    @property
    def lost(self) -> int:
        return self._line.lost

    def take(self, peer: Peer) -> None:
        """Somebody sits down here."""
        self.peer = peer
        self.candidate.name = peer.title

    def member(self) -> Member | None:
        """What the statistics say of who sits here; None where nobody was ever set up."""
        it = self.described
        if it is None:
            return None
        seconds = (self._line.state.busy_seconds, it.build_seconds, it.compile_seconds)
        return Member(it.device, it.driver, it.type, *seconds, it.device_bytes, f"{self.candidate.name} ({it.host})")

    def release(self) -> None:
        """Let the worker go."""
        self._line.close()

    # What scheduling calls, in the worker's own thread

    def _present(self) -> bool:
        """Whether the scheduler knows it, and nothing says that it would not answer."""
        if self.peer is None:
            self._team.seat_newcomer(self)
        peer = None if self.peer is None else self._team.cluster.peers.get(self.peer.key)
        if peer is not None and self._line.is_open(peer):
            self.take(peer)
            return True
        self._team.check()
        return False

    def _set_up(self) -> Seat:
        peer, line, parcel = self.peer, self._line, self._parcel
        assert peer is not None
        try:
            line.connect(peer)
            hashes = sorted(parcel.assets)
            for name in line.call("lacks", hashes) or []:
                line.call("take", {name: parcel.assets[name]})
                self.sent_bytes += len(parcel.assets[name])
            described: Described | None = line.call("prepare", parcel.text, hashes, parcel.arrays_sha256)
            self.sent_bytes += len(parcel.text)
        except ClrenderError as error:
            if not isinstance(error, DeviceFailure):
                self._team.refuse(peer, str(error))
            raise
        if described is not None:
            self.described = described
            self.candidate.driver = f"{described.driver} {described.version}"
            self._on_ready()
        return self

    def _restart(self) -> None:
        if self.peer is not None and self._line.leads_to(self.peer):
            self._line.call("restart")

    def render(
        self, unit: Unit, on_slice: Callable[[int, int], None] | None, should_stop: Callable[[], bool] | None
    ) -> UnitSums:
        """As of `clrender.scheduling.worker.Worker.render`; samples are told of when the unit is done."""
        result = self._line.call("render", unit, should_stop=should_stop)
        if not isinstance(result, UnitSums):
            return UnitSums.nothing(unit)
        arrays = (getattr(result, field.name) for field in fields(result))
        self.received_bytes += sum(each.nbytes for each in arrays if isinstance(each, np.ndarray))
        if on_slice is not None:
            pixels = unit.pixels(self._parcel.width, self._parcel.height)
            on_slice(int((pixels * result.done).sum()), result.rays)
        return result
