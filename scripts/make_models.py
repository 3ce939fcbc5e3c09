"""Writes the plants and the rotunda in scenes/.

They are committed, and the same bytes come out on every machine. Run ``python scripts/make_models.py`` to write them,
with ``--check`` to compare them with the committed ones.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Final

import numpy as np
from make_meshes import lathe
from models import Chance, Model, Vector, across, arc, plus, turned, unit, write_models

from clrender.exact.angles import sin_cos_degrees

__all__ = ["MODELS"]

_UP: Final = (0.0, 1.0, 0.0)

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
    "dome": dome,
    "columns": columns,
    "entablature": entablature,
}


if __name__ == "__main__":
    sys.exit(write_models(__doc__ or "", MODELS))
