"""Poses that are drawn: of cameras around a target, of objects, and of distractors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from clrender.datasets.spec import CameraTable, DistractorTable, ObjectTable
from clrender.datasets.values import drawn
from clrender.errors import SceneError
from clrender.exact.angles import sin_cos_degrees
from clrender.exact.counters import Draws
from clrender.scene import Camera, Scene
from clrender.scene.groups import Instance, ShapeOrInstance
from clrender.scene.shapes import Transform
from clrender.scene.transforms import Affine, affine, combined
from clrender.scene.values import Vector, cross, length
from clrender.wording import quoted, suggestion

__all__ = [
    "Drawer",
    "matrix_of",
    "named",
    "overruled",
    "placed_camera",
    "pose_of_table",
    "with_distractors",
    "with_objects",
]

_AXES: Final[Mapping[str, tuple[Vector, Vector, Vector]]] = {
    "x": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)),
    "y": ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "z": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
}
"""Two horizontal axes, from the first of which to the second azimuths count, and the upward one."""
_PARALLEL: Final = 1e-4
_TURNS: Final = {"x": 0, "y": 1, "z": 2}


class Drawer:
    """Draws for one image; each place has random numbers of its own, so that others can be added.

    Parameters
    ----------
    seed, index : int
        Of the data set, and of the image.

    Attributes
    ----------
    drawn : dict
        What was drawn, by place.
    """

    def __init__(self, seed: int, index: int) -> None:
        self._seed, self._index = seed, index
        self.drawn: dict[str, Any] = {}

    def draws(self, place: str) -> Draws:
        """Random numbers of a place."""
        return Draws(self._seed, place, self._index)

    def value(self, place: str, value: Any) -> Any:
        """A value with its distributions drawn."""
        found = drawn(value, self.draws, place)
        if found != value:
            self.drawn[place] = found
        return found

    def vector(self, place: str, value: Any) -> Vector:
        """A value that must be three numbers."""
        found = self.value(place, value)
        if not isinstance(found, list | tuple) or len(found) != 3 or not all(_is_number(each) for each in found):
            raise SceneError(f"{place} is {found!r:.60}, but must be three numbers")
        x, y, z = (float(each) for each in found)
        return (x, y, z)

    def number(self, place: str, value: Any) -> float:
        """A value that must be a number."""
        found = self.value(place, value)
        if not _is_number(found):
            raise SceneError(f"{place} is {found!r:.60}, but must be a number")
        return float(found)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def placed_camera(scene: Scene, table: CameraTable, up: str, drawer: Drawer) -> Camera:
    """The camera of a scene, placed. One that is placed does not move, whatever motion the scene's camera has.

    Parameters
    ----------
    scene : Scene
        With the camera that a file gave it, if there is one.
    table : CameraTable
    up : str
        The upward axis.
    drawer : Drawer
    """
    camera, right_up = scene.camera, camera_up(scene.camera)
    if table == CameraTable():
        return camera
    target = camera.target if table.target is None else drawer.vector("camera.target", table.target)
    position = camera.position
    if table.type in ("sphere", "hemisphere"):
        away = _direction(table, up, drawer)
        distance = drawer.number("camera.distance", table.distance)
        if not distance > 0.0:
            raise SceneError(f"camera.distance is {distance}, but must be above 0")
        position, right_up = _ahead(target, away, distance), _AXES[up][2]
    elif table.type == "box":
        position, right_up = drawer.vector("camera.position", table.position), _AXES[up][2]
    view: Vector = tuple(t - p for t, p in zip(target, position, strict=True))  # type: ignore[assignment]
    if length(view) == 0.0:
        raise SceneError("camera.position is where camera.target is; draw them from places apart")
    forward = _scaled(view, 1.0 / length(view))
    if length(cross(forward, right_up)) < _PARALLEL * length(right_up):  # straight up or down
        right_up = _AXES[up][0]
    roll = drawer.number("camera.roll_degrees", table.roll_degrees)
    right_up = _rolled(forward, right_up, roll)
    return camera.changed({"position": position, "target": target, "up": right_up, "motion": ()})


def overruled(camera: Camera, table: CameraTable) -> dict[str, str]:
    """Keys of a scene's camera that do not say where it is, since something else does, with what does.

    Parameters
    ----------
    camera : Camera
        Before it is placed.
    table : CameraTable
    """
    found = dict[str, str]()
    if table == CameraTable():
        for key in ("position", "target", "up") if camera.motion else ():
            if all(getattr(stop, key) is not None for stop in camera.motion):
                found[key] = "all keys of the camera's motion give it"
    else:
        found["motion"] = "a camera that the data set places does not move"
        if table.type in ("sphere", "hemisphere", "box"):
            found |= dict.fromkeys(("position", "up"), f"the data set's camera is of type {table.type}")
        if table.target is not None:
            found["target"] = "the data set's camera.target says it"
    if {"position", "target", "up"} <= found.keys():
        found |= dict.fromkeys(("camera_to_world", "world_to_camera"), found["position"])
    return found


def camera_up(camera: Camera) -> Vector:
    """The camera's key."""
    return camera.up


