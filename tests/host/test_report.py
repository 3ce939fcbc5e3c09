"""The report's tables, plots and verdicts from made-up numbers: what they say follows the numbers."""

from __future__ import annotations

import dataclasses
import math
import os
import re
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable
from html import escape
from pathlib import Path

import numpy as np
import pytest
import scipy.stats
from cases import for_each

import clrender
from clrender.drawing.svg import BLUE
from clrender.errors import UsageError
from clrender.report import make_report
from clrender.report.drawing import hemisphere, room_dimensions
from clrender.report.founding import CLAIMS, GROUPS
from clrender.report.intervals import mean_interval, power_law, ratio_interval
from clrender.report.machine_load import MachineLoad
from clrender.report.page import Page, html_page, markdown_page
from clrender.report.pictures import Figure, Panel, figures, strip
from clrender.report.plan import ONE_CORE, SPECS
from clrender.report.plots import Series, plot, plots
from clrender.report.results import Results, Row, Run
from clrender.report.tables import noise_table, times_table, verdict_table
from clrender.report.termination import expected_deepest, survival_for, termination_for
from clrender.report.verdicts import FAILS, HOLDS, OPEN, verdicts
from clrender.report.wording import bounds, significant

Change = Callable[[Run, Row], Run]
SPREAD = (0.99, 1.0, 1.01, 1.0)


def made_up(change: Change = lambda run, row: run, one_core: bool = True) -> Results:
    """Results in which every conclusion of the report but the exponential time is right."""
    rows = {}
    for number, (name, spec) in enumerate(SPECS.items()):
        termination = {14: 0.3, 7: 0.35, 5: 0.4, None: None}[spec.deepest]
        growth = 0.0 if termination is None else 0.5
        row = Row(name, spec.samples, spec.shadow_rays, termination, 4, growth)
        for turn, off in enumerate(SPREAD):
            row.runs.append(_made_up_run(row, 100 * number + turn, off, spec.deepest or 14))
        rows[name] = row
    for name, twin in ONE_CORE.items() if one_core else ():
        alone = dataclasses.replace(rows[twin], name=name, cores=1, runs=[])
        # The more samples, the better four cores are used.
        gain = {4: 2.0, 16: 2.98, 64: 3.6}[alone.samples]
        alone.runs = [dataclasses.replace(run, seconds=gain * run.seconds) for run in rows[twin].runs[:3]]
        rows[name] = alone
    for row in rows.values():
        row.runs = [change(run, row) for run in row.runs]
    why = "" if one_core else "It cannot be held to one core."
    limited = [0.79, 0.80, 0.81]
    return Results(
        800, 800, False, "a processor", "a driver", 4, rows, why, 1.1, 1e-5, 768, 0.1, 0.6, limited, 3, 300.0
    )


def _made_up_run(row: Row, seed: int, off: float, deepest: int) -> Run:
    seconds = row.samples / 16.0 * {1: 1.0, 2: 1.71, 4: 3.1}[row.shadow_rays] * (0.9 + 0.1 * deepest / 14) * off
    paths = 640_000 * row.samples
    noise, display_error = 0.1 / row.samples / off, 0.1 / math.sqrt(row.samples) / off
    work = (paths, int(1.4 * paths), paths, deepest)
    return Run(seed, seconds, 4 * seconds, seconds, *work, noise, display_error, 0.9, 1.1 * off, str(seed))


def outcome(name: str, results: Results) -> str:
    return {each.name: each.outcome for each in verdicts(results)}[name]


def test_every_conclusion_has_a_verdict() -> None:
    assert {each.name for each in verdicts(made_up())} == set(CLAIMS)
    assert {each.outcome for each in verdicts(made_up())} <= {HOLDS, FAILS, OPEN}


@pytest.mark.parametrize("name", sorted(set(CLAIMS) - {"time"}))
def test_what_the_report_says_holds_of_numbers_like_its_own(name: str) -> None:
    assert outcome(name, made_up()) == HOLDS


