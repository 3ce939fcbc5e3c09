"""Parser of the material libraries of OBJ files (``.mtl``).

Format: Wavefront Technologies, "MTL material format"; the keys of "Physically-based rendering" are those of Exocortex's
extension: ``Pr Pm Ps Pc Pcr aniso anisor norm``.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import Final

from clrender.errors import SceneError
from clrender.wording import counted, quoted

__all__ = ["MtlMaterial", "MtlPicture", "read_mtl"]

_NUMBER: Final = re.compile(r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]{1,4})?")
_SYNONYMS: Final = {"map_bump": "bump", "map_norm": "norm", "map_kn": "norm", "map_disp": "disp", "map_tr": "map_d"}
_OPTIONS: Final = {
    **dict.fromkeys(("-blendu", "-blendv", "-cc", "-clamp", "-imfchan", "-type"), "word"),
    **dict.fromkeys(("-bm", "-boost", "-texres"), "number"),
    **dict.fromkeys(("-o", "-s", "-t"), "numbers"),
    "-mm": "pair",
}
"""Options of images, and their arguments."""
_MATERIAL_LIMIT: Final = 65536


@dataclass(frozen=True)
class MtlPicture:
    """An image that a material names.

    Attributes
    ----------
    name : str
        Name in the file.
    options : dict of str to tuple of float, or str
        By option, such as ``-s``.
    place : str
        For messages.
    folder : str
        The library's, relative to the scene's.
    """

    name: str
    options: dict[str, tuple[float, ...] | str]
    place: str
    folder: str

    def numbers(self, option: str, default: tuple[float, ...]) -> tuple[float, ...]:
        """Numbers of an option; missing ones are taken from the default."""
        given = self.options.get(option, ())
        assert not isinstance(given, str)
        return (*given, *default[len(given) :])

    def word(self, option: str) -> str:
        """The word after an option, in lower case."""
        given = self.options.get(option, "")
        return given.lower() if isinstance(given, str) else ""


@dataclass
class MtlMaterial:
    """One material.

    Attributes
    ----------
    name : str
    label : str
        Start of an error message: the names of scene and library.
    lines : dict of str to (str, int)
        The rest of the line and its number, by keyword in lower case; the last one of several.
    folder : str
        The library's, relative to the scene's.
    """

    name: str
    label: str
    folder: str
    lines: dict[str, tuple[str, int]] = field(default_factory=dict)

    def __contains__(self, key: str) -> bool:
        return key in self.lines

    def place(self, key: str) -> str:
        """Location of a statement, for messages."""
        return f"{self.label}: line {self.lines[key][1]}"

    def number(self, key: str, default: float) -> float:
        """A number.

        Raises
        ------
        SceneError
            It is not a number.
        """
        if key not in self.lines:
            return default
        words = self.lines[key][0].split()
        if words[:1] == ["-halo"]:
            del words[0]
        if len(words) != 1 or (value := _number(words[0])) is None:
            raise SceneError(f"{self.place(key)}: {key} is {quoted(self.lines[key][0])}, but must be one number")
        return value

    def color(self, key: str, default: float) -> tuple[float, float, float]:
        """A colour; one number is a grey, and ``xyz`` is converted to linear Rec. 709. A spectrum's is the default.

        Raises
        ------
        SceneError
            It is not a colour.
        """
        if key not in self.lines:
            return (default, default, default)
        words = self.lines[key][0].split()
        xyz = words[:1] == ["xyz"]
        values = [_number(word) for word in words[xyz:]]
        found = [value for value in values if value is not None]
        if len(found) != len(values) or len(found) not in (1, 3):
            if words[:1] == ["spectral"]:
                return (default, default, default)
            right = "but must be one number or three"
            raise SceneError(f"{self.place(key)}: {key} is {quoted(self.lines[key][0])}, {right}")
        red, green, blue = found if len(found) == 3 else found * 3
        return _rec709(red, green, blue) if xyz else (red, green, blue)

    def picture(self, key: str) -> MtlPicture | None:
        """An image and its options; None if there is none.

        Raises
        ------
        SceneError
            An option lacks its argument, or there is no name.
        """
        if key not in self.lines:
            return None
        rest, options = self.lines[key][0], dict[str, tuple[float, ...] | str]()
        while rest.startswith("-") and (kind := _OPTIONS.get((option := rest.split(None, 1)[0]).lower())):
            rest = rest[len(option) :].lstrip()
            least, most = {"word": (0, 0), "number": (1, 1), "pair": (2, 2), "numbers": (1, 3)}[kind]
            if kind == "word":
                word, *more = rest.split(None, 1) or [""]
                options[option.lower()] = word
                rest = more[0] if more else ""
                continue
            numbers: list[float] = []
            while len(numbers) < most and rest and (value := _number(rest.split(None, 1)[0])) is not None:
                numbers.append(value)
                rest = rest[len(rest.split(None, 1)[0]) :].lstrip()
            if len(numbers) < least:
                count = "a number" if most == 1 else "two numbers" if most == 2 else "up to three numbers"
                raise SceneError(f"{self.place(key)}: {option} of {key} must be followed by {count}")
            options[option.lower()] = tuple(numbers)
        if not rest:
            raise SceneError(f"{self.place(key)}: {key} names no picture; give the name of its file")
        return MtlPicture(rest, options, self.place(key), self.folder)


def read_mtl(data: bytes, label: str, folder: str) -> dict[str, MtlMaterial]:
    """Materials by name.

    Parameters
    ----------
    data : bytes
        The file.
    label : str
        Prefix of error messages.
    folder : str
        The file's, relative to the scene's.

    Raises
    ------
    SceneError
        It is not text, or a statement precedes the first material.
    """
    if b"\0" in data:
        raise SceneError(f"{label} is no text file: it holds zero bytes; save it as UTF-8 or plain ASCII")
    text = data.removeprefix(b"\xef\xbb\xbf").decode("utf-8", "replace")
    found: dict[str, MtlMaterial] = {}
    now: MtlMaterial | None = None
    for number, line in enumerate(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), 1):
        words = line.strip().split(None, 1)
        if not words or words[0].startswith("#"):
            continue
        keyword, rest = words[0].lower(), words[1].strip() if len(words) > 1 else ""
        if keyword == "newmtl":
            now = MtlMaterial(rest, label, folder)
            found.setdefault(rest, now)
            if len(found) > _MATERIAL_LIMIT:
                raise SceneError(
                    f"{label} holds more than {counted(_MATERIAL_LIMIT, 'material')}; at most that many are read"
                )
        elif now is None:
            raise SceneError(
                f"{label}: line {number}: {quoted(keyword)} stands before the first newmtl; name a material"
            )
        else:
            # A comment may follow numbers, but in file names # is an ordinary character
            plain = (
                rest if keyword.startswith(("map_", "bump", "norm", "disp", "decal", "refl")) else rest.split("#")[0]
            )
            now.lines[_SYNONYMS.get(keyword, keyword)] = (plain.strip(), number)
    return found


def _number(word: str) -> float | None:
    value = float(word) if _NUMBER.fullmatch(word) else math.inf
    return value if math.isfinite(value) else None


def _rec709(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Convert CIE XYZ to linear Rec. 709 (white point D65)."""
    return (
        3.2404542 * x - 1.5371385 * y - 0.4985314 * z,
        -0.9692660 * x + 1.8760108 * y + 0.0415560 * z,
        0.0556434 * x - 0.2040259 * y + 1.0572252 * z,
    )
