"""What measured reflectance consists of, checked: tables of the RGL database, and of the MERL database."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.spectra.colors import reflectance_weights
from clrender.wording import counted, grouped

__all__ = ["MERL_SHAPE", "MerlTable", "RglTables", "merl_table", "rgl_tables"]

_Floats: TypeAlias = NDArray[np.float32]
MERL_SHAPE: Final = (90, 90, 180)
"""Steps of the angle between half vector and normal, of that between it and a direction, and of the turn around it."""
_MERL_SCALES: Final = (1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0)
"""Of the numbers of red, green and blue in a file."""
_HALF_PI: Final = 1.5707963267948966
_TWO_PI: Final = 6.283185307179586
_SLACK: Final = 1e-3
_LARGEST: Final = 1e9
_BRIGHTEST: Final = 1e4
_NARROWEST: Final = 1e-4
_MOST_ANGLES: Final = 1024
_MOST_SIDE: Final = 4096
_MOST_NUMBERS: Final = 2**28


@dataclass(frozen=True)
class RglTables:
    """Reflectance over a warped square of half vectors, for some directions towards the viewer (Dupuy and Jakob 2018).

    A half vector at the polar angle θ and the azimuth φ has the coordinates √(2θ/π) and (φ + π) / 2π. The densities
    `normals` and `luminance` are bilinear functions of two such coordinates in the unit square, whose last index is
    along the first coordinate. With M the map of the square that has `normals` as its density, the reflectance times
    the cosine is, at the half vector M(s), D(M(s)) / (4 σ) times `values` at s.

    Attributes
    ----------
    theta : (T,) float32
        Polar angles towards the viewer, radians, ascending.
    phi : (P,) float32
        Azimuths towards the viewer, radians, ascending; up to two of an isotropic surface.
    normals : (P, T, H, W) float32
        Density of the visible normals; no slice is 0 everywhere.
    luminance : (P, T, N, N) float32
        Density for sampling.
    values : (P, T, N, N, 3) float32
        Linear Rec. 709, not below 0.
    facets, projected : (h, w) float32
        D and σ.
    has_jacobian : bool
        False: `values` are the reflectance times the cosine themselves.
    """

    theta: _Floats
    phi: _Floats
    normals: _Floats
    luminance: _Floats
    values: _Floats
    facets: _Floats
    projected: _Floats
    has_jacobian: bool

    @property
    def isotropic(self) -> bool:
        """Whether it is the same from all azimuths."""
        return len(self.phi) <= 2

    @property
    def symmetry(self) -> int:
        """Parts of a turn of the viewer that look alike: 1, 2 or 4."""
        if self.isotropic:
            return 1
        turn = round(_TWO_PI / float(self.phi[-1] - self.phi[0]))
        return turn if turn in (2, 4) else 1


@dataclass(frozen=True)
class MerlTable:
    """Reflectance by half vector and difference (Rusinkiewicz 1998), isotropic (Matusik et al. 2003).

    Attributes
    ----------
    values : (90, 90, 180, 3) float32
        1/sr, linear RGB, not below 0: by the root of the polar angle of the half vector, the angle between it and a
        direction, and the turn of the direction around it. Each is the middle of a step.
    """

    values: _Floats


def rgl_tables(fields: Mapping[str, NDArray[Any]]) -> RglTables:
    """The tables of an RGL file.

    Parameters
    ----------
    fields : mapping of str to ndarray

    Raises
    ------
    ValueError
        One is missing, or has another shape or numbers that are not allowed.
    """
    theta, phi = _angles(fields, "theta_i", 0.0, _HALF_PI), _angles(fields, "phi_i", -_TWO_PI, _TWO_PI)
    seen = (len(phi), len(theta))
    normals, luminance = (_densities(fields, name, seen) for name in ("vndf", "luminance"))
    facets, projected = (_floats(fields, name, 2) for name in ("ndf", "sigma"))
    for name, array in (("ndf", facets), ("sigma", projected)):
        _check_numbers(name, array)
        if min(array.shape) < 2 or max(array.shape) > _MOST_SIDE:
            raise ValueError(f"{name} has {array.shape} numbers, but 2 to {_MOST_SIDE} along each side are known")
    if not facets.any() or not float(projected.min()) > _NARROWEST:
        raise ValueError(f"ndf is 0 everywhere, or sigma is below {_NARROWEST:g} somewhere")
    jacobian = fields.get("jacobian")
    if jacobian is None or jacobian.size != 1:
        raise ValueError("it has no field jacobian of one number")
    values = _values(fields, (*seen, *luminance.shape[2:]))
    return RglTables(theta, phi, normals, luminance, values, facets, projected, bool(jacobian.item()))


def merl_table(content: NDArray[np.uint8]) -> MerlTable:
    """The table of a MERL file: three numbers of steps, and all numbers of red, of green and of blue.

    Parameters
    ----------
    content : (N,) uint8

    Raises
    ------
    ValueError
        It is no such file, or a damaged one.
    """
    steps = tuple(content[:12].view("<i4").tolist()) if len(content) >= 12 else ()
    if steps != MERL_SHAPE:
        said = " x ".join(str(each) for each in steps) or "none"
        raise ValueError(f"its numbers of steps are {said}, but 90 x 90 x 180 are known")
    size = 12 + 3 * 8 * MERL_SHAPE[0] * MERL_SHAPE[1] * MERL_SHAPE[2]
    if len(content) != size:
        raise ValueError(f"it has {counted(len(content), 'byte')}, but its head promises {size}")
    numbers = content[12:].view("<f8").reshape(3, *MERL_SHAPE)
    values = np.empty((*MERL_SHAPE, 3), np.float32)
    for channel, scale in enumerate(_MERL_SCALES):
        plane = numbers[channel] * scale
        if not (np.isfinite(plane).all() and float(plane.max()) <= _LARGEST):
            raise ValueError("it has numbers that are not finite, or too large")
        values[..., channel] = np.maximum(plane, 0.0)  # a number below 0 says that nothing was measured
    if not values.any():
        raise ValueError("it reflects nothing at all")
    return MerlTable(values)


def _floats(fields: Mapping[str, NDArray[Any]], name: str, axes: int) -> _Floats:
    array = fields.get(name)
    if array is None:
        raise ValueError(f"it has no field {name}")
    if array.dtype != np.dtype("<f4") or array.ndim != axes:
        raise ValueError(f"{name} holds {array.dtype} {array.shape}, but must hold float32 with {axes} axes")
    if array.size > _MOST_NUMBERS:
        raise ValueError(f"{name} has {counted(array.size, 'number')}; at most {grouped(_MOST_NUMBERS)} are possible")
    return np.ascontiguousarray(array, np.float32)


def _check_numbers(name: str, array: _Floats) -> None:
    if array.size == 0 or not (float(array.min()) >= 0.0 and float(array.max()) <= _LARGEST):
        raise ValueError(f"{name} has no numbers, or such as are not from 0 to {_LARGEST:g}")


def _angles(fields: Mapping[str, NDArray[Any]], name: str, low: float, high: float) -> _Floats:
    angles = _floats(fields, name, 1)
    if not 1 <= len(angles) <= _MOST_ANGLES or not np.isfinite(angles).all():
        raise ValueError(f"{name} must be 1 to {_MOST_ANGLES} angles")
    if not (np.diff(angles) > 0.0).all() or angles[0] < low - _SLACK or angles[-1] > high + _SLACK:
        raise ValueError(f"{name} must ascend between {low:g} and {high:g}")
    return angles


def _densities(fields: Mapping[str, NDArray[Any]], name: str, seen: tuple[int, int]) -> _Floats:
    array = _floats(fields, name, 4)
    _check_numbers(name, array)
    if array.shape[:2] != seen or min(array.shape) < 1 or min(array.shape[2:]) < 2:
        raise ValueError(f"{name} has the shape {array.shape}, which does not fit its angles")
    if max(array.shape[2:]) > _MOST_SIDE:
        raise ValueError(f"{name} has {array.shape} numbers; at most {grouped(_MOST_SIDE)} along a side are known")
    if not array.any(axis=(2, 3)).all():
        raise ValueError(f"{name} is 0 for all half vectors of a direction")
    return array


def _values(fields: Mapping[str, NDArray[Any]], shape: tuple[int, ...]) -> _Floats:
    """Colours, of ``rgb`` or ``spectra``."""
    seen, square = shape[:2], shape[2:]
    if "rgb" in fields:
        planes = _floats(fields, "rgb", 5)
        if planes.shape != (*seen, 3, *square):
            raise ValueError(f"rgb has the shape {planes.shape}, but must have {(*seen, 3, *square)}")
        values: NDArray[Any] = np.moveaxis(planes, 2, -1)
    else:
        planes, wavelengths = _floats(fields, "spectra", 5), _floats(fields, "wavelengths", 1)
        if planes.shape != (*seen, len(wavelengths), *square) or not len(wavelengths):
            raise ValueError(f"spectra has the shape {planes.shape}, which does not fit luminance and wavelengths")
        if not (np.isfinite(wavelengths).all() and (np.diff(wavelengths) > 0.0).all()):
            raise ValueError("wavelengths must ascend")
        sums = np.zeros((*seen, *square, 3))
        for number, weights in enumerate(reflectance_weights(wavelengths.tolist())):
            if weights.any():
                with np.errstate(over="ignore", invalid="ignore"):  # sums that are not finite are refused below
                    sums += planes[:, :, number, :, :, None] * weights
        values = sums
    if not (np.isfinite(values).all() and float(np.abs(values).max()) <= _BRIGHTEST):
        raise ValueError("its colours are not finite, or too large")
    return np.ascontiguousarray(np.maximum(values, 0.0), np.float32)