def _times(where: Callable[[Row], bool], factor: Callable[[Row], float]) -> Change:
    def change(run: Run, row: Row) -> Run:
        times = factor(row) if where(row) else 1.0
        return dataclasses.replace(run, seconds=run.seconds * times, cost=run.cost * times)

    return change


def _errors(where: Callable[[Row], bool], factor: Callable[[Row], float]) -> Change:
    def change(run: Run, row: Row) -> Run:
        times = factor(row) if where(row) else 1.0
        return dataclasses.replace(run, noise=run.noise * times, display_error=run.display_error * math.sqrt(times))

    return change


def _deeper(run: Run, row: Row) -> Run:
    return dataclasses.replace(run, deepest=run.deepest + int(2 * math.log2(row.samples)))


def _only_shadow_rays_matter(run: Run, row: Row) -> Run:
    return dataclasses.replace(run, cost=1.0 + row.shadow_rays, display_error=0.1 / row.shadow_rays)


def _brighter(run: Run, row: Row) -> Run:
    return dataclasses.replace(run, mean=1.3 * run.mean)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("noise", _errors(lambda row: True, lambda row: math.sqrt(row.samples))),
        ("important", _only_shadow_rays_matter),
        ("shadow", _errors(lambda row: row.shadow_rays == 4, lambda row: 0.1)),
        ("light", _errors(lambda row: row.name == "depth-5", lambda row: 100.0)),
        ("bounces", _times(lambda row: row.name == "depth-5", lambda row: 0.1)),
        ("deepest", _deeper),
        ("roulette", _brighter),
        ("cores", _times(lambda row: row.name == "one-core", lambda row: 1.0 / 2.98)),
        ("more-cores", _times(lambda row: row.name == "one-core-64", lambda row: 0.3)),
    ],
)  # fmt: skip
def test_a_verdict_flips_with_its_numbers(name: str, change: Change) -> None:
    assert outcome(name, made_up(change)) == FAILS


def test_verdicts_on_single_numbers_flip() -> None:
    results = made_up()
    assert outcome("time", results) == FAILS
    assert outcome("time", made_up(_times(lambda row: True, lambda row: float(row.samples)))) == HOLDS
    assert outcome("limit", dataclasses.replace(results, limited=[1.09, 1.1, 1.11])) == FAILS
    assert outcome("indirect", dataclasses.replace(results, direct_mean=1.1)) == FAILS


def test_too_much_noise_decides_nothing() -> None:
    # Runs of the same setting that differ tenfold: no interval is on one side.
    def scattered(run: Run, row: Row) -> Run:
        return dataclasses.replace(
            run, cost=run.cost * 10.0 ** (run.seed % 3), noise=run.noise * 10.0 ** (run.seed % 2)
        )

    assert outcome("shadow", made_up(scattered)) == OPEN


def _scattered_times(run: Run, row: Row) -> Run:
    """Times of the shortest renders that differ threefold from run to run, and a gain that does not grow much."""
    times = (1.0, 3.0, 0.6)[run.seed % 3] if row.samples == 4 else 0.6 if row.name == "one-core-64" else 1.0
    return dataclasses.replace(run, seconds=run.seconds * times)


def test_scattered_times_and_a_busy_machine_decide_nothing() -> None:
    """Elapsed times of few runs, whose bounds overlap, or of a machine that does something else."""
    worse = _times(lambda row: row.name == "one-core-64", lambda row: 0.3)
    assert outcome("more-cores", made_up(_scattered_times)) == OPEN
    for name in ("cores", "more-cores"):
        busy = dataclasses.replace(made_up(worse), others=0.2)
        (verdict,) = (each for each in verdicts(busy) if each.name == name)
        assert verdict.outcome == OPEN and "Other programs took 20.0 % of the processor" in verdict.measured
    alone = made_up()
    alone.rows["one-core"].runs = alone.rows["one-core"].runs[:1]
    assert outcome("cores", alone) == outcome("more-cores", alone) == OPEN


