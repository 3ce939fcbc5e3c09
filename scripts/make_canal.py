"""Writes the meshes of the scene `canal` in scenes/: gabled houses, a bridge, a lantern, a boat and ripples.

They are committed, and the same bytes come out on every machine. Run ``python scripts/make_canal.py`` to write them,
with ``--check`` to compare them with the committed ones.
"""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Final

from make_meshes import lathe
from models import PLAIN, STONE, Chance, Color, Facets, Model, Outline, Vector, arc, plus, tube, unit, write_models

from clrender.exact.angles import sin_cos_degrees

__all__ = ["MODELS"]

Rectangle = tuple[float, float, float, float]
"""x0, y0, x1, y1 on a facade, metres."""

_TRIM: Final = (212, 206, 190)
_SLATE: Final = (58, 60, 66)
_PANE: Final = (20, 24, 28)
_DEEP: Final = 8.0
"""Depth of a house behind its facade, metres."""
_GLASS: Final = (9, 9)
"""Texture coordinates of the spot of `bricks.png` that is as smooth as glass."""


@dataclass(frozen=True)
class House:
    """A house of the row: a front with windows, and a gable or a cornice."""

    wall: Color
    door: Color
    width: float
    floors: int
    windows: int
    gable: str
    lit: int
    """Number of windows of which about one is lit."""


HOUSES: Final[Mapping[str, House]] = {
    "house-neck": House((112, 58, 44), (34, 62, 48), 6.2, 3, 3, "neck", 3),
    "house-step": House((134, 82, 58), (70, 26, 24), 5.6, 3, 2, "step", 2),
    "house-bell": House((74, 50, 44), (30, 44, 74), 5.8, 4, 3, "bell", 4),
    "house-cornice": House((176, 164, 140), (40, 40, 42), 7.4, 4, 4, "cornice", 3),
    "house-spout": House((98, 66, 50), (96, 72, 34), 5.0, 4, 2, "spout", 3),
    "house-plain": House((66, 62, 62), (58, 34, 24), 6.6, 3, 3, "cornice", 2),
}


