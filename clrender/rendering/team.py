"""Interfaces to the workers of a render: those of this process, and those of others or of other machines."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any, Protocol

from clrender.scheduling.member import Member
from clrender.scheduling.watchdog import TimeLimits
from clrender.scheduling.worker import Candidate

if TYPE_CHECKING:
    from clrender.rendering.job import RenderJob

__all__ = ["Cluster", "Team"]


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
