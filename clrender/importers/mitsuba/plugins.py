"""The objects that Mitsuba's XML describes: a type, values by name, and nested objects."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

import numpy as np

from clrender.errors import SceneError
from clrender.importers.shared.matrices import Matrix, identity
from clrender.spectra.colors import Color
from clrender.wording import quoted

__all__ = ["Keys", "Plugin", "Spectrum", "Value"]


Keys: TypeAlias = tuple[tuple[float, Matrix], ...]
"""Times, seconds, and transforms."""


@dataclass(frozen=True)
class Spectrum:
    """A colour, which is later interpreted as that of light or of a surface.

    Attributes
    ----------
    color : three floats, or None
        Linear Rec. 709, if the file gives one.
    wavelengths, values : tuples of floats
        Else nanometres, and values, which are interpolated linearly. A single value without wavelength is constant.
    """

    color: Color | None = None
    wavelengths: tuple[float, ...] = ()
    values: tuple[float, ...] = ()


@dataclass(frozen=True)
class Value:
    """A named value of an object.

    Attributes
    ----------
    kind : str
        ``float integer boolean string vector transform spectrum``.
    value : float, int, bool, str, (3,) float64, (4, 4) float64 or Spectrum
        Of an animated transform its first moment.
    line : int
    keys : tuple of (float, (4, 4) float64)
        Times in seconds, ascending, and transforms of an animated transform; else none.
    """

    kind: str
    value: Any
    line: int
    keys: Keys = ()


_EMPTY: Final = ""


@dataclass
class Plugin:
    """An object of the scene.

    Attributes
    ----------
    kind : str
        Its element: ``shape bsdf emitter texture sensor film rfilter sampler integrator medium phase volume spectrum``.
    type : str
    name : str
        Name by which the parent refers to it; may be empty.
    id : str
        Id by which references refer to it; may be empty.
    source : str
        File, for messages.
    line : int
    values : dict of str to Value
    children : list of Plugin
    """

    kind: str
    type: str
    name: str
    id: str
    source: str
    line: int
    values: dict[str, Value] = field(default_factory=dict)
    children: list[Plugin] = field(default_factory=list)
    used: set[str] = field(default_factory=set)
    busy: bool = False

    @property
    def label(self) -> str:
        """Name of the object in notes."""
        return f"the {self.kind} of type {quoted(self.type)}"

    def fault(self, sentence: str, line: int | None = None) -> SceneError:
        """An error about it."""
        return SceneError(f"{self.source}: line {line or self.line}: {sentence}")

    def has(self, *names: str) -> bool:
        """Whether it has a value or nested object of any of these names."""
        return any(name in self.values or any(child.name == name for child in self.children) for name in names)

    def ignore(self, *names: str) -> None:
        """Mark names as used: they have no meaning here, and nothing is lost."""
        self.used.update(names)

    def unused(self) -> Iterator[str]:
        """Names of values, and kinds of nested objects, that were not used."""
        yield from (name for name in self.values if name not in self.used)
        for child in self.children:
            if child.name not in self.used and f"<{child.kind}>" not in self.used:
                yield child.name or child.kind

    def children_of(self, *kinds: str) -> list[Plugin]:
        """The nested objects of these kinds."""
        self.used.update(f"<{kind}>" for kind in kinds)
        return [child for child in self.children if child.kind in kinds]

    def child(self, *names: str) -> Plugin | None:
        """The nested object of one of these names."""
        self.used.update(names)
        return next((child for child in self.children if child.name in names), None)

    def _get(self, name: str, kinds: tuple[str, ...], wanted: str) -> Any:
        found = self.values.get(name)
        if found is None:
            if not any(child.name == name for child in self.children):  # else that is what is lost if nobody reads it
                self.used.add(name)
            return None
        self.used.add(name)
        if found.kind not in kinds:
            raise self.fault(f"{quoted(name)} is given as <{found.kind}>, but must be {wanted}", found.line)
        return found.value

    def number(self, name: str, default: float) -> float:
        """A number, or that of a grey spectrum."""
        value = self._get(name, ("float", "integer", "spectrum"), "a number")
        if isinstance(value, Spectrum):
            if value.color is not None:
                return sum(value.color) / 3.0
            return sum(value.values) / len(value.values)
        return default if value is None else float(value)

    def whole(self, name: str, default: int) -> int:
        """An integer."""
        value = self._get(name, ("integer", "float"), "a whole number")
        if value is None:
            return default
        if value != int(value):
            raise self.fault(f"{quoted(name)} is {value:g}, but must be a whole number")
        return int(value)

    def flag(self, name: str, default: bool) -> bool:
        """True or false."""
        value = self._get(name, ("boolean",), "true or false")
        return default if value is None else bool(value)

    def text(self, name: str, default: str = _EMPTY) -> str:
        """A text."""
        value = self._get(name, ("string",), "a text")
        return default if value is None else str(value)

    def vector(self, name: str, default: tuple[float, float, float]) -> Any:
        """Three numbers, (3,) float64."""
        value = self._get(name, ("vector",), "a point or vector")
        return np.array(default, np.float64) if value is None else value

    def matrix(self, name: str = "to_world") -> Matrix:
        """A transform; the identity if there is none."""
        value = self._get(name, ("transform",), "a transform")
        return identity() if value is None else value

    def keys(self, name: str = "to_world") -> Keys:
        """Keys of an animated transform; none if it is at rest."""
        return self.values[name].keys if name in self.values else ()

    def spectrum(self, name: str) -> Spectrum | None:
        """A colour; a number is grey."""
        value = self._get(name, ("spectrum", "float", "integer"), "a colour or a number")
        if isinstance(value, float | int):
            return Spectrum(color=(float(value),) * 3)
        return value if isinstance(value, Spectrum) else None
