"""Writes the vessels in scenes/, a cloth, a backdrop, and the parts of a Newton's cradle.

They are committed, and the same bytes come out on every machine. Run ``python scripts/make_vessels.py`` to write them,
with ``--check`` to compare them with the committed ones.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from functools import partial
from typing import Final

import numpy as np
from models import Model, Outline, Vector, arc, tube, turned_on_a_lathe, unit, write_models

from clrender.exact.angles import sin_cos_degrees

__all__ = ["MODELS"]

# --- a product shot ---------------------------------------------------------------------------------------------------


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


# --- metalware --------------------------------------------------------------------------------------------------------


def goblet() -> Outline:
    """A goblet, 17 cm high, with a knop in its stem."""
    foot = [(0.0, 0.0), (0.036, 0.0), *arc(0.0375, 0.002, 0.002, -80.0, 90.0, 5), (0.02, 0.008), (0.0085, 0.016)]
    stem = [(0.0055, 0.03), (0.005, 0.042), *arc(0.005, 0.05, 0.0075, -80.0, 80.0, 8), (0.005, 0.058), (0.0065, 0.068)]
    cup = [*arc(0.0, 0.115, 0.04, -75.0, -5.0, 14), (0.0405, 0.14), *arc(0.0395, 0.169, 0.001, 0.0, 180.0, 6)]
    return [*foot, *stem, *cup, (0.0385, 0.14), *arc(0.0, 0.115, 0.038, -5.0, -80.0, 12), (0.0, 0.077)]


def pitcher() -> Outline:
    """The body of a pitcher, 24 cm high, with a narrow neck and a flared rim."""
    body = [(0.0, 0.0), (0.04, 0.0), *arc(0.041, 0.003, 0.003, -80.0, 60.0, 5), (0.042, 0.008)]
    body += [*arc(0.0, 0.085, 0.075, -50.0, 50.0, 22), (0.034, 0.168), (0.03, 0.19), (0.034, 0.218), (0.043, 0.236)]
    inside = [*arc(0.0425, 0.2375, 0.0015, 0.0, 170.0, 5), (0.032, 0.218), (0.028, 0.19), (0.032, 0.166)]
    return [*body, *inside, *arc(0.0, 0.085, 0.072, 50.0, -80.0, 22), (0.0, 0.013)]


def pan() -> Outline:
    """A pot, 11 cm high and 17 cm across, with its lid and knob."""
    low = [(0.0, 0.0), (0.07, 0.0), *arc(0.072, 0.012, 0.012, -85.0, 0.0, 6), (0.085, 0.05), (0.085, 0.082)]
    low += [*arc(0.0865, 0.0845, 0.0025, -90.0, 90.0, 6), (0.084, 0.0885)]
    lid = [*arc(0.0835, 0.0905, 0.0015, -60.0, 90.0, 4), (0.07, 0.098), (0.04, 0.106), (0.014, 0.109), (0.006, 0.111)]
    return [*low, *lid, (0.0055, 0.118), *arc(0.005, 0.127, 0.009, -70.0, 80.0, 9), (0.0, 0.1362)]


def candlestick() -> Outline:
    """A turned candlestick, 20 cm high."""
    foot = [
        (0.0, 0.0),
        (0.048, 0.0),
        *arc(0.049, 0.004, 0.004, -80.0, 80.0, 6),
        (0.03, 0.014),
        *arc(0.022, 0.02, 0.006, -60.0, 80.0, 5),
    ]
    stem = [(0.012, 0.034), *arc(0.012, 0.052, 0.009, -80.0, 80.0, 8), (0.0085, 0.066), (0.0065, 0.11), (0.0085, 0.138)]
    head = [*arc(0.0085, 0.148, 0.007, -80.0, 80.0, 7), (0.009, 0.16), (0.016, 0.172), (0.032, 0.178), (0.033, 0.18)]
    return [
        *foot,
        *stem,
        *head,
        (0.0325, 0.1815),
        (0.014, 0.1785),
        (0.0135, 0.2),
        (0.0105, 0.2),
        (0.0105, 0.185),
        (0.0, 0.185),
    ]


def bud_vase() -> Outline:
    """A vase, 20 cm high, round below and with a long neck."""
    outside = [
        (0.0, 0.0),
        (0.022, 0.0),
        (0.0235, 0.0015),
        *arc(0.0, 0.05, 0.052, -60.0, 62.0, 26),
        (0.0165, 0.112),
        (0.0125, 0.14),
    ]
    outside += [(0.0125, 0.17), (0.0165, 0.192), *arc(0.0185, 0.1985, 0.0015, -30.0, 160.0, 6)]
    inside = [
        (0.0145, 0.192),
        (0.0105, 0.17),
        (0.0105, 0.14),
        (0.0145, 0.112),
        *arc(0.0, 0.05, 0.0495, 62.0, -80.0, 26),
    ]
    return [*outside, *inside, (0.0, 0.001)]


def handle() -> Model:
    """The handle of the pitcher: a strap that leaves the neck, bends, and returns to the belly."""
    model = Model(1e-5, normal_bits=16)
    path = [
        (0.031, 0.2),
        (0.045, 0.212),
        *((0.062 + 0.036 * c, 0.176 + 0.036 * s) for s, c in (sin_cos_degrees(a) for a in range(80, -41, -10))),
    ]
    path += [(0.082, 0.134), (0.073, 0.118), (0.066, 0.108)]
    around = 14
    points, faces = [], []
    for number, (x, y) in enumerate(path):
        (ax, ay), (bx, by) = path[max(number - 1, 0)], path[min(number + 1, len(path) - 1)]
        ux, uy, _ = unit((by - ay, ax - bx, 0.0))
        for i in range(around):
            s, c = sin_cos_degrees(360.0 * i / around)
            points.append((x + 0.0028 * c * ux, y + 0.0028 * c * uy, 0.007 * s))
            j, here, there = (i + 1) % around, around * number, around * (number + 1)
            if number < len(path) - 1:
                faces += [(here + i, here + j, there + j), (here + i, there + j, there + i)]
    model.add_arrays(np.array(points), np.array(faces))
    return model


# --- things on a table ------------------------------------------------------------------------------------------------


def carafe() -> Outline:
    """A carafe of glass, 27 cm high, with a wide foot, a narrow neck and a flared rim."""
    outside = [(0.0, 0.0), (0.045, 0.0), *arc(0.057, 0.008, 0.008, -85.0, 0.0, 5), (0.064, 0.03)]
    outside += [*arc(0.0, 0.06, 0.064, -8.0, 55.0, 14), (0.026, 0.145), (0.021, 0.175), (0.0205, 0.205)]
    outside += [(0.023, 0.235), (0.029, 0.262), *arc(0.0285, 0.2675, 0.0017, -20.0, 160.0, 6)]
    inside = [(0.025, 0.258), (0.0195, 0.233), (0.017, 0.205), (0.0175, 0.175), (0.0225, 0.143)]
    inside += [*arc(0.0, 0.06, 0.06, 55.0, -8.0, 12), (0.058, 0.03), *arc(0.05, 0.018, 0.006, 0.0, -85.0, 4)]
    return [*outside, *inside, (0.0, 0.011)]


def decanter() -> Outline:
    """A low decanter, 16 cm high, with a ball as its stopper."""
    body = [(0.0, 0.0), (0.04, 0.0), *arc(0.046, 0.01, 0.01, -80.0, -30.0, 4), *arc(0.0, 0.045, 0.062, -28.0, 60.0, 18)]
    neck = [(0.02, 0.105), (0.0165, 0.114), *arc(0.019, 0.119, 0.003, -60.0, 70.0, 5), (0.012, 0.124)]
    return [*body, *neck, *arc(0.0, 0.142, 0.02, -62.0, 90.0, 16)]


def cloche() -> Outline:
    """A bell of thin glass with a knob, 25 cm high, and a plate of it below."""
    bell = [(0.0, 0.0), (0.06, 0.0), *arc(0.088, 0.002, 0.002, -90.0, 90.0, 6), (0.086, 0.006), (0.086, 0.09)]
    knob = [(0.009, 0.2125), *arc(0.0, 0.2265, 0.0155, -58.0, 90.0, 14)]
    return [*bell, *arc(0.0, 0.124, 0.086, 0.0, 84.0, 20), *knob]


def gourd() -> Outline:
    """A pair of hollow balls, the small one on the large one, 14 cm high, with a stalk."""
    low = [(0.0, 0.0), (0.02, 0.0), *arc(0.0, 0.046, 0.05, -62.0, 50.0, 18)]
    high = [*arc(0.0302, 0.0937, 0.006, 225.0, 135.0, 5), *arc(0.0, 0.117, 0.0295, -35.0, 74.0, 14)]
    return [*low, *high, (0.0055, 0.149), (0.0045, 0.156), *arc(0.0, 0.16, 0.006, -40.0, 90.0, 6)]


def egg() -> Outline:
    """An egg, 8 cm high, narrower at its top."""
    turns = [sin_cos_degrees(-90.0 + 7.5 * i) for i in range(25)]
    return [(0.029 * c * (1.0 - 0.14 * s), 0.04 + 0.04 * s) for s, c in turns]


def pawn() -> Outline:
    """A pawn of chess, 13 cm high."""
    foot = [
        (0.0, 0.0),
        (0.036, 0.0),
        *arc(0.0375, 0.004, 0.004, -80.0, 80.0, 6),
        *arc(0.031, 0.013, 0.0055, -50.0, 80.0, 6),
    ]
    stem = [(0.0255, 0.024), (0.0185, 0.04), (0.0145, 0.058), (0.0128, 0.076)]
    collar = [*arc(0.019, 0.0825, 0.003, -100.0, 80.0, 8), (0.0135, 0.088)]
    return [*foot, *stem, *collar, *arc(0.0, 0.1065, 0.0225, -52.0, 90.0, 16)]


def mill() -> Outline:
    """A mill for pepper, turned of wood, 25 cm high: a groove runs below its head."""
    foot = [(0.0, 0.0), (0.03, 0.0), *arc(0.0315, 0.003, 0.003, -80.0, 0.0, 4), (0.0345, 0.024)]
    foot += [*arc(0.0325, 0.026, 0.002, 0.0, 80.0, 4), *arc(0.0305, 0.033, 0.0045, -70.0, 70.0, 6)]
    waist = [(0.0275, 0.052), (0.022, 0.085), (0.0205, 0.11), (0.0225, 0.14), (0.028, 0.168)]
    waist += [*arc(0.0285, 0.1745, 0.0035, -60.0, 85.0, 6), (0.0215, 0.1785), (0.0215, 0.1805)]
    head = [*arc(0.0285, 0.184, 0.003, -80.0, 20.0, 5), *arc(0.0, 0.196, 0.0335, -12.0, 66.0, 12)]
    return [*foot, *waist, *head, (0.0085, 0.2295), *arc(0.0, 0.2405, 0.0115, -55.0, 90.0, 12)]


def draughtsman() -> Outline:
    """A piece of draughts, 3 cm across: its upper side has a raised rim and a ring."""
    side = [
        (0.0, 0.0),
        (0.013, 0.0),
        *arc(0.0138, 0.0012, 0.0012, -90.0, 0.0, 4),
        *arc(0.0138, 0.0068, 0.0012, 0.0, 90.0, 4),
    ]
    return [
        *side,
        (0.0122, 0.008),
        (0.0112, 0.0066),
        (0.0082, 0.0066),
        (0.0074, 0.0076),
        (0.0064, 0.0076),
        (0.0056, 0.0066),
        (0.0, 0.0066),
    ]


def globe_stand() -> Model:
    """The foot of a globe of 15 cm radius about the origin, and the ring, around its tilted axis, that carries it."""
    foot = [(0.0, -0.3), (0.08, -0.3), *arc(0.083, -0.295, 0.005, -80.0, 80.0, 6), (0.07, -0.286), (0.04, -0.276)]
    foot += [*arc(0.022, -0.266, 0.007, -40.0, 70.0, 6), (0.013, -0.25), (0.011, -0.23)]
    foot += [
        *arc(0.011, -0.215, 0.009, -70.0, 70.0, 7),
        (0.0105, -0.195),
        (0.0135, -0.18),
        *arc(0.012, -0.172, 0.004, 0.0, 80.0, 4),
    ]
    model = turned_on_a_lathe([*foot, (0.0, -0.168)], 48)
    ring = [(0.164 * c, 0.164 * s, 0.0) for s, c in (sin_cos_degrees(5.0 * i) for i in range(73))]
    tube(model, ring, 0.0042, 12)
    s, c = sin_cos_degrees(23.0)
    for side in (1.0, -1.0):
        tube(model, [(0.146 * s * side, 0.146 * c * side, 0.0), (0.172 * s * side, 0.172 * c * side, 0.0)], 0.005, 12)
    return model


# --- a garden ---------------------------------------------------------------------------------------------------------


def baluster() -> Outline:
    """A baluster of stone, 60 cm high, between two plates."""
    foot = [(0.0, 0.0), (0.07, 0.0), *arc(0.074, 0.004, 0.004, -80.0, 0.0, 3), (0.078, 0.04)]
    foot += [*arc(0.055, 0.066, 0.02, -45.0, 70.0, 6), (0.042, 0.1)]
    belly = [*arc(0.0, 0.215, 0.0745, -55.0, 40.0, 12), (0.046, 0.29), (0.035, 0.36), (0.0315, 0.43), (0.034, 0.48)]
    head = [
        *arc(0.04, 0.502, 0.012, -90.0, 90.0, 6),
        (0.038, 0.528),
        (0.06, 0.552),
        (0.078, 0.558),
        (0.078, 0.6),
        (0.0, 0.6),
    ]
    return [*foot, *belly, *head]


def urn() -> Outline:
    """An urn, 32 cm high, on a foot: a round belly below a wide neck with a rolled rim."""
    foot = [
        (0.0, 0.0),
        (0.068, 0.0),
        *arc(0.07, 0.007, 0.007, -80.0, 80.0, 6),
        (0.052, 0.02),
        (0.034, 0.034),
        (0.027, 0.052),
    ]
    foot += [*arc(0.03, 0.062, 0.0065, -80.0, 50.0, 6)]
    belly = [(0.045, 0.076), *arc(0.0, 0.145, 0.095, -46.0, 16.0, 12), *arc(0.0915, 0.179, 0.006, -60.0, 90.0, 6)]
    neck = [(0.079, 0.19), (0.074, 0.215), (0.076, 0.245), (0.088, 0.272), (0.108, 0.29)]
    rim = [*arc(0.113, 0.301, 0.0105, -70.0, 150.0, 10), (0.086, 0.288), (0.07, 0.26), (0.066, 0.2)]
    return [*foot, *belly, *neck, *rim, (0.06, 0.12), (0.0, 0.1)]


# --- a Newton's cradle -----------------------------------------------------------------------------------------------


def cradle() -> Model:
    """The frame of a Newton's cradle: two bent rods along x, 15 cm high, and the rods across at their feet."""
    model = Model(1e-5, normal_bits=16)
    for z in (-0.055, 0.055):
        bends = [
            *((0.115 - 0.02 * (1.0 - c), 0.13 + 0.02 * s) for s, c in (sin_cos_degrees(15.0 * i) for i in range(7)))
        ]
        half = [(0.115, 0.004), (0.115, 0.05), (0.115, 0.1), *bends, (0.05, 0.15)]
        tube(model, [(x, y, z) for x, y in half] + [(-x, y, z) for x, y in reversed(half)], 0.004, 16)
    return model


