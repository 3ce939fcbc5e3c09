"""Lights of plugins: what the kernels read of them, and how much light they give, by which light sampling goes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, MutableMapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.errors import SceneError
from clrender.exact.angles import sin_cos_degrees
from clrender.flatten.plugin_rows import parameter_numbers, plugin_number, plugin_of, used_plugins
from clrender.scene.light_kinds import PluginLight
from clrender.scene.values import POWER_LIMIT, Color, Vector, cross, length

if TYPE_CHECKING:
    from collections.abc import Sequence

    from clrender.plugins import Plugin
    from clrender.scene.description import Scene

__all__ = ["Emitted", "Grid", "Said", "given_words", "light_axes", "light_grid", "light_spread", "measured_lights"]

ROWS: Final = 96
COLUMNS: Final = 32
_POWER: Final = 4
"""Power of the distance from the axis that 1 - cosine grows by: beams are narrow, and the first row is 0.03° wide."""
_LEAST_SHARE: Final = 1e-3
"""Of the light of a formula that is 1 all over its cone: no light counts as darker, as it may shine between the grid's
directions, and what has no power is never sampled."""
_Floats: TypeAlias = NDArray[np.float64]
Said: TypeAlias = "Callable[[Sequence[Plugin], int, Sequence[float], NDArray[np.float32]], NDArray[np.float32]]"
"""Evaluates the formula of one of some plugins, by its number from 1 on, with these numbers for its parameters, in
directions (n, 3) of its own frame: (n, 3) W/sr."""
_HEAD: Final = {name: at for name, at, _, _ in layout.ROWS["GIVEN"]}


@dataclass(frozen=True)
class Emitted:
    """What a plugin's formula gives, without the light's scale.

    Attributes
    ----------
    integral : (3,) float
        Of the intensity over solid angle, by colour, watts.
    moments : (3, 3) float
        The same of intensity times direction, by colour; in the light's frame.
    peak : float
        The largest intensity found, W/sr.
    """

    integral: Color
    moments: tuple[Vector, Vector, Vector] = field(repr=False)
    peak: float

    @classmethod
    def even(cls, spread: float) -> Emitted:
        """Of a formula that is 1 in all of its cone, which stands for one that nobody has evaluated.

        Parameters
        ----------
        spread : float
            1 - cosine of half the cone.
        """
        solid_angle = 2.0 * math.pi * spread
        along = (0.0, 0.0, solid_angle * (1.0 - spread / 2.0))
        return cls((solid_angle,) * 3, (along,) * 3, 0.0)

    def flux(self, luminance: Color, spread: float) -> float:
        """Luminance of the integral, for a light whose scale times the weights of luminance is given; not too small."""
        found = sum(w * part for w, part in zip(luminance, self.integral, strict=True))
        return max(found / sum(luminance), _LEAST_SHARE * 2.0 * math.pi * spread)

    def mean(self, luminance: Color) -> _Floats:
        """Approximate mean direction of its light, (3,), in its frame; see `flux`."""
        found = sum(w * part for w, part in zip(luminance, self.integral, strict=True))
        if found <= 0.0:
            return np.zeros(3)
        x, y, z = (sum(w * each[i] for w, each in zip(luminance, self.moments, strict=True)) for i in range(3))
        return np.array([x, y, z]) / found


@dataclass(frozen=True)
class Grid:
    """Directions of a cone about z, in rings that are denser near its axis, and their solid angles.

    Attributes
    ----------
    directions : (n, 3) float32
        Unit vectors.
    solid_angles : (n,) float64
        Steradians.
    """

    directions: NDArray[np.float32]
    solid_angles: _Floats


def light_spread(plugin: Plugin) -> float:
    """1 - cosine of half the cone of a plugin's light; 2 for one that shines all around."""
    sine = sin_cos_degrees(plugin.header.cone_degrees / 4.0)[0]
    return 2.0 * (sine * sine) if plugin.header.cone_degrees < 360.0 else 2.0