class Built:
    """The meshes of a house: the house with its dark windows, and the lit panes."""

    def __init__(self, house: House, seed: int) -> None:
        self.house, self.chance = house, Chance(seed)
        self.solid, self.lit = Facets(), Model(1e-3)
        self.front()

    def front(self) -> None:
        """Add all parts, from the bottom to the top."""
        house, solid, chance = self.house, self.solid, self.chance
        width, y = house.width, 0.0
        bay = width / house.windows
        for floor in range(house.floors):
            high = (3.7, 3.3, 2.9, 2.6)[floor]
            sill, head = (0.9, 3.0) if floor == 0 else (0.75, high - 0.55)
            wide = min(1.15, bay * 0.6)
            openings = [
                (bay * (i + 0.5) - wide / 2, y + sill, bay * (i + 0.5) + wide / 2, y + head)
                for i in range(house.windows)
            ]
            if floor == 0:  # a door takes the place of the first window
                x = openings[0][0]
                openings[0] = (x, 0.45, x + wide, 3.05)
            self.wall(y, y + high, openings)
            for number, opening in enumerate(openings):
                if floor == 0 and number == 0:
                    self.doorway(opening)
                else:
                    self.window(opening, chance(0.0, 1.0) * house.lit < 1.0)
            y += high
        solid.color, solid.spot = _TRIM, PLAIN
        solid.box((0.0, 3.42, -0.2), (width, 3.56, 0.09))
        solid.color, solid.spot = house.wall, None
        for x, turn in ((0.0, 1), (width, -1)):  # party walls
            corners = [(x, 0.0, -_DEEP), (x, 0.0, 0.0), (x, y, 0.0), (x, y, -_DEEP)]
            solid.facet(*corners[::turn])
        self.top(y)

    def wall(self, low: float, high: float, openings: Sequence[Rectangle]) -> None:
        """Add a storey of the wall around openings, and their reveals."""
        solid, width = self.solid, self.house.width
        solid.color, solid.spot = self.house.wall, None

        def piece(x0: float, y0: float, x1: float, y1: float) -> None:
            solid.facet((x0, y0, 0.0), (x1, y0, 0.0), (x1, y1, 0.0), (x0, y1, 0.0))

        x = 0.0
        for x0, y0, x1, y1 in openings:
            piece(x, low, x0, high)
            piece(x0, low, x1, y0)
            piece(x0, y1, x1, high)
            x, deep = x1, -0.14
            solid.facet((x0, y0, 0.0), (x0, y0, deep), (x0, y1, deep), (x0, y1, 0.0))
            solid.facet((x1, y0, deep), (x1, y0, 0.0), (x1, y1, 0.0), (x1, y1, deep))
            solid.facet((x0, y1, 0.0), (x0, y1, deep), (x1, y1, deep), (x1, y1, 0.0))
            solid.facet((x0, y0, deep), (x0, y0, 0.0), (x1, y0, 0.0), (x1, y0, deep))
        piece(x, low, width, high)

    def window(self, opening: Rectangle, lit: bool) -> None:
        """Add a sash window with six panes, its sill and its lintel."""
        solid = self.solid
        x0, y0, x1, y1 = opening
        solid.color, solid.spot = _TRIM, PLAIN
        for x in (x0, x1 - 0.07):
            solid.box((x, y0, -0.14), (x + 0.07, y1, -0.05))
        middle = y0 + 0.56 * (y1 - y0)
        for y, half in ((y0 + 0.04, 0.04), (middle, 0.035), (y1 - 0.04, 0.04)):
            solid.box((x0 + 0.07, y - half, -0.14), (x1 - 0.07, y + half, -0.055))
        for part in (1.0, 2.0):
            x = x0 + (x1 - x0) * part / 3.0
            solid.box((x - 0.018, y0 + 0.08, -0.14), (x + 0.018, y1 - 0.08, -0.075))
        solid.box((x0 - 0.08, y0 - 0.09, -0.14), (x1 + 0.08, y0, 0.09))
        solid.color = STONE
        solid.box((x0 - 0.1, y1, -0.02), (x1 + 0.1, y1 + 0.22, 0.03))
        self.pane((x0 + 0.07, y0 + 0.08, x1 - 0.07, y1 - 0.08), -0.1, lit)

    def pane(self, opening: Rectangle, z: float, lit: bool) -> None:
        """Add the glass of a window, behind which it is dark or light."""
        x0, y0, x1, y1 = opening
        corners = [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)]
        if lit:
            self.lit.add(corners, [(0, 1, 2), (0, 2, 3)])
            self.lit.uvs += [(0, 0), (1, 0), (1, 1), (0, 1)]
        else:
            self.solid.color, self.solid.spot = _PANE, _GLASS
            self.solid.facet(*corners)

    def doorway(self, opening: Rectangle) -> None:
        """Add a door with panels, a lit pane above it, and its steps."""
        solid = self.solid
        x0, y0, x1, y1 = opening
        solid.color, solid.spot = self.house.door, PLAIN
        solid.box((x0, y0, -0.14), (x1, y1 - 0.5, -0.11))
        half = (x1 - x0) / 2
        for x in (x0 + 0.1, x0 + half + 0.05):
            for low, high in ((0.15, 0.8), (0.95, 1.95)):
                solid.box((x, y0 + low, -0.11), (x + half - 0.15, y0 + high, -0.085))
        solid.color = _TRIM
        for x in (x0 - 0.12, x1):
            solid.box((x, y0, -0.02), (x + 0.12, y1 + 0.1, 0.05))
        solid.box((x0 - 0.2, y1 + 0.1, -0.02), (x1 + 0.2, y1 + 0.28, 0.12))
        solid.box((x0, y1 - 0.54, -0.14), (x1, y1 - 0.46, -0.06))
        self.pane((x0, y1 - 0.46, x1, y1), -0.12, True)
        solid.color = STONE
        for step in range(3):
            solid.box((x0 - 0.3, 0.0, -0.1), (x1 + 0.3, 0.15 * (3 - step), 0.35 * (step + 1)))

    def top(self, y: float) -> None:
        """Add gable or cornice, roof and chimney."""
        house, solid = self.house, self.solid
        width, half = house.width, house.width / 2
        rise = 0.62 * width
        if house.gable == "cornice":
            solid.color, solid.spot = _TRIM, PLAIN
            for low, high, out in ((0.0, 0.3, 0.08), (0.3, 0.42, 0.2), (0.42, 0.6, 0.34)):
                solid.box((-0.02, y + low, -0.3), (width + 0.02, y + high, out))
            for i in range(round(width / 0.6)):
                x = (i + 0.5) * width / round(width / 0.6)
                solid.box((x - 0.09, y + 0.05, 0.0), (x + 0.09, y + 0.42, 0.24))
            solid.color = _SLATE
            back, ridge = -_DEEP, y + 0.55 + 2.6
            solid.facet((0.0, y + 0.55, 0.0), (width, y + 0.55, 0.0), (width, ridge, back / 2), (0.0, ridge, back / 2))
            for x, turn in ((0.0, -1), (width, 1)):
                solid.facet(*[(x, y, 0.0), (x, y, back), (x, ridge, back / 2)][::turn])
            self.dormer((half, y + 0.75), -0.25)
        else:
            solid.color, solid.spot = house.wall, None
            outline = [(half + dx, y + dy) for dx, dy in self.gable(rise)]
            solid.prism([(half, y), *outline], -0.35, 0.0)
            self.window((half - 0.45, y + 0.45, half + 0.45, y + 1.75), False)
            solid.color, solid.spot = house.wall, PLAIN
            solid.box((half - 0.5, y + 0.4, -0.05), (half + 0.5, y + 1.8, 0.005))
            self.window((half - 0.42, y + 0.5, half + 0.42, y + 1.7), self.chance(0.0, 1.0) < 0.4)
            solid.color, solid.spot = _TRIM, PLAIN
            for (ax, ay), (bx, by) in itertools.pairwise(outline):  # a stone coping
                ux, uy, _ = unit((by - ay, ax - bx, 0.0))
                edge = [(ax, ay), (bx, by), (bx + 0.12 * ux, by + 0.12 * uy), (ax + 0.12 * ux, ay + 0.12 * uy)]
                solid.prism([edge[0], edge[3], edge[2], edge[1]][::-1], -0.4, 0.06)
            solid.color = _SLATE
            top = y + rise * 0.8
            for x, turn in ((0.0, 1), (width, -1)):
                solid.facet(*[(x, y, -0.3), (half, top, -0.3), (half, top, -_DEEP), (x, y, -_DEEP)][::turn])
        solid.color, solid.spot = (92, 58, 46), PLAIN
        x = 0.18 * width
        solid.box((x, y, -3.4), (x + 0.7, y + rise * 0.8 + 0.9, -2.8))

    def gable(self, rise: float) -> list[tuple[float, float]]:
        """The outline of the gable from right to left, about the middle of its foot."""
        half = self.house.width / 2
        if self.house.gable == "step":
            right = []
            steps = 5
            for i in range(steps):
                x, low, high = half * (1.0 - i / steps), rise * i / steps, rise * (i + 1) / steps
                right += [(x, low), (x, high)]
        elif self.house.gable == "neck":
            neck = 0.42 * half
            curl = [
                (half - (half - neck) * s, 0.3 + 1.3 * (1.0 - c))
                for s, c in (sin_cos_degrees(a) for a in range(0, 91, 10))
            ]
            right = [(half, 0.0), *curl, (neck, rise - 0.3), (neck + 0.15, rise - 0.3), (neck + 0.15, rise - 0.1)]
            right += [(0.5 * neck, rise + 0.25)]
        elif self.house.gable == "bell":
            right = [(half, 0.0), (half, 0.35)]
            right += [
                (half * (0.36 + 0.64 * (1.0 - s)), 0.35 + (rise - 0.9) * (1.0 - c))
                for s, c in (sin_cos_degrees(a) for a in range(9, 91, 9))
            ]
            right += [
                (0.4 * half, rise - 0.5),
                *[(0.36 * half * c, rise - 0.5 + 0.6 * s) for s, c in (sin_cos_degrees(a) for a in range(0, 90, 15))],
            ]
        else:  # spout
            right = [
                (half, 0.0),
                (0.3 * half, rise - 0.6),
                (0.3 * half, rise),
                (0.36 * half, rise),
                (0.36 * half, rise + 0.2),
            ]
        return [*right, *[(-x, y) for x, y in reversed(right)]]

    def dormer(self, at: tuple[float, float], z: float) -> None:
        """Add a dormer window with a small gable roof."""
        solid, (x, y) = self.solid, at
        solid.color, solid.spot = _TRIM, PLAIN
        solid.box((x - 0.75, y, -2.5), (x + 0.75, y + 1.6, z))
        solid.prism([(x, y + 1.6), (x + 0.9, y + 1.6), (x, y + 2.2), (x - 0.9, y + 1.6)], -2.8, z + 0.1)
        self.pane((x - 0.5, y + 0.25, x + 0.5, y + 1.4), z + 0.02, False)


