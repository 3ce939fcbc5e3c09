"""IES files (ANSI/IES LM-63 of 1986, 1991, 1995, 2002 and 2019): luminous intensity of a luminaire by direction."""

from __future__ import annotations

import hashlib
import math
import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NoReturn

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.files.named import open_named_file
from clrender.scene.values import POWER_LIMIT
from clrender.wording import counted, grouped, quoted

__all__ = ["IesProfile", "ies_text", "read_ies"]

_FILE_LIMIT: Final = 2**24
_COUNT_LIMIT: Final = 2**20
"""Most intensities of a file."""
_STEP: Final = 0.01
"""Least difference between adjacent angles, degrees: a photometer cannot distinguish closer ones."""
_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\Z")
_TILT: Final = re.compile(r"\s*TILT\s*=(.*)", re.IGNORECASE | re.DOTALL)
_YEAR: Final = re.compile(r"IES(?:NA)?(?::LM-63-(\d{4})|(91))", re.IGNORECASE)
_TYPES: Final = {1: "C", 2: "B", 3: "A"}

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class IesProfile:
    """Intensity by direction, of photometric type C.

    Attributes
    ----------
    vertical : (V,) float64
        Degrees from straight down, strictly ascending, within 0 to 180; outside their range it is dark.
    horizontal : (H,) float64
        Degrees about the vertical axis, counter-clockwise as seen from above, ascending from 0 to 360; a single angle,
        0, means rotational symmetry.
    candela : (V, H) float64
        Not negative; interpolated linearly between the angles.
    tilt : (2, T) float64
        Tilt angles of the lamp, degrees, ascending, and the factors of its light at these; T may be 0.
    """

    vertical: _Floats
    horizontal: _Floats
    candela: _Floats
    tilt: _Floats

    def sha256(self) -> str:
        """Hash of the numbers."""
        digest = hashlib.sha256()
        for array in (self.vertical, self.horizontal, self.candela, self.tilt):
            digest.update(f"{array.shape}".encode() + np.ascontiguousarray(array, "<f8").tobytes())
        return digest.hexdigest()

    def tilt_factor(self, degrees: float) -> float:
        """Factor of the light at a tilt angle: interpolated linearly, constant outside the table."""
        angles, factors = self.tilt.tolist()
        if not angles:
            return 1.0
        after = next((i for i, angle in enumerate(angles) if angle >= degrees), len(angles) - 1)
        before = max(after - 1, 0)
        if degrees >= angles[after] or after == before:
            return float(factors[after])
        share = (degrees - angles[before]) / (angles[after] - angles[before])
        return float(factors[before] * (1.0 - share) + factors[after] * share)

    @classmethod
    def checked(cls, vertical: _Floats, horizontal: _Floats, candela: _Floats, tilt: _Floats) -> IesProfile:
        """Validate arrays and make a profile of them.

        Raises
        ------
        ValueError
            They are not a valid profile.
        """
        arrays = [np.ascontiguousarray(array, np.float64) for array in (vertical, horizontal, candela, tilt)]
        lines, columns, values, tilts = arrays
        sound = lines.ndim == columns.ndim == 1 and values.shape == (len(lines), len(columns)) and len(lines) >= 2
        sound = sound and tilts.ndim == 2 and len(tilts) == 2 and all(np.isfinite(array).all() for array in arrays)
        sound = sound and lines[0] >= 0.0 and lines[-1] <= 180.0 and bool((np.diff(lines) >= _STEP * 0.99).all())
        around = (
            columns.tolist() == [0.0]
            if columns.size == 1
            else columns.size > 1 and columns[[0, -1]].tolist() == [0.0, 360.0]
        )
        sound = sound and around and bool((np.diff(columns) >= _STEP * 0.99).all())
        if not (sound and values.size <= 4 * _COUNT_LIMIT and values.min() >= 0.0 and values.max() <= POWER_LIMIT):
            raise ValueError("it is no table of intensities")
        return cls(lines, columns, values, tilts)


def read_ies(name: str, base_folder: Path, allow_paths: Sequence[Path], place: str) -> IesProfile:
    """Read an IES file named by a scene.

    Parameters
    ----------
    name, base_folder, allow_paths
        See `clrender.files.named.allowed_file`; the same rules hold for its tilt file (``TILT=``).
    place : str
        Location of the name in the scene, for error messages.

    Raises
    ------
    SceneError
        The message names the line, what is wrong there, and what would be right.
    """
    label = f"{place}: {quoted(name)}"
    lines = _lines(name, base_folder, allow_paths, label)
    year, (tilt_at, what) = _YEAR.match(lines[0].strip()), _tilt_line(lines, label)
    numbers = _Numbers(lines, tilt_at + 1, label)
    tilt = np.zeros((2, 0))
    if what.upper() == "INCLUDE":
        tilt = _tilt(numbers)
    elif what.upper() != "NONE":
        # The tilt file is meant to be in the same folder
        other, beside = f"{label}: line {tilt_at + 1}: TILT={quoted(what)}", str(Path(name).parent / what)
        more = _Numbers(_lines(beside, base_folder, allow_paths, other), 0, other)
        tilt = _tilt(more)
        more.end()
    return _profile(numbers, 1986 if year is None else int(year[1] or 1991), tilt)


