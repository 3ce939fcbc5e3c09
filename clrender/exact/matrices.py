"""Products, lengths, determinants and inverses of small matrices, with the same bits on every machine.

Sums run from left to right, and nothing is fused. Leading axes are broadcast, as by NumPy's own functions.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

__all__ = ["determinant", "inner", "interpolated", "inverse", "length", "lengths", "product", "times", "total"]

_Floats = npt.NDArray[np.float64]


def inner(a: npt.ArrayLike, b: npt.ArrayLike) -> _Floats:
    """Inner products along the last axis.

    Parameters
    ----------
    a, b : (..., n) floats
    """
    products = np.asarray(a, np.float64) * np.asarray(b, np.float64)
    total = products[..., 0]
    for k in range(1, products.shape[-1]):
        total = total + products[..., k]
    return np.asarray(total, np.float64)


def product(a: npt.ArrayLike, b: npt.ArrayLike) -> _Floats:
    """The matrix product.

    Parameters
    ----------
    a : (..., m, n) floats
    b : (..., n, k) floats

    Returns
    -------
    (..., m, k) float64
    """
    first, second = np.asarray(a, np.float64), np.asarray(b, np.float64)
    total = first[..., :, 0, None] * second[..., None, 0, :]
    for k in range(1, first.shape[-1]):
        total = total + first[..., :, k, None] * second[..., None, k, :]
    return np.asarray(total, np.float64)


def times(matrix: npt.ArrayLike, vectors: npt.ArrayLike) -> _Floats:
    """A matrix times a column vector, or each of many.

    Parameters
    ----------
    matrix : (m, n) floats
    vectors : (..., n) floats

    Returns
    -------
    (..., m) float64
    """
    rows, columns = np.asarray(matrix, np.float64), np.asarray(vectors, np.float64)
    total = columns[..., 0, None] * rows[:, 0]
    for k in range(1, rows.shape[1]):
        total = total + columns[..., k, None] * rows[:, k]
    return np.asarray(total, np.float64)


def lengths(vectors: npt.ArrayLike) -> _Floats:
    """Euclidean lengths along the last axis.

    Parameters
    ----------
    vectors : (..., n) floats
    """
    return np.sqrt(inner(vectors, vectors))


def total(values: npt.ArrayLike) -> _Floats:
    """Sums along the first axis, from the first entry to the last.

    Parameters
    ----------
    values : (n, ...) floats
    """
    numbers = np.asarray(values, np.float64)
    return np.asarray(np.cumsum(numbers, axis=0)[-1] if len(numbers) else np.zeros(numbers.shape[1:]), np.float64)


def length(vector: npt.ArrayLike) -> float:
    """Euclidean length of one vector.

    Parameters
    ----------
    vector : (n,) floats
    """
    return float(lengths(vector))


def determinant(matrix: npt.ArrayLike) -> float:
    """Determinant of three rows: the volume that they span.

    Parameters
    ----------
    matrix : (3, 3) floats
    """
    x, y, z = np.asarray(matrix, np.float64)
    return float(inner(x, np.cross(y, z)))


def inverse(matrix: npt.ArrayLike) -> _Floats:
    """The inverse, by elimination with the largest pivot of each column (Gauss and Jordan).

    Parameters
    ----------
    matrix : (n, n) floats

    Raises
    ------
    ValueError
        The matrix is singular.
    """
    left = np.array(matrix, np.float64)
    size = len(left)
    both = np.concatenate([left, np.eye(size)], axis=1)
    for k in range(size):
        pivot = k + int(np.abs(both[k:, k]).argmax())
        if not 0.0 < abs(both[pivot, k]) < math.inf:
            raise ValueError("the matrix cannot be inverted")
        both[[k, pivot]] = both[[pivot, k]]
        both[k] /= both[k, k]
        for row in range(size):
            if row != k:
                both[row] -= both[row, k] * both[k]
    return np.ascontiguousarray(both[:, size:])


@np.errstate(over="ignore", invalid="ignore")  # of numbers that are refused where they are used
def interpolated(
    x: npt.ArrayLike, places: npt.ArrayLike, values: npt.ArrayLike, outside: float | None = None
) -> _Floats:
    """Piecewise linear interpolation.

    Parameters
    ----------
    x : (...) floats
    places : (n,) floats, ascending
    values : (n,) floats
    outside : float, optional
        Value beyond the first and the last place; default: that of the nearest one.
    """
    at, given, shares = np.asarray(x, np.float64), np.asarray(places, np.float64), np.asarray(values, np.float64)
    if len(given) == 1:
        found = np.full(at.shape, shares[0])
    else:
        left = np.clip(np.searchsorted(given, at, side="right") - 1, 0, len(given) - 2)
        slope = (shares[1:] - shares[:-1]) / (given[1:] - given[:-1])
        found = slope[left] * (at - given[left]) + shares[left]
        found = np.where(at >= given[-1], shares[-1], np.where(at < given[0], shares[0], found))
    return found if outside is None else np.where((at < given[0]) | (at > given[-1]), outside, found)
