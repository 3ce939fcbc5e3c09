"""An open cluster: the client of its scheduler, its current workers, and a team of them for each job."""

from __future__ import annotations

import os
import queue
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING, Any, Final

from clrender.cluster.address import check_address, local_workers
from clrender.cluster.peer import Peer
from clrender.cluster.proxy import JobPayload, WorkerProxy
from clrender.cluster.quiet import quiet_logs
from clrender.errors import RenderError, UsageError
from clrender.extras import install_command
from clrender.scheduling.member import Member
from clrender.scheduling.watchdog import TimeLimits
from clrender.scheduling.worker import Candidate
from clrender.wording import counted

if TYPE_CHECKING:
    from distributed import Client

    from clrender.rendering.job import RenderJob

__all__ = ["DaskCluster", "open_cluster"]

CONNECT_SECONDS: Final = 10.0
"""Default time limit of the connection to a scheduler (see ``CLRENDER_CLUSTER_SECONDS``)."""
_MORE_SECONDS: Final = 2.0
"""Time for Dask to notice by itself that it has expired."""
PATIENCE: float = 30.0
"""Seconds without any worker after which a render fails."""
_LOOK_SECONDS: Final = 0.5
_SPARE: Final = 16
"""Number of additional workers that may join a running render."""
_LIMITS: Final = TimeLimits(steady=1)
"""After one finished unit, earlier losses of a worker are forgotten."""


@contextmanager
def open_cluster(
    address: str, *, device: str | int | Sequence[str | int] | None = None, notify: Callable[[str], None] | None = None
) -> Iterator[DaskCluster]:
    """Connect to a Dask cluster, or start one on this machine, while the block runs.

    Parameters
    ----------
    address : str
        Address of a Dask scheduler, ``tcp://HOST:PORT`` or, with the certificates of Dask's configuration,
        ``tls://HOST:PORT``; or ``local:N`` for N worker processes on this machine.
    device : str, int or sequence of them, optional
        The device of each worker, see `Session`. Default: the worker's ``CLRENDER_DEVICE``, else its best device.
    notify : callable, optional
        Called with one line of text for each notice.

    Yields
    ------
    cluster : DaskCluster
        For `Session.render`.

    Raises
    ------
    UsageError
        When the address is invalid, or Dask is not installed.
    RenderError
        When no scheduler answers at the address.
    """
    check_address(address)
    count = local_workers(address)
    spec = None if device is None else (device,) if isinstance(device, (str, int)) else tuple(device)
    if spec is not None and not all(isinstance(each, (str, int)) for each in spec):
        raise UsageError("workers of a cluster open their own devices; say which as --device does, by name or index")
    with ExitStack() as stack:
        try:
            import distributed
        except ImportError as error:
            raise UsageError(
                f"Dask cannot be loaded here ({error}); install it anew with "
                f"`{install_command('cluster')} --force-reinstall`"
            ) from None
        stack.enter_context(quiet_logs())
        where = address
        if count is not None:
            from clrender.cluster.local import local_cluster

            where = stack.enter_context(local_cluster(count))
        client = _connected(distributed.Client, address, where)
        stack.callback(_close, client)
        cluster = DaskCluster(address, client, spec, notify or (lambda line: None), spare=0 if count else _SPARE)
        stack.callback(cluster.close)
        yield cluster


def _connected(client: Any, address: str, where: str) -> Any:
    """Connect to the scheduler; `address` is for messages."""
    seconds = _connect_seconds()
    found: queue.SimpleQueue[Any] = queue.SimpleQueue()
    late = threading.Event()

    def connect() -> None:
        try:
            made = client(where, timeout=seconds, direct_to_workers=True, name="clrender")
            made.scheduler_info(n_workers=-1)
            found.put(made)
            if late.is_set():
                _close_quietly(made)
        except Exception as error:  # Dask passes on any exception of its transports
            found.put(error)

    # In a thread, because Dask's time limit does not cover all that a scheduler may be silent about
    threading.Thread(target=connect, daemon=True).start()
    try:
        answer = found.get(timeout=seconds + _MORE_SECONDS)
    except queue.Empty:
        late.set()
        raise RenderError(
            f"{address}: something accepts connections there, but has not answered for {seconds:g} s as a Dask "
            "scheduler does; check host and port, or set CLRENDER_CLUSTER_SECONDS to more seconds"
        ) from None
    if isinstance(answer, Exception):
        reason = str(answer).split("\n", maxsplit=1)[0].strip() or type(answer).__name__
        raise RenderError(
            f"{address}: no Dask scheduler answers there ({reason}); start one with `dask scheduler`, and workers with "
            "`dask worker`; CLRENDER_CLUSTER_SECONDS sets the time limit"
        )
    return answer


def _connect_seconds() -> float:
    """The time limit of the connection."""
    try:
        return max(float(os.environ["CLRENDER_CLUSTER_SECONDS"]), 0.1)
    except (KeyError, ValueError):
        return CONNECT_SECONDS


def _close(client: Any) -> None:
    # In a thread, because closing waits in vain for a scheduler that is gone
    closing = threading.Thread(target=_close_quietly, args=(client,), daemon=True)
    closing.start()
    closing.join(3.0)


def _close_quietly(client: Any) -> None:
    with suppress(Exception):
        client.close(timeout=2)