# --- the bridge -------------------------------------------------------------------------------------------------------

_SPAN: Final = 4.6
"""Half of the span of the arch, metres."""
_RISE: Final = 2.3


def arch(parts: int) -> list[tuple[float, float]]:
    """Points on the arch of the bridge, half an ellipse, from right to left."""
    turns = (sin_cos_degrees(180.0 * i / parts) for i in range(parts + 1))
    return [(_SPAN * c, 0.35 + _RISE * s) for s, c in turns]


def deck(x: float) -> float:
    """Height of the deck: it rises towards the middle of the canal."""
    return 3.35 - 1.55 * x * x / 49.0


def bridge() -> Model:
    """A bridge over the canal, 14 m long and 5 m wide, its middle at the origin: an arch of stone and brick."""
    model, half = Facets(), 2.5
    curve = arch(32)
    for (ax, ay), (bx, by) in itertools.pairwise(curve):
        model.color, model.spot = (120, 70, 54), None
        for z, turn in ((half, 1), (-half, -1)):
            model.facet(*[(bx, by, z), (ax, ay, z), (ax, deck(ax), z), (bx, deck(bx), z)][::turn])
        model.facet((ax, ay, half), (bx, by, half), (bx, by, -half), (ax, ay, -half))
        model.color, model.spot = STONE, PLAIN
        model.facet((ax, deck(ax), half), (ax, deck(ax), -half), (bx, deck(bx), -half), (bx, deck(bx), half))
        ux, uy, _ = unit((ax / _SPAN / _SPAN, (ay - 0.35) / _RISE / _RISE, 0.0))
        vx, vy, _ = unit((bx / _SPAN / _SPAN, (by - 0.35) / _RISE / _RISE, 0.0))
        ring = [(ax, ay), (ax + 0.32 * ux, ay + 0.32 * uy), (bx + 0.32 * vx, by + 0.32 * vy), (bx, by)]
        for low, high in ((half, half + 0.06), (-half - 0.06, -half)):
            model.prism(ring[::-1], low, high)
        cope = [(ax, deck(ax)), (bx, deck(bx)), (bx, deck(bx) + 0.16), (ax, deck(ax) + 0.16)]
        for low, high in ((half - 0.25, half + 0.12), (-half - 0.12, -half + 0.25)):
            model.prism(cope[::-1], low, high)
    model.color, model.spot = (120, 70, 54), None
    for side in (1, -1):
        for z, turn in ((half, side), (-half, -side)):
            x, y = side * _SPAN, side * 7.2
            model.facet(*[(x, -1.0, z), (y, -1.0, z), (y, 1.7, z), (x, deck(x), z)][::turn])
        x = side * _SPAN
        model.facet(*[(x, -1.0, half), (x, 0.35, half), (x, 0.35, -half), (x, -1.0, -half)][::side])
        deck_corners = [(side * 7.2, 1.7, half), (side * 7.2, 1.7, -half), (x, deck(x), -half), (x, deck(x), half)]
        model.color, model.spot = STONE, PLAIN
        model.facet(*deck_corners[::side])
    return model


