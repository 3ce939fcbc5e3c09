"""The prose of the report's page: introduction, method, and reasons why our numbers differ."""

from __future__ import annotations

from typing import Final

from clrender.report.founding import GROUPS, TITLE
from clrender.report.results import Results
from clrender.report.wording import percent, significant
from clrender.version import __version__
from clrender.wording import counted

__all__ = ["differences", "introduction", "method"]

_BUSY: Final = 0.85
"""Fraction of the cores below which the page notes that the machine was busy."""


def introduction(results: Results) -> list[str]:
    """Paragraphs at the top."""
    size, usual = (results.width, results.height), (160, 160) if results.quick else (800, 800)
    kind = "the report's own size" if size == (800, 800) else "not the report's own 800 × 800"
    command = "clrender report" + " --quick" * results.quick
    if size != usual:
        command += f" --size {results.width}x{results.height}"
    if results.quick:
        kind += "; few runs, not enough for conclusions"
    cores = f", {results.cores} cores" if results.cores else ""
    busy = (
        f" The machine was busy: only {percent(results.share_of_cores)} of its cores were available, so elapsed times "
        "are longer than on an idle machine."
        if results.share_of_cores < _BUSY
        else ""
    )
    return [
        f"clrender grew out of a report on a Monte Carlo ray tracer ({TITLE}). This page reproduces its benchmark "
        "table and its figures, compares its numbers with ours, and tests its conclusions. Every verdict is computed "
        "from the numbers on this page.",
        f"Made with clrender {__version__}, “{command}”, at {results.width} × {results.height} pixels ({kind}) on "
        f"{results.device}{cores} ({results.driver}) in {significant(results.seconds / 60.0, 2)} minutes. Scene of "
        f"the table: room-report.{busy}",
    ]


def method(results: Results) -> list[str]:
    """Paragraphs on the method of measurement and its assumptions."""
    row = results.rows["base"]
    one_core = (
        "One core: PoCL reads its number of threads when it starts, so these renders run in a process of their own, "
        "after one render that does not count. They are compared with the renders on all cores of the same turns."
    )
    if results.no_one_core:
        one_core = f"The row with one core is missing: {results.no_one_core}"
    cost = "CPU time divided by the number of cores" if results.cores else "elapsed time"
    return [
        "Settings are rendered in turns, every run with a seed of its own, so that other load on the machine affects "
        "all of them alike. Time is measured from the first launch to the last result: without compiling, reading "
        f"the scene and building its BVH. Efficiency and ratios in verdicts use {cost}.",
        "Termination probability: the report varies it and states the deepest path that occurred; so do we. For n "
        "paths that survive each hit with probability s, the most probable deepest path follows from s and n; a short "
        "render measures how many paths end on lights. Table 1 shows the deepest paths that resulted. Depth counts "
        "scattering events, including the one that the last shadow ray serves.",
        "Noise is relMSE, the mean over pixels and channels of (x − r)² / (r² + 0.01), against a reference r of "
        f"{counted(results.reference_samples, 'sample')} per pixel, with other seeds and clrender's roulette. The "
        "reference is "
        "the mean of two renders, whose difference gives its own relMSE "
        f"({significant(results.reference_noise, 2)}), which is subtracted. Intervals are 95 % t-intervals, each by "
        "itself. They assume that runs are independent, which their seeds ensure, and that their means are normally "
        "distributed; ratios are computed in logarithms (Welch).",
        "The second assumption does not hold for relMSE where the variance is unbounded. The roulette ends a path "
        "with probability α at every hit and divides the others by 1 − α; between surfaces of reflectance ρ the mean "
        "square of a path's weight is multiplied by ρ²/(1 − α) at each bounce, here "
        f"{row.growth:.2f} on the white walls at α = {row.termination}. Above 1 it can grow without bound: more "
        "samples find ever rarer, ever brighter paths. Such rows are marked with * and judged by the display error, "
        "which is bounded. The questions about samples and shadow rays are also answered with clrender's roulette, "
        "whose variance is finite.",
        one_core,
    ]


def differences(results: Results) -> list[str]:
    """Paragraphs on why our numbers differ from the report's."""
    base, theirs = results.rows["base"], GROUPS[1].rows[0]
    pixels = 800 * 800 / (results.width * results.height)
    faster = theirs.seconds / (base.cost * pixels)
    return [
        f"Per path, with 16 samples and one shadow ray, the report's program took {significant(faster)} times as "
        "long as clrender here. Its processor is not named, so only ratios can be compared. It is written in C++, "
        "renders one pixel per software thread and, as far as the report says, tests every object for every ray; "
        "clrender traces sixteen paths at a time through a BVH with vector instructions, in single precision.",
        "Ratios differ too. A shadow ray is cheap here, as it stops at the first occluder, so additional shadow rays "
        "cost less than the report's. Each additional bounce costs more, relative to a path with hardly any "
        "overhead. Our room follows the report's description; its exact objects and reflectances are unknown, and "
        "so is whether its roulette divides by 1 − α.",
    ]
