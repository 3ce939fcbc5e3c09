"""Images of light groups that add up to the whole image, to the bit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

__all__ = ["adding_up", "group_channels"]

_Image = npt.NDArray[np.float32]


def group_channels(groups: Mapping[str, _Image]) -> dict[str, npt.NDArray[np.float32]]:
    """Images of light groups as channels of an EXR file: ``light.NAME.R``, …

    Parameters
    ----------
    groups : mapping of str to (H, W, 3) float32

    Returns
    -------
    dict of str to (H, W) float32
    """
    return {
        f"light.{name}.{letter}": np.ascontiguousarray(image[..., channel])
        for name, image in groups.items()
        for channel, letter in enumerate("RGB")
    }


def adding_up(whole: _Image, parts: Mapping[str, _Image]) -> dict[str, _Image]:
    """Parts of an image, rounded so that their sums in single precision, in any order, are the image.

    All parts but the last become multiples of the last place of the image's pixel, and the last one is what is left:
    sums of such numbers that are not larger than the image are exact. So a part changes by half of that place at most,
    and the last by as much for each of the others.

    Parameters
    ----------
    whole : (H, W, 3) float32
    parts : mapping of str to (H, W, 3) float32
        Adding up to `whole` but for rounding. Where some are negative, as a pixel filter may make them, sums are exact
        but for their own roundings.

    Returns
    -------
    dict of str to (H, W, 3) float32
    """
    if not parts:
        return {}
    place = np.spacing(np.abs(whole)).astype(np.float64)
    rest, rounded = whole.astype(np.float64), dict[str, _Image]()
    *first, last = parts
    for name in first:
        part = np.rint(parts[name].astype(np.float64) / place) * place
        rounded[name] = part.astype(np.float32)
        rest = rest - part
    return {**rounded, last: rest.astype(np.float32)}
