"""Builds the BVH on the device: ordering, merging, collapsing.

The kernels are in ``kernels/geometry/build_*.cl``; this module launches them and allocates their buffers. The result is
bit-identical on every device, whatever the order of work-items. Another BVH over the same primitives would give the
same hits, except for rounding of their distances: no hit is nearer than the entry into its leaf's box.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from clrender.device.radix_sort import CHUNK, launch_each, scan, sort
from clrender.errors import RenderError
from clrender.wording import counted

if TYPE_CHECKING:
    from clrender.device.device import Argument, Buffer, Device

__all__ = [
    "ANALYTIC_BLOCK_WORDS",
    "BINARY_WORDS",
    "COST_ROOTS",
    "MERGE_CHUNK",
    "NODE_WORDS",
    "SOURCE_NAMES",
    "STACK",
    "TRIANGLE_BLOCK_WORDS",
    "UNIT_NUMBER",
    "UNIT_PAIR",
    "Bvh",
    "InstanceBoxes",
    "Numbers",
    "Part",
    "SourceArrays",
    "broken_pairs",
    "build",
    "build_over",
    "cost",
    "joined",
    "refit",
    "triangle_units",
    "unpaired",
]

# kernels/geometry/bvh.h and build.h; a test compares them.
NODE_WORDS: Final = 56
TRIANGLE_BLOCK_WORDS: Final = 128
ANALYTIC_BLOCK_WORDS: Final = 72
_TRIANGLE_ID: Final = 120
_ANALYTIC_ID: Final = 64
MERGE_CHUNK: Final = 64
COST_ROOTS: Final = 7
BINARY_WORDS: Final = 8
STACK: Final = 96
"""Default capacity of the traversal stack, in entries."""
_SORT_BITS: Final = 63
_FEW: Final = 1024
"""Most units whose clusters a single work-item of a CPU joins."""
_FEW_ELSEWHERE: Final = MERGE_CHUNK
"""The same of other devices, whose work-items are slow."""
# Most blocks of eight columns that a reference can address.
_MOST_BLOCKS: Final = 1 << 24
# Padding, as reading eight columns from the last column of a block's last row reads beyond the block.
_BEYOND: Final = 8
# Bits of a unit's entry that hold its type, beside its number.
_FLAGS: Final = np.uint32(5 << 29)

UNIT_PAIR: Final = np.uint32(1 << 31)
"""Bit of a unit's entry that tells that it is two triangles, ``BVH_PAIR``."""
UNIT_NUMBER: Final = ~_FLAGS
"""Mask of a unit's entry for the number of its first triangle."""

Numbers: TypeAlias = "npt.NDArray[np.uint32]"

_Arguments: TypeAlias = "list[Argument]"


SOURCE_NAMES: Final = ("vertices", "triangles", "analytic_shapes", "primitive_shape", "shapes", "curve_rows")
"""Arrays of a scene that the builder reads."""


@dataclass(frozen=True)
class SourceArrays:
    """The scene's arrays on the device, as the builder reads them."""

    vertices: Buffer
    triangles: Buffer
    analytic_shapes: Buffer
    primitive_shape: Buffer
    shapes: Buffer
    curve_rows: Buffer
    triangle_count: int
    analytic_count: int

    @classmethod
    def of(cls, arrays: Mapping[str, Buffer], triangle_count: int, analytic_count: int) -> SourceArrays:
        """Those among others, by the names of `SOURCE_NAMES`."""
        return cls(
            **{name: arrays[name] for name in SOURCE_NAMES},
            triangle_count=triangle_count,
            analytic_count=analytic_count,
        )


@dataclass(frozen=True)
class InstanceBoxes:
    """Instances that are leaves of a BVH.

    Attributes
    ----------
    numbers : (N,) uint32
        Indices of their rows in ``instance_rows``, halved.
    boxes : (N, 6) float32
        Minimum and maximum of each bounding box, enlarged by the rounding error of transforming a ray into the
        instance.
    """

    numbers: Numbers
    boxes: npt.NDArray[np.float32]


