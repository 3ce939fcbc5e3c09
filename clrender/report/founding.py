"""The founding report's measurements and conclusions: its Table 1, and its sentences quoted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

__all__ = ["CLAIMS", "GROUPS", "TITLE", "FoundingRow", "Group"]

TITLE: Final = "V. Tholen and J. Halldan, Global Illumination Report TNCG15, Linköping University, 2021"


@dataclass(frozen=True)
class FoundingRow:
    """A line of the report's Table 1.

    Attributes
    ----------
    run : str
        Name of our run that reproduces it (`clrender.report.plan.SPECS`).
    seconds : int
        Time of the render.
    samples, shadow_rays : int
        Per pixel; per hit.
    depth : int
        Depth of the deepest path.
    cores : bool
        Whether it used all cores of the CPU.
    """

    run: str
    seconds: int
    samples: int
    shadow_rays: int
    depth: int
    cores: bool = True

    @property
    def clock(self) -> str:
        """The time as the report prints it, mm:ss."""
        return f"{self.seconds // 60:02d}:{self.seconds % 60:02d}"


@dataclass(frozen=True)
class Group:
    """Lines that vary one parameter; `base` is the line that the others are compared with."""

    title: str
    rows: tuple[FoundingRow, ...]
    base: int


GROUPS: Final = (
    Group(
        "Samples",
        (
            FoundingRow("samples-256", 44 * 60 + 59, 256, 2, 13),
            FoundingRow("samples-64", 12 * 60, 64, 2, 14),
            FoundingRow("samples-16", 2 * 60 + 56, 16, 2, 13),
        ),
        2,
    ),
    Group(
        "Shadow rays",
        (
            FoundingRow("base", 103, 16, 1, 14),
            FoundingRow("samples-16", 176, 16, 2, 14),
            FoundingRow("shadow-4", 320, 16, 4, 14),
        ),
        0,
    ),
    Group(
        "Depth",
        (
            FoundingRow("base", 103, 16, 1, 14),
            FoundingRow("depth-7", 95, 16, 1, 7),
            FoundingRow("depth-5", 91, 16, 1, 5),
        ),
        0,
    ),
    Group(
        "Cores",
        (FoundingRow("base", 103, 16, 1, 14), FoundingRow("one-core", 307, 16, 1, 14, cores=False)),
        0,
    ),
)
"""The report's Table 1: 800 x 800 pixels, on an unnamed CPU."""

CLAIMS: Final = {
    "time": "“The sample amount … will cause an exponential increase in computations.”",
    "important": "The sample amount is “arguably the most important modifiable parameter”.",
    "noise": "“The samples greatly affects the time but it also affects the amount of noise”; convergence is “slow”.",
    "shadow": "“There is barely any difference between the images which tends to suggest that one shadow ray is "
    "sufficient enough.”",
    "light": "With fewer bounces “a slight difference in reflected light can be observed though the differences are "
    "small”.",
    "bounces": "“The additional time for the extra bounces is relative small compared to other parameters impact.”",
    "cores": "Parallelization “reduced render times significantly”.",
    "more-cores": "Parallelization “did reduce it even further on renders with higher sample numbers”.",
    "roulette": "By Russian roulette “the method will mathematically still be converging to the desired result”.",
    "limit": "A constant ray limit “adds bias”.",
    "indirect": "“The effect of the indirect illumination can easily be distinguished.”",
    "deepest": "More samples found no deeper path: 13 of 256 samples, 14 of 64, 13 of 16 (Table 1).",
}
"""Conclusions by name."""