def _rolled(forward: Vector, up: Vector, degrees: float) -> Vector:
    """The up direction, turned about the view, clockwise as the camera sees it."""
    if degrees == 0.0:
        return up
    sine, cosine = sin_cos_degrees(degrees)
    right = cross(forward, up)
    right = _scaled(right, 1.0 / length(right))
    upward = cross(right, forward)
    return tuple(cosine * u + sine * r for u, r in zip(upward, right, strict=True))  # type: ignore[return-value]


def _direction(table: CameraTable, up: str, drawer: Drawer) -> Vector:
    """From the target to the camera, uniform over the part of the sphere between the angles."""
    draws = drawer.draws("camera.direction")
    low, high = (sin_cos_degrees(angle)[0] for angle in table.elevations)
    height = low + (high - low) * draws.unit()
    first, last = table.azimuth_degrees
    sine, cosine = sin_cos_degrees(first + (last - first) * draws.unit())
    level = math.sqrt(max(0.0, 1.0 - height * height))
    ahead, aside, upward = _AXES[up]
    found: Vector = tuple(
        (level * cosine * a + level * sine * b) + height * u for a, b, u in zip(ahead, aside, upward, strict=True)
    )  # type: ignore[assignment]
    drawer.drawn["camera.direction"] = list(found)
    return found


def _ahead(point: Vector, direction: Vector, distance: float) -> Vector:
    return tuple(p + distance * d for p, d in zip(point, direction, strict=True))  # type: ignore[return-value]


def _scaled(vector: Vector, factor: float) -> Vector:
    return (vector[0] * factor, vector[1] * factor, vector[2] * factor)


def pose_of_table(table: ObjectTable | DistractorTable, place: str, up: str, drawer: Drawer) -> Affine:
    """A pose: scaled and rotated about the pivot, which comes to the position; by default it stays where it is."""
    rows = _rotation(table, place, up, drawer)
    scale = drawer.value(f"{place}.scale", table.scale)
    factors = [scale] * 3 if _is_number(scale) else scale
    if not isinstance(factors, list | tuple) or len(factors) != 3 or not all(_is_number(f) and f != 0 for f in factors):
        raise SceneError(f"{place}.scale is {scale!r:.60}, but must be one number or three, and none of them 0")
    linear = tuple(tuple(each * float(f) for each, f in zip(row, factors, strict=True)) for row in rows)
    pivot = table.pivot
    position = pivot if table.position is None else drawer.vector(f"{place}.position", table.position)
    turned = Affine(linear, (0.0, 0.0, 0.0)).point(pivot)  # type: ignore[arg-type]
    return Affine(linear, tuple(p - t for p, t in zip(position, turned, strict=True)))  # type: ignore[arg-type]


def _rotation(
    table: ObjectTable | DistractorTable, place: str, up: str, drawer: Drawer
) -> tuple[Vector, Vector, Vector]:
    if table.rotation == "any":
        draws = drawer.draws(f"{place}.rotation")
        found = _quaternion_rows(draws.unit(), draws.unit(), draws.unit())
        drawer.drawn[f"{place}.rotation"] = [list(row) for row in found]
        return found
    angles = [0.0, 0.0, 0.0]
    angles[_TURNS[up]] = drawer.number(f"{place}.yaw_degrees", table.yaw_degrees)
    yaw = affine(Transform(rotate_degrees=tuple(angles)))
    if table.rotate_degrees is None:
        return yaw.linear
    inner = drawer.vector(f"{place}.rotate_degrees", table.rotate_degrees)
    return combined(yaw, affine(Transform(rotate_degrees=inner))).linear


