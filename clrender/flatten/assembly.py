"""Resolves a scene's instances: which shapes are duplicated per instance, and which are stored once and shared."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.flatten.emission import emits
from clrender.flatten.motion import NO_MOTION, Knots, knots_of, placed_knots
from clrender.flatten.ribbons import with_ribbons_as_meshes
from clrender.scene.description import Scene
from clrender.scene.groups import Instance, ShapeOrInstance
from clrender.scene.medium import Medium
from clrender.scene.motion import Track, rests
from clrender.scene.posed import Deformation, deformation_of
from clrender.scene.poses import Transform
from clrender.scene.resting import carried, opened, placements, resting
from clrender.scene.shapes import AnyShape, Curves, Mesh
from clrender.scene.transforms import Affine, affine, combined
from clrender.scene.values import SHAPE_LIMIT
from clrender.wording import counted, grouped, place, quoted

__all__ = ["Assembly", "assemble", "written_out"]

_MANY: Final = 64
"""Up to this many groups, each gets its own tree, however small it is."""
_CURE: Final = "scale all axes alike or use a mesh"
_PLACES: Final = 8
"""Most shapes, over all its instances, of a small group."""
_TRIANGLES: Final = 2**12
"""Most triangles, over all its instances, of a small group. Duplicating small groups is faster than building trees."""
_ONCE: Final = np.eye(4)[None, :3]
_Placed: TypeAlias = "tuple[tuple[str | int, ...], AnyShape]"


@dataclass(frozen=True)
class Assembly:
    """A scene with its instances resolved, and the placements of its groups.

    Attributes
    ----------
    scene : Scene
        Its shapes come in this order: the scene's own; the group shapes that emit light, duplicated per instance
        because each is a light of its own, or has a medium with a grid of its own, and those of small groups, if there
        are many groups; the other group shapes, in group space.
    own_shapes : int
        Number of shapes in world space, which come first.
    groups : tuple of range
        Range of the remaining shapes that makes up each placed group.
    group_of : (N,) int64
        Group of each instance.
    maps : (N, 3, 4) float64
        Map of each instance from group space to world space, metres.
    seen_place, seen_shape : (K,) int64
        The objects that an image can tell apart: each shape in world space, then each group shape once per entry of
        the original shape list that places its group. `seen_place` is the index in the original list (for duplicated
        shapes that of their instance), `seen_shape` the index in `scene`.
    seen_begin : (N,) int64
        Of each instance: the offset from the index of a group's shape in `scene` to its index in these two arrays.
    own_turns : (own_shapes,) int64
        Of each shape in world space: which transform of its entry in the original list placed it, from 0.
    placed : (N, 2) int64
        Of each instance: its entry in the original list, and which transform of the entry placed it.
    motion_of : (N,) int64
        Of each instance: which of `motions` follows its map while the shutter is open; -1: it rests.
    motions : tuple of Knots
    deformations : mapping of int to Deformation
        Of groups that are one mesh that changes its form.
    """

    scene: Scene
    own_shapes: int
    groups: tuple[range, ...]
    group_of: NDArray[np.int64]
    maps: NDArray[np.float64]
    seen_place: NDArray[np.int64]
    seen_shape: NDArray[np.int64]
    seen_begin: NDArray[np.int64]
    own_turns: NDArray[np.int64]
    placed: NDArray[np.int64]
    motion_of: NDArray[np.int64]
    motions: tuple[Knots, ...] = ()
    deformations: Mapping[int, Deformation] = field(default_factory=dict)

    @property
    def at_rest(self) -> Assembly:
        """The same without what moves."""
        if not self.motions:
            return self
        still = self.motion_of < 0
        return replace(
            self,
            group_of=self.group_of[still],
            maps=self.maps[still],
            seen_begin=self.seen_begin[still],
            placed=self.placed[still],
            motion_of=self.motion_of[still],
            motions=(),
            deformations={},
        )


def assemble(scene: Scene) -> Assembly:
    """Resolve a scene's instances, and make meshes of its ribbons.

    Raises
    ------
    SceneError
        If an instance stretches a sphere, disk or curve unevenly, a file of transforms cannot be read, or too many
        shapes that shine would have to be written out.
    """
    scene = with_ribbons_as_meshes(scene)
    given, scene = scene, resting(scene)
    own, own_places = _own(scene)
    none = np.zeros(0, np.int64)
    if len(own) == len(scene.shapes):
        all_own = np.arange(len(own))
        nowhere = np.zeros((0, 3, 4)), all_own, all_own, none, np.zeros_like(all_own), np.zeros((0, 2), np.int64)
        return Assembly(scene, len(own), (), none, *nowhere, none)
    written: list[_Placed] = []
    media: dict[str, Medium] = {}
    kept: list[_Placed] = []
    groups: dict[Hashable, tuple[int, range]] = {}
    placed: list[tuple[int, int, int, int, int]] = []  # entry, group, how often, motion, first transform
    maps: list[NDArray[np.float64]] = []
    turns = [np.zeros(len(own), np.int64)]
    motions: list[Knots] = []
    deformations: dict[int, Deformation] = {}
    small = _small_groups(scene)

    def place_group(
        entry: int, name: Hashable, shapes: list[_Placed], array: NDArray[np.float64], motion: int, turn: int = 0
    ) -> None:
        if name not in groups:
            begin = len(kept)
            kept.extend(shapes)
            groups[name] = len(groups), range(begin, len(kept))
        placed.append((entry, groups[name][0], len(array), motion, turn))
        maps.append(array)

    def deform(group: int, given: Scene, at: tuple[str | int, ...]) -> None:
        if group not in deformations:
            mesh = given.shapes[int(at[1])] if at[0] == "shapes" else given.groups[str(at[1])].shapes[int(at[3])]
            assert isinstance(mesh, Mesh)
            deformations[group] = deformation_of(given, at, mesh)

    for index, instance in enumerate(scene.shapes):
        if not isinstance(instance, Instance):
            if instance.motion or _is_posed(instance):
                motions.append(knots_of(Track(instance.motion), scene, index) if instance.motion else NO_MOTION)
                plain = instance.with_checked(motion=(), **({"poses": ()} if _is_posed(instance) else {}))
                shapes = _written([(scene.place_of(index), plain)], motions[-1].before)
                place_group(index, (index,), shapes, _ONCE, len(motions) - 1)
            if isinstance(instance, Mesh) and instance.poses:
                deform(placed[-1][1], given, given.place_of(index))
            continue
        array = placements(scene, index)
        shapes = _shapes_of(scene, instance.group)
        _check_similar(scene, index, instance.group, shapes, array)
        moves = bool(instance.motion) and rests(instance.motion, *scene.camera.interval) is None
        inside = [each for each in shapes if each[1].motion or _is_posed(each[1])]
        shapes = [each for each in shapes if not (each[1].motion or _is_posed(each[1]))]
        shining = [each for each in shapes if _is_apart(scene, each[1])]
        if inside:
            for at, shape in inside:
                _check_no_grid(scene, at, shape)
            _check_number(scene, index, len(kept) + len(inside) * len(array), len(array), len(inside))
            _check_keys_similar(scene, index, instance, inside)
        for at, shape in inside:
            plain = shape.with_checked(motion=(), **({"poses": ()} if _is_posed(shape) else {}))
            outer = Track(instance.motion) if moves else None
            if not shape.motion:  # all places have the same motion, if any
                motions.append(NO_MOTION if outer is None else knots_of(outer, scene, index))
                signed = motions[-1].before[0, 0, 0] * array
                place_group(index, (instance.group, at), [(at, plain)], signed, len(motions) - 1)
            else:
                for number, each in enumerate(array):
                    knots = placed_knots(Track(shape.motion), each, outer, scene, index)
                    motions.append(knots)
                    shared: Hashable = (index, number) if emits(scene, shape) else float(knots.before[0, 0, 0])
                    written_once = _written([(at, plain)], knots.before)
                    place_group(index, (instance.group, at, shared), written_once, _ONCE, len(motions) - 1, number)
            if _is_posed(shape):
                for _, group, *_ in placed[-len(array) if shape.motion else -1 :]:
                    deform(group, given, at)
        if not shapes:
            continue
        if moves:
            _check_no_grids(scene, index, instance.group, shapes)
            _check_keys_similar(scene, index, instance, shapes)
            motions.append(knots_of(Track(instance.motion), scene, index))
            array = motions[-1].before[0, 0, 0] * array
            _check_number(scene, index, len(kept) + len(shining) * len(array), len(array), len(shining))
            # Each place of what shines is a light of its own, with a row of its own
            for number, each in enumerate(array if shining else ()):
                place_group(index, (index, number), _written(shining, each[None]), _ONCE, len(motions) - 1, number)
            if len(shining) < len(shapes):
                dark = [each for each in shapes if not _is_apart(scene, each[1])]
                place_group(index, instance.group, dark, array, len(motions) - 1)
            continue
        alone = shapes if instance.group in small else shining
        _check_number(scene, index, len(own) + len(written) + len(alone) * len(array), len(array), len(alone))
        written += _written(alone, array, scene, index, media)
        own_places += [index] * (len(alone) * len(array))
        turns.append(np.repeat(np.arange(len(array)), len(alone)))
        if len(alone) < len(shapes):
            place_group(index, instance.group, [each for each in shapes if not _is_apart(scene, each[1])], array, -1)
    in_world = [*own, *written]
    ranges = tuple(range(len(in_world) + each.start, len(in_world) + each.stop) for _, each in groups.values())
    seen_place, seen_shape, begins = [np.array(own_places, np.int64)], [np.arange(len(in_world))], [none]
    total = len(in_world)
    for index, group, count, _, _ in placed:
        seen_place.append(np.full(len(ranges[group]), index))
        seen_shape.append(np.array(ranges[group]))
        begins.append(np.full(count, total - ranges[group].start))
        total += len(ranges[group])
    counts = np.array([count for _, _, count, _, _ in placed], np.int64)
    return Assembly(
        scene.assembled([*in_world, *kept], media),
        len(in_world),
        ranges,
        np.repeat(np.array([group for _, group, _, _, _ in placed], np.int64), counts),
        np.concatenate([np.zeros((0, 3, 4)), *maps]),
        np.concatenate(seen_place),
        np.concatenate(seen_shape),
        np.concatenate(begins),
        np.concatenate(turns),
        np.concatenate(
            [np.zeros((0, 2), np.int64), *(_numbered(entry, count, turn) for entry, _, count, _, turn in placed)],
            dtype=np.int64,
        ),
        np.repeat(np.array([motion for _, _, _, motion, _ in placed], np.int64), counts),
        tuple(motions),
        deformations,
    )


def _is_posed(shape: ShapeOrInstance) -> bool:
    """Whether it is a mesh that changes its form."""
    return isinstance(shape, Mesh) and bool(shape.poses)


def _numbered(entry: int, count: int, turn: int) -> NDArray[np.int64]:
    """(count, 2): an entry, and the numbers of its transforms from `turn` on."""
    return np.stack([np.full(count, entry), np.arange(turn, turn + count)], axis=1)


def _check_number(scene: Scene, index: int, total: int, places: int, shining: int) -> None:
    if total > SHAPE_LIMIT:
        text = (
            f"places {places} times a group of which "
            f"{counted(shining, 'shape shines or has', 'shapes shine or have')} a grid; "
            f"at most {grouped(SHAPE_LIMIT)} may"
        )
        raise SceneError(f"{scene.source}: shapes[{index}] {text}")


def _small_groups(scene: Scene) -> set[str]:
    """Groups too small for their own trees: building a tree takes as long as some thousand more triangles."""
    places: dict[str, int] = {}
    for index, instance in scene.instances():
        places[instance.group] = places.get(instance.group, 0) + len(placements(scene, index))
    if len(places) <= _MANY:
        return set()
    small: set[str] = set()
    for group, count in places.items():
        shapes = _shapes_of(scene, group)
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


def written_out(scene: Scene) -> Scene:
    """A copy of the scene in which each instance is replaced by the shapes of its group; nothing moves.

    Raises
    ------
    SceneError
        Like `assemble`, or if there would be too many shapes.
    """
    scene = opened(scene)
    shapes, _ = _own(scene)
    if len(shapes) == len(scene.shapes):
        return scene
    media: dict[str, Medium] = {}
    for index, instance in scene.instances():
        array, group = placements(scene, index), _shapes_of(scene, instance.group)
        _check_similar(scene, index, instance.group, group, array)
        if len(shapes) + len(group) * len(array) > SHAPE_LIMIT:
            text = f"places {len(array)} times a group of {counted(len(group), 'shape')} to be written out here"
            raise SceneError(f"{scene.source}: shapes[{index}] {text}; at most {grouped(SHAPE_LIMIT)} can be")
        shapes += _written(group, array, scene, index, media)
    return scene.assembled(shapes, media)


def _own(scene: Scene) -> tuple[list[_Placed], list[int]]:
    """Shapes of the scene that are not instances and do not move, and their indices in its list."""
    shapes = enumerate(scene.shapes)
    own = [
        (index, shape)
        for index, shape in shapes
        if not (isinstance(shape, Instance) or shape.motion or _is_posed(shape))
    ]
    return [(scene.place_of(index), shape) for index, shape in own], [index for index, _ in own]


def _shapes_of(scene: Scene, group: str) -> list[_Placed]:
    return [(("groups", group, "shapes", index), shape) for index, shape in enumerate(scene.groups[group].shapes)]


def _is_apart(scene: Scene, shape: AnyShape) -> bool:
    """Whether each place of a group needs a copy of its shape: a light of its own, or a grid that goes with it."""
    return emits(scene, shape) or _has_grid(scene, shape)


def _has_grid(scene: Scene, shape: AnyShape) -> bool:
    return shape.interior is not None and scene.media[shape.interior].density is not None


def _check_no_grid(scene: Scene, at: tuple[str | int, ...], shape: AnyShape) -> None:
    """Refuse a shape of a group that moves by itself, or changes its form, around a grid."""
    if _has_grid(scene, shape):
        where = f"{scene.source}: {place((*at, 'motion' if shape.motion else 'poses'))}"
        text = f"is of a shape with the medium {quoted(shape.interior or '')}, which has a grid"
        raise SceneError(f"{where} {text}; grids rest: let the shape rest, or fill it evenly")


def _check_no_grids(scene: Scene, index: int, group: str, shapes: Sequence[_Placed]) -> None:
    """Refuse grids in groups that move while the shutter is open."""
    for _, shape in shapes:
        if _has_grid(scene, shape):
            text = f"moves the group {quoted(group)}, in which the medium {quoted(shape.interior or '')} has a grid"
            raise SceneError(f"{scene.source}: shapes[{index}] {text}; grids rest: let it rest, or fill it evenly")


def _written(
    shapes: Sequence[_Placed],
    array: NDArray[np.float64],
    scene: Scene | None = None,
    index: int = 0,
    media: dict[str, Medium] | None = None,
) -> list[_Placed]:
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
    made: list[_Placed] = []
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


def _check_similar(scene: Scene, index: int, group: str, shapes: Sequence[_Placed], array: NDArray[np.float64]) -> None:
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
        raise SceneError(f"{scene.source}: {at} {text}; scale all axes alike or use a mesh")


def _check_keys_similar(scene: Scene, index: int, instance: Instance, shapes: Sequence[_Placed]) -> None:
    """Raise an error if a key of a motion would stretch a sphere, disk or curve unevenly."""
    if not any(shape.needs_similarity for _, shape in shapes):
        return
    for number, key in enumerate(instance.motion):
        if not key.is_similarity():
            text = f"stretches a sphere, disk or curve of the group {quoted(instance.group)} unevenly"
            at = place(("shapes", index, "motion", number))
            raise SceneError(f"{scene.source}: {at} {text}, which is not supported; {_CURE}")
