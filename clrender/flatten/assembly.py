"""Resolves a scene's instances: which shapes are duplicated per instance, and which are stored once and shared."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.exact.matrices import product
from clrender.flatten.emission import emits
from clrender.flatten.motion import NO_MOTION, Knots, knots_of, placed_knots
from clrender.flatten.placed_shapes import (
    PlacedShape,
    check_keys_similar,
    check_similar,
    is_apart,
    is_posed,
    own_shapes,
    refuse_moving_grid,
    refuse_moving_grids,
    shapes_of,
    small_groups,
    still,
    written,
)
from clrender.flatten.ribbons import with_ribbons_as_meshes
from clrender.scene.description import Scene
from clrender.scene.groups import Instance
from clrender.scene.medium import Medium
from clrender.scene.motion import Track, rests
from clrender.scene.posed import Deformation, deformation_of
from clrender.scene.resting import opened, placements, resting
from clrender.scene.shapes import AnyShape, Mesh
from clrender.scene.values import SHAPE_LIMIT
from clrender.wording import counted, grouped

__all__ = ["Assembly", "assemble", "numbers_written_out", "written_out"]

_ONCE: Final = np.eye(4)[None, :3]


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
    def forms(self) -> dict[int, Deformation]:
        """Of meshes that change their form: how, by their index in `scene`."""
        return {self.groups[group].start: how for group, how in self.deformations.items()}

    @property
    def opened(self) -> Assembly:
        """The same with everything where it is when the shutter opens, at rest."""
        if not self.motions:
            return self
        maps = self.maps.copy()
        for instance in np.flatnonzero(self.motion_of >= 0).tolist():
            motion = self.motions[int(self.motion_of[instance])]
            for linear, offset in (
                (motion.before[0, :, :3], motion.before[0, :, 3]),
                (motion.linear[0], motion.offsets[0]),
            ):
                maps[instance] = product(linear, maps[instance])
                maps[instance, :, 3] += offset
        return replace(self, maps=maps, motion_of=np.full_like(self.motion_of, -1), motions=(), deformations={})


def assemble(scene: Scene) -> Assembly:
    """Resolve a scene's instances, and make meshes of its ribbons.

    Raises
    ------
    SceneError
        If an instance stretches a sphere, disk or curve unevenly, a file of transforms cannot be read, or too many
        shapes that shine would have to be written out.
    """
    assembler = _Assembler(with_ribbons_as_meshes(scene))
    assembler.place_all()
    return assembler.assembly()


@dataclass(frozen=True)
class _Place:
    """Instances of one group: one for each map.

    Attributes
    ----------
    entry : int
        Index in the original list of shapes.
    group : int
    maps : (n, 3, 4) float64
    motion : int
        Which of the motions follows the maps; -1: none.
    turn : int
        Which transform of the entry the first map is.
    """

    entry: int
    group: int
    maps: NDArray[np.float64]
    motion: int
    turn: int


class _Assembler:
    """Decides of each shape, or place of a group, whether it is written out or shared, and collects both.

    Parameters
    ----------
    scene : Scene
        Without ribbons.
    """

    def __init__(self, scene: Scene) -> None:
        self._given, self._scene = scene, resting(scene)
        self._own, self._places = own_shapes(self._scene)
        self._turns = [np.zeros(len(self._own), np.int64)]
        self._written: list[PlacedShape] = []
        self._media: dict[str, Medium] = {}
        self._kept: list[PlacedShape] = []
        self._groups: dict[Hashable, tuple[int, range]] = {}
        self._placed: list[_Place] = []
        self._motions: list[Knots] = []
        self._deformations: dict[int, Deformation] = {}
        self._plain = len(self._own) == len(self._scene.shapes)
        self._small = set[str]() if self._plain else small_groups(self._scene)

    def place_all(self) -> None:
        """Take the scene's shapes in their order."""
        if self._plain:
            return  # as in most scenes, there are no instances, and nothing moves
        for index, shape in enumerate(self._scene.shapes):
            if isinstance(shape, Instance):
                self._place_instance(index, shape)
            else:
                self._place_shape(index, shape)

    def _place_shape(self, index: int, shape: AnyShape) -> None:
        """A shape of the scene: what moves, or changes its form, becomes a group of its own."""
        if shape.motion or is_posed(shape):
            motion = self._moves(knots_of(Track(shape.motion), self._scene, index) if shape.motion else NO_MOTION)
            shapes = written([(self._scene.place_of(index), still(shape))], self._motions[-1].before)
            self._place(index, (index,), shapes, _ONCE, motion)
        if isinstance(shape, Mesh) and shape.poses:
            self._deform(self._placed[-1].group, self._given.place_of(index))

    def _place_instance(self, index: int, instance: Instance) -> None:
        """The places of a group."""
        scene = self._scene
        array = placements(scene, index)
        shapes = shapes_of(scene, instance.group)
        check_similar(scene, index, instance.group, shapes, array)
        outer = None
        if instance.motion and rests(instance.motion, *scene.camera.interval) is None:
            outer = Track(instance.motion)
        inside = [each for each in shapes if each[1].motion or is_posed(each[1])]
        if inside:
            for at, shape in inside:
                refuse_moving_grid(scene, at, shape)
            self._check_number(index, len(self._kept), array, inside)
            check_keys_similar(scene, index, instance, inside)
        for at, shape in inside:
            self._place_moving(index, instance, at, shape, array, outer)
        shapes = [each for each in shapes if not (each[1].motion or is_posed(each[1]))]
        if shapes and outer is not None:
            self._place_carried(index, instance, shapes, array)
        elif shapes:
            self._place_resting(index, instance.group, shapes, array)

    def _place_moving(
        self,
        index: int,
        instance: Instance,
        at: tuple[str | int, ...],
        shape: AnyShape,
        array: NDArray[np.float64],
        outer: Track | None,
    ) -> None:
        """A shape of a group that moves in it, or changes its form; the group may follow `outer`."""
        scene, before = self._scene, len(self._placed)
        if not shape.motion:  # all places have the same motion, if any
            motion = self._moves(NO_MOTION if outer is None else knots_of(outer, scene, index))
            signed = self._motions[-1].before[0, 0, 0] * array
            self._place(index, (instance.group, at), [(at, still(shape))], signed, motion)
        else:
            for number, each in enumerate(array):
                knots = placed_knots(Track(shape.motion), each, outer, scene, index)
                shared: Hashable = (index, number) if emits(scene, shape) else float(knots.before[0, 0, 0])
                shapes = written([(at, still(shape))], knots.before)
                self._place(index, (instance.group, at, shared), shapes, _ONCE, self._moves(knots), number)
        if is_posed(shape):
            for each in self._placed[before:]:
                self._deform(each.group, at)

    def _place_carried(
        self, index: int, instance: Instance, shapes: list[PlacedShape], array: NDArray[np.float64]
    ) -> None:
        """The shapes of a group whose places move as one."""
        scene = self._scene
        refuse_moving_grids(scene, index, instance.group, shapes)
        check_keys_similar(scene, index, instance, shapes)
        shining, dark = self._split(shapes)
        motion = self._moves(knots_of(Track(instance.motion), scene, index))
        array = self._motions[-1].before[0, 0, 0] * array
        self._check_number(index, len(self._kept), array, shining)
        # Each place of what shines is a light of its own, with a row of its own
        for number, each in enumerate(array if shining else ()):
            self._place(index, (index, number), written(shining, each[None]), _ONCE, motion, number)
        if dark:
            self._place(index, instance.group, dark, array, motion)

    def _place_resting(self, index: int, group: str, shapes: list[PlacedShape], array: NDArray[np.float64]) -> None:
        """The shapes of a group whose places rest; those of small groups are written out."""
        apart, shared = self._split(shapes)
        if group in self._small:
            apart = shapes
        self._check_number(index, len(self._own) + len(self._written), array, apart)
        self._written += written(apart, array, self._scene, index, self._media)
        self._places += [index] * (len(apart) * len(array))
        self._turns.append(np.repeat(np.arange(len(array)), len(apart)))
        if len(apart) < len(shapes):
            self._place(index, group, shared, array, -1)

    def _split(self, shapes: Sequence[PlacedShape]) -> tuple[list[PlacedShape], list[PlacedShape]]:
        """Shapes of which each place needs a copy, and others."""
        apart = [is_apart(self._scene, shape) for _, shape in shapes]
        return (
            [each for each, alone in zip(shapes, apart, strict=True) if alone],
            [each for each, alone in zip(shapes, apart, strict=True) if not alone],
        )

    def _moves(self, knots: Knots) -> int:
        """The number of a motion, which is added."""
        self._motions.append(knots)
        return len(self._motions) - 1

    def _place(
        self,
        entry: int,
        name: Hashable,
        shapes: list[PlacedShape],
        maps: NDArray[np.float64],
        motion: int,
        turn: int = 0,
    ) -> None:
        """Place a group, which is added if there is none of this name."""
        if name not in self._groups:
            begin = len(self._kept)
            self._kept.extend(shapes)
            self._groups[name] = len(self._groups), range(begin, len(self._kept))
        self._placed.append(_Place(entry, self._groups[name][0], maps, motion, turn))

    def _deform(self, group: int, at: tuple[str | int, ...]) -> None:
        """Note that a group is a mesh that changes its form."""
        if group not in self._deformations:
            given = self._given
            mesh = given.shapes[int(at[1])] if at[0] == "shapes" else given.groups[str(at[1])].shapes[int(at[3])]
            assert isinstance(mesh, Mesh)
            self._deformations[group] = deformation_of(given, at, mesh)

    def _check_number(self, index: int, before: int, array: NDArray[np.float64], alone: Sequence[PlacedShape]) -> None:
        """Refuse more copies of shapes than a scene may have."""
        if before + len(alone) * len(array) > SHAPE_LIMIT:
            text = (
                f"places {len(array)} times a group of which "
                f"{counted(len(alone), 'shape shines or has', 'shapes shine or have')} a grid; "
                f"at most {grouped(SHAPE_LIMIT)} may"
            )
            raise SceneError(f"{self._scene.source}: shapes[{index}] {text}")

    def assembly(self) -> Assembly:
        """What was placed."""
        in_world, placed = [*self._own, *self._written], self._placed
        world = len(in_world)
        ranges = tuple(range(world + each.start, world + each.stop) for _, each in self._groups.values())
        none = np.zeros(0, np.int64)
        seen_place, seen_shape, begins = [np.array(self._places, np.int64)], [np.arange(world)], [none]
        total = world
        for each in placed:
            members = ranges[each.group]
            seen_place.append(np.full(len(members), each.entry))
            seen_shape.append(np.array(members))
            begins.append(np.full(len(each.maps), total - members.start))
            total += len(members)
        counts = np.array([len(each.maps) for each in placed], np.int64)
        numbered = [_numbered(each.entry, len(each.maps), each.turn) for each in placed]
        return Assembly(
            self._scene if self._plain else self._scene.assembled([*in_world, *self._kept], self._media),
            world,
            ranges,
            np.repeat(np.array([each.group for each in placed], np.int64), counts),
            np.concatenate([np.zeros((0, 3, 4)), *(each.maps for each in placed)]),
            np.concatenate(seen_place),
            np.concatenate(seen_shape),
            np.concatenate(begins),
            np.concatenate(self._turns),
            np.concatenate([np.zeros((0, 2), np.int64), *numbered], dtype=np.int64),
            np.repeat(np.array([each.motion for each in placed], np.int64), counts),
            tuple(self._motions),
            self._deformations,
        )