def railing() -> Model:
    """The iron railing along one side of the bridge: three rails and a post every metre."""
    model = Model(1e-3)
    places = [0.25 * i - 7.0 for i in range(57)]
    for height, radius in ((1.0, 0.035), (0.55, 0.018), (0.25, 0.018)):
        tube(model, [(x, deck(x) + 0.16 + height, 0.0) for x in places], radius)
    for x in places[::4]:
        tube(model, [(x, deck(x), 0.0), (x, deck(x) + 1.2, 0.0)], 0.04, 8)
    return model


def quay() -> Model:
    """15 m of a quay at the right of the canal, whose middle is at x = 0: a wall, its coping, a street and a kerb."""
    model = Facets()
    for first in range(0, 15, 5):  # texture coordinates are below 256
        low, high = float(-first - 5), float(-first)
        model.color, model.spot = (104, 66, 54), None
        model.facet((7.0, -1.0, high), (7.0, -1.0, low), (7.0, 1.5, low), (7.0, 1.5, high))
        model.color = (104, 84, 76)
        model.facet((7.4, 1.7, high), (11.6, 1.7, high), (11.6, 1.7, low), (7.4, 1.7, low))
        model.color, model.spot = STONE, PLAIN
        model.box((6.92, 1.5, low + 0.005), (7.4, 1.715, high - 0.005))
        model.box((11.6, 1.6, low + 0.005), (11.8, 1.82, high - 0.005))
        model.color = (98, 94, 90)
        model.facet((11.8, 1.8, high), (13.5, 1.8, high), (13.5, 1.8, low), (11.8, 1.8, low))
    return model


