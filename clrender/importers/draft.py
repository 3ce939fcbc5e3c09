"""Intermediate result of an importer: a description like our own scene files, and embedded data."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

from clrender.curves import CurveData
from clrender.errors import SceneError
from clrender.grids import GridData
from clrender.measured import MeasuredFile
from clrender.meshes.data import MeshData
from clrender.scene.environment import EnvironmentPicture
from clrender.scene.groups import TransformArray
from clrender.scene.ies import IesProfile
from clrender.wording import counted

__all__ = ["Draft"]

_MOST_NOTES: Final = 40
"""Most notes that are kept; further ones are only counted."""


@dataclass
class Draft:
    """A scene under construction by an importer.

    What is wrong in a file is answered in one of three ways. What cannot be drawn refuses the file. What makes a part
    impossible leaves out that part. What a specification forbids, but leaves no doubt about the image, is forgiven. The
    last two are noted and counted, and refuse the file as well if that is asked for (``--strict``).

    Attributes
    ----------
    description : dict
        Like our own scene files: ``camera image render materials shapes lights``. A mesh or image of the draft is named
        where a file would be; names without a known extension cannot be files.
    meshes : dict of str to MeshData
        By that name.
    pictures : dict of str to (bytes, str)
        Encoded images by that name, each with the extension of its format, such as ``.png``.
    environments : dict of str to EnvironmentPicture
        By the file name of the environment light.
    profiles : dict of str to IesProfile
        By the file name of the IES light.
    places : dict of str to TransformArray
        Transforms of instances, by their file name.
    grids : dict of str to GridData
        By the file name of the density of a medium.
    curves : dict of str to CurveData
        By the file name of curves.
    measured : dict of str to MeasuredFile
        By the file name of measured materials.
    notes : list of str
        What is not supported and what was done instead; a sentence each, without the file's name.
    wants_light : bool
        Whether it needs a default environment although it has emissive surfaces, if it has no other lights.
    wants_exposure : bool
        Whether its camera is of a format in which cameras have no exposure.
    forgiven, left_out : int
        Faults that were forgiven, and parts that were left out for theirs.
    fault : SceneError or None
        The first fault for which a part was left out.
    """

    description: dict[str, Any] = field(default_factory=lambda: {"materials": {}, "shapes": [], "lights": []})
    meshes: dict[str, MeshData] = field(default_factory=dict)
    pictures: dict[str, tuple[bytes, str]] = field(default_factory=dict)
    environments: dict[str, EnvironmentPicture] = field(default_factory=dict)
    profiles: dict[str, IesProfile] = field(default_factory=dict)
    places: dict[str, TransformArray] = field(default_factory=dict)
    grids: dict[str, GridData] = field(default_factory=dict)
    curves: dict[str, CurveData] = field(default_factory=dict)
    measured: dict[str, MeasuredFile] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    wants_light: bool = False
    wants_exposure: bool = False
    forgiven: int = 0
    left_out: int = 0
    fault: SceneError | None = None
    _more: int = field(default=0, repr=False)

    def note(self, sentence: str) -> None:
        """Add a note, unless it is a duplicate; count it if there are too many."""
        if sentence in self.notes:
            return
        if len(self.notes) < _MOST_NOTES:
            self.notes.append(sentence)
        else:
            self._more += 1

    def forgive(self, fault: SceneError, source: str, strict: bool) -> None:
        """Note a fault that leaves no doubt about the image.

        Parameters
        ----------
        fault : SceneError
            The error with which the file would be refused; what follows its last semicolon is the remedy.
        source : str
            Name of the file, with which the message begins.
        strict : bool
            Whether to refuse the file.

        Raises
        ------
        SceneError
            The fault itself, if `strict`.
        """
        if strict:
            raise fault
        self.forgiven += 1
        sentence = str(fault).removeprefix(f"{source}: ")
        self.note(f"{sentence.rpartition('; ')[0] or sentence}: read all the same")

    def leave_out(self, fault: SceneError, source: str, strict: bool) -> None:
        """Note a fault for which a part is left out; for the parameters see `forgive`."""
        if strict:
            raise fault
        self.left_out += 1
        self.fault = self.fault or fault
        self.note(f"{str(fault).removeprefix(f'{source}: ')}: left out")

    def said(self) -> list[str]:
        """All notes, and a last one with the number of omitted notes."""
        return (
            [*self.notes, f"{counted(self._more, 'more thing was', 'more things were')} left out or changed"]
            if self._more
            else self.notes
        )
