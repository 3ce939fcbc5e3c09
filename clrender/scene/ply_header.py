"""Reads and checks the header of a PLY file before any of its data is believed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import BinaryIO, Final

from clrender.errors import SceneError
from clrender.scene.wording import quoted

__all__ = ["Element", "PlyHeader", "read_header"]

_HEADER_LIMIT: Final = 2**16
_ELEMENT_LIMIT: Final = 2**27
_SIZES: Final = {
    **dict.fromkeys(("char", "uchar", "int8", "uint8"), 1),
    **dict.fromkeys(("short", "ushort", "int16", "uint16"), 2),
    **dict.fromkeys(("int", "uint", "int32", "uint32", "float", "float32"), 4),
    **dict.fromkeys(("double", "float64"), 8),
}
_FLOATS: Final = ("float", "float32", "double", "float64")


@dataclass
class Element:
    """One kind of record: its number, and its properties as (name, type) or, for a list, (name, count type, type)."""

    name: str
    count: int
    properties: list[tuple[str, ...]] = field(default_factory=list)

    @property
    def least_bytes(self) -> int:
        """Bytes of all records in a binary file, if every list were empty."""
        return self.count * sum(_SIZES[entry[1]] for entry in self.properties)

    @property
    def index_list(self) -> str | None:
        """Name of the list of vertex indices, in the element of faces."""
        lists = [entry[0] for entry in self.properties if len(entry) == 3]
        return next((name for name in lists if name in ("vertex_indices", "vertex_index")), None)


@dataclass
class PlyHeader:
    """What a header promises."""

    is_ascii: bool
    elements: list[Element]
    size: int
    """Bytes of the header itself."""

    def element(self, name: str) -> Element | None:
        """The element of that name."""
        return next((element for element in self.elements if element.name == name), None)


def read_header(file: BinaryIO, label: str) -> PlyHeader:
    """Read the header; the file is left right behind it.

    Raises
    ------
    SceneError
        If it is no header of a mesh with positions and faces of sane size.
    """
    if file.readline(16).rstrip(b"\r\n") != b"ply":
        raise SceneError(f'{label} is no PLY file: its first line is not "ply"')
    encoding = ""
    elements: list[Element] = []
    while True:
        line = file.readline(_HEADER_LIMIT)
        if not line.endswith(b"\n") or file.tell() > _HEADER_LIMIT:
            raise SceneError(f"{label} has no complete header; the file is truncated or no PLY file")
        words = line.decode("latin-1").split()
        if words == ["end_header"]:
            break
        if not words or words[0] in ("comment", "obj_info"):
            if not words or "end_header" in words:
                raise SceneError(f"{label} has a header line that cannot be read: {quoted(' '.join(words))}")
        elif words[0] == "format" and len(words) == 3:
            encoding = words[1]
        elif words[0] == "element" and len(words) == 3:
            elements.append(_element(words, label))
        elif words[0] == "property" and elements:
            _add_property(elements, words, label)
        else:
            raise SceneError(f"{label} has a header line that cannot be read: {quoted(' '.join(words))}")
    if encoding not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise SceneError(f"{label} has the format {quoted(encoding)}, which is none of PLY's")
    header = PlyHeader(encoding == "ascii", elements, file.tell())
    _check_mesh(header, label)
    return header


def _element(words: list[str], label: str) -> Element:
    if not (words[2].isascii() and words[2].isdigit() and len(words[2]) <= 18):
        raise SceneError(f"{label} promises {quoted(words[2])} of element {quoted(words[1])}, which is no number")
    if int(words[2]) > _ELEMENT_LIMIT:
        text = f"promises {words[2]} of element {quoted(words[1])}, but at most {_ELEMENT_LIMIT} are read"
        raise SceneError(f"{label} {text}")
    return Element(words[1], int(words[2]))


def _add_property(elements: list[Element], words: list[str], label: str) -> None:
    is_list = len(words) == 5 and words[1] == "list"
    if not is_list and len(words) != 3:
        raise SceneError(f"{label} has a property that is not PLY's: {quoted(' '.join(words))}")
    entry = (words[4], words[2], words[3]) if is_list else (words[2], words[1])
    if any(kind not in _SIZES for kind in entry[1:]):
        raise SceneError(f"{label} has a property that is not PLY's: {quoted(' '.join(words))}")
    if is_list and entry[1] in _FLOATS:
        raise SceneError(f"{label} counts the entries of {quoted(entry[0])} in floats; integers would be right")
    if any(entry[0] == other[0] for other in elements[-1].properties):
        raise SceneError(f"{label} has the property {quoted(entry[0])} twice")
    elements[-1].properties.append(entry)


def _check_mesh(header: PlyHeader, label: str) -> None:
    names = [element.name for element in header.elements]
    for name in ("vertex", "face"):
        element = header.element(name)
        if element is None or element.count == 0:
            raise SceneError(f"{label} has no {name} element with anything in it; a mesh needs vertices and faces")
        if names.count(name) > 1:
            raise SceneError(f"{label} has two elements {quoted(name)}")
        if name == "vertex":
            scalars = [entry[0] for entry in element.properties if len(entry) == 2]
            missing = [axis for axis in "xyz" if axis not in scalars]
            if missing:
                raise SceneError(f"{label} has vertices without the property {quoted(missing[0])}")
        elif element.index_list is None:
            raise SceneError(f"{label} has faces without a list `vertex_indices`")
        elif next(entry[2] for entry in element.properties if entry[0] == element.index_list) in _FLOATS:
            raise SceneError(f"{label} has vertex indices in floats; a whole-number type would be right")
