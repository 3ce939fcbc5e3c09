"""Adds what a model lacks: a camera that frames it, an exposure, and light."""

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
from clrender.image.exposure import photographic_shutter
from clrender.importers.asset_files import AssetFiles
from clrender.importers.draft import Draft
from clrender.importers.instancing import share_meshes
from clrender.importers.lost_pictures import leave_out_pictures
from clrender.importers.metering import stops_needed
from clrender.importers.shared.meshes import without_area
from clrender.importers.studio import studio_light
from clrender.importers.surface_points import surface_points, upright
from clrender.importers.viewpoint import SIDES, chosen_side, visible
from clrender.scene import EnvironmentLight, Mesh, Scene
from clrender.scene.frozen import frozen
from clrender.scene.validation_errors import scene_error
from clrender.scene.values import Vector, cross
from clrender.wording import place, quoted

__all__ = ["FRAMED", "completed"]

FRAMED: Final = "there is no camera in it: it is framed"
"""Beginning of the note about a camera that was chosen here."""

_UP: Final = {"y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_VERTICAL_FOV: Final = 35.0
_MARGIN: Final = 1.05
_F_STOPS: Final = {"dim": 4.0, "bright": 64.0}
"""Of a camera whose exposure is chosen, by its lights."""
_STUDIO: Final = "studio light"
"""Name of the environment map for models without light."""
_EXPOSED: Final = "its lights are {} for its size: display images get {:+d} stops (f/{:g}, {:.3g} s), radiance none"
_LIT: Final = "there is no light in it: lit by a grey surround and a soft light from the camera's upper left"


def completed(draft: Draft, files: AssetFiles, up: str = "y", *, surrounded: bool = False) -> Scene:
    """The scene of a draft, with a camera and light if it has none.

    Parameters
    ----------
    draft : Draft
    files : AssetFiles
    up : str
        Upward axis, ``y`` or ``z``, for that camera and light.
    surrounded : bool
        Whether the scene will be given an environment.

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
    held = {shape.asset for _, shape in scene.mesh_files() if shape.file in draft.meshes}
    meshes = {asset: frozen(draft.meshes[asset[0]]) for asset in held}
    places, pictures, profiles, grids, curves, measured = (
        {name: frozen(content) for name, content in each.items()}
        for each in (draft.places, draft.environments, draft.profiles, draft.grids, draft.curves, draft.measured)
    )
    scene = scene.with_files(
        meshes=meshes,
        transforms=places,
        encoded=draft.pictures,
        environments=pictures,
        profiles=profiles,
        grids=grids,
        curves=curves,
        measured=measured,
    )
    if framed:
        keys, side = _around(scene, up)
        which = "" if up == "y" else "; z is up, or y with --up y"
        notes = [*notes, f"{FRAMED} {side}{which}"]
        scene = scene.with_checked(camera=scene.camera.with_checked(**keys))
    if not dark and not surrounded and (framed or draft.wants_exposure):
        scene, exposed = _exposed(scene)
        notes = [*notes, *exposed]
    if dark:
        notes = [*notes, _LIT]
        scene = scene.with_default_light(EnvironmentLight(type="environment", file=_STUDIO), _LIT)
        scene = scene.with_files(environments={_STUDIO: studio_light(scene.camera, _UP[up])})
    try:
        scene.read_named()
    except SceneError:
        if not leave_out_pictures(draft, scene, files):
            raise
        return completed(draft, files, up, surrounded=surrounded)
    said = (f"{files.source}: {note}" for note in notes)
    forgiven, left_out = _faults_of_meshes(scene, files)
    return scene.with_notes(said, dict.fromkeys(files.opened), (draft.forgiven + forgiven, draft.left_out + left_out))


def _faults_of_meshes(scene: Scene, files: AssetFiles) -> tuple[int, int]:
    """How many faults of meshes were forgiven, and for how many triangles were left out. Each mesh counts once.

    The flat scene has their warnings.
    """
    found: dict[tuple[str, str | None], tuple[int, int]] = {}
    for at, shape in scene.all_shapes():
        if isinstance(shape, Mesh) and shape.file is not None:
            mesh = scene.mesh_of(at, shape)
            if files.strict and (mesh.forgiven or mesh.left_out):
                raise SceneError(f"{files.source}: {place(at)}: {mesh.warning}; export it again")
            found[shape.asset] = mesh.forgiven, mesh.left_out
    return sum(each for each, _ in found.values()), sum(each for _, each in found.values())


def _leave_out_flat(draft: Draft, files: AssetFiles) -> None:
    """Take out shapes whose mesh, in the draft, has no triangle with an area, nor has that of a pose."""
    flat = {name for name, mesh in draft.meshes.items() if without_area(mesh.vertices, mesh.triangles)}
    if not flat:
        return

    def is_flat(shape: dict[str, Any]) -> bool:
        return all(each.get("file") in flat for each in (shape, *shape.get("poses", ())))

    description = draft.description
    for shapes in (description["shapes"], *(group["shapes"] for group in description.get("groups", {}).values())):
        for name in [each["file"] for each in shapes if is_flat(each)]:
            text = f"the mesh {quoted(name)} has no triangle with an area; give it some"
            draft.leave_out(SceneError(f"{files.source}: {text}"), files.source, files.strict)
        shapes[:] = [each for each in shapes if not is_flat(each)]


def _shines(description: dict[str, Any]) -> bool:
    shapes = [*description["shapes"], *(s for g in description.get("groups", {}).values() for s in g["shapes"])]
    if any(shape.get("emission") is not None for shape in shapes):
        return True
    used = {shape.get("material") for shape in shapes}
    if any("emission" in material for name, material in description["materials"].items() if name in used):
        return True
    filled = {shape.get("interior") for shape in shapes} | {description.get("fog")}
    return any("emission" in medium for name, medium in description.get("media", {}).items() if name in filled)


def _around(scene: Scene, up: str) -> tuple[dict[str, Any], str]:
    """Keys of a camera that frames all that is seen, and the name of the side from which it does."""
    low, high = scene_bounds(scene, seen_only=True)
    if not (high >= low).all():  # nothing but what is transparent
        low, high = scene_bounds(scene)
    if not (high >= low).all():
        raise SceneError(f"{scene.source}: has no surface that a camera could be pointed at")
    middle, radius = (low + high) / 2.0, length(high - low) / 2.0
    # Even for a single point, the camera is so far away that double precision distinguishes the two
    radius = max(radius, 1e-6 * max(1.0, float(np.abs(middle).max())))
    slope = tangent(math.radians(_VERTICAL_FOV) / 2.0)
    wide = scene.image.width / scene.image.height
    sine = sin_cos(min(math.radians(_VERTICAL_FOV) / 2.0, angle_of(slope * wide, 1.0)))[0]
    points = surface_points(scene)
    side = chosen_side(points.upright(up), upright(middle, up).tolist(), _MARGIN * radius / sine, slope)
    toward = _from_y_up(SIDES[side], up)
    toward = tuple(x / length(toward) for x in toward)  # type: ignore[assignment]
    corners = points.corners.reshape(-1, 3) if len(points.corners) else np.stack([low, high])
    distance = _MARGIN * max(radius / 2.0, _least_distance(corners - middle, toward, _UP[up], slope, wide))
    keys = {
        **({} if up == "y" else {"up": _UP[up]}),
        "position": tuple(float(x) for x in middle + distance * np.array(toward)),
        "target": tuple(float(x) for x in middle),
        "vertical_fov": _VERTICAL_FOV,
    }
    return keys, side


def _least_distance(points: NDArray[np.float64], toward: Vector, up: Vector, slope: float, wide: float) -> float:
    """The distance from the origin, in a direction, from which all points, (N, 3), are within the image."""
    right = cross(up, toward)
    size = length(right)
    right = (right[0] / size, right[1] / size, right[2] / size)
    x, y, z = points.T
    across, above, nearer = ((a[0] * x + a[1] * y) + a[2] * z for a in (right, cross(toward, right), toward))
    return float((nearer + np.maximum(np.abs(above) / slope, np.abs(across) / (slope * wide))).max())


def _from_y_up(vector: Vector, up: str) -> Vector:
    x, y, z = vector
    return vector if up == "y" else (x, -z, y)


def _exposed(scene: Scene) -> tuple[Scene, list[str]]:
    """The scene with an exposure of display images if its lights are much too dim or bright, and a note of that."""
    camera = scene.camera
    if camera.type != "perspective":
        return scene, []
    points = surface_points(scene)
    view = [a - b for a, b in zip(camera.target, camera.position, strict=True)]
    size = length(view)
    slope = tangent(math.radians(camera.vertical_fov) / 2.0)
    toward = (view[0] / size, view[1] / size, view[2] / size)
    stops = stops_needed(points, visible(points, camera.position, toward, camera.up, slope), scene.lights)
    if not stops:
        return scene, []
    kind = "dim" if stops > 0 else "bright"
    shutter = photographic_shutter(stops, _F_STOPS[kind])
    camera = camera.with_checked(f_stop=_F_STOPS[kind], shutter=shutter)
    return scene.with_checked(camera=camera), [_EXPOSED.format(kind, stops, _F_STOPS[kind], shutter)]
