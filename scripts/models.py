"""What the scripts that make meshes share: meshes of whole numbers, vectors, tubes and surfaces of revolution.

Whole numbers keep the files small; scenes scale them by the unit of each `Model`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Final

import numpy as np
from make_meshes import lathe, vertex_normals, write_or_compare
from numpy.typing import NDArray

from clrender.exact.angles import sin_cos_degrees

__all__ = [
    "BRICK",
    "PLAIN",
    "STONE",
    "Chance",
    "Color",
    "Facets",
    "Model",
    "Outline",
    "Vector",
    "across",
    "arc",
    "cross",
    "plus",
    "tube",
    "turned",
    "turned_on_a_lathe",
    "unit",
    "write_models",
]

Vector = tuple[float, float, float]
Color = tuple[int, int, int]
Outline = list[tuple[float, float]]
"""Points (radius, height) of the profile of a surface of revolution, counter-clockwise from axis to axis."""
_TYPES: Final = {"<i2": "short", "i1": "char", "u1": "uchar"}
_UP: Final = (0.0, 1.0, 0.0)
STONE: Final = (132, 126, 116)
BRICK: Final = 0.0625
"""Metres for each step of a texture coordinate: the texture of 16 steps is a square metre of bricks."""
PLAIN: Final = (1, 1)
"""Texture coordinates of the middle of a white brick of `bricks.png`, for what is not of brick."""


class Chance:
    """Random numbers that are independent of library versions."""

    def __init__(self, seed: int) -> None:
        self.state = seed

    def __call__(self, low: float, high: float) -> float:
        """A number from `low` to `high`."""
        self.state = (self.state * 6364136223846793005 + 1442695040888963407) % 2**64
        return low + (high - low) * (self.state >> 11) / 2.0**53


class Model:
    """A mesh of 16-bit numbers, with or without normals, texture coordinates and colours (sRGB).

    Parameters
    ----------
    unit : float
        Unit of coordinates, metres.
    normal_bits : int
        Bits of each component of a normal: 8 or 16.
    """

    def __init__(self, unit: float, normal_bits: int = 8) -> None:
        self.unit = unit
        self.largest = 2 ** (normal_bits - 1) - 1
        self.points: list[Vector] = []
        self.normals: list[Vector] = []
        self.uvs: list[tuple[int, int]] = []
        self.colors: list[tuple[int, int, int]] = []
        self.faces: list[tuple[int, ...]] = []

    def add(self, points: Sequence[Vector], faces: Sequence[Sequence[int]]) -> None:
        """Add vertices, and triangles whose indices into them start from 0."""
        first = len(self.points)
        self.points += points
        self.faces += [tuple(first + corner for corner in face) for face in faces]

    def add_arrays(self, vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> None:
        """Add a mesh with smooth normals."""
        x, y, z = vertex_normals(vertices, triangles).T.tolist()
        self.normals += list(zip(x, y, z, strict=True))
        x, y, z = vertices.T.tolist()
        self.add(list(zip(x, y, z, strict=True)), triangles.tolist())

    def ply(self) -> bytes:
        """A binary PLY file."""
        names = ["x", "y", "z"]
        columns = np.array(self.points) / self.unit
        if self.normals:
            names += ["nx", "ny", "nz"]
            columns = np.hstack([columns, np.array(self.normals) * self.largest])
        kinds = [(name, "<i2" if name in "xyz" or self.largest > 127 else "i1") for name in names]
        if self.uvs:
            columns = np.hstack([columns, np.array(self.uvs)])
            kinds += [("s", "u1"), ("t", "u1")]
        if self.colors:
            columns = np.hstack([columns, np.array(self.colors)])
            kinds += [("red", "u1"), ("green", "u1"), ("blue", "u1")]
        properties = "".join(f"property {_TYPES[kind]} {name}\n" for name, kind in kinds)
        whole = np.floor(columns + 0.5)
        if abs(whole).max() > 32767 or len(whole) > 65535:
            raise ValueError("the model is too large for numbers of 16 bits")
        records = np.empty(len(whole), dtype=kinds)
        for name, column in zip([name for name, _ in kinds], whole.T, strict=True):
            records[name] = column
        faces = np.empty(len(self.faces), dtype=[("count", "u1"), ("corners", "<u2", 3)])
        faces["count"], faces["corners"] = 3, self.faces
        header = (
            f"ply\nformat binary_little_endian 1.0\nelement vertex {len(records)}\n{properties}"
            f"element face {len(faces)}\nproperty list uchar ushort vertex_indices\nend_header\n"
        )
        return header.encode() + records.tobytes() + faces.tobytes()


class Facets(Model):
    """A flat-shaded mesh with a colour and texture coordinates for each vertex."""

    def __init__(self) -> None:
        super().__init__(1e-3)
        self.color: Color = STONE
        self.spot: tuple[int, int] | None = PLAIN

    def facet(self, *corners: Vector) -> None:
        """Add a convex polygon, counter-clockwise from in front, with courses of bricks where no spot is set."""
        self.add(corners, [(0, i, i + 1) for i in range(1, len(corners) - 1)])
        self.colors += [self.color] * len(corners)
        for x, y, z in corners:
            along, up = (x if abs(z) < 3.0 else -z), y
            if all(corner[1] == y for corner in corners):
                along, up = z, x
            bricks = (round(along / BRICK) % 256, round(up / BRICK) % 256)
            self.uvs.append(self.spot or bricks)

    def box(self, low: Vector, high: Vector) -> None:
        """Add a box without its back, which is at the lowest z."""
        (a, b, c), (d, e, f) = low, high
        self.facet((a, b, f), (d, b, f), (d, e, f), (a, e, f))
        self.facet((a, e, f), (d, e, f), (d, e, c), (a, e, c))
        self.facet((a, b, c), (d, b, c), (d, b, f), (a, b, f))
        self.facet((a, b, c), (a, b, f), (a, e, f), (a, e, c))
        self.facet((d, b, f), (d, b, c), (d, e, c), (d, e, f))

    def prism(self, outline: Sequence[tuple[float, float]], back: float, front: float) -> None:
        """Add an outline in x and y, counter-clockwise and a star about its first point, from `back` to `front`."""
        first = outline[0]
        for (ax, ay), (bx, by) in itertools.pairwise(outline[1:]):
            self.facet((first[0], first[1], front), (ax, ay, front), (bx, by, front))
            self.facet((first[0], first[1], back), (bx, by, back), (ax, ay, back))
        for (ax, ay), (bx, by) in zip(outline, [*outline[1:], outline[0]], strict=True):
            self.facet((ax, ay, front), (ax, ay, back), (bx, by, back), (bx, by, front))


# --- vectors: plain numbers, added in the order that is written -------------------------------------------------------


def plus(a: Vector, b: Vector, times: float = 1.0) -> Vector:
    """a + b · times"""
    return (a[0] + b[0] * times, a[1] + b[1] * times, a[2] + b[2] * times)


def unit(a: Vector) -> Vector:
    """The direction of a vector."""
    size = math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
    return (a[0] / size, a[1] / size, a[2] / size)


def cross(a: Vector, b: Vector) -> Vector:
    """a × b"""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def across(a: Vector) -> tuple[Vector, Vector]:
    """Unit vectors perpendicular to a unit vector and each other; the first is horizontal unless `a` is vertical."""
    first = unit(cross(a, _UP) if abs(a[1]) < 0.99 else cross(a, (0.0, 0.0, 1.0)))
    return first, cross(first, a)


def turned(a: Vector, angle: float, around: float) -> Vector:
    """A unit vector rotated by whole degrees, towards the azimuth `around`."""
    (s, c), (sine, cosine) = sin_cos_degrees(round(angle)), sin_cos_degrees(round(around))
    u, v = across(a)
    return unit(plus(plus((a[0] * c, a[1] * c, a[2] * c), u, s * cosine), v, s * sine))


# --- shapes ---


def tube(model: Model, nodes: Sequence[Vector], radius: float, sides: int = 6) -> None:
    """Add a round tube along a polyline, with smooth normals and open ends."""
    points, faces = [], []
    u: Vector | None = None
    for number, center in enumerate(nodes):
        ahead, behind = nodes[min(number + 1, len(nodes) - 1)], nodes[max(number - 1, 0)]
        axis = unit(plus(ahead, behind, -1.0))
        # From ring to ring it turns no more than the axis does, so that the tube is not twisted
        u = across(axis)[0] if u is None else unit(plus(u, axis, -(u[0] * axis[0] + u[1] * axis[1] + u[2] * axis[2])))
        v = cross(u, axis)
        for i in range(sides):
            s, c = sin_cos_degrees(360.0 * i / sides)
            normal = plus((u[0] * c, u[1] * c, u[2] * c), v, s)
            points.append(plus(center, normal, radius))
            model.normals.append(normal)
            j, here, there = (i + 1) % sides, sides * number, sides * (number + 1)
            if number < len(nodes) - 1:
                faces += [(here + i, there + j, here + j), (here + i, there + i, there + j)]
    model.add(points, faces)


def arc(x: float, y: float, radius: float, first: float, last: float, parts: int) -> Outline:
    """Points on a circle, from one angle to another."""
    angles = [sin_cos_degrees(first + (last - first) * i / parts) for i in range(parts + 1)]
    return [(x + radius * c, y + radius * s) for s, c in angles]


def turned_on_a_lathe(outline: Outline, segments: int = 64, step: float = 1e-5) -> Model:
    """A vessel as a surface of revolution of its outline."""
    model = Model(step, normal_bits=16)
    model.add_arrays(*lathe(outline, segments))
    return model


def write_models(description: str, models: Mapping[str, Callable[[], Model]]) -> int:
    """Write the files of these models in scenes/, or with ``--check`` compare them; returns the exit code."""

    def ply(make: Callable[[], Model]) -> bytes:
        return make().ply()

    return write_or_compare(description, {name: partial(ply, make) for name, make in models.items()})