def _quaternion_rows(a: float, b: float, c: float) -> tuple[Vector, Vector, Vector]:
    """A rotation, uniform over all (Shoemake, "Uniform random rotations", Graphics Gems III, 1992)."""
    (s1, c1), (s2, c2) = sin_cos_degrees(360.0 * b), sin_cos_degrees(360.0 * c)
    low, high = math.sqrt(1.0 - a), math.sqrt(a)
    x, y, z, w = low * s1, low * c1, high * s2, high * c2
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


def matrix_of(pose: Affine) -> list[list[float]]:
    """A map as four rows."""
    rows = [[*row, offset] for row, offset in zip(pose.linear, pose.offset, strict=True)]
    return [*rows, [0.0, 0.0, 0.0, 1.0]]


def named(shape: ShapeOrInstance, index: int) -> str:
    """The name of an entry of a scene's list, or its type and index, such as ``mesh_3``."""
    return f"{shape.type}_{index}" if shape.name is None else shape.name


def with_objects(
    shapes: Sequence[ShapeOrInstance], tables: Sequence[ObjectTable], up: str, drawer: Drawer, poses: dict[str, Affine]
) -> list[ShapeOrInstance]:
    """A scene's list of shapes with objects placed, and without those that are not in the image.

    Parameters
    ----------
    shapes : sequence of shapes
    tables : sequence of ObjectTable
    up : str
    drawer : Drawer
    poses : dict
        Receives the pose of each object by name.

    Raises
    ------
    SceneError
        There is no object of a name, or it is no instance of a group.
    """
    known = [named(shape, index) for index, shape in enumerate(shapes)]
    removed, placed = set[str](), dict[str, tuple[Affine, str | None]]()
    for table in tables:
        for name in table.name:
            if name not in known:
                text = f"objects: there is no shape of the name {quoted(name)}{suggestion(name, known)}"
                raise SceneError(text)
            place = f"objects.{name}"
            if drawer.draws(f"{place}.present").unit() >= table.present:
                removed.add(name)
                drawer.drawn[f"{place}.present"] = False
                continue
            group = None if table.group is None else drawer.value(f"{place}.group", table.group)
            placed[name] = pose_of_table(table, place, up, drawer), group
    result = []
    for name, shape in zip(known, shapes, strict=True):
        if name in removed:
            continue
        if name in placed:
            pose, group = placed[name]
            poses[name] = pose
            result.append(_moved(shape, pose, name, group))
        else:
            # Names stay, though indices change
            result.append(shape if shape.name is not None else shape.with_checked(name=name))
    return result


def _moved(shape: ShapeOrInstance, pose: Affine, name: str, group: str | None) -> ShapeOrInstance:
    """A shape or an instance in another place."""
    changes: dict[str, Any] = {"name": name}
    if group is not None:
        if not isinstance(shape, Instance):
            raise SceneError(f"objects: {quoted(name)} is no instance, so it has no group; leave group out")
        changes["group"] = group
    if isinstance(shape, Instance) and shape.transforms is not None:
        if isinstance(shape.transforms, str):
            text = "has its transforms in a file; write them into the scene to move it"
            raise SceneError(f"objects: {quoted(name)} {text}")
        changes["transforms"] = [
            matrix_of(combined(pose, affine(Transform(matrix=matrix)))) for matrix in shape.transforms
        ]
    else:
        changes["transform"] = {"matrix": matrix_of(combined(pose, affine(shape.transform)))}
    return shape.changed(changes)


def with_distractors(
    shapes: list[ShapeOrInstance], tables: Sequence[DistractorTable], up: str, drawer: Drawer, poses: dict[str, Affine]
) -> list[ShapeOrInstance]:
    """A scene's list of shapes with instances added; for the arguments see `with_objects`."""
    result = list(shapes)
    for number, table in enumerate(tables):
        count = drawer.number(f"distractors[{number}].count", table.count)
        if count != int(count) or not 0 <= count <= 100000:
            raise SceneError(f"distractors[{number}].count is {count:g}, but must be a whole number from 0 to 100000")
        for each in range(int(count)):
            name = f"distractor_{number}_{each}"
            place = f"distractors[{number}][{each}]"
            group = table.groups[drawer.draws(f"{place}.group").below(len(table.groups))]
            pose = pose_of_table(table, place, up, drawer)
            poses[name] = pose
            given: dict[str, Any] = {"type": "instance", "name": name, "group": group}
            given |= {"category": table.category} if table.category is not None else {}
            result.append(Instance(**given, transform={"matrix": matrix_of(pose)}))
            drawer.drawn[f"{place}.group"] = group
    return result
