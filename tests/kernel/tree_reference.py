"""The tree as it lies in a device's memory, checked word by word, and other trees to compare its cost with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from kernel_support import Tree

from clrender import layout
from clrender.device.bvh import ANALYTIC_BLOCK_WORDS, NODE_WORDS, TRIANGLE_BLOCK_WORDS

if TYPE_CHECKING:
    from clrender.flatten.flat_scene import FlatScene

__all__ = ["Words", "bounds_of", "check", "cost", "download", "median_cost", "stack_needed", "sweep_cost"]

# kernels/geometry/bvh.h
EMPTY, LEAF, ANALYTIC, COUNT, INDEX = 0xFFFFFFFF, 0x80000000, 0x40000000, 27, 0x07FFFFFF
PAIR, NUMBER = np.uint32(0x80000000), np.uint32(0x40000000)
DISK, RECTANGLE = 1, 2

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Words:
    """A tree's memory.

    Attributes
    ----------
    nodes : (n, 56) float32
    triangle_packs : (8 t, 16) float32
        A row each for the columns of all blocks.
    analytic_packs : (8 r, 9) float32
    """

    nodes: npt.NDArray[np.float32]
    triangle_packs: npt.NDArray[np.float32]
    analytic_packs: npt.NDArray[np.float32]

    @property
    def references(self) -> npt.NDArray[np.uint32]:
        return np.ascontiguousarray(self.nodes[:, 48:]).view(np.uint32)

    def packs(self, leaves: npt.NDArray[np.bool_], analytic: bool) -> npt.NDArray[np.uint32]:
        """(leaves, 8) uint32: primitives of the packs that these references lead to, PAIR left in; NONE fills up."""
        references = self.references[leaves]
        assert (((references & ANALYTIC) != 0) == analytic).all()
        columns = (references & INDEX).astype(np.int64)[:, None] + np.arange(8)
        size = (references >> COUNT & 7) + 1
        assert (columns[:, 0] % 8 + size <= 8).all(), "a pack is in one block"
        there = np.arange(8) < size[:, None]
        rows = self.analytic_packs if analytic else self.triangle_packs
        ids = np.ascontiguousarray(rows[:, -1]).view(np.uint32)
        taken = np.bincount(columns[there], minlength=len(rows))
        assert (taken <= 1).all(), "no two packs share a column"
        assert (rows[taken == 0] == 0).all(), "other columns hold zeros"
        assert ((ids[taken == 1] & NUMBER) != 0).all(), "numbers are normal as floats"
        return np.where(there, ids[np.where(there, columns, 0)] & ~NUMBER, layout.NONE)

    @property
    def low(self) -> Floats:
        return self.nodes[:, :24].reshape(-1, 3, 8).transpose(0, 2, 1).astype(np.float64)

    @property
    def high(self) -> Floats:
        return self.nodes[:, 24:48].reshape(-1, 3, 8).transpose(0, 2, 1).astype(np.float64)


def download(tree: Tree) -> Words:
    """Read a tree back."""
    counts = (tree.bvh.node_count, tree.bvh.triangle_block_count, tree.bvh.analytic_block_count)
    arrays = []
    for buffer, count, words in zip(
        tree.buffers, counts, (NODE_WORDS, TRIANGLE_BLOCK_WORDS, ANALYTIC_BLOCK_WORDS), strict=True
    ):
        array = np.empty((count, words), np.float32)
        tree.device.read(buffer, array)
        arrays.append(array)
    nodes, *blocks = arrays
    columns = [each.reshape(len(each), each.shape[1] // 8, 8).transpose(0, 2, 1) for each in blocks]
    return Words(nodes, *(each.reshape(8 * len(each), each.shape[2]) for each in columns))


def bounds_of(scene: FlatScene) -> tuple[Floats, Floats]:
    """Smallest boxes of all primitives, in double precision."""
    corners = scene.arrays["vertices"][scene.arrays["triangles"][: scene.triangle_count]].astype(np.float64)
    analytic_shapes = scene.arrays["analytic_shapes"][: scene.analytic_count]
    center, radius = (
        analytic_shapes["center_radius"][:, :3].astype(np.float64),
        analytic_shapes["center_radius"][:, 3:].astype(np.float64),
    )
    normal = analytic_shapes["normal"][:, :3].astype(np.float64)
    disk = (normal != 0).any(1, keepdims=True)
    squares = (normal**2).sum(1, keepdims=True)
    extent = radius * np.where(disk, np.sqrt(np.maximum(squares - normal**2, 0) / np.where(disk, squares, 1)), 1.0)
    low = np.concatenate([corners.min(1), center - extent])
    return low, np.concatenate([corners.max(1), center + extent])


def check(words: Words, scene: FlatScene) -> None:
    """Raise AssertionError unless the words are a tree over the scene.

    Every primitive is in one leaf, with its own numbers, every node and pack has one parent, a node's box is the union
    of its children's, and a leaf's holds its primitives with room for roundings but little more.
    """
    references = words.references
    used = references != EMPTY
    assert (np.diff(used.astype(int), axis=1) <= 0).all(), "children fill the front"
    leaf = used & ((references & LEAF) != 0)
    analytic_leaf = leaf & ((references & ANALYTIC) != 0)
    inner = references[used & ~leaf]
    assert np.array_equal(np.sort(inner), np.arange(1, len(words.nodes))), "every node but the root has one parent"

    parent, slot = np.nonzero(used & ~leaf)
    low, high = words.low, words.high
    below = references[parent, slot]
    # Slots that are not used hold a box that no union feels.
    assert np.array_equal(low[parent, slot], low[below].min(1)), "a box is the union of those in it"
    assert np.array_equal(high[parent, slot], high[below].max(1)), "a box is the union of those in it"

    packs = words.packs(leaf & ~analytic_leaf, False), words.packs(analytic_leaf, True)
    pairs = [(pack != layout.NONE) & ((pack & PAIR) != 0) for pack in packs]
    firsts = [np.where(pair, pack & ~PAIR, pack) for pack, pair in zip(packs, pairs, strict=True)]
    both = [
        np.concatenate([first, np.where(pair, first + np.uint32(1), layout.NONE)], axis=1)
        for first, pair in zip(firsts, pairs, strict=True)
    ]
    ids = np.concatenate([pack[pack != layout.NONE] for pack in both])
    assert np.array_equal(np.sort(ids), np.arange(scene.triangle_count + scene.analytic_count)), "each is in one leaf"
    assert (firsts[0][firsts[0] != layout.NONE] < scene.triangle_count).all()
    rectangle = firsts[1] < scene.triangle_count
    assert np.array_equal(rectangle, pairs[1]), "of triangles only pairs are no triangles"
    _check_numbers(words, scene)
    _check_analytic(words, scene)
    exact_low, exact_high = bounds_of(scene)
    for pack_ids, leaves in ((both[0], leaf & ~analytic_leaf), (both[1], analytic_leaf)):
        parent, slot = np.nonzero(leaves)
        safe = np.where(pack_ids == layout.NONE, pack_ids[:, :1], pack_ids)
        inner_low, inner_high = exact_low[safe].min(1), exact_high[safe].max(1)
        box_low, box_high = low[parent, slot], high[parent, slot]
        assert (box_low <= inner_low).all(), "a leaf's box holds what is in it"
        assert (box_high >= inner_high).all(), "a leaf's box holds what is in it"
        size = (inner_high - inner_low).max(1, keepdims=True)
        room = 2e-6 * size + 4e-7 * np.maximum(np.abs(inner_low), np.abs(inner_high))
        assert (inner_low - box_low <= room).all(), "and little more"
        assert (box_high - inner_high <= room).all(), "and little more"


def _check_numbers(words: Words, scene: FlatScene) -> None:
    stored = words.triangle_packs[words.triangle_packs[:, 15] != 0]
    numbers = np.ascontiguousarray(stored[:, 15]).view(np.uint32)
    pair = (numbers & PAIR) != 0
    number = (numbers & ~(PAIR | NUMBER)).astype(np.int64)
    a, b, c = scene.arrays["vertices"][scene.arrays["triangles"][number]].transpose(1, 0, 2)
    again_a, again_c, d = scene.arrays["vertices"][scene.arrays["triangles"][number + pair]].transpose(1, 0, 2)
    assert np.array_equal(again_a[pair], a[pair]) and np.array_equal(again_c[pair], c[pair]), "pairs share A and C"
    gap = np.abs((b.astype(np.float64) - a) - (c.astype(np.float64) - d)).sum(1)
    largest = np.abs(np.stack([a, b, c, d])).max((0, 2))
    assert (gap <= 8 * 2**-24 * largest)[pair].all(), "pairs are parallelograms"
    sides = np.abs(np.stack([b - a, c - b, a - c])).max(2)
    turned = ~pair & (sides[1] * 4 < np.maximum(sides[0], sides[2]))  # where BC is much the shortest
    a, b, c = (np.where(turned[:, None], *two) for two in ((b, a), (c, b), (a, np.where(pair[:, None], d, c))))
    assert np.array_equal(stored[:, 14] < 0, pair & (np.abs(stored[:, 14]) > 0)), "packs tell pairs from triangles"
    assert np.array_equal(stored[:, :3].view(np.uint32), a.view(np.uint32)), "packs hold A to the bit"
    for edge, exact in ((stored[:, 3:6], b.astype(np.float64) - a), (stored[:, 6:9], a.astype(np.float64) - c)):
        assert np.array_equal(edge, exact.astype(np.float32)), "packs hold the edges, rounded once"
    edges = stored[:, 3:9].astype(np.float64).reshape(-1, 2, 3)
    normal = np.cross(edges[:, 1], edges[:, 0])
    assert (np.abs(stored[:, 9:12] - normal) <= 2**-23 * np.abs(normal) + 1e-38).all(), "packs hold the normal"
    sizes = np.abs(edges).max(2)
    assert np.array_equal(np.abs(stored[:, [12, 14]]), sizes), "packs hold the largest components of the edges"
    # Twice the error of the determinant of such a normal, over 5 roundings: see reference.triangles.
    exactly = np.cross(b.astype(np.float64) - a, c.astype(np.float64) - a)
    wrong = (np.abs(normal - exactly) + 2**-23 * np.abs(normal)).sum(1) + 3 * 2**-24 * np.abs(normal).sum(1)
    wrong += np.where(pair, gap * sizes.max(1), 0.0)
    assert (stored[:, 13] * 5 * 2**-24 >= 2 * wrong - 1e-37).all(), "packs bound the normal's error"


def _check_analytic(words: Words, scene: FlatScene) -> None:
    stored = words.analytic_packs[words.analytic_packs[:, 8] != 0]
    kinds, numbers = (np.ascontiguousarray(stored[:, k]).view(np.uint32) & ~NUMBER for k in (7, 8))
    round_ = kinds < RECTANGLE
    rows = scene.arrays["analytic_shapes"][numbers[round_] - scene.triangle_count]
    wanted = np.concatenate([rows["center_radius"], rows["normal"][:, :3]], axis=1)
    assert np.array_equal(stored[round_, :7], wanted), "packs hold the spheres and disks to the bit"
    assert np.array_equal(kinds[round_] == DISK, (wanted[:, 4:] != 0).any(1)), "and tell which is which"
    for row, kind, number in zip(stored[~round_], kinds[~round_], numbers[~round_] & ~PAIR, strict=True):
        axis = int(kind) - RECTANGLE
        u, v = (axis + 1) % 3, (axis + 2) % 3
        corners = scene.arrays["vertices"][scene.arrays["triangles"][[number, number + 1]]]
        assert np.ptp(corners[:, :, axis]) == 0, "a rectangle is square to its axis"
        assert len(np.unique(corners[0][:, [u, v]])) <= 4
        assert all(len(np.unique(corners[:, :, k])) == 2 for k in (u, v)), "with sides along the others"
        middle = corners.min((0, 1)).astype(np.float64) / 2 + corners.max((0, 1)).astype(np.float64) / 2
        half = np.ptp(corners.astype(np.float64), axis=(0, 1)) / 2
        assert (np.abs(row[:3] - middle) <= 2**-23 * np.abs(middle)).all(), "packs hold its centre"
        for k, stored_half in ((u, row[3]), (v, row[4])):
            reach = abs(row[k] - middle[k]) + half[k]
            assert reach <= stored_half <= reach * (1 + 2**-19), "and half its sides, with a few roundings to spare"
        # Middles of both triangles: on the side of the diagonal that is theirs.
        place = corners.astype(np.float64).mean(1) - middle
        side = place[:, u] * row[5] + place[:, v] * row[6]
        assert side[0] < 0 < side[1], "and which triangle is where"


def stack_needed(words: Words) -> tuple[int, int]:
    """Entries that a traversal needs that enters every child, in the worst order; and levels of the tree."""
    references = words.references
    used = references != EMPTY
    inner = used & ((references & LEAF) == 0)
    need, levels = np.ones(len(words.nodes), int), np.ones(len(words.nodes), int)
    # A node's number is larger than its parent's, so going backwards meets children first.
    for node in range(len(words.nodes) - 1, -1, -1):
        children = references[node][inner[node]]
        others = int(used[node].sum()) - 1
        # The child that is entered first finds all of its siblings on the stack.
        need[node] = max([others + 1, *(others + need[children])])
        levels[node] = 1 + max(levels[children], default=0)
    return int(need[0]), int(levels[0])


def _half_area(low: Floats, high: Floats) -> Floats:
    x, y, z = np.moveaxis(np.maximum(high - low, 0), -1, 0)
    area: Floats = x * y + y * z + z * x
    return area


def cost(words: Words) -> float:
    """Nodes and packs that a random line through the root's box visits on average (surface area heuristic)."""
    used = words.references != EMPTY
    low, high = words.low, words.high
    root = _half_area(low[0][used[0]].min(0), high[0][used[0]].max(0))
    return float(1 + _half_area(low, high)[used].sum() / root)


