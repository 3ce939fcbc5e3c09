"""Indices of refraction of glasses and other clear substances by wavelength, at the lines of tables of spectra."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "GLASSES",
    "LINE_C",
    "LINE_D",
    "LINE_F",
    "abbe_indices",
    "cauchy_indices",
    "glass_index",
    "sellmeier_indices",
]

_Floats: TypeAlias = NDArray[np.float64]

LINE_D: Final = 587.5618
LINE_F: Final = 486.1327
LINE_C: Final = 656.2725
"""Fraunhofer's lines by which glasses are described, nanometres: index and Abbe number."""

GLASSES: Final[Mapping[str, tuple[float, ...]]] = {
    "BAF10": (1.5851495, 0.00926681282, 0.143559385, 0.0424489805, 1.08521269, 105.613573),
    "BK7": (1.03961212, 0.00600069867, 0.231792344, 0.0200179144, 1.01046945, 103.560653),
    "F2": (1.34533359, 0.00997743871, 0.209073176, 0.0470450767, 0.937357162, 111.886764),
    "FK51A": (0.971247817, 0.00472301995, 0.216901417, 0.0153575612, 0.904651666, 168.68133),
    "K7": (1.1273555, 0.00720341707, 0.124412303, 0.0269835916, 0.827100531, 100.384588),
    "LASF9": (2.00029547, 0.0121426017, 0.298926886, 0.0538736236, 1.80691843, 156.530829),
    "SF5": (1.52481889, 0.011254756, 0.187085527, 0.0588995392, 1.42729015, 129.141675),
    "SF10": (1.62153902, 0.0122241457, 0.256287842, 0.0595736775, 1.64447552, 147.468793),
    "SF11": (1.73759695, 0.013188707, 0.313747346, 0.0623068142, 1.89878101, 155.23629),
    "diamond": (0.3306, 0.030625, 4.3356, 0.011236),
    "fused silica": (0.6961663, 0.00467914826, 0.4079426, 0.0135120631, 0.8974794, 97.9340025),
    "sapphire": (1.4313493, 0.0052799261, 0.65054713, 0.0142382647, 5.3414021, 325.017834),
    "water": (0.567198, 0.005085551, 0.173689, 0.01814938, 0.020847, 0.02625444, 0.113375, 10.73883),
}
"""Coefficients B1, C1, B2, C2, ... of Sellmeier's equation; the Cs are in square micrometres.

Glasses: data sheets of SCHOTT. Diamond: Peter, Zeitschrift für Physik 15 (1923). Fused silica: Malitson, JOSA 55
(1965). Sapphire, ordinary ray: Malitson and Dodge, JOSA 62 (1972). Water at 20 degrees: Daimon and Masumura, Applied
Optics 46 (2007).
"""


def sellmeier_indices(coefficients: Sequence[float], wavelengths: _Floats) -> _Floats:
    """Indices by Sellmeier's equation, n² = 1 + Σ B λ² / (λ² − C).

    Parameters
    ----------
    coefficients : sequence of float
        B1, C1, B2, C2, ...; the Cs in square micrometres.
    wavelengths : float64
        Nanometres.

    Returns
    -------
    float64
        NaN where the square is not positive.
    """
    square = wavelengths * 1e-3 * (wavelengths * 1e-3)
    total = np.ones_like(square)
    with np.errstate(all="ignore"):
        for b, c in zip(coefficients[::2], coefficients[1::2], strict=True):
            total = total + b * square / (square - c)
        return np.sqrt(total)


def cauchy_indices(coefficients: Sequence[float], wavelengths: _Floats) -> _Floats:
    """Indices by Cauchy's equation, n = A + B / λ² + C / λ⁴ ..., with λ in micrometres."""
    inverse = 1.0 / (wavelengths * 1e-3 * (wavelengths * 1e-3))
    total = np.zeros_like(inverse)
    for coefficient in reversed(coefficients):
        total = total * inverse + coefficient
    return total


def abbe_indices(index: float, abbe: float, wavelengths: _Floats) -> _Floats:
    """Indices by Cauchy's equation of two terms.

    Parameters
    ----------
    index : float
        At the line d.
    abbe : float
        Abbe number, (n(d) − 1) / (n(F) − n(C)).
    wavelengths : float64
        Nanometres.
    """
    inverse_d, inverse_f, inverse_c = (1.0 / (line * 1e-3 * (line * 1e-3)) for line in (LINE_D, LINE_F, LINE_C))
    slope = (index - 1.0) / (abbe * (inverse_f - inverse_c))
    return cauchy_indices((index - slope * inverse_d, slope), wavelengths)


def glass_index(name: str) -> float:
    """Index of one of `GLASSES` at the line d."""
    return float(sellmeier_indices(GLASSES[name], np.array([LINE_D]))[0])
