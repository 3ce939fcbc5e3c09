"""What the parts of a scene exported for another program share: ids, files and notes."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Final

from clrender.errors import SceneError
from clrender.exporters.files import NamedFiles
from clrender.files.access import atomic_write
from clrender.scene import PluginMaterial, Scene
from clrender.scene.light_kinds import MOVING_LIGHTS, IesLight, PluginLight, ProjectorLight
from clrender.scene.motion import rests
from clrender.scene.posed import deforms
from clrender.scene.resting import opened
from clrender.scene.shapes import Mesh
from clrender.scene.textures import PluginTexture, textures_of
from clrender.wording import place

__all__ = ["LAMPS", "ForeignExport", "Target", "write_foreign"]

LAMPS: Final[Mapping[type, str]] = {
    IesLight: "the lamps of IES files",
    ProjectorLight: "projectors",
    PluginLight: "the lights of plugins",
}
"""Words for lights at a point that few programs have, in notes on what is left out."""

_MOST_PLACES: Final = 3
"""Most places that one note names."""


@dataclass
class ForeignExport(NamedFiles):
    """A scene for another program, and its files.

    Attributes
    ----------
    text : bytes
        Content of the scene file.
    notes : tuple of str
        What the program cannot express, a sentence each; see also `NamedFiles`.
    """

    program: ClassVar[str]
    """Its name."""
    text: bytes = b""
    notes: tuple[str, ...] = ()

    def check(self, scene: Scene, strict: bool) -> None:
        """Refuse a scene of which something is left out, if `strict`.

        Raises
        ------
        SceneError
            With all that is left out.
        """
        if strict and self.notes:
            left_out = "; ".join(self.notes)
            text = f"{self.program} cannot express all of it: {left_out}; convert it without strict"
            raise SceneError(f"{scene.source}: {text}")


def write_foreign(
    exported: Callable[[Scene, str, bool], ForeignExport], scene: Scene, output: str | Path, strict: bool, merge: bool
) -> tuple[str, ...]:
    """Write a scene for another program.

    Parameters
    ----------
    exported : callable
        Makes the export from the scene, the folder of its files, and `merge`.
    scene : Scene
    output : str or pathlib.Path
        The scene file; meshes and pictures are written to the folder ``NAME-files`` beside it.
    strict : bool
        Refuse a scene of which something would be left out.
    merge : bool
        Passed on.

    Returns
    -------
    tuple of str
        What the program cannot express, a sentence each.

    Raises
    ------
    SceneError
        Like `exported`; or something would be left out, if `strict`.
    UsageError
        A file cannot be written.
    """
    path = Path(output)
    export = exported(scene, f"{path.stem}-files", merge)
    export.check(scene, strict)
    with export.written(path), atomic_write(path) as file:
        file.write(export.text)
    return export.notes


@dataclass
class Target:
    """An exported scene under construction.

    Attributes
    ----------
    scene : Scene
    folder : str
        Folder of its files, relative to the scene file.
    no_id : re.Pattern
        What ids of the program lack, and so is removed from names.
    between : str
        What separates a name from the number that distinguishes it from others.
    apart : bool
        Whether objects of different kinds may have the same id.
    files : NamedFiles
    """

    scene: Scene
    folder: str
    no_id: re.Pattern[str]
    between: str = " "
    apart: bool = False
    files: NamedFiles = field(default_factory=NamedFiles)
    _ids: set[tuple[str, str]] = field(default_factory=set)
    _numbers: dict[tuple[str, str], int] = field(default_factory=dict)
    _notes: dict[str, list[str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse what no other program has, and take what moves as it is when the shutter opens.

        Raises
        ------
        SceneError
            A material is made by a plugin.
        """
        moving, (begin, end) = self.scene, self.scene.camera.interval
        self.scene = opened(moving)
        sentence = "motion: it is where it is when the shutter opens"
        if moving.camera.track is not None:
            self.leave_out(sentence, "camera", "motion")
        placed: list[tuple[tuple[str | int, ...], Any]]
        placed = [(("shapes", index), shape) for index, shape in enumerate(moving.shapes if moving.has_motion else ())]
        inside = (each for each in moving.all_shapes() if each[0][0] == "groups")
        for where, shape in (*placed, *inside):
            if shape.motion and rests(shape.motion, begin, end) is None:
                self.leave_out(sentence, *where, "motion")
            if isinstance(shape, Mesh) and deforms(shape, begin, end):
                self.leave_out("a change of form: it is as the shutter finds it", *where, "poses")
        for index, light in enumerate(moving.lights):
            keys = light.motion if isinstance(light, MOVING_LIGHTS) else ()
            if keys and rests(keys, begin, end) is None:
                self.leave_out(sentence, "lights", index, "motion")
        if moving.camera.rolling_shutter > 0.0:
            self.leave_out("a rolling shutter", "camera", "rolling_shutter")
        for name, material in self.scene.materials.items():
            textures = ((key, each) for key, each in textures_of(material) if isinstance(each, PluginTexture))
            at, plugin = next(textures, ("", material if isinstance(material, PluginMaterial) else None))
            if plugin is not None:
                of_material = place(("materials", name, *(at.split(".", 1) if at else ())))
                text = f"is made by the plugin {plugin.plugin}, which other programs do not have"
                cure = "give it another, or convert to clrender's own format"
                raise SceneError(f"{self.scene.source}: {of_material} {text}; {cure}")

    def id(self, kind: str, wanted: str) -> str:
        """A new id: `wanted` as far as the program takes it and no other object has it.

        Parameters
        ----------
        kind : str
            The id if nothing else is left of `wanted`.
        wanted : str
        """
        plain = self.no_id.sub("", wanted).strip() or kind
        space = kind if self.apart else ""
        made, number = plain, self._numbers.get((space, plain), 2)
        while (space, made) in self._ids:
            made, number = f"{plain}{self.between}{number}", number + 1
        self._ids.add((space, made))
        self._numbers[space, plain] = number
        return made

    def leave_out(self, sentence: str, *at: str | int) -> None:
        """Note what the program cannot express.

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
