"""Patches with textured reflectance: their texture coordinates and mean reflectance."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.flatten.surface_arrays import FlatSurfaces
from clrender.flatten.surfaces import flat_surfaces
from clrender.flatten.texture_integrals import reflectance_means
from clrender.flatten.texture_means import TextureMeans
from clrender.flatten.texture_rows import flat_textures
from clrender.radiosity.vectors import cross, dot
from clrender.scene.description import Scene
from clrender.scene.materials import material_textures

__all__ = ["patch_coordinates", "patch_reflectance", "textured_shapes"]

_TURN: Final = (
    -6.45303749e-4, 3.47959646e-3, -8.89872294e-3, 1.53460354e-2, -2.21362729e-2, 3.17459442e-2, -5.30461222e-2,
    1.59154832e-1,
)  # fmt: skip
"""atan(x) / 2π over x, in powers of x², as in kernels/texture/mapping.h: libraries differ in theirs."""
_POLE: Final = 1e-6
"""Fraction of a sphere's radius: this close to the axis, longitude is undefined."""

_Floats = NDArray[np.float64]


def textured_shapes(scene: Scene) -> NDArray[np.bool_]:
    """(s,) bool: which shapes have a material with a texture."""
    materials = [shape.material for shape in scene.shapes]
    return np.array(
        [m is not None and any(True for _ in material_textures(scene.materials, m)) for m in materials], bool
    )


def patch_coordinates(
    scene: Scene, corners: _Floats, shape: NDArray[np.int64], primitive: NDArray[np.int64]
) -> _Floats:
    """Texture coordinates of the corners of patches: (2, n, 3, 2) float64, both sets; zero for untextured shapes.

    They are linear over a patch, which is exact on triangles and disks, and an approximation on spheres. A patch that
    the seam crosses has longitudes beyond 1; a corner at a pole takes the mean longitude of the others. For the
    parameters see `clrender.radiosity.patches.Patches`.
    """
    surfaces = flat_surfaces(scene)
    uvs = np.zeros((2, len(corners), 3, 2))
    flat = primitive < len(surfaces.triangles)
    textured = textured_shapes(scene)[shape]
    for which, fill in ((textured & flat, _on_triangles), (textured & ~flat, _on_rounds)):
        some = np.flatnonzero(which)
        if len(some):
            fill(surfaces, corners[some], primitive[some], some, uvs)
    return uvs


def _on_triangles(
    surfaces: FlatSurfaces, corners: _Floats, primitive: NDArray[np.int64], some: NDArray[np.int64], uvs: _Floats
) -> None:
    whole = surfaces.vertices[surfaces.triangles[primitive]].astype(np.float64)
    ab, ac = whole[:, 1] - whole[:, 0], whole[:, 2] - whole[:, 0]
    normal = cross(ab, ac)
    square = dot(normal, normal)
    rows = surfaces.attributes[primitive].astype(np.float64)
    for corner in range(3):
        to = corners[:, corner] - whole[:, 0]
        b, c = dot(cross(to, ac), normal) / square, dot(cross(ab, to), normal) / square
        for number in (0, 1):
            at, to_b, to_c = (rows[:, 6 * number + 2 * k : 6 * number + 2 * k + 2] for k in range(3))
            uvs[number, some, corner] = at + b[:, None] * (to_b - at) + c[:, None] * (to_c - at)


def _on_rounds(
    surfaces: FlatSurfaces, corners: _Floats, primitive: NDArray[np.int64], some: NDArray[np.int64], uvs: _Floats
) -> None:
    shapes = surfaces.analytic_shapes[primitive - len(surfaces.triangles)]
    center = shapes["center_radius"].astype(np.float64)
    axes = surfaces.attributes[primitive, :9].astype(np.float64)
    out = (corners - center[:, None, :3]) / center[:, None, 3:]
    x, y, z = (
        out[..., 0] * axes[:, None, k] + out[..., 1] * axes[:, None, k + 1] + out[..., 2] * axes[:, None, k + 2]
        for k in (0, 3, 6)
    )
    level = np.sqrt(x * x + z * z)
    longitude, latitude = _turn(x, z) + 0.5, _turn(y, level) * 2.0 + 0.5
    pole = level < _POLE
    first = np.where(pole, -1.0, longitude).max(axis=1)[:, None]
    longitude = np.where(longitude < first - 0.5, longitude + 1.0, longitude)
    others = np.where(pole, 0.0, longitude).sum(axis=1) / np.maximum((~pole).sum(axis=1), 1)
    longitude = np.where(pole, others[:, None], longitude)
    disk = np.any(shapes["normal"][:, :3] != 0.0, axis=1, keepdims=True)
    u, v = np.where(disk, x * 0.5 + 0.5, longitude), np.where(disk, y * 0.5 + 0.5, latitude)
    uvs[:, some] = np.stack([u, v], axis=-1)


def _turn(y: _Floats, x: _Floats) -> _Floats:
    """The angle of (x, y), in turns from -1/2 to 1/2; 0 at the origin."""
    ax, ay = np.abs(x), np.abs(y)
    high, low = np.maximum(ax, ay), np.minimum(ax, ay)
    ratio = low / np.where(high > 0.0, high, 1.0)
    square, p = ratio * ratio, np.full_like(ratio, _TURN[0])
    for factor in _TURN[1:]:
        p = p * square + factor
    eighth = p * ratio
    quarter = np.where(ay > ax, 0.25 - eighth, eighth)
    half = np.where(x < 0.0, 0.5 - quarter, quarter)
    return np.where(y < 0.0, -half, half)


def patch_reflectance(
    scene: Scene, shape: NDArray[np.int64], coordinates: _Floats, known: _Floats, which: NDArray[np.bool_]
) -> _Floats:
    """Mean reflectance of each patch.

    Parameters
    ----------
    scene : Scene
    shape : (n,) int64
        Shape of each patch.
    coordinates : (2, n, 3, 2) float64
        As of `patch_coordinates`.
    known : (n, 3) float64
        Reflectance of the untextured patches.
    which : (n,) bool
        Textured patches.

    Returns
    -------
    (n, 3) float64
    """
    textures = flat_textures(scene)
    slots = textures.slots.view(np.uint32)[:, layout.TEXTURE_SLOTS["BASE_COLOR"]]
    numbers = {name: int(slots[number]) for number, name in enumerate(scene.materials)}
    of = np.array([-1 if s.material is None else numbers[s.material] for s in scene.shapes])
    of[~textured_shapes(scene)] = -1
    means = known.copy()
    for number in np.unique(of[of >= 0]).tolist():
        some = np.flatnonzero((of == number)[shape] & which)
        texture = TextureMeans(textures, number)
        means[some] = reflectance_means(texture, coordinates[texture.uv_set, some])
    return means
