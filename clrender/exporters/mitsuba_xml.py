"""Elements of Mitsuba's XML, and what the parts of one exported scene share: ids, files and notes."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np

from clrender.exporters.files import NamedFiles
from clrender.scene import Scene
from clrender.wording import place

__all__ = ["Element", "Target", "element", "transform", "value", "words"]

Element = ElementTree.Element
_MOST_PLACES: Final = 3
"""Most places that one note names."""
_NO_ID: Final = re.compile(r"[^\w -]|^_+")
"""What Mitsuba's ids lack: dots, which separate names of parameters, ``$``, and an underscore at their beginning."""


def words(values: Any) -> str:
    """Numbers separated by blanks, with all their digits."""
    return " ".join(repr(float(x)) for x in np.asarray(values, np.float64).ravel())


def element(tag: str, *children: Element, **attributes: str) -> Element:
    """An element with attributes and children."""
    made = Element(tag, attributes)
    made.extend(children)
    return made


def value(tag: str, name: str, given: Any) -> Element:
    """A named value: ``float``, ``integer``, ``boolean``, ``string``, ``rgb``, ``point`` or ``vector``."""
    if isinstance(given, bool):
        text = str(given).lower()
    else:
        text = str(given) if isinstance(given, str | int) else words(given)
    return element(tag, name=name, value=text)


def transform(matrix: Any, name: str = "to_world") -> Element:
    """A transform of a (4, 4) matrix that acts on column vectors."""
    return element("transform", element("matrix", value=words(matrix)), name=name)


@dataclass
class Target:
    """An exported scene under construction.

    Attributes
    ----------
    scene : Scene
    folder : str
        Folder of its files, relative to the scene file.
    files : NamedFiles
    """

    scene: Scene
    folder: str
    files: NamedFiles = field(default_factory=NamedFiles)
    _ids: dict[str, str] = field(default_factory=dict)
    _notes: dict[str, list[str]] = field(default_factory=dict)

    def id(self, kind: str, wanted: str) -> str:
        """A new id: `wanted` as far as Mitsuba takes it and no other object has it.

        Parameters
        ----------
        kind : str
            The id if nothing else is left of `wanted`.
        wanted : str
        """
        plain = _NO_ID.sub("", wanted).strip() or kind
        made, number = plain, 2
        while made in self._ids:
            made, number = f"{plain} {number}", number + 1
        self._ids[made] = wanted
        return made

    def leave_out(self, sentence: str, *at: str | int) -> None:
        """Note what Mitsuba cannot express.

        Parameters
        ----------
        sentence : str
            What is left out, and what is there instead.
        *at : str or int
            Place in the scene.
        """
        places = self._notes.setdefault(sentence, [])
        if at and place(at) not in places:
            places.append(place(at))

    def notes(self) -> tuple[str, ...]:
        """A sentence for each kind of thing that is left out, with the places where it is."""
        return tuple(f"left out: {sentence}{_where(places)}" for sentence, places in self._notes.items())


def _where(places: list[str]) -> str:
    if not places:
        return ""
    more = f" and {len(places) - _MOST_PLACES} more" if len(places) > _MOST_PLACES else ""
    return f" ({', '.join(places[:_MOST_PLACES])}{more})"
