"""Elements of Mitsuba's XML."""

from __future__ import annotations

import re
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np

from clrender.scene.spectra import SpectralColor
from clrender.spectra.colors import table_wavelengths

__all__ = ["NO_ID", "Element", "element", "spectral", "spectrum", "transform", "value", "words"]

Element = ElementTree.Element
NO_ID: Final = re.compile(r"[^\w -]|^_+")
"""What Mitsuba's ids lack: dots, which separate names of parameters, ``$``, and an underscore at their beginning."""


def words(values: Any) -> str:
    """Numbers separated by blanks, with all their digits."""
    return " ".join(repr(float(x)) for x in np.asarray(values, np.float64).ravel())


def element(tag: str, *children: Element, **attributes: str) -> Element:
    """An element with attributes and children."""
    made = Element(tag, attributes)
    made.extend(children)
    return made


def value(tag: str, name: str, given: Any) -> Element:
    """A named value: ``float``, ``integer``, ``boolean``, ``string``, ``rgb``, ``point`` or ``vector``."""
    if isinstance(given, bool):
        text = str(given).lower()
    else:
        text = str(given) if isinstance(given, str | int) else words(given)
    return element(tag, name=name, value=text)


def spectral(name: str, given: Any, factor: Any = 1.0) -> Element:
    """A colour times a factor, or a spectrum times one that is a number."""
    if not isinstance(given, SpectralColor) or np.ndim(factor):
        return value("rgb", name, np.array(given) * factor)
    return spectrum(name, given.values * factor)


def spectrum(name: str, values: Any) -> Element:
    """A spectrum of values at the lines of tables of spectra, (95,)."""
    lines = zip(table_wavelengths().tolist(), values.tolist(), strict=True)
    return element("spectrum", name=name, value=", ".join(f"{wave:g}:{amount!r}" for wave, amount in lines))


def transform(matrix: Any, name: str = "to_world") -> Element:
    """A transform of a (4, 4) matrix that acts on column vectors."""
    return element("transform", element("matrix", value=words(matrix)), name=name)
