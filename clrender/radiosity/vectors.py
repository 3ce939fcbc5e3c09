"""Vector operations on arrays with sums in a fixed order: the same bits with every version of NumPy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["cross", "dot"]

_Floats = NDArray[np.float64]


def cross(a: _Floats, b: _Floats) -> _Floats:
    """The cross product of `a`, (..., 3), with `b`."""
    (ax, ay, az), (bx, by, bz) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def dot(a: _Floats, b: _Floats) -> _Floats:
    """The inner product of `a`, (..., 3), with `b`."""
    product = a * b
    inner: _Floats = (product[..., 0] + product[..., 1]) + product[..., 2]
    return inner
