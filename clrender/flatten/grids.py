"""Grids of media as kernels read them: heads that place them, densities in bricks, and tables of colours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.errors import SceneError
from clrender.exact.angles import logarithm_of, power_of_two
from clrender.exact.matrices import inverse, times
from clrender.scene.grid_placement import grid_placement
from clrender.scene.medium import Temperature
from clrender.spectra.colors import blackbody_color
from clrender.wording import counted, quoted

if TYPE_CHECKING:
    from clrender.grids import GridData
    from clrender.scene.description import Scene
    from clrender.scene.medium import Density, Grid, Grids
    from clrender.scene.values import Vector

__all__ = ["black_body_hue", "brick_words", "flat_grids"]

_ROW: Final = 16
_MOST_BRICKS: Final = 20
"""Most bricks along an axis, if they are not to be larger than the largest: a walk takes a step in each."""
_SIDES: Final = (4, 8, 16, 32, 64, 128, 256, 512)
_WORD_LIMIT: Final = 2**31
_LARGEST: Final = 1e15
"""Largest number of the map from the world to a grid."""
_COLDEST: Final = 100.0
_STEPS_PER_DOUBLING: Final = layout.COLORS_PER_DOUBLING
_LOG_2: Final = 0.6931471805599453
_PEAK: Final = 4.0956746e-15
"""Radiance of a black body at the peak of its spectrum over the fifth power of its temperature, W/(m2 sr nm K5)."""
_COLUMNS: Final = {name: slice(at, at + count) for name, at, count, _ in layout.ROWS["GRID"]}
_FIELD: Final = {name: slice(at, at + count) for name, at, count, _ in layout.ROWS["GRID_COLORS"]}
_Floats = NDArray[np.float32]


def flat_grids(scene: Scene, media: Sequence[tuple[str, Grids]], origin: Vector) -> tuple[_Floats, _Floats]:
    """The grids of some media.

    Parameters
    ----------
    scene : Scene
    media : sequence of (str, Grids)
        Names of media, and their grids.
    origin : (3,) float
        Of the coordinates on the device, world space, metres.

    Returns
    -------
    rows : (2 n, 16) float32
        Head of each density, ``GRID_ROW_*`` of ``kernels/types.h``, then of each table of colours,
        ``GRID_COLORS_ROW_*``.
        One row of zeros if there are none.
    words : (N,) float32
        Tables and values of the densities' bricks, and of the tables of colours. One zero if there are none.

    Raises
    ------
    SceneError
        A file cannot be read, or the grids are too large together.
    """
    if not media:
        return np.zeros((1, _ROW), np.float32), np.zeros(1, np.float32)
    words = scene.of_contents("grids", lambda: _all_words(scene, media))
    heads: list[_Floats] = []
    fields: list[_Floats] = []
    for name, grids in media:
        head = _density_row(scene, name, grids.density, words, origin)
        for column, (key, grid) in (("ALBEDO", ("albedo", grids.albedo)), ("EMISSION", _emission_of(grids))):
            if grid is not None:
                head[_COLUMNS[column]] = _bits(2 * (len(media) + len(fields)))
                fields.append(_field_row(scene, name, key, grid, words, origin))
        heads.append(head)
    return np.concatenate([*heads, *fields]).reshape(-1, _ROW), words.words


@dataclass(frozen=True)
class _Words:
    """The words of all grids, and where those of each begin.

    Attributes
    ----------
    words : (N,) float32
    bricks : mapping of (str, str) to (int, int, int)
        By asset and edges: the side of the bricks, and the words where their table and their values begin.
    fields : mapping of (str, float, float) to (int, int, int)
        By asset, offset and scale of temperatures: the words of the numbers and of the colours that they stand for, or
        0, and how many colours.
    """

    words: _Floats
    bricks: Mapping[tuple[str, str], tuple[int, int, int]]
    fields: Mapping[tuple[str, float, float], tuple[int, int, int]]


def _emission_of(grids: Grids) -> tuple[str, Grid | None]:
    """What emission is multiplied by, with its key."""
    if grids.temperature is not None:
        return "temperature", grids.temperature
    return "emission_grid", grids.emission_grid


def _bits(number: int) -> np.float32:
    """Bits of an integer, reinterpreted as a float."""
    return np.uint32(number).view(np.float32)


def _density_row(scene: Scene, name: str, density: Density, words: _Words, origin: Vector) -> _Floats:
    """Head of a density."""
    grid = scene.grid(name, "density", density)
    side, table, values = words.bricks[density.asset, density.edges]
    row = np.zeros(2 * _ROW, np.float32)
    matrix, offset = _checked_map(scene, name, "density", density, grid, origin)
    for axis, letter in enumerate("XYZ"):
        row[_COLUMNS[letter]] = [*matrix[axis], offset[axis]]
    size = np.array(grid.values.shape[::-1])
    row[_COLUMNS["HIGH"]], row[_COLUMNS["SIDE"]] = size + 0.5, side
    row[_COLUMNS["BRICKS"]] = -(-(size + 1) // side)
    row[_COLUMNS["TABLE"]], row[_COLUMNS["VALUES"]] = _bits(table), _bits(values)
    return row


def _field_row(scene: Scene, name: str, key: str, grid: Grid, words: _Words, origin: Vector) -> _Floats:
    """Head of a table of colours."""
    data = scene.grid(name, key, grid)
    values, colors, count = words.fields[_field_key(grid)]
    row = np.zeros(2 * _ROW, np.float32)
    matrix, offset = _checked_map(scene, name, key, grid, data, origin)
    for axis, letter in enumerate("XYZ"):
        row[_FIELD[letter]] = [*matrix[axis], offset[axis] - 1.0]
    row[_FIELD["LAST"]] = np.array(data.sides[::-1]) - 1
    row[_FIELD["CHANNELS"]], row[_FIELD["VALUES"]], row[_FIELD["COLORS"]] = map(_bits, (data.channels, values, colors))
    if isinstance(grid, Temperature):
        row[_FIELD["COLOR_SCALE"]], row[_FIELD["COLOR_OFFSET"]] = grid.scale / _COLDEST, grid.offset
        row[_FIELD["COLOR_LAST"]] = count - 1
    return row


def _checked_map(
    scene: Scene, name: str, key: str, grid: Grid, data: GridData, origin: Vector
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Map from coordinates on the device to those of the grid: (3, 3) and (3,)."""
    placed = grid_placement(grid, data)
    linear, shift = placed[:, :3], placed[:, 3] - np.array(origin)
    matrix = inverse(linear) * np.array(data.sides[::-1], np.float64)[:, None]
    offset = 0.5 - times(matrix, shift)
    if max(np.abs(matrix).max(), np.abs(offset).max()) > _LARGEST:
        text = "is a grid whose cells are too small for single precision, or that is too far away; give it another box"
        raise SceneError(f"{scene.source}: media.{name}.{key}.file: {quoted(grid.file)} {text}")
    return matrix, offset