class DaskCluster:
    """The cluster that `open_cluster` yields; a `clrender.rendering.team.Cluster`.

    Parameters
    ----------
    address : str
        Address as given by the user.
    client : distributed.Client
    spec : tuple or None
        The device of each worker.
    notify : callable
    spare : int
        Number of additional workers that may join a running render.
    """

    def __init__(
        self,
        address: str,
        client: Client,
        spec: tuple[str | int, ...] | None,
        notify: Callable[[str], None],
        spare: int,
    ) -> None:
        self.address = address
        self.client = client
        self.spec = spec
        self._notify = notify
        self._spare = spare
        self._peers: dict[str, Peer] = {}
        self._heard = time.monotonic()
        self._closed = threading.Event()
        self._look()
        self._looking = threading.Thread(target=self._look_on, daemon=True)
        self._looking.start()

    def close(self) -> None:
        """Stop looking for workers."""
        self._closed.set()

    @property
    def peers(self) -> Mapping[str, Peer]:
        """Workers that the scheduler currently knows, by their keys."""
        return self._peers

    @property
    def silent_seconds(self) -> float:
        """Seconds since the scheduler's last answer."""
        return time.monotonic() - self._heard

    @contextmanager
    def team(self, job: RenderJob, arrays_sha256: str, on_ready: Callable[[], None]) -> Iterator[DaskTeam]:
        """See `clrender.rendering.team.Cluster.team`."""
        text, assets = job.to_json()
        payload = JobPayload(text, assets, arrays_sha256, *job.settings.film_size)
        team = DaskTeam(self, payload, on_ready, len(self._peers) + self._spare)
        try:
            yield team
        finally:
            team.release()

    def _look_on(self) -> None:
        while not self._closed.wait(_LOOK_SECONDS + 0.005 * len(self._peers)):
            with suppress(Exception):
                self._look()

    def _look(self) -> None:
        workers = self.client.scheduler_info(n_workers=-1)["workers"]
        peers = [
            Peer(str(each.get("nanny") or address), str(address), str(each["name"]), str(each["host"]))
            for address, each in workers.items()
            if each.get("status") != "closing"
        ]
        self._peers = {peer.key: peer for peer in peers}
        self._heard = time.monotonic()


class DaskTeam:
    """Workers of a cluster for one job; a `clrender.rendering.team.Team`.

    Each has a proxy; unassigned proxies are for workers that join later.
    """

    def __init__(self, cluster: DaskCluster, payload: JobPayload, on_ready: Callable[[], None], proxies: int) -> None:
        self.cluster = cluster
        self.limits = _LIMITS
        self._active = time.monotonic()
        self._lock = threading.Lock()
        self._refused: dict[str, str] = {}
        self._proxies = [WorkerProxy(self, payload, on_ready) for _ in range(max(proxies, 1))]
        for proxy, peer in zip(self._proxies, list(cluster.peers.values()), strict=False):
            proxy.assign(peer)
        self._asset_bytes = sum(map(len, payload.assets.values()))

    @property
    def candidates(self) -> Sequence[Candidate]:
        """One candidate for each proxy."""
        return [proxy.candidate for proxy in self._proxies]

    def active(self) -> None:
        """Note that a worker has answered."""
        self._active = time.monotonic()

    def refuse(self, peer: Peer, why: str) -> None:
        """Note that a worker cannot do this job."""
        with self._lock:
            self._refused[peer.key] = why

    def newcomer(self) -> Peer | None:
        """A worker without a proxy, or None."""
        taken = {proxy.peer.key for proxy in self._proxies if proxy.peer is not None}
        return next((peer for key, peer in self.cluster.peers.items() if key not in taken), None)

    def assign_newcomer(self, proxy: WorkerProxy) -> None:
        """Assign a proxy to a worker that has none, if there is one."""
        with self._lock:
            peer = self.newcomer()
            if peer is not None:
                proxy.assign(peer)

    def check(self) -> None:
        """Check that there are workers that can be expected to answer.

        Raises
        ------
        RenderError
            When all workers refused the job, or none has answered for `PATIENCE`.
        """
        peers, address = self.cluster.peers, self.cluster.address
        with self._lock:
            if peers and peers.keys() <= self._refused.keys():
                raise RenderError("; ".join(dict.fromkeys(self._refused[key] for key in peers)))
        waited = time.monotonic() - self._active
        if waited <= PATIENCE:
            return
        if self.cluster.silent_seconds > PATIENCE / 2:
            raise RenderError(f"{address}: the scheduler has not answered for {waited:.0f} s, and no worker either")
        there = f"of {counted(len(peers), 'worker')} none answers" if peers else "no worker is there"
        raise RenderError(f"{address}: {there}, since {waited:.0f} s; start some with `dask worker`")

    def members(self) -> list[Member | None]:
        """See `clrender.rendering.team.Team.members`."""
        return [proxy.member() for proxy in self._proxies]

    def stats(self) -> Mapping[str, Any]:
        """Entries of the statistics: number of workers, bytes sent and received, and connection losses."""
        return {
            "cluster": {
                "address": self.cluster.address,
                "workers": sum(proxy.described is not None for proxy in self._proxies),
                "asset_bytes": self._asset_bytes,
                "sent_bytes": sum(proxy.sent_bytes for proxy in self._proxies),
                "received_bytes": sum(proxy.received_bytes for proxy in self._proxies),
                "lost": sum(proxy.lost for proxy in self._proxies),
            }
        }

    def release(self) -> None:
        """Release the workers."""
        for proxy in self._proxies:
            proxy.release()
