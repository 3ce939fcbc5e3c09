"""Writes the plants, vessels and the rotunda in scenes/: mesh files of whole numbers, which keeps them small.

They are committed, and the same bytes come out on every machine. Run ``python scripts/make_models.py`` to write them,
with ``--check`` to compare them with the committed ones. Scenes scale them by the unit of each `Model`.
"""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Final

import numpy as np
from make_meshes import lathe, vertex_normals, write_or_compare
from numpy.typing import NDArray

from clrender.exact.angles import sin_cos_degrees

__all__ = ["MODELS", "Chance", "Model"]

Vector = tuple[float, float, float]
_TYPES: Final = {"<i2": "short", "i1": "char", "u1": "uchar"}
_UP: Final = (0.0, 1.0, 0.0)


class Chance:
    """Random numbers that are independent of library versions."""

    def __init__(self, seed: int) -> None:
        self.state = seed

    def __call__(self, low: float, high: float) -> float:
        """A number from `low` to `high`."""
        self.state = (self.state * 6364136223846793005 + 1442695040888963407) % 2**64
        return low + (high - low) * (self.state >> 11) / 2.0**53


class Model:
    """A mesh of 16-bit numbers, with texture coordinates or normals, or neither.

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


# --- plants -----------------------------------------------------------------------------------------------------------

_PARTS: Final = (9, 6, 3, 1)
"""Number of straight segments of trunk, limbs, branches and twigs."""
_SIDES: Final = (9, 6, 4, 3)
_BRANCHES: Final = (13, 8, 5, 0)
"""Number of children of each of these."""
_BEND: Final = (0.07, 0.16, 0.2, 0.2)
_RISE: Final = (0.1, 0.07, 0.02, -0.05)


class Tree:
    """A small broad-leaved tree, 3 m high: its wood, and its leaves, which are squares folded along a diagonal."""

    def __init__(self) -> None:
        self.wood, self.leaves = Model(1e-4), Model(1e-4)
        self.chance = Chance(5)
        self.grow(0, (0.0, -0.05, 0.0), _UP, 2.05, 0.07)

    def grow(self, level: int, start: Vector, direction: Vector, length: float, radius: float) -> None:
        """Grow the wood of one level, and everything on it."""
        chance, parts = self.chance, _PARTS[level]
        nodes = [(start, direction)]
        for _ in range(parts):
            bend = (chance(-1.0, 1.0), chance(-1.0, 1.0), chance(-1.0, 1.0))
            direction = unit(plus(plus(direction, bend, _BEND[level]), _UP, _RISE[level]))
            nodes.append((plus(nodes[-1][0], direction, length / parts), direction))
        self.tube(nodes, radius, _SIDES[level])
        count = _BRANCHES[level]
        first = (0.4, 0.22, 0.15, 0.0)[level]
        for i in range(count):
            at = first + (1.0 - first) * (i + chance(0.3, 0.9)) / count
            part = min(int(at * parts), parts - 1)
            point = plus(nodes[part][0], nodes[part + 1][1], (at * parts - part) * length / parts)
            away = turned(nodes[part + 1][1], chance(58.0, 80.0) - 30.0 * at, i * 137.5 + chance(-25.0, 25.0))
            size = (1.55 * (1.0 - 0.55 * at), length * 0.55 * (1.15 - 0.6 * at), 0.2, 0.0)[level] * chance(0.8, 1.2)
            self.grow(level + 1, point, away, size, radius * (0.55 - 0.2 * at))
        if level >= 2:
            leaves = (3, 7)[level - 2]
            for i in range(leaves):
                at = (i + 1.0) / leaves
                part = min(int(at * parts), parts - 1)
                point = plus(nodes[part][0], nodes[part + 1][1], (at * parts - part) * length / parts)
                angle = 20.0 if i == leaves - 1 else chance(45.0, 75.0)
                self.leaf(
                    point, turned(nodes[part + 1][1], angle, 180.0 * i + chance(-50.0, 50.0)), chance(0.07, 0.105)
                )

    def tube(self, nodes: Sequence[tuple[Vector, Vector]], radius: float, sides: int) -> None:
        """Add rings around the nodes, ever thinner, and a point at the end."""
        points, faces = [], []
        for number, (center, direction) in enumerate(nodes[:-1]):
            u, v = across(direction)
            size = radius * (1.0 - 0.75 * number / (len(nodes) - 1))
            if number == 0 and sides == _SIDES[0]:
                size *= 1.5  # where the roots begin
            for i in range(sides):
                s, c = sin_cos_degrees(round(360.0 * i / sides))
                normal = plus((u[0] * c, u[1] * c, u[2] * c), v, s)
                points.append(plus(center, normal, size))
                self.wood.normals.append(normal)
                j = (i + 1) % sides
                here, above = sides * number, sides * (number + 1)
                if number < len(nodes) - 2:
                    faces += [(here + i, above + i, above + j), (here + i, above + j, here + j)]
                else:
                    faces.append((here + i, above, here + j))
        points.append(nodes[-1][0])
        self.wood.normals.append(nodes[-1][1])
        self.wood.add(points, faces)

    def leaf(self, base: Vector, axis: Vector, size: float) -> None:
        """Add a leaf whose midrib is the diagonal of the texture."""
        axis = unit(plus(axis, _UP, -0.25))
        side, normal = across(axis)
        s, c = sin_cos_degrees(round(self.chance(-50.0, 50.0)))
        side, normal = (
            plus((side[0] * c, side[1] * c, side[2] * c), normal, s),
            plus((normal[0] * c, normal[1] * c, normal[2] * c), side, -s),
        )
        middle = plus(plus(base, axis, 0.5 * size), normal, 0.1 * size)
        right, left = plus(middle, side, 0.5 * size), plus(middle, side, -0.5 * size)
        self.leaves.add([base, right, plus(base, axis, size), left], [(0, 1, 2), (0, 2, 3)])
        self.leaves.uvs += [(0, 0), (1, 0), (1, 1), (0, 1)]


def meadow() -> Model:
    """4 × 4 m of tufts: upright textured quads, one in nine with daisies, which are the texture's second half."""
    model, chance = Model(1e-4), Chance(11)
    cells = 34
    for number in range(cells * cells):
        x, z = ((n + chance(0.0, 1.0)) / cells * 4.0 - 2.0 for n in divmod(number, cells))
        s, c = sin_cos_degrees(round(chance(0.0, 360.0)))
        half, height = chance(0.08, 0.14), chance(0.09, 0.19)
        lean = (chance(-0.05, 0.05), height, chance(-0.05, 0.05))
        foot = [(x - half * c, -0.01, z - half * s), (x + half * c, -0.01, z + half * s)]
        model.add([*foot, plus(foot[1], lean), plus(foot[0], lean)], [(0, 1, 2), (0, 2, 3)])
        u = 1 if chance(0.0, 9.0) < 1.0 else 0
        model.uvs += [(u, 0), (u + 1, 0), (u + 1, 1), (u, 1)]
    return model


