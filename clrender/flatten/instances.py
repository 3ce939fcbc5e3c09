"""Rows of instances for the kernels, and conservative bounding boxes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.errors import SceneError
from clrender.flatten.assembly import Assembly
from clrender.flatten.motion import Knots, knot_rows, swept_boxes
from clrender.flatten.poses import FlatPoses, flat_poses
from clrender.flatten.surface_arrays import FlatSurfaces
from clrender.scene.values import Vector
from clrender.wording import counted, grouped

__all__ = ["NUMBER_LIMIT", "FlatGroup", "FlatInstances", "box_of", "flat_instances"]

NUMBER_LIMIT: Final = 2**32 - 16
"""Most primitives of a scene, instances counted: each has a 32-bit number, a few of which are reserved."""

_ROUNDING: Final = 2.0**-24
_REACH: Final = 4.0
"""Rays begin within this multiple of the largest coordinate of the scene's own shapes and instances."""
_CELLS: Final = 4
_FEW: Final = 2**16
"""Most instances of a group for which boxes of its parts are used."""
_BATCH: Final = 2**14
"""Parts of instances transformed to world space at a time."""
_INSTANCE: Final = layout.columns("INSTANCE")
_PLACEMENT: Final = layout.columns("PLACEMENT")


@dataclass(frozen=True)
class FlatGroup:
    """Primitives of a group: triangles from `first_triangle` on, spheres and disks from `first_analytic` on."""

    first_triangle: int
    triangle_count: int
    first_analytic: int
    analytic_count: int

    @property
    def triangles(self) -> slice:
        """Its slice of all triangles."""
        return slice(self.first_triangle, self.first_triangle + self.triangle_count)

    def analytic(self, first: int) -> slice:
        """Its slice of all spheres and disks; `first` is the primitive number of the first one."""
        return slice(self.first_analytic - first, self.first_analytic - first + self.analytic_count)

    @property
    def count(self) -> int:
        """Number of its primitives."""
        return self.triangle_count + self.analytic_count