def _field_key(grid: Grid) -> tuple[str, float, float]:
    return (grid.asset, grid.offset, grid.scale) if isinstance(grid, Temperature) else (grid.asset, 0.0, 0.0)


def _all_words(scene: Scene, media: Sequence[tuple[str, Grids]]) -> _Words:
    bricks: dict[tuple[str, str], tuple[int, int, int]] = {}
    fields: dict[tuple[str, float, float], tuple[int, int, int]] = {}
    parts: list[_Floats] = []
    total = 0

    def added(name: str, key: str, *more: _Floats) -> list[int]:
        nonlocal total
        begins = []
        for part in more:
            begins.append(total)
            total += len(part)
        if total > _WORD_LIMIT:
            text = f"the grids of its media take more than {counted(_WORD_LIMIT, 'number')}; make them coarser"
            raise SceneError(f"{scene.source}: media.{name}.{key}: {text}")
        parts.extend(more)
        return begins

    for name, grids in media:
        density = grids.density
        if (density.asset, density.edges) not in bricks:
            side, table, values = brick_words(scene.grid(name, "density", density), density.edges == "fall")
            begin, first = added(name, "density", table, values)
            bricks[density.asset, density.edges] = side, begin, first
        for key, grid in (("albedo", grids.albedo), _emission_of(grids)):
            if grid is None or _field_key(grid) in fields:
                continue
            data = scene.grid(name, key, grid)
            numbers = data.values.reshape(-1)
            if isinstance(grid, Temperature):
                colors = _black_body_colors(_color_count(grid, data))
                at, of_colors = added(name, key, numbers, colors.reshape(-1))
                fields[_field_key(grid)] = at, of_colors, len(colors)
            else:
                (at,) = added(name, key, numbers)
                fields[_field_key(grid)] = at, 0, 0
    return _Words(parts[0] if len(parts) == 1 else np.concatenate(parts), bricks, fields)


