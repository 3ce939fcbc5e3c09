"""Domains of values: ranges of numbers and lists of names, with the same checks in command lines, files and calls."""

from __future__ import annotations

import difflib
import math
import numbers
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from clrender.errors import UsageError

__all__ = [
    "MOST_BANDS",
    "Bands",
    "Bytes",
    "Choice",
    "Domain",
    "Flag",
    "NotAllowed",
    "Range",
    "Region",
    "checked_path",
    "given_too",
    "nearest",
    "shown",
]

MOST_BANDS = 300
"""Most bands of a spectrum."""

_DIGITS = 400
"""Longest text that is parsed as a number: longer ones are surely mistakes, and slow to convert."""


class NotAllowed(ValueError):
    """A value outside its domain; the message follows the value's name: "is 0, but must be ..."."""


class Domain(Protocol):
    """A set of allowed values."""

    @property
    def words(self) -> str:
        """The allowed values, as text for messages: "a whole number of at least 1"."""

    @property
    def metavar(self) -> str:
        """Placeholder of the value in the help of a command."""

    def accept(self, value: object) -> Any:
        """Check a value and convert it to a built-in Python type.

        Raises
        ------
        NotAllowed
        """

    def parse(self, text: str) -> Any:
        """Parse and check a text from the command line.

        Raises
        ------
        NotAllowed
        """

    def schema(self) -> dict[str, Any]:
        """JSON Schema."""


@dataclass(frozen=True)
class Range:
    """Finite numbers from `low` to `high`.

    Attributes
    ----------
    low, high : float
        Smallest and largest value.
    whole : bool
        Whether fractions are refused.
    above, below : bool
        Whether `low` itself and `high` itself are refused.
    unit : str
        What is counted or measured, as messages say it; empty: nothing.
    """

    low: float
    high: float = math.inf
    whole: bool = False
    above: bool = False
    below: bool = False
    unit: str = ""

    @property
    def words(self) -> str:
        bounds = f"above {self.low:.12g}" if self.above else f"of at least {self.low:.12g}"
        if math.isfinite(self.high):
            bounds += f" and {'below' if self.below else 'at most'} {self.high:.12g}"
        return f"a {'whole number' if self.whole else 'number'}{f' of {self.unit}' if self.unit else ''} {bounds}"

    @property
    def metavar(self) -> str:
        return "N" if self.whole else "X"

    def accept(self, value: object) -> int | float:
        # NumPy's scalars are of these abstract types too. Booleans are integers in Python, but are refused.
        number: int | float = math.nan
        if self.whole and isinstance(value, numbers.Integral) and not isinstance(value, bool):
            number = int(value)
        elif not self.whole and isinstance(value, numbers.Real) and not isinstance(value, bool):
            with suppress(OverflowError):
                number = float(value)
        return self._checked(number, value)

    def parse(self, text: str) -> int | float:
        number: int | float = math.nan
        with suppress(ValueError):
            number = int(text[:_DIGITS]) if self.whole else float(text[:_DIGITS])
        return self._checked(number, text)

    def schema(self) -> dict[str, Any]:
        schema: dict[str, Any] = {"type": "integer" if self.whole else "number"}
        schema["exclusiveMinimum" if self.above else "minimum"] = self.low
        if math.isfinite(self.high):
            schema["exclusiveMaximum" if self.below else "maximum"] = self.high
        return schema

    def _checked(self, number: int | float, value: object) -> int | float:
        low_ok = number > self.low if self.above else number >= self.low
        high_ok = number < self.high if self.below else number <= self.high
        if not (low_ok and high_ok and number != math.inf):
            words = self.words.replace("a number", "a finite number") if number in (math.inf, -math.inf) else self.words
            raise NotAllowed(f"is {shown(value)}, but must be {words}")
        return number


_SUFFIXES = {"": 1, "K": 2**10, "M": 2**20, "G": 2**30, "T": 2**40}


