"""Tone mapping: linear radiance (Rec. 709) to display values, in NumPy only.

Every operator maps linear values, scaled by 2^exposure and clamped below at 0, to display values in 0..1:

=========  ============================================================================================
linear     x
sqrt       x^(1/2)
srgb       the sRGB transfer function, IEC 61966-2-1
reinhard   x / (1 + Y), Y the luminance of x: Reinhard et al. 2002, "Photographic Tone Reproduction for
           Digital Images", eq. 3; then the sRGB function
aces       S. Hill's fit of the ACES RRT and sRGB ODT, published in M. Pettineo's "Baking Lab" (2016);
           then the sRGB function
agx        T. Sobotka's AgX base look (2022) in B. Wrensch's polynomial fit ("Minimal AgX
           Implementation", 2023): log2 encoding of 16.5 stops, a sigmoid, display-encoded as it comes
=========  ============================================================================================
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Final, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from clrender.errors import UsageError
from clrender.exact.elementary import power_two_fifths
from clrender.exact.matrices import inner, times
from clrender.wording import shown

__all__ = [
    "LUMINANCE",
    "TONE_MAPS",
    "DisplayMap",
    "check_display",
    "display_values",
    "record_of",
    "srgb_decode",
    "srgb_encode",
    "to_display",
]

LUMINANCE: Final = (0.2126, 0.7152, 0.0722)
"""Weights of linear Rec. 709 R, G, B in luminance."""

EXPOSURE_LIMIT: Final = 128.0

_Array = npt.NDArray[np.float64]
_CHUNK: Final = 1 << 16  # pixels at a time: temporaries of a large image stay small
_LARGEST: Final = 1e30  # replaces infinity, so that no operator overflows

_ACES_IN: Final = np.array([[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]])
_ACES_OUT: Final = np.array(
    [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]]
)
_AGX_IN: Final = np.array(
    [
        [0.842479062253094, 0.0784335999999992, 0.0792237451477643],
        [0.0423282422610123, 0.878468636469772, 0.0791661274605434],
        [0.0423756549057051, 0.0784336, 0.879142973793104],
    ]
)
_AGX_OUT: Final = np.array(
    [
        [1.19687900512017, -0.0980208811401368, -0.0990297440797205],
        [-0.0528968517574562, 1.15190312990417, -0.0989611768448433],
        [-0.0529716355144438, -0.0980434501171241, 1.15107367264116],
    ]
)
_AGX_STOPS: Final = (-12.47393, 4.026069)
_AGX_SIGMOID: Final = (15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.00232)


@runtime_checkable
class DisplayMap(Protocol):
    """A tone map that is not one of the operators: linear Rec. 709 to display values."""

    @property
    def record(self) -> dict[str, Any]:
        """What a file says of it; its key ``tone_map`` has the name of its kind."""

    def shown(self, linear: _Array) -> _Array:
        """Display values, which are cut off at 0 and 1 afterwards.

        Parameters
        ----------
        linear : (..., 3) float64
            Finite, at least 0.
        """


def record_of(tone_map: str | DisplayMap, exposure: float) -> dict[str, Any]:
    """What a display image says of how its pixels were stored.

    Raises
    ------
    UsageError
        It is no tone map.
    """
    _check_kind(tone_map)
    return {**({"tone_map": tone_map} if isinstance(tone_map, str) else tone_map.record), "exposure": exposure}


def srgb_encode(linear: npt.ArrayLike) -> _Array:
    """Encode linear values 0..1 as sRGB display values 0..1, any shape (IEC 61966-2-1)."""
    x = np.asarray(linear, np.float64)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.power(np.maximum(x, 0.0031308), 1 / 2.4) - 0.055)


def srgb_decode(display: npt.ArrayLike) -> _Array:
    """Decode sRGB display values 0..1 to linear values 0..1, any shape (IEC 61966-2-1)."""
    x = np.asarray(display, np.float64)
    base = (np.maximum(x, 0.04045) + 0.055) / 1.055
    return np.where(x <= 0.04045, x / 12.92, base * base * power_two_fifths(base))


def _reinhard(x: _Array) -> _Array:
    luminance = inner(x, LUMINANCE)
    return srgb_encode(np.clip(x / (1.0 + luminance)[..., None], 0.0, 1.0))


def _aces(x: _Array) -> _Array:
    v = times(_ACES_IN, x)
    v = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081)
    return srgb_encode(np.clip(times(_ACES_OUT, v), 0.0, 1.0))


def _agx(x: _Array) -> _Array:
    low, high = _AGX_STOPS
    stops = np.log2(np.maximum(times(_AGX_IN, x), 2.0**low))
    return times(_AGX_OUT, np.polyval(np.array(_AGX_SIGMOID), (np.clip(stops, low, high) - low) / (high - low)))


_OPERATORS: Final[Mapping[str, Callable[[_Array], _Array]]] = {
    "linear": lambda x: x,
    "sqrt": np.sqrt,
    "srgb": lambda x: srgb_encode(np.minimum(x, 1.0)),
    "reinhard": _reinhard,
    "aces": _aces,
    "agx": _agx,
}

TONE_MAPS: Final = tuple(_OPERATORS)
"""Names of the operators."""


def _check_kind(tone_map: object) -> None:
    if not isinstance(tone_map, str | DisplayMap):
        text = f"choose one of {', '.join(TONE_MAPS)}, or what clrender.display_view gives."
        raise UsageError(f"tone_map is {shown(tone_map)}, but must be the name of a tone map; {text}")


def check_display(tone_map: str | DisplayMap, exposure: float) -> None:
    """Check how an image is to be shown; see `display_values`.

    Raises
    ------
    UsageError
        Unknown operator, or an exposure that is not a number between -128 and 128.
    """
    _check_kind(tone_map)
    if isinstance(tone_map, str) and tone_map not in _OPERATORS:
        raise UsageError(f"tone map {tone_map!r} is unknown; choose one of {', '.join(TONE_MAPS)}.")
    if not abs(exposure) <= EXPOSURE_LIMIT:
        raise UsageError(f"exposure {exposure} is not a number between {-EXPOSURE_LIMIT:g} and {EXPOSURE_LIMIT:g}.")


def display_values(linear: npt.ArrayLike, tone_map: str | DisplayMap = "srgb", exposure: float = 0.0) -> _Array:
    """Display values of linear radiance.

    Parameters
    ----------
    linear : (..., 3) floats
        Radiance, linear Rec. 709. NaN and negative values count as 0.
    tone_map : str or DisplayMap
        One of `TONE_MAPS`, or another map, such as `clrender.image.ocio.display_view` makes.
    exposure : float
        Stops: the radiance is multiplied by 2^exposure first.

    Returns
    -------
    (..., 3) float64
        Between 0 and 1.

    Raises
    ------
    UsageError
        Unknown operator, or an exposure that is not a number between -128 and 128.
    """
    check_display(tone_map, exposure)
    values = np.asarray(linear, np.float64) * math.ldexp(2.0 ** (exposure % 1.0), math.floor(exposure))
    values = np.clip(np.nan_to_num(values, nan=0.0, posinf=_LARGEST), 0.0, _LARGEST)
    return np.clip(_OPERATORS[tone_map](values) if isinstance(tone_map, str) else tone_map.shown(values), 0.0, 1.0)


def to_display(
    linear: npt.ArrayLike, tone_map: str | DisplayMap = "srgb", exposure: float = 0.0
) -> npt.NDArray[np.uint8]:
    """Eight-bit display image: 255 times `display_values`, rounded half to even.

    Parameters
    ----------
    linear : (H, W, 3) floats
    tone_map, exposure
        See `display_values`, also for the errors raised.

    Returns
    -------
    (H, W, 3) uint8
    """
    image = np.asarray(linear)
    pixels = image.reshape(-1, 3)
    result = np.empty(pixels.shape, np.uint8)
    for first in range(0, len(pixels), _CHUNK):
        part = np.s_[first : first + _CHUNK]
        result[part] = np.rint(display_values(pixels[part], tone_map, exposure) * 255.0)
    return result.reshape(image.shape)
