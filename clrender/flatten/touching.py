"""Decides what rays find where things touch, by moving one of them by a few roundings.

Where two surfaces are closer than rounding errors, a ray finds either. These rules say which it has to be:

- An opaque surface counts, and the boundary of glass or of a medium in its plane does not. It becomes two copies, one
  on either side of the boundary, so that nothing finds the boundary in between.
- A lamp lies before an opaque surface in its plane, on the side that it shines to; but a face of a closed lamp that
  stands on the surface, front to front, lies behind it. Of two lamps that shine to one side, the first in the file
  counts.
- Of two boundaries, or of two opaque surfaces of different materials with their fronts on one side, nothing decides: a
  warning names them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.flatten.emission import emits
from clrender.flatten.faces import (
    NO_CONTACTS,
    ROUNDING,
    Contacts,
    Faces,
    bounds,
    coplanar,
    coplanar_among,
    cross,
    inner,
    joined,
)
from clrender.flatten.near_pairs import near_pairs
from clrender.flatten.shape_faces import (
    BOUNDARY,
    LAMP,
    OPAQUE,
    SIMPLE,
    Placed,
    is_curve,
    is_disk,
    placed_faces,
    shape_faces,
)
from clrender.scene.materials import passes_light
from clrender.scene.shapes import Mesh
from clrender.wording import place

if TYPE_CHECKING:
    from clrender.flatten.assembly import Assembly
    from clrender.flatten.surface_arrays import FlatSurfaces
    from clrender.scene.camera import Camera
    from clrender.scene.description import Scene
    from clrender.scene.values import Vector

__all__ = ["KnownMoves", "Moves", "camera_reach", "moves", "undecided"]

_CURE: Final = "give both a priority and let one reach a little into the other, or keep them apart"
_CLEAR: Final = 16.0 * ROUNDING
"""Of the way that rays come, along the normal: planes this far apart are met in their order."""
_REACH: Final = 16.0
"""Rays to the outer copy and to lamps come from within this multiple of a shape's largest coordinate."""
_CAMERA: Final = 0.25
"""Part of the way that rays come from the camera, which `_CLEAR` leaves room for."""
_MOST_SPHERES: Final = 2**18
_MOST_KNOWN: Final = 2**20
"""Primitives of a scene of which it is kept what touches."""
_FEW: Final = 2**12
"""Most opaque faces of simple shapes that are searched for coincidences which nothing decides."""

_PLACED: Final = 4.0
"""Rounding of planes in instances: the way into a group's space and back rounds so many times as much."""
_MOVING: Final = 4.0 * _PLACED
"""The same where something moves: its maps are computed by the kernels (kernels/geometry/instance.h)."""
_NONE: Final = np.zeros(0, np.int64)

_Floats = NDArray[np.float64]


@dataclass
class Moves:
    """How far primitives move along their normals, metres; 0: they stay.

    Attributes
    ----------
    first, second : (P,) float64
        Of each primitive's two copies; both are the same for what stays or moves alone. Of a sphere: how far its front
        moves.
    undecided, boundaries : list of (int, int)
        Opaque shapes, and boundaries of dielectrics or media, that coincide without a rule that decides.
    unknown : bool
        Whether there were too many faces to compare.
    camera_free : float
        Up to this `camera_reach` they do not depend on the camera.
    """

    first: _Floats
    second: _Floats
    undecided: list[tuple[int, int]] = field(default_factory=list)
    boundaries: list[tuple[int, int]] = field(default_factory=list)
    unknown: bool = False
    camera_free: float = math.inf

    @property
    def any(self) -> bool:
        """Whether anything moves."""
        return bool(self.first.any() or self.second.any())


def camera_reach(camera: Camera, origin: Vector) -> float:
    """A power of two that no coordinate of the camera is beyond; most camera moves do not change it.

    Parameters
    ----------
    camera : Camera
    origin : (3,) float
        World space, metres: the origin of coordinates on the device.
    """
    most = max(abs(a - b) for a, b in zip(camera.position, origin, strict=True))
    mantissa, exponent = math.frexp(most)
    return math.ldexp(1.0, exponent - (mantissa == 0.5)) if most > 0.0 else 0.0