def threads() -> Model:
    """The two threads of a ball that hangs 11 cm below the origin, which is between the points that they hang from."""
    model = Model(1e-5, normal_bits=16)
    for z in (-0.055, 0.055):
        tube(model, [(0.0, 0.0, z), (0.0, -0.05, 0.5 * z), (0.0, -0.095, 0.1 * z)], 0.0004, 6)
    return model


OUTLINES: Final[Mapping[str, tuple[Callable[[], Outline], int]]] = {
    "flask": (flask, 64),
    "perfume": (perfume, 64),
    "cap": (cap, 64),
    "jar": (jar, 64),
    "bowl": (bowl, 64),
    "goblet": (goblet, 96),
    "pitcher": (pitcher, 96),
    "pan": (pan, 96),
    "candlestick": (candlestick, 96),
    "bud-vase": (bud_vase, 96),
    "carafe": (carafe, 48),
    "decanter": (decanter, 48),
    "cloche": (cloche, 48),
    "gourd": (gourd, 48),
    "egg": (egg, 48),
    "pawn": (pawn, 48),
    "mill": (mill, 48),
    "draughtsman": (draughtsman, 48),
    "baluster": (baluster, 24),
    "urn": (urn, 64),
}
"""Surfaces of revolution, and the number of their segments."""


def vessel(name: str) -> Model:
    """One of them."""
    outline, segments = OUTLINES[name]
    return turned_on_a_lathe(outline(), segments, 2e-5 if name == "baluster" else 1e-5)


MODELS: Final[Mapping[str, Callable[[], Model]]] = {
    **{name: partial(vessel, name) for name in OUTLINES},
    "drape": drape,
    "sweep": sweep,
    "handle": handle,
    "globe-stand": globe_stand,
    "cradle": cradle,
    "threads": threads,
}


if __name__ == "__main__":
    sys.exit(write_models(__doc__ or "", MODELS))
