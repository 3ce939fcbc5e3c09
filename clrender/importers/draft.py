"""What a reader has found so far: a description as of our own scene files, and what it holds itself."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from clrender.scene.environment import EnvironmentPicture
from clrender.scene.mesh_data import MeshData

__all__ = ["Draft"]


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
    notes : list of str
        What was not understood and what was done instead; a sentence each, without the file's name.
    """

    description: dict[str, Any] = field(default_factory=lambda: {"materials": {}, "shapes": [], "lights": []})
    meshes: dict[str, MeshData] = field(default_factory=dict)
    pictures: dict[str, tuple[bytes, str]] = field(default_factory=dict)
    environments: dict[str, EnvironmentPicture] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def note(self, sentence: str) -> None:
        """Say something once."""
        if sentence not in self.notes:
            self.notes.append(sentence)