def _color_count(grid: Temperature, data: GridData) -> int:
    """Entries of a table of colours up to the highest temperature of a grid."""
    hottest = max((float(data.values.max()) - grid.offset) * grid.scale, _COLDEST)
    return int(logarithm_of(hottest / _COLDEST) / _LOG_2 * _STEPS_PER_DOUBLING) + 2


def _black_body_colors(count: int) -> _Floats:
    """(N, 3) colours of black bodies from the coldest on, whose temperatures grow by one factor."""
    steps = [power_of_two(number / _STEPS_PER_DOUBLING) for number in range(count)]
    return np.array([black_body_hue(_COLDEST * each) for each in steps], np.float32)


@lru_cache(maxsize=4096)
def black_body_hue(kelvin: float) -> tuple[float, float, float]:
    """Colour of a black body, over the peak of its spectrum; black up to 100 K, as in pbrt.

    Parameters
    ----------
    kelvin : float
        Not below 0.
    """
    if kelvin <= _COLDEST:
        return (0.0, 0.0, 0.0)
    peak = _PEAK * (kelvin * kelvin * kelvin * kelvin * kelvin)
    red, green, blue = blackbody_color(kelvin)
    return (red / peak, green / peak, blue / peak)


def brick_words(grid: GridData, falls: bool = False) -> tuple[int, _Floats, _Floats]:
    """The numbers of a grid in bricks, each with the numbers around it, so that no lookup needs two.

    Empty bricks are left out.

    Parameters
    ----------
    grid : GridData
    falls : bool
        Whether there are zeros around the grid, to which the outermost numbers fall; else they go on.

    Returns
    -------
    side : int
        Steps between values along a brick.
    table : (2 B,) float32
        Of each brick, of which x counts fastest, the word of ``values`` where its own begin, as bits, and the largest.
    values : (N (side + 1)³,) float32
    """
    size = np.array(grid.values.shape)
    side = next((each for each in _SIDES if (size + 1).max() <= _MOST_BRICKS * each), _SIDES[-1])
    counts = -(-(size + 1) // side)
    ends = counts * side + 1 - (size + 1)
    mode = {"mode": "constant"} if falls else {"mode": "edge"}
    padded = np.pad(grid.values, [(1, int(end)) for end in ends], **mode)  # type: ignore[call-overload]
    strides = padded.strides
    shape = (*counts.tolist(), side + 1, side + 1, side + 1)
    steps = (*(side * stride for stride in strides), *strides)
    bricks = np.lib.stride_tricks.as_strided(padded, shape, steps, writeable=False)
    most = np.stack([sheet.max(axis=(2, 3, 4)) for sheet in bricks])
    filled = most > 0.0
    values = np.ascontiguousarray(bricks[filled])
    begins = np.zeros(filled.shape, np.uint32)
    begins[filled] = np.arange(len(values), dtype=np.uint32) * np.uint32((side + 1) * (side + 1) * (side + 1))
    table = np.stack([begins.view(np.float32), most], axis=-1)
    return side, table.reshape(-1), values.reshape(-1)
