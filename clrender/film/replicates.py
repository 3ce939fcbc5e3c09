"""Standard errors of a film's means, from the exact sums of its replicates and of their squares.

A replicate is a run of a pixel's samples with its own scrambling. Replicates are independent and identically
distributed, so their variance estimates the error of their mean, even if the samples within each are correlated
(Owen, "Monte Carlo variance of scrambled net quadrature", SIAM Journal on Numerical Analysis 34(5), 1997).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from clrender.errors import UsageError
from clrender.film.film import Film
from clrender.film.fixed_point import QUANTUM_BITS, to_float64
from clrender.film.unit import BLOCK, blocks_across
from clrender.image.tone_map import LUMINANCE

__all__ = [
    "deviations",
    "image_error",
    "pooled",
    "relative_error",
    "replicate_counts",
    "standard_error",
    "standard_error_of",
]

_CHUNK: Final = 1 << 12
"""Pixels processed at a time: their temporaries, about a hundred numbers per pixel, stay in the cache."""
_LIMB: Final = np.uint64(32)
_LOW: Final = np.uint64(0xFFFFFFFF)

_Words = npt.NDArray[np.uint64]
_Floats = npt.NDArray[np.float64]


def replicate_counts(film: Film) -> npt.NDArray[np.int64]:
    """Number of whole replicates of each pixel: (height, width) int64.

    Raises
    ------
    UsageError
        When the film has no replicates.
    """
    if not film.replicate_spp:
        raise UsageError("the film has no replicates, so its errors cannot be estimated; render with --replicate-spp")
    taken = (film.ledger.taken() // film.replicate_spp).reshape(-1, blocks_across(film.width))
    whole = taken.repeat(BLOCK, axis=0)[: film.height].repeat(BLOCK, axis=1)[:, : film.width]
    counts: npt.NDArray[np.int64] = np.ascontiguousarray(whole)
    return counts


def standard_error(film: Film) -> _Floats:
    """Standard error of the mean of each pixel and channel.

    A sample that was left out counts as 0 in its replicate.

    Parameters
    ----------
    film : Film
        A film with replicates.

    Returns
    -------
    (height, width, 3) float64
        Radiance; NaN for pixels with fewer than two replicates or without accepted samples.

    Raises
    ------
    UsageError
        When the film has no replicates, or its squares are inconsistent with its sums.
    RenderError
        After `Film.develop`.
    """
    return standard_error_of(film, slice(0, film.height))


def standard_error_of(film: Film, rows: slice) -> _Floats:
    """Standard errors for some rows only: (n, width, 3) float64.

    Parameters
    ----------
    film : Film
    rows : slice
        Half-open range within the image, possibly with a step.
    """
    wanted = range(*rows.indices(film.height))
    replicates, bands, squares = replicate_counts(film), film.bands(), film.square_bands()
    errors = np.empty((len(wanted), film.width, 3), np.float64)
    step = max(1, _CHUNK // film.width)
    for first in range(0, len(wanted), step):
        some = wanted[first : first + step]
        places = [divmod(row, film.band_rows) for row in some]
        sums = np.concatenate([bands[band][row] for band, row in places])
        of_squares = np.concatenate([squares[band][row] for band, row in places])
        counts, taken = film.counts[some].reshape(-1), replicates[some].reshape(-1)
        found = _errors_of(sums, of_squares, taken, counts)
        errors[first : first + len(some)] = found.reshape(len(some), film.width, 3)
    return errors


def _errors_of(
    sums: _Words, squares: _Words, replicates: npt.NDArray[np.int64], counts: npt.NDArray[np.uint32]
) -> _Floats:
    """Standard errors of the means of some pixels: (n, 3) float64, NaN where unknown."""
    spread = deviations(sums, squares, replicates)
    known = (replicates >= 2) & (counts > 0)
    divisor = np.where(known, replicates - 1.0, np.nan)[:, None]
    errors: _Floats = np.sqrt(spread / divisor) / np.maximum(counts, 1)[:, None]
    return errors


def relative_error(film: Film, most: int = 4096) -> float | None:
    """Mean standard error of the pixels' luminance over their mean luminance, from a grid of pixels.

    It is fast enough to be called repeatedly during a render. There must be no commits meanwhile, as in `on_progress`.

    Parameters
    ----------
    film : Film
    most : int
        Most pixels to evaluate.

    Returns
    -------
    float or None
        None if the film has no replicates, none of these pixels has two of them yet, or no light was found.
    """
    if not film.replicate_spp:
        return None
    step = math.ceil(math.sqrt(max(1.0, film.width * film.height / most)))
    rows, columns = np.arange(0, film.height, step), np.arange(0, film.width, step)
    taken = film.ledger.taken().reshape(-1, blocks_across(film.width))
    replicates = (taken[rows[:, None] // BLOCK, columns // BLOCK] // film.replicate_spp).reshape(-1)
    sums, squares = (
        np.concatenate([band[-index * film.band_rows % step :: step, ::step] for index, band in enumerate(bands)])
        for bands in (film.bands(), film.square_bands())
    )
    counts = film.counts[::step, ::step].reshape(-1)
    errors = _errors_of(sums.reshape(-1, 3, 2), squares.reshape(-1, 3, 4), replicates, counts)
    known = np.isfinite(errors[:, 0])
    mean = to_float64(sums).reshape(-1, 3)[known] / counts[known, None]
    luminance = float(np.sum(mean @ np.array(LUMINANCE)))
    # Channels of a pixel may be correlated: the error of their sum is at most that for full correlation
    return float(np.sum(errors[known] @ np.array(LUMINANCE))) / luminance if luminance > 0.0 else None


def image_error(errors: _Floats, shares: str = "") -> _Floats:
    """Standard error of the mean of all pixels, of each channel.

    Parameters
    ----------
    errors : (height, width, 3) float64
        Standard errors of pixels.
    shares : str
        Whether pixels of a ``block`` or of the whole ``image`` may be correlated; the result is then an upper bound.
        Otherwise (empty) pixels are independent.

    Returns
    -------
    (3,) float64
    """
    height, width, _ = errors.shape
    if shares == "image":
        whole: _Floats = errors.sum(axis=(0, 1)) / (height * width)
        return whole
    if shares == "block":
        rows, columns = (np.arange(0, side, BLOCK) for side in (height, width))
        errors = np.add.reduceat(np.add.reduceat(errors, rows, axis=0), columns, axis=1)
    total: _Floats = np.sqrt((errors**2).sum(axis=(0, 1))) / (height * width)
    return total


def pooled(errors: _Floats, scale: _Floats) -> _Floats:
    """Raise errors so that, relative to the pixel's scale, they are not smaller than in the neighbourhood.

    If light is found rarely, a pixel that misses it by chance is dark with a small error estimate; its neighbours
    correct that.

    Parameters
    ----------
    errors : (height, width, ...) float64
        NaN where unknown.
    scale : like errors
        Luminance or radiance, above 0 where errors are.

    Returns
    -------
    like errors
        The larger of a pixel's error and the root mean square over 3 x 3 pixels, each relative to its scale.
    """
    known = scale > 0.0
    relative = np.divide(errors, scale, out=np.where(errors > 0.0, np.inf, errors), where=known)
    height, width = errors.shape[:2]
    padded = np.pad(relative**2, [(1, 1), (1, 1)] + [(0, 0)] * (errors.ndim - 2), mode="edge")
    total = np.zeros_like(relative)
    for row in range(3):
        for column in range(3):
            total += padded[row : row + height, column : column + width]
    around: _Floats = np.maximum(errors, np.multiply(np.sqrt(total / 9.0), scale, out=errors.copy(), where=known))
    return around


def deviations(sums: _Words, squares: _Words, replicates: npt.NDArray[np.int64]) -> _Floats:
    """R Σx² − (Σx)² of R replicates: R times the sum of the squared deviations from their mean.

    It is computed in integers, to avoid cancellation if replicates hardly differ, and rounded once.

    Parameters
    ----------
    sums : (n, 3, 2) uint64
        Σx: two's complement, low word first, in quanta of 2^-64.
    squares : (n, 3, 4) uint64
        Σx², in quanta of 2^-128.
    replicates : (n,) int64
        Below 2^32.

    Returns
    -------
    (n, 3) float64

    Raises
    ------
    UsageError
        When the difference is negative, which is impossible for valid sums.
    """
    number = _limbs(_magnitude(sums))
    square = _product(number, number)
    times = _product(_limbs(squares), replicates.astype(np.uint64)[:, None, None])
    borrow = np.zeros(square.shape[:-1], np.int64)
    value = np.zeros(borrow.shape, np.float64)
    difference = np.empty(times.shape, np.float64)
    for k in range(times.shape[-1]):
        limb = times[..., k].astype(np.int64) - borrow
        limb -= square[..., k].astype(np.int64) if k < square.shape[-1] else 0
        borrow = (limb < 0).astype(np.int64)
        difference[..., k] = limb + (borrow << 32)
    if borrow.any():
        raise UsageError("the squares of the film's replicates are smaller than their sums allow; render it again")
    for k in reversed(range(times.shape[-1])):
        value = value * 2.0**32 + difference[..., k]
    return np.asarray(np.ldexp(value, -2 * QUANTUM_BITS), np.float64)


def _magnitude(sums: _Words) -> _Words:
    """Absolute values of two-word integers."""
    low, high = sums[..., 0], sums[..., 1]
    negative = high >> np.uint64(63) == 1
    high = np.where(negative, ~high + (low == 0).astype(np.uint64), high)
    return np.stack([np.where(negative, ~low + np.uint64(1), low), high], axis=-1)


def _limbs(words: _Words) -> _Words:
    """Split 64-bit words into 32-bit limbs, stored in uint64, least significant first."""
    return np.stack([words & _LOW, words >> _LIMB], axis=-1).reshape(*words.shape[:-1], -1)


def _product(a: _Words, b: _Words) -> _Words:
    """Product of integers given as limbs, (..., m) and (..., n): (..., m + n) limbs."""
    m, n = a.shape[-1], b.shape[-1]
    shape = (*np.broadcast_shapes(a.shape[:-1], b.shape[:-1]), m + n)
    product = np.zeros(shape, np.uint64)
    for i in range(m):
        for j in range(n):
            part = a[..., i] * b[..., j]
            product[..., i + j] += part & _LOW
            product[..., i + j + 1] += part >> _LIMB
    for k in range(m + n - 1):
        product[..., k + 1] += product[..., k] >> _LIMB
        product[..., k] &= _LOW
    return product
