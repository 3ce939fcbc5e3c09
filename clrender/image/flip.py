"""FLIP: the perceived difference of two images when a viewer flips between them.

LDR-FLIP of P. Andersson, J. Nilsson, T. Akenine-Möller, M. Oskarsson, K. Åström and M. D. Fairchild, "FLIP: A
Difference Evaluator for Alternating Images", HPG 2020; section and equation numbers below are of that paper.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from clrender.exact.matrices import inverse, times

__all__ = ["PIXELS_PER_DEGREE", "flip_map"]

PIXELS_PER_DEGREE: Final = 0.7 * (3840 / 0.7) * math.pi / 180
"""The paper's default viewing condition: 0.7 m from a monitor 0.7 m and 3840 pixels wide."""

_Array = npt.NDArray[np.float64]

# Linear Rec. 709 to XYZ, exactly (D65).
_XYZ: Final = np.array(
    [
        [10135552 / 24577794, 8788810 / 24577794, 4435075 / 24577794],
        [2613072 / 12288897, 8788810 / 12288897, 887015 / 12288897],
        [1425312 / 73733382, 8788810 / 73733382, 70074185 / 73733382],
    ]
)
_WHITE: Final = _XYZ.sum(axis=1)

# Table 1: contrast sensitivity of the channels as sums of Gaussians, (a, b) each.
_SENSITIVITY: Final = (((1.0, 0.0047),), ((1.0, 0.0053),), ((34.1, 0.04), (13.5, 0.025)))
_WIDEST: Final = 0.04
_COLOR_EXPONENT: Final = 0.7  # q_c, sec. 4.1.3
_KNEE_COLOR: Final = 0.4  # p_c
_KNEE_ERROR: Final = 0.95  # p_t
_FEATURE_WIDTH: Final = 0.082  # w, degrees, sec. 4.2
_FEATURE_EXPONENT: Final = 0.5  # q_f
_BAND: Final = 1 << 19  # pixels


def flip_map(test: npt.ArrayLike, reference: npt.ArrayLike, ppd: float = PIXELS_PER_DEGREE) -> _Array:
    """Perceived difference of each pixel.

    Parameters
    ----------
    test, reference : (H, W, 3) floats
        *Linear* Rec. 709 as displayed, clamped to 0..1. The result is symmetric in the two.
    ppd : float
        Pixels per degree of the viewer's field of view.

    Returns
    -------
    (H, W) float64
        0 (the same) to 1.
    """
    x, r = np.asarray(test), np.asarray(reference)
    # Bands of rows, padded by the filters' radius, keep temporary arrays small compared with a large image.
    halo = max(_color_radius(ppd), _feature_radius(ppd))
    height, width = x.shape[:2]
    step = max(4 * halo, _BAND // width)
    result = np.empty((height, width))
    for top in range(0, height, step):
        low, high = max(0, top - halo), min(height, top + step + halo)
        result[top : top + step] = _flip(x[low:high], r[low:high], ppd)[top - low :][:step]
    return result


def _flip(test: npt.NDArray[Any], reference: npt.NDArray[Any], ppd: float) -> _Array:
    images = [_opponent(np.clip(np.asarray(image, np.float64), 0.0, 1.0)) for image in (test, reference)]
    # Colour (sec. 4.1): what the eye resolves, in a uniform space, as a distance for large differences.
    seen = [_hunt_lab(_filtered(image, ppd)) for image in images]
    color = _redistribute(_hyab(seen[0], seen[1]) ** _COLOR_EXPONENT)
    # Features (sec. 4.2): edges and points in one image and not in the other.
    found = [_features((image[..., 0] + 16.0) / 116.0, ppd) for image in images]
    feature = np.maximum(np.abs(found[0][0] - found[1][0]), np.abs(found[0][1] - found[1][1]))
    feature = (feature / math.sqrt(2.0)) ** _FEATURE_EXPONENT
    # Eq. 7
    return np.asarray(color ** (1.0 - feature), np.float64)


def _opponent(linear: _Array) -> _Array:
    """YCxCz of linear Rec. 709: a linear opponent space."""
    x, y, z = np.moveaxis(times(_XYZ, linear) / _WHITE, -1, 0)
    return np.stack([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)], axis=-1)


def _linear(opponent: _Array) -> _Array:
    y = (opponent[..., 0] + 16.0) / 116.0
    x, z = y + opponent[..., 1] / 500.0, y - opponent[..., 2] / 200.0
    return times(inverse(_XYZ), np.stack([x, y, z], axis=-1) * _WHITE)


