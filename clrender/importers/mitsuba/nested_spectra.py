"""Spectra of Mitsuba's XML that are objects of their own, with a type."""

from __future__ import annotations

import math
import re
from itertools import pairwise
from typing import Final

from clrender.importers.mitsuba.plugins import Plugin, Spectrum
from clrender.wording import counted, quoted

__all__ = ["NESTED_SPECTRA", "nested_spectrum"]

NESTED_SPECTRA: Final = ("uniform", "rgb", "srgb", "regular", "irregular")
"""Types that are the same in every place."""

_SEPARATOR: Final = re.compile(r"[\s,;]+")
_MOST: Final = 2**16
_VISIBLE: Final = (360.0, 830.0)


def nested_spectrum(plugin: Plugin) -> Spectrum | None:
    """The spectrum, or colour, of an object of one of `NESTED_SPECTRA`; None for others, and if it has no value."""
    if plugin.type in ("uniform", "rgb", "srgb"):
        return plugin.spectrum("value" if plugin.has("value") else "color")
    if plugin.type not in ("regular", "irregular"):
        return None
    values = _numbers(plugin, "values")
    if plugin.type == "irregular":
        waves = _numbers(plugin, "wavelengths")
        if len(waves) != len(values):
            counts = f"{counted(len(waves), 'wavelength')} and {counted(len(values), 'value')}"
            raise plugin.fault(f"the spectrum has {counts}; give a value for each wavelength")
    else:
        names = [
            old if plugin.has(old) else new
            for old, new in (("lambda_min", "wavelength_min"), ("lambda_max", "wavelength_max"))
        ]
        low, high = (plugin.number(name, default) for name, default in zip(names, _VISIBLE, strict=True))
        last = max(len(values) - 1, 1)
        waves = [low + (high - low) * number / last for number in range(len(values))]
    if any(later <= earlier for earlier, later in pairwise(waves)):
        raise plugin.fault("the wavelengths of the spectrum do not grow; sort them")
    return Spectrum(wavelengths=tuple(waves), values=tuple(values))


def _numbers(plugin: Plugin, name: str) -> list[float]:
    """Numbers in a text."""
    parts = [part for part in _SEPARATOR.split(plugin.text(name).strip()) if part]
    if not 1 <= len(parts) <= _MOST:
        raise plugin.fault(f"the spectrum has {counted(len(parts), 'number')} in {quoted(name)}; give 1 to {_MOST}")
    numbers = []
    for part in parts:
        try:
            number = math.nan if "_" in part else float(part)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise plugin.fault(f"{quoted(part)} in {quoted(name)} is no finite number; give one")
        numbers.append(number)
    return numbers
