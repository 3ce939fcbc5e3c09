"""Interfaces to workers in other processes or on other machines: how a render gets them, and their statistics."""

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


class Team(Protocol):
    """The workers for one job.

    Attributes
    ----------
    candidates : sequence of Candidate
        Some may stand for workers that join later, or never.
    limits : TimeLimits or None
        None: the default limits.
    """

    @property
    def candidates(self) -> Sequence[Candidate]: ...

    @property
    def limits(self) -> TimeLimits | None: ...

    def members(self) -> list[Member | None]:
        """One member for each candidate; None if no worker took its place or nothing is known of it."""

    def stats(self) -> Mapping[str, Any]:
        """Further entries of the statistics, as JSON values."""


class Cluster(Protocol):
    """Workers in other processes that serve one render after another."""

    def team(self, job: RenderJob, arrays_sha256: str, on_ready: Callable[[], None]) -> AbstractContextManager[Team]:
        """Get the workers for a job.

        Parameters
        ----------
        job : RenderJob
        arrays_sha256 : str
            Hash of the scene's arrays on this machine; a worker with different arrays would render a different image.
        on_ready : callable
            Called, in any thread, after each worker is set up.
        """
