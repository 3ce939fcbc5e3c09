"""What a reader has found so far: a description as of our own scene files, and what it holds itself."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

from clrender.scene.environment import EnvironmentPicture
from clrender.scene.groups import TransformArray
from clrender.scene.mesh_data import MeshData

__all__ = ["Draft"]

_MOST_NOTES: Final = 40
"""More are counted."""


@dataclass
class Draft:
    """A scene on its way in.

    Attributes
    ----------
    description : dict
        As a scene file of our own would say it: ``camera image render materials shapes lights``. A mesh or picture of
        the draft's own is named where a file would be; names that end in no known ending cannot be files.
    meshes : dict of str to MeshData
        By that name.
    pictures : dict of str to (bytes, str)
        Encoded pictures by that name, each with the ending that its format has, such as ``.png``.
    environments : dict of str to EnvironmentPicture
        By the name that the light of the environment has for its file.
    places : dict of str to TransformArray
        Of instances, by the name that they have for a file of them.
    notes : list of str
        What was not understood and what was done instead; a sentence each, without the file's name.
    wants_light : bool
        Whether it is lit from all around also where surfaces of it shine, as long as it has no other lights.
    """

    description: dict[str, Any] = field(default_factory=lambda: {"materials": {}, "shapes": [], "lights": []})
    meshes: dict[str, MeshData] = field(default_factory=dict)
    pictures: dict[str, tuple[bytes, str]] = field(default_factory=dict)
    environments: dict[str, EnvironmentPicture] = field(default_factory=dict)
    places: dict[str, TransformArray] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    wants_light: bool = False
    _more: int = field(default=0, repr=False)

    def note(self, sentence: str) -> None:
        """Say something once, or count it when it is too much."""
        if sentence in self.notes:
            return
        if len(self.notes) < _MOST_NOTES:
            self.notes.append(sentence)
        else:
            self._more += 1

    def said(self) -> list[str]:
        """All notes, and how many things are in none."""
        return [*self.notes, f"{self._more} more things were left out or changed"] if self._more else self.notes