@dataclass(frozen=True)
class Bvh:
    """A finished BVH.

    Attributes
    ----------
    nodes, triangle_packs, analytic_packs : Buffer
        In the layout of ``kernels/geometry/bvh.h``; node 0 is the root.
    node_count, triangle_block_count, analytic_block_count : int
    levels : int
        Levels of nodes. They bound the traversal stack: seven entries per level.
    ranges : tuple of range
        The nodes of each level; children come after their parents, except roots of other trees.
    """

    nodes: Buffer
    triangle_packs: Buffer
    analytic_packs: Buffer
    node_count: int
    triangle_block_count: int
    analytic_block_count: int
    levels: int
    ranges: tuple[range, ...]

    @property
    def buffers(self) -> tuple[Buffer, Buffer, Buffer]:
        """Nodes, then packs."""
        return self.nodes, self.triangle_packs, self.analytic_packs

    @property
    def counts(self) -> tuple[int, int, int]:
        """Number of nodes, and of blocks of each kind of packs."""
        return self.node_count, self.triangle_block_count, self.analytic_block_count

    @property
    def nbytes(self) -> int:
        """Size of nodes and packs, bytes."""
        return sum(buffer.nbytes for buffer in self.buffers)

    def release(self, device: Device) -> None:
        """Release the device memory."""
        for buffer in self.buffers:
            device.release(buffer)

    @property
    def stack_entries(self) -> int:
        """Capacity that a traversal stack needs, in entries."""
        return 7 * self.levels + 1


def unpaired(units: Numbers, shapes: npt.NDArray[np.bool_]) -> Numbers:
    """Units in which the pairs of some shapes are two triangles.

    Parameters
    ----------
    units : (U,) uint32
        See `triangle_units`.
    shapes : (U,) bool
        Whether a unit is of one of these shapes.
    """
    split = shapes & ((units & UNIT_PAIR) != 0)
    alone = np.where(split, units & UNIT_NUMBER, units)
    whole: Numbers = np.insert(alone, np.flatnonzero(split) + 1, alone[split] + np.uint32(1))
    return whole


def broken_pairs(device: Device, source: SourceArrays, pairs: Numbers) -> npt.NDArray[np.bool_]:
    """Which of some pairs of triangles are no parallelograms any more, or no rectangles, or have become ones.

    Parameters
    ----------
    device : Device
    source : SourceArrays
    pairs : (P,) uint32
        Some units of `triangle_units`, of other vertices.

    Returns
    -------
    (P,) bool
    """
    if not len(pairs):
        return np.zeros(0, bool)
    given, found = device.upload(pairs), device.empty(4 * len(pairs))
    head: _Arguments = [source.vertices, source.triangles, source.primitive_shape, source.shapes]
    arguments = [*head, _u(source.triangle_count), given, _u(len(pairs)), found]
    launch_each(device, device.common_program(), "refit_units", len(pairs), arguments)
    now = np.empty_like(pairs)
    device.read(found, now)
    device.release(given)
    device.release(found)
    return np.asarray(now != pairs)


def build(device: Device, source: SourceArrays, among: npt.NDArray[np.bool_] | None = None) -> Bvh:
    """Build the BVH over a scene's triangles, spheres and disks.

    Parameters
    ----------
    device : Device
    source : SourceArrays
        The BVH may have at most 2**24 blocks of packs: about a hundred million triangles.
    among : (triangle_count + analytic_count,) bool, optional
        Primitives to include, all or none of each shape; they keep their numbers.

    Raises
    ------
    RenderError
        When there are too many primitives, or the device has no memory for them.
    """
    units = triangle_units(device, source)
    round_ones = np.arange(source.analytic_count, dtype=np.uint32)
    if among is not None:
        units = units[among[: source.triangle_count][units & UNIT_NUMBER]]
        round_ones = round_ones[among[source.triangle_count :]]
    return build_over(device, source, units, round_ones)


def triangle_units(device: Device, source: SourceArrays) -> Numbers:
    """The units of triangles in a BVH: one for each triangle, or for two that form a parallelogram.

    Returns
    -------
    (U,) uint32
        The number of each unit's first triangle, ascending, with flags of ``kernels/geometry/build.h`` in the high
        bits.
    """
    count = source.triangle_count
    if count == 0:
        return np.zeros(0, np.uint32)
    program = device.common_program()
    units, places = device.empty(4 * count), device.empty(4 * count)
    head: _Arguments = [source.vertices, source.triangles, source.primitive_shape, source.shapes, _u(count)]
    launch_each(device, program, "build_starts", count, [*head, places])
    total = scan(device, places, count)
    launch_each(device, program, "build_units", count, [*head, places, units])
    found = np.empty(total, np.uint32)
    device.read(units, found)
    device.release(units)
    device.release(places)
    return found


