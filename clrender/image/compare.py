"""Comparison of an image with a reference: means, errors, and perceived difference."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from clrender.errors import UsageError
from clrender.image.flip import flip_map
from clrender.wording import counted

__all__ = ["RELATIVE_FLOOR", "compare_images", "relative_squared_error"]

RELATIVE_FLOOR: Final = 0.01
"""Keeps relative errors finite where the reference is black."""
_BAND: Final = 1 << 20  # pixels

_Array: TypeAlias = npt.NDArray[np.floating[Any]]


def compare_images(image: npt.ArrayLike, reference: npt.ArrayLike) -> dict[str, Any]:
    """Compare a linear image with a reference.

    Parameters
    ----------
    image, reference : (H, W, 3) floats
        Linear Rec. 709 radiance, x and r below.

    Returns
    -------
    dict
        ``width``, ``height`` : pixels. ``mean``, ``reference_mean`` : [R, G, B] means.
        ``difference_of_means`` : (mean(x) - mean(r)) / mean(r), signed; 0 when both are 0, None when only r is.
        ``rmse`` : sqrt(mean((x - r)²)). ``relmse`` : mean((x - r)² / (r² + 0.01)).
        ``mean_relative_difference`` : mean(|x - r| / (|r| + 0.01)). ``max_difference`` : max(|x - r|).
        ``flip`` : mean LDR-FLIP of both, clamped to 0..1. ``identical`` : whether every value is equal.
        Means are over pixels and channels unless said otherwise.

    Raises
    ------
    UsageError
        They are not images, differ in size, or have values that are not finite.
    """
    x, r = _finite(image, "the image"), _finite(reference, "the reference")
    if x.shape != r.shape:
        raise UsageError(
            f"the images are {x.shape[1]} x {x.shape[0]} and {r.shape[1]} x {r.shape[0]} pixels; "
            "only images of one size can be compared."
        )
    bands = [_sums(x[rows].astype(np.float64), r[rows].astype(np.float64)) for rows in _bands(x)]
    total = {name: np.array([math.fsum(column) for column in zip(*values, strict=True)]) / x[..., 0].size
             for name, values in ((name, [band[name] for band in bands]) for name in bands[0])}  # fmt: skip
    mean, reference_mean = float(total["x"].mean()), float(total["r"].mean())
    bias = (mean - reference_mean) / reference_mean if reference_mean else (None if mean else 0.0)
    return {
        "width": x.shape[1],
        "height": x.shape[0],
        "mean": total["x"].tolist(),
        "reference_mean": total["r"].tolist(),
        "difference_of_means": bias,
        "rmse": float(np.sqrt(total["square"].mean())),
        "relmse": float(total["relative square"].mean()),
        "mean_relative_difference": float(total["relative"].mean()),
        "max_difference": max(_largest_difference(x[rows], r[rows]) for rows in _bands(x)),
        "flip": float(flip_map(x, r).mean()),
        "identical": bool(np.array_equal(x, r)),
    }


def _bands(image: _Array) -> Iterator[slice]:
    """Bands of rows, so that temporary arrays stay small compared with a large image."""
    step = max(1, _BAND // image.shape[1])
    return (slice(top, top + step) for top in range(0, len(image), step))


def _sums(x: npt.NDArray[np.float64], r: npt.NDArray[np.float64]) -> dict[str, list[float]]:
    """Sums over the pixels of a band, per channel."""
    difference = x - r
    terms = {
        "x": x,
        "r": r,
        "square": difference**2,
        "relative square": difference**2 / (r**2 + RELATIVE_FLOOR),
        "relative": np.abs(difference) / (np.abs(r) + RELATIVE_FLOOR),
    }
    return {name: term.sum(axis=(0, 1)).tolist() for name, term in terms.items()}


def _largest_difference(x: _Array, r: _Array) -> float:
    return float(np.abs(x.astype(np.float64) - r).max())


def relative_squared_error(difference: npt.ArrayLike, reference: npt.ArrayLike) -> float:
    """relMSE: mean(d² / (r² + 0.01)) over pixels and channels.

    Parameters
    ----------
    difference, reference : arrays of one shape
        Image minus reference, d, and reference, r: linear radiance.
    """
    d, r = np.asarray(difference, np.float64), np.asarray(reference, np.float64)
    return float(np.mean(d**2 / (r**2 + RELATIVE_FLOOR)))


def _finite(image: npt.ArrayLike, name: str) -> _Array:
    array = np.asarray(image)
    array = array if array.dtype.kind == "f" else np.asarray(array, np.float64)
    if array.ndim != 3 or array.shape[2] != 3 or array.size == 0:
        raise UsageError(f"{name} is not an array of (height, width, 3) numbers but of {array.shape}.")
    bad = sum(int(np.count_nonzero(~np.isfinite(array[rows]).all(axis=2))) for rows in _bands(array))
    if bad:
        raise UsageError(
            f"{name} has {counted(bad, 'pixel that is', 'pixels that are')} not finite; replace them before comparing."
        )
    return array