def moves(scene: Scene, surfaces: FlatSurfaces, own: int, assembly: Assembly | None) -> Moves:
    """Find what touches, and decide it.

    Parameters
    ----------
    scene : Scene
    surfaces : FlatSurfaces
    own : int
        Number of first shapes that are in world space.
    assembly : Assembly, optional
        Groups of the other shapes, and where they are placed.
    """
    total = int(surfaces.count.sum())
    result = Moves(np.zeros(total), np.zeros(total))
    kinds = np.array([_kind(scene, index) for index in range(len(surfaces.shapes))], np.int64)
    kinds[surfaces.count == 0] = 0
    groups = assembly.groups if assembly is not None else ()
    slack = _PLACED if assembly is None or not assembly.motions else _MOVING
    assembly = None if assembly is None else assembly.opened
    for space in groups:
        here = (space.start <= np.arange(len(kinds))) & (np.arange(len(kinds)) < space.stop)
        if np.count_nonzero(kinds[here]) > 1:
            _Space(scene, surfaces, np.where(here, kinds, 0), result).decide()
    placed = None
    if assembly is not None and groups and (kinds > OPAQUE).any():
        placed = placed_faces(surfaces, assembly, kinds)
        result.unknown |= placed is None
    world = np.where(np.arange(len(kinds)) < own, kinds, 0)
    camera = camera_reach(scene.camera, surfaces.origin)
    outer = None
    if placed is not None:
        outer = _Space(scene, surfaces, world, result, placed, kinds[placed.shape], camera, slack)
    elif np.count_nonzero(world) > 1:
        outer = _Space(scene, surfaces, world, result, camera=camera)
    if outer is not None:
        outer.decide()
        if result.any or camera == 0.0:
            result.camera_free = outer.camera_free
    return result


class KnownMoves:
    """What was found last, for scenes after each other whose shapes are in the same places, as while one is edited.

    All that `moves` reads is compared, so that what is known is what would be found.
    """

    def __init__(self) -> None:
        self._known: tuple[tuple[Any, ...], list[NDArray[Any]], Moves] | None = None

    def of(self, scene: Scene, surfaces: FlatSurfaces, own: int, assembly: Assembly | None) -> Moves:
        """As of `moves`; of scenes with groups, and of large ones, nothing is kept."""
        if (assembly is not None and assembly.groups) or len(surfaces.primitive_shape) > _MOST_KNOWN:
            self._known = None
            return moves(scene, surfaces, own, assembly)
        shapes = range(len(surfaces.shapes))
        numbers = [(_kind(scene, index), isinstance(scene.plain_shapes[index], Mesh)) for index in shapes]
        key = numbers, own, camera_reach(scene.camera, surfaces.origin)
        arrays = [
            surfaces.vertices,
            surfaces.triangles,
            surfaces.analytic_shapes,
            surfaces.curve_rows,
            surfaces.primitive_shape,
            surfaces.first,
            surfaces.count,
            surfaces.first_vertex,
            surfaces.shapes["material"].copy(),
        ]
        known = self._known
        if known is None or known[0] != key or not all(map(_same, known[1], arrays)):
            known = self._known = key, arrays, moves(scene, surfaces, own, assembly)
        return known[2]


def _same(a: NDArray[Any], b: NDArray[Any]) -> bool:
    """Whether two arrays have the same bytes, so that two of the same not-a-number are equal."""
    if a.shape != b.shape or a.dtype != b.dtype:
        return False
    return bool(np.array_equal(np.ascontiguousarray(a).view(np.uint8), np.ascontiguousarray(b).view(np.uint8)))