def build_over(
    device: Device,
    source: SourceArrays,
    units: Numbers,
    round_ones: Numbers,
    instances: InstanceBoxes | None = None,
    unit_boxes: npt.NDArray[np.float32] | None = None,
) -> Bvh:
    """Build a BVH over some of a scene's primitives, which keep their numbers, and over instances.

    Parameters
    ----------
    device : Device
    source : SourceArrays
    units : (U,) uint32
        A subset of the result of `triangle_units`.
    round_ones : (R,) uint32
        Spheres and disks, numbered from 0.
    instances : InstanceBoxes, optional
    unit_boxes : (U, 6) float32, optional
        Lowest and highest coordinates of all units, if they are not those of the arrays; there is nothing else then.

    Raises
    ------
    RenderError
        When there are too many primitives, or the device has no memory for them.
    """
    builder = _Builder(device, source, units, round_ones, instances, unit_boxes)
    if builder.unit_count == 0:
        return builder.empty()
    order, boxes = builder.order()
    return builder.collapse(order, builder.merge(order, boxes))


@dataclass(frozen=True)
class Part:
    """A BVH in the arrays of one or several.

    Attributes
    ----------
    buffers : (Buffer, Buffer, Buffer)
        Nodes, then packs.
    firsts : (int, int, int)
        Its first node, and its first block of each kind of packs.
    counts : (int, int, int)
        See `Bvh.counts`.
    levels : int
    ranges : tuple of range
        The nodes of each level, counted from its first one.
    """

    buffers: tuple[Buffer, Buffer, Buffer]
    firsts: tuple[int, int, int]
    counts: tuple[int, int, int]
    levels: int
    ranges: tuple[range, ...]

    @classmethod
    def of(cls, tree: Bvh) -> Part:
        """A whole BVH."""
        return cls(tree.buffers, (0, 0, 0), tree.counts, tree.levels, tree.ranges)


def joined(device: Device, trees: Sequence[tuple[Part, int, int]]) -> tuple[Bvh, list[Part]]:
    """Concatenate several BVHs in one set of arrays.

    Parameters
    ----------
    device : Device
    trees : sequence of (Part, int, int)
        Each with what is to be added to the numbers of its triangles, and to those of its spheres and disks. The first
        one has instances as leaves. Its levels and those of the deepest of the others add up.

    Returns
    -------
    tree : Bvh
        The first one, followed by the others.
    parts : list of Part
        Where each is in it.

    Raises
    ------
    RenderError
        When there are too many primitives, or the device has no memory for them.
    """
    totals = [sum(counts) for counts in zip(*(tree.counts for tree, _, _ in trees), strict=True)]
    if max(totals[1:]) > _MOST_BLOCKS:
        raise _too_many(f"{counted(len(trees), 'group')} of shapes", max(totals[1:]))
    program = device.common_program()
    words, numbers = (NODE_WORDS, TRIANGLE_BLOCK_WORDS, ANALYTIC_BLOCK_WORDS), (0, _TRIANGLE_ID, _ANALYTIC_ID)
    buffers = [
        device.empty(4 * (width * total + (_BEYOND if packs else 0)))
        for packs, (width, total) in enumerate(zip(words, totals, strict=True))
    ]
    nodes, triangles, others = buffers
    made, parts, ranges = (0, 0, 0), list[Part](), list[range]()
    for tree, of_triangles, of_round in trees:
        ranges += [range(made[0] + each.start, made[0] + each.stop) for each in tree.ranges]
        parts.append(replace(tree, buffers=(nodes, triangles, others), firsts=made))
        blocks: _Arguments = [_u(new - old) for new, old in zip(made[1:], tree.firsts[1:], strict=True)]
        head: _Arguments = [tree.buffers[0], _u(tree.firsts[0]), _u(tree.counts[0]), _u(made[0])]
        launch_each(device, program, "build_append", tree.counts[0], [*head, *blocks, nodes])
        for kind, of_others in ((1, of_triangles), (2, of_round)):
            rows, length = words[kind] // 8, tree.counts[kind] * words[kind] + _BEYOND
            head = [tree.buffers[kind], _u(tree.firsts[kind] * rows), _u(length), _u(made[kind] * rows)]
            changes: _Arguments = [_u(words[kind]), _u(numbers[kind]), _u(of_triangles), _u(of_others)]
            launch_each(device, program, "build_copy", length, [*head, *changes, buffers[kind]])
        made = (made[0] + tree.counts[0], made[1] + tree.counts[1], made[2] + tree.counts[2])
    levels = parts[0].levels + max((part.levels for part in parts[1:]), default=0)
    return Bvh(nodes, triangles, others, *made, levels, tuple(ranges)), parts


