"""Where the grid of a medium is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from clrender.exact.matrices import product, times
from clrender.scene.transforms import affine

if TYPE_CHECKING:
    from clrender.grids import GridData
    from clrender.scene.medium import Grid

__all__ = ["grid_placement"]


def grid_placement(grid: Grid, data: GridData) -> NDArray[np.float64]:
    """Affine map of the unit cube to the box of a grid, world space, metres.

    Parameters
    ----------
    grid : Grid
    data : GridData
        What its file holds.

    Returns
    -------
    (3, 4) float64
        The cube's x runs along the grid's last index.
    """
    if grid.box is None:
        linear, offset = data.placement[:, :3], data.placement[:, 3]
    else:
        low, high = np.array(grid.box)
        linear, offset = np.diag(high - low), low
    outer = affine(grid.transform)
    matrix = np.array(outer.linear)
    return np.concatenate([product(matrix, linear), (times(matrix, offset) + np.array(outer.offset))[:, None]], axis=1)