Split = Callable[[Floats, Floats], tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]]


def sweep_cost(low: Floats, high: Floats) -> float:
    """The cost of a tree whose every split is the best one along the three axes, made eight wide as the builder's."""
    return _cost_of(low, high, _best_split)


def median_cost(low: Floats, high: Floats) -> float:
    """The same with splits in the middle of the order along the widest axis."""
    return _cost_of(low, high, _median_split)


def _median_split(low: Floats, high: Floats) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    center = low + high
    order = np.argsort(center[:, int(np.ptp(center, axis=0).argmax())], kind="stable")
    return order[: len(order) // 2], order[len(order) // 2 :]


def _best_split(low: Floats, high: Floats) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    best = np.inf
    chosen = _median_split(low, high)
    count = np.arange(1, len(low))
    for axis in range(3):
        order = np.argsort(low[:, axis] + high[:, axis], kind="stable")
        a, b = low[order], high[order]
        left = _half_area(np.minimum.accumulate(a), np.maximum.accumulate(b))[:-1]
        right = _half_area(np.minimum.accumulate(a[::-1]), np.maximum.accumulate(b[::-1]))[::-1][1:]
        # Whole packs of eight, as the leaves are.
        price = left * -(-count // 8) + right * -(-(len(low) - count) // 8)
        if price.min() < best:
            best, at = price.min(), int(price.argmin()) + 1
            chosen = order[:at], order[at:]
    return chosen


def _cost_of(low: Floats, high: Floats, split: Split) -> float:
    whole = float(_half_area(low.min(0), high.max(0)))
    total = whole
    tasks = [(low, high)]
    while tasks:
        children = [tasks.pop()]
        while len(children) < 8:
            areas = [float(_half_area(a.min(0), b.max(0))) if len(a) > 8 else -1.0 for a, b in children]
            largest = int(np.argmax(areas))
            if areas[largest] < 0:
                break
            a, b = children[largest]
            first, second = split(a, b)
            children[largest] = a[first], b[first]
            children.append((a[second], b[second]))
        total += sum(float(_half_area(a.min(0), b.max(0))) for a, b in children)
        tasks += [child for child in children if len(child[0]) > 8]
    return total / whole
