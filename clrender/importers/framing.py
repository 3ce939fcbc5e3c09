"""Adds what a model lacks: a camera that frames it, and light."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from clrender.errors import SceneError
from clrender.exact.angles import angle_of, sin_cos, tangent
from clrender.exact.matrices import length
from clrender.flatten.bounds import scene_bounds
from clrender.importers.asset_files import AssetFiles
from clrender.importers.draft import Draft
from clrender.importers.instancing import share_meshes
from clrender.importers.lost_pictures import leave_out_pictures
from clrender.importers.shared.meshes import without_area
from clrender.importers.studio import studio_light
from clrender.scene import EnvironmentLight, Mesh, Scene
from clrender.scene.frozen import frozen
from clrender.scene.validation_errors import scene_error
from clrender.wording import quoted

__all__ = ["completed"]

_FROM: Final = {"y": (0.45, 0.35, 1.0), "z": (0.45, -1.0, 0.35)}
"""Direction from the model's centre to the camera, by the upward axis: in front, slightly to the right and above."""
_UP: Final = {"y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_VERTICAL_FOV: Final = 35.0
_MARGIN: Final = 1.05
_STUDIO: Final = "studio light"
"""Name of the environment map for models without light."""
_LIT: Final = "there is no light in it: lit by a grey surround and a soft light from the camera's upper left"


def completed(draft: Draft, files: AssetFiles, up: str = "y") -> Scene:
    """The scene of a draft, with a camera and light if it has none.

    Parameters
    ----------
    draft : Draft
    files : AssetFiles
    up : str
        Upward axis, ``y`` or ``z``, for that camera and light.

    Raises
    ------
    SceneError
        It is not a valid scene, or has nothing to frame, or all its shapes were left out.
    """
    _leave_out_flat(draft, files)
    if draft.fault is not None and not draft.description["shapes"]:
        raise draft.fault
    share_meshes(draft)
    framed = "camera" not in draft.description
    notes = draft.said()
    description = {**draft.description}
    if framed:
        description["camera"] = {"position": (0.0, 0.0, 1.0), "target": (0.0, 0.0, 0.0)}
    dark = not description.get("lights") and (draft.wants_light or not _shines(description))
    try:
        scene = Scene.model_validate(description)
    except ValidationError as error:
        raise scene_error(error, Scene, files.source) from None
    scene = scene.placed(files.source, files.folder, files.allow_paths)
    held = {shape.asset for _, shape in scene.all_shapes() if isinstance(shape, Mesh) and shape.file in draft.meshes}
    meshes = {asset: frozen(draft.meshes[asset[0]]) for asset in held}
    places, pictures = (
        {name: frozen(content) for name, content in each.items()} for each in (draft.places, draft.environments)
    )
    scene = scene.with_files(meshes=meshes, transforms=places, encoded=draft.pictures, environments=pictures)
    if framed:
        which = "" if up == "y" else "; z is up, or y with --up y"
        notes = [*notes, f"there is no camera in it: it is framed from the front, a little from above{which}"]
        low, high = scene_bounds(scene)
        scene = scene.with_checked(camera=scene.camera.with_checked(**_around(low, high, scene, up)))
    if dark:
        notes = [*notes, _LIT]
        scene = scene.with_default_light(EnvironmentLight(type="environment", file=_STUDIO), _LIT)
        scene = scene.with_files(environments={_STUDIO: studio_light(scene.camera, _UP[up])})
    try:
        scene.read_named()
    except SceneError:
        if not leave_out_pictures(draft, scene, files):
            raise
        return completed(draft, files, up)
    said = (f"{files.source}: {note}" for note in notes)
    return scene.with_notes(said, files.opened, (draft.forgiven, draft.left_out))


def _leave_out_flat(draft: Draft, files: AssetFiles) -> None:
    """Take out shapes whose mesh, in the draft, has no triangle with an area."""
    flat = {name for name, mesh in draft.meshes.items() if without_area(mesh.vertices, mesh.triangles)}
    if not flat:
        return
    description = draft.description
    for shapes in (description["shapes"], *(group["shapes"] for group in description.get("groups", {}).values())):
        for name in [each["file"] for each in shapes if each.get("file") in flat]:
            text = f"the mesh {quoted(name)} has no triangle with an area; give it some"
            draft.leave_out(SceneError(f"{files.source}: {text}"), files.source, files.strict)
        shapes[:] = [each for each in shapes if each.get("file") not in flat]


def _shines(description: dict[str, Any]) -> bool:
    shapes = [*description["shapes"], *(s for g in description.get("groups", {}).values() for s in g["shapes"])]
    if any(shape.get("emission") is not None for shape in shapes):
        return True
    used = {shape.get("material") for shape in shapes}
    return any("emission" in material for name, material in description["materials"].items() if name in used)


def _around(low: NDArray[np.float64], high: NDArray[np.float64], scene: Scene, up: str) -> dict[str, Any]:
    """Keys of a camera that frames a whole box."""
    if not (high >= low).all():
        raise SceneError(f"{scene.source}: has no surface that a camera could be pointed at")
    middle, radius = (low + high) / 2.0, length(high - low) / 2.0
    wide = scene.image.width / scene.image.height
    half = math.radians(_VERTICAL_FOV) / 2.0
    half = min(half, angle_of(tangent(half) * wide, 1.0))
    # Even for a single point, the camera is so far away that double precision distinguishes the two
    radius = max(radius, 1e-6 * max(1.0, float(np.abs(middle).max())))
    distance = _MARGIN * radius / sin_cos(half)[0]
    toward = np.array(_FROM[up]) / length(_FROM[up])
    return {
        **({} if up == "y" else {"up": _UP[up]}),
        "position": tuple(float(x) for x in middle + distance * toward),
        "target": tuple(float(x) for x in middle),
        "vertical_fov": _VERTICAL_FOV,
    }
