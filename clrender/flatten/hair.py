"""What the kernels need to know of hair (Chiang, Bitterli, Tappan and Burley 2016; PBR 4ed, 9.9)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from clrender.exact.angles import exponential_of, logarithm_of, sin_cos_degrees
from clrender.scene.materials import Hair
from clrender.scene.values import Vector

__all__ = ["HairNumbers", "hair_absorption", "hair_color", "hair_numbers"]

_UNKNOWN: Final = (0.5, 0.5, 0.5)
"""Placeholder for a colour that a texture gives."""
_LEAST_VARIANCE: Final = 1e-6
_LEAST_SPREAD: Final = 1e-3
_LOG_2: Final = 0.6931471805599453
_DARKEST: Final = 1e-30


@dataclass(frozen=True)
class HairNumbers:
    """Numbers of a material's rows.

    Attributes
    ----------
    variance : float
        Of the first lobe along the fibre; the second has a quarter of it, the others four times as much.
    spread : float
        Scale of the logistic distributions around the fibre, radians.
    per_logarithm : float
        Root of the absorption along a radius, per doubling of the reflectance.
    tilt : (2,) float
        Sine and cosine of the tilt of the scales.
    """

    variance: float
    spread: float
    per_logarithm: float
    tilt: tuple[float, float]


def hair_numbers(material: Hair) -> HairNumbers:
    """The numbers of a material."""
    m, n = material.roughness, material.azimuthal_roughness
    root = 0.726 * m + 0.812 * m * m + 3.7 * _raised(m, 20)
    spread = math.sqrt(math.pi / 8.0) * (0.265 * n + 1.194 * n * n + 5.372 * _raised(n, 22))
    tilt = sin_cos_degrees(material.tilt_degrees)
    return HairNumbers(
        max(root * root, _LEAST_VARIANCE), max(spread, _LEAST_SPREAD), _LOG_2 / _per_root(material), tilt
    )


def hair_color(material: Hair) -> Vector:
    """Reflectance of many strands of constant colour; grey where a texture says it."""
    absorption = material.absorption_of
    if absorption is None:
        color = material.reflectance
        return color if isinstance(color, tuple) else _UNKNOWN
    red, green, blue = (exponential_of(-math.sqrt(each) * _per_root(material)) for each in absorption)
    return (red, green, blue)


def hair_absorption(material: Hair) -> Vector:
    """Absorption along a radius; where a texture says the reflectance, that of grey."""
    if material.absorption_of is not None:
        return material.absorption_of
    roots = (logarithm_of(max(each, _DARKEST)) / _per_root(material) for each in hair_color(material))
    red, green, blue = (each * each for each in roots)
    return (red, green, blue)


def _per_root(material: Hair) -> float:
    """What of the root of an absorption makes minus the natural logarithm of the reflectance."""
    n = material.azimuthal_roughness
    return 5.969 - 0.215 * n + 2.532 * n * n - 10.73 * _raised(n, 3) + 5.574 * _raised(n, 4) + 0.245 * _raised(n, 5)


def _raised(x: float, power: int) -> float:
    """The power in an order of products that is the same everywhere."""
    product = 1.0
    for _ in range(power):
        product *= x
    return product
