"""Writes the meshes of the scene `interior` in scenes/: cushions, curtains, a window, books, a lamp, a table.

They are committed, and the same bytes come out on every machine. Run ``python scripts/make_interior.py`` to write them,
with ``--check`` to compare them with the committed ones.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
from models import Chance, Facets, Model, Outline, Vector, arc, tube, turned_on_a_lathe, unit, write_models

from clrender.exact.angles import sin_cos_degrees

__all__ = ["MODELS"]


def rounded(radius: float, puff: float, cells: int) -> Model:
    """A cube from -1/2 to 1/2 whose edges are round, and whose sides bulge.

    Parameters
    ----------
    radius : float
        Radius of the edges.
    puff : float
        How far the middle of each side stands out.
    cells : int
        Squares along an edge of a side.
    """
    model, core = Model(1e-4), 0.5 - radius
    steps = [-1.0 + 2.0 * i / cells for i in range(cells + 1)]
    # Cells are narrow near the edges, where the surface bends
    steps = [s * (1.5 - 0.5 * s * s) for s in steps]
    numbers: dict[tuple[float, ...], int] = {}
    points: list[Vector] = []
    faces: list[tuple[int, ...]] = []

    def corner(axis: int, side: float, u: float, v: float) -> int:
        place = [0.0, 0.0, 0.0]
        place[axis], place[(axis + 1) % 3], place[(axis + 2) % 3] = side, u, v
        key = tuple(place)
        if key not in numbers:
            numbers[key] = len(points)
            inner = [max(-core, min(core, 0.5 * p)) for p in place]
            x, y, z = unit((0.5 * place[0] - inner[0], 0.5 * place[1] - inner[1], 0.5 * place[2] - inner[2]))
            out = [inner[0] + radius * x, inner[1] + radius * y, inner[2] + radius * z]
            bulge = puff * (1.0 - u * u) * (1.0 - v * v)
            out[axis] += side * bulge
            points.append((out[0], out[1], out[2]))
        return numbers[key]

    for axis in range(3):
        for side in (1.0, -1.0):
            for (a, b), (c, d) in itertools.product(itertools.pairwise(steps), itertools.pairwise(steps)):
                four = [corner(axis, side, u, v) for u, v in ((a, c), (b, c), (b, d), (a, d))]
                four = four if side > 0.0 else four[::-1]
                faces += [(four[0], four[1], four[2]), (four[0], four[2], four[3])]
    model.add_arrays(np.array(points), np.array(faces))
    return model


def curtain() -> Model:
    """A curtain, 2.5 m high, that hangs at x = 0 in folds along z, 0.6 m wide."""
    model = Model(1e-4)
    columns, rows = 120, 24
    vertices: list[Vector] = []
    for row in range(rows + 1):
        y = 2.5 * row / rows
        fall = 1.0 - row / rows
        for column in range(columns + 1):
            part = column / columns
            wave = sin_cos_degrees(360.0 * 7.0 * part + 40.0 * sin_cos_degrees(360.0 * 2.0 * part)[0])
            sway = sin_cos_degrees(360.0 * 1.5 * part + 120.0 * fall)[0]
            vertices.append(
                ((0.035 + 0.02 * fall) * wave[0] + 0.015 * fall * sway, y, 0.6 * part + 0.006 * wave[1] * fall)
            )
    triangles = []
    for row in range(rows):
        for column in range(columns):
            a = row * (columns + 1) + column
            b, c, d = a + 1, a + columns + 2, a + columns + 1
            triangles += [(a, b, c), (a, c, d)]
    model.add_arrays(np.array(vertices), np.array(triangles))
    return model


_WHITE: Final = (238, 236, 230)


def casement() -> Model:
    """A window of two leaves with three panes each, in the plane x = 0: 1.2 m along z and 2.2 m high, without glass."""
    model = Facets()
    model.color = _WHITE

    def bar(low: tuple[float, float], high: tuple[float, float], thick: float) -> None:
        (y0, z0), (y1, z1) = low, high
        solid(model, (-thick, y0, z0), (thick, y1, z1))

    for z in (0.0, 1.13):
        bar((0.0, z), (2.2, z + 0.07), 0.05)
    for y in (0.0, 2.13):
        bar((y, 0.07), (y + 0.07, 1.13), 0.05)
    for first in (0.07, 0.6):
        for z in (first, first + 0.47):
            bar((0.07, z), (2.13, z + 0.06), 0.03)
        for y in (0.07, 0.72, 1.4, 2.07):
            bar(
                (y, first + 0.06),
                (y + (0.035 if 0.1 < y < 2.0 else 0.06), first + 0.47),
                0.024 if 0.1 < y < 2.0 else 0.03,
            )
    solid(model, (0.03, 0.98, 0.585), (0.075, 1.12, 0.615))  # the handle
    solid(model, (-0.12, -0.05, -0.06), (0.2, 0.0, 1.26))  # the sill
    return model


def solid(model: Facets, low: Vector, high: Vector) -> None:
    """Add a box with all its sides."""
    model.box(low, high)
    (a, b, c), (d, e, f) = low, high
    model.facet((d, b, c), (a, b, c), (a, e, c), (d, e, c))
    model.facet((a, b, c), (d, b, c), (d, b, f), (a, b, f))


def walls() -> Model:
    """The wall with two windows at x = -2.7, from outside to inside, and its reveals."""
    model = Facets()
    model.color = (226, 222, 212)
    inside, outside, low, high = -2.7, -2.98, 0.3, 2.5
    edges = [-2.1, -1.4, -0.2, 0.5, 1.7, 3.2]
    for number, (z0, z1) in enumerate(itertools.pairwise(edges)):
        bands = [(0.0, 2.8)] if number % 2 == 0 else [(0.0, low), (high, 2.8)]
        for y0, y1 in bands:
            model.facet((inside, y0, z1), (inside, y0, z0), (inside, y1, z0), (inside, y1, z1))
            model.facet((outside, y0, z0), (outside, y0, z1), (outside, y1, z1), (outside, y1, z0))
        if number % 2:
            for z, turn in ((z0, 1), (z1, -1)):
                corners = [(inside, low, z), (outside, low, z), (outside, high, z), (inside, high, z)]
                model.facet(*corners[::turn])
            for y, turn in ((low, 1), (high, -1)):
                corners = [(inside, y, z0), (inside, y, z1), (outside, y, z1), (outside, y, z0)]
                model.facet(*corners[::-turn])
    return model


_BINDINGS: Final = (
    (150, 46, 38), (38, 70, 96), (206, 190, 158), (52, 84, 66), (196, 142, 60), (228, 222, 208), (84, 60, 50),
    (70, 88, 104), (172, 92, 62), (38, 40, 46), (122, 130, 96), (196, 176, 150),
)  # fmt: skip


def books() -> Model:
    """Five shelves of books, 1.4 m wide and 0.38 m apart, the lowest at y = 0; their backs are at z = 0."""
    model, chance = Facets(), Chance(23)
    for shelf in range(5):
        x, y = 0.0, 0.38 * shelf
        while x < 1.34:
            kind = chance(0.0, 1.0)
            if kind < 0.06 and x < 1.1:  # lying
                wide, at = chance(0.2, 0.26), y
                for _ in range(3):
                    thick = chance(0.02, 0.04)
                    model.color = _BINDINGS[int(chance(0.0, 12.0))]
                    solid(model, (x, at + 0.0005, -chance(0.16, 0.19)), (x + wide, at + thick, 0.0))
                    at += thick
                x += wide + 0.02
            elif kind < 0.1 and x < 1.15:  # a gap
                x += chance(0.06, 0.16)
            else:
                thick, high = chance(0.014, 0.046), chance(0.19, 0.31)
                if x + thick > 1.4:
                    break
                deep, back = chance(0.14, 0.2), -chance(0.0, 0.02)
                model.color = _BINDINGS[int(chance(0.0, 12.0))]
                solid(model, (x, y + 0.0005, back - deep), (x + thick, y + high, back))
                if chance(0.0, 1.0) < 0.5:  # a label on the spine
                    model.color = (222, 206, 166)
                    low = y + high * chance(0.55, 0.75)
                    solid(model, (x + 0.15 * thick, low, back - 0.001), (x + 0.85 * thick, low + 0.03, back + 0.0008))
                x += thick + 0.001
    return model


def table() -> Outline:
    """The round top of a low table, 0.9 m across, from 0.38 to 0.415 m."""
    return [
        (0.0, 0.38),
        (0.3, 0.38),
        (0.425, 0.383),
        *arc(0.44, 0.4, 0.012, -80.0, 80.0, 7),
        (0.43, 0.415),
        (0.2, 0.415),
        (0.0, 0.415),
    ]


def legs() -> Model:
    """Three splayed legs below it."""
    model = Model(1e-4)
    for i in range(3):
        s, c = sin_cos_degrees(120.0 * i + 20.0)
        parts = [(0.27 + 0.13 * t, 0.385 - 0.385 * t) for t in (0.0, 0.25, 0.5, 0.75, 1.0)]
        tube(model, [(r * c, y, r * s) for r, y in parts], 0.02, 10)
    return model


def vase() -> Outline:
    """A vase of stoneware, 0.3 m high."""
    outside = [
        (0.0, 0.0),
        (0.05, 0.0),
        (0.056, 0.004),
        *arc(0.0, 0.115, 0.115, -70.0, 55.0, 20),
        (0.04, 0.235),
        (0.032, 0.27),
    ]
    inside = [
        *arc(0.036, 0.3, 0.005, -10.0, 170.0, 6),
        (0.028, 0.27),
        (0.034, 0.23),
        (0.07, 0.18),
        (0.09, 0.11),
        (0.0, 0.02),
    ]
    return [*outside, *inside]


def pot() -> Outline:
    """A plant pot, 0.34 m high, filled with earth to 0.3 m."""
    outside = [(0.0, 0.0), (0.12, 0.0), (0.13, 0.01), (0.175, 0.31), *arc(0.17, 0.33, 0.01, -5.0, 180.0, 7)]
    return [*outside, (0.156, 0.3), (0.0, 0.3)]


def shade() -> Outline:
    """The shade of a lamp, a thin shell around the y axis from 1.35 m up."""
    return [
        (0.0, 1.647),
        (0.09, 1.647),
        (0.2345, 1.351),
        (0.2355, 1.3495),
        (0.237, 1.3495),
        (0.2375, 1.351),
        (0.093, 1.65),
        (0.0, 1.65),
    ]


def stand() -> Model:
    """The stand of the lamp: a heavy foot, and three slim legs that meet below the shade."""
    model = Model(1e-4)
    for i in range(3):
        s, c = sin_cos_degrees(120.0 * i + 45.0)
        tube(model, [(0.26 * c, 0.0, 0.26 * s), (0.13 * c, 0.65, 0.13 * s), (0.012 * c, 1.3, 0.012 * s)], 0.013, 8)
    tube(model, [(0.0, 1.27, 0.0), (0.0, 1.5, 0.0)], 0.012, 10)
    return model


def pouf() -> Outline:
    """A round, soft seat, 0.36 m high."""
    return [
        (0.0, 0.0),
        (0.2, 0.0),
        *arc(0.17, 0.1, 0.1, -70.0, 0.0, 6),
        *arc(0.17, 0.26, 0.1, 10.0, 85.0, 7),
        (0.08, 0.363),
        (0.0, 0.364),
    ]


MODELS: Final[Mapping[str, Callable[[], Model]]] = {
    "cushion": lambda: rounded(0.2, 0.09, 14),
    "block": lambda: rounded(0.03, 0.0, 8),
    "curtain": curtain,
    "casement": casement,
    "walls": walls,
    "books": books,
    "table": lambda: turned_on_a_lathe(table(), 72, 1e-4),
    "legs": legs,
    "vase": lambda: turned_on_a_lathe(vase(), 48, 1e-4),
    "pot": lambda: turned_on_a_lathe(pot(), 48, 1e-4),
    "shade": lambda: turned_on_a_lathe(shade(), 48, 1e-4),
    "stand": stand,
    "pouf": lambda: turned_on_a_lathe(pouf(), 48, 1e-4),
}


if __name__ == "__main__":
    sys.exit(write_models(__doc__ or "", MODELS))
