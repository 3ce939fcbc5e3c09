"""Square cups of glass with water in them: by priorities, and with merged interfaces as they were built without."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from render_support import lambert, quad, scene

if TYPE_CHECKING:
    from clrender.scene import Scene

__all__ = ["CAMERA", "GLASS", "ICE", "WATER", "by_priority", "merged", "on_a_table", "rectangles"]

Vector = Sequence[float]
Shape = Mapping[str, Any]

OUTER: Final = 0.5
INNER: Final = 0.4
FOOT: Final = 0.1
RIM: Final = 1.0
LEVEL: Final = 0.7
"""Half widths of the cup outside and inside, and heights of its inner floor, its rim and the water, metres."""

CAMERA: Final = {"position": [0.7, 1.9, 2.6], "target": [0.0, 0.5, 0.0], "vertical_fov": 28.0}
GLASS: Final = {"type": "dielectric", "ior": 1.5, "priority": 3}
WATER: Final = {"type": "dielectric", "ior": 1.33, "priority": 1}
ICE: Final = {"type": "dielectric", "ior": 1.2, "priority": 2}


def rectangles(corners: Sequence[tuple[Vector, Vector, Vector]], **more: Any) -> dict[str, Any]:
    """A mesh of rectangles, each given by its origin and two edges; it faces along their cross product."""
    vertices: list[list[float]] = []
    faces: list[list[int]] = []
    for origin, u, v in corners:
        n = len(vertices)
        for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
            vertices.append([o + a * x + b * y for o, x, y in zip(origin, u, v, strict=True)])
        faces += [[n, n + 1, n + 2], [n, n + 2, n + 3]]
    return {"type": "mesh", "vertices": vertices, "faces": faces, **more}


def walls(half: float, low: float, high: float, outward: bool) -> list[tuple[Vector, Vector, Vector]]:
    """The four sides of a square column."""
    up = (0.0, high - low, 0.0)
    found: list[tuple[Vector, Vector, Vector]] = []
    for x, z in ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)):
        along = (2.0 * half * z, 0.0, -2.0 * half * x)
        origin = (half * (x - z), low, half * (z + x))
        found.append((origin, along, up) if outward else (origin, up, along))
    return found


def floor(half: float, height: float, upward: bool) -> tuple[Vector, Vector, Vector]:
    """A square that lies."""
    u, v = (2.0 * half, 0.0, 0.0), (0.0, 0.0, -2.0 * half)
    return ((-half, height, half), u, v) if upward else ((-half, height, half), v, u)


def rim() -> list[tuple[Vector, Vector, Vector]]:
    """The top of the cup's wall: four rectangles that face up."""
    thick, wide = OUTER - INNER, 2.0 * OUTER
    deep = (0.0, 0.0, -2.0 * INNER)
    return [
        ((-OUTER, RIM, OUTER), (wide, 0.0, 0.0), (0.0, 0.0, -thick)),
        ((-OUTER, RIM, -INNER), (wide, 0.0, 0.0), (0.0, 0.0, -thick)),
        ((-OUTER, RIM, INNER), (thick, 0.0, 0.0), deep),
        ((INNER, RIM, INNER), (thick, 0.0, 0.0), deep),
    ]


def outside() -> list[tuple[Vector, Vector, Vector]]:
    """All of the cup's surface that air touches, but for its inner walls."""
    return [*walls(OUTER, 0.0, RIM, True), floor(OUTER, 0.0, False), *rim()]


def by_priority(into: float = 0.03) -> list[Shape]:
    """The cup, and a block of water that reaches so far into its walls."""
    half, low = INNER + into, FOOT - into
    cup = [*outside(), *walls(INNER, FOOT, RIM, False), floor(INNER, FOOT, True)]
    return [
        rectangles(cup, material="glass"),
        {
            "type": "box",
            "center": [0.0, (low + LEVEL) / 2.0, 0.0],
            "size": [2.0 * half, LEVEL - low, 2.0 * half],
            "material": "water",
        },
    ]


def merged() -> tuple[list[Shape], dict[str, Mapping[str, Any]]]:
    """The same with one surface between each two media, and what these are made of."""
    wet = [*walls(INNER, FOOT, LEVEL, False), floor(INNER, FOOT, True)]
    shapes: list[Shape] = [
        rectangles([*outside(), *walls(INNER, LEVEL, RIM, False)], material="dry"),
        rectangles(wet, material="wet"),
        rectangles([floor(INNER, LEVEL, True)], material="surface"),
    ]
    return shapes, {
        "dry": {"type": "dielectric", "ior": 1.5},
        "wet": {"type": "dielectric", "ior": 1.5, "exterior_ior": 1.33},
        "surface": {"type": "dielectric", "ior": 1.33},
    }


def on_a_table(shapes: Sequence[Shape], **materials: Mapping[str, Any]) -> Scene:
    """They stand a little above a checked table, under a sky and a lamp."""
    table = [
        quad([x, -0.01, z], [0.0, 0.0, 0.4], [0.4, 0.0, 0.0], material="dark" if (i + j) % 2 else "light")
        for i, x in enumerate((-0.8, -0.4, 0.0, 0.4))
        for j, z in enumerate((-0.8, -0.4, 0.0, 0.4))
    ]
    lamp = quad([-1.0, 3.0, -1.0], [2.0, 0.0, 0.0], [0.0, 0.0, 2.0], emission=1.5)
    sky = {"type": "environment", "radiance": [0.6, 0.7, 0.8]}
    return scene(
        [*shapes, *table, lamp],
        [sky],
        CAMERA,
        dark=lambert([0.2, 0.3, 0.5]),
        light=lambert([0.8, 0.7, 0.6]),
        **materials,
    )
