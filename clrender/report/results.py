"""What was measured, as data: runs, rows of runs, and all of them together."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from clrender.report.intervals import Interval, mean_interval

__all__ = ["Results", "Row", "Run"]


@dataclass(frozen=True)
class Run:
    """One render.

    Attributes
    ----------
    seed : int
    seconds, cpu_seconds : float
        From the first launch to the last result: by the clock, and of all of this process's threads.
    cost : float
        Seconds that an idle machine would take: processor seconds over cores on a CPU, else seconds by the clock.
    paths, rays, shadow_rays, deepest : int
        Camera paths; closest-hit rays; shadow rays; scattering events of the deepest path.
    noise : float
        relMSE against the reference, less the reference's own.
    seen : float
        Root mean square difference from it of what a display shows, both through the square root and cut to 0..1.
    typical : float
        Median over pixels and channels of this image over the reference: below 1 where rare paths carry much.
    mean : float
        Radiance, over pixels and channels.
    sha256 : str
        Of the image's linear pixels.
    """

    seed: int
    seconds: float
    cpu_seconds: float
    cost: float
    paths: int
    rays: int
    shadow_rays: int
    deepest: int
    noise: float
    seen: float
    typical: float
    mean: float
    sha256: str = ""

    @property
    def efficiency(self) -> float:
        """1 / (relMSE x seconds)."""
        return 1.0 / (self.noise * self.cost)

    @property
    def seen_efficiency(self) -> float:
        """The same of the error that is seen: 1 / (its square x seconds)."""
        return 1.0 / (self.seen**2 * self.cost)


@dataclass
class Row:
    """The runs of one setting, each with a seed of its own.

    Attributes
    ----------
    name : str
    samples, shadow_rays : int
    absorption : float or None
        Of the roulette by absorption; None: the roulette by throughput, clrender's own.
    cores : int
        That may work; 0 on a device that is no CPU.
    growth : float
        What a bounce between the brightest surfaces multiplies the mean square of a path's weight by: reflectance
        squared over 1 - absorption. From 1 on, the variance of a pixel may have no bound; 0 with clrender's roulette.
    runs : list of Run
    """

    name: str
    samples: int
    shadow_rays: int
    absorption: float | None
    cores: int
    growth: float = 0.0
    runs: list[Run] = field(default_factory=list)

    def values(self, of: Callable[[Run], float]) -> list[float]:
        """One number of each run."""
        return [of(run) for run in self.runs]

    @property
    def seconds(self) -> float:
        """Median, by the clock."""
        return statistics.median(run.seconds for run in self.runs)

    @property
    def cpu_seconds(self) -> float:
        """Median, of the processor."""
        return statistics.median(run.cpu_seconds for run in self.runs)

    @property
    def cost(self) -> float:
        """Median of the runs' costs: seconds on an idle machine."""
        return statistics.median(run.cost for run in self.runs)

    @property
    def noise(self) -> Interval:
        """relMSE."""
        return mean_interval(self.values(lambda run: run.noise))

    @property
    def efficiency(self) -> Interval:
        """1 / (relMSE x seconds)."""
        return mean_interval(self.values(lambda run: run.efficiency))

    @property
    def bounded(self) -> bool:
        """Whether the variance of a pixel is surely finite, as intervals of relMSE need it to be."""
        return self.growth < 1.0

    @property
    def seen(self) -> Interval:
        """Root mean square difference of what a display shows; bounded, so its interval holds always."""
        return mean_interval(self.values(lambda run: run.seen))

    @property
    def deepest(self) -> tuple[int, int]:
        """Least and greatest of the runs."""
        depths = [run.deepest for run in self.runs]
        return min(depths), max(depths)


@dataclass
class Results:
    """Everything measured.

    Attributes
    ----------
    width, height : int
    quick : bool
    device, driver : str
    cores : int
        Of the CPU that renders; 0 on a device that is none.
    rows : dict
        Name -> Row; ``one-core`` is absent where one core alone could not be had.
    no_one_core : str
        Why, then; else empty.
    reference_mean, reference_noise : float
        Radiance of the reference over pixels and channels; its own relMSE, which every run's is lessened by.
    reference_samples : int
    emitted_mean, direct_mean : float
        Radiance of the lights as they are seen; of them and of direct light alone.
    limited : list of float
        Means of renders whose paths scatter `limit` times at most.
    limit : int
    seconds : float
        The whole report took.
    """

    width: int
    height: int
    quick: bool
    device: str
    driver: str
    cores: int
    rows: dict[str, Row]
    no_one_core: str
    reference_mean: float
    reference_noise: float
    reference_samples: int
    emitted_mean: float
    direct_mean: float
    limited: list[float]
    limit: int
    seconds: float = 0.0

    def each(self, names: Sequence[str]) -> list[Row]:
        """Those of these rows that there are."""
        return [self.rows[name] for name in names if name in self.rows]

    @property
    def share_of_cores(self) -> float:
        """What the machine gave of its cores to the renders that had all of them; 1 where they are no CPU's."""
        if not self.cores:
            return 1.0
        runs = [run for row in self.rows.values() if row.cores == self.cores for run in row.runs]
        return sum(run.cpu_seconds for run in runs) / (sum(run.seconds for run in runs) * self.cores)

    def beside_reference(self, mean: float) -> float:
        """A mean radiance over the reference's, both without the lights that are seen, less 1."""
        return (mean - self.emitted_mean) / (self.reference_mean - self.emitted_mean) - 1.0

    def as_json(self) -> dict[str, Any]:
        """All of it as plain data."""
        from dataclasses import asdict

        plain = asdict(self)
        for name, row in self.rows.items():
            plain["rows"][name] |= {
                "seconds": row.seconds,
                "cpu_seconds": row.cpu_seconds,
                "deepest": row.deepest,
                "noise": _bounds(row.noise),
                "efficiency": _bounds(row.efficiency),
                "seen": _bounds(row.seen),
                "bounded": row.bounded,
            }
        return plain


def _bounds(interval: Interval) -> dict[str, float] | None:
    return {"value": interval.value, "low": interval.low, "high": interval.high} if interval.known else None