@dataclass(frozen=True)
class Bytes:
    """Amounts of memory, whole numbers of bytes; on the command line also with a suffix, such as ``512M``.

    Attributes
    ----------
    low, high : int
        The smallest and the largest, bytes.
    """

    low: int
    high: int = 2**60

    @property
    def words(self) -> str:
        return f"a number of bytes from {self.low} to {self.high} (as an option also with K, M or G: 512M)"

    @property
    def metavar(self) -> str:
        return "BYTES"

    def accept(self, value: object) -> int:
        number = int(value) if isinstance(value, numbers.Integral) and not isinstance(value, bool) else -1
        return self._checked(number, value)

    def parse(self, text: str) -> int:
        one = r"(\d{1,18}|\d{1,18}\.\d{1,9}(?= ?[KMGT])) ?([KMGT]?)(?:iB|B)?"
        match = re.fullmatch(one, text.strip(), re.ASCII | re.IGNORECASE)
        number = -1 if match is None else int(float(match[1]) * _SUFFIXES[match[2].upper()])
        return self._checked(number, text)

    def schema(self) -> dict[str, Any]:
        return {"type": "integer", "minimum": self.low, "maximum": self.high}

    def _checked(self, number: int, value: object) -> int:
        if not self.low <= number <= self.high:
            raise NotAllowed(f"is {shown(value)}, but must be {self.words}")
        return number


@dataclass(frozen=True)
class Choice:
    """One of a few names, or of a few whole numbers.

    Attributes
    ----------
    members : tuple
    former : mapping of str to str
        Names of earlier versions, which are still accepted, and the members that they stand for.
    """

    members: tuple[str, ...] | tuple[int, ...]
    former: Mapping[str, str] = field(default_factory=dict, hash=False)

    @property
    def words(self) -> str:
        names = [str(member) for member in self.members]
        return " or ".join(part for part in (", ".join(names[:-1]), names[-1]) if part)

    @property
    def metavar(self) -> str:
        return f"[{'|'.join(map(str, self.members))}]"

    def accept(self, value: object) -> str | int:
        # The type must match too: 8.0 and True are no number of lanes.
        whole = isinstance(self.members[0], int)
        if isinstance(value, numbers.Integral if whole else str) and not isinstance(value, bool):
            plain: str | int = int(value) if isinstance(value, numbers.Integral) else str(value)
            if isinstance(plain, str):
                plain = self.former.get(plain, plain)
            if plain in self.members:
                return plain
        raise self._refused(value)

    def parse(self, text: str) -> str | int:
        for member in self.members:
            if self.former.get(text, text) == str(member):
                return member
        raise self._refused(text)

    def schema(self) -> dict[str, Any]:
        return {"type": "string" if isinstance(self.members[0], str) else "integer", "enum": list(self.members)}

    def _refused(self, value: object) -> NotAllowed:
        return NotAllowed(f"is {shown(value)}, but must be {self.words}{nearest(value, self.members)}")


@dataclass(frozen=True)
class Bands:
    """Three neighbouring bands of the spectrum: the number of the first one, and of all."""

    @property
    def words(self) -> str:
        return f"two whole numbers, the first of three bands and the number of all, at most {MOST_BANDS}"

    @property
    def metavar(self) -> str:
        return "FIRST,COUNT"

    def accept(self, value: object) -> tuple[int, int]:
        given = tuple(value) if isinstance(value, list | tuple) else ()
        if len(given) == 2 and all(type(each) is int for each in given):
            first, count = given
            if 0 <= first <= count - 3 and count <= MOST_BANDS:
                return first, count
        raise NotAllowed(f"is {shown(value)}, but must be {self.words}")

    def parse(self, text: str) -> tuple[int, int]:
        match = re.fullmatch(r"(\d{1,3}),(\d{1,3})", text, re.ASCII)
        if match is None:
            raise NotAllowed(f"is {shown(text)}, but must be {self.words}")
        return self.accept((int(match[1]), int(match[2])))

    def schema(self) -> dict[str, Any]:
        return {
            "type": "array",
            "items": {"type": "integer", "minimum": 0, "maximum": MOST_BANDS},
            "minItems": 2,
            "maxItems": 2,
        }


@dataclass(frozen=True)
class Flag:
    """Yes or no."""

    @property
    def words(self) -> str:
        return "true or false"

    @property
    def metavar(self) -> str:
        return "[true|false]"

    def accept(self, value: object) -> bool:
        if isinstance(value, bool) or type(value).__name__ in ("bool_", "bool"):
            return bool(value)
        raise NotAllowed(f"is {shown(value)}, but must be {self.words}")

    def parse(self, text: str) -> bool:
        if text in ("true", "false"):
            return text == "true"
        raise NotAllowed(f"is {shown(text)}, but must be {self.words}")

    def schema(self) -> dict[str, Any]:
        return {"type": "boolean"}


