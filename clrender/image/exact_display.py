"""Display images with the same bits on every machine, for records that other machines prove."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from clrender.exact.angles import power_of_two
from clrender.image.tone_map import srgb_decode

__all__ = ["display_bytes", "srgb_bytes"]

_Floats = npt.NDArray[np.float64]


@lru_cache(maxsize=1)
def _thresholds() -> _Floats:
    """Linear values from which on an encoded value rounds to 1, 2, … 255."""
    return srgb_decode((np.arange(255) + 0.5) / 255.0)


def srgb_bytes(linear: _Floats) -> npt.NDArray[np.uint8]:
    """Linear values as sRGB with 8 bits (IEC 61966-2-1), clipped to 0..1; NaN is 0.

    The encoding is inverted where it rounds, by `srgb_decode`, which has no powers that processors round differently.

    Parameters
    ----------
    linear : (...) float64

    Returns
    -------
    (...) uint8
    """
    values = np.nan_to_num(linear, nan=0.0, posinf=1.0)
    return np.searchsorted(_thresholds(), values, side="right").astype(np.uint8)


def display_bytes(linear: npt.NDArray[np.float32], exposure: float = 0.0) -> npt.NDArray[np.uint8]:
    """Radiance as a display image, as `clrender.image.tone_map.to_display` makes it with the tone map ``srgb``.

    Parameters
    ----------
    linear : (H, W, 3) float32
    exposure : float
        Stops, of magnitude below 128; rounded to 2^-20 of one, since it may come from a logarithm.

    Returns
    -------
    (H, W, 3) uint8
    """
    stops = round(exposure * (1 << 20)) / (1 << 20)
    return srgb_bytes(linear.astype(np.float64) * power_of_two(stops))