def test_the_load_of_other_programs_is_that_of_the_system_without_this_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stat = tmp_path / "stat"
    monkeypatch.setattr("clrender.report.machine_load._STAT", stat)
    monkeypatch.setattr("os.sysconf", lambda name: 100)
    own = iter((1.0, 2.5, 2.5))
    monkeypatch.setattr("time.process_time", lambda: next(own))
    monkeypatch.setattr("os.times", lambda: os.times_result((0.0, 0.0, 0.5, 0.5, 0.0)))
    stat.write_text("cpu  100 0 50 1000 50 0 0 0 7 7\ncpu0 1 2 3\n")
    load = MachineLoad()
    # Ten seconds of the processors, 5.5 of them busy: 1.5 by this process
    stat.write_text("cpu  400 100 200 1400 100 0 0 0 7 7\n")
    assert load.share() == pytest.approx(0.4)
    stat.unlink()
    assert MachineLoad().share() == 0.0


def test_one_core_left_out_is_said() -> None:
    results = made_up(one_core=False)
    assert not {"cores", "more-cores"} & {each.name for each in verdicts(results)}
    line = times_table(results).rows[-1]
    assert line[3] == "one" and "left out" in line and line[-2] == "×2.98"
    assert "cannot be held to one core" in markdown_page(Page(results, [], []))


def test_the_images_of_one_core_are_compared() -> None:
    def other(run: Run, row: Row) -> Run:
        return dataclasses.replace(run, sha256="another") if row.name == "one-core" else run

    assert "NOT the same" in {each.name: each.measured for each in verdicts(made_up(other))}["cores"]


def test_the_table_has_the_reports_numbers_beside_ours() -> None:
    table = times_table(made_up())
    assert len(table.rows) == sum(len(group.rows) for group in GROUPS) == 11
    assert all(len(row) == len(table.header) for row in table.rows)
    clocks = [row[7] for row in table.rows]
    assert clocks == ["44:59", "12:00", "02:56", "01:43", "02:56", "05:20", "01:43", "01:35", "01:31", "01:43", "05:07"]
    theirs, ours = [row[-2] for row in table.rows], [row[-1] for row in table.rows]
    assert theirs[0] == "×15.3" and theirs[5] == "×3.11" and theirs[8] == "×0.883" and theirs[10] == "×2.98"
    assert ours[0] == "×16.0" and ours[5] == "×3.10" and ours[10] == "×2.98"


def test_rows_without_a_bound_are_marked() -> None:
    results = made_up()
    results.rows["base"].growth = 1.8
    marked = [row for row in noise_table(results).rows if any(text.endswith("*") for text in row)]
    assert len(marked) == 1 and marked[0][0] == "constant 0.3"
    assert not any("*" in text for row in noise_table(made_up()).rows for text in row)


# --- intervals --------------------------------------------------------------------------------------------------------


def test_intervals_are_those_of_scipy() -> None:
    values = [1.0, 1.4, 0.9, 1.3, 1.15]
    interval = mean_interval(values)
    expected = scipy.stats.t.interval(0.95, 4, np.mean(values), scipy.stats.sem(values))
    assert (interval.low, interval.high) == pytest.approx(expected, rel=1e-9)
    x = np.array([1.0, 1.0, 4.0, 4.0, 16.0, 64.0])
    y = np.array([1.1, 0.9, 0.26, 0.24, 0.06, 0.017])
    fit = scipy.stats.linregress(np.log(x), np.log(y))
    power = power_law(list(zip(x.tolist(), y.tolist(), strict=True)))
    assert power.value == pytest.approx(fit.slope)
    assert power.high - power.value == pytest.approx(fit.stderr * scipy.stats.t.ppf(0.975, 4), rel=1e-9)


