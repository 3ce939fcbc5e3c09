"""Measurements as data: runs, rows of runs, and all rows together."""

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
        Elapsed time from the first launch to the last result, and CPU time of all threads of this process.
    cost : float
        Seconds that an idle machine would take: CPU time over cores on a CPU, else elapsed time.
    paths, rays, shadow_rays, deepest : int
        Camera paths; closest-hit rays; shadow rays; scattering events of the deepest path.
    noise : float
        relMSE against the reference, minus the reference's own.
    display_error : float
        Display error: root mean square difference from the reference, both after the square root and clamped to 0..1.
    median_ratio : float
        Median over pixels and channels of image / reference: below 1 if rare paths contribute much.
    mean : float
        Radiance, over pixels and channels.
    sha256 : str
        Hash of the image's linear pixels.
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
    display_error: float
    median_ratio: float
    mean: float
    sha256: str = ""

    @property
    def efficiency(self) -> float:
        """1 / (relMSE x seconds)."""
        return 1.0 / (self.noise * self.cost)


@dataclass
class Row:
    """The runs of one setting, each with a different seed.

    Attributes
    ----------
    name : str
    samples, shadow_rays : int
    termination : float or None
        Probability of the constant roulette; None: clrender's own roulette, by throughput.
    cores : int
        Available to the run; 0 on a device that is not a CPU.
    growth : float
        Factor by which a bounce between the brightest surfaces multiplies the mean square of a path's weight:
        reflectance squared over 1 - termination. From 1 on, a pixel's variance may be unbounded; 0 with clrender's
        roulette.
    runs : list of Run
    """

    name: str
    samples: int
    shadow_rays: int
    termination: float | None
    cores: int
    growth: float = 0.0
    runs: list[Run] = field(default_factory=list)

    def values(self, of: Callable[[Run], float]) -> list[float]:
        """One value of each run."""
        return [of(run) for run in self.runs]

    @property
    def seconds(self) -> float:
        """Median elapsed time."""
        return statistics.median(run.seconds for run in self.runs)

    @property
    def cpu_seconds(self) -> float:
        """Median CPU time."""
        return statistics.median(run.cpu_seconds for run in self.runs)

    @property
    def cost(self) -> float:
        """Median cost: seconds on an idle machine."""
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
        """Whether the variance of a pixel is known to be finite, which intervals of relMSE require."""
        return self.growth < 1.0

    @property
    def display_error(self) -> Interval:
        """Display error; it is bounded, so its interval is always valid."""
        return mean_interval(self.values(lambda run: run.display_error))

    @property
    def deepest(self) -> tuple[int, int]:
        """Smallest and largest deepest path of the runs."""
        depths = [run.deepest for run in self.runs]
        return min(depths), max(depths)


@dataclass
class Results:
    """All measurements.

    Attributes
    ----------
    width, height : int
    quick : bool
    device, driver : str
    cores : int
        Cores of the rendering CPU; 0 on other devices.
    rows : dict
        Rows by name; without ``one-core`` if rendering could not be restricted to one core.
    no_one_core : str
        The reason for its absence; else empty.
    reference_mean, reference_noise : float
        Radiance of the reference over pixels and channels; its own relMSE, which is subtracted from every run's.
    reference_samples : int
    emitted_mean, direct_mean : float
        Mean radiance of directly visible lights; that with direct light added.
    limited : list of float
        Means of renders whose paths have at most `limit` scattering events.
    limit : int
    seconds : float
        Duration of the whole report.
    others : float
        Part of the processor, 0 to 1, that other programs took while the rows were rendered.
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
    others: float = 0.0

    def each(self, names: Sequence[str]) -> list[Row]:
        """The rows of these names that exist."""
        return [self.rows[name] for name in names if name in self.rows]

    @property
    def share_of_cores(self) -> float:
        """Fraction of the cores that the renders on all cores actually used; 1 on devices that are not CPUs."""
        if not self.cores:
            return 1.0
        runs = [run for row in self.rows.values() if row.cores == self.cores for run in row.runs]
        return sum(run.cpu_seconds for run in runs) / (sum(run.seconds for run in runs) * self.cores)

    def beside_reference(self, mean: float) -> float:
        """Relative difference of a mean radiance from the reference's, both without directly visible lights."""
        return (mean - self.emitted_mean) / (self.reference_mean - self.emitted_mean) - 1.0

    def as_json(self) -> dict[str, Any]:
        """Everything as plain data."""
        from dataclasses import asdict

        plain = asdict(self)
        for name, row in self.rows.items():
            plain["rows"][name] |= {
                "seconds": row.seconds,
                "cpu_seconds": row.cpu_seconds,
                "deepest": row.deepest,
                "noise": _bounds(row.noise),
                "efficiency": _bounds(row.efficiency),
                "display_error": _bounds(row.display_error),
                "bounded": row.bounded,
            }
        return plain


def _bounds(interval: Interval) -> dict[str, float] | None:
    return {"value": interval.value, "low": interval.low, "high": interval.high} if interval.known else None