def undecided(scene: Scene, found: Moves) -> list[str]:
    """Sentences about what coincides without a rule that decides."""
    texts = []
    for pairs, text in (
        (found.boundaries, "faces of two dielectrics or media coincide, and what is seen through them is wrong; {}"),
        (found.undecided, "their faces coincide, and either may be seen; move one of them a little"),
    ):
        for pair in pairs[:1]:
            which = " and ".join(place(scene.place_of(index)) for index in pair)
            texts.append(f"{which}: {text}".format(_CURE))
    if found.unknown:
        texts.append("too many faces touch to look for coinciding ones; keep lamps and glass off the others")
    return texts


def _kind(scene: Scene, index: int) -> int:
    """What a shape is to others that touch it; 0: surfaces with holes, which are nothing of all this."""
    shape = scene.plain_shapes[index]
    material = None if shape.material is None else scene.materials[shape.material]
    if material is not None and material.masked:
        return 0
    if shape.interior is not None or (material is not None and passes_light(scene.materials, material)):
        return BOUNDARY
    return LAMP if emits(scene, shape) else OPAQUE


class _Space:
    """Shapes with coordinates in common."""

    def __init__(
        self,
        scene: Scene,
        surfaces: FlatSurfaces,
        kinds: NDArray[np.int64],
        result: Moves,
        placed: Placed | None = None,
        placed_kinds: NDArray[np.int64] = _NONE,
        camera: float = 0.0,
        slack: float = _PLACED,
    ) -> None:
        self._scene, self._surfaces, self._result = scene, surfaces, result
        self._faces = shape_faces(surfaces, kinds, None if placed is None else placed.faces)
        self._slack, self._shape = 1.0, np.arange(len(kinds))
        if placed is not None:
            self._slack, self._shape = slack, np.concatenate([self._shape, placed.shape])
            self._faces = joined([self._faces, placed.faces])
            kinds = np.concatenate([kinds, placed_kinds])
        self._kinds = kinds
        """Of each shape, and of each in each instance; `_shape` has the scene's shapes that these are."""
        count = len(surfaces.triangles)
        self._rounds = np.flatnonzero((kinds[surfaces.primitive_shape[count:]] > 0) & ~is_disk(surfaces)) + count
        self._numbers = surfaces.analytic_shapes["center_radius"][self._rounds - count].astype(np.float64)
        shape_of_rounds = surfaces.primitive_shape[self._rounds].astype(np.int64)
        low, high = _boxes(self._faces, shape_of_rounds, self._numbers, len(kinds))
        some = low <= high
        low, high = np.where(some, low, 0.0), np.where(some, high, 0.0)
        self._own = np.maximum(np.abs(low), np.abs(high)) + (high - low)
        """(S, 3) how far rays within each shape come, and how far from the origin they are."""
        self._closed = _closed(self._faces, len(kinds))
        if placed is not None:  # a map has to do with all coordinates
            self._own = np.repeat(self._own.max(axis=1, initial=0.0)[:, None], 3, axis=1)
        self._far = np.minimum(_extent(surfaces), _REACH * self._own.max(axis=1, initial=0.0)[:, None])
        own = self._own.max(axis=1, initial=0.0)[:, None]
        self.camera_free = float(np.min(((self._far / _CAMERA - own) / 2.0)[own[:, 0] > 0.0], initial=math.inf))
        # The camera may be further away; its rays come far along normals, and not only along what the scene is large in
        self._far = np.maximum(self._far, _CAMERA * (2.0 * camera + own))

    def decide(self) -> None:
        """Write the moves of this space's primitives."""
        kinds, shape = self._kinds, self._faces.shape
        boundary, lamp = kinds[shape] == BOUNDARY, kinds[shape] == LAMP
        solid = lamp | (kinds[shape] == OPAQUE)
        if boundary.any() and solid.any():
            self._before_boundaries(self._faces.at(solid), self._faces.at(boundary))
        self._equal_spheres()
        if lamp.any():
            self._lamps(self._faces.at(lamp), self._faces.at(solid & ~lamp))
        self._undecided(self._faces.at(solid & ~lamp), self._faces.at(boundary))

    def _known(self, found: Contacts | None) -> Contacts:
        self._result.unknown |= found is None
        return NO_CONTACTS if found is None else found

    def _before_boundaries(self, solid: Faces, boundary: Faces) -> None:
        """Opaque faces get a copy on either side of the boundaries in their planes."""
        found = self._known(coplanar(solid, boundary, self._slack))
        shape, other = solid.shape[found.first], boundary.shape[found.second]
        normal, inwards = np.abs(found.normal), ~found.same
        within, outside = np.zeros(len(self._kinds)), np.zeros(len(self._kinds))
        np.maximum.at(within, shape, found.gap + self._slack * _CLEAR * inner(normal, self._own[other]))
        np.maximum.at(outside, shape, found.gap + self._slack * _CLEAR * inner(normal, self._far[other]))
        row, stretch = solid.row[found.first], solid.stretch[found.first]
        np.maximum.at(self._result.first, row, np.where(inwards, within[shape], outside[shape]) / stretch)
        np.minimum.at(self._result.second, row, -np.where(inwards, outside[shape], within[shape]) / stretch)

    def _lamps(self, lamp: Faces, opaque: Faces) -> None:
        """Faces of lamps move before, or behind, what is opaque in their planes."""
        found, lift = self._known(coplanar(lamp, opaque, self._slack)), np.zeros(len(self._kinds))
        closed = self._closed[lamp.shape[found.first]]
        self._lift(lamp, opaque, found, np.where(found.same | ~closed, 1.0, -1.0), lift)
        found = self._known(coplanar_among(lamp, self._slack))
        first, second = (self._closed[lamp.shape[each]] for each in (found.first, found.second))
        # Closed lamps that stand on each other, front to front, hide both faces: a gap would only hold light
        found = found.where(found.same | ~(first & second))
        closed = self._closed[lamp.shape[found.first]]
        self._lift(lamp, lamp, found, np.where(found.same | ~closed, 1.0, -1.0), lift)
        back = found.where(~found.same)
        back = replace(back, first=back.second, second=back.first)
        self._lift(lamp, lamp, back, np.where(self._closed[lamp.shape[back.first]], -1.0, 1.0), lift)

    def _lift(self, lamp: Faces, other: Faces, found: Contacts, sign: _Floats, lift: _Floats) -> None:
        """Move the first face of each pair clear of the second, and all such faces of a lamp as far."""
        row, shape, partner = lamp.row[found.first], lamp.shape[found.first], other.row[found.second]
        reach = np.maximum(np.abs(self._result.first[partner]), np.abs(self._result.second[partner]))
        reach = reach * other.stretch[found.second]
        way = self._far[shape] + np.abs(other.corners[found.second]).max(axis=1, initial=0.0)
        np.maximum.at(lift, shape, found.gap + reach + self._slack * _CLEAR * inner(np.abs(found.normal), way))
        for chosen in (sign < 0.0, sign > 0.0):
            self._result.first[row[chosen]] = sign[chosen] * lift[shape[chosen]]
            self._result.second[row[chosen]] = self._result.first[row[chosen]]

    def _equal_spheres(self) -> None:
        """The front of an opaque sphere moves before a boundary that is the same sphere, and that of a lamp further."""
        spheres = ~is_curve(self._surfaces)[self._rounds - len(self._surfaces.triangles)]
        rows, numbers = self._rounds[spheres], self._numbers[spheres]
        kinds = self._kinds[self._surfaces.primitive_shape[rows]]
        if not (kinds > OPAQUE).any():
            return
        equal = _CLEAR * (np.abs(numbers[:, :3]).max(axis=1, initial=0.0) + numbers[:, 3])[:, None]
        boxes = np.concatenate([numbers[:, :3] - equal, numbers[:, :3] + equal], axis=1)
        pairs = near_pairs(boxes, boxes, _MOST_SPHERES)
        self._result.unknown |= pairs is None
        ranks = {BOUNDARY: 0, OPAQUE: 1, LAMP: 2}
        order = [(ranks[kind], -row) for kind, row in zip(kinds.tolist(), rows.tolist(), strict=True)]
        for i, j in sorted(zip(*(each.tolist() for each in pairs or ()), strict=True), key=lambda pair: order[pair[1]]):
            moves_before = order[i] < order[j] and order[j][0] > 0
            apart = float(np.abs(numbers[i] - numbers[j]).max())
            if moves_before and apart <= float(equal[i, 0] + equal[j, 0]):
                before = max(0.0, float(self._result.first[rows[i]])) + apart + 2.0 * float(equal[i, 0] + equal[j, 0])
                self._result.first[rows[j]] = max(float(self._result.first[rows[j]]), before)
                self._result.second[rows[j]] = self._result.first[rows[j]]

    def _undecided(self, opaque: Faces, boundary: Faces) -> None:
        """The first two boundaries that coincide, and the first two simple opaque shapes of different materials."""
        found = self._known(coplanar_among(boundary, self._slack))
        if len(found.first):
            pair = self._shape[boundary.shape[[found.first[0], found.second[0]]]].tolist()
            self._result.boundaries.append((pair[0], pair[1]))
        simple = self._surfaces.count[self._shape] <= SIMPLE
        for index in np.flatnonzero(simple & self._closed).tolist():
            # Which side of a closed mesh is its front may not matter to whoever made it
            simple[index] = not isinstance(self._scene.plain_shapes[int(self._shape[index])], Mesh)
        some = opaque.at(simple[opaque.shape])
        if not 1 < len(some.row) <= _FEW:
            return
        found = self._known(coplanar_among(some, self._slack))
        first, second = self._shape[some.shape[found.first]], self._shape[some.shape[found.second]]
        materials = self._surfaces.shapes["material"]
        meant = found.same & (materials[first] != materials[second])
        if meant.any():
            at = int(np.argmax(meant))
            self._result.undecided.append((int(first[at]), int(second[at])))


