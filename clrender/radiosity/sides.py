"""Sides of patches: which are needed, their emission, and their uncovered fractions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.matrices import length
from clrender.flatten.lamps import AT_POINT
from clrender.radiosity.patches import Patches
from clrender.scene.description import DirectionalLight
from clrender.scene.shapes import Box, Shape, Sphere, Tetrahedron

if TYPE_CHECKING:
    from clrender.flatten.flat_scene import FlatScene
    from clrender.radiosity.tracer import Tracer

__all__ = [
    "box_around",
    "carried_radiance",
    "covered_rays",
    "first_sides",
    "importance",
    "is_convex",
    "largest",
    "lifted",
    "light_boxes",
    "lights_differ",
    "own_radiance",
    "reaches_inside",
    "sealed_sides",
    "side_areas",
    "traced_sides",
]

_BOX_MARGIN: Final = 1e-4
_CLOSED: Final = (Sphere, Box, Tetrahedron)
_NEAR: Final = 0.25
"""Fraction of the scene's diagonal within which importance no longer grows towards the observer."""

_Floats = NDArray[np.float64]
_Uints = NDArray[np.uint32]


def own_radiance(patches: Patches) -> _Floats:
    """(2 n + 1, 3): emitted radiance of sides, and last that of the environment."""
    own = np.zeros((2 * len(patches) + 1, 3))
    own[:-1:2] = patches.emission
    own[-1] = patches.environment
    return own


def carried_radiance(patches: Patches) -> _Floats:
    """The part of `own_radiance` that form factors carry; shadow rays sample the rest."""
    own = own_radiance(patches)
    if patches.shadow_rays_find_emission:
        own[:-1] = 0.0
    return own


def side_areas(patches: Patches) -> _Floats:
    """(2 n + 1,) float64; 0 for the environment."""
    return np.append(np.repeat(patches.areas, 2), 0.0)


