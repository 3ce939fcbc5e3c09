"""Pictures of projectors as the kernels read them: intensities by place on a screen, and where photons go."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.angles import tan_degrees
from clrender.flatten.lamp_tables import LampTable, light_shares, packed_words

__all__ = ["projector_table"]

_Floats = NDArray[np.float64]
_LUMINANCE: Final = (0.2126, 0.7152, 0.0722)


def projector_table(pixels: NDArray[np.float32], vertical_fov: float, even: bool) -> LampTable:
    """Table of the picture of a projector.

    Parameters
    ----------
    pixels : (H, W, 3) float32
        Not below 0, first row on top.
    vertical_fov : float
        Angle between its upper and its lower edge, degrees.
    even : bool
        Whether it lights a screen as it says; otherwise it is the radiant intensity of its directions.

    Returns
    -------
    LampTable
        Lines are heights, from below, and columns places to the right, both over the distance of the screen. `flux` is
        that of the luminance, and `mean` in the frame right, up, ahead.
    """
    height, width, _ = pixels.shape
    top = tan_degrees(vertical_fov / 2.0)
    lines, columns = _places(height, top), _places(width, top * (width / height))
    peak = float(pixels.max())
    whole = np.pad(pixels[::-1], ((1, 1), (1, 1), (0, 0)), mode="edge")  # as far as the edges
    shares = np.divide(whole, np.float32(peak if peak > 0.0 else 1.0))

    # Light of each cell between two lines and two columns
    red, green, blue = (shares[..., channel].astype(np.float64) * each for channel, each in enumerate(_LUMINANCE))
    light = red + green + blue
    light = (light[:-1, :-1] + light[:-1, 1:] + light[1:, :-1] + light[1:, 1:]) * 0.25
    down, right = lines.astype(np.float64), columns.astype(np.float64)
    y, x = ((places[:-1] + places[1:]) * 0.5 for places in (down, right))
    cosine = 1.0 / np.sqrt(1.0 + (y * y)[:, None] + (x * x)[None, :])
    mass = light * np.diff(down)[:, None] * np.diff(right)[None, :]
    if not even:
        mass = mass * (cosine * cosine * cosine)
    bands, cells, flux = light_shares(mass)
    aimed = mass * cosine
    parts = (aimed * x[None, :], aimed * y[:, None], aimed)
    mean = np.array([float(np.cumsum(part)[-1]) for part in parts]) / (flux if flux > 0.0 else 1.0)
    words = packed_words(
        {
            "LINE": lines,
            "COLUMN": columns,
            "VALUE": np.moveaxis(shares, 2, 0),
            "BAND": bands,
            "CELL": cells,
        },
        (len(lines), len(columns)),
        even=even,
    )
    corner = 1.0 / np.sqrt(1.0 + down[-1] * down[-1] + right[-1] * right[-1])
    return LampTable(words, peak, flux, mean, 1.0, float(corner))


def _places(count: int, edge: float) -> NDArray[np.float32]:
    """The lower edge, the middles of so many pixels, and the upper edge, from ``-edge`` to `edge`."""
    middles = (np.arange(count) + 0.5) * (2.0 / count) - 1.0
    return (np.concatenate([[-1.0], middles, [1.0]]) * edge).astype(np.float32)