def _hunt_lab(linear: _Array) -> _Array:
    """CIE L*a*b* with the chroma of dark colours lowered (Hunt effect), sec. 4.1.2."""
    ratio = times(_XYZ, linear) / _WHITE
    delta = 6.0 / 29.0
    f = np.where(ratio > delta**3, np.cbrt(ratio), ratio / (3.0 * delta**2) + 4.0 / 29.0)
    lightness = 116.0 * f[..., 1] - 16.0
    a, b = 500.0 * (f[..., 0] - f[..., 1]), 200.0 * (f[..., 1] - f[..., 2])
    return np.stack([lightness, 0.01 * lightness * a, 0.01 * lightness * b], axis=-1)


def _hyab(first: _Array, second: _Array) -> _Array:
    difference = first - second
    return np.asarray(np.abs(difference[..., 0]) + np.hypot(difference[..., 1], difference[..., 2]))


def _redistribute(color: _Array) -> _Array:
    """Map HyAB^q to 0..1, small differences to nearly all of it (sec. 4.1.3, eq. 5)."""
    green, blue = _hunt_lab(np.array([0.0, 1.0, 0.0])), _hunt_lab(np.array([0.0, 0.0, 1.0]))
    largest = float(_hyab(green, blue)) ** _COLOR_EXPONENT
    knee = _KNEE_COLOR * largest
    high = _KNEE_ERROR + (color - knee) / (largest - knee) * (1.0 - _KNEE_ERROR)
    return np.asarray(np.clip(np.where(color < knee, _KNEE_ERROR / knee * color, high), 0.0, 1.0))


def _color_radius(ppd: float) -> int:
    """Radius of the contrast sensitivity filter, pixels."""
    return math.ceil(3.0 * math.sqrt(_WIDEST / (2.0 * math.pi**2)) * ppd)


def _feature_radius(ppd: float) -> int:
    """Radius of the feature filters, pixels."""
    return math.ceil(3.0 * 0.5 * _FEATURE_WIDTH * ppd)


def _filtered(opponent: _Array, ppd: float) -> _Array:
    """Image filtered by the eye's contrast sensitivity (sec. 4.1.1), linear Rec. 709 in 0..1."""
    radius = _color_radius(ppd)
    degrees = np.arange(-radius, radius + 1) / ppd
    channels = []
    for channel, terms in enumerate(_SENSITIVITY):
        total: _Array = np.zeros(opponent.shape[:2])
        weight = 0.0
        # A sum of isotropic Gaussians: each is separable, their weights add.
        for a, b in terms:
            row = np.exp(-(math.pi**2) * degrees**2 / b)
            scale = a * math.sqrt(math.pi / b)
            total += scale * _convolve(_convolve(opponent[..., channel], row, 0), row, 1)
            weight += scale * row.sum() ** 2
        channels.append(total / weight)
    return np.clip(_linear(np.stack(channels, axis=-1)), 0.0, 1.0)


def _features(lightness: _Array, ppd: float) -> tuple[_Array, _Array]:
    """Strengths of edges and of points (sec. 4.2.1)."""
    deviation = 0.5 * _FEATURE_WIDTH * ppd
    radius = _feature_radius(ppd)
    x = np.arange(-radius, radius + 1, dtype=np.float64)
    smooth = np.exp(-(x**2) / (2.0 * deviation**2))
    strengths = []
    for kernel in (-x * smooth, (x**2 / deviation**2 - 1.0) * smooth):
        # Positive weights sum to 1, negative ones to -1.
        balanced = np.where(kernel > 0, kernel / kernel[kernel > 0].sum(), kernel / -kernel[kernel < 0].sum())
        blur = smooth / smooth.sum()
        across = _convolve(_convolve(lightness, balanced, 1), blur, 0)
        along = _convolve(_convolve(lightness, balanced, 0), blur, 1)
        strengths.append(np.hypot(across, along))
    return strengths[0], strengths[1]


def _convolve(image: _Array, kernel: _Array, axis: int) -> _Array:
    """Correlate (H, W) with an odd kernel along one axis; the border is replicated."""
    radius = len(kernel) // 2
    padding = [(0, 0), (0, 0)]
    padding[axis] = (radius, radius)
    wide = np.pad(image, padding, mode="edge")
    result: _Array = np.zeros_like(image)
    for offset, weight in enumerate(kernel):
        part = [slice(None), slice(None)]
        part[axis] = slice(offset, offset + image.shape[axis])
        result += weight * wide[tuple(part)]
    return result
