"""How the samples of a render were taken: by which workers, and how much time that took."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from clrender.device.team import member
from clrender.scheduling.member import Member
from clrender.scheduling.run import Tally, WorkerTally

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.rendering.team import Team

__all__ = ["Taken"]


@dataclass(frozen=True)
class Taken:
    """How the samples of a plan were taken.

    Attributes
    ----------
    tally : Tally
    members : list of Member
        The workers that took part, in the order of the tally.
    finished : float
        Time of the last result, by `time.perf_counter`.
    told : mapping
        Further entries of the statistics.
    cpu_seconds : float
        Of this process.
    wrong : bool
        Whether a device computed wrong results.
    """

    tally: Tally
    members: list[Member]
    finished: float
    told: Mapping[str, Any]
    cpu_seconds: float = 0.0
    wrong: bool = False

    @classmethod
    def of(cls, tally: Tally, team: Team, finished: float) -> Taken:
        """The samples that a team took; workers that never joined are left out."""
        came = [
            (each or Member(done.name, "", ""), done)
            for each, done in zip(team.members(), tally.workers, strict=True)
            if each is not None or done.failures
        ]
        tally.workers = [done for _, done in came]
        return cls(tally, [each for each, _ in came], finished, team.stats())

    @classmethod
    def none(cls, devices: Sequence[Device]) -> Taken:
        """No samples, because none were lacking."""
        tally = Tally(complete=True, workers=[WorkerTally(device.info.title) for device in devices])
        return cls(tally, [member(device) for device in devices], time.perf_counter(), {})