def _numbered(entry: int, count: int, turn: int) -> NDArray[np.int64]:
    """(count, 2): an entry, and the numbers of its transforms from `turn` on."""
    return np.stack([np.full(count, entry), np.arange(turn, turn + count)], axis=1)


def written_out(scene: Scene) -> Scene:
    """A copy of the scene in which each instance is replaced by the shapes of its group; nothing moves.

    Raises
    ------
    SceneError
        Like `assemble`, or if there would be too many shapes.
    """
    scene = opened(scene)
    shapes, _ = own_shapes(scene)
    if len(shapes) == len(scene.shapes):
        return scene
    media: dict[str, Medium] = {}
    for index, instance in scene.instances():
        array, group = placements(scene, index), shapes_of(scene, instance.group)
        check_similar(scene, index, instance.group, group, array)
        if len(shapes) + len(group) * len(array) > SHAPE_LIMIT:
            text = f"places {len(array)} times a group of {counted(len(group), 'shape')} to be written out here"
            raise SceneError(f"{scene.source}: shapes[{index}] {text}; at most {grouped(SHAPE_LIMIT)} can be")
        shapes += written(group, array, scene, index, media)
    return scene.assembled(shapes, media)


def numbers_written_out(scene: Scene, index: int) -> range:
    """Indices in `written_out` of what `shapes[index]` becomes: one shape, or of an instance those of its group."""
    scene = opened(scene)
    counts = {
        instance: len(shapes_of(scene, placed.group)) * len(placements(scene, instance))
        for instance, placed in scene.instances()
    }
    if index in counts:
        first = len(scene.shapes) - len(counts) + sum(count for each, count in counts.items() if each < index)
        return range(first, first + counts[index])
    first = index - sum(each < index for each in counts)
    return range(first, first + 1)