@pytest.mark.long
def test_ratio_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """2000 intervals of 95 %: 1900 ± 10 hold it, five standard deviations allowed, and a little more for Welch.

    Intervals by the normal distribution in the place of Student's hold it 1790 times.
    """
    random = np.random.default_rng(1)
    draws = np.exp(0.2 * random.standard_normal((2000, 11)))
    inside = sum(ratio_interval((3.0 * row[:5]).tolist(), row[5:].tolist()).holds(3.0) for row in draws)
    assert 1850 < inside < 1965


def test_one_run_has_no_interval() -> None:
    assert not mean_interval([2.0]).known and not ratio_interval([2.0], [1.0]).known
    assert bounds(mean_interval([2.0])) == "2.00"


# --- termination ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("deepest", [5, 7, 14])
def test_termination_gives_the_deepest_path_asked_for(deepest: int) -> None:
    """The likeliest deepest of a thousand simulated renders is the one asked for."""
    paths, random = 1_000_000, np.random.default_rng(deepest)
    survival = survival_for(deepest, paths)
    # The greatest of n geometric numbers, by its distribution function: P(all <= k) = (1 - s^k)^n.
    found = np.ceil(np.log1p(-(random.random(1000) ** (1.0 / paths))) / math.log(survival))
    assert scipy.stats.mode(found).mode == deepest
    # And no other probability makes it likelier.
    likely = [
        (1.0 - s**deepest) ** paths - (1.0 - s ** (deepest - 1)) ** paths
        for s in (0.97 * survival, survival, 1.03 * survival)
    ]
    assert likely[1] > max(likely[0], likely[2])
    assert abs(expected_deepest(survival, paths) - deepest) < 1.0
    assert termination_for(deepest, paths, 0.9) < termination_for(deepest, paths, 1.0) == pytest.approx(1.0 - survival)


# --- what is shown ----------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_plot_puts_points_where_they_belong() -> None:
    points = [(1.0, 1.0, 0.5, 2.0), (10.0, 10.0, 10.0, 10.0), (100.0, 100.0, 100.0, 100.0)]
    svg = plot("one", "A <plot> & more", ("x", "y"), [Series("one", points, BLUE)], (1, 10, 100)).svg
    drawn = ET.fromstring(svg)
    marks = [use for use in drawn.iter() if use.tag.endswith("use") and "clip-path" not in use.attrib]
    dots = [(float(use.get("x", "")), float(use.get("y", ""))) for use in _markers(drawn)]
    assert marks and len(dots) == 3
    (x0, y0), (x1, y1), (x2, y2) = dots
    assert x1 - x0 == pytest.approx(x2 - x1, abs=0.2) and y1 - y0 == pytest.approx(y2 - y1, abs=0.2)
    assert x2 > x0 and y2 < y0
    assert "A <plot> & more" in "".join(drawn.itertext())


def _markers(drawn: ET.Element) -> list[ET.Element]:
    """Uses of the first round marker inside the axes."""
    groups = [group for group in drawn.iter() if group.tag.endswith("}g") and "clip-path" in group.attrib]
    return [use for group in groups for use in group if use.tag.endswith("use")][-3:]


def test_the_same_plot_is_the_same_bytes_and_names_nothing_outside() -> None:
    first, again = (plots(made_up()) for _ in range(2))
    assert [each.svg for each in first] == [each.svg for each in again]
    for each in first:
        assert not re.search(r"<\?xml|<!DOCTYPE|<metadata|@import|url\((?!#)|href=\"(?!#)", each.svg)
    names = [re.findall(r' id="([^"]*)"', each.svg) for each in first]
    together = [name for one in names for name in one]
    assert len(set(together)) == len(together), "plots of one page must not share the names of their clip paths"


def test_without_matplotlib_the_report_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(
        UsageError, match=r"Matplotlib, which is not installed; install it with `.*pip install 'matplotlib[^']*'`"
    ):
        make_report((16, 16), quick=True)


