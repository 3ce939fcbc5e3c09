"""Leaves out pictures that are missing or damaged, in scenes of all other formats."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from clrender.errors import OutOfMemory, SceneError
from clrender.files.named import allowed_file
from clrender.importers.asset_files import AssetFiles
from clrender.importers.draft import Draft
from clrender.scene import Scene
from clrender.scene.pictures import TexelStore
from clrender.wording import place

__all__ = ["LOST", "leave_out_pictures"]

LOST: Final = 0.5
"""Stands for a picture that is missing, in the place of the colour of a surface."""
_BASES: Final = frozenset(["base_color", "f0", "reflectance"])
"""Keys of the colours of surfaces."""
_LAYERS: Final = frozenset(["emission", "sheen_color", "specular_color"])
"""Keys of colours that are absent without their picture."""
_RELIEFS: Final = frozenset(["bump_map", "normal_map"])


def leave_out_pictures(draft: Draft, scene: Scene, files: AssetFiles) -> bool:
    """Take all pictures that cannot be read out of a draft, with a note for each.

    The colour of a surface becomes grey, times the factor of the picture; an emission, a highlight and a sheen become
    black; a number becomes the factor, as if the picture were white; maps of normals and heights are left out.

    Parameters
    ----------
    draft : Draft
        Its description is changed.
    scene : Scene
        Made of the draft.
    files : AssetFiles

    Returns
    -------
    bool
        Whether there were any.

    Raises
    ------
    SceneError
        A picture is in a folder that is not allowed, or too large for this machine; or there is one, and `files` are
        strict.
    """
    lost: set[str] = set()
    for at, texture in scene.texture_files():
        name = texture.texture
        label = f"{files.source}: {place(at)}"
        if name in lost:
            continue
        if name not in draft.pictures:
            allowed_file(name, files.folder, files.allow_paths, f"{label}: {name!a}")
        try:
            TexelStore([(label, texture)], files.folder, files.allow_paths, {}, draft.pictures)
        except OutOfMemory:
            raise
        except SceneError as fault:
            draft.leave_out(fault, files.source, files.strict)
            lost.add(name)
    description = draft.description
    grouped = (shape for group in description.get("groups", {}).values() for shape in group["shapes"])
    parts = [*description["materials"].values(), *description["shapes"], *grouped]
    return sum(_taken_out(part, lost) for part in parts) > 0


def _taken_out(part: dict[str, Any], lost: set[str]) -> int:
    """Replace the lost pictures of a material or shape; returns how many."""
    count = 0
    for key, value in list(part.items()):
        if not isinstance(value, dict) or value.get("texture") not in lost:
            continue
        count += 1
        factor = np.clip(np.asarray(value.get("scale", 1.0), np.float64) * np.ones(3), 0.0, 1.0)
        if key in _RELIEFS:
            del part[key]
        elif key in _BASES:
            part[key] = (LOST * factor).tolist()
        else:
            part[key] = [0.0, 0.0, 0.0] if key in _LAYERS else float(factor[0])
    return count
