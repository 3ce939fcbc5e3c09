"""Values of an image's texels, as textures read them."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.matrices import inner
from clrender.image.pictures import Picture
from clrender.image.texel_tiles import coded_values
from clrender.image.tone_map import LUMINANCE

__all__ = ["texel_colors", "texel_numbers"]

_CHANNELS: Final = {"r": 0, "g": 1, "b": 2, "a": 3}


def texel_colors(picture: Picture, band: NDArray[Any], srgb: bool) -> NDArray[np.float32]:
    """Linear colours of texels.

    Parameters
    ----------
    picture : Picture
    band : (h, w, 1 or 4) array
        One of its bands.
    srgb : bool
        Whether numbers of 8 or 16 bits are sRGB-encoded.

    Returns
    -------
    (h, w, 1 or 3) float32
    """
    colors = band[..., :3]
    return np.asarray(colors if picture.coding == "float" else coded_values(picture.coding, srgb)[colors], np.float32)


def texel_numbers(picture: Picture, band: NDArray[Any], srgb: bool, channel: str) -> NDArray[np.float32]:
    """One channel of texels, ``r g b a``, or their ``luminance``, (h, w, 1); for the rest see `texel_colors`."""
    if picture.channels == 1:
        return texel_colors(picture, band, srgb)
    if channel == "a":
        return texel_colors(picture, band[..., 3:], False)
    colors = texel_colors(picture, band, srgb)
    if channel == "luminance":
        return np.asarray(inner(colors.astype(np.float64), LUMINANCE)[..., None], np.float32)
    at = _CHANNELS[channel]
    return colors[..., at : at + 1]
