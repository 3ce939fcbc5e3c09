"""The words of the report's page: what it is, how it was measured, and why our numbers are other ones."""

from __future__ import annotations

from typing import Final

from clrender.report.founding import GROUPS, TITLE
from clrender.report.results import Results
from clrender.report.wording import percent, significant
from clrender.version import __version__

__all__ = ["differences", "introduction", "method"]

_BUSY: Final = 0.85
"""Share of the cores below which the page says that the machine was busy."""


def introduction(results: Results) -> list[str]:
    """Paragraphs at the top."""
    size, usual = (results.width, results.height), (160, 160) if results.quick else (800, 800)
    kind = "the report's own size" if size == (800, 800) else "not the report's own 800 × 800"
    command = "clrender report" + " --quick" * results.quick
    if size != usual:
        command += f" --size {results.width}x{results.height}"
    if results.quick:
        kind += ", with few runs: for a look, not for conclusions"
    cores = f", {results.cores} cores" if results.cores else ""
    busy = (
        f" The machine was busy with other things: it gave {percent(results.share_of_cores)} of its cores, and "
        "times by the clock are longer for it."
        if results.share_of_cores < _BUSY
        else ""
    )
    return [
        f"clrender grew out of a report on one Monte Carlo ray tracer ({TITLE}). This page renders its benchmark "
        "table and its figures again, puts its numbers beside ours, and says what holds of its conclusions. Every "
        "verdict is computed from the numbers on this page.",
        f"Made by clrender {__version__} with “{command}” at {results.width} × {results.height} pixels ({kind}) on "
        f"{results.device}{cores} ({results.driver}) in {significant(results.seconds / 60.0, 2)} minutes. Scene of "
        f"the table: room-report.{busy}",
    ]


def method(results: Results) -> list[str]:
    """How it was measured, and what is assumed."""
    row = results.rows["base"]
    one_core = (
        "One core: PoCL reads how many threads it may have when it starts, so these renders are a process of their "
        "own; one render comes first there and does not count. The ratio is to those renders of all cores that lay "
        "beside them."
    )
    if results.no_one_core:
        one_core = f"The line with one core is left out: {results.no_one_core}"
    cost = "processor seconds over cores, as an idle machine would take" if results.cores else "seconds by the clock"
    return [
        "Settings are rendered in turns, every run with a seed of its own, so that what else the machine does "
        "falls on all alike. Time is from the first launch to the last result: without compiling, reading the "
        f"scene and building its tree. Efficiency and ratios in verdicts use {cost}.",
        "Absorption: the report varies it and tells the deepest path that it saw, and so do we. With n paths that "
        "go on with probability s, the likeliest deepest path follows from s alone; a short render tells how many "
        "paths end on lights. Table 1 shows the deepest paths that came of it. Depth counts scattering events, the "
        "last shadow ray's included.",
        "Noise is relMSE, the mean over pixels and channels of (x − r)² / (r² + 0.01), against a reference r of "
        f"{results.reference_samples} samples a pixel, other seeds and clrender's roulette. The reference is made "
        f"of two halves, whose difference tells its own relMSE ({significant(results.reference_noise, 2)}), which "
        "is taken off. Intervals are Student's t at 95 %, each by itself; they take runs to be independent, which "
        "seeds make them, and their means to be normally distributed; ratios are taken in logarithms (Welch).",
        "The last does not hold of relMSE where variance has no bound. The roulette ends a path with probability α "
        "at every hit and divides the others by 1 − α; between surfaces of reflectance ρ the mean square of a "
        f"path's weight is multiplied by ρ²/(1 − α) at each bounce, here {row.growth:.2f} on the white walls at α = "
        f"{row.absorption}. Above 1 it can grow without end, and more samples meet ever rarer, ever brighter paths. "
        "Such rows are marked with * and judged by the visible error, which is bounded; and the questions about "
        "samples and shadow rays are answered with clrender's roulette as well, whose variance is finite.",
        one_core,
    ]


def differences(results: Results) -> list[str]:
    """Why our numbers are not the report's."""
    base, theirs = results.rows["base"], GROUPS[1].rows[0]
    pixels = 800 * 800 / (results.width * results.height)
    faster = theirs.seconds / (base.cost * pixels)
    return [
        f"Per path, with 16 samples and one shadow ray, the report's program took {significant(faster)} times as "
        "long as clrender here. Its processor is not named, so only ratios can be compared. Its program is C++ "
        "with one pixel to a software thread and, as far as it tells, tests every object for every ray; clrender "
        "takes sixteen paths at a time through a tree of boxes in vector instructions, in single precision.",
        "Ratios differ too. A shadow ray here costs less than a path's other work (it stops at the first thing in "
        "its way), so further shadow rays are cheaper than the report's, while each further bounce is a larger "
        "share of a path that has next to no overhead. Our room is made after the report's description; its exact "
        "objects and reflectances are not known, nor whether its roulette divides by 1 − α.",
    ]
