"""Conversion of linear RGB with other primaries to linear Rec. 709."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from clrender.exact.matrices import determinant, inverse, product, times

__all__ = ["REC_709", "rec_709_matrix"]

REC_709: Final = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
"""CIE xy of red, green, blue and white (D65)."""
_XYZ: Final = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
_SAME: Final = 1e-3
"""Tolerance: files round chromaticities to three or four digits."""

_BRADFORD: Final = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
"""Cone responses of K. M. Lam, "Metamerism and Colour Constancy" (1985), as in ICC.1:2010, annex E."""


def rec_709_matrix(chromaticities: Sequence[float]) -> npt.NDArray[np.float64] | None:
    """Matrix that converts linear RGB with other primaries to linear Rec. 709.

    White stays white: the Bradford transform adapts another white point to D65. But if the primaries are those of CIE
    XYZ itself, the values are tristimulus values, which are not adapted.

    Parameters
    ----------
    chromaticities : eight floats
        CIE xy of red, green, blue and white.

    Returns
    -------
    (3, 3) float64, or None
        To multiply from the left; None if the primaries are Rec. 709's.

    Raises
    ------
    ValueError
        If they do not span a colour space.
    """
    given = np.array(chromaticities, np.float64)
    if given.shape != (8,) or not np.isfinite(given).all():
        raise ValueError("its chromaticities are not eight numbers")
    if np.abs(given - REC_709).max() <= _SAME:
        return None
    if np.abs(given[:6] - _XYZ).max() <= _SAME:
        return inverse(_to_xyz(np.array(REC_709)))
    here, there = _white(given), _white(np.array(REC_709))
    adapted = product(inverse(_BRADFORD), (times(_BRADFORD, there) / times(_BRADFORD, here))[:, None] * _BRADFORD)
    matrix = product(inverse(_to_xyz(np.array(REC_709))), product(adapted, _to_xyz(given)))
    if not np.isfinite(matrix).all() or np.abs(matrix).max() > 1e3:
        raise ValueError("its chromaticities span no colour space")
    return matrix


def _white(chromaticities: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    x, y = chromaticities[6:]
    if y <= 1e-6:
        raise ValueError("its white point is no colour")
    return np.array([x / y, 1.0, (1.0 - x - y) / y])


def _to_xyz(chromaticities: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Columns: XYZ of each primary, such that all three together are white of luminance 1 (SMPTE RP 177-1993)."""
    x, y = chromaticities[0:6:2], chromaticities[1:6:2]
    primaries = np.stack([x, y, 1.0 - x - y])
    if abs(determinant(primaries)) < 1e-6:
        raise ValueError("its chromaticities span no colour space")
    return np.asarray(primaries * times(inverse(primaries), _white(chromaticities)))