# --- lantern, boat, bicycle, water ------------------------------------------------------------------------------------


def post() -> Outline:
    """A cast-iron lamp post, 3.3 m high, with the plate that carries the lantern."""
    foot = [(0.0, 0.0), (0.17, 0.0), (0.17, 0.08), *arc(0.12, 0.11, 0.035, -60.0, 60.0, 3), (0.12, 0.3)]
    foot += [*arc(0.1, 0.62, 0.03, -70.0, 70.0, 4), (0.075, 0.72), *arc(0.06, 0.86, 0.03, -80.0, 80.0, 4)]
    shaft = [(0.052, 0.95), (0.04, 2.6), *arc(0.035, 2.66, 0.035, -80.0, 80.0, 5), (0.033, 2.74), (0.03, 3.0)]
    head = [*arc(0.03, 3.06, 0.03, -70.0, 70.0, 4), (0.035, 3.12), (0.1, 3.24), (0.11, 3.26), (0.11, 3.29), (0.0, 3.3)]
    return [*foot, *shaft, *head]


def hood() -> Outline:
    """The roof of the lantern, from 3.78 m up."""
    return [
        (0.0, 3.78),
        (0.235, 3.78),
        (0.235, 3.81),
        *arc(0.06, 3.8, 0.14, 35.0, 80.0, 5),
        (0.05, 3.98),
        *arc(0.0, 4.04, 0.035, -40.0, 75.0, 6),
        (0.0, 4.1),
    ]


def lantern() -> Model:
    """A street lamp without its bulb: post, roof and the six bars of the lantern."""
    model = Model(2e-4, normal_bits=16)
    for outline in (post(), hood()):
        model.add_arrays(*lathe(outline, 16))
    for i in range(6):
        s, c = sin_cos_degrees(60.0 * i)
        tube(model, [(0.1 * c, 3.27, 0.1 * s), (0.22 * c, 3.8, 0.22 * s)], 0.011, 5)
    return model


def boat() -> Model:
    """An open boat, 5.2 m long, its keel along z and its waterline at 0: hull, inside and thwarts."""
    model = Facets()
    model.spot = PLAIN
    stations, ribs = 18, 7

    def ring(part: float, inset: float) -> list[Vector]:
        bow = 1.25 * part - 0.5
        swell = 1.0 - bow * bow / (0.25 if part < 0.4 else 0.5625)
        half = max(0.92 * math.sqrt(max(swell, 0.0)) - inset, 0.0)
        rim = 0.42 + 0.77 * (part - 0.4) * (part - 0.4)
        keel = -0.2 + inset
        turns = (sin_cos_degrees(90.0 * i / (ribs - 1)) for i in range(ribs))
        return [
            (half * (0.35 * s + 0.65 * s * (2.0 - s)), keel + (rim - keel) * (1.0 - c), 5.2 * part - 2.6)
            for s, c in turns
        ]

    for number in range(stations):
        here, there = number / stations, (number + 1) / stations
        for inset, turn in ((0.0, 1), (0.05, -1)):
            model.color = (36, 66, 60) if inset == 0.0 else (120, 84, 52)
            a, b = ring(here, inset), ring(there, inset)
            for i in range(ribs - 1):
                for side in (1, -1):
                    corners = [a[i], a[i + 1], b[i + 1], b[i]]
                    corners = [(side * x, y, z) for x, y, z in corners]
                    model.facet(*corners[:: -side * turn])
        model.color = (150, 112, 70)
        near, far = ring(here, -0.03)[-1], ring(there, -0.03)[-1]
        top = [plus(at, (0.0, 0.02, 0.0)) for at in (near, far, ring(there, 0.06)[-1], ring(here, 0.06)[-1])]
        strip = [plus(near, (0.0, -0.07, 0.0)), plus(far, (0.0, -0.07, 0.0)), top[1], top[0]]
        for corners in (top, strip):
            for side in (1, -1):
                model.facet(*[(side * x, y, z) for x, y, z in corners][::-side])
    for part in (0.25, 0.5, 0.7):
        half, z = ring(part, 0.05)[-2][0], 5.2 * part - 2.6
        model.box((-half, 0.2, z - 0.14), (half, 0.24, z + 0.14))
    return model


