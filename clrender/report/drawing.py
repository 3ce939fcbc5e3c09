"""Drawings: the room's dimensions (figure 1) and a hemisphere of sampled directions (figure 3), as SVG."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from clrender.drawing.svg import BLUE, EDGE, GREY, INK, draw
from clrender.scene import Box, Quad, Sphere, Tetrahedron, Transform

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from clrender.scene import Scene, Shape

__all__ = ["hemisphere", "room_dimensions"]

_Points = npt.NDArray[np.float64]
_RED, _GREEN, _LAMP, _SOLID = "#b5382c", "#2f8f46", "#f0b429", "#8aa4cf"
_TILT: Final = 0.2
"""Sine of the angle from above at which the hemisphere is viewed."""


def room_dimensions(scene: Scene) -> str:
    """Plan and front view of a room with its dimensions in metres, drawn from the scene.

    Parameters
    ----------
    scene : Scene
        Quads, boxes, spheres and tetrahedra, with the room as its outermost quads.
    """
    shapes = [(shape, *_outline(shape)) for _, shape in scene.all_shapes() if _outline(shape)[0].size]
    everything = np.concatenate([points for _, points, _ in shapes])
    low, high = everything.min(0), everything.max(0)
    size = high - low

    def paint(figure: Figure) -> None:
        plan, front = figure.subplots(1, 2)
        _view(plan, shapes, low, high, (0, 2), "from above")
        _view(front, shapes, low, high, (0, 1), "from the front")
        plan.invert_yaxis()  # the camera, at the largest z, is at the bottom
        x, _, z = scene.camera.position
        plan.plot([x - 0.45, x, x + 0.45], [z - 0.5, z, z - 0.5], color=GREY)
        plan.annotate("camera", (x, z), (6, -3), textcoords="offset points")

    title = f"The room: {size[0]:g} m wide, {size[1]:g} m high, {size[2]:g} m deep"
    return draw("figure-1", title, (7.6, 1.0 + 6.6 * size[2] / (2.0 * size[0])), paint)


def _view(
    axes: Axes, shapes: list[tuple[Shape, _Points, str]], low: _Points, high: _Points, which: tuple[int, int],
    title: str,
) -> None:  # fmt: skip
    """One view along an axis of the world: the objects, the walls in their colours, the dimensions."""
    from matplotlib.patches import Circle, Polygon

    x, y = which
    for shape, points, kind in shapes:
        colour = _LAMP if kind == "lamp" else _SOLID
        if isinstance(shape, Sphere):
            centre = (shape.center[x], shape.center[y])
            axes.add_patch(Circle(centre, shape.radius, facecolor=colour, edgecolor=EDGE, alpha=0.6))
        elif kind != "wall":
            corners = _hull([(float(point[x]), float(point[y])) for point in points])
            axes.add_patch(Polygon(corners, facecolor=colour, edgecolor=EDGE, alpha=0.6))
    for at, colour in ((low[x], _RED), (high[x], _GREEN)):
        axes.plot([at, at], [low[y], high[y]], color=colour, linewidth=4.0, solid_capstyle="butt")
    for at in (low[y], high[y]):
        axes.plot([low[x], high[x]], [at, at], color=EDGE)
    axes.set(title=title, xlabel=f"{high[x] - low[x]:g} m", ylabel=f"{high[y] - low[y]:g} m", xticks=[], yticks=[])
    axes.set_aspect("equal")
    axes.set_anchor("N")
    axes.spines[:].set_visible(False)


def _outline(shape: Shape) -> tuple[_Points, str]:
    """World-space corners of a shape, and its role: ``wall``, ``lamp`` or ``solid``; no corners for other types."""
    if isinstance(shape, Quad):
        o, u, v = (np.asarray(each) for each in (shape.origin, shape.edge_u, shape.edge_v))
        return np.array([o, o + u, o + u + v, o + v]), "lamp" if shape.shines else "wall"
    if isinstance(shape, Sphere):
        center = np.asarray(shape.center)
        return np.array([center - shape.radius, center + shape.radius]), "solid"
    if isinstance(shape, Tetrahedron):
        return np.asarray(shape.vertices, np.float64), "solid"
    if isinstance(shape, Box):
        signs = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
        return _moved(np.asarray(shape.center) + signs * np.asarray(shape.size), shape.transform), "solid"
    return np.empty((0, 3)), ""


def _moved(points: _Points, transform: Transform | None) -> _Points:
    """Points rotated about the vertical and translated, which is all that the rooms use."""
    if transform is None:
        return points
    angle = math.radians(transform.rotate_degrees[1])
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    moved: _Points = points @ turn.T + np.asarray(transform.translate)
    return moved


def _hull(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Convex hull, in order around it (Andrew's monotone chain)."""
    ordered = sorted(set(points))

    def chain(some: list[tuple[float, float]]) -> list[tuple[float, float]]:
        kept: list[tuple[float, float]] = []
        for p in some:
            while len(kept) > 1 and _turns_right(kept[-2], kept[-1], p):
                kept.pop()
            kept.append(p)
        return kept[:-1]

    return chain(ordered) + chain(ordered[::-1])


def _turns_right(a: tuple[float, float], b: tuple[float, float], p: tuple[float, float]) -> bool:
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) <= 0.0


def hemisphere(count: int = 400) -> str:
    """Directions by the report's formula, θ = asin √y and φ = 2πx, seen from the side.

    Parameters
    ----------
    count : int
        Number of directions.
    """
    from matplotlib.patches import Arc, Ellipse

    random = np.random.default_rng(1)
    theta = np.arcsin(np.sqrt(random.random(count)))
    phi = 2.0 * np.pi * random.random(count)
    x, depth, z = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot()
        axes.add_patch(Ellipse((0.0, 0.0), 2.0, 2.0 * _TILT, facecolor="none", edgecolor=EDGE))
        axes.add_patch(Arc((0.0, 0.0), 2.0, 2.0, theta1=0.0, theta2=180.0, edgecolor=EDGE))
        axes.plot(x, math.sqrt(1.0 - _TILT**2) * z - _TILT * depth, ".", color=BLUE, markersize=4.0)
        axes.annotate("", (0.0, 1.16), (0.0, 0.0), arrowprops={"arrowstyle": "->", "color": INK, "linewidth": 1.6})
        axes.annotate("N", (0.04, 1.1))
        axes.set(xlim=(-1.1, 1.1), ylim=(-0.28, 1.22))
        axes.set_aspect("equal")
        axes.set_axis_off()

    title = "Cosine-weighted directions above a surface: many along its normal, few along the surface"
    return draw("figure-3", title, (5.6, 3.4), paint)
