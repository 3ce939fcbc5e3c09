"""What a render knows of workers in other processes and on other machines: how to get them, and what they tell."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from clrender.scheduling.watchdog import TimeLimits
from clrender.scheduling.worker import Candidate

if TYPE_CHECKING:
    from clrender.job import RenderJob

__all__ = ["Cluster", "Member", "Team"]


@dataclass(frozen=True)
class Member:
    """What the statistics of a render say of one of its workers beside what it did.

    Attributes
    ----------
    name, driver, type : str
        Of its device.
    busy_seconds, build_seconds, compile_seconds : float
    device_bytes : int
        Allocated there.
    host : str
        Machine, where that is not this one or there are several processes.
    """

    name: str
    driver: str
    type: str
    busy_seconds: float = 0.0
    build_seconds: float = 0.0
    compile_seconds: float = 0.0
    device_bytes: int = 0
    host: str = ""


class Team(Protocol):
    """Workers that are at one job's disposal.

    Attributes
    ----------
    candidates : sequence of Candidate
        Some may stand for workers that may join later.
    limits : TimeLimits or None
        None: as always.
    """

    @property
    def candidates(self) -> Sequence[Candidate]: ...

    @property
    def limits(self) -> TimeLimits | None: ...

    def members(self) -> list[Member | None]:
        """One for each candidate; None: nobody took its place, or nothing is known of who did."""

    def stats(self) -> Mapping[str, Any]:
        """What else the statistics say, JSON-able."""


class Cluster(Protocol):
    """Workers in other processes, that are there for one render after the other."""

    def team(self, job: RenderJob, arrays_sha256: str, on_ready: Callable[[], None]) -> AbstractContextManager[Team]:
        """Workers for a job.

        Parameters
        ----------
        job : RenderJob
        arrays_sha256 : str
            Hash of the arrays that its scene is here; a worker whose arrays are others would give another image.
        on_ready : callable
            Told, in any thread, of each worker that is set up.
        """