# --- a product shot ---------------------------------------------------------------------------------------------------

Outline = list[tuple[float, float]]


def arc(x: float, y: float, radius: float, first: float, last: float, parts: int) -> Outline:
    """Points on a circle, from one angle to another."""
    angles = [sin_cos_degrees(first + (last - first) * i / parts) for i in range(parts + 1)]
    return [(x + radius * c, y + radius * s) for s, c in angles]


def turned_on_a_lathe(outline: Outline, segments: int = 64) -> Model:
    """A vessel as a surface of revolution of its outline."""
    model = Model(1e-5, normal_bits=16)
    model.add_arrays(*lathe(outline, segments))
    return model


def flask() -> Outline:
    """A bottle, 12 cm high, whose wall is 5 mm thick and whose foot is thicker; its mouth is open."""
    outside = [(0.0, 0.0), (0.018, 0.0), *arc(0.034, 0.006, 0.006, -90.0, 0.0, 5), (0.04, 0.04)]
    outside += [*arc(0.026, 0.072, 0.014, 0.0, 80.0, 10), *arc(0.0145, 0.0935, 0.005, 255.0, 180.0, 5), (0.0095, 0.104)]
    inside = [(0.0065, 0.1055), (0.0065, 0.0925), *arc(0.0235, 0.0715, 0.0115, 100.0, 0.0, 9), (0.035, 0.04)]
    inside += [*arc(0.03, 0.019, 0.005, 0.0, -90.0, 5), (0.015, 0.014), (0.0, 0.014)]
    return [*outside, (0.0085, 0.1055), *inside]


def perfume() -> Outline:
    """Liquid that fills the bottle to 58 mm: it extends into the glass, to the middle of the wall."""
    return [
        (0.0, 0.011),
        (0.016, 0.011),
        *arc(0.0305, 0.018, 0.007, -90.0, 0.0, 5),
        (0.0375, 0.058),
        (0.018, 0.058),
        (0.0, 0.058),
    ]


def cap() -> Outline:
    """A cap on the bottle, with round edges."""
    return [
        (0.0, 0.1),
        (0.013, 0.1),
        *arc(0.0135, 0.1015, 0.0015, -90.0, 0.0, 4),
        (0.015, 0.115),
        *arc(0.0125, 0.1315, 0.0025, 0.0, 90.0, 5),
        (0.006, 0.134),
        (0.0, 0.134),
    ]