def test_drawings_are_svg_with_the_rooms_dimensions() -> None:
    for name in ("room", "room-mirror", "room-report"):
        drawn = ET.fromstring(room_dimensions(clrender.load(name)))
        texts = [text.text for text in drawn.iter() if text.tag.endswith("text")]
        assert texts.count("4 m") == 3 and texts.count("8 m") == 1
    assert len([use for use in ET.fromstring(hemisphere(50)).iter() if use.tag.endswith("use")]) == 50


def test_the_page_and_the_markdown_say_the_same() -> None:
    results = made_up()
    names = ("reference", "direct", "mirror", "path", "whitted", *SPECS)
    random = np.random.default_rng(1)
    images = {name: random.random((40, 40, 3)) for name in names}
    page = Page(results, figures(images, results), plots(results))
    html, markdown = html_page(page), markdown_page(page)
    for table in (times_table(results), verdict_table(verdicts(results))):
        assert html.count("<tr") >= len(table.rows)
        for row in table.rows:
            assert all(escape(text) in html and text in markdown for text in row)
    for figure in page.figures:
        assert f'id="{figure.name}"' in html and f"(report-{figure.name}.jpg)" in markdown
    assert html.count("<svg") == len(page.plots) == 3
    # The contents lead to each heading, and on the page also to each figure.
    headings = re.findall(r"^## (.+)$", markdown, re.MULTILINE)
    contents = re.findall(r"^- \[(.+)\]\(#(.+)\)$", markdown, re.MULTILINE)
    assert [heading for heading, _ in contents] == headings == re.findall(r"<h2[^>]*>(.+?)</h2>", html)
    anchors = [anchor for _, anchor in contents]
    assert re.findall(r'<h2 id="(.+?)"', html) == anchors == [each.lower().replace(" ", "-") for each in headings]
    nav = html[html.index("<nav") : html.index("</nav>")]
    linked = re.findall(r'href="#(.+?)"', nav)
    assert sorted(linked) == sorted([*anchors, *(figure.name for figure in page.figures)])
    assert html.index("</nav>") < html.index("<h2") and markdown.index("- [") < markdown.index("## ")


def test_the_committed_page_has_the_contents() -> None:
    text = (Path(__file__).resolve().parents[2] / "docs" / "report.md").read_text()
    contents = re.findall(r"^- \[(.+)\]\(#(.+)\)$", text, re.MULTILINE)
    assert [heading for heading, _ in contents] == re.findall(r"^## (.+)$", text, re.MULTILINE)


def test_a_busy_machine_is_said() -> None:
    def slowed(run: Run, row: Row) -> Run:
        return dataclasses.replace(run, seconds=2.0 * run.seconds)

    assert "only 50.0 % of its cores were available" in markdown_page(Page(made_up(slowed), [], []))
    assert "busy" not in markdown_page(Page(made_up(), [], []))
    # Ratios are of processor time, so they stay.
    assert [row[-1] for row in times_table(made_up(slowed)).rows] == [row[-1] for row in times_table(made_up()).rows]


def test_words_are_escaped() -> None:
    results = dataclasses.replace(made_up(), device="<script>alert(1)</script>")
    assert "<script" not in html_page(Page(results, [], []))


def test_a_strip_is_small() -> None:
    noise = np.random.default_rng(1).integers(0, 256, (400, 400, 3), np.uint8)
    panels = [Panel(noise, "noise")] * 3
    assert len(strip(Figure("a", "A", "", [panels, panels]))) <= 60_000


@for_each(
    ("value", "text"), [(15.34, "15.3"), (0.000123, "0.000123"), (1234567.0, "1 230 000"), (0.0, "0"), (1.0, "1.00")]
)
def test_significant_digits(value: float, text: str) -> None:
    assert significant(value) == text
