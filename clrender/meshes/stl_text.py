"""Vectorised parsing of ASCII STL files."""

from __future__ import annotations

import re
from typing import BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.meshes.data import TRIANGLE_LIMIT
from clrender.meshes.text import Block, line_blocks, parse_numbers
from clrender.wording import counted, quoted

__all__ = ["read_facets"]

_FACET: Final = b"facet normal . . . outer loop vertex . . . vertex . . . vertex . . . endloop endfacet".split()
"""The words of a facet; a dot stands for a number."""
_NUMBERS: Final = [place for place, word in enumerate(_FACET) if word == b"."]
_SOLID: Final = re.compile(rb"^[ \t]*(?:end[ \t]?)?solid\b[^\n]*", re.MULTILINE)
_NO_NORMAL: Final = re.compile(rb"\bfacet\b(?=\s+outer\b)")
"""A facet without a normal, which the order of its corners gives."""
_Floats = NDArray[np.float64]


def read_facets(file: BinaryIO, label: str) -> tuple[_Floats, _Floats]:
    """Corners and normals of all facets.

    Parameters
    ----------
    file : binary file
        Positioned at its start.
    label : str
        Prefix of error messages.

    Returns
    -------
    corners : (F, 3, 3) float64
    normals : (F, 3) float64

    Raises
    ------
    SceneError
        A word is not the expected one, or the file ends within a facet.
    """
    parts: list[_Floats] = []
    rest: list[bytes] = []
    total, last = 0, 1
    for block in line_blocks(file, label):
        # A solid's name is arbitrary
        words = rest + _SOLID.sub(b"", _NO_NORMAL.sub(b"facet normal 0 0 0", block.text.lower())).split()
        whole = len(words) - len(words) % len(_FACET)
        numbers = _numbers(words[:whole])
        if numbers is None:
            raise _wrong(words[:whole], len(rest), block, label)
        rest = words[whole:]
        parts.append(numbers)
        total += len(numbers)
        last = block.first_line + block.text.count(b"\n") - 1
        if total > TRIANGLE_LIMIT:
            raise SceneError(
                f"{label} holds more than {counted(TRIANGLE_LIMIT, 'triangle')}; at most that many are read"
            )
    if rest:
        raise SceneError(f"{label}: line {last}: the file ends within a facet; it may be cut off: export it again")
    table = np.concatenate(parts) if parts else np.empty((0, 4, 3))
    return np.ascontiguousarray(table[:, 1:]), table[:, 0]


def _numbers(words: list[bytes]) -> _Floats | None:
    """Normal and corners of complete facets, (n, 4, 3); None if a word is wrong."""
    count = len(words) // len(_FACET)
    if not count:
        return np.empty((0, 4, 3))
    for place, word in enumerate(_FACET):
        if word != b"." and words[place :: len(_FACET)] != [word] * count:
            return None
    table = np.empty((count, 12))
    for column, place in enumerate(_NUMBERS):
        values = parse_numbers(b" ".join(words[place :: len(_FACET)]) + b"\n")
        if values is None or len(values) != count:
            return None
        table[:, column] = values
    # Some programs write nan as the normal of a facet without area, which is invisible anyway
    table[:, :3][~np.isfinite(table[:, :3])] = 0.0
    return table.reshape(count, 4, 3) if np.isfinite(table).all() else None


def _wrong(words: list[bytes], carried: int, block: Block, label: str) -> SceneError:
    """The error for the first wrong word; the first `carried` words precede the block."""
    at = next((number for number, word in enumerate(words) if not _fits(word, number % len(_FACET))), len(words) - 1)
    right = _FACET[at % len(_FACET)]
    what = "a number" if right == b"." else right.decode()
    line, before = block.first_line, carried
    for text in _SOLID.sub(b"", block.text.lower()).split(b"\n"):
        before += len(text.split())
        if before > at:
            break
        line += 1
    found = f"{label}: line {line} has {quoted(words[at].decode('utf-8', 'replace'))}"
    return SceneError(f"{found} where {what} must stand; export the file again")


def _fits(word: bytes, place: int) -> bool:
    """Whether a word is valid at a position of a facet."""
    if _FACET[place] != b".":
        return word == _FACET[place]
    value = parse_numbers(word + b"\n")
    return value is not None and len(value) == 1 and (place in _NUMBERS[:3] or bool(np.isfinite(value).all()))
