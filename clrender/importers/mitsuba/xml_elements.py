"""Parses XML to a tree of elements with line numbers; refuses document types, entities, and excessive depth or size."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final
from xml.parsers import expat

from clrender.errors import SceneError
from clrender.wording import counted, quoted

__all__ = ["FILE_LIMIT", "Element", "parsed"]

FILE_LIMIT: Final = 2**26
"""Largest XML file, bytes: meshes are in separate files."""
_DEPTH: Final = 32
_COUNT: Final = 2**20
"""Most elements of a file."""


@dataclass
class Element:
    """An XML element.

    Attributes
    ----------
    tag : str
    attributes : dict of str to str
    line : int
        From 1.
    children : list of Element
    """

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)


class _Refused(Exception):
    """Stops the parser, with the line and the sentence."""


class _Tree:
    """Builds the tree from the parser's events."""

    def __init__(self) -> None:
        self.root: Element | None = None
        self._open: list[Element] = []
        self._count = 0
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        self.parser.StartDoctypeDeclHandler = self._doctype
        self.parser.EntityDeclHandler = self._doctype

    def _refuse(self, sentence: str) -> _Refused:
        return _Refused(self.parser.CurrentLineNumber, sentence)

    def _doctype(self, *_: object) -> None:
        raise self._refuse("has a document type or entities, which are not read; remove the declaration")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._count += 1
        if self._count > _COUNT:
            raise self._refuse(
                f"is beyond {counted(_COUNT, 'element')}, which are the most; keep meshes in files of their own"
            )
        if len(self._open) >= _DEPTH:
            raise self._refuse(f"elements are nested more than {_DEPTH} deep; use `ref` instead")
        element = Element(tag, attributes, self.parser.CurrentLineNumber)
        if self._open:
            self._open[-1].children.append(element)
        else:
            self.root = element
        self._open.append(element)

    def _end(self, _: str) -> None:
        self._open.pop()

    def _text(self, text: str) -> None:
        if text.strip():
            # The parser has read the whole element and is positioned after it
            leading = len(text) - len(text.lstrip())
            line = self.parser.CurrentLineNumber - text.count("\n") + text[:leading].count("\n")
            sentence = f"has the text {quoted(text.strip())} between elements; give values as attributes"
            raise _Refused(line, sentence)


def parsed(data: bytes, source: str) -> Element:
    """The root of an XML file.

    Parameters
    ----------
    data : bytes
    source : str
        Name of the file for messages.

    Raises
    ------
    SceneError
        It is not XML, or has refused content.
    """
    tree = _Tree()
    try:
        tree.parser.Parse(data, True)
    except _Refused as refused:
        line, sentence = refused.args
        raise SceneError(f"{source}: line {line}: {sentence}") from None
    except expat.ExpatError as error:
        problem = ascii(expat.ErrorString(error.code))[1:-1]
        raise SceneError(
            f"{source}: line {error.lineno}: is no sound XML ({problem}); mend or export it again"
        ) from None
    except (LookupError, ValueError):  # an encoding that Python lacks
        raise SceneError(f"{source}: line 1: is in an encoding that is not known; save it as UTF-8") from None
    assert tree.root is not None
    return tree.root
