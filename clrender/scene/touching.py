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

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from clrender.scene.emission import emits
from clrender.scene.faces import NO_CONTACTS, ROUNDING, Contacts, Faces, coplanar, coplanar_among, inner
from clrender.scene.materials import passes_light
from clrender.scene.near_pairs import near_pairs
from clrender.scene.shape_faces import BOUNDARY, LAMP, OPAQUE, SIMPLE, is_disk, shape_faces
from clrender.scene.shapes import Mesh
from clrender.scene.wording import place

if TYPE_CHECKING:
    from clrender.scene.description import Scene
    from clrender.scene.surfaces import FlatSurfaces

__all__ = ["Moves", "moves", "undecided"]

_CURE: Final = "give both a priority and let one reach a little into the other, or keep them apart"
_CLEAR: Final = 16.0 * ROUNDING
"""Of the way that rays come, along the normal: planes this far apart are met in their order."""
_REACH: Final = 16.0
"""Rays to the outer copy and to lamps come from within this multiple of a shape's largest coordinate."""
_MOST_SPHERES: Final = 2**18
_FEW: Final = 2**12
"""Most opaque faces of simple shapes that are searched for coincidences which nothing decides."""

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
    """

    first: _Floats
    second: _Floats
    undecided: list[tuple[int, int]] = field(default_factory=list)
    boundaries: list[tuple[int, int]] = field(default_factory=list)
    unknown: bool = False

    @property
    def any(self) -> bool:
        """Whether anything moves."""
        return bool(self.first.any() or self.second.any())


def moves(scene: Scene, surfaces: FlatSurfaces, spaces: Sequence[range]) -> Moves:
    """Find what touches, and decide it.

    Parameters
    ----------
    scene : Scene
    surfaces : FlatSurfaces
    spaces : sequence of range
        Ranges of shapes that have coordinates in common: those in world space, and those of each group.
    """
    total = int(surfaces.count.sum())
    result = Moves(np.zeros(total), np.zeros(total))
    kinds = np.array([_kind(scene, index) for index in range(len(surfaces.shapes))], np.int64)
    for space in spaces:
        here = np.zeros(len(kinds), bool)
        here[space.start : space.stop] = surfaces.count[space.start : space.stop] > 0
        if np.count_nonzero(here) > 1:
            _Space(scene, surfaces, np.where(here, kinds, 0), result).decide()
    return result


def undecided(scene: Scene, found: Moves) -> list[str]:
    """Sentences about what coincides without a rule that decides.

    Parameters
    ----------
    scene : Scene
    found : Moves
    """
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

    def __init__(self, scene: Scene, surfaces: FlatSurfaces, kinds: NDArray[np.int64], result: Moves) -> None:
        self._scene, self._surfaces, self._kinds, self._result = scene, surfaces, kinds, result
        self._faces = shape_faces(surfaces, kinds)
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
        everywhere = self._own.max(axis=0, initial=0.0) * 2.0
        self._far = np.minimum(everywhere, _REACH * self._own.max(axis=1, initial=0.0)[:, None])

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
        found = self._known(coplanar(solid, boundary))
        shape, other = solid.shape[found.first], boundary.shape[found.second]
        normal, inwards = np.abs(found.normal), ~found.same
        within, outside = np.zeros(len(self._kinds)), np.zeros(len(self._kinds))
        np.maximum.at(within, shape, found.gap + _CLEAR * inner(normal, self._own[other]))
        np.maximum.at(outside, shape, found.gap + _CLEAR * inner(normal, self._far[other]))
        row = solid.row[found.first]
        np.maximum.at(self._result.first, row, np.where(inwards, within[shape], outside[shape]))
        np.minimum.at(self._result.second, row, -np.where(inwards, outside[shape], within[shape]))

    def _lamps(self, lamp: Faces, opaque: Faces) -> None:
        """Faces of lamps move before, or behind, what is opaque in their planes."""
        found, lift = self._known(coplanar(lamp, opaque)), np.zeros(len(self._kinds))
        closed = self._closed[lamp.shape[found.first]]
        self._lift(lamp, opaque, found, np.where(found.same | ~closed, 1.0, -1.0), lift)
        found = self._known(coplanar_among(lamp))
        closed = self._closed[lamp.shape[found.first]]
        self._lift(lamp, lamp, found, np.where(found.same | ~closed, 1.0, -1.0), lift)
        apart = ~found.same
        back = Contacts(*(getattr(found, name)[apart] for name in Contacts.__annotations__))
        back = replace(back, first=back.second, second=back.first)
        self._lift(lamp, lamp, back, np.where(self._closed[lamp.shape[back.first]], -1.0, 1.0), lift)

    def _lift(self, lamp: Faces, other: Faces, found: Contacts, sign: _Floats, lift: _Floats) -> None:
        """Move the first face of each pair clear of the second, and all such faces of a lamp as far."""
        row, shape, partner = lamp.row[found.first], lamp.shape[found.first], other.row[found.second]
        reach = np.maximum(np.abs(self._result.first[partner]), np.abs(self._result.second[partner]))
        way = self._far[shape] + self._own[other.shape[found.second]]
        np.maximum.at(lift, shape, found.gap + reach + _CLEAR * inner(np.abs(found.normal), way))
        for chosen in (sign < 0.0, sign > 0.0):
            self._result.first[row[chosen]] = sign[chosen] * lift[shape[chosen]]
            self._result.second[row[chosen]] = self._result.first[row[chosen]]

    def _equal_spheres(self) -> None:
        """The front of an opaque sphere moves before a boundary that is the same sphere, and that of a lamp further."""
        rows, numbers = self._rounds, self._numbers
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
        found = self._known(coplanar_among(boundary))
        if len(found.first):
            pair = int(boundary.shape[found.first[0]]), int(boundary.shape[found.second[0]])
            self._result.boundaries.append(pair)
        simple = self._surfaces.count <= SIMPLE
        for index in np.flatnonzero(simple & self._closed).tolist():
            # Which side of a closed mesh is its front may not matter to whoever made it
            simple[index] = not isinstance(self._scene.plain_shapes[index], Mesh)
        some = opaque.at(simple[opaque.shape])
        if not 1 < len(some.row) <= _FEW:
            return
        found = self._known(coplanar_among(some))
        first, second = some.shape[found.first], some.shape[found.second]
        materials = self._surfaces.shapes["material"]
        meant = found.same & (materials[first] != materials[second])
        if meant.any():
            at = int(np.argmax(meant))
            self._result.undecided.append((int(first[at]), int(second[at])))


def _boxes(faces: Faces, shape: NDArray[np.int64], numbers: _Floats, count: int) -> tuple[_Floats, _Floats]:
    """Lowest and highest coordinates of each shape, (S, 3) each; of none, infinite."""
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, faces.shape, faces.corners.min(axis=1))
    np.maximum.at(high, faces.shape, faces.corners.max(axis=1))
    np.minimum.at(low, shape, numbers[:, :3] - numbers[:, 3:])
    np.maximum.at(high, shape, numbers[:, :3] + numbers[:, 3:])
    return low, high


def _closed(faces: Faces, count: int) -> NDArray[np.bool_]:
    """(S,) which shapes are closed: the areas of their faces, with their normals, cancel out."""
    area = np.cross(faces.corners[:, 1] - faces.corners[:, 0], faces.corners[:, 2] - faces.corners[:, 0])
    total, size = np.zeros((count, 3)), np.zeros(count)
    np.add.at(total, faces.shape, area)
    np.add.at(size, faces.shape, np.sqrt(inner(area, area)))
    return np.asarray(np.sqrt(inner(total, total)) <= 1e-3 * size)
