"""Measured metals: their indices of refraction, by chemical symbol."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.exact.matrices import interpolated
from clrender.spectra.colors import table_wavelengths

__all__ = ["METALS", "metal_spectra"]

_Triple: TypeAlias = tuple[float, float, float]

METALS: Final[Mapping[str, tuple[_Triple, _Triple]]] = {
    "Ag": ((0.06, 0.06, 0.04), (4.152, 3.586, 2.657)),
    "Al": ((1.35, 1.01, 0.64), (7.37, 6.61, 5.47)),
    "Au": ((0.21, 0.43, 1.38), (3.272, 2.455, 1.914)),
    "Co": ((2.19, 2.05, 1.74), (4.11, 3.82, 3.28)),
    "Cr": ((3.17, 3.18, 2.33), (3.30, 3.33, 3.14)),
    "Cu": ((0.30, 1.02, 1.24), (3.205, 2.577, 2.397)),
    "Fe": ((2.88, 2.95, 2.59), (3.05, 2.93, 2.77)),
    "Hg": ((1.89, 1.55, 1.06), (5.13, 4.64, 3.87)),
    "Mn": ((2.51, 2.39, 2.11), (3.54, 3.33, 2.98)),
    "Ni": ((1.99, 1.92, 1.73), (4.02, 3.61, 2.95)),
    "Pd": ((1.75, 1.64, 1.41), (4.21, 3.84, 3.26)),
    "Pt": ((2.27, 2.08, 1.85), (4.09, 3.71, 3.14)),
    "Ti": ((2.67, 2.54, 2.27), (3.72, 3.43, 3.04)),
    "V": ((3.54, 4.00, 3.59), (3.02, 3.04, 3.46)),
    "W": ((3.62, 3.50, 3.31), (2.79, 2.76, 2.61)),
}
"""Symbol -> real and imaginary part of the index of refraction at 617, 549 and 451 nm.

Ag, Au, Cu: Johnson and Christy, Phys. Rev. B 6 (1972). Co, Cr, Fe, Mn, Ni, Pd, Ti, V: the same, Phys. Rev. B 9 (1974).
Al: Rakić, Applied Optics 34 (1995). Hg, liquid: Inagaki, Arakawa and Williams, Phys. Rev. B 23 (1981). Pt, W: Rakić et
al., Applied Optics 37 (1998).
"""

_WAVELENGTHS: Final = (451.0, 549.0, 617.0)


def metal_spectra(name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Real and imaginary part of a metal's index at the lines of tables of spectra, (95,) float64 each.

    Linear between the wavelengths of `METALS`, and constant beyond.
    """
    at = table_wavelengths()
    n, k = (interpolated(at, _WAVELENGTHS, part[::-1]) for part in METALS[name])
    return n, k
