"""Splits pbrt's text into directives: a name, its arguments, and parameters with their types."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.importers.pbrt.parameters import Parameter, Parameters
from clrender.wording import counted, quoted

__all__ = ["FILE_LIMIT", "Directive", "directives"]

FILE_LIMIT: Final = 2**29
"""Largest file, bytes."""
_COUNT: Final = 2**22
"""Most values of a list that are not plain numbers."""
_TOKEN: Final = re.compile(r'[\s]+|#[^\n]*|"(?:[^"\\\n]|\\.)*"|[\[\]]|[^\s"#\[\]]+')
_NUMBERS_ONLY: Final = re.compile(r"[-+0-9.eE\s]*\Z")
_NUMERIC: Final = frozenset(
    [
        "float",
        "integer",
        "point",
        "point2",
        "point3",
        "vector",
        "vector2",
        "vector3",
        "normal",
        "normal3",
        "rgb",
        "blackbody",
    ]
)
_TEXTUAL: Final = frozenset(["string", "texture", "bool", "spectrum"])
_TYPES: Final = _NUMERIC | _TEXTUAL
_ESCAPES: Final = {"n": "\n", "t": "\t", "r": "\r", "b": "\b", "f": "\f"}


@dataclass(frozen=True)
class Directive:
    """A directive of the file.

    Attributes
    ----------
    name : str
    texts : tuple of str
        Quoted arguments after the name.
    numbers : tuple of float
        Numeric arguments after the name.
    parameters : Parameters
    source : str
        File, for messages.
    line : int
        From 1.
    """

    name: str
    texts: tuple[str, ...]
    numbers: tuple[float, ...]
    parameters: Parameters
    source: str
    line: int

    def fault(self, sentence: str) -> SceneError:
        """An error about it."""
        return SceneError(f"{self.source}: line {self.line}: {sentence}")

    def text(self, index: int, what: str) -> str:
        """One of the texts, which is required."""
        if index >= len(self.texts):
            raise self.fault(f"{self.name} has no {what} in quotes; give it")
        return self.texts[index]

    def floats(self, count: int) -> tuple[float, ...]:
        """All of its numbers, of which there must be `count`."""
        if len(self.numbers) != count:
            raise self.fault(f"{self.name} has {counted(len(self.numbers), 'number')}, but must have {count}")
        return self.numbers


class _Text:
    """Tokenizer of the text."""

    def __init__(self, text: str, source: str) -> None:
        self.text, self.source = text, source
        self.at, self.line = 0, 1
        self._ahead: str | None = None
        self._next_line = 1

    def fault(self, sentence: str) -> SceneError:
        return SceneError(f"{self.source}: line {self.line}: {sentence}")

    def peek(self) -> str | None:
        """The next token, without consuming it; None at the end."""
        while self._ahead is None and self.at < len(self.text):
            match = _TOKEN.match(self.text, self.at)
            if match is None:
                self.line = self._next_line
                raise self.fault("a text in quotes has no end; close it on its line")
            self.at = match.end()
            token = match[0]
            if token[0].isspace():
                self._next_line += token.count("\n")
            elif token[0] != "#":
                self._ahead = token
                self.line = self._next_line
        return self._ahead

    def take(self) -> str | None:
        """Consume and return the next token."""
        token = self.peek()
        self._ahead = None
        return token

    def plain_numbers(self) -> NDArray[np.float64] | None:
        """After an opening bracket: all numbers up to the closing one, at once; None if there is anything else."""
        if self._ahead is not None:
            return None
        end = self.text.find("]", self.at)
        if end < 0:
            raise self.fault("a list has no end; close it with ]")
        inside = self.text[self.at : end]
        if not _NUMBERS_ONLY.match(inside):
            return None
        try:
            numbers = np.array(inside.split(), np.float64)
        except ValueError:
            return None
        self._next_line += inside.count("\n")
        self.at = end + 1
        return numbers


def _unquoted(token: str) -> str:
    return re.sub(r"\\(.)", lambda match: _ESCAPES.get(match[1], match[1]), token[1:-1])


def _number(text: _Text, token: str) -> float:
    try:
        value = float(token) if "_" not in token else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise text.fault(f"{quoted(token)} is no finite number; give one")
    return value


def _list(text: _Text) -> tuple[list[str], NDArray[np.float64] | None]:
    """Tokens of a value, of which there may be several in brackets; or its numbers."""
    token = text.take()
    if token is None:
        raise text.fault("the file ends where a value should be; complete it")
    if token != "[":
        if token == "]":
            raise text.fault("a list ends here that did not begin; remove the ]")
        return [token], None
    numbers = text.plain_numbers()
    if numbers is not None:
        return [], numbers
    found: list[str] = []
    while (token := text.take()) != "]":
        if token is None or token == "[" or len(found) >= _COUNT:
            raise text.fault("a list has no end, or another list inside; close it with ]")
        found.append(token)
    return found, None


def _parameter(text: _Text) -> tuple[str, Parameter]:
    """A parameter: its type and name in quotes, then its values."""
    declared, line = text.take() or "", text.line
    words = _unquoted(declared).split()
    if len(words) != 2 or words[0] not in _TYPES:
        raise text.fault(f'{quoted(declared[1:-1])} is no type and name of a parameter, such as "float radius"')
    kind, name = words
    tokens, numbers = _list(text)
    values: Any
    if numbers is None and tokens and all(token[0] != '"' for token in tokens) and kind != "bool":
        numbers = np.array([_number(text, token) for token in tokens], np.float64)
    if numbers is not None:
        if kind in _TEXTUAL and kind != "spectrum":
            raise text.fault(f"{quoted(name)} of type {kind} has numbers, but must have texts in quotes")
        if not np.isfinite(numbers).all():
            raise text.fault(f"a number of {quoted(name)} is too large or none; give finite ones")
        values = numbers
    else:
        if kind in _NUMERIC:
            raise text.fault(f"{quoted(name)} of type {kind} has texts, but must have numbers")
        values = [_unquoted(token) if token[0] == '"' else token for token in tokens]
    return name, Parameter(kind, values, line)


def directives(data: bytes, source: str) -> Iterator[Directive]:
    """The directives of a file, in order.

    Parameters
    ----------
    data : bytes
    source : str
        For messages.

    Raises
    ------
    SceneError
        The syntax is invalid.
    """
    text = _Text(data.decode("utf-8", "replace"), source)
    while (name := text.take()) is not None:
        line = text.line
        if not name[0].isalpha():
            raise text.fault(f"{quoted(name.strip(chr(34)))} stands where the name of a directive should")
        texts: list[str] = []
        numbers: list[float] = []
        parameters = Parameters(source, line)
        while (token := text.peek()) is not None:
            if token[0] == '"':
                words = _unquoted(token).split()
                # Names of media may also have two words
                if len(words) == 2 and texts and (name != "MediumInterface" or words[0] in _TYPES):
                    key, parameter = _parameter(text)
                    parameters.values[key] = parameter
                else:
                    texts.append(_unquoted(text.take() or ""))
            elif token == "[":
                tokens, found = _list(text)
                numbers += [_number(text, each) for each in tokens] if found is None else [float(x) for x in found]
            elif token in ("true", "false"):
                texts.append(text.take() or "")
            elif token[0] in "+-.0123456789":
                numbers.append(_number(text, text.take() or ""))
            else:
                break
        yield Directive(name, tuple(texts), tuple(numbers), parameters, source, line)
