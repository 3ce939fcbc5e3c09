"""Grids of colours that stand for how much there is of a medium: here a grid of numbers, times one colour."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["density_and_hue"]

_LEAST: Final = 1e-12
_SLACK: Final = 0.01
"""Relative spread of extinctions over channels, up to which a grid of colours counts as one of numbers."""


def density_and_hue(extinction: NDArray[np.float64]) -> tuple[NDArray[np.float64], list[float], bool]:
    """Split extinctions into their means over the channels, and one hue.

    Parameters
    ----------
    extinction : (nz, ny, nx, 3) float64
        Not below 0.

    Returns
    -------
    density : (nz, ny, nx) float64
    hue : three floats
        Their mean is 1; 0 if there is no extinction anywhere.
    varies : bool
        Whether hues differ from place to place, so that their mean stands for them.
    """
    density = (extinction[..., 0] + extinction[..., 1] + extinction[..., 2]) / 3.0
    some = np.where(density > _LEAST, density, 1.0)[..., None]
    hue = extinction.reshape(-1, 3).cumsum(axis=0)[-1]
    hue = hue * (3.0 / max(float(hue[0] + hue[1] + hue[2]), _LEAST))
    return density, hue.tolist(), bool((np.abs(extinction - density[..., None] * hue) > _SLACK * some).any())
