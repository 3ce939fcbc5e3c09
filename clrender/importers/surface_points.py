"""Points spread evenly over a scene's surfaces, from which a first view of it is chosen.

Points are equally far apart on the list of all triangles by area, and within triangles by the R2 sequence, so that two
loads of a scene have the same ones, on any machine. Of many triangles, shapes and instances some stand for all.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.matrices import lengths
from clrender.flatten.assembly import Assembly, assemble
from clrender.flatten.bounds import is_seen
from clrender.flatten.emission import shape_emission
from clrender.flatten.polyhedra import polyhedron
from clrender.flatten.tubes import curve_mesh
from clrender.image.tone_map import LUMINANCE
from clrender.importers.shared.meshes import disk_mesh, sphere_mesh
from clrender.meshes.data import MeshData
from clrender.scene import Mesh, Scene
from clrender.scene.shapes import Curves, Disk, Sphere
from clrender.scene.transforms import affine
from clrender.scene.values import Vector, cross, length

__all__ = ["SurfacePoints", "surface_points", "upright"]

Floats = NDArray[np.float64]
_COUNT: Final = 1 << 15
_MOST_SHAPES: Final = 4096
_MOST_TRIANGLES: Final = 1 << 18
"""Of all shapes together, about; each has as many of them."""
_LEAST_TRIANGLES: Final = 12
"""Of a mesh, if it has as many."""
_MOST_PLACES: Final = 256
"""Of a group."""
_R2: Final = (0.7548776662466927, 0.5698402909980532)
"""Steps of the R2 sequence (Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018)."""


@dataclass(frozen=True)
class SurfacePoints:
    """Points, each of which stands for the same area.

    Attributes
    ----------
    positions, normals : (N, 3) float64
        World space, metres; geometric normals, unit vectors on the front side.
    emitted : (N,) float64
        Luminance of the constant radiance emitted there, W/(sr m2).
    area : float
        Of all surfaces, square metres.
    corners : (T, 3, 3) float64
        Corners of the triangles on which they lie, or some of them.
    """

    positions: Floats
    normals: Floats
    emitted: Floats
    area: float
    corners: Floats

    def upright(self, up: str) -> SurfacePoints:
        """The same points in coordinates in which y is up and z points to the front."""
        return replace(self, positions=upright(self.positions, up), normals=upright(self.normals, up))


def upright(vectors: Floats, up: str) -> Floats:
    """Vectors, (..., 3), of a model whose axis `up` (``y`` or ``z``) is upward, with y up and z to the front."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    return vectors if up == "y" else np.stack([x, z, -y], axis=-1)


def surface_points(scene: Scene) -> SurfacePoints:
    """Points on the surfaces of a scene; none if all are transparent or flattened.

    Parameters
    ----------
    scene : Scene
        With its files.
    """
    assembly = assemble(scene)
    corners, weights, emitted = _gathered(assembly)
    across = [corners[:, k] - corners[:, 0] for k in (1, 2)]
    normals = np.stack(
        [across[0][:, i] * across[1][:, j] - across[0][:, j] * across[1][:, i] for i, j in ((1, 2), (2, 0), (0, 1))], 1
    )
    sizes = lengths(normals)
    sums = np.cumsum(0.5 * sizes * weights)
    if not len(sums) or not 0.0 < sums[-1] < np.inf:
        none = np.zeros((0, 3))
        return SurfacePoints(none, none, np.zeros(0), 0.0, corners)
    at = (np.arange(_COUNT) + 0.5) / _COUNT * sums[-1]
    chosen = np.minimum(np.searchsorted(sums, at, side="right"), len(sums) - 1)
    u, v = ((0.5 + step * np.arange(_COUNT)) % 1.0 for step in _R2)
    outside = u + v > 1.0
    u, v = np.where(outside, 1.0 - u, u)[:, None], np.where(outside, 1.0 - v, v)[:, None]
    positions = (corners[chosen, 0] + u * across[0][chosen]) + v * across[1][chosen]
    return SurfacePoints(positions, normals[chosen] / sizes[chosen, None], emitted[chosen], float(sums[-1]), corners)


