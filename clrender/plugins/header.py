"""The header of a plugin: TOML in the comment that its file begins with, from the line ``// [plugin]`` on."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from clrender.errors import UsageError
from clrender.layout import PLUGIN_NUMBERS
from clrender.wording import quoted, shown, suggestion

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

__all__ = ["ALL_AROUND", "CLAIMS", "KINDS", "NEEDS", "TEXTURED", "Header", "Parameter", "header_of"]

KINDS: Final = ("bsdf", "texture", "light")
NEEDS: Final = {"bsdf": ("tangents",), "texture": ("uv",), "light": ()}
"""What a plugin of each kind may need beside its parameters."""
CLAIMS: Final = ("reciprocal", "lossless")
"""What a BSDF may claim, and `clrender furnace` tests: f(a, b) = f(b, a); with colours of 1, no light is lost."""
TEXTURED: Final = 10
"""Most parameters of a BSDF that may be textures: so many columns of texture slots are free."""
ALL_AROUND: Final = 360.0
"""Degrees of the cone of a light that shines in all directions."""
_LEAST_CONE: Final = 0.01
"""Degrees; in single precision directions in a narrower cone are hardly different ones."""
_MOST: Final = 1e6
"""Largest number of a parameter: single precision keeps seven digits of it."""
_NAME: Final = re.compile(r"[a-z][a-z0-9]*(?:_[a-z0-9]+)*\Z")
_LONGEST: Final = 40
_WORDS: Final = frozenset(
    (
        *("auto", "bool", "break", "case", "char", "const", "constant", "continue", "default", "do"),
        *("double", "else", "enum", "event", "extern", "float", "for", "global", "goto", "half", "if"),
        *("image", "inline", "int", "kernel", "local", "long", "pipe", "private", "quad", "register"),
        *("restrict", "return", "short", "signed", "sizeof", "static", "struct", "switch", "typedef"),
        *("uchar", "uint", "ulong", "union", "unsigned", "ushort", "vec3", "vfloat", "vint", "vmask"),
        *("void", "volatile", "vuint", "while"),
    )
)
"""Words of the language, and types, which are no names of parameters."""
_POSITION: Final = re.compile(r" \(at (?:line (\d+), column \d+|end of document)\)\Z")


@dataclass(frozen=True)
class Parameter:
    """A parameter of a plugin.

    Attributes
    ----------
    name : str
    type : str
        ``number`` or ``color``.
    default : tuple of float
        One number, or three.
    min, max : float
        Bounds of each number.
    about : str
        What it is; may be empty.
    """

    name: str
    type: str
    default: tuple[float, ...]
    min: float
    max: float
    about: str

    @property
    def count(self) -> int:
        """How many numbers it is."""
        return 3 if self.type == "color" else 1

    @property
    def textured(self) -> bool:
        """Whether it may be a texture: textures have values from 0 to 1."""
        return self.min >= 0.0 and self.max <= 1.0


@dataclass(frozen=True)
class Header:
    """What a plugin says about itself.

    Attributes
    ----------
    name : str
    kind : str
        One of `KINDS`.
    about : str
        First line of the file.
    parameters : tuple of Parameter
        In the order of the file.
    needs, claims : tuple of str
        Of `NEEDS` and `CLAIMS`.
    transmits : bool
        Whether a BSDF also scatters light to the other side, and from there.
    cone_degrees : float
        Full opening angle of the cone about its axis that a light shines into, degrees; 360: all directions.
    """

    name: str
    kind: str
    about: str
    parameters: tuple[Parameter, ...]
    needs: tuple[str, ...]
    claims: tuple[str, ...]
    transmits: bool
    cone_degrees: float = ALL_AROUND

    @property
    def struct(self) -> str:
        """Type of its parameters in OpenCL C, such as ``MinnaertParameters``."""
        return "".join(part.capitalize() for part in self.name.split("_")) + "Parameters"


def header_of(text: str, source: str) -> Header:
    """Read and check the header of a plugin.

    Parameters
    ----------
    text : str
        The plugin.
    source : str
        Name of its file in messages.

    Raises
    ------
    UsageError
        In one sentence: file and line, what is wrong, what would be right.
    """
    lines = text.split("\n")
    comment = next((i for i, line in enumerate(lines) if not line.startswith("//")), len(lines))
    begin = next((i for i in range(comment) if lines[i][2:].strip() == "[plugin]"), None)
    if not lines[0].startswith("//") or begin is None:
        raise UsageError(
            f"{source}:1: this is no plugin: it has to begin with // comments that say what it is, and then have its "
            "header, from a line `// [plugin]` on; docs/write-a-material.md has examples"
        )
    bare = [line[3:] if line.startswith("// ") else line[2:] for line in lines[begin:comment]]
    reader = _Reader(source, bare, begin)
    return reader.header(lines[0][2:].strip() if begin else "")


class _Reader:
    """Reads the header's lines, of which the first is line `begin` of the file, counted from 0."""

    def __init__(self, source: str, lines: Sequence[str], begin: int) -> None:
        self._source, self._lines, self._begin = source, lines, begin
        try:
            self._content = tomllib.loads("\n".join(lines))
        except (tomllib.TOMLDecodeError, RecursionError, ValueError) as error:
            found = _POSITION.search(str(error))
            at = int(found[1]) if found and found[1] else len(lines)
            problem = ascii(_POSITION.sub("", str(error)))[1:-1][:100]
            raise UsageError(f"{source}:{begin + at}: the header is no valid TOML ({problem})") from None

    def header(self, about: str) -> Header:
        content = self._content
        for key in content:
            if key not in ("plugin", "parameters"):
                raise self._fault(key, f"is no table of a header{suggestion(key, ('plugin', 'parameters'))}")
        table = content["plugin"]
        known = ("name", "kind", "needs", "claims", "transmits", "cone_degrees")
        for key in table:
            if key not in known:
                raise self._fault(key, f"is an unknown key{suggestion(key, known)}")
        name = self._name(table)
        kind = table.get("kind")
        if kind not in KINDS:
            said = f"is {shown(kind)}" if "kind" in table else "is missing"
            raise self._fault("kind", f"{said}, but must be one of {', '.join(KINDS)}")
        needs = self._listed(table, "needs", NEEDS[kind])
        claims = self._listed(table, "claims", CLAIMS if kind == "bsdf" else ())
        transmits = table.get("transmits", False)
        if not isinstance(transmits, bool):
            raise self._fault("transmits", f"is {shown(transmits)}, but must be true or false")
        if transmits and kind != "bsdf":
            raise self._fault("transmits", "is for a bsdf; leave it out")
        cone = self._cone(table, kind)
        given = content.get("parameters", {})
        if not isinstance(given, dict):
            raise self._fault("parameters", f"is {shown(given)}, but must be a table")
        parameters = tuple(self._parameter(key, each) for key, each in given.items())
        self._check_sizes(kind, parameters)
        return Header(name, kind, about, parameters, needs, claims, transmits, cone)

    def _name(self, table: Mapping[str, Any]) -> str:
        name = table.get("name")
        if not isinstance(name, str) or not _NAME.match(name) or len(name) > _LONGEST:
            said = f"is {shown(name)}" if "name" in table else "is missing"
            text = f"but must be a word of up to {_LONGEST} small letters, digits and single underscores between them"
            raise self._fault("name", f"{said}, {text}")
        return name

    def _cone(self, table: Mapping[str, Any], kind: str) -> float:
        cone = table.get("cone_degrees", ALL_AROUND)
        if kind != "light" and "cone_degrees" in table:
            raise self._fault("cone_degrees", "is for a light; leave it out")
        number = isinstance(cone, int | float) and not isinstance(cone, bool)
        if not number or not _LEAST_CONE <= cone <= ALL_AROUND:
            text = f"is {shown(cone)}, but must be a number from {_LEAST_CONE:g} to {ALL_AROUND:g}"
            raise self._fault("cone_degrees", text)
        return float(cone)

    def _listed(self, table: Mapping[str, Any], key: str, known: Sequence[str]) -> tuple[str, ...]:
        given = table.get(key, [])
        if not isinstance(given, list) or not all(isinstance(each, str) for each in given):
            raise self._fault(key, f"is {shown(given)}, but must be a list of names")
        for each in given:
            if each not in known:
                raise self._fault(key, f"names {quoted(each)}, which is not known{suggestion(each, known)}")
        return tuple(dict.fromkeys(given))

    def _parameter(self, name: str, given: Any) -> Parameter:
        if not _NAME.match(name) or len(name) > _LONGEST or name in _WORDS:
            text = "is no name of a parameter: take small letters, digits and underscores, and no word of OpenCL C"
            raise self._fault(name, text)
        example = '{ type = "number", default = 0.5, min = 0.0, max = 1.0 }'
        if not isinstance(given, dict):
            raise self._fault(name, f"is {shown(given)}, but must be a table such as {example}")
        known = ("type", "default", "min", "max", "about")
        for key in given:
            if key not in known:
                raise self._fault(name, f"has an unknown key {quoted(key)}{suggestion(key, known)}")
        kind = given.get("type")
        if kind not in ("number", "color"):
            said = f"is {shown(kind)}" if "type" in given else "is missing"
            raise self._fault(name, f"type {said}, but must be number or color", dot=True)
        about = given.get("about", "")
        if not isinstance(about, str):
            raise self._fault(name, f"about is {shown(about)}, but must be a text", dot=True)
        low, high = (self._number(name, key, given.get(key, default)) for key, default in (("min", 0.0), ("max", 1.0)))
        if not low < high:
            raise self._fault(name, f"min is {low:g}, but must be less than max, which is {high:g}", dot=True)
        default = given.get("default")
        count = 3 if kind == "color" else 1
        numbers = default if isinstance(default, list) else [default] * count
        if "default" not in given or len(numbers) != count:
            what = "three numbers" if kind == "color" else "a number"
            said = f"is {shown(default)}" if "default" in given else "is missing"
            raise self._fault(name, f"default {said}, but must be {what}", dot=True)
        values = tuple(self._number(name, "default", each) for each in numbers)
        for each in values:
            if not low <= each <= high:
                raise self._fault(name, f"default is {each:g}, but must be from {low:g} to {high:g}", dot=True)
        return Parameter(name, kind, values, low, high, about)

    def _number(self, name: str, key: str, value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise self._fault(name, f"{key} is {shown(value)}, but must be a number", dot=True)
        if abs(value) > _MOST:
            raise self._fault(name, f"{key} is {value:g}, but must be from {-_MOST:g} to {_MOST:g}", dot=True)
        return float(value)

    def _check_sizes(self, kind: str, parameters: Sequence[Parameter]) -> None:
        numbers = sum(each.count for each in parameters)
        if numbers > PLUGIN_NUMBERS:
            text = f"are {numbers} numbers, a colour being three; at most {PLUGIN_NUMBERS} are possible"
            raise self._fault("parameters", text)
        textured = sum(each.textured for each in parameters)
        if kind == "bsdf" and textured > TEXTURED:
            text = f"are {textured} that may be textures, being within 0 and 1; at most {TEXTURED} are possible"
            raise self._fault("parameters", text)

    def _fault(self, key: str, sentence: str, dot: bool = False) -> UsageError:
        """The error about a key, at its line."""
        pattern = re.compile(rf'\s*\[?"?{re.escape(key)}"?\s*[=.\]]')
        at = next((i for i, line in enumerate(self._lines) if pattern.match(line)), 0)
        where = f"{self._source}:{self._begin + at + 1}: the header's {quoted(key)[1:-1]}"
        return UsageError(f"{where}{'.' if dot else ' '}{sentence}")
