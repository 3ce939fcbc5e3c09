"""What a run came to: who did what, what was checked, and who failed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from clrender.errors import ClrenderError
from clrender.film.unit import Unit, UnitSums

__all__ = ["Tally", "WorkerTally", "failures_told"]


@dataclass
class WorkerTally:
    """What one worker did.

    Attributes
    ----------
    name : str
    units, samples, rays, shadow_rays, deepest : int
        Of what it did and what was kept of that.
    requeued : int
        Units that it had begun or done, and that others had to do.
    checked : int
        Samples of its units that another worker did again for comparison.
    failures : int
        How often it failed.
    state : str
        ``ok``, ``failed``, ``hung`` (a call of its driver never came back) or ``wrong`` (its results were).
    """

    name: str
    units: int = 0
    samples: int = 0
    rays: int = 0
    shadow_rays: int = 0
    deepest: int = 0
    requeued: int = 0
    checked: int = 0
    failures: int = 0
    state: str = "ok"

    def add(self, result: UnitSums, samples: int) -> None:
        """A unit of its was committed."""
        self.units += 1
        self.samples += samples
        self.rays += result.rays
        self.shadow_rays += result.shadow_rays
        self.deepest = max(self.deepest, result.deepest)

    def absorb(self, later: WorkerTally) -> None:
        """Add what it did in a run that came after."""
        for name in ("units", "samples", "rays", "shadow_rays", "requeued", "checked", "failures"):
            setattr(self, name, getattr(self, name) + getattr(later, name))
        self.deepest = max(self.deepest, later.deepest)
        self.state = later.state

    def withdraw(self, units: list[Unit]) -> None:
        """All that was kept of its is no longer."""
        self.requeued += len(units)
        self.forget()

    def forget(self) -> None:
        """Nothing is kept of what it did."""
        self.units = self.samples = self.rays = self.shadow_rays = self.deepest = 0


@dataclass
class Tally:
    """What a run came to.

    Attributes
    ----------
    complete : bool
        Every sample of the plan was taken.
    workers : list of WorkerTally
        In the order given.
    failures : list of ClrenderError
        Why workers ended before the work did, each with the name of its device in the message.
    recovered : list of ClrenderError
        What failed, and then worked again.
    check_samples, checks, differences : int
        Samples that were done twice, in how many pieces, and how many of those came out differently.
    """

    complete: bool = False
    workers: list[WorkerTally] = field(default_factory=list)
    failures: list[ClrenderError] = field(default_factory=list)
    recovered: list[ClrenderError] = field(default_factory=list)
    check_samples: int = 0
    checks: int = 0
    differences: int = 0

    def take_back(self) -> None:
        """All that was kept of all workers is no longer."""
        for each in self.workers:
            each.requeued += each.units
            each.forget()
        self.complete = False

    @property
    def samples(self) -> int:
        """Samples committed."""
        return sum(each.samples for each in self.workers)

    @property
    def rays(self) -> int:
        """Rays of all kinds that they took."""
        return sum(each.rays for each in self.workers)

    @property
    def shadow_rays(self) -> int:
        """Shadow rays among them."""
        return sum(each.shadow_rays for each in self.workers)

    @property
    def deepest(self) -> int:
        """Most scattering events of a path."""
        return max((each.deepest for each in self.workers), default=0)

    @property
    def all_failed(self) -> bool:
        """Whether nobody is left who could go on."""
        return all(each.state != "ok" for each in self.workers)

    def absorb(self, later: Tally, numbers: Sequence[int]) -> None:
        """Add a run that came after this one, in which the workers of these numbers took part."""
        self.complete = later.complete
        for number, more in zip(numbers, later.workers, strict=True):
            self.workers[number].absorb(more)
        self.failures += later.failures
        self.recovered += later.recovered
        self.check_samples += later.check_samples
        self.checks += later.checks
        self.differences += later.differences

    def raise_failure(self) -> None:
        """Raise why the last worker failed, where all did before the work was done."""
        if self.all_failed and not self.complete:
            raise self.failures[-1]


def failures_told(tally: Tally) -> list[str]:
    """What the end of a render says of devices that failed, a line each."""
    lines = [f"warning: {error}; its work was done by the others" for error in tally.failures]
    lines += [f"warning: {error}; it worked again when it was set up anew" for error in tally.recovered]
    return [line if times == 1 else f"{line} ({times} times)" for line, times in Counter(lines).items()]