def _spread(count: int, most: int) -> tuple[slice, float]:
    """Which of so many things stand for all, at most so many, and for how many each does."""
    step = max(1, -(-count // most))
    return slice(None, None, step), count / max(1, -(-count // step))


def _gathered(assembly: Assembly) -> tuple[Floats, Floats, Floats]:
    """(T, 3, 3) corners of triangles in world space; (T,) how many each stands for, and their emission."""
    corners, weights, emitted = [np.zeros((0, 3, 3))], [np.zeros(0)], [np.zeros(0)]

    def add(every: range, maps: Any, weight: float) -> None:
        some, more = _spread(len(every), _MOST_SHAPES)
        most = _MOST_TRIANGLES // max(1, len(every[some]) * len(maps))
        for triangles, number, shines in _triangles(assembly.scene, every[some], max(most, _LEAST_TRIANGLES)):
            for each in maps:
                placed = triangles if each is None else _mapped(each, triangles)
                corners.append(placed)
                weights.append(np.full(len(placed), number * more * weight))
                emitted.append(np.full(len(placed), shines))

    add(range(assembly.own_shapes), [None], 1.0)
    for group, shapes in enumerate(assembly.groups):
        maps = assembly.maps[assembly.group_of == group]
        some, weight = _spread(len(maps), _MOST_PLACES)
        add(shapes, maps[some], weight)
    return np.concatenate(corners), np.concatenate(weights), np.concatenate(emitted)


def _mapped(matrix: Floats, triangles: Floats) -> Floats:
    x, y, z = triangles[..., 0], triangles[..., 1], triangles[..., 2]
    return np.stack([((row[0] * x + row[1] * y) + row[2] * z) + row[3] for row in matrix], axis=-1)


def _triangles(scene: Scene, shapes: Sequence[int], most: int) -> Iterator[tuple[Floats, float, float]]:
    """Of each visible shape: (T, 3, 3) corners, how many triangles each stands for, and its emission."""
    for index in shapes:
        shape = scene.plain_shapes[index]
        if not is_seen(scene, shape):
            continue
        if isinstance(shape, Sphere | Disk):
            mesh = _rounded(shape)
        elif isinstance(shape, Curves):
            mesh = curve_mesh(shape, scene.strands(scene.place_of(index), shape), scene.source, 1, 3)
        else:
            mesh = scene.mesh(index) if isinstance(shape, Mesh) else polyhedron(shape)
        some, weight = _spread(len(mesh.triangles), most)
        place = affine(shape.transform)
        matrix = np.column_stack([np.array(place.linear), np.array(place.offset)])
        found = shape_emission(scene, index)
        shines = 0.0 if found is None else sum(a * b for a, b in zip(LUMINANCE, found.constant, strict=True))
        yield _mapped(matrix, np.asarray(mesh.vertices[mesh.triangles[some]], np.float64)), weight, shines


@cache
def _units() -> tuple[MeshData, MeshData]:
    return sphere_mesh(1.0), disk_mesh(1.0)


def _rounded(shape: Sphere | Disk) -> MeshData:
    """A sphere or disk as triangles."""
    sphere, disk = _units()
    if isinstance(shape, Sphere):
        return replace(sphere, vertices=shape.radius * sphere.vertices + np.array(shape.center))
    size = length(shape.normal)
    normal: Vector = tuple(x / size for x in shape.normal)  # type: ignore[assignment]
    least = min(range(3), key=lambda axis: abs(normal[axis]))
    across = cross(normal, (float(least == 0), float(least == 1), float(least == 2)))
    across = tuple(x / length(across) for x in across)  # type: ignore[assignment]
    x, y, _ = shape.radius * disk.vertices.T
    vertices = (x[:, None] * np.array(across) + y[:, None] * np.array(cross(normal, across))) + np.array(shape.center)
    return replace(disk, vertices=vertices)