@dataclass(frozen=True)
class FlatInstances:
    """Instances of a scene; if there are none, one row of zeros and a guide that no primitive reaches.

    Attributes
    ----------
    rows : (2 N, 16) float32
        As ``kernels/geometry/instance.h`` reads them, except for the references to trees, which the device builds.
    guides : (K,) uint32
        Guide table from a primitive's number to its instance.
    boxes : (N, 6) float32
        Lowest and highest coordinates in world space, relative to the origin, enlarged for the rounding of rays.
    groups : tuple of FlatGroup
    group_of : (N,) int64
    own_triangles, own_analytic, own_vertices : int
        Counts of the scene itself, whose elements come before those of groups.
    own_places : (S,) int64
        Index in the scene's list of shapes, for each shape in world space.
    seen_begin : (N,) int64
        See `clrender.flatten.assembly.Assembly`.
    own_turns : (S,) int64
    placed : (N, 2) int64
        See `clrender.flatten.assembly.Assembly`.
    motion_rows : (K, 16) float32
        Knots of what moves; one row of zeros if nothing does.
    motion_places : (N, 4) uint32
        Of each instance, its first knot, and the number of ways between its knots; 0: it rests. Then, in the same rows,
        the first of its poses, and the number of their times; 0: its form stays. One row if there are no instances.
    motion_of : (N,) int64
        See `clrender.flatten.assembly.Assembly`.
    motions : tuple of Knots
    poses : mapping of int to FlatPoses
        Of groups that are one mesh that changes its form.
    """

    rows: NDArray[np.float32]
    guides: NDArray[np.uint32]
    boxes: NDArray[np.float32]
    groups: tuple[FlatGroup, ...]
    group_of: NDArray[np.int64]
    own_triangles: int
    own_analytic: int
    own_vertices: int
    own_places: NDArray[np.int64]
    seen_begin: NDArray[np.int64]
    own_turns: NDArray[np.int64]
    placed: NDArray[np.int64]
    motion_rows: NDArray[np.float32]
    motion_places: NDArray[np.uint32]
    motion_of: NDArray[np.int64]
    motions: tuple[Knots, ...] = ()
    poses: Mapping[int, FlatPoses] = field(default_factory=dict)

    @classmethod
    def none(
        cls,
        own_triangles: int,
        own_analytic: int,
        own_vertices: int,
        own_places: NDArray[np.int64],
        own_turns: NDArray[np.int64] | None = None,
    ) -> FlatInstances:
        """The instances of a scene that has none, or only such that are written out."""
        nowhere = np.array([layout.NONE, 0, 0, 0], np.uint32)
        own = own_triangles, own_analytic, own_vertices, own_places
        empty = np.zeros(0, np.int64)
        turns = np.zeros_like(own_places) if own_turns is None else own_turns
        resting = np.zeros((1, 16), np.float32), np.zeros((1, 4), np.uint32), empty
        nothing = np.zeros((2, 16), np.float32), nowhere, np.zeros((0, 6), np.float32), (), empty
        return cls(*nothing, *own, empty, turns, np.zeros((0, 2), np.int64), *resting)

    @property
    def count(self) -> int:
        """Number of instances."""
        return len(self.group_of)

    @property
    def moves(self) -> bool:
        """Whether any of them moves while the shutter is open."""
        return bool((self.motion_of >= 0).any())

    def moving_light(self, first: int, triangle_count: int) -> tuple[Knots, int] | None:
        """The motion of a shape that shines, and what to add to rows of its primitives for their numbers.

        Of the instances' shapes only those shine that move, each in one place.

        Parameters
        ----------
        first : int
            Row of its first primitive.
        triangle_count : int

        Returns
        -------
        Knots and int, or None
            None if the shape is none of an instance.
        """
        triangle = first < triangle_count
        if first < self.own_triangles or triangle_count <= first < triangle_count + self.own_analytic:
            return None
        for number, group in enumerate(self.groups):
            begin, count = (
                (group.first_triangle, group.triangle_count)
                if triangle
                else (group.first_analytic, group.analytic_count)
            )
            if begin <= first < begin + count:
                (instance,) = np.flatnonzero(self.group_of == number).tolist()
                column = _INSTANCE["TRIANGLE_OFFSET" if triangle else "ANALYTIC_OFFSET"]
                return self.motions[self.motion_of[instance]], int(self.rows.view(np.uint32)[2 * instance, column])
        raise AssertionError(first)

    @property
    def primitive_count(self) -> int:
        """Number of primitives of all instances, if they were duplicated."""
        return int(np.array([group.count for group in self.groups], np.int64)[self.group_of].sum()) if self.count else 0

    def rows_of(self, primitives: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Row of each primitive in the scene's tables, and its instance, or -1.

        Parameters
        ----------
        primitives : (...) int64
            Primitive numbers as used by the kernels.
        """
        words = self.rows.view(np.uint32).astype(np.int64)
        if not self.count:
            return primitives, np.full_like(primitives, -1)
        firsts = words[1::2, _PLACEMENT["FIRST"]]
        instance = np.searchsorted(firsts, primitives, side="right") - 1
        at = np.maximum(instance, 0)
        analytic = primitives >= words[1::2, _PLACEMENT["FIRST_ANALYTIC"]][at]
        offsets = words[::2, [_INSTANCE["TRIANGLE_OFFSET"], _INSTANCE["ANALYTIC_OFFSET"]]]
        offset = np.where(analytic, offsets[at, 1], offsets[at, 0])
        return np.where(instance >= 0, (primitives - offset) & 0xFFFFFFFF, primitives), instance

    def seen(self, primitives: NDArray[np.int64], primitive_shape: NDArray[np.uint32]) -> NDArray[np.int64]:
        """Objects of primitives, as indices of `clrender.flatten.assembly.Assembly.seen_place`.

        Parameters
        ----------
        primitives : (...) int64
            Primitive numbers as used by the kernels.
        primitive_shape : (P,) uint32
            See `clrender.flatten.flat_scene.FlatScene`.
        """
        rows, instance = self.rows_of(primitives)
        shape = primitive_shape[rows].astype(np.int64)
        return shape + np.where(instance >= 0, self.seen_begin[instance], 0) if self.count else shape


def flat_instances(assembly: Assembly, surfaces: FlatSurfaces) -> FlatInstances:
    """Rows and boxes of a scene's instances.

    Parameters
    ----------
    assembly : Assembly
    surfaces : FlatSurfaces
        Surfaces of the assembly's scene.

    Raises
    ------
    SceneError
        There are more primitives than numbers for them.
    """
    groups = tuple(_group(surfaces, shapes) for shapes in assembly.groups)
    own_triangles = min((group.first_triangle for group in groups), default=len(surfaces.triangles))
    triangles, analytic = len(surfaces.triangles), len(surfaces.analytic_shapes)
    own_analytic = min((group.first_analytic for group in groups), default=triangles + analytic) - triangles
    own_vertices = len(surfaces.vertices)
    if own_triangles < triangles:
        own_vertices = int(surfaces.triangles[own_triangles:].min())  # groups' vertices come after the scene's own
    filled = np.array([group.count > 0 for group in groups], bool)
    present = filled[assembly.group_of] if len(assembly.group_of) else np.zeros(0, bool)
    group_of, maps = assembly.group_of[present], assembly.maps[present]
    if not len(group_of):
        own_places = assembly.seen_place[: assembly.own_shapes]
        return FlatInstances.none(own_triangles, own_analytic, own_vertices, own_places, assembly.own_turns)
    counts = np.array([group.count for group in groups], np.int64)[group_of]
    numbers = triangles + analytic + np.concatenate([[0], np.cumsum(counts)])
    if numbers[-1] > NUMBER_LIMIT:
        text = (
            f"{counted(int(counts.sum()), 'triangle')} with all instances counted, but {grouped(NUMBER_LIMIT)} "
            "is the most"
        )
        raise SceneError(f"{assembly.scene.source}: shapes hold {text}; place fewer, or simpler groups")
    motion_of = assembly.motion_of[present]
    moving = motion_of >= 0
    # A motion leads to world space, and has the origin in its own offsets
    shifts = np.where(moving[:, None], 0.0, np.array(surfaces.origin))
    to_world, to_object = _both_ways(maps, shifts)
    rows = np.zeros((len(group_of), 2, 16), np.float32)
    rows[:, 0, :12], rows[:, 1, :12] = to_object.reshape(-1, 12), to_world.reshape(-1, 12)
    words = rows.view(np.uint32)
    firsts = numbers[:-1]
    of = {
        name: np.array([getattr(group, name) for group in groups], np.int64)[group_of]
        for name in FlatGroup.__annotations__
    }
    words[:, 0, _INSTANCE["TRIANGLE_OFFSET"]] = (firsts - of["first_triangle"]) & 0xFFFFFFFF
    first_analytic = firsts + of["triangle_count"]
    words[:, 0, _INSTANCE["ANALYTIC_OFFSET"]] = (first_analytic - of["first_analytic"]) & 0xFFFFFFFF
    words[:, 1, _PLACEMENT["FIRST"]] = firsts
    words[:, 1, _PLACEMENT["FIRST_ANALYTIC"]] = first_analytic
    linear = to_world[:, :, :3].astype(np.float64)
    rows[:, 1, _PLACEMENT["SCALE"]] = np.sqrt((linear[:, :, 0] * linear[:, :, 0]).sum(axis=1))
    rows[:, 1, _PLACEMENT["FACING"]] = np.sign(_cofactors(linear)[1])
    centers = surfaces.analytic_shapes["center_radius"][:own_analytic]
    own_box = box_of(surfaces.vertices[:own_vertices], centers)
    low, high = _bounds(surfaces, groups, group_of, to_world, np.flatnonzero(~moving))
    poses = {
        group: flat_poses(assembly.scene, surfaces, assembly.groups[group].start, deformation)
        for group, deformation in assembly.deformations.items()
        if groups[group].count
    }
    parts: dict[int, NDArray[np.float64]] = {}
    conditions = np.zeros(len(maps))
    for instance in np.flatnonzero(moving).tolist():
        group, knots = int(group_of[instance]), assembly.motions[motion_of[instance]]
        if group not in parts:
            parts[group] = _pose_boxes(poses[group]) if group in poses else _group_boxes(surfaces, groups[group], 1)
        low[instance], high[instance] = _swept(parts[group], maps[instance], knots, surfaces.origin)
        conditions[instance] = knots.condition
    boxes = _enlarged(low, high, to_world, to_object, own_box, conditions)
    own = own_triangles, own_analytic, own_vertices, assembly.seen_place[: assembly.own_shapes]
    motion_rows, places = knot_rows(assembly.motions, surfaces.origin)
    at = np.zeros((len(maps), 4), np.uint32)
    at[moving, :2] = places[motion_of[moving]]
    for group, flat in poses.items():
        at[group_of == group, 2:] = len(motion_rows), flat.knots
        motion_rows = np.concatenate([motion_rows, flat.rows])
    return FlatInstances(
        rows.reshape(-1, 16),
        _guides(numbers),
        boxes,
        groups,
        group_of,
        *own,
        assembly.seen_begin[present],
        assembly.own_turns,
        assembly.placed[present],
        motion_rows,
        at,
        motion_of,
        assembly.motions,
        poses,
    )


def box_of(
    vertices: NDArray[np.float32], center_radius: NDArray[np.float32], instances: NDArray[np.float32] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest coordinates, (3,) each, of (n, 3) points, (n, 4) spheres, (n, 6) boxes; infinite if empty."""
    spheres = center_radius.astype(np.float64)
    boxes = np.zeros((0, 6), np.float32) if instances is None else instances
    lows = (vertices, spheres[:, :3] - spheres[:, 3:], boxes[:, :3])
    highs = (vertices, spheres[:, :3] + spheres[:, 3:], boxes[:, 3:])
    low = np.stack([some.min(axis=0, initial=np.inf).astype(np.float64) for some in lows]).min(axis=0)
    return low, np.stack([some.max(axis=0, initial=-np.inf).astype(np.float64) for some in highs]).max(axis=0)


def _group(surfaces: FlatSurfaces, shapes: range) -> FlatGroup:
    """The primitives of a range of shapes, which are contiguous."""
    triangles = len(surfaces.triangles)
    first, count = surfaces.first[shapes.start : shapes.stop], surfaces.count[shapes.start : shapes.stop]
    flat, round_ = (count > 0) & (first < triangles), (count > 0) & (first >= triangles)
    first_triangle = int(first[flat].min()) if flat.any() else triangles
    first_analytic = int(first[round_].min()) if round_.any() else triangles + len(surfaces.analytic_shapes)
    return FlatGroup(first_triangle, int(count[flat].sum()), first_analytic, int(count[round_].sum()))


def _cofactors(linear: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N, 3, 3) adjugates and (N,) determinants, in IEEE arithmetic of a fixed order for reproducible bits."""
    a, b, c = linear[:, 0], linear[:, 1], linear[:, 2]

    def cross(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
        (ux, uy, uz), (vx, vy, vz) = u.T, v.T
        return np.stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx], axis=1)

    adjugate = np.stack([cross(b, c), cross(c, a), cross(a, b)], axis=2)
    determinant = a[:, 0] * adjugate[:, 0, 0] + a[:, 1] * adjugate[:, 1, 0] + a[:, 2] * adjugate[:, 2, 0]
    return adjugate, determinant


def _both_ways(
    maps: NDArray[np.float64], shifts: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(N, 3, 4) maps to and from world space, less their (N, 3) shifts; the second inverts the rounded first."""
    to_world = maps.copy()
    to_world[:, :, 3] -= shifts
    rounded = to_world.astype(np.float32)
    linear, offset = rounded[:, :, :3].astype(np.float64), rounded[:, :, 3].astype(np.float64)
    adjugate, determinant = _cofactors(linear)
    inverse = adjugate / determinant[:, None, None]
    to_object = np.empty_like(rounded)
    to_object[:, :, :3] = inverse
    x, y, z = offset.T
    to_object[:, :, 3] = -(
        inverse[:, :, 0] * x[:, None] + inverse[:, :, 1] * y[:, None] + inverse[:, :, 2] * z[:, None]
    )
    return rounded, to_object


def _guides(numbers: NDArray[np.int64]) -> NDArray[np.uint32]:
    """The instance of every n-th primitive number; n is such that there are about two entries per instance."""
    first, last, count = int(numbers[0]), int(numbers[-1]), len(numbers) - 1
    shift = max(0, ((last - first) // (2 * count)).bit_length() - 1)
    buckets = ((last - 1 - first) >> shift) + 2
    begins = np.minimum(first + (np.arange(buckets, dtype=np.int64) << shift), last - 1)
    found = np.searchsorted(numbers, begins, side="right") - 1
    return np.concatenate([[first, shift], found]).astype(np.uint32)


def _group_boxes(surfaces: FlatSurfaces, group: FlatGroup, instances: int) -> NDArray[np.float64]:
    """(n, 2, 3) boxes of the parts of a group, enlarged like the boxes of primitives.

    Parts are its spheres and disks and, if it has few instances, the cells of a grid over its vertices: for a rotated
    body, the box around the boxes of its parts is smaller than that around its whole box.
    """
    corners = surfaces.triangles[group.first_triangle : group.first_triangle + group.triangle_count].reshape(-1)
    begin = group.first_analytic - len(surfaces.triangles)
    spheres = surfaces.analytic_shapes["center_radius"][begin : begin + group.analytic_count]
    used = slice(int(corners.min()), int(corners.max()) + 1) if len(corners) else slice(0)  # they are contiguous
    low, high = box_of(surfaces.vertices[used], spheres)
    room = 32.0 * _ROUNDING * (float((high - low).max()) + np.maximum(np.abs(low), np.abs(high)))
    boxes = [np.stack(box_of(surfaces.vertices[:0], spheres))[None]] if len(spheres) else []
    if len(corners):
        boxes.append(_cell_boxes(surfaces.vertices[used], _CELLS if instances <= _FEW else 1))
    return np.concatenate(boxes) + np.stack([-room, room])


def _pose_boxes(poses: FlatPoses) -> NDArray[np.float64]:
    """(1, 2, 3) the box of all that a mesh passes while it changes its form."""
    boxes = poses.boxes.astype(np.float64)
    return np.stack([boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)])[None]


def _cell_boxes(points: NDArray[np.float32], cells: int) -> NDArray[np.float64]:
    """(n, 2, 3) boxes of (m, 3) points, one for each cell of a grid with `cells` cells along each axis."""
    low, high = points.min(axis=0), points.max(axis=0)
    size = np.where(high > low, high - low, np.float32(1.0))
    x, y, z = np.minimum((points - low) / size * np.float32(cells), cells - 1).astype(np.int64).T
    cell = (x * cells + y) * cells + z
    order = np.argsort(cell, kind="stable")
    begins = np.flatnonzero(np.diff(cell[order], prepend=-1))
    ordered = points[order].astype(np.float64)
    return np.stack([np.minimum.reduceat(ordered, begins), np.maximum.reduceat(ordered, begins)], axis=1)


def _carried(maps: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 3) points transformed by (..., 3, 4) maps."""
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    return np.stack(
        [maps[..., k, 0] * x + maps[..., k, 1] * y + maps[..., k, 2] * z + maps[..., k, 3] for k in range(3)], axis=-1
    )


def _bounds(
    surfaces: FlatSurfaces,
    groups: Sequence[FlatGroup],
    group_of: NDArray[np.int64],
    to_world: NDArray[np.float32],
    resting: NDArray[np.int64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N, 3) each: boxes of the instances that rest, in world space; zeros for others."""
    out = to_world.astype(np.float64)
    sizes = np.abs(out)
    sizes[:, :, 3] = 0.0
    low, high = np.zeros((len(out), 3)), np.zeros((len(out), 3))
    order, counts = np.argsort(group_of[resting], kind="stable"), np.bincount(group_of[resting], minlength=len(groups))
    for group, of_it in zip(groups, np.split(resting[order], np.cumsum(counts)[:-1]), strict=True):
        if not len(of_it):
            continue
        parts = _group_boxes(surfaces, group, len(of_it))
        middles, halves = parts.mean(axis=1), (parts[:, 1] - parts[:, 0]) / 2.0
        for some in np.array_split(of_it, -(-len(of_it) * len(parts) // _BATCH)):
            center, extent = _carried(out[some, None], middles), _carried(sizes[some, None], halves)
            low[some], high[some] = (center - extent).min(axis=1), (center + extent).max(axis=1)
    return low, high


def _swept(
    parts: NDArray[np.float64], map_: NDArray[np.float64], knots: Knots, origin: Vector
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Box of all places of an instance that moves, in world space, relative to the origin; (n, 2, 3) parts of it."""
    middles, halves = parts.mean(axis=1), (parts[:, 1] - parts[:, 0]) / 2.0
    sizes = np.abs(map_)
    sizes[:, 3] = 0.0
    center, extent = _carried(map_, middles), _carried(sizes, halves)
    low, high = swept_boxes(knots, center - extent, center + extent)
    return low.min(axis=0) - np.array(origin), high.max(axis=0) - np.array(origin)


def _enlarged(
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    to_world: NDArray[np.float32],
    to_object: NDArray[np.float32],
    own_box: tuple[NDArray[np.float64], NDArray[np.float64]],
    conditions: NDArray[np.float64],
) -> NDArray[np.float32]:
    """(N, 6) world-space boxes, enlarged by the rounding error of a ray that is transformed to group space.

    Each coordinate in group space is the sum of three products and an offset, rounded three times, of numbers rounded
    once: the error is at most four roundings of the sum of their magnitudes, which the inverse map carries to world
    space. The inverse map itself was rounded likewise. What moves is on a way of its own before that, where errors have
    nothing to do with single entries of maps (MOTION_ROUNDINGS of kernels/geometry/instance.h); `conditions` are those
    of the motions, 0 of what rests.
    """
    out, inside = to_world.astype(np.float64), to_object.astype(np.float64)
    own_low, own_high = (np.where(np.isfinite(corner), corner, 0.0) for corner in own_box)
    reach = np.abs(np.concatenate([low, high, [own_low, own_high]])).max(axis=0)
    lost = _carried(np.abs(inside), np.broadcast_to(_REACH * reach, low.shape))
    room = 8.0 * _ROUNDING * _carried(np.abs(out), lost)
    spread = np.abs(out[:, :, :3]).max(axis=(1, 2)) * np.abs(inside[:, :, :3]).max(axis=(1, 2))
    room += 64.0 * _ROUNDING * _REACH * reach.sum() * (spread * conditions)[:, None]
    low, high = low - room, high + room
    boxes = np.concatenate([low, high], axis=1)
    # Round outwards where single precision rounds inwards
    single = boxes.astype(np.float32)
    single[:, :3] = np.where(single[:, :3] > low, np.nextafter(single[:, :3], np.float32(-np.inf)), single[:, :3])
    single[:, 3:] = np.where(single[:, 3:] < high, np.nextafter(single[:, 3:], np.float32(np.inf)), single[:, 3:])
    return single