def ies_text(profile: IesProfile) -> str:
    """A file, of LM-63-2019, from which `read_ies` reads the same profile.

    Parameters
    ----------
    profile : IesProfile
        Without tilt factors.
    """
    assert not profile.tilt.size
    rows = (profile.vertical, profile.horizontal, *profile.candela.T)
    counts = f"1 -1 1 {len(profile.vertical)} {len(profile.horizontal)} 1 2 0 0 0"
    numbers = (textwrap.fill(" ".join(map(repr, row.tolist())), 120) for row in rows)
    text = "\n".join(["IES:LM-63-2019", "TILT=NONE", counts, "1 1 0", *numbers, ""])
    return text.replace("\n", "\r\n")


def _lines(name: str, base_folder: Path, allow_paths: Sequence[Path], label: str) -> list[str]:
    file, _ = open_named_file(name, base_folder, allow_paths, label, _FILE_LIMIT)
    try:
        with file:
            data = file.read(_FILE_LIMIT + 1)
    except OSError as error:
        raise SceneError(f"{label} cannot be read: {error.strerror or error}") from None
    return data.decode("latin-1").replace("\x1a", "").replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _tilt_line(lines: list[str], label: str) -> tuple[int, str]:
    """Index of the TILT line, which the numbers follow, and its value."""
    for number, line in enumerate(lines):
        if found := _TILT.match(line):
            return number, found[1].strip()
    raise SceneError(f"{label} is no IES file: it has no line that begins with TILT=; give one in the format LM-63")


class _Numbers:
    """Reader of a file's numbers, in order; line breaks between them have no meaning.

    Parameters
    ----------
    lines : list of str
    first : int
        Index of the line where they begin.
    label : str
        Prefix of error messages.
    """

    def __init__(self, lines: list[str], first: int, label: str) -> None:
        self._label = label
        self._words = [
            (number, word)
            for number, line in enumerate(lines[first:], first + 1)
            for word in line.replace(",", " ").split()
        ]
        self._at = 0
        self.line = first + 1

    def fail(self, problem: str) -> NoReturn:
        """Raise an error about the number read last."""
        raise SceneError(f"{self._label}: line {self.line}: {problem}")

    def number(self, what: str) -> float:
        """The next number; `what` is its meaning."""
        if self._at == len(self._words):
            if self._words:
                self.line = self._words[-1][0]
            self.fail(f"the file ends before {what}; it may be cut off: get it again")
        self.line, word = self._words[self._at]
        self._at += 1
        value = float(word) if _NUMBER.match(word) else math.inf
        if not math.isfinite(value):
            self.fail(f"{what} is {quoted(word)}; it must be a finite number")
        return value

    def count(self, what: str, least: int) -> int:
        """The next number, a count of entries in the file."""
        value = self.number(what)
        left = len(self._words) - self._at
        if value != int(value) or value < least:
            self.fail(f"{what} is {value:g}; it must be a whole number of at least {least}")
        if value > left:
            self.fail(
                f"{what} is {value:g}, but only {counted(left, 'number follows', 'numbers follow')}; the file may "
                "be cut off: get it again"
            )
        return int(value)

    def several(self, what: str, count: int) -> _Floats:
        return np.array([self.number(what) for _ in range(count)])

    def ascending(self, what: str, count: int) -> _Floats:
        values: list[float] = []
        for _ in range(count):
            value = self.number(what)
            if values and not value >= values[-1] + _STEP * 0.99:
                self.fail(
                    f"{what} of {value:g} degrees follows on {values[-1]:g}; angles must ascend, by {_STEP} at least"
                )
            values.append(value)
        return np.array(values)

    def end(self) -> None:
        """Raise an error if anything follows."""
        if self._at < len(self._words):
            self.line = self._words[self._at][0]
            self.fail("more follows than the counts of the file say; correct the counts, or remove what follows")


def _tilt(numbers: _Numbers) -> _Floats:
    geometry = numbers.number("the lamp-to-luminaire geometry")
    if geometry not in (1.0, 2.0, 3.0):
        numbers.fail(f"the lamp-to-luminaire geometry is {geometry:g}; it must be 1, 2 or 3")
    count = numbers.count("the number of tilt angles", 1)
    angles = numbers.ascending("a tilt angle", count)
    factors = numbers.several("a factor of a tilt angle", count)
    if factors.min() < 0.0:
        numbers.fail(f"a factor of a tilt angle is {factors.min():g}; it must be at least 0")
    # A lamp that stays horizontal in a tilted luminaire is never tilted
    return np.stack([angles, factors])[:, : 1 if geometry == 2.0 else None]


