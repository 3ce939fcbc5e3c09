"""Parameters of pbrt's directives, by name."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.wording import counted, quoted

__all__ = ["Parameter", "Parameters"]


@dataclass(frozen=True, slots=True)  # there may be millions
class Parameter:
    """A parameter of a directive.

    Attributes
    ----------
    kind : str
        Its type in the file.
    values : (n,) float64, or list of str
    line : int
    """

    kind: str
    values: Any
    line: int


@dataclass(slots=True)
class Parameters:
    """The parameters of a directive; records which of them were used.

    Attributes
    ----------
    source : str
        File, for messages.
    line : int
    values : dict of str to Parameter
    """

    source: str
    line: int
    values: dict[str, Parameter] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)

    def fault(self, sentence: str, name: str = "") -> SceneError:
        """An error about them."""
        line = self.values[name].line if name in self.values else self.line
        return SceneError(f"{self.source}: line {line}: {sentence}")

    def get(self, name: str) -> Parameter | None:
        """A parameter of whatever type."""
        self.used.add(name)
        return self.values.get(name)

    def unused(self) -> Iterator[str]:
        """Names of parameters that were not used."""
        yield from (name for name in self.values if name not in self.used)

    def ignore(self, *names: str) -> None:
        """Mark names as used: they have no meaning here, and nothing is lost."""
        self.used.update(names)

    def numbers(self, name: str, group: int = 1) -> NDArray[np.float64] | None:
        """All numbers of a parameter, in rows of `group` if that is more than 1.

        Returns
        -------
        (n,) or (n, group) float64, or None
        """
        found = self.get(name)
        if found is None:
            return None
        if isinstance(found.values, list):
            raise self.fault(f"{quoted(name)} is of type {found.kind}, but must hold numbers", name)
        if len(found.values) % group:
            raise self.fault(f"{quoted(name)} has {counted(len(found.values), 'number')}, no multiple of {group}", name)
        values: NDArray[np.float64] = found.values
        return values.reshape(-1, group) if group > 1 else values

    def indices(self, name: str, group: int, count: int) -> NDArray[np.int64] | None:
        """Integers below `count`, in rows.

        Returns
        -------
        (n, group) int64, or None
        """
        found = self.numbers(name, group)
        if found is None:
            return None
        if (found != np.floor(found)).any() or (found < 0).any() or (found >= count).any():
            raise self.fault(f"{quoted(name)} must hold whole numbers from 0 to {count - 1}", name)
        return found.astype(np.int64)

    def number(self, name: str, default: float) -> float:
        """One number."""
        found = self.numbers(name)
        if found is None:
            return default
        if len(found) != 1:
            raise self.fault(f"{quoted(name)} has {counted(len(found), 'number')}, but must have one", name)
        return float(found[0])

    def vector(self, name: str, default: tuple[float, ...]) -> NDArray[np.float64]:
        """A vector of the default's length."""
        found = self.numbers(name)
        if found is None:
            return np.array(default, np.float64)
        if len(found) != len(default):
            raise self.fault(f"{quoted(name)} has {counted(len(found), 'number')}, but must have {len(default)}", name)
        return found

    def whole(self, name: str, default: int) -> int:
        """One integer."""
        value = self.number(name, default)
        if value != int(value):
            raise self.fault(f"{quoted(name)} is {value:g}, but must be a whole number", name)
        return int(value)

    def texts(self, name: str) -> list[str]:
        """All texts of a parameter."""
        found = self.get(name)
        if found is None:
            return []
        if not isinstance(found.values, list):
            raise self.fault(f"{quoted(name)} is of type {found.kind}, but must hold texts", name)
        return list(found.values)

    def text(self, name: str, default: str = "") -> str:
        """One text."""
        found = self.texts(name)
        if name in self.values and len(found) != 1:
            raise self.fault(f"{quoted(name)} has {len(found)} texts, but must have one", name)
        return found[0] if found else default

    def flag(self, name: str, default: bool) -> bool:
        """True or false, with or without quotes."""
        text = self.text(name, "true" if default else "false").lower()
        if text not in ("true", "false"):
            raise self.fault(f"{quoted(name)} is {quoted(text)}, but must be true or false", name)
        return text == "true"