def sealed_sides(patches: Patches) -> NDArray[np.bool_]:
    """Sides that face the dark interior of a closed shape: (2 n + 1,) bool.

    Spheres, boxes and tetrahedra are closed; their interior is dark if neither the camera nor any emitter extends into
    their bounding box.
    """
    sealed = np.zeros(2 * len(patches) + 1, bool)
    scene = patches.scene
    spans = [tuple(side // 2 for side in patches.sides_of(shape)) for shape in range(len(scene.shapes))]
    lows, highs = patches.boxes
    points = [light.position for light in scene.lights if isinstance(light, AT_POINT)]
    points.append(scene.camera.position)
    reach = scene.camera.reach
    for index, shape in enumerate(scene.shapes):
        if not isinstance(shape, _CLOSED) or shape.flip_normals:
            continue
        low, high = lows[index], highs[index]
        open_ = any(((np.array(p) >= low - reach) & (np.array(p) <= high + reach)).all() for p in points)
        for other, source in enumerate(scene.shapes):
            if other != index and source.emission is not None:
                open_ = open_ or bool(((lows[other] <= high) & (highs[other] >= low)).all())
        if not open_:
            sealed[2 * spans[index][0] + 1 : 2 * spans[index][1] : 2] = True
    return sealed


def is_convex(shape: Shape) -> bool:
    """Whether rays that leave the front of the shape's patches cannot hit it again."""
    return isinstance(shape, _CLOSED) and not shape.flip_normals


def reaches_inside(patches: Patches, shape: int) -> bool:
    """Whether a shape may intersect another, and one of them is a box or tetrahedron."""
    lows, highs = patches.boxes
    near = ((lows <= highs[shape]) & (highs >= lows[shape])).all(axis=1)
    shapes = patches.scene.shapes
    for other in np.flatnonzero(near):
        flat = any(isinstance(shapes[each], Box | Tetrahedron) for each in (shape, other))
        if other != shape and flat and not _apart(patches, shape, int(other)):
            return True
    return False


def _apart(patches: Patches, *pair: int) -> bool:
    """Whether a face of one of two shapes, or a plane across the line between their centres, separates them."""
    ranges = [slice(*(side // 2 for side in patches.sides_of(shape))) for shape in pair]
    points = [patches.corners[each].reshape(-1, 3) for each in ranges]
    axes = [(points[1].mean(axis=0) - points[0].mean(axis=0))[None]]
    for shape, each in zip(pair, ranges, strict=True):
        if isinstance(patches.scene.shapes[shape], Box | Tetrahedron):
            axes.append(np.unique(np.round(patches.normals[each], 6), axis=0))
    for x, y, z in np.concatenate(axes):
        one, two = ((p[:, 0] * x + p[:, 1] * y) + p[:, 2] * z for p in points)
        if one.max() <= two.min() or two.max() <= one.min():
            return True
    return False


def covered_rays(hits: _Uints, sealed: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Number of rays of each side that start inside a closed shape standing on it.

    That part of the side receives no light and is not visible: the side's radiance is that of its uncovered part.

    Parameters
    ----------
    hits : (r, rays) uint32
        A ray that hits a sealed side started in the covered part.
    sealed : (2 n + 1,) bool

    Returns
    -------
    (r,) int64
    """
    if not sealed.any():
        return np.zeros(len(hits), np.int64)
    covered: NDArray[np.int64] = np.count_nonzero(sealed[hits], axis=1).astype(np.int64)
    return covered


def lifted(reflectance: _Floats, share: _Floats) -> _Floats:
    """Reflectance that relates the mean irradiance of a whole side to the radiance of its uncovered part."""
    up: _Floats = np.divide(reflectance, share[:, None], out=np.zeros_like(reflectance), where=share[:, None] > 0.0)
    return up


def first_sides(patches: Patches, sealed: NDArray[np.bool_] | None = None) -> _Uints:
    """All fronts, and the backs that the camera may see; pass `sealed` if it is known."""
    camera = patches.scene.camera
    x, y, z = (patches.centers - np.array(camera.position)).T
    normal_x, normal_y, normal_z = patches.normals.T
    used = np.zeros(2 * len(patches), bool)
    used[::2] = True
    used[1::2] = (x * normal_x + y * normal_y) + z * normal_z > -camera.reach
    return np.flatnonzero(used & ~(sealed_sides(patches) if sealed is None else sealed)[:-1]).astype(np.uint32)


def traced_sides(tracer: Tracer, sides: _Uints, known: NDArray[np.bool_]) -> tuple[_Uints, _Uints]:
    """Rays from these sides, and from every side that they see.

    Parameters
    ----------
    tracer : Tracer
    sides : (k,) uint32
        Ascending.
    known : (2 n + 1,) bool
        Sides whose rays are already traced, or need not be.

    Returns
    -------
    sides : (r,) uint32
        Ascending.
    hits : (r, rays) uint32
    """
    hits = tracer.hits(sides)
    while True:
        seen = np.zeros(tracer.outside + 1, bool)
        seen[hits] = True
        seen[sides] = False
        seen &= ~known
        new = np.flatnonzero(seen[:-1]).astype(np.uint32)
        if not len(new):
            return sides, hits
        every = np.concatenate([sides, new])
        order = np.argsort(every, kind="stable")
        sides, hits = every[order], np.concatenate([hits, tracer.hits(new)])[order]


def importance(patches: Patches) -> _Floats:
    """Importance to the observer, (2 n,) float64: 1 nearby, falling with the square of the distance."""
    spans = patches.corners.reshape(-1, 3).max(axis=0) - patches.corners.reshape(-1, 3).min(axis=0)
    near = _NEAR * length(spans)
    x, y, z = (patches.centers - np.array(patches.scene.camera.position)).T
    return np.repeat(np.minimum(1.0, near * near / np.maximum((x * x + y * y) + z * z, 1e-30)), 2)


def box_around(patches: Patches, moved: tuple[int, int]) -> NDArray[np.float32]:
    """(6,): bounds of a shape's patches, with a margin for rounding."""
    corners = patches.corners[moved[0] // 2 : moved[1] // 2].reshape(-1, 3)
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = _BOX_MARGIN * max(float((high - low).max()), float(np.abs(corners).max()) * 1e-2)
    return np.concatenate([low - margin, high + margin]).astype(np.float32)


def light_boxes(patches: Patches) -> NDArray[np.float32]:
    """(k, 6): bounds of the targets of shadow rays; of the whole scene for lights at infinity."""
    scene = patches.scene
    boxes = [
        box_around(patches, patches.sides_of(shape))
        for shape, each in enumerate(scene.shapes)
        if each.emission is not None and patches.shadow_rays_find_emission
    ]
    for light in scene.lights:
        if isinstance(light, AT_POINT):
            place = np.array(light.position)
            margin = _BOX_MARGIN * max(float(np.abs(place).max()), 1e-6)
            boxes.append(np.concatenate([place - margin, place + margin]).astype(np.float32))
        elif isinstance(light, DirectionalLight):
            boxes.append(np.repeat(np.array([-1e30, 1e30], np.float32), 3))
    return np.stack(boxes) if boxes else np.zeros((1, 6), np.float32)


def lights_differ(before: FlatScene, after: FlatScene) -> bool:
    """Whether the distribution from which shadow rays pick a light has changed."""
    return any(not np.array_equal(before.arrays[n], after.arrays[n]) for n in ("lights", "light_nodes", "light_order"))


def largest(radiance: _Floats) -> _Floats:
    """Largest magnitude of each row; column by column, which is faster than NumPy's reduction of a short axis."""
    size = np.abs(radiance)
    most: _Floats = np.maximum(np.maximum(size[:, 0], size[:, 1]), size[:, 2])
    return most
