"""How far an image is from a reference: means, errors, and what a viewer would notice."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from clrender.errors import UsageError
from clrender.image.flip import flip_map

__all__ = ["RELATIVE_FLOOR", "compare_images", "relative_squared_error"]

RELATIVE_FLOOR: Final = 0.01
"""Keeps relative errors finite where the reference is black."""


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
        ``flip`` : mean LDR-FLIP of both, cut to 0..1. ``identical`` : whether every value is equal.
        Means are over pixels and channels unless said otherwise.

    Raises
    ------
    UsageError
        Not images, of two sizes, or with values that are not finite.
    """
    x, r = _finite(image, "the image"), _finite(reference, "the reference")
    if x.shape != r.shape:
        raise UsageError(
            f"the images are {x.shape[1]} x {x.shape[0]} and {r.shape[1]} x {r.shape[0]} pixels; "
            "only images of one size can be compared."
        )
    difference = x - r
    mean, reference_mean = float(x.mean()), float(r.mean())
    bias = (mean - reference_mean) / reference_mean if reference_mean else (None if mean else 0.0)
    return {
        "width": x.shape[1],
        "height": x.shape[0],
        "mean": x.mean(axis=(0, 1)).tolist(),
        "reference_mean": r.mean(axis=(0, 1)).tolist(),
        "difference_of_means": bias,
        "rmse": float(np.sqrt(np.mean(difference**2))),
        "relmse": relative_squared_error(difference, r),
        "mean_relative_difference": float(np.mean(np.abs(difference) / (np.abs(r) + RELATIVE_FLOOR))),
        "max_difference": float(np.abs(difference).max()),
        "flip": float(flip_map(x, r).mean()),
        "identical": bool(np.array_equal(x, r)),
    }


def relative_squared_error(difference: npt.ArrayLike, reference: npt.ArrayLike) -> float:
    """relMSE: mean(d² / (r² + 0.01)) over pixels and channels.

    Parameters
    ----------
    difference, reference : arrays of one shape
        Image minus reference, d, and reference, r: linear radiance.
    """
    d, r = np.asarray(difference, np.float64), np.asarray(reference, np.float64)
    return float(np.mean(d**2 / (r**2 + RELATIVE_FLOOR)))


def _finite(image: npt.ArrayLike, name: str) -> npt.NDArray[np.float64]:
    array = np.asarray(image, np.float64)
    if array.ndim != 3 or array.shape[2] != 3 or array.size == 0:
        raise UsageError(f"{name} is not an array of (height, width, 3) numbers but of {array.shape}.")
    bad = int(np.count_nonzero(~np.isfinite(array).all(axis=2)))
    if bad:
        raise UsageError(f"{name} has {bad} pixels that are not finite; mend them before comparing.")
    return array
