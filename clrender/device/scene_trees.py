"""The BVHs of a scene: over what is opaque and what is masked, each followed by those of its groups.

From one image to the next, often only the camera, lights or the places of instances change. A group's BVH depends on
none of these, so a group that is the same in the next scene keeps its BVH, whose bits are those of a new one. The BVH
over the scene's own primitives is kept where these and the places of all instances are the same.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.device import bvh

if TYPE_CHECKING:
    from clrender.device.device import Buffer, Device
    from clrender.flatten.flat_scene import FlatScene
    from clrender.flatten.instances import FlatGroup

__all__ = ["SceneTrees", "masked_primitives"]

_SHARE: Final = 8
"""BVHs are kept for the next scene if they take at most one part in this many of the device's memory."""


@dataclass(frozen=True)
class _GroupTree:
    """The BVH of a group among those of a scene, and what it is over.

    Attributes
    ----------
    part : bvh.Part
    group : FlatGroup
    units : (U,) uint32
        Of the scene's, those that it is over.
    round_ones : (R,) uint32
        Likewise.
    """

    part: bvh.Part
    group: FlatGroup
    units: bvh.Numbers
    round_ones: bvh.Numbers

    @property
    def counts(self) -> tuple[int, int]:
        """Number of the group's primitives of either kind."""
        return self.group.triangle_count, self.group.analytic_count


@dataclass(frozen=True)
class _OwnTree:
    """The BVH over a scene's own primitives and its instances, without those of groups: attributes as above.

    Attributes
    ----------
    part : bvh.Part
    units, round_ones : (U,) and (R,) uint32
    places : bvh.InstanceBoxes
    """

    part: bvh.Part
    units: bvh.Numbers
    round_ones: bvh.Numbers
    places: bvh.InstanceBoxes


