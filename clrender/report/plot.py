"""Plots as SVG: logarithmic or plain axes, points with error bars, lines; nothing else."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

__all__ = ["STYLE", "Axis", "Series", "plot"]

_WIDTH, _HEIGHT = 620.0, 400.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 76.0, 16.0, 12.0, 54.0
_LEGEND_LINE = 19.0

STYLE: Final = (
    "<style>"
    ".paper{fill:#fff}.ink{fill:#222;font:13px system-ui,sans-serif}.rule{stroke:#ddd}.edge{stroke:#888;fill:none}"
    ".rim{stroke:#888}"
    ".a{stroke:#0b62a8;fill:#0b62a8}.b{stroke:#b3490b;fill:#b3490b}.c{stroke:#666;fill:#666}.line{fill:none}"
    ".wall-red{stroke:#b5382c}.wall-green{stroke:#2f8f46}.solid{fill:#8aa4cf55}.lamp{fill:#f0b429}"
    "@media (prefers-color-scheme:dark){.paper{fill:#16181c}.ink{fill:#e4e4e4}.rule{stroke:#3a3d42}.edge{stroke:#999}"
    ".a{stroke:#6db3f2;fill:#6db3f2}.b{stroke:#f0945a;fill:#f0945a}.c{stroke:#aaa;fill:#aaa}.line{fill:none}}"
    "</style>"
)
"""Colours, light and dark; in every picture, so that each stands alone."""


@dataclass(frozen=True)
class Axis:
    """What is on an axis; logarithmic unless `plain`, and then from 0."""

    title: str
    plain: bool = False


@dataclass(frozen=True)
class Series:
    """Points of one kind.

    Attributes
    ----------
    title : str
        For the legend.
    points : sequence of (x, y, low, high)
        `low` and `high` equal to y: no error bar.
    kind : str
        ``a``, ``b``, ``c``: the colour.
    dots, line : bool
        What is drawn.
    dashed : bool
    """

    title: str
    points: Sequence[tuple[float, float, float, float]]
    kind: str = "a"
    dots: bool = True
    line: bool = True
    dashed: bool = False


class _Scale:
    """Values to places along an axis."""

    def __init__(self, axis: Axis, values: Sequence[float], begin: float, end: float) -> None:
        self._plain, self._begin, self._end = axis.plain, begin, end
        usable = [value for value in values if math.isfinite(value) and (axis.plain or value > 0.0)] or [1.0]
        if axis.plain:
            self._low, self._high = 0.0, max(usable) * 1.1 or 1.0
        else:
            low, high = math.log10(min(usable)), math.log10(max(usable))
            margin = max(0.06 * (high - low), 0.05)
            self._low, self._high = low - margin, high + margin

    def __call__(self, value: float) -> float:
        place = value if self._plain else math.log10(max(value, 1e-300))
        share = (place - self._low) / (self._high - self._low)
        return self._begin + min(max(share, 0.0), 1.0) * (self._end - self._begin)

    def ticks(self) -> list[float]:
        """Round numbers within, two to nine of them."""
        if self._plain:
            step = 10.0 ** math.floor(math.log10(self._high / 2.0))
            step *= next(times for times in (1, 2, 5, 10) if self._high / (step * times) <= 7)
            return [step * i for i in range(int(self._high / step) + 1)]
        decades = range(math.floor(self._low), math.ceil(self._high) + 1)
        for digits in ((1,), (1, 3), (1, 2, 5), range(1, 10)):
            found = [d * 10.0**e for e in decades for d in digits if self._low <= math.log10(d * 10.0**e) <= self._high]
            if len(found) >= 3:
                break
        return found


def plot(
    title: str, x_axis: Axis, y_axis: Axis, series: Sequence[Series], x_ticks: Sequence[float] | None = None
) -> str:
    """A plot as an SVG element that stands alone or in HTML.

    Parameters
    ----------
    title : str
        What it shows, for those who cannot see it.
    x_axis, y_axis : Axis
    series : sequence of Series
    x_ticks : sequence of float, optional
        Default: round numbers.
    """
    points = [point for each in series for point in each.points]
    top = _TOP + _LEGEND_LINE * sum(bool(each.title) for each in series)
    x = _Scale(x_axis, [point[0] for point in points], _LEFT, _WIDTH - _RIGHT)
    y = _Scale(y_axis, [v for point in points for v in point[1:]], _HEIGHT - _BOTTOM, top)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" role="img" '
        f'aria-label="{escape(title)}">{STYLE}<title>{escape(title)}</title>',
        f'<rect class="paper" width="{_WIDTH:g}" height="{_HEIGHT:g}"/>',
        *_frame(x, y, top, (x_axis, y_axis), x_ticks),
        *(part for each in series for part in _drawn(each, x, y)),
        *_legend(series),
        "</svg>",
    ]
    return "\n".join(parts)


def _frame(x: _Scale, y: _Scale, top: float, axes: tuple[Axis, Axis], x_ticks: Sequence[float] | None) -> list[str]:
    right, bottom = _WIDTH - _RIGHT, _HEIGHT - _BOTTOM
    parts = []
    for value in y.ticks():
        at = y(value)
        parts.append(f'<path class="rule" d="M{_LEFT:g} {at:.1f}H{right:g}"/>')
        parts.append(f'<text class="ink" x="{_LEFT - 8:g}" y="{at + 4:.1f}" text-anchor="end">{value:g}</text>')
    for value in x.ticks() if x_ticks is None else x_ticks:
        at = x(value)
        parts.append(f'<path class="rule" d="M{at:.1f} {top:g}V{bottom:g}"/>')
        parts.append(f'<text class="ink" x="{at:.1f}" y="{bottom + 18:g}" text-anchor="middle">{value:g}</text>')
    middle = (top + bottom) / 2.0
    parts += [
        f'<path class="edge" d="M{_LEFT:g} {top:g}V{bottom:g}H{right:g}"/>',
        f'<text class="ink" x="{(_LEFT + right) / 2:g}" y="{_HEIGHT - 12:g}" text-anchor="middle">'
        f"{escape(axes[0].title)}</text>",
        f'<text class="ink" transform="translate(16 {middle:g}) rotate(-90)" text-anchor="middle">'
        f"{escape(axes[1].title)}</text>",
    ]
    return parts


def _drawn(series: Series, x: _Scale, y: _Scale) -> list[str]:
    kind, parts = series.kind, []
    places = [(x(point[0]), y(point[1]), y(point[2]), y(point[3])) for point in series.points]
    if series.line and len(places) > 1:
        path = "L".join(f"{px:.1f} {py:.1f}" for px, py, _, _ in places)
        dashes = ' stroke-dasharray="6 5"' if series.dashed else ""
        parts.append(f'<path class="{kind} line" d="M{path}" stroke-width="1.6"{dashes}/>')
    for px, py, low, high in places if series.dots else ():
        if low != high:
            bar = f"M{px:.1f} {low:.1f}V{high:.1f}M{px - 5:.1f} {low:.1f}h10M{px - 5:.1f} {high:.1f}h10"
            parts.append(f'<path class="{kind} line" d="{bar}" stroke-width="1.4"/>')
        parts.append(f'<circle class="{kind}" cx="{px:.1f}" cy="{py:.1f}" r="3.6"/>')
    return parts


def _legend(series: Sequence[Series]) -> list[str]:
    parts = []
    for i, each in enumerate(each for each in series if each.title):
        baseline = _TOP + 8 + _LEGEND_LINE * i
        dashes = ' stroke-dasharray="6 5"' if each.dashed else ""
        parts.append(f'<path class="{each.kind}" d="M{_LEFT:g} {baseline - 4:g}h28" stroke-width="2"{dashes}/>')
        parts.append(f'<text class="ink" x="{_LEFT + 36:g}" y="{baseline:g}">{escape(each.title)}</text>')
    return parts
