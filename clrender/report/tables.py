"""The report's table next to our numbers, and work and noise of every setting, as text tables."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from clrender.drawing.table import Table
from clrender.report.founding import GROUPS
from clrender.report.results import Results, Row
from clrender.report.verdicts import Verdict
from clrender.report.wording import factor, significant

__all__ = ["noise_table", "times_table", "verdict_table"]


def times_table(results: Results) -> Table:
    """The report's Table 1, next to our times."""
    header = (
        "Test", "Samples", "Shadow rays", "Cores", "Deepest path: report", "Deepest path: ours", "Termination",
        "Time: report", "Time: ours", "CPU time", "Ratio: report", "Ratio: ours",
    )  # fmt: skip
    lines = []
    for group in GROUPS:
        base = group.rows[group.base]
        for theirs in group.rows:
            start = [group.title, str(theirs.samples), str(theirs.shadow_rays)]
            row = results.rows.get(theirs.run)
            if row is None:
                told = ["one", str(theirs.depth), "–", "–", theirs.clock, "left out", "–"]
                lines.append([*start, *told, factor(theirs.seconds / base.seconds), "–"])
                continue
            ratio = 1.0 if theirs is base else _ratio(results, row, results.rows[base.run])
            cores = "one" if not theirs.cores else f"all ({row.cores})" if row.cores else "all"
            lines.append(
                [
                    *start, cores, str(theirs.depth), _deepest(row), f"{row.termination}", theirs.clock,
                    f"{significant(row.seconds)} s", f"{significant(row.cpu_seconds)} s",
                    factor(theirs.seconds / base.seconds), factor(ratio),
                ]
            )  # fmt: skip
    caption = (
        f"Table 1: the report's benchmark. Its times (mm:ss) are for 800 × 800 pixels, ours for {results.width} × "
        f"{results.height}, medians. Ratios are relative to the row of the same test with ratio ×1; ours are ratios of "
        "CPU time, and of elapsed time for cores. Deepest path: scattering events of the deepest path, smallest and "
        "largest of the runs."
    )
    return Table(caption, header, lines)


def noise_table(results: Results) -> Table:
    """Work, error and efficiency of every setting."""
    header = (
        "Roulette", "Samples", "Shadow rays", "Runs", "Paths, M", "Rays, M", "Shadow rays, M", "Deepest path", "Time",
        "relMSE", "Display error", "Median pixel", "Efficiency",
    )  # fmt: skip
    lines = []
    for row in sorted(results.rows.values(), key=lambda row: (row.termination or 0.0, row.shadow_rays, row.samples)):
        if row.name.startswith("one-core"):
            continue
        told = "throughput" if row.termination is None else f"constant {row.termination}"
        typical = statistics.fmean(run.median_ratio for run in row.runs)
        work = [statistics.fmean(values) / 1e6 for values in (
            row.values(lambda run: run.paths), row.values(lambda run: run.rays), row.values(lambda run: run.shadow_rays)
        )]  # fmt: skip
        display_error = row.display_error
        half = f" ± {significant(100 * (display_error.high - display_error.value), 2)}" if display_error.known else ""
        lines.append(
            [
                told, str(row.samples), str(row.shadow_rays), str(len(row.runs)),
                *(significant(value) for value in work),
                _deepest(row), f"{significant(row.seconds)} s", _error(row),
                f"{significant(100 * display_error.value)}{half} %",
                f"{100 * typical:.1f} %", _efficiency(row),
            ]
        )  # fmt: skip
    caption = (
        "Table 2: work and noise of every setting. relMSE and efficiency, 1/(relMSE × s): ± is a 95 % t-interval "
        "over runs with different seeds; for rows marked with * the variance may be unbounded (see below), so the "
        "median is given with the smallest and the largest run. Display error: root mean square difference from the "
        "reference after the square root, clamped to 0–100 %. Median pixel: median of image over reference; below "
        "100 % most pixels lack light that is concentrated in a few."
    )
    return Table(caption, header, lines)


def verdict_table(found: Sequence[Verdict]) -> Table:
    """The verdicts on the conclusions.

    Parameters
    ----------
    found : sequence of Verdict
    """
    lines = [[each.claim, each.outcome, each.measured] for each in found]
    return Table(
        "The report's conclusions, and what the measurements say.", ("The report", "Verdict", "Measured"), lines, 3
    )


def _ratio(results: Results, row: Row, base: Row) -> float:
    if row.cores == 1 and base.cores != 1:
        # The runs on one core were measured alongside these runs on all cores.
        seeds = {run.seed for run in row.runs}
        return row.seconds / statistics.median(run.seconds for run in base.runs if run.seed in seeds)
    return row.cost / base.cost


def _deepest(row: Row) -> str:
    low, high = row.deepest
    return str(low) if low == high else f"{low}–{high}"


def _error(row: Row) -> str:
    values = row.values(lambda run: run.noise)
    return _told(values, row.bounded, row.noise.high - row.noise.value)


def _efficiency(row: Row) -> str:
    values = row.values(lambda run: run.efficiency)
    return _told(values, row.bounded, row.efficiency.high - row.efficiency.value)


def _told(values: Sequence[float], bounded: bool, half: float) -> str:
    if not bounded:
        return f"{significant(statistics.median(values))} ({significant(min(values))}–{significant(max(values))})*"
    mean = statistics.fmean(values)
    return f"{significant(mean)} ± {significant(half, 2)}" if len(values) > 1 else significant(mean)
