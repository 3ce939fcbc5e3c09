"""Grids of densities as the kernels read them: heads that place them in the world, and their numbers in bricks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.errors import SceneError
from clrender.exact.matrices import inverse, times
from clrender.scene.density import density_placement

if TYPE_CHECKING:
    from clrender.grids import GridData
    from clrender.scene.description import Scene
    from clrender.scene.medium import Density
    from clrender.scene.values import Vector

__all__ = ["brick_words", "flat_grids"]

_ROW: Final = 16
_MOST_BRICKS: Final = 20
"""Most bricks along an axis, if they are not to be larger than the largest: a walk takes a step in each."""
_SIDES: Final = (4, 8, 16, 32, 64, 128, 256, 512)
_WORD_LIMIT: Final = 2**31
_LARGEST: Final = 1e15
"""Largest number of the map from the world to a grid."""
_COLUMNS: Final = {name: slice(at, at + count) for name, at, count, _ in layout.ROWS["GRID"]}
_Floats = NDArray[np.float32]


def flat_grids(scene: Scene, densities: Sequence[tuple[str, Density]], origin: Vector) -> tuple[_Floats, _Floats]:
    """The grids of some media.

    Parameters
    ----------
    scene : Scene
    densities : sequence of (str, Density)
        Names of media, and their grids.
    origin : (3,) float
        Of the coordinates on the device, world space, metres.

    Returns
    -------
    rows : (2 n, 16) float32
        Head of each: ``GRID_ROW_*`` of ``kernels/types.h``. One row of zeros if there are none.
    words : (N,) float32
        Tables and values of their bricks. One zero if there are none.

    Raises
    ------
    SceneError
        A file cannot be read, or the grids are too large together.
    """
    if not densities:
        return np.zeros((1, _ROW), np.float32), np.zeros(1, np.float32)
    grids = [scene.grid(*each) for each in densities]
    places, words = scene.of_contents("grids", lambda: _all_words(scene, densities, grids))
    rows = np.zeros((len(grids), 2 * _ROW), np.float32)
    for row, grid, (name, density), (side, table, values) in zip(rows, grids, densities, places, strict=True):
        matrix, offset = _to_grid(grid, density, origin)
        if max(np.abs(matrix).max(), np.abs(offset).max()) > _LARGEST:
            text = (
                "is a grid whose cells are too small for single precision, or that is too far away; give it another box"
            )
            raise SceneError(f"{scene.source}: media.{name}.density {text}")
        for axis, letter in enumerate("XYZ"):
            row[_COLUMNS[letter]] = [*matrix[axis], offset[axis]]
        size = np.array(grid.values.shape[::-1])
        row[_COLUMNS["HIGH"]], row[_COLUMNS["SIDE"]] = size + 0.5, side
        row[_COLUMNS["BRICKS"]] = -(-(size + 1) // side)
        row[_COLUMNS["TABLE"]] = np.uint32(table).view(np.float32)
        row[_COLUMNS["VALUES"]] = np.uint32(values).view(np.float32)
    return rows.reshape(-1, _ROW), words


def _to_grid(grid: GridData, density: Density, origin: Vector) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Map from coordinates on the device to those of the grid: (3, 3) and (3,)."""
    placed = density_placement(density, grid)
    linear, offset = placed[:, :3], placed[:, 3] - np.array(origin)
    back = inverse(linear) * np.array(grid.values.shape[::-1], np.float64)[:, None]
    return back, 0.5 - times(back, offset)


def _all_words(
    scene: Scene, densities: Sequence[tuple[str, Density]], grids: Sequence[GridData]
) -> tuple[list[tuple[int, int, int]], _Floats]:
    """Of each grid the side of its bricks and where its table and its values begin, and all words."""
    made: dict[tuple[str, str], tuple[int, int, int]] = {}
    parts: list[_Floats] = []
    total, places = 0, []
    for (name, density), grid in zip(densities, grids, strict=True):
        key = density.file, density.edges
        if key not in made:
            side, table, values = brick_words(grid, density.edges == "fall")
            if total + len(table) + len(values) > _WORD_LIMIT:
                text = f"the grids of its media take more than {_WORD_LIMIT} numbers; make them coarser"
                raise SceneError(f"{scene.source}: media.{name}.density: {text}")
            made[key] = side, total, total + len(table)
            parts += [table, values]
            total += len(table) + len(values)
        places.append(made[key])
    return places, parts[0] if len(parts) == 1 else np.concatenate(parts)


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
