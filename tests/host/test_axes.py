"""Axes and curves of plots: ticks that can be read, and curves that can be told apart without colour vision."""

from __future__ import annotations

import itertools
import math
import re

import numpy as np
import numpy.typing as npt
import pytest
from cases import for_each

from clrender.drawing.axes import log_axis, log_ticks, plain_number
from clrender.drawing.svg import GREY, PAPER, draw, line_style


@for_each(
    ("value", "percent", "text"),
    [
        (1.0, False, "1"),
        (10.0, False, "10"),
        (1000.0, False, "1,000"),
        (65536.0, False, "65,536"),
        (0.05, False, "0.05"),
        (0.1 + 0.2, False, "0.3"),
        (1e-5, False, "0.00001"),
        (2e-8, False, "2 × 10⁻⁸"),
        (0.0, False, "0"),
        (0.001, True, "0.1 %"),
        (0.07, True, "7 %"),
        (10.0, True, "1,000 %"),
    ],
)
def test_numbers_are_plain(value: float, percent: bool, text: str) -> None:
    assert plain_number(value, percent) == text


@for_each(
    ("low", "high", "ticks"),
    [
        (0.9, 1100.0, [1.0, 10.0, 100.0, 1000.0]),
        (0.0015, 0.15, [0.002, 0.005, 0.01, 0.02, 0.05, 0.1]),
        (0.9, 70.0, [1.0, 2.0, 5.0, 10.0, 20.0, 50.0]),
        (1.9, 8.1, [2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]),
        (0.0521, 0.0538, [0.0525, 0.053, 0.0535]),
        (1.9, 510.0, [3.0, 10.0, 30.0, 100.0, 300.0]),
        (0.21, 1.05, [0.4, 0.6, 0.8, 1.0]),
        (1e-9, 1e3, [1e-8, 1e-6, 1e-4, 0.01, 1.0, 100.0]),
    ],
)
def test_ticks_are_round_and_few(low: float, high: float, ticks: list[float]) -> None:
    assert log_ticks(low, high) == pytest.approx(ticks, rel=1e-12)


def test_every_range_has_ticks() -> None:
    generator = np.random.default_rng(1)
    for _ in range(2000):
        low = 10.0 ** generator.uniform(-9.0, 6.0)
        high = low * math.exp(generator.uniform(0.11, 30.0))
        ticks = log_ticks(low, high)
        assert 2 <= len(ticks) <= 8 and low <= ticks[0] and ticks[-1] <= high, (low, high, ticks)
        assert ticks == sorted(set(ticks))
        assert len({plain_number(tick) for tick in ticks}) == len(ticks)


def test_an_axis_has_these_labels_and_holds_all_values() -> None:
    pytest.importorskip("matplotlib")

    def paint(figure: object) -> None:
        axes = figure.add_subplot()  # type: ignore[attr-defined]
        axes.plot([1.0, 256.0], [0.4, 0.025])
        log_axis(axes, "x", [1.0, 256.0])
        log_axis(axes, "y", [0.4, 0.025], percent=True)
        for (low, high), first, last in ((axes.get_xlim(), 1.0, 256.0), (axes.get_ylim(), 0.025, 0.4)):
            assert low < first and last < high

    svg = draw("axis", "A line", (5.0, 4.0), paint, "It falls & falls.")
    assert re.findall(r"<text[^>]*>([^<]+)</text>", svg) == ["1", "10", "100", "5 %", "10 %", "20 %"]
    assert '<desc id="axis-text">It falls &amp; falls.</desc>' in svg and 'aria-describedby="axis-text"' in svg


_VISION = {
    "normal": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.3039]],
}
"""Machado, Oliveira and Fernandes, "A Physiologically-based Model for Simulation of Color Vision Deficiency" (2009)."""


def linear(colour: str) -> npt.NDArray[np.float64]:
    coded = np.array([int(colour[at : at + 2], 16) for at in (1, 3, 5)]) / 255.0
    return np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)


def lab(rgb: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    to_xyz = [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.072175], [0.0193339, 0.119192, 0.9503041]]
    xyz = np.array(to_xyz) @ np.clip(rgb, 0.0, 1.0) / np.array([0.95047, 1.0, 1.08883])
    x, y, z = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16.0 / 116.0)
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


def shown_colours() -> list[tuple[list[str], str]]:
    """Colours of the lines and of the slope with their background: in the light scheme, and in the dark one."""
    pytest.importorskip("matplotlib")
    light = [line_style(number).color for number in range(4)] + [GREY, PAPER]
    svg = draw("colours", "Colours", (2.0, 2.0), lambda figure: None)
    schemes = [dict(re.findall(r"--c(\d+):(#\w+)", scheme)) for scheme in re.findall(r"svg\{([^}]*)\}", svg)]
    place = {colour: number for number, colour in schemes[0].items()}
    both = [[scheme[place[colour]] for colour in light] for scheme in schemes]
    return [(colours[:-1], colours[-1]) for colours in both]


@for_each("vision", _VISION)
def test_curves_differ_for_every_kind_of_colour_vision(vision: str) -> None:
    for colours, paper in shown_colours():
        seen = [lab(np.array(_VISION[vision]) @ linear(colour)) for colour in [*colours, paper]]
        assert min(np.linalg.norm(a - b) for a, b in itertools.combinations(seen, 2)) > 20.0
        for colour in colours:
            bright, dark = sorted((lab_luminance(colour), lab_luminance(paper)), reverse=True)
            assert (bright + 0.05) / (dark + 0.05) >= 3.0, colour  # WCAG 2.1, 1.4.11


def lab_luminance(colour: str) -> float:
    return float(linear(colour) @ [0.2126729, 0.7151522, 0.072175])


def test_curves_differ_without_colour() -> None:
    styles = [line_style(number) for number in range(20)]
    assert len(set(styles)) == 20
    for first, second in itertools.pairwise(styles):
        assert first.linestyle != second.linestyle and first.marker != second.marker and first.color != second.color
