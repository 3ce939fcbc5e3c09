"""Albedo inversion: from the reflectance of skin, wax and marble to their single-scattering albedo."""

from __future__ import annotations

import math
from typing import Final

from clrender.scene.materials import MOST_G

__all__ = ["SERIES", "single_scattering"]

SERIES: Final = (
    (-1.000532, 0.450457, 0.001506, -0.025923, 0.008798, -0.001716, 0.000594,
     -0.000210, 0.000057, -0.000019),
    (-0.132778, 0.174992, -0.040069, -0.005864, 0.006828, -0.004129, 0.001372,
     -0.000506, 0.000171, -0.000024),
    (0.030287, -0.024185, -0.015130, 0.008940, 0.000533, -0.001266, 0.001237,
     -0.000548, 0.000201, -0.000080),
    (-0.007049, 0.002029, 0.005412, 0.002504, -0.002968, -0.000045, 0.000364,
     -0.000441, 0.000253, -0.000081),
    (0.003522, -0.001093, -0.002249, -0.000843, -0.000236, 0.000921, 0.000077,
     -0.000183, 0.000165, -0.000099),
    (-0.001107, -0.000408, 0.000936, 0.001121, -0.000182, -0.000135, -0.000239,
     -0.000052, 0.000095, -0.000049),
    (0.000745, 0.000024, -0.000370, -0.000465, -0.000313, 0.000254, 0.000101,
     0.000036, 0.000022, -0.000034),
    (-0.000302, -0.000216, 0.000225, 0.000342, 0.000094, 0.000020, -0.000138,
     -0.000042, 0.000009, -0.000003),
    (0.000220, 0.000064, -0.000085, -0.000173, -0.000144, 0.000036, 0.000034,
     0.000053, 0.000010, -0.000008),
    (-0.000098, -0.000094, 0.000060, 0.000116, 0.000063, 0.000029, -0.000046,
     -0.000023, -0.000014, 0.000000),
    (0.000073, 0.000035, -0.000019, -0.000064, -0.000060, -0.000002, 0.000007,
     0.000027, 0.000008, 0.000003),
    (-0.000034, -0.000038, 0.000016, 0.000039, 0.000029, 0.000017, -0.000014,
     -0.000009, -0.000011, -0.000002),
    (0.000023, 0.000014, -0.000004, -0.000021, -0.000022, -0.000004, 0.000000,
     0.000010, 0.000004, 0.000003),
    (-0.000008, -0.000010, 0.000003, 0.000010, 0.000008, 0.000005, -0.000003,
     -0.000002, -0.000004, -0.000001),
)  # fmt: skip
"""Chebyshev coefficients in g / `MOST_G` and 2 √A - 1, made by ``scripts/subsurface_fit.py``."""


def _polynomials(x: float, count: int) -> list[float]:
    """Chebyshev polynomials of the first kind, by their recurrence, which has the same bits on all machines."""
    values = [1.0, x]
    while len(values) < count:
        values.append(2.0 * x * values[-1] - values[-2])
    return values


def single_scattering(albedo: float, g: float) -> float:
    """Single-scattering albedo for which a half-space of the medium has a given reflectance.

    Parameters
    ----------
    albedo : float
        From 0 to 1: fraction of cosine-distributed incident light that a thick slab returns, whose boundary reflects
        nothing on either side.
    g : float
        Mean cosine of the Henyey-Greenstein phase function, at most `MOST_G` in magnitude.

    Returns
    -------
    float
        The resulting reflectance is within 0.02 % of the given one. The usual formula, van de Hulst's (Multiple Light
        Scattering, 1980), has errors up to 4 % for g ≥ 0 and 17 % for g < 0.
    """
    root = _polynomials(2.0 * math.sqrt(albedo) - 1.0, len(SERIES[0]))
    q = 0.0
    for row, of_g in zip(SERIES, _polynomials(g / MOST_G, len(SERIES)), strict=True):
        for coefficient, of_root in zip(row, root, strict=True):
            q += coefficient * of_g * of_root
    s = (1.0 - albedo) * (1.0 + albedo * q)
    return (1.0 - s * s) / (1.0 - g * s * s)