def _profile(numbers: _Numbers, year: int, tilt: _Floats) -> IesProfile:
    """Read what follows the TILT line, by the standard of that year."""
    numbers.number("the number of lamps")
    numbers.number("the lumens per lamp")
    factor = numbers.number("the candela multiplier")
    if factor <= 0.0:
        numbers.fail(f"the candela multiplier is {factor:g}; it must be above 0")
    verticals = numbers.count("the number of vertical angles", 2)
    horizontals = numbers.count("the number of horizontal angles", 1)
    if verticals * horizontals > _COUNT_LIMIT:
        numbers.fail(f"{verticals} times {horizontals} intensities are too many; {grouped(_COUNT_LIMIT)} is the most")
    photometry = numbers.number("the photometric type")
    if photometry != 1.0:
        known = _TYPES.get(int(photometry)) if photometry in _TYPES else None
        kind = f"{photometry:g}, type {known}" if known else f"{photometry:g}"
        numbers.fail(f"the photometric type is {kind}; only type C, 1, is read: convert the file to type C")
    for what in ("the units", "the width", "the length", "the height"):
        numbers.number(what)
    for what in ("the ballast factor", "the ballast-lamp factor"):
        value = numbers.number(what)
        # From 2002 on the second number is reserved; since 2019 it says how the file was made
        counts = what == "the ballast factor" or year < 2002
        if counts and value <= 0.0:
            numbers.fail(f"{what} is {value:g}; it must be above 0")
        factor *= value if counts else 1.0
    numbers.number("the input watts")

    vertical = numbers.ascending("a vertical angle", verticals)
    if vertical[0] not in (0.0, 90.0) or vertical[-1] not in (90.0, 180.0):
        ends = f"{vertical[0]:g} to {vertical[-1]:g}"
        numbers.fail(f"vertical angles go from {ends} degrees; they must go from 0 or 90 to 90 or 180")
    horizontal = numbers.ascending("a horizontal angle", horizontals)
    _check_horizontal(numbers, horizontal)
    candela = np.empty((horizontals, verticals))
    for row in candela:
        for i in range(verticals):
            row[i] = numbers.number("an intensity")
            if row[i] < 0.0:
                numbers.fail(f"an intensity is {row[i]:g} candela; it must be at least 0")
    candela *= factor
    if candela.max() > POWER_LIMIT:
        numbers.fail(f"an intensity is {candela.max():g} candela; at most {POWER_LIMIT:g} is known")
    numbers.end()
    angles, values = _all_around(horizontal, candela.T)
    return IesProfile(vertical, angles, np.ascontiguousarray(values), tilt)


def _check_horizontal(numbers: _Numbers, angles: _Floats) -> None:
    first, last = float(angles[0]), float(angles[-1])
    if len(angles) == 1 or (first == 0.0 and last in (90.0, 180.0, 360.0)) or (first, last) == (90.0, 270.0):
        return
    # Some files omit the last angle, which repeats the first
    if first == 0.0 and 180.0 < last < 360.0 and 360.0 - last <= 1.001 * float(np.diff(angles).max()):
        return
    right = "from 0 to 0, 90, 180 or 360, or from 90 to 270"
    numbers.fail(f"horizontal angles go from {first:g} to {last:g} degrees; they must go {right}")


def _all_around(angles: _Floats, values: _Floats) -> tuple[_Floats, _Floats]:
    """Angles from 0 to 360 and their values, from a file that uses symmetry to omit some."""
    last = float(angles[-1])
    if len(angles) == 1:
        return np.zeros(1), values
    if angles[0] == 90.0:
        # Symmetric about the plane through 90 and 270
        between = (angles > 90.0) & (angles < 270.0)
        angles = np.concatenate([angles, 540.0 - angles[between][::-1]])
        values = np.concatenate([values, values[:, between][:, ::-1]], axis=1)
        turned = np.where(angles >= 360.0, angles - 360.0, angles)
        order = turned.argsort(kind="stable")
        angles, values = turned[order], values[:, order]
        if angles[0] > 0.0:
            # 180 is not in the file, and so 0 is not, either
            share = angles[0] / (angles[0] + 360.0 - angles[-1])
            at_zero = values[:, :1] * (1.0 - share) + values[:, -1:] * share
            angles, values = np.append(0.0, angles), np.concatenate([at_zero, values], axis=1)
        last = float(angles[-1])
    for mirror in (90.0, 180.0):
        if last == mirror:
            angles = np.concatenate([angles, 2.0 * mirror - angles[-2::-1]])
            values = np.concatenate([values, values[:, -2::-1]], axis=1)
            last = float(angles[-1])
    if last < 360.0:
        angles, values = np.append(angles, 360.0), np.concatenate([values, values[:, :1]], axis=1)
    return angles, values
