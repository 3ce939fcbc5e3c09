"""Tally of a run: the work of each worker, spot checks, and failures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from clrender.errors import ClrenderError
from clrender.film.held import HeldUnit
from clrender.film.unit import Unit, UnitSums

__all__ = ["Tally", "WorkerTally", "failures_told"]


@dataclass
class WorkerTally:
    """Counts of one worker.

    Attributes
    ----------
    name : str
    units, samples, rays, shadow_rays, deepest : int
        Counts of its work that is in the film.
    requeued : int
        Units that it had started or finished and that others had to render.
    checked : int
        Samples of its units that another worker rendered again for comparison.
    failures : int
        Number of its failures.
    state : str
        ``ok``, ``failed``, ``hung`` (a driver call did not return) or ``wrong`` (its results were wrong).
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

    def add(self, result: UnitSums | HeldUnit, samples: int) -> None:
        """Count a unit that was committed."""
        self.units += 1
        self.samples += samples
        self.rays += result.rays
        self.shadow_rays += result.shadow_rays
        self.deepest = max(self.deepest, result.deepest)

    def absorb(self, later: WorkerTally) -> None:
        """Add the counts of a later run."""
        for name in ("units", "samples", "rays", "shadow_rays", "requeued", "checked", "failures"):
            setattr(self, name, getattr(self, name) + getattr(later, name))
        self.deepest = max(self.deepest, later.deepest)
        self.state = later.state

    def withdraw(self, units: list[Unit]) -> None:
        """Reset its counts: its contributions were subtracted from the film and these units are requeued."""
        self.requeued += len(units)
        self.forget()

    def forget(self) -> None:
        """Reset the counts of its work in the film."""
        self.units = self.samples = self.rays = self.shadow_rays = self.deepest = 0


@dataclass
class Tally:
    """Tally of a run.

    Attributes
    ----------
    complete : bool
        Whether every sample of the plan was taken.
    stopped : bool
        Whether the run was asked to stop. What fails afterwards does not matter.
    workers : list of WorkerTally
        In the order of the candidates.
    failures : list of ClrenderError
        Errors that ended workers before the work was done, each with the name of its device in the message.
    told : list of ClrenderError
        Those of the failures that the user has been told of.
    recovered : list of ClrenderError
        Errors of workers that later worked again.
    check_samples, checks, differences : int
        Samples that were rendered twice, the number of pieces, and the number of pieces whose results differ.
    """

    complete: bool = False
    stopped: bool = False
    workers: list[WorkerTally] = field(default_factory=list)
    failures: list[ClrenderError] = field(default_factory=list)
    told: list[ClrenderError] = field(default_factory=list)
    recovered: list[ClrenderError] = field(default_factory=list)
    check_samples: int = 0
    checks: int = 0
    differences: int = 0

    def take_back(self) -> None:
        """Withdraw the work of all workers."""
        for each in self.workers:
            each.requeued += each.units
            each.forget()
        self.complete = False

    @property
    def samples(self) -> int:
        """Number of committed samples."""
        return sum(each.samples for each in self.workers)

    @property
    def rays(self) -> int:
        """Rays of all kinds of these samples."""
        return sum(each.rays for each in self.workers)

    @property
    def shadow_rays(self) -> int:
        """Shadow rays among them."""
        return sum(each.shadow_rays for each in self.workers)

    @property
    def deepest(self) -> int:
        """Largest number of scattering events of a path."""
        return max((each.deepest for each in self.workers), default=0)

    @property
    def all_failed(self) -> bool:
        """Whether every worker has failed, before the run was asked to stop."""
        return not self.stopped and all(each.state != "ok" for each in self.workers)

    def absorb(self, later: Tally, numbers: Sequence[int]) -> None:
        """Add a later run; `numbers` are the indices, in this tally, of its workers."""
        self.complete, self.stopped = later.complete, later.stopped
        for number, more in zip(numbers, later.workers, strict=True):
            self.workers[number].absorb(more)
        self.failures += later.failures
        self.told += later.told
        self.recovered += later.recovered
        self.check_samples += later.check_samples
        self.checks += later.checks
        self.differences += later.differences

    def raise_failure(self) -> None:
        """Raise the last failure, if all workers failed before the work was done."""
        if self.all_failed and not self.complete:
            raise self.failures[-1]


def failures_told(tally: Tally) -> list[str]:
    """Messages about failed devices for the end of a render, one line each."""
    rest = "" if tally.stopped else "; its work was done by the others"
    lines = [f"warning: {error}{rest}" for error in tally.failures if error not in tally.told]
    lines += [f"warning: {error}; it worked again when it was set up anew" for error in tally.recovered]
    return [line if times == 1 else f"{line} ({times} times)" for line, times in Counter(lines).items()]
