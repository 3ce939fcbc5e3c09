"""Measured reflectance as the kernels read it: heads, and tables of densities, their integrals, and values."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.errors import SceneError
from clrender.exact.angles import sin_cos
from clrender.measured import MeasuredFile, MerlTable, RglTables
from clrender.measured.tables import MERL_SHAPE
from clrender.wording import counted, place

if TYPE_CHECKING:
    from clrender.scene.description import Scene
    from clrender.scene.materials import Measured
    from clrender.scene.values import Vector

__all__ = ["MeasuredArrays", "flat_measured", "is_anisotropic", "measured_color"]

_Doubles: TypeAlias = NDArray[np.float64]
_Floats: TypeAlias = NDArray[np.float32]
_ROW: Final = 16
_COLUMNS: Final = layout.columns("MEASURED")
_WORD_LIMIT: Final = 2**31
_HALF_PI: Final = 1.5707963267948966
_PI: Final = 3.141592653589793
_VIEWS: Final = 20
"""Polar angles towards the viewer for which half vectors of a MERL table are sampled."""
_SIDE: Final = 64
"""Steps of either coordinate of those half vectors."""
_LEAST: Final = 0.05
"""Share of what is added to their densities, even over directions: between the steps there may be light."""


@dataclass(frozen=True)
class MeasuredArrays:
    """The measured reflectance of a scene.

    Attributes
    ----------
    rows : (2 n, 16) float32
        Head of each file: ``MEASURED_ROW_*`` of ``kernels/types.h``. One row of zeros if there are none.
    words : (N,) float32
        Their tables. One zero if there are none.
    head_of : dict of str to int
        By file name, the first of its rows.
    """

    rows: _Floats
    words: _Floats
    head_of: dict[str, int]


@dataclass(frozen=True)
class _Tables:
    """Tables of one file, whatever database it is of; see `clrender.measured.RglTables`."""

    flags: int
    theta: _Doubles
    phi: _Doubles
    normals: _Doubles
    luminance: _Doubles
    values: _Floats
    facets: _Floats
    projected: _Floats
    albedo: _Doubles


def flat_measured(scene: Scene) -> MeasuredArrays:
    """Heads and tables of all measured materials.

    Parameters
    ----------
    scene : Scene

    Raises
    ------
    SceneError
        A file cannot be read, or the tables are too large together.
    """
    return scene.of_contents("measured", lambda: _flat(scene))


def _flat(scene: Scene) -> MeasuredArrays:
    rows: list[_Floats] = []
    parts: list[_Floats] = []
    head_of: dict[str, int] = {}
    total = 0
    for name, material in scene.measured_materials():
        if material.file in head_of:
            continue
        head, words = _file_words(scene.measured(name, material), total)
        total += len(words)
        if total > _WORD_LIMIT:
            text = f"measured materials take more than {counted(_WORD_LIMIT, 'number')}; use fewer"
            raise SceneError(f"{scene.source}: {place(('materials', name, 'file'))}: {text}")
        head_of[material.file] = 2 * len(rows)
        rows.append(head)
        parts.append(words)
    if not rows:
        return MeasuredArrays(np.zeros((1, _ROW), np.float32), np.zeros(1, np.float32), head_of)
    return MeasuredArrays(np.concatenate(rows).reshape(-1, _ROW), np.concatenate(parts), head_of)


def is_anisotropic(scene: Scene, material: Measured) -> bool:
    """Whether a measured material is not the same in all directions around the normal."""
    name = next(name for name, each in scene.measured_materials() if each is material)
    tables = scene.measured(name, material).tables
    return isinstance(tables, RglTables) and not tables.isotropic


def measured_color(scene: Scene, name: str, material: Measured) -> Vector:
    """The colour of the light that is reflected towards viewers at about 45 degrees.

    Parameters
    ----------
    scene : Scene
    name : str
        Of the material, for error messages.
    material : Measured

    Raises
    ------
    SceneError
        Its file cannot be read.
    """

    def computed() -> Vector:
        tables = _tables(scene.measured(name, material))
        middle = int(np.argmin(np.abs(tables.theta - _HALF_PI / 2.0)))
        red, green, blue = tables.albedo[0, middle].tolist()
        return (red, green, blue)

    return scene.of_contents(f"color of {material.file}", computed)


def _file_words(file: MeasuredFile, begin: int) -> tuple[_Floats, _Floats]:
    """Head of a file whose words begin there, (32,), and the words."""
    tables = _tables(file)
    height, width = tables.normals.shape[2:]
    numbers = {
        "FLAGS": tables.flags,
        "THETAS": len(tables.theta),
        "PHIS": len(tables.phi),
        "NORMALS_WIDTH": width,
        "NORMALS_HEIGHT": height,
        "SIDE": tables.luminance.shape[2],
        "FACETS_WIDTH": tables.facets.shape[1],
        "FACETS_HEIGHT": tables.facets.shape[0],
        "PROJECTED_WIDTH": tables.projected.shape[1],
        "PROJECTED_HEIGHT": tables.projected.shape[0],
    }
    arrays: dict[str, NDArray[np.floating]] = {"ANGLES": np.concatenate([tables.theta, tables.phi])}
    for name, density in (("NORMALS", tables.normals), ("LUMINANCE", tables.luminance)):
        arrays |= dict(zip((name, f"{name}_ROWS", f"{name}_COLUMN"), _integrated(density), strict=True))
    arrays |= {"VALUES": tables.values, "FACETS": tables.facets, "PROJECTED": tables.projected, "ALBEDO": tables.albedo}
    head = np.zeros(2 * _ROW, np.uint32)
    parts = []
    for name, array in arrays.items():
        numbers[name] = begin
        words = np.asarray(array, np.float32).reshape(-1)
        parts.append(words)
        begin += len(words)
    for name, number in numbers.items():
        head[_COLUMNS[name]] = number
    return head.view(np.float32), np.concatenate(parts)


def _integrated(density: _Doubles) -> tuple[_Doubles, _Doubles, _Doubles]:
    """A density of integral 1 over the unit square, its integrals along each row up to each number, and over rows.

    Parameters
    ----------
    density : (P, T, H, W) float64
        Values of a bilinear function.
    """
    zeros = np.zeros((*density.shape[:3], 1))
    rows = np.cumsum((density[..., 1:] + density[..., :-1]) / 2.0, axis=-1) / (density.shape[3] - 1)
    rows = np.concatenate([zeros, rows], axis=-1)
    sums = rows[..., -1]
    column = np.cumsum((sums[..., 1:] + sums[..., :-1]) / 2.0, axis=-1) / (density.shape[2] - 1)
    column = np.concatenate([zeros[:, :, 0], column], axis=-1)
    total = column[..., -1:]
    return density / total[..., None], rows / total[..., None], column / total


def _tables(file: MeasuredFile) -> _Tables:
    tables = file.tables
    return _of_rgl(tables) if isinstance(tables, RglTables) else _of_merl(tables)


def _of_rgl(tables: RglTables) -> _Tables:
    flags = layout.MEASURED_JACOBIAN if tables.has_jacobian else 0
    flags |= layout.MEASURED_ISOTROPIC if tables.isotropic else 0
    flags |= {1: 0, 2: layout.MEASURED_HALVES, 4: layout.MEASURED_QUARTERS}[tables.symmetry]
    return _Tables(
        flags=flags,
        theta=tables.theta.astype(np.float64),
        phi=tables.phi.astype(np.float64),
        normals=tables.normals.astype(np.float64),
        luminance=tables.luminance.astype(np.float64),
        values=tables.values,
        facets=tables.facets,
        projected=tables.projected,
        albedo=np.minimum(_warped_albedo(tables) if tables.has_jacobian else _plain_albedo(tables), 1.0),
    )


def _warped_albedo(tables: RglTables) -> _Doubles:
    """Over the warped square light is reflected as the values are: all else is the density of visible normals.

    Of that square the share is left out that stands for directions below the surface.
    """
    weights = _trapezoid(tables.values.shape[2])
    albedo = np.zeros((*tables.values.shape[:2], 3))
    for y, x in np.ndindex(len(weights), len(weights)):
        albedo += tables.values[:, :, y, x] * (weights[y] * weights[x])
    density = tables.normals.astype(np.float64)
    for p, t, half in _half_vectors(tables):
        light = half.values * density[p, t][..., None]
        whole, left = _integral(light), _integral(light * half.above[..., None])
        albedo[p, t] *= np.divide(left, whole, out=np.ones(3), where=whole > 0.0)
    return albedo


def _plain_albedo(tables: RglTables) -> _Doubles:
    """The integral of values that are the reflectance times the cosine, over the half vectors of `normals`."""
    albedo = np.zeros((*tables.values.shape[:2], 3))
    for p, t, half in _half_vectors(tables):
        area = np.where(half.above, 4.0 * half.toward * (2.0 * _PI * _PI) * half.u * half.sine, 0.0)
        albedo[p, t] = _integral(half.values * area[..., None])
    return albedo


@dataclass(frozen=True)
class _HalfVectors:
    """The half vectors of a table's `normals`, (height, width) each, for one direction of the viewer.

    Attributes
    ----------
    u, sine : (width,) float64
        Their coordinate along the table, and the sine of their polar angle.
    toward : (height, width) float64
        Cosine of the angle to the viewer, at least 0.
    above : (height, width) bool
        Whether light comes from above the surface.
    values : (height, width, 3) float64
        Where the table's map has put each.
    """

    u: _Doubles
    sine: _Doubles
    toward: _Doubles
    above: NDArray[np.bool_]
    values: _Doubles


def _half_vectors(tables: RglTables) -> Iterator[tuple[int, int, _HalfVectors]]:
    """Those of each direction of the viewer, with its indices."""
    _, rows, column = _integrated(tables.normals.astype(np.float64))
    height, width = rows.shape[2:]
    u, v = np.arange(width) / (width - 1.0), np.arange(height) / (height - 1.0)
    tilted = np.array([sin_cos(each) for each in (u * u * _HALF_PI).tolist()])
    side = tables.values.shape[2]
    for p, t in np.ndindex(*tables.values.shape[:2]):
        so, co = sin_cos(float(tables.theta[t]))
        azimuth = 0.0 if tables.isotropic else float(tables.phi[p])
        turned = np.array([sin_cos(each - azimuth)[1] for each in ((2.0 * v - 1.0) * _PI).tolist()])
        toward = np.maximum(so * turned[:, None] * tilted[:, 0] + co * tilted[:, 1], 0.0)
        above = 2.0 * toward * tilted[:, 1] > co  # where the light comes from
        ends = rows[p, t, :, -1:]
        x = np.rint(rows[p, t] / np.where(ends > 0.0, ends, 1.0) * (side - 1)).astype(np.int64)
        y = np.rint(column[p, t] * (side - 1)).astype(np.int64)
        yield p, t, _HalfVectors(u, tilted[:, 0], toward, above, tables.values[p, t, y[:, None], x].astype(np.float64))


def _integral(light: _Doubles) -> _Doubles:
    """The integral over the unit square of what is linear between (height, width) places, (channels,)."""
    down, across = (_trapezoid(count) for count in light.shape[:2])
    total: _Doubles = ((light * across[:, None]).cumsum(axis=1)[:, -1] * down[:, None]).cumsum(axis=0)[-1]
    return total


def _trapezoid(count: int) -> _Doubles:
    """Weights of the mean of a function that is linear between equally distant numbers."""
    weights = np.full(count, 1.0 / (count - 1))
    weights[[0, -1]] /= 2.0
    return weights


def _of_merl(table: MerlTable) -> _Tables:
    """A table of MERL, and densities by which its half vectors are sampled."""
    theta = np.arange(_VIEWS, dtype=np.float64) * (_HALF_PI / (_VIEWS - 1))
    viewed = np.array([sin_cos(each) for each in theta.tolist()])
    u = np.arange(_SIDE) / (_SIDE - 1.0)
    tilted = np.array([sin_cos(each) for each in (u * u * _HALF_PI).tolist()])
    turned = np.array([sin_cos(each) for each in ((2.0 * u - 1.0) * _PI).tolist()])
    # Axes: viewer, azimuth of the half vector, polar angle of the half vector
    so, co = viewed[:, 0, None, None], viewed[:, 1, None, None]
    sp, cp = turned[None, :, 0, None], turned[None, :, 1, None]
    sm, cm = tilted[None, None, :, 0], tilted[None, None, :, 1]
    across = so * sm * cp + co * cm
    out = 2.0 * across * cm - co
    value = table.values[_half_steps(u)[None, None, :], _difference_steps(across), _turn_steps(so, co, sm, cm, sp, cp)]
    area = 4.0 * np.maximum(across, 0.0) * (2.0 * _PI * _PI) * u * sm  # solid angle over that of the square
    light = value * (np.maximum(out, 0.0) * area)[..., None]
    density = (light[..., 0] + light[..., 1] + light[..., 2]) / 3.0
    weights = _trapezoid(_SIDE)
    albedo = np.zeros((_VIEWS, 3))
    mean = np.zeros(_VIEWS)
    for y, x in np.ndindex(_SIDE, _SIDE):
        albedo += light[:, y, x] * (weights[y] * weights[x])
        mean += density[:, y, x] * (weights[y] * weights[x])
    density = density + np.where(mean > 0.0, _LEAST / (2.0 * _PI) * mean, 1.0)[:, None, None] * area
    return _Tables(
        flags=layout.MEASURED_MERL | layout.MEASURED_ISOTROPIC,
        theta=theta,
        phi=np.zeros(1),
        normals=density[None],
        luminance=np.ones((1, _VIEWS, 2, 2)),
        values=table.values,
        facets=np.ones((2, 2), np.float32),
        projected=np.ones((2, 2), np.float32),
        albedo=np.minimum(albedo, 1.0)[None],
    )


def _half_steps(u: _Doubles) -> NDArray[np.int64]:
    """Steps of the root of the polar angle of a half vector."""
    return np.minimum((u * MERL_SHAPE[0]).astype(np.int64), MERL_SHAPE[0] - 1)


def _cosines(count: int, end: float) -> _Doubles:
    """Cosines where steps of an angle begin, but for the first; negative, so that they ascend."""
    return -np.array([sin_cos(end * k / count)[1] for k in range(1, count)])


def _difference_steps(cosine: _Doubles) -> NDArray[np.int64]:
    """Steps of the angle between half vector and direction."""
    return np.asarray(np.searchsorted(_cosines(MERL_SHAPE[1], _HALF_PI), -cosine), np.int64)


def _turn_steps(
    so: _Doubles, co: _Doubles, sm: _Doubles, cm: _Doubles, sp: _Doubles, cp: _Doubles
) -> NDArray[np.int64]:
    """Steps of the turn of the viewer around the half vector; both directions have the same, up to half a turn."""
    x, y = so * cm * cp - co * sm, -(so * sp) + 0.0 * cm
    length = np.sqrt(x * x + y * y)
    cosine = np.where(y < 0.0, -x, x) / np.where(length > 0.0, length, 1.0)
    return np.asarray(np.searchsorted(_cosines(MERL_SHAPE[2], _PI), -cosine), np.int64)