def _boxes(faces: Faces, shape: NDArray[np.int64], numbers: _Floats, count: int) -> tuple[_Floats, _Floats]:
    """Lowest and highest coordinates of each shape, (S, 3) each; of none, infinite."""
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    if len(faces.row):
        starts = np.concatenate([[0], np.flatnonzero(np.diff(faces.shape)) + 1])
        run = faces.shape[starts]
        boxes = bounds(faces.corners, 0.0)
        np.minimum.at(low, run, np.minimum.reduceat(boxes[:, :3], starts, axis=0))
        np.maximum.at(high, run, np.maximum.reduceat(boxes[:, 3:], starts, axis=0))
    np.minimum.at(low, shape, numbers[:, :3] - numbers[:, 3:])
    np.maximum.at(high, shape, numbers[:, :3] + numbers[:, 3:])
    return low, high


def _extent(surfaces: FlatSurfaces) -> _Floats:
    """(3,) how far rays come at most, and how far from the origin they are."""
    balls = surfaces.analytic_shapes["center_radius"].astype(np.float64)
    ends: list[_Floats] = [balls[:, :3] - balls[:, 3:], balls[:, :3] + balls[:, 3:]]
    if len(surfaces.vertices):
        ends.append(np.stack([surfaces.vertices.min(axis=0), surfaces.vertices.max(axis=0)]).astype(np.float64))
    every = np.concatenate(ends)
    low, high = every.min(axis=0), every.max(axis=0)
    return np.asarray(2.0 * (np.maximum(np.abs(low), np.abs(high)) + (high - low)))


def _closed(faces: Faces, count: int) -> NDArray[np.bool_]:
    """(S,) which shapes are closed: the areas of their faces, with their normals, cancel out."""
    area = cross(faces.corners[:, 1] - faces.corners[:, 0], faces.corners[:, 2] - faces.corners[:, 0])
    total = np.zeros((count, 3))
    total[:] = np.stack([np.bincount(faces.shape, area[:, axis], count) for axis in range(3)], axis=1)
    size = np.bincount(faces.shape, np.sqrt(inner(area, area)), count)
    return np.asarray(np.sqrt(inner(total, total)) <= 1e-3 * size)