def light_grid(spread: float, rows: int = ROWS, columns: int = COLUMNS) -> Grid:
    """The directions at which formulas are evaluated; the same numbers on every machine.

    Parameters
    ----------
    spread : float
        1 - cosine of half the cone.
    rows, columns : int
        Rings, and directions of each.
    """
    edges = [i / rows for i in range(rows + 1)]
    drops = [spread * _power((i + 0.5) / rows) for i in range(rows)]
    widths = [spread * (_power(b) - _power(a)) for a, b in pairwise(edges)]
    # Those of every other ring lie between those of the others, and all of them within the columns
    turns = [sin_cos_degrees((180.0 * j + 90.0) / columns) for j in range(2 * columns)]
    directions = np.empty((rows, columns, 3))
    for i, drop in enumerate(drops):
        across = math.sqrt(max(drop * (2.0 - drop), 0.0))
        sines, cosines = np.array(turns[i % 2 :: 2]).T
        directions[i] = np.stack([across * cosines, across * sines, np.full(columns, 1.0 - drop)], axis=1)
    solid_angles = np.repeat(np.array(widths) * (2.0 * math.pi / columns), columns)
    return Grid(directions.reshape(-1, 3).astype(np.float32), solid_angles)


def _power(x: float) -> float:
    result = x
    for _ in range(_POWER - 1):
        result *= x
    return result


def measured_lights(
    scene: Scene, said: Said, known: MutableMapping[tuple[Any, ...], Emitted] | None = None
) -> Mapping[int, Emitted]:
    """What each light of a plugin gives, by its index.

    Parameters
    ----------
    scene : Scene
    said : callable
        Evaluates formulas; see `Said`.
    known : mutable mapping, optional
        What was measured before, by the hash of the plugin's text and the numbers of its parameters.

    Raises
    ------
    SceneError
        A formula gives a negative intensity, one that is not finite, or one that is too large.
    """
    known = {} if known is None else known
    plugins = used_plugins(scene)
    found: dict[int, Emitted] = {}
    for index, light in enumerate(scene.lights):
        if not isinstance(light, PluginLight):
            continue
        plugin, numbers = plugin_of(scene, light), parameter_numbers(scene, light)
        key = (plugin.sha256, *numbers)
        if key not in known:
            grid = light_grid(light_spread(plugin))
            values = said(plugins, plugin_number(scene, plugin.name), numbers, grid.directions)
            where = f"{scene.source}: lights[{index}]: the plugin {plugin.name}"
            known[key] = _emitted(grid, values, where)
        found[index] = known[key]
    return found


def _emitted(grid: Grid, values: NDArray[np.float32], where: str) -> Emitted:
    sound = np.isfinite(values) & (values >= 0.0) & (values <= POWER_LIMIT)
    if not sound.all():
        at = int(np.flatnonzero(~sound.all(axis=1))[0])
        value = values[at][~sound[at]][0]
        x, y, z = (float(each) for each in grid.directions[at])
        cure = f"it has to be from 0 to {POWER_LIMIT:g}; `clrender furnace` tests it"
        raise SceneError(f"{where} gives the intensity {value:g} W/sr in the direction ({x:g}, {y:g}, {z:g}); {cure}")
    light = values.astype(np.float64) * grid.solid_angles[:, None]
    directions = grid.directions.astype(np.float64)
    red, green, blue = (math.fsum(light[:, i].tolist()) for i in range(3))
    moments = [tuple(math.fsum((light[:, i] * directions[:, k]).tolist()) for k in range(3)) for i in range(3)]
    return Emitted((red, green, blue), tuple(moments), float(values.max()))  # type: ignore[arg-type]


def light_axes(light: PluginLight) -> tuple[Vector, Vector, Vector]:
    """Unit vectors of its frame in the world: x, to the right as seen along z; y, up; and z."""
    axis = _unit(light.direction)
    right = _unit(cross(axis, _unit(light.upward)))
    return right, cross(right, axis), axis


def given_words(scene: Scene, light: PluginLight) -> NDArray[np.float32]:
    """The rows of a light in `lamp_tables`: `layout.ROWS` ``GIVEN``, and the numbers of its parameters.

    Returns
    -------
    (32,) float32
    """
    plugin, numbers = plugin_of(scene, light), parameter_numbers(scene, light)
    words = np.zeros(32, np.float32)
    words[_HEAD["PLUGIN"] : _HEAD["PLUGIN"] + 1].view(np.uint32)[0] = plugin_number(scene, plugin.name)
    words[_HEAD["SPREAD"]] = light_spread(plugin)
    right, _, axis = light_axes(light)
    words[_HEAD["AXIS"] : _HEAD["AXIS"] + 3] = axis
    words[_HEAD["RIGHT"] : _HEAD["RIGHT"] + 3] = right
    words[16 : 16 + len(numbers)] = numbers
    return words


def _unit(vector: Vector) -> Vector:
    size = length(vector)
    x, y, z = (each / size for each in vector)
    return (x, y, z)
