"""Shapes of groups and scenes, each with its place in the description: told apart, checked, and written out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.flatten.emission import emits
from clrender.scene.description import Scene
from clrender.scene.groups import Instance, ShapeOrInstance
from clrender.scene.medium import Medium
from clrender.scene.poses import Transform
from clrender.scene.resting import carried, placements
from clrender.scene.shapes import AnyShape, Curves, Mesh
from clrender.scene.transforms import Affine, affine, combined
from clrender.scene.values import SHAPE_LIMIT
from clrender.wording import place, quoted

__all__ = [
    "PlacedShape",
    "check_keys_similar",
    "check_similar",
    "is_apart",
    "is_posed",
    "own_shapes",
    "refuse_moving_grid",
    "refuse_moving_grids",
    "shapes_of",
    "small_groups",
    "still",
    "written",
]

_MANY: Final = 64
"""Up to this many groups, each gets its own tree, however small it is."""
_CURE: Final = "scale all axes alike or use a mesh"
_PLACES: Final = 8
"""Most shapes, over all its instances, of a small group."""
_TRIANGLES: Final = 2**12
"""Most triangles, over all its instances, of a small group. Duplicating small groups is faster than building trees."""
PlacedShape: TypeAlias = "tuple[tuple[str | int, ...], AnyShape]"
"""A shape, and where it is in the description."""


def own_shapes(scene: Scene) -> tuple[list[PlacedShape], list[int]]:
    """Shapes of the scene that are not instances and do not move, and their indices in its list."""
    shapes = enumerate(scene.shapes)
    own = [
        (index, shape)
        for index, shape in shapes
        if not (isinstance(shape, Instance) or shape.motion or is_posed(shape))
    ]
    return [(scene.place_of(index), shape) for index, shape in own], [index for index, _ in own]


def shapes_of(scene: Scene, group: str) -> list[PlacedShape]:
    """Shapes of a group."""
    return [(("groups", group, "shapes", index), shape) for index, shape in enumerate(scene.groups[group].shapes)]


def is_posed(shape: ShapeOrInstance) -> bool:
    """Whether it is a mesh that changes its form."""
    return isinstance(shape, Mesh) and bool(shape.poses)


def still(shape: AnyShape) -> AnyShape:
    """The shape without its motion, and in its own form."""
    return shape.with_checked(motion=(), **({"poses": ()} if is_posed(shape) else {}))


def is_apart(scene: Scene, shape: AnyShape) -> bool:
    """Whether each place of a group needs a copy of its shape: a light of its own, or a grid that goes with it."""
    return emits(scene, shape) or _has_grid(scene, shape)


def _has_grid(scene: Scene, shape: AnyShape) -> bool:
    return shape.interior is not None and scene.media[shape.interior].density is not None


def small_groups(scene: Scene) -> set[str]:
    """Groups too small for their own trees: building a tree takes as long as some thousand more triangles."""
    places: dict[str, int] = {}
    for index, instance in scene.instances():
        places[instance.group] = places.get(instance.group, 0) + len(placements(scene, index))
    if len(places) <= _MANY:
        return set()
    small: set[str] = set()
    for group, count in places.items():
        shapes = shapes_of(scene, group)
        if len(shapes) * count <= _PLACES and count * sum(_triangles(scene, *each) for each in shapes) <= _TRIANGLES:
            small.add(group)
        if len(small) * _PLACES > SHAPE_LIMIT // 2:
            break
    return small


def _triangles(scene: Scene, at: tuple[str | int, ...], shape: AnyShape) -> int:
    """Number of triangles of a mesh, or points of curves; 1 for other shapes, whose few triangles do not matter."""
    if isinstance(shape, Curves):
        return len(scene.strands(at, shape).points)
    if not isinstance(shape, Mesh):
        return 1
    return len(shape.faces) if shape.file is None else len(scene.mesh_of(at, shape).triangles)


def written(
    shapes: Sequence[PlacedShape],
    array: NDArray[np.float64],
    scene: Scene | None = None,
    index: int = 0,
    media: dict[str, Medium] | None = None,
) -> list[PlacedShape]:
    """The shapes, transformed by each of the maps.

    With `media`, grids of media are transformed, too: those of `shapes[index]` are added there.
    """
    if not shapes:
        return []
    outers = [
        Affine(((a, b, c), (e, f, g), (i, j, k)), (d, h, o))
        for (a, b, c, d), (e, f, g, h), (i, j, k, o) in array.tolist()
    ]
    if scene is None or media is None or not any(_has_grid(scene, shape) for _, shape in shapes):
        return [(at, carried(shape, outer)) for outer in outers for at, shape in shapes]
    made: list[PlacedShape] = []
    for number, outer in enumerate(outers):
        for at, shape in shapes:
            placed = carried(shape, outer)
            if _has_grid(scene, shape) and shape.interior is not None:
                name = f"{shape.interior[:100]} of shapes[{index}], {number}"
                media[name] = _with_moved_grids(scene.media[shape.interior], outer)
                placed = placed.with_checked(interior=name)
            made.append((at, placed))
    return made


def _with_moved_grids(medium: Medium, outer: Affine) -> Medium:
    assert medium.grids is not None
    moved = {}
    for key, grid in medium.grids.given():
        (a, b, c), (x, y, z) = (whole := combined(outer, affine(grid.transform))).linear, whole.offset
        matrix = ((*a, x), (*b, y), (*c, z), (0.0, 0.0, 0.0, 1.0))
        moved[key] = grid.with_checked(transform=Transform(matrix=matrix))
    return medium.with_checked(**moved)


def check_similar(
    scene: Scene, index: int, group: str, shapes: Sequence[PlacedShape], array: NDArray[np.float64]
) -> None:
    """Raise an error if a map would stretch a sphere, disk or curve unevenly."""
    if not any(shape.needs_similarity for _, shape in shapes):
        return
    x, y, z = array[:, :, 0], array[:, :, 1], array[:, :, 2]
    products = np.stack([(a * b).sum(axis=1) for a, b in ((x, x), (y, y), (z, z), (x, y), (x, z), (y, z))], axis=1)
    uneven = np.abs(products - products[:, :1] * np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])).max(axis=1)
    faulty = np.flatnonzero(uneven > 2e-6 * products[:, 0])
    if len(faulty):
        which: tuple[str | int, ...] = ("transform",) if len(array) == 1 else ("transforms", int(faulty[0]))
        at = place(("shapes", index, *which))
        text = f"stretches a sphere, disk or curve of the group {quoted(group)} unevenly, which is not supported"
        raise SceneError(f"{scene.source}: {at} {text}; {_CURE}")


def check_keys_similar(scene: Scene, index: int, instance: Instance, shapes: Sequence[PlacedShape]) -> None:
    """Raise an error if a key of a motion would stretch a sphere, disk or curve unevenly."""
    if not any(shape.needs_similarity for _, shape in shapes):
        return
    for number, key in enumerate(instance.motion):
        if not key.is_similarity():
            text = f"stretches a sphere, disk or curve of the group {quoted(instance.group)} unevenly"
            at = place(("shapes", index, "motion", number))
            raise SceneError(f"{scene.source}: {at} {text}, which is not supported; {_CURE}")


def refuse_moving_grid(scene: Scene, at: tuple[str | int, ...], shape: AnyShape) -> None:
    """Refuse a shape of a group that moves by itself, or changes its form, around a grid."""
    if _has_grid(scene, shape):
        where = f"{scene.source}: {place((*at, 'motion' if shape.motion else 'poses'))}"
        text = f"is of a shape with the medium {quoted(shape.interior or '')}, which has a grid"
        raise SceneError(f"{where} {text}; grids rest: let the shape rest, or fill it evenly")


def refuse_moving_grids(scene: Scene, index: int, group: str, shapes: Sequence[PlacedShape]) -> None:
    """Refuse grids in groups that move while the shutter is open."""
    for _, shape in shapes:
        if _has_grid(scene, shape):
            text = f"moves the group {quoted(group)}, in which the medium {quoted(shape.interior or '')} has a grid"
            raise SceneError(f"{scene.source}: shapes[{index}] {text}; grids rest: let it rest, or fill it evenly")
