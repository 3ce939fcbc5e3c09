"""The light tree, which samples lights by their estimated contribution at a point (Conty Estevez & Kulla, HPG 2018).

If there are lamps, each node also has a cone that bounds the directions of its light. A light that sends its flux into
a fraction q of its node's cone illuminates a point there with probability q, and then with 1/q of the mean. Sampling
by flux / √q has the least variance. So the power of a node is the sum of its lights' fluxes, each over the square root
of its cone's solid angle, divided by the square root of the node's own solid angle. For a single light this is its flux
over its solid angle; for a group that faces all directions, nearly the flux alone.

The tree is complete: node n has the children 2n and 2n + 1, and all lights are on the last level. It uses only
operations that every processor rounds alike, for the same bits everywhere.

Kernels multiply powers by squares of distances. Only ratios count, and factors that are powers of two round nothing. So
the tree is scaled to a size of about 1, and the powers of each pair of children to a sum of 1: no product leaves the
normal numbers of single precision, whatever the scene's size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.matrices import lengths

__all__ = ["NODE_WORDS", "Emitters", "LightTree", "light_tree"]

NODE_WORDS: Final = 8
"""Words per child: centre of its bounding sphere, radius (negative: infinitely distant), mean normal, power."""
_INFINITE: Final = -1.0
_LEAST_POWER: Final = 1e-30
"""Of a child with lights, relative to its sibling: so that its share remains above 0 in single precision."""
_CONE_MARGIN: Final = 1e-5
"""Margin of a cone's cosine for the single-precision rounding of a direction's cosine."""

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Emitters:
    """Light data that the tree is built from.

    Attributes
    ----------
    low, high : (L, 3) float64
        Bounds, metres.
    normal : (L, 3) float64
        Unit axis of the hemisphere that a light emits into; zero if it emits in all directions; for a lamp the mean
        direction of its light, shorter than 1.
    power : (L,) float64
        Flux over π, which for flat lights is the irradiance at 1 m in front, W/m²; for infinitely distant lights their
        irradiance. Above 0.
    infinite : (L,) bool
    radius : float
        Of the scene, metres.
    cones : (L, 4) float64 or None
        If there are lamps: unit axis of the cone that bounds a light's emission, and cosine of its half angle, -1 for
        emission in all directions.
    """

    low: _Floats
    high: _Floats
    normal: _Floats
    power: _Floats
    infinite: NDArray[np.bool_]
    radius: float
    cones: _Floats | None = None


@dataclass(frozen=True)
class LightTree:
    """The tree as kernels read it.

    Attributes
    ----------
    rows : (N, 16) float32
        Both children of each node, `NODE_WORDS` each, lengths times a power of two, which row 0 begins with.
    order : (N,) uint32
        The light at each position of the last level.
    place : (L,) uint32
        The number of each light's node on the last level.
    levels : int
        Depth of the lights.
    cones : (N, 8) float32 or None
        Cones of both children of each node, `CONE_ROW_*` of types.h, each with a small margin.
    """

    rows: NDArray[np.float32]
    order: NDArray[np.uint32]
    place: NDArray[np.uint32]
    levels: int
    cones: NDArray[np.float32] | None = None


def light_tree(emitters: Emitters) -> LightTree:
    """Build the tree.

    Parameters
    ----------
    emitters : Emitters
        At least two.
    """
    groups = [np.flatnonzero(some) for some in (~emitters.infinite, emitters.infinite) if some.any()]
    depth = max(int(len(group) - 1).bit_length() for group in groups)
    parts = [_levels(emitters, group, depth) for group in groups]
    levels = [np.concatenate([part[1][level] for part in parts]) for level in range(depth + 1)]
    top = levels if len(parts) == 1 else [np.zeros((1, NODE_WORDS)), *levels]
    words = np.concatenate([np.zeros((1, NODE_WORDS)), *top])
    order = np.concatenate([part[0] for part in parts])
    cones = None
    if emitters.cones is not None:
        about = _cones(emitters.cones, order)
        words[1:, 7] *= np.sqrt(_narrowness(about[:, 3]))
        cones = np.concatenate([np.zeros((1, 4)), about])
        cones[:, 3] -= _CONE_MARGIN
        cones = cones.astype(np.float32).reshape(len(order), 8)
    words[0, 0] = _scale_down(words, emitters)
    _even_out(words)
    there = order >= 0
    place = np.zeros(len(emitters.power), np.uint32)
    place[order[there]] = len(order) + np.flatnonzero(there)
    rows = words.astype(np.float32).reshape(len(order), 2 * NODE_WORDS)
    return LightTree(rows, np.maximum(order, 0).astype(np.uint32), place, len(top) - 1, cones)


def _scale_down(words: _Floats, emitters: Emitters) -> float:
    """Scale all lengths to about 1 by a power of two, and powers so that irradiances stay; return the factor."""
    finite = words[:, 3] >= 0.0
    size = max(emitters.radius, float(np.abs(words[finite, :3]).max(initial=0.0)))
    scale = math.ldexp(1.0, -math.frexp(size)[1])
    words[finite, :4] *= scale
    words[finite, 7] *= scale * scale
    return scale


def _even_out(words: _Floats) -> None:
    """Replace the powers of each pair of children by their shares, so that they add up to 1."""
    power = words[:, 7].reshape(-1, 2)
    _, exponent = np.frexp(power.max(axis=1))
    even = np.ldexp(power, -exponent[:, None])
    total = even[:, 0] + even[:, 1]
    shares = np.divide(even, total[:, None], out=np.zeros_like(even), where=total[:, None] > 0.0)
    power[:] = np.where(power > 0.0, np.maximum(shares, _LEAST_POWER), 0.0)


def _narrowness(cosine: _Floats) -> _Floats:
    """Ratio of the intensity of a light that fills a cone to that of a cosine emitter of the same power."""
    narrowness: _Floats = 1.0 / np.clip(2.0 - 2.0 * cosine, 1e-12, 1.0)
    return narrowness


def _cones(cones: _Floats, order: NDArray[np.int64]) -> _Floats:
    """Cones of all nodes, (N, 4), from the root down to the lights."""
    there = (order >= 0)[:, None]
    levels = [np.where(there, cones[order], (0.0, 0.0, 0.0, 2.0))]
    while len(levels[0]) > 1:
        levels.insert(0, _about(levels[0][::2], levels[0][1::2]))
    return np.concatenate(levels)


def _about(first: _Floats, second: _Floats) -> _Floats:
    """A cone that bounds each pair of cones; a cosine of 2 marks an empty one."""
    axis = first[:, :3] + second[:, :3]
    size = lengths(axis)[:, None]
    apart = size > 1e-6
    axis = np.divide(axis, size, out=np.zeros_like(axis), where=apart)
    cosine = np.minimum(_widened(axis, first), _widened(axis, second))
    both = np.concatenate([axis, np.where(apart[:, 0], cosine, -1.0)[:, None]], axis=1)
    return np.where(first[:, 3:] > 1.0, second, np.where(second[:, 3:] > 1.0, first, both))


def _widened(axis: _Floats, cone: _Floats) -> _Floats:
    """Cosine of the angle between an axis and the farthest edge of a cone."""
    between = axis[:, 0] * cone[:, 0] + axis[:, 1] * cone[:, 1] + axis[:, 2] * cone[:, 2]
    sines = [np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0)) for cosine in (between, cone[:, 3])]
    # From half a turn on, the cone is the full sphere
    return np.where(between + cone[:, 3] > 0.0, between * cone[:, 3] - sines[0] * sines[1], -1.0)


def _levels(emitters: Emitters, group: NDArray[np.int64], depth: int) -> tuple[NDArray[np.int64], list[_Floats]]:
    """The lights of a subtree in order, −1 for empty positions, and the words of its nodes, level by level."""
    count = 1 << depth
    order = np.full(count, -1)
    order[: len(group)] = group
    order = _sorted(emitters, order, depth)
    there = (order >= 0)[:, None]
    low, high = np.where(there, emitters.low[order], np.inf), np.where(there, emitters.high[order], -np.inf)
    normals = np.where(there, emitters.normal[order], 0.0)
    power = np.where(there[:, 0], emitters.power[order], 0.0)
    if emitters.cones is not None:
        power = power * np.sqrt(_narrowness(emitters.cones[order, 3]))
    normals *= power[:, None]
    infinite = bool(emitters.infinite[group[0]])
    levels: list[_Floats] = []
    while True:
        levels.insert(0, _words(low, high, normals, power, infinite))
        if len(power) == 1:
            return order, levels
        low, high = np.minimum(low[::2], low[1::2]), np.maximum(high[::2], high[1::2])
        power, normals = power[::2] + power[1::2], normals[::2] + normals[1::2]


def _sorted(emitters: Emitters, order: NDArray[np.int64], depth: int) -> NDArray[np.int64]:
    """Order lights so that each node's halves lie on either side of the median along the axis of largest extent."""
    center = emitters.low * 0.5 + emitters.high * 0.5
    for level in range(depth):
        runs = order.reshape(1 << level, -1)
        there = (runs >= 0)[:, :, None]
        at = center[runs]
        spread = np.where(there, at, -np.inf).max(1) - np.where(there, at, np.inf).min(1)
        axis = spread.argmax(1)
        along = np.where(there[:, :, 0], np.take_along_axis(at, axis[:, None, None], 2)[:, :, 0], np.inf)
        # Empty positions come last, so that lights stay together.
        order = np.take_along_axis(runs, along.argsort(1, kind="stable"), 1).reshape(-1)
    return order


def _words(low: _Floats, high: _Floats, normals: _Floats, power: _Floats, infinite: bool) -> _Floats:
    words = np.zeros((len(power), NODE_WORDS))
    there = power > 0.0
    low, high = np.where(there[:, None], low, 0.0), np.where(there[:, None], high, 0.0)
    words[:, :3] = low * 0.5 + high * 0.5
    half = (high - low) * 0.5
    radius = lengths(half)
    words[:, 3] = _INFINITE if infinite else radius
    words[:, 4:7] = np.divide(normals, power[:, None], out=np.zeros_like(normals), where=there[:, None])
    words[:, 7] = power
    return words
