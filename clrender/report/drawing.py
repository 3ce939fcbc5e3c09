"""Drawings: the room's measures (figure 1) and a hemisphere of sampled directions (figure 3), as SVG."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from clrender.report.plot import STYLE
from clrender.scene import Box, Quad, Sphere, Tetrahedron, Transform

if TYPE_CHECKING:
    from clrender.scene import Scene, Shape

__all__ = ["hemisphere", "room_measures"]

_Points = npt.NDArray[np.float64]
_METRE = 58.0


def room_measures(scene: Scene) -> str:
    """Plan and front view of a room with its measures in metres, drawn from the scene.

    Parameters
    ----------
    scene : Scene
        Quads, boxes, spheres and tetrahedra, with the room as its outermost quads.
    """
    shapes = [(shape, *_outline(shape)) for shape in scene.shapes if _outline(shape)[0].size]
    everything = np.concatenate([points for _, points, _ in shapes])
    low, high = everything.min(0), everything.max(0)
    size = high - low
    plan_top, gap = 40.0, 90.0
    front_left = 70.0 + size[0] * _METRE + gap
    width, height = front_left + size[0] * _METRE + 30.0, plan_top + max(size[2], size[1]) * _METRE + 46.0

    def from_above(p: _Points) -> tuple[float, float]:
        return 70.0 + float(p[0] - low[0]) * _METRE, plan_top + float(p[2] - low[2]) * _METRE

    def from_front(p: _Points) -> tuple[float, float]:
        return front_left + float(p[0] - low[0]) * _METRE, plan_top + float(high[1] - p[1]) * _METRE

    camera = np.asarray(scene.camera.position)
    cx, cy = from_above(camera)
    title = f"The room: {size[0]:g} m wide, {size[1]:g} m high, {size[2]:g} m deep"
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" role="img" '
        f'aria-label="{escape(title)}">{STYLE}<title>{escape(title)}</title>',
        f'<rect class="paper" width="{width:.0f}" height="{height:.0f}"/>',
        *_view(shapes, from_above, low, high, (0, 2), "from above"),
        *_view(shapes, from_front, low, high, (0, 1), "from the front"),
        f'<path class="c line" d="M{cx - 26:.1f} {cy - 30:.1f}L{cx:.1f} {cy:.1f}L{cx + 26:.1f} {cy - 30:.1f}"/>',
        f'<text class="ink" x="{cx + 10:.1f}" y="{cy + 4:.1f}">camera</text>',
        "</svg>",
    ]
    return "\n".join(parts)


def _view(
    shapes: Sequence[tuple[Shape, _Points, str]], place: Callable[[_Points], tuple[float, float]], low: _Points,
    high: _Points, axes: tuple[int, int], title: str,
) -> list[str]:  # fmt: skip
    """One view: what stands in the room, its walls in their colours, and its measures."""
    (left, a), (right, b) = place(low), place(high)
    top, bottom = min(a, b), max(a, b)
    size = high - low
    parts = []
    for shape, points, kind in shapes:
        if kind == "wall":
            continue
        if isinstance(shape, Sphere):
            x, y = place(np.asarray(shape.center))
            parts.append(f'<circle class="solid rim" cx="{x:.1f}" cy="{y:.1f}" r="{shape.radius * _METRE:.1f}"/>')
            continue
        corners = _hull([place(point) for point in points])
        path = "L".join(f"{x:.1f} {y:.1f}" for x, y in corners)
        parts.append(f'<path class="{"lamp" if kind == "lamp" else "solid"} rim" d="M{path}Z"/>')
    middle = (left + right) / 2.0
    parts += [
        f'<path class="edge" d="M{left:.1f} {top:.1f}H{right:.1f}M{left:.1f} {bottom:.1f}H{right:.1f}"/>',
        f'<path class="wall-red" stroke-width="4" d="M{left:.1f} {top:.1f}V{bottom:.1f}"/>',
        f'<path class="wall-green" stroke-width="4" d="M{right:.1f} {top:.1f}V{bottom:.1f}"/>',
        f'<text class="ink" x="{middle:.1f}" y="{top - 14:.1f}" text-anchor="middle">{title}</text>',
        f'<text class="ink" x="{middle:.1f}" y="{bottom + 24:.1f}" text-anchor="middle">{size[axes[0]]:g} m</text>',
        f'<text class="ink" x="{left - 10:.1f}" y="{(top + bottom) / 2:.1f}" text-anchor="end">'
        f"{size[axes[1]]:g} m</text>",
    ]
    return parts


def _outline(shape: Shape) -> tuple[_Points, str]:
    """World-space corners of a shape, and what it is: ``wall``, ``lamp`` or ``solid``; none of further types."""
    if isinstance(shape, Quad):
        o, u, v = (np.asarray(each) for each in (shape.origin, shape.edge_u, shape.edge_v))
        lamp = shape.emission is not None and any(shape.emission)
        return np.array([o, o + u, o + u + v, o + v]), "lamp" if lamp else "wall"
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
    """Points through a turn about the vertical and a translation, which is all that the rooms have."""
    if transform is None:
        return points
    angle = math.radians(transform.rotate_degrees[1])
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    moved: _Points = points @ turn.T + np.asarray(transform.translate)
    return moved


def _hull(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Convex hull, counted round (monotone chain)."""
    ordered = sorted(set(points))

    def chain(some: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
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
        Of directions.
    """
    title = "Directions over a surface: many along its normal, few along the surface"
    random = np.random.default_rng(1)
    theta = np.arcsin(np.sqrt(random.random(count)))
    phi = 2.0 * np.pi * random.random(count)
    x, depth, z = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)
    radius, cx, cy = 170.0, 200.0, 200.0
    upright = math.sqrt(1.0 - 0.2**2)  # looked at from a little above
    dots = [
        f'<circle class="a" cx="{cx + radius * a:.1f}" cy="{cy - radius * (upright * c - 0.2 * b):.1f}" r="1.7"/>'
        for a, b, c in zip(x, depth, z, strict=True)
    ]
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 400 250" role="img" aria-label="{escape(title)}">'
            f'{STYLE}<title>{escape(title)}</title><rect class="paper" width="400" height="250"/>',
            f'<ellipse class="edge" cx="{cx:g}" cy="{cy:g}" rx="{radius:g}" ry="{0.2 * radius:g}"/>',
            f'<path class="edge" d="M{cx - radius:g} {cy:g}A{radius:g} {radius:g} 0 0 1 {cx + radius:g} {cy:g}"/>',
            *dots,
            f'<path class="edge" d="M{cx:g} {cy:g}V14" stroke-width="2"/>',
            f'<text class="ink" x="{cx + 8:g}" y="22">N</text>',
            "</svg>",
        ]
    )