class SceneTrees:
    """The BVHs of a scene on a device.

    Parameters
    ----------
    device : Device
    source : bvh.SourceArrays
    units : (U,) uint32
        `bvh.triangle_units` of the source.
    scene : FlatScene
    instance_rows : Buffer
        Rows of the scene's instances; the roots of their groups' BVHs are written there.
    earlier : SceneTrees, optional
        Those of another scene, which the caller still owns: BVHs that are the same are copied from them.

    Attributes
    ----------
    opaque : bvh.Bvh
        BVH over all opaque primitives and instances.
    masked : bvh.Bvh or None
        BVH over all masked primitives and instances.

    Raises
    ------
    RenderError
        When there are too many primitives, or the device has no memory for them.
    """

    def __init__(
        self,
        device: Device,
        source: bvh.SourceArrays,
        units: bvh.Numbers,
        scene: FlatScene,
        instance_rows: Buffer,
        earlier: SceneTrees | None = None,
    ) -> None:
        self._device, self._scene = device, scene
        self._groups: defaultdict[tuple[str, tuple[int, int]], list[_GroupTree]] = defaultdict(list)
        self._own: dict[str, _OwnTree] = {}
        masked = masked_primitives(scene)
        rows = scene.instances.rows.copy()
        self.opaque = self._built(source, units, None if masked is None else ~masked, rows, "ROOT", earlier)
        self.masked: bvh.Bvh | None = None
        if masked is not None:
            self.masked = self._built(source, units, masked, rows, "MASKED_ROOT", earlier)
        if scene.instances.count:
            device.write(instance_rows, rows)

    def _built(
        self,
        source: bvh.SourceArrays,
        units: bvh.Numbers,
        among: NDArray[np.bool_] | None,
        rows: NDArray[np.float32],
        column: str,
        earlier: SceneTrees | None,
    ) -> bvh.Bvh:
        """Build the BVH over some primitives, and over the instances of groups that have any of them.

        The BVHs of groups are appended to it; the column of the instances' rows refers to these.
        """
        device, instances, triangles = self._device, self._scene.instances, source.triangle_count
        firsts = units & bvh.UNIT_NUMBER
        chosen = np.broadcast_to(True if among is None else among, triangles + source.analytic_count)

        def of(triangle: slice, analytic: slice) -> tuple[bvh.Numbers, bvh.Numbers]:
            """The chosen units of a range of triangles, and the chosen ones of a range of spheres and disks."""
            begin, end = np.searchsorted(firsts, [triangle.start, triangle.stop])
            some = units[begin:end]
            round_ones = np.arange(analytic.start, analytic.stop, dtype=np.uint32)
            return some[chosen[firsts[begin:end]]], round_ones[chosen[triangles:][analytic]]

        own = of(slice(0, instances.own_triangles), slice(0, instances.own_analytic))
        over = [of(group.triangles, group.analytic(triangles)) for group in instances.groups]
        filled = np.array([len(some) + len(others) > 0 for some, others in over], bool)
        numbers = np.flatnonzero(filled[instances.group_of]) if instances.count else np.zeros(0, np.intp)
        places = bvh.InstanceBoxes(numbers.astype(np.uint32), instances.boxes[numbers])
        first = None if earlier is None else earlier._kept_own(column, self._scene, *own, places)
        made, below = list[bvh.Bvh](), dict[int, tuple[bvh.Part, int, int]]()
        if first is None:
            made.append(bvh.build_over(device, source, *own, places))
            first = bvh.Part.of(made[0]), 0, 0
            if not len(numbers):
                self._own[column] = _OwnTree(first[0], own[0].copy(), own[1].copy(), places)
                return made[0]
        try:
            for group in np.flatnonzero(filled).tolist():
                poses, kept = instances.poses.get(group), None
                if earlier is not None and poses is None:
                    kept = earlier._kept(column, self._scene, instances.groups[group], *over[group])
                if kept is None:
                    triangle = (over[group][0] & bvh.UNIT_NUMBER) - np.uint32(instances.groups[group].first_triangle)
                    boxes = None if poses is None else poses.boxes[triangle]
                    made.append(bvh.build_over(device, source, *over[group], unit_boxes=boxes))
                    kept = bvh.Part.of(made[-1]), 0, 0
                below[group] = kept
            whole, parts = bvh.joined(device, [first, *below.values()])
            device.finish()
        finally:
            for each in made:
                each.release(device)
        self._own[column] = _OwnTree(parts[0], own[0].copy(), own[1].copy(), places)
        of_group = np.zeros(len(over), np.uint32)
        for group, part in zip(below, parts[1:], strict=True):
            of_group[group] = part.firsts[0]
            if group in instances.poses:
                continue
            made_over = _GroupTree(part, instances.groups[group], *(each.copy() for each in over[group]))
            self._groups[column, made_over.counts].append(made_over)
        if len(numbers):
            rows.view(np.uint32)[::2, layout.columns("INSTANCE")[column]] = of_group[instances.group_of]
        return whole

    def _kept_own(
        self, column: str, scene: FlatScene, units: bvh.Numbers, round_ones: bvh.Numbers, places: bvh.InstanceBoxes
    ) -> tuple[bvh.Part, int, int] | None:
        """The BVH over the same primitives and instances in another scene, and how much their numbers differ."""
        known = self._own.get(column)
        if known is None or not self._has_own(scene):
            return None
        same = _same(known.units, units, 0) and _same(known.round_ones, round_ones, 0)
        same = same and _same(known.places.numbers, places.numbers, 0) and _same_bytes(known.places.boxes, places.boxes)
        return (known.part, 0, scene.triangle_count - self._scene.triangle_count) if same else None

    def _has_own(self, scene: FlatScene) -> bool:
        """Whether the primitives outside of groups here are those of another scene."""
        old, new = self._scene.instances, scene.instances
        counts = [(each.own_triangles, each.own_analytic, each.own_vertices) for each in (old, new)]
        if counts[0] != counts[1] or not (counts[0][0] or counts[0][1]):
            return False
        names = ("triangles", "analytic_shapes", "vertices")
        here, there = self._scene.arrays, scene.arrays
        pairs = [(here[name][:count], there[name][:count]) for name, count in zip(names, counts[0], strict=True)]
        if self._scene.features.curves or scene.features.curves:
            pairs.append((here["curve_rows"], there["curve_rows"]))
        return all(_same_bytes(*pair) for pair in pairs)

    def _kept(
        self, column: str, scene: FlatScene, group: FlatGroup, units: bvh.Numbers, round_ones: bvh.Numbers
    ) -> tuple[bvh.Part, int, int] | None:
        """The BVH of a group that has the same primitives in another scene, and how much their numbers differ."""
        for known in self._groups.get((column, (group.triangle_count, group.analytic_count)), ()):
            triangles = group.first_triangle - known.group.first_triangle
            analytic = group.first_analytic - known.group.first_analytic
            first = analytic - (scene.triangle_count - self._scene.triangle_count)
            over = _same(known.units, units, triangles) and _same(known.round_ones, round_ones, first)
            if over and self._has(known.group, scene, group):
                return known.part, triangles, analytic
        return None

    def _has(self, own: FlatGroup, scene: FlatScene, group: FlatGroup) -> bool:
        """Whether a group here has the same primitives as one of another scene."""
        here, there = self._scene.arrays, scene.arrays
        old, new = here["triangles"][own.triangles], there["triangles"][group.triangles]
        if len(old) != len(new):
            return False
        if len(old):
            first, last, begin = int(old.min()), int(old.max()) + 1, int(new.min())
            points = here["vertices"][first:last], there["vertices"][begin : begin + last - first]
            if not (_same(old, new, begin - first) and _same_bytes(*points)):
                return False
        a, b = own.analytic(self._scene.triangle_count), group.analytic(scene.triangle_count)
        if not _same_bytes(here["analytic_shapes"][a], there["analytic_shapes"][b]):
            return False
        if not (here["analytic_shapes"]["normal"][a, 3] >= layout.ANALYTIC_SHAPE_CURVE).any():
            return True
        # Its leaves have the numbers of curves among all analytic shapes, which are not changed where they are copied
        return a.start == b.start and _same_bytes(here["curve_rows"][a], there["curve_rows"][b])

    def shares(self, scene: FlatScene) -> bool:
        """Whether another scene may go on with one of the BVHs, and there is memory to keep them for it."""
        if self._device.memory_limit is not None or self._device.info.memory_bytes < _SHARE * self.nbytes:
            return False
        if self._own and _same_bytes(self._scene.instances.boxes, scene.instances.boxes) and self._has_own(scene):
            return True
        return any(
            known.counts == (group.triangle_count, group.analytic_count) and self._has(known.group, scene, group)
            for group in scene.instances.groups
            for some in self._groups.values()
            for known in some
        )

    def forget(self) -> None:
        """Note that the BVHs have been changed, so that no other scene can go on with them."""
        self._groups.clear()
        self._own.clear()

    @property
    def each(self) -> tuple[bvh.Bvh, ...]:
        """The BVH over opaque primitives, and the one over masked primitives if there is one."""
        return (self.opaque,) if self.masked is None else (self.opaque, self.masked)

    @property
    def nbytes(self) -> int:
        """Size of all BVHs, bytes."""
        return sum(tree.nbytes for tree in self.each)

    def release(self) -> None:
        """Release the device memory."""
        for tree in self.each:
            tree.release(self._device)


def _same(old: NDArray[np.uint32], new: NDArray[np.uint32], change: int) -> bool:
    """Whether all numbers have changed by as much; flags are in the bits above."""
    return old.shape == new.shape and bool(np.array_equal(old + np.uint32(change & 0xFFFFFFFF), new))


def _same_bytes(old: NDArray[Any], new: NDArray[Any]) -> bool:
    if old.shape != new.shape or old.dtype != new.dtype:
        return False
    first, second = (np.ascontiguousarray(each).reshape(-1).view(np.uint8) for each in (old, new))
    return bool(np.array_equal(first, second))


def masked_primitives(scene: FlatScene) -> NDArray[np.bool_] | None:
    """Mask of the primitives that rays may pass through; None if there are none."""
    if not scene.features.opacity:
        return None
    count = scene.triangle_count + scene.analytic_count
    flags: NDArray[np.uint32] = scene.arrays["shapes"]["flags"][scene.arrays["primitive_shape"][:count]]
    return np.asarray((flags & layout.SHAPE_MASKED) != 0)