def bicycle() -> Model:
    """A bicycle without a cross bar that leans on nothing: wheels, frame, handlebar, saddle and mudguards."""
    model = Model(1e-4)
    hubs = (-0.55, 0.55)
    for hub in hubs:
        circle = [(hub + 0.33 * c, 0.345 + 0.33 * s, 0.0) for s, c in (sin_cos_degrees(15.0 * i) for i in range(25))]
        tube(model, circle, 0.018, 6)
        for i in range(12):
            s, c = sin_cos_degrees(30.0 * i)
            tube(model, [(hub, 0.345, 0.0), (hub + 0.32 * c, 0.345 + 0.32 * s, 0.0)], 0.003, 3)
        guard = [
            (hub + 0.37 * c, 0.345 + 0.37 * s, 0.0) for s, c in (sin_cos_degrees(20.0 + 15.0 * i) for i in range(10))
        ]
        tube(model, guard, 0.022, 5)
    crank, head, seat = (-0.08, 0.3, 0.0), (0.38, 0.88, 0.0), (-0.25, 0.85, 0.0)
    low = (0.33, 0.62, 0.0)
    for nodes, radius in (
        ([crank, low, head], 0.018),
        ([crank, seat, (-0.28, 0.95, 0.0)], 0.017),
        ([(-0.13, 0.45, 0.0), (0.3, 0.76, 0.0), head], 0.014),
        ([(-0.55, 0.345, 0.03), crank], 0.012),
        ([(-0.55, 0.345, -0.03), crank], 0.012),
        ([(-0.55, 0.345, 0.0), seat], 0.011),
        ([head, (0.44, 0.68, 0.0), (0.55, 0.345, 0.0)], 0.013),
        ([head, (0.34, 1.05, 0.0)], 0.014),
        ([(0.12, 1.02, -0.28), (0.26, 1.06, -0.22), (0.35, 1.08, 0.0), (0.26, 1.06, 0.22), (0.12, 1.02, 0.28)], 0.012),
        ([(-0.4, 0.97, 0.0), (-0.24, 0.985, 0.0), (-0.12, 0.97, 0.0)], 0.05),
        ([(-0.8, 0.74, 0.0), (-0.55, 0.76, 0.0), (-0.3, 0.76, 0.0)], 0.03),
    ):
        tube(model, nodes, radius, 7)
    return model


def ripples() -> Model:
    """A square of 6 m of rippled water, which continues on all sides: waves whose lengths are fractions of the side."""
    model = Model(2e-4, normal_bits=16)
    cells, side = 72, 6.0
    waves = [
        (3, 5, 0.0),
        (-4, 7, 70.0),
        (6, 8, 150.0),
        (-9, 4, 230.0),
        (11, 7, 20.0),
        (2, -12, 310.0),
        (-8, -13, 110.0),
        (14, -5, 190.0),
    ]
    for row in range(cells + 1):
        for column in range(cells + 1):
            u, v = column / cells, row / cells
            height, slope_x, slope_z = 0.0, 0.0, 0.0
            for a, b, phase in waves:
                size = 0.016 / math.sqrt(a * a + b * b)
                rise, along = sin_cos_degrees(360.0 * (a * column % cells / cells + b * row % cells / cells) + phase)
                height += size * rise
                slope_x += size * along * a * 6.283185307179586 / side
                slope_z += size * along * b * 6.283185307179586 / side
            model.points.append((side * u - 3.0, height, side * v - 3.0))
            model.normals.append(unit((-slope_x, 1.0, -slope_z)))
    for row in range(cells):
        for column in range(cells):
            a = row * (cells + 1) + column
            b, c, d = a + 1, a + cells + 2, a + cells + 1
            model.faces += [(a, d, c), (a, c, b)]
    return model


@cache
def built(name: str) -> Built:
    """The house of this name."""
    return Built(HOUSES[name], 7 + 10 * list(HOUSES).index(name))


def solid(name: str) -> Model:
    """A house with its dark windows."""
    return built(name).solid


def lit(name: str) -> Model:
    """Its lit panes."""
    return built(name).lit


MODELS: Final[Mapping[str, Callable[[], Model]]] = {
    **{name: partial(solid, name) for name in HOUSES},
    **{f"{name}-lit": partial(lit, name) for name in HOUSES},
    "bridge": bridge,
    "quay": quay,
    "railing": railing,
    "lantern": lantern,
    "boat": boat,
    "bicycle": bicycle,
    "ripples": ripples,
}


if __name__ == "__main__":
    sys.exit(write_models(__doc__ or "", MODELS))
