"""Reads and validates the header of a PLY file."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import BinaryIO, Final

from clrender.errors import SceneError
from clrender.wording import grouped, quoted

__all__ = ["Element", "PlyHeader", "Property", "read_header"]

_HEADER_LIMIT: Final = 2**16
_ELEMENT_LIMIT: Final = 2**27
_KINDS: Final = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float": "f4",
    "double": "f8",
    "float32": "f4",
    "float64": "f8",
}
"""NumPy's names for PLY's types."""


@dataclass(frozen=True)
class Property:
    """One number of a record, or one list of numbers.

    Attributes
    ----------
    name : str
    kind : str
        NumPy type of the number, or of the list's entries: a letter of "iuf" and the bytes.
    count_kind : str
        Type of the number of entries; empty if the property is not a list.
    """

    name: str
    kind: str
    count_kind: str = ""

    @property
    def entry_bytes(self) -> int:
        """Size of a number in a binary file, bytes."""
        return int(self.kind[1])

    @property
    def count_bytes(self) -> int:
        """Size of a list's number of entries in a binary file, bytes."""
        return int(self.count_kind[1])


@dataclass
class Element:
    """One kind of record, and the number of such records."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)

    @property
    def least_bytes(self) -> int:
        """Size of all records in a binary file if every list were empty, bytes."""
        return self.count * sum(p.count_bytes if p.count_kind else p.entry_bytes for p in self.properties)

    @property
    def lists(self) -> list[Property]:
        """Properties that are lists."""
        return [entry for entry in self.properties if entry.count_kind]

    @property
    def index_list(self) -> Property | None:
        """The list of vertex indices, in the element of faces."""
        return next((entry for entry in self.lists if entry.name in ("vertex_indices", "vertex_index")), None)


@dataclass
class PlyHeader:
    """Content of a header."""

    encoding: str
    """One of `ascii`, `binary_little_endian`, `binary_big_endian`."""
    elements: list[Element]
    size: int
    """Size of the header, bytes."""
    lines: int
    """Number of lines of the header."""
    texture: str = ""
    """The picture that a comment of MeshLab's names."""
    unknown: int = 0
    """Number of lines that are none of a header's."""

    @property
    def surface(self) -> Element | None:
        """The element of faces, or of triangle strips."""
        return self.element("face") or self.element("tristrips")

    def element(self, name: str) -> Element | None:
        """The element of that name."""
        return next((element for element in self.elements if element.name == name), None)


def read_header(file: BinaryIO, label: str) -> PlyHeader:
    """Read the header; leaves the file positioned after it.

    Raises
    ------
    SceneError
        If it is not the header of a mesh with positions and faces, or its counts are too large.
    """
    encoding, lines, size, texture, unknown = "", 0, 0, "", 0
    elements: list[Element] = []
    for line, end in _header_lines(file, label):
        lines += 1
        words = line.decode("latin-1").split()
        if lines == 1:
            continue
        if words == ["end_header"]:
            size = end
            break
        keyword = words[0] if words else ""
        if keyword in ("comment", "obj_info"):
            if len(words) > 2 and words[1].lower() == "texturefile":
                texture = texture or line.decode("utf-8", "replace").split(None, 2)[2].strip()
            continue
        if keyword == "format" and len(words) == 3:
            encoding = words[1]
        elif keyword == "element" and len(words) == 3:
            elements.append(_element(words, label))
        elif keyword == "property" and elements:
            _add_property(elements, words, label)
        elif keyword in ("format", "element", "property"):
            raise SceneError(f"{label} has a header line that cannot be read: {quoted(' '.join(words))}")
        else:
            unknown += 1  # a comment without the word
    file.seek(size)
    if encoding not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise SceneError(f"{label} has the format {quoted(encoding)}, which is none of PLY's")
    header = PlyHeader(encoding, elements, size, lines, texture, unknown)
    _check_mesh(header, label)
    return header


def _header_lines(file: BinaryIO, label: str) -> Iterator[tuple[bytes, int]]:
    """Lines of the header, and the byte after each; they end in a line feed, a carriage return or both."""
    data = file.read(_HEADER_LIMIT)
    match = re.match(rb"ply[ \t]*(\r\n|\n|\r)", data)
    if match is None:
        raise SceneError(f'{label} is no PLY file: its first line is not "ply"')
    ending, at = match[1], 0
    while (end := data.find(ending, at)) >= 0:
        yield data[at:end], end + len(ending)
        at = end + len(ending)
    raise SceneError(f"{label} has no complete header; the file is truncated or no PLY file")


def _element(words: list[str], label: str) -> Element:
    if not (words[2].isascii() and words[2].isdigit() and len(words[2]) <= 18):
        raise SceneError(f"{label} promises {quoted(words[2])} of element {quoted(words[1])}, which is no number")
    if int(words[2]) > _ELEMENT_LIMIT:
        text = f"promises {words[2]} of element {quoted(words[1])}, but at most {grouped(_ELEMENT_LIMIT)} are read"
        raise SceneError(f"{label} {text}")
    return Element(words[1], int(words[2]))


def _add_property(elements: list[Element], words: list[str], label: str) -> None:
    is_list = len(words) == 5 and words[1] == "list"
    if not is_list and len(words) != 3:
        raise SceneError(f"{label} has a property that is not PLY's: {quoted(' '.join(words))}")
    name, kind, count_kind = (words[4], words[3], words[2]) if is_list else (words[2], words[1], "uchar")
    if kind not in _KINDS or count_kind not in _KINDS:
        raise SceneError(f"{label} has a property that is not PLY's: {quoted(' '.join(words))}")
    entry = Property(name, _KINDS[kind], _KINDS[count_kind] if is_list else "")
    if entry.count_kind.startswith("f"):
        raise SceneError(f"{label} counts the entries of {quoted(name)} in floats; integers would be right")
    if any(name == other.name for other in elements[-1].properties):
        raise SceneError(f"{label} has the property {quoted(name)} twice")
    elements[-1].properties.append(entry)


def _check_mesh(header: PlyHeader, label: str) -> None:
    names = [element.name for element in header.elements]
    for name, element in (("vertex", header.element("vertex")), ("face", header.surface)):
        if element is None or element.count == 0:
            raise SceneError(f"{label} has no {name} element with anything in it; a mesh needs vertices and faces")
        if names.count(element.name) > 1:
            raise SceneError(f"{label} has two elements {quoted(element.name)}")
        if name == "vertex":
            scalars = [entry.name for entry in element.properties if not entry.count_kind]
            missing = [axis for axis in "xyz" if axis not in scalars]
            if missing:
                raise SceneError(f"{label} has vertices without the property {quoted(missing[0])}")
        elif element.index_list is None:
            raise SceneError(f"{label} has faces without a list `vertex_indices`")
        elif element.index_list.kind.startswith("f"):
            raise SceneError(f"{label} has vertex indices in floats; a whole-number type would be right")
