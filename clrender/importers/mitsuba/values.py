"""Parses the value elements of Mitsuba's XML: numbers, colours, vectors, transforms."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from clrender.errors import SceneError
from clrender.exact.matrices import product
from clrender.image.tone_map import srgb_decode
from clrender.importers.mitsuba.plugins import Spectrum, Value
from clrender.importers.mitsuba.xml_elements import Element
from clrender.importers.shared.matrices import Matrix, identity, look_at, rotation, scaling, translation
from clrender.spectra.colors import Color, blackbody_color
from clrender.wording import counted, grouped, quoted, suggestion

__all__ = ["VALUE_TAGS", "ValueReader"]

VALUE_TAGS: Final = frozenset(
    [
        "float",
        "integer",
        "boolean",
        "string",
        "point",
        "vector",
        "rgb",
        "srgb",
        "color",
        "spectrum",
        "blackbody",
        "transform",
        "animation",
    ]
)
_STEPS: Final = ("translate", "rotate", "scale", "lookat", "matrix")
_SEPARATOR: Final = re.compile(r"[\s,;]+")
_NUMBERS_LIMIT: Final = 2**16


class ValueReader:
    """Reads values of one file.

    Parameters
    ----------
    source : str
        For messages.
    note : callable
        Called with a sentence about a deviation from the file.
    file : callable
        Returns the content of a text file that the scene names at a line, for spectra.
    old : bool
        Whether the file is one of 0.6 or older.
    """

    def __init__(
        self, source: str, note: Callable[[str], None], file: Callable[[str, int], str], old: bool = False
    ) -> None:
        self._source, self._note, self._file, self._old = source, note, file, old

    def fault(self, element: Element, sentence: str) -> SceneError:
        """An error at an element."""
        return SceneError(f"{self._source}: line {element.line}: {sentence}")

    def read(self, element: Element) -> Value:
        """The value of one of `VALUE_TAGS`."""
        tag = element.tag
        if tag in ("point", "vector"):
            return Value("vector", self._vector(element, 0.0), element.line)
        if tag == "transform":
            return Value("transform", self._transform(element), element.line)
        if tag == "animation":
            return self._animation(element)
        if tag in ("rgb", "srgb", "color"):
            return Value("spectrum", self._rgb(element), element.line)
        if tag == "blackbody":
            text = self.attribute(element, "temperature").rstrip("Kk ")
            kelvin, factor = self._number(element, text), self._number(element, element.attributes.get("scale", "1"))
            if not 1.0 <= kelvin <= 1e6:
                raise self.fault(element, f"the temperature is {kelvin:g}; it must be 1 to 1000000 kelvin")
            red, green, blue = blackbody_color(kelvin)
            return Value("spectrum", Spectrum(color=(red * factor, green * factor, blue * factor)), element.line)
        if tag == "spectrum":
            return Value("spectrum", self._spectrum(element), element.line)
        text = self.attribute(element, "value")
        if tag == "string":
            return Value("string", text, element.line)
        if tag == "boolean":
            if text.strip().lower() not in ("true", "false"):
                raise self.fault(element, f"the value is {quoted(text)}, but must be true or false")
            return Value("boolean", text.strip().lower() == "true", element.line)
        number = self._number(element, text)
        if tag == "integer" and number != int(number):
            raise self.fault(element, f"the value is {quoted(text)}, but must be a whole number")
        return Value(tag, int(number) if tag == "integer" else number, element.line)

    def attribute(self, element: Element, name: str) -> str:
        """A required attribute."""
        if name not in element.attributes:
            raise self.fault(element, f"<{element.tag}> has no {quoted(name)}; give it")
        return element.attributes[name]

    def _number(self, element: Element, text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or "_" in text:
            raise self.fault(element, f"{quoted(text)} is no finite number; give one")
        return value

    def _numbers(self, element: Element, text: str, *counts: int) -> list[float]:
        parts = [part for part in _SEPARATOR.split(text.strip()) if part]
        if len(parts) > _NUMBERS_LIMIT or (counts and len(parts) not in counts):
            wanted = " or ".join(map(str, counts)) or f"at most {grouped(_NUMBERS_LIMIT)}"
            raise self.fault(element, f"{quoted(text)} holds {counted(len(parts), 'number')}, but must hold {wanted}")
        return [self._number(element, part) for part in parts]

    def _vector(self, element: Element, missing: float) -> Any:
        given = element.attributes
        if "value" in given:
            numbers = self._numbers(element, given["value"], 1, 3)
            return np.array(numbers * 3 if len(numbers) == 1 else numbers)
        return np.array([self._number(element, given.get(axis, str(missing))) for axis in "xyz"])

    def _rgb(self, element: Element) -> Spectrum:
        text = self.attribute(element, "value").strip()
        if re.fullmatch(r"#[0-9a-fA-F]{6}", text):
            coded: Color | list[float] = [int(text[at : at + 2], 16) / 255.0 for at in (1, 3, 5)]
        else:
            numbers = self._numbers(element, text, 1, 3)
            coded = numbers * 3 if len(numbers) == 1 else numbers
            if element.tag != "srgb":
                return Spectrum(color=(coded[0], coded[1], coded[2]))
        red, green, blue = (float(x) for x in srgb_decode(np.array(coded)))
        return Spectrum(color=(red, green, blue))

    def _spectrum(self, element: Element) -> Spectrum:
        if "filename" in element.attributes:
            text = self._file(element.attributes["filename"], element.line)
            pairs = [line.split() for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
            pairs = [pair for pair in pairs if len(pair) == 2]
        else:
            text = self.attribute(element, "value").strip()
            if ":" not in text:
                numbers = self._numbers(element, text, 1, 3)
                if len(numbers) == 3:
                    return Spectrum(color=(numbers[0], numbers[1], numbers[2]))
                return Spectrum(values=(numbers[0],))
            pairs = [
                part.split(":")
                for part in _SEPARATOR.split(" ".join(text.split()).replace(" :", ":").replace(": ", ":"))
                if part
            ]
        if not 1 <= len(pairs) <= _NUMBERS_LIMIT or any(len(pair) != 2 for pair in pairs):
            raise self.fault(element, f"{quoted(text)} is no spectrum; write it as 400:0.1, 500:0.2")
        waves, values = ([self._number(element, pair[at]) for pair in pairs] for at in (0, 1))
        if any(later <= earlier for earlier, later in itertools.pairwise(waves)):
            raise self.fault(element, "the wavelengths of the spectrum do not grow; sort them")
        return Spectrum(wavelengths=tuple(waves), values=tuple(values))

    def _animation(self, element: Element) -> Value:
        """Transforms at times, between which their parts are interpolated."""
        keys: list[tuple[float, Matrix]] = []
        for child in element.children:
            if child.tag != "transform":
                raise self.fault(child, f"<{child.tag}> is no part of an animation, which has <transform time=...>")
            time = self._number(child, self.attribute(child, "time"))
            if keys and not time > keys[-1][0]:
                raise self.fault(child, f"the time {time:g} of the animation does not grow; sort its transforms")
            keys.append((time, self._transform(child)))
        if not keys:
            raise self.fault(element, "the animation has no transform; give one")
        first = keys[0][1]
        rests = all(np.array_equal(first, matrix) for _, matrix in keys)
        return Value("transform", first, element.line, () if rests else tuple(keys))

    def _transform(self, element: Element) -> Matrix:
        """Composition of its steps, in order."""
        whole = identity()
        for step in element.children:
            tag = step.tag.lower()
            if tag not in _STEPS:
                raise self.fault(step, f"<{step.tag}> is no step of a transform{suggestion(tag, _STEPS)}")
            try:
                whole = product(self._step(tag, step), whole)
            except ValueError as error:
                raise self.fault(step, f"{error}; give another") from None
        if not np.isfinite(whole).all():
            raise self.fault(element, "the numbers of the transform are too large")
        return whole

    def _step(self, tag: str, step: Element) -> Matrix:
        if tag == "translate":
            x, y, z = self._vector(step, 0.0)
            return translation(x, y, z)
        if tag == "scale":
            x, y, z = self._vector(step, 1.0)
            return scaling(x, y, z)
        if tag == "rotate":
            return rotation(self._vector(step, 0.0), self._number(step, self.attribute(step, "angle")), not self._old)
        if tag == "lookat":
            origin, target = (self._numbers(step, self.attribute(step, key), 3) for key in ("origin", "target"))
            up = step.attributes.get("up")
            if up is None:
                forward = np.array(target) - np.array(origin)
                across = np.eye(3)[int(np.abs(forward).argmin())]
                return look_at(origin, target, across)
            return look_at(origin, target, self._numbers(step, up, 3))
        numbers = self._numbers(step, self.attribute(step, "value"), 9, 16)
        made = np.eye(4)
        side = 3 if len(numbers) == 9 else 4
        made[:side, :side] = np.array(numbers).reshape(side, side)
        return made