def jar() -> Outline:
    """A jar with a lid, 9 cm high: a groove runs between them."""
    low = [
        (0.0, 0.0),
        (0.03, 0.0),
        *arc(0.043, 0.003, 0.003, -90.0, 0.0, 4),
        (0.046, 0.03),
        *arc(0.045, 0.057, 0.001, 0.0, 90.0, 3),
    ]
    high = [
        *arc(0.045, 0.0605, 0.001, 270.0, 360.0, 3),
        (0.046, 0.07),
        *arc(0.0425, 0.0785, 0.0035, 0.0, 80.0, 5),
        (0.02, 0.0845),
    ]
    knob = [*arc(0.007, 0.0865, 0.002, 260.0, 180.0, 3), *arc(0.0, 0.0955, 0.0085, -45.0, 90.0, 12)]
    return [*low, (0.0435, 0.0575), (0.0435, 0.06), *high, *knob[:-1], (0.0, 0.104)]


def bowl() -> Outline:
    """A bowl with a foot and a thin round rim."""
    outside = [(0.0, 0.0), (0.02, 0.0), (0.0215, 0.001), (0.022, 0.006), *arc(0.0, 0.07, 0.066, -66.0, -14.0, 14)]
    inside = [*arc(0.0625, 0.0545, 0.0015, -10.0, 170.0, 8), *arc(0.0, 0.07, 0.0625, -16.0, -75.0, 14), (0.0, 0.0075)]
    return [*outside, *inside]


def drape() -> Model:
    """A round cloth on a round stand, 20 cm across and 7 cm high: flat on top, then falling in folds onto the floor."""
    model = Model(1e-5)
    around, rings = 180, 22
    vertices: list[Vector] = [(0.0, 0.07, 0.0)]
    for ring in range(1, rings + 1):
        if ring <= 4:  # the top
            reach, y = 0.1 * ring / 4.0, 0.07
            depth = 0.0
        else:
            part = (ring - 4.0) / (rings - 4.0)
            depth = part * (2.0 - part)
            s, c = sin_cos_degrees(round(90.0 * min(4.0 * part, 1.0)))
            y = 0.07 - 0.006 * (1.0 - c) - max(part - 0.125, 0.0) / 0.875 * 0.0605
            reach = 0.1 + 0.007 * s + 0.012 * depth
        for i in range(around):
            fold = (
                sin_cos_degrees(i * 34.0 + 30.0 * sin_cos_degrees(i * 6.0)[0])[0]
                + 0.5 * sin_cos_degrees(i * 14.0 + 40.0)[0]
            )
            flare = reach + depth * (0.008 * fold + 0.005 * sin_cos_degrees(i * 6.0)[0])
            s, c = sin_cos_degrees(2.0 * i)
            vertices.append((flare * c, max(y, 0.0008), -flare * s))
    triangles = [(0, 1 + i, 1 + (i + 1) % around) for i in range(around)]
    for ring in range(rings - 1):
        for i in range(around):
            a, b = 1 + ring * around + i, 1 + ring * around + (i + 1) % around
            triangles += [(a, a + around, b + around), (a, b + around, b)]
    model.add_arrays(np.array(vertices), np.array(triangles))
    return model


def sweep() -> Model:
    """A backdrop, 3 m wide: a floor that bends up into a wall."""
    model = Model(1e-4, normal_bits=16)
    profile = [(1.2, 0.0), *((x, y) for x, y in arc(-0.3, 0.5, 0.5, 270.0, 180.0, 24)), (-0.8, 1.8)]
    normals = [(0.0, 1.0), *((-c, -s) for c, s in arc(0.0, 0.0, 1.0, 270.0, 180.0, 24)), (1.0, 0.0)]
    for (z, y), (nz, ny) in zip(profile, normals, strict=True):
        model.points += [(-1.5, y, z), (1.5, y, z)]
        model.normals += [(0.0, ny, nz)] * 2
    for i in range(0, 2 * len(profile) - 2, 2):
        model.faces += [(i, i + 1, i + 3), (i, i + 3, i + 2)]
    return model


# --- the rotunda ------------------------------------------------------------------------------------------------------

_SECTORS: Final = 24
_TIERS: Final = (2.0, 16.0, 29.5, 41.5, 52.0, 61.0)
"""Elevations, degrees, between the tiers of coffers."""
_RADIUS: Final = 4.0
_SPRING: Final = 4.4
"""Height at which the dome begins."""