def refit(device: Device, source: SourceArrays, tree: Bvh, instance_boxes: npt.NDArray[np.float32]) -> None:
    """Make a BVH fit primitives and instances that have moved; its nodes keep their children, and its packs theirs.

    Parameters
    ----------
    device : Device
    source : SourceArrays
        `triangle_units` of these arrays are those that it was built over.
    tree : Bvh
        Its buffers are changed.
    instance_boxes : (N, 6) float32
        Boxes of all instances by their numbers; see `InstanceBoxes`.
    """
    boxes = device.upload(instance_boxes if len(instance_boxes) else np.zeros(6, np.float32))
    program = device.common_program()
    geometry: _Arguments = [_u(source.triangle_count), source.vertices, source.triangles, source.analytic_shapes]
    triangles, others = 8 * tree.triangle_block_count, 8 * tree.analytic_block_count
    triangle_boxes = device.empty(24 * max(triangles, 1))
    if triangles:
        arguments: _Arguments = [_u(triangles), source.vertices, source.triangles, tree.triangle_packs, triangle_boxes]
        launch_each(device, program, "refit_triangle_columns", triangles, arguments)
    if others:
        launch_each(
            device,
            program,
            "refit_analytic_columns",
            others,
            [_u(others), *geometry, source.curve_rows, tree.analytic_packs],
        )
    for level in reversed(tree.ranges):
        head: _Arguments = [_u(level.start), _u(len(level)), *geometry, boxes]
        arguments = [*head, triangle_boxes, tree.analytic_packs, tree.nodes]
        launch_each(device, program, "refit_nodes", len(level), arguments)
    device.finish()
    device.release(boxes)
    device.release(triangle_boxes)


def cost(device: Device, tree: Bvh) -> float:
    """Surface area cost of a BVH: the expected nodes and packs that a random ray through it visits.

    Returns
    -------
    float
        The sum of the areas of all children's boxes over that of the root; infinite if that has none.
    """
    buffer, costs = device.empty(4 * tree.node_count), np.empty(tree.node_count, np.float32)
    node = np.empty(NODE_WORDS, np.float32)
    arguments: _Arguments = [_u(tree.node_count), tree.nodes, buffer]
    launch_each(device, device.common_program(), "refit_costs", tree.node_count, arguments)
    device.read(buffer, costs)
    device.release(buffer)
    device.read(tree.nodes, node)
    low, high = node[:24].reshape(3, 8), node[24:48].reshape(3, 8)
    there = node[48:].view(np.uint32) != 0xFFFFFFFF
    if not there.any():
        return 0.0
    x, y, z = (high[:, there].max(axis=1) - low[:, there].min(axis=1)).astype(np.float64)
    area = x * y + y * z + z * x
    return float(costs.sum(dtype=np.float64)) / area if area > 0.0 else math.inf


def _too_many(what: str, blocks: int) -> RenderError:
    return RenderError(
        f"the tree over {what} takes {counted(blocks, 'block')} and holds {_MOST_BLOCKS} of them: split the scene"
    )


@dataclass(frozen=True)
class _BinaryTree:
    nodes: Buffer
    children: Buffer
    costs: Buffer
    leaves: int
    root: int

    @property
    def arguments(self) -> _Arguments:
        """Arguments for the kernels that collapse it."""
        return [self.nodes, self.children, self.costs, _u(self.leaves), _u(self.root)]


@dataclass(frozen=True)
class _Level:
    """The nodes of a level of the wide BVH.

    Attributes
    ----------
    tasks : Buffer
        The binary nodes that they replace.
    task_count : int
    counts : list of Buffer
        For each, the sums over those before it of its children that are nodes, and of its blocks of both kinds.
    totals : list of int
        These sums over all.
    """

    tasks: Buffer
    task_count: int
    counts: list[Buffer]
    totals: list[int]