@dataclass(frozen=True)
class Region:
    """Rectangles of pixels: the left and upper edge, the width and the height; on the command line ``X,Y,WxH``.

    Attributes
    ----------
    most : int
        The largest number.
    """

    most: int

    @property
    def words(self) -> str:
        return f"four whole numbers up to {self.most}, x, y, width and height (as an option: X,Y,WxH)"

    @property
    def metavar(self) -> str:
        return "X,Y,WxH"

    def accept(self, value: object) -> tuple[int, int, int, int]:
        listed = value.tolist() if hasattr(value, "tolist") else value
        given = tuple(listed) if isinstance(listed, list | tuple) else ()
        if len(given) != 4 or not all(
            isinstance(each, numbers.Integral) and not isinstance(each, bool) for each in given
        ):
            raise NotAllowed(f"is {shown(value)}, but must be {self.words}")
        x, y, width, height = (int(each) for each in given)
        if not (0 <= x <= self.most and 0 <= y <= self.most and 1 <= width <= self.most and 1 <= height <= self.most):
            raise NotAllowed(f"is {shown(value)}, but must be {self.words}, the last two at least 1")
        return x, y, width, height

    def parse(self, text: str) -> tuple[int, int, int, int]:
        match = re.fullmatch(r"(\d{1,9}),(\d{1,9}),(\d{1,9})x(\d{1,9})", text.strip(), re.ASCII)
        if match is None:
            raise NotAllowed(
                f"is {shown(text)}, but must be X,Y,WxH: the left and upper edge, width and height, pixels"
            )
        return self.accept([int(each) for each in match.groups()])

    def schema(self) -> dict[str, Any]:
        sides = [{"type": "integer", "minimum": low, "maximum": self.most} for low in (0, 0, 1, 1)]
        return {"type": "array", "prefixItems": sides, "minItems": 4, "maxItems": 4}

    @staticmethod
    def text(value: Sequence[int]) -> str:
        """A value as `parse` reads it."""
        x, y, width, height = value
        return f"{x},{y},{width}x{height}"


def checked_path(value: object, what: str) -> Path:
    """The path of a file's name, given by a caller.

    Raises
    ------
    UsageError
        It is no name; the message begins with `what`.
    """
    name = os.fspath(value) if isinstance(value, str | os.PathLike) else value
    if not isinstance(name, str):
        raise UsageError(f"{what} is {shown(value)}, but must be the name of a file, a str or a pathlib.Path")
    return Path(name)


def checked_flag(value: object, what: str) -> bool:
    """A bool, given by a caller.

    Raises
    ------
    UsageError
        It is none; the message begins with `what`.
    """
    try:
        return Flag().accept(value)
    except NotAllowed as error:
        raise UsageError(f"{what} {error}") from None


def check_function(value: object, what: str) -> None:
    """Check that a caller gave a function, or None.

    Raises
    ------
    UsageError
        It is neither; the message begins with `what`.
    """
    if value is not None and not callable(value):
        raise UsageError(f"{what} is {shown(value)}, but must be a function")


def given_too(present: str) -> str:
    """The error text for a name of earlier versions beside the present one; it follows the former name."""
    return f"is the former name of {present}, which is given too; leave one of them out"


def nearest(wrong: object, known: Iterable[object]) -> str:
    """The end of a message about a misspelt name: ``; did you mean 'path'?``, or empty if no name is similar."""
    if not isinstance(wrong, str) or re.fullmatch(r"[+-]?[\d.]+", wrong):
        return ""  # of numbers, one with similar digits would be far away
    near = difflib.get_close_matches(wrong[:100], map(str, known), 1)
    return f"; did you mean {near[0]!r}?" if near else ""


def shown(value: object) -> str:
    """A wrong value as text for a message: on one line, printable anywhere, not too long."""
    if isinstance(value, int) and abs(value) >= 10**30:
        return "an integer of more than 30 digits"  # Python may refuse to print it
    try:
        text = ascii(value)
    except Exception:  # the value's own `__repr__` may do anything
        text = f"of type {type(value).__name__}"
    return text if len(text) <= 60 else f"{text[:56]} ..."
