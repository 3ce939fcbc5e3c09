"""Tests whether two films agree: each pixel, and the mean of the whole image, by the films' own error estimates."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from clrender.agreement.significance import holm
from clrender.errors import UsageError
from clrender.film import Film
from clrender.film.replicates import image_error, pooled, replicate_counts, standard_error
from clrender.integrators import INTEGRATORS
from clrender.statistics.student_t import p_value

__all__ = ["LEVEL", "compare_films"]

LEVEL: Final = 0.01
"""Probability of finding a difference if there is none; half of it is for pixels, half for the mean."""

_ROUNDING: Final = 1e-6
"""Largest relative difference due to single-precision samples."""
_FLOOR_SHARE: Final = 0.1
"""Fraction of the mean radiance; darker pixels count as this bright when errors are compared with neighbours'."""
_MAYBE: Final = 2.5
"""No value of t below it is significant, so its probability is not computed."""

_Floats = npt.NDArray[np.float64]


def compare_films(first: Film, second: Film, names: tuple[str, str] = ("one film", "the other")) -> dict[str, Any]:
    """Test whether two films estimate the same image.

    Welch's t-test of each pixel and channel, with Holm's correction for their number; errors are those of
    `clrender.film.replicates.pooled`.

    Parameters
    ----------
    first, second : Film
        With two or more replicates in each pixel.
    names : (str, str)
        Names of the films in messages.

    Returns
    -------
    dict
        JSON-able. ``level`` : of all tests together. ``agree`` : no test found a difference. ``pixels`` : tested.
        ``differing_pixels`` : where some channel differs. ``first_differing`` : column and row of the one of smallest
        p, or None. ``smallest_p`` : corrected for the number of pixels and channels, at most 1. ``mean_difference``,
        ``mean_error`` : [R, G, B] of the means over the image, first minus second, and its standard error.
        ``mean_differs`` : whether some channel of it does. ``largest_z`` : |difference| over its error of any pixel.

    Raises
    ------
    UsageError
        A film has no replicates, or too few; they are of two sizes; or their samples depend on each other.
    """
    _check(first, second, names)
    films, means, variances = (first, second), [], []
    for film, name in zip(films, names, strict=True):
        try:
            error = standard_error(film)
        except UsageError as problem:
            raise UsageError(f"{name}: {problem}") from None
        means.append(film.mean().astype(np.float64))
        variances.append(error**2)
    difference = means[0] - means[1]
    beyond = np.maximum(np.abs(difference) - _ROUNDING * np.maximum(np.abs(means[0]), np.abs(means[1])), 0.0)
    scales = [np.maximum(np.abs(mean), _FLOOR_SHARE * np.abs(mean).mean()) for mean in means]
    u, v = (pooled(np.sqrt(each), scale) ** 2 for each, scale in zip(variances, scales, strict=True))
    counts = [replicate_counts(film)[..., None] - 1.0 for film in films]
    t = np.where(beyond > 0.0, np.inf, 0.0)
    np.divide(beyond, np.sqrt(u + v), out=t, where=u + v > 0.0)
    below = u * u / counts[0] + v * v / counts[1]
    df = np.broadcast_to(np.minimum(*counts), t.shape).copy()
    np.divide((u + v) ** 2, below, out=df, where=below > 0.0)
    p, some = np.ones(t.shape), t > _MAYBE
    p[some] = p_value(t[some], df[some])
    differs = holm(p.ravel(), LEVEL / 2.0).reshape(p.shape).any(axis=2)
    row, column = np.unravel_index(int(p.min(axis=2).argmin()), differs.shape)

    shared = [film.request.get("shares", INTEGRATORS[film.request["integrator"]].shares) for film in films]
    errors = [image_error(np.sqrt(each), shares) for each, shares in zip(variances, shared, strict=True)]
    of_mean, error = difference.mean(axis=(0, 1)), np.sqrt(errors[0] ** 2 + errors[1] ** 2)
    allowed = _ROUNDING * np.maximum(np.abs(means[0]), np.abs(means[1])).mean(axis=(0, 1))
    left = np.maximum(np.abs(of_mean) - allowed, 0.0)
    score = np.divide(left, error, out=np.where(left > 0.0, np.inf, 0.0), where=error > 0.0)
    mean_differs = bool(holm(p_value(score, float(counts[0].min() + counts[1].min())), LEVEL / 2.0).any())
    return {
        "level": LEVEL,
        "agree": not (mean_differs or bool(differs.any())),
        "pixels": int(differs.size),
        "differing_pixels": int(np.count_nonzero(differs)),
        "first_differing": [int(column), int(row)] if differs.any() else None,
        "smallest_p": min(1.0, float(p.min()) * p.size),
        "largest_z": float(np.minimum(t, 1e300).max()),
        "mean_difference": of_mean.tolist(),
        "mean_error": error.tolist(),
        "mean_differs": mean_differs,
    }


def _check(first: Film, second: Film, names: tuple[str, str]) -> None:
    """Check that both films have error estimates, and are independent."""
    for film, name in zip((first, second), names, strict=True):
        if not film.replicate_spp:
            raise UsageError(
                f"{name}: has no replicates, so its errors cannot be estimated; render it with --replicate-spp 16"
            )
        if film.request.get("integrator") not in INTEGRATORS:
            raise UsageError(f"{name}: does not record its integrator; render it again")
        if int(replicate_counts(film).min()) < 2:
            raise UsageError(f"{name}: has pixels with fewer than two replicates; render it with more samples")
    if (first.width, first.height) != (second.width, second.height):
        raise UsageError(
            f"{names[0]} has {first.width} x {first.height} pixels and {names[1]} {second.width} x {second.height}; "
            "only films of one size can be compared"
        )
    if first.request.get("seed") != second.request.get("seed"):
        return
    try:
        if first.request != second.request:
            raise UsageError("two requests")
        first.ledger.copy().unite(second.ledger)
    except UsageError:
        raise UsageError(
            f"{names[0]} and {names[1]} have the same seed, so they are not independent of each other; render one of "
            "them with another --seed"
        ) from None