class _Builder:
    """State of one build: its programs, and the buffers to release."""

    def __init__(
        self,
        device: Device,
        source: SourceArrays,
        units: Numbers,
        round_ones: Numbers,
        instances: InstanceBoxes | None,
        unit_boxes: npt.NDArray[np.float32] | None,
    ) -> None:
        self.device = device
        self._unit_boxes = unit_boxes
        self.source = source
        self._program = device.common_program()
        self._instance_count = 0 if instances is None else len(instances.numbers)
        none = InstanceBoxes(np.zeros(0, np.uint32), np.zeros((0, 6), np.float32))
        self._units, self._round = self._uploaded(units), self._uploaded(round_ones)
        self._instances = self._uploaded((instances or none).numbers)
        self._instance_boxes = self._uploaded((instances or none).boxes)
        self._triangle_units, self._round_count = len(units), len(round_ones)
        self.unit_count = self._triangle_units + self._round_count + self._instance_count

    def _uploaded(self, array: npt.NDArray[np.generic]) -> Buffer:
        """Upload an array; an empty one gives a buffer with a placeholder, as OpenCL has no empty buffers."""
        return self.device.upload(array if len(array) else np.zeros(1, np.uint32))

    def _release_units(self) -> None:
        self._release(self._units, self._round, self._instances, self._instance_boxes)

    def empty(self) -> Bvh:
        self._release_units()
        node = np.zeros(NODE_WORDS, np.float32)
        node[48:].view(np.uint32)[:] = 0xFFFFFFFF
        upload = self.device.upload
        packs = upload(np.zeros(_BEYOND, np.float32)), upload(np.zeros(_BEYOND, np.float32))
        return Bvh(upload(node), *packs, 1, 0, 0, 1, (range(1),))

    def order(self) -> tuple[Buffer, Buffer]:
        """Indices of the units in Morton order, and the boxes of the units in their original order."""
        source, count = self.source, self.unit_count
        boxes = self.device.empty(24 * count)
        self._each(
            "build_boxes",
            count,
            [
                self._units,
                source.vertices,
                source.triangles,
                source.analytic_shapes,
                self._round,
                self._instance_boxes,
                _u(self._triangle_units),
                _u(self._round_count),
                _u(count),
                boxes,
            ],
        )
        if self._unit_boxes is not None:
            self.device.write(boxes, np.ascontiguousarray(self._unit_boxes))
        bounds, length, centers = boxes, count, 1
        while length > 1 or centers:
            chunks = -(-length // CHUNK)
            reduced = self.device.empty(24 * chunks)
            self._each("build_bounds", chunks, [bounds, _u(length), _u(centers), reduced])
            if bounds is not boxes:
                self.device.release(bounds)
            bounds, length, centers = reduced, chunks, 0
        keys, values = self.device.empty(8 * count), self.device.empty(4 * count)
        self._each("build_morton", count, [boxes, bounds, _u(count), keys, values])
        self.device.release(bounds)
        keys, values = sort(self.device, keys, values, count, _SORT_BITS)
        self.device.release(keys)
        return values, boxes

    def merge(self, order: Buffer, boxes: Buffer) -> _BinaryTree:
        """Build the binary BVH over the ordered units; consumes `boxes`."""
        device, count = self.device, self.unit_count
        tree = device.empty(4 * BINARY_WORDS * 2 * count)
        costs, clusters = device.empty(4 * COST_ROOTS * count), device.empty(4 * count)
        arguments: _Arguments = [boxes, order, self._units, _u(self._triangle_units), _u(self._round_count), _u(count)]
        arguments += [tree, clusters]
        self._each("build_leaves", count, arguments)
        device.release(boxes)
        children, merged, nearest = device.empty(8 * count), device.empty(4 * count), device.empty(4 * count)
        if count <= (_FEW if device.is_cpu else _FEW_ELSEWHERE):
            self._each("build_merge_few", 1, [_u(count), clusters, merged, nearest, tree, children, costs])
            self._release(clusters, merged, nearest)
            return _BinaryTree(tree, children, costs, count, 2 * count - 2)
        length, next_node = count, count
        while length > 1:
            chunks = -(-length // CHUNK)
            kept, pairs = device.empty(4 * chunks), device.empty(4 * chunks)
            askers = -(-length // MERGE_CHUNK)
            self._each("build_nearest", askers, [tree, clusters, _u(length), nearest])
            self._each("build_merge_count", chunks, [nearest, _u(length), kept, pairs])
            joined = scan(self.device, pairs, chunks)
            scan(self.device, kept, chunks)
            arguments = [nearest, clusters, _u(length), kept, pairs]
            arguments += [_u(count), _u(next_node), tree, children, costs, merged]
            self._each("build_merge", chunks, arguments)
            self._release(kept, pairs)
            clusters, merged = merged, clusters
            length -= joined
            next_node += joined
        self._release(clusters, merged, nearest)
        return _BinaryTree(tree, children, costs, count, next_node - 1)

    def collapse(self, order: Buffer, tree: _BinaryTree) -> Bvh:
        """Collapse the binary BVH, which is consumed, to the wide BVH."""
        device = self.device
        levels = self._levels(tree)
        nodes = sum(level.task_count for level in levels)
        blocks = [sum(level.totals[kind] for level in levels) for kind in (1, 2)]
        if max(blocks) > _MOST_BLOCKS:
            self._release(order, tree.nodes, tree.children, tree.costs)
            for level in levels:
                self._release(level.tasks, *level.counts)
            self._release_units()
            raise _too_many(f"{counted(self.unit_count, 'triangle')} and spheres", max(blocks))
        node_buffer = device.empty(4 * NODE_WORDS * nodes)
        columns = [device.empty(4 * max(8 * count, 1)) for count in blocks]
        made, ranges = [0, 0, 0], list[range]()
        primitive_units = self._triangle_units + self._round_count
        for level in levels:
            arguments: _Arguments = [*tree.arguments, level.tasks, _u(level.task_count), *level.counts]
            arguments += [order, self._instances, _u(primitive_units)]
            arguments += [*(_u(number) for number in made), node_buffer, *columns]
            self._each("build_collapse", level.task_count, arguments)
            ranges.append(range(made[0], made[0] + level.task_count))
            made = [made[0] + level.task_count, made[1] + level.totals[1], made[2] + level.totals[2]]
            self._release(*level.counts, level.tasks)
        self._release(order, tree.nodes, tree.children, tree.costs)
        packs = self._fill(columns, blocks)
        self._release_units()
        self._release(*columns)
        return Bvh(node_buffer, *packs, nodes, blocks[0], blocks[1], len(levels), tuple(ranges))

    def _fill(self, columns: list[Buffer], blocks: list[int]) -> tuple[Buffer, Buffer]:
        """Build the packs, column by column, after the memory of the binary BVH is released."""
        source, words = self.source, (TRIANGLE_BLOCK_WORDS, ANALYTIC_BLOCK_WORDS)
        none = np.zeros(_BEYOND, np.float32)
        triangles, others = (
            self.device.empty(4 * (width * count + _BEYOND)) if count else self.device.upload(none)
            for width, count in zip(words, blocks, strict=True)
        )
        count = 8 * blocks[0]
        arguments: _Arguments = [columns[0], _u(count), self._units, source.vertices, source.triangles, triangles]
        if count:
            self._each("build_triangle_columns", count, arguments)
        count = 8 * blocks[1]
        arguments = [
            columns[1],
            _u(count),
            self._units,
            self._round,
            _u(self._triangle_units),
            _u(source.triangle_count),
        ]
        arguments += [source.vertices, source.triangles, source.analytic_shapes, source.curve_rows, others]
        if count:
            self._each("build_analytic_columns", count, arguments)
        return triangles, others

    def _levels(self, tree: _BinaryTree) -> list[_Level]:
        """The levels of the wide BVH from the root on, which tell how many nodes and blocks there will be."""
        device, levels = self.device, list[_Level]()
        tasks, task_count = device.upload(np.array([tree.root], np.uint32)), 1
        while task_count:
            counts = [device.empty(4 * task_count) for _ in range(3)]
            head: _Arguments = [*tree.arguments, tasks, _u(task_count)]
            self._each("build_collapse_count", task_count, [*head, *counts])
            levels.append(_Level(tasks, task_count, counts, [scan(device, each, task_count) for each in counts]))
            task_count = levels[-1].totals[0]
            if task_count:
                next_tasks = device.empty(4 * task_count)
                self._each("build_next_tasks", levels[-1].task_count, [*head, counts[0], next_tasks])
                tasks = next_tasks
        return levels

    def _each(self, kernel: str, count: int, arguments: _Arguments) -> None:
        launch_each(self.device, self._program, kernel, count, arguments)

    def _release(self, *buffers: Buffer) -> None:
        for buffer in buffers:
            self.device.release(buffer)


def _u(value: int) -> np.uint32:
    """An argument of a kernel, modulo 2^32."""
    return np.uint32(value & 0xFFFFFFFF)