def dome() -> Model:
    """A dome of five tiers of coffers with an opening at the top, 4 m in radius, seen from inside."""
    model = Model(1e-3)

    def place(radius: float, azimuth: float, elevation: float) -> Vector:
        (s, c), (rise, out) = sin_cos_degrees(azimuth), sin_cos_degrees(elevation)
        return (radius * out * c, _SPRING + radius * rise, radius * out * s)

    def facet(*corners: Vector) -> None:
        model.add(corners, [(0, 1, 2), (0, 2, 3)])

    wide = 360.0 / _SECTORS
    for sector in range(_SECTORS):
        left, right = sector * wide, (sector + 1) * wide
        for low, high in itertools.pairwise(_TIERS):
            outer = [(left, low), (right, low), (right, high), (left, high)]
            for step in range(3):  # a frame, and two steps into the shell
                inset = (0.14, 0.09, 0.07)[step]
                (a, b), (c, d) = outer[0], outer[2]
                rim_u, rim_v = (c - a) * inset, (d - b) * inset
                inner = [(a + rim_u, b + rim_v), (c - rim_u, b + rim_v), (c - rim_u, d - rim_v), (a + rim_u, d - rim_v)]
                here, below = _RADIUS + 0.13 * step, _RADIUS + 0.13 * (step + 1)
                for i in range(4):
                    j = (i + 1) % 4
                    facet(*(place(here, *at) for at in (outer[j], outer[i], inner[i], inner[j])))
                    wall = ((here, inner[j]), (here, inner[i]), (below, inner[i]), (below, inner[j]))
                    facet(*(place(r, *at) for r, at in wall))
                outer = inner
            facet(*(place(_RADIUS + 0.5, *at) for at in ((left, low), (right, low), (right, high), (left, high))))
            facet(*(place(_RADIUS + 0.39, *at) for at in (outer[1], outer[0], outer[3], outer[2])))
        # Smooth up to the opening, and its rim
        facet(*(place(_RADIUS, *at) for at in ((right, 61.0), (left, 61.0), (left, 70.0), (right, 70.0))))
        rim = ((_RADIUS, right), (_RADIUS, left), (_RADIUS + 0.5, left), (_RADIUS + 0.5, right))
        facet(*(place(r, a, 70.0) for r, a in rim))
        facet(*(place(_RADIUS + 0.5, *at) for at in ((left, 61.0), (right, 61.0), (right, 70.0), (left, 70.0))))
    return model


def columns() -> Model:
    """Twelve columns, 4 m high, in a circle, and the ring that they carry."""
    model = Model(1e-3)
    base = [(0.0, 0.0), (0.33, 0.0), (0.33, 0.12), *arc(0.27, 0.18, 0.06, -90.0, 90.0, 4), (0.24, 0.26)]
    shaft = [(0.23, 1.4), *arc(0.205, 3.55, 0.035, -90.0, 90.0, 4), (0.2, 3.62)]
    head = [*arc(0.2, 3.76, 0.12, -90.0, 0.0, 3), (0.34, 3.8), (0.34, 4.0), (0.0, 4.0)]
    vertices, triangles = lathe([*base, *shaft, *head], 18)
    for number in range(12):
        s, c = sin_cos_degrees(30.0 * number + 15.0)
        model.add_arrays(vertices + np.array([4.15 * c, 0.0, 4.15 * s]), triangles)
    return model


def entablature() -> Model:
    """The ring on the columns, with three steps."""
    model = Model(1e-3)
    profile = [(3.8, 4.0), (3.8, 4.2), (3.75, 4.22), (3.75, 4.36), (3.62, 4.46), (3.62, 4.54), (4.0, 4.545)]
    profile += [(4.75, 4.545), (4.75, 4.46), (4.62, 4.36), (4.5, 4.2), (4.5, 4.0)]
    for k, (r, y) in enumerate(profile):
        last_r, last_y = profile[k - 1]
        for i in range(48):
            (s, c), (t, d) = sin_cos_degrees(7.5 * i), sin_cos_degrees(7.5 * (i + 1))
            here, there = [(r * c, y, r * s), (r * d, y, r * t)], [(last_r * d, last_y, last_r * t)]
            model.add([(last_r * c, last_y, last_r * s), *here, *there], [(0, 1, 2), (0, 2, 3)])
    return model


TREE: Final = Tree()
MODELS: Final[Mapping[str, Callable[[], Model]]] = {
    "tree": lambda: TREE.wood,
    "leaves": lambda: TREE.leaves,
    "meadow": meadow,
    "flask": lambda: turned_on_a_lathe(flask()),
    "perfume": lambda: turned_on_a_lathe(perfume()),
    "cap": lambda: turned_on_a_lathe(cap()),
    "jar": lambda: turned_on_a_lathe(jar()),
    "bowl": lambda: turned_on_a_lathe(bowl()),
    "drape": drape,
    "sweep": sweep,
    "dome": dome,
    "columns": columns,
    "entablature": entablature,
}


def _ply(make: Callable[[], Model]) -> bytes:
    return make().ply()


if __name__ == "__main__":
    sys.exit(write_or_compare(__doc__ or "", {name: partial(_ply, make) for name, make in MODELS.items()}))
