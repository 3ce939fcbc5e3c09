"""Evaluates an animation at a time: translations, rotations, scales and weights of morph targets."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.exact.angles import arccosine, sin_cos
from clrender.importers.gltf.accessors import Accessors
from clrender.importers.gltf.document import Document
from clrender.wording import quoted

__all__ = ["Moved", "moved_at", "values_at"]

Moved: TypeAlias = dict[tuple[int, str], list[float]]
"""Animated values, by node and path."""


def moved_at(document: Document, accessors: Accessors, seconds: float | None) -> Moved:
    """Values of the file's first animation; constant before its first and after its last key frame.

    Parameters
    ----------
    document, accessors
        Checked.
    seconds : float, optional
        Time from the start of the animation; default: nothing is animated.
    """
    animations = document.items("animations")
    if seconds is None:
        if animations:
            document.note("it has animations; the image is of the model at rest, another moment with --time-at SECONDS")
        return {}
    if not animations:
        document.note("it has no animation, so that the time asked for changes nothing")
        return {}
    if len(animations) > 1:
        name = animations[0].get("name", "0")
        document.note(f"it has {len(animations)} animations; of these the first, {quoted(name)}, moves the model")
    return values_at(document, accessors, seconds)


def values_at(document: Document, accessors: Accessors, seconds: float) -> Moved:
    """Like `moved_at`, of a file that has an animation, and without notes."""
    animations = document.items("animations")
    moved: Moved = {}
    for channel in animations[0]["channels"]:
        target = channel["target"]
        if "node" in target and target.get("path") in ("translation", "rotation", "scale", "weights"):
            sampler = animations[0]["samplers"][channel["sampler"]]
            moved[target["node"], target["path"]] = _value(accessors, sampler, target["path"], seconds)
    return moved


def _value(accessors: Accessors, sampler: dict[str, Any], path: str, seconds: float) -> list[float]:
    """A value interpolated according to appendix C of the specification."""
    times = accessors.raw(sampler["input"]).astype(np.float64)
    kind = sampler.get("interpolation", "LINEAR")
    values = accessors.floats(sampler["output"]).astype(np.float64)
    # (frames, 1 or 3, numbers): a spline has a tangent before and after each value
    values = values.reshape(len(times), 3 if kind == "CUBICSPLINE" else 1, -1)
    middle = values[:, values.shape[1] // 2]
    after = int(np.searchsorted(times, seconds, "right"))
    if after in (0, len(times)) or kind == "STEP":
        return _unit(middle[max(after - 1, 0)], path)
    before = after - 1
    step = times[after] - times[before]
    t = (seconds - times[before]) / step
    if kind == "CUBICSPLINE":
        a, b, square, cube = values[before], values[after], t * t, t * t * t
        value = (
            (2 * cube - 3 * square + 1) * a[1]
            + step * (cube - 2 * square + t) * a[2]
            + (-2 * cube + 3 * square) * b[1]
            + step * (cube - square) * b[0]
        )
        return _unit(value, path)
    if path == "rotation":
        return _between(middle[before], middle[after], t)
    return [float(x) for x in (1.0 - t) * middle[before] + t * middle[after]]


def _unit(value: NDArray[np.float64], path: str) -> list[float]:
    numbers = [float(x) for x in value]
    size = math.sqrt(sum(x * x for x in numbers))
    return [x / size for x in numbers] if path == "rotation" and size > 0.0 else numbers


def _between(a: NDArray[np.float64], b: NDArray[np.float64], t: float) -> list[float]:
    """Spherical linear interpolation of quaternions, along the shorter arc."""
    dot = sum(float(x * y) for x, y in zip(a, b, strict=True))
    sign = -1.0 if dot < 0.0 else 1.0
    angle = arccosine(min(abs(dot), 1.0))
    if angle < 1e-6:
        return _unit((1.0 - t) * a + t * sign * b, "rotation")
    first, second, whole = (sin_cos(share * angle)[0] for share in (1.0 - t, t, 1.0))
    return _unit((first * a + sign * second * b) / whole, "rotation")
