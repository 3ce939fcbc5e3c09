"""Pixel filters as tables from which the kernels sample positions (``kernels/film/filter.h``).

Each filter is separable: the product of one even function along x and along y, of the distance from the pixel centre in
pixels:

===============  ======  ==============================================================================================
name             radius  function
===============  ======  ==============================================================================================
box              0.5     1: the pixel itself; with this radius the kernels need no table
tent             1       1 - |x|: Bartlett's window, and the interpolation of neighbours
gaussian         1.5     exp(-2 x^2) less its value at the radius: standard deviation 0.5 (PBR 4ed, 8.8.2)
blackman-harris  1.5     the four-term window of F. Harris, "On the use of windows for harmonic analysis with the
                         discrete Fourier transform", Proc. IEEE 66(1) 1978, of full width 3
mitchell         2       cubic with B = C = 1/3 of Mitchell and Netravali, "Reconstruction filters in computer
                         graphics", SIGGRAPH 1988; negative from 8/7 on
===============  ======  ==============================================================================================

With another radius the function is stretched along x.

A table is a piecewise linear approximation of the function with `clrender.layout.FILTER_LINES` segments. Both the
sampling and the sample weights use this approximation. Its error is at most 0.1 % of the function's maximum.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from decimal import Decimal, localcontext
from functools import lru_cache
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from clrender import layout

__all__ = ["PIXEL_FILTERS", "FilterTable", "filter_table"]

_DIGITS: Final = 40
"""Digits of the decimal arithmetic, used because math libraries differ in the last bit of exponentials and cosines."""
_PI: Final = Decimal("3.141592653589793238462643383279502884197")


@dataclass(frozen=True)
class FilterTable:
    """A filter as the kernels read it.

    Attributes
    ----------
    lines : (FILTER_LINES, 4) float32
        Columns ``FILTER_LINE_*`` of `clrender.layout`.
    negative : int
        Index of the first segment where the function is negative; `FILTER_LINES` if it never is.
    weight : float
        Weight of a sample where the filter is positive; its negative elsewhere. It is the ratio of the integral of the
        filter's absolute value to the integral of the filter, both over the square of the function's support.
    radius : float
        Pixels.
    """

    lines: npt.NDArray[np.float32]
    negative: int
    weight: float
    radius: float


@lru_cache(maxsize=8)
def filter_table(name: str, radius: float | None = None) -> FilterTable:
    """The table of a filter.

    Parameters
    ----------
    name : str
        Of `PIXEL_FILTERS`.
    radius : float, optional
        Pixels; by default the filter's own.
    """
    with localcontext() as context:
        context.prec = _DIGITS
        function, ends = PIXEL_FILTERS[name]
        places = _places(ends)
        values = [round(function(place), _DIGITS - 5) for place in places]  # makes zeros exact
        stretch = 1 if radius is None else Decimal(radius) / ends[-1]
        spans = list(zip(pairwise(place * stretch for place in places), pairwise(values), strict=True))
        areas = [(end - begin) * (low + high) / 2 for (begin, end), (low, high) in spans]
        size = sum(map(abs, areas), Decimal(0))
        rows, before = [], Decimal(0)
        for ((begin, end), (low, high)), area in zip(spans, areas, strict=True):
            rows.append((before / size, begin, abs(low) / size, (abs(high) - abs(low)) / (end - begin) / size))
            before += abs(area)
        negative = next((number for number, area in enumerate(areas) if area < 0), len(areas))
        weight = float((size / sum(areas)) ** 2)
    lines = np.array([[float(number) for number in row] for row in rows]).astype(np.float32)
    lines.flags.writeable = False
    return FilterTable(lines, negative, weight, float(ends[-1] * stretch))


def _places(ends: tuple[Decimal, ...]) -> list[Decimal]:
    """The ends of the segments; every lobe is divided into equally many."""
    each = layout.FILTER_LINES // len(ends)
    places = [Decimal(0)]
    for begin, end in zip((Decimal(0), *ends), ends, strict=False):
        places += [begin + (end - begin) * number / each for number in range(1, each + 1)]
    return places


def _box(_: Decimal) -> Decimal:
    return Decimal(1)


def _tent(x: Decimal) -> Decimal:
    return 1 - x


def _gaussian(x: Decimal) -> Decimal:
    return (-2 * x * x).exp() - Decimal("-4.5").exp()


def _blackman_harris(x: Decimal) -> Decimal:
    terms = (Decimal("0.35875"), Decimal("0.48829"), Decimal("0.14128"), Decimal("0.01168"))
    return sum((term * _cosine(number * _PI * x / Decimal("1.5")) for number, term in enumerate(terms)), Decimal(0))


def _mitchell(x: Decimal) -> Decimal:
    b = c = Decimal(1) / 3
    if x < 1:
        return ((12 - 9 * b - 6 * c) * x**3 + (-18 + 12 * b + 6 * c) * x**2 + (6 - 2 * b)) / 6
    return ((-b - 6 * c) * x**3 + (6 * b + 30 * c) * x**2 + (-12 * b - 48 * c) * x + (8 * b + 24 * c)) / 6


def _cosine(x: Decimal) -> Decimal:
    """Cosine by its series, for angles of at most a few turns."""
    total, term, number = Decimal(0), Decimal(1), 0
    while abs(term) > Decimal(10) ** -(_DIGITS - 5):
        total += term
        number += 2
        term *= -x * x / (number * (number - 1))
    return total


PIXEL_FILTERS: Final[Mapping[str, tuple[Callable[[Decimal], Decimal], tuple[Decimal, ...]]]] = {
    "box": (_box, (Decimal("0.5"),)),
    "tent": (_tent, (Decimal(1),)),
    "gaussian": (_gaussian, (Decimal("1.5"),)),
    "blackman-harris": (_blackman_harris, (Decimal("1.5"),)),
    "mitchell": (_mitchell, (Decimal(8) / 7, Decimal(2))),
}
"""Function and ends of its lobes, the last at the radius, of each filter."""
