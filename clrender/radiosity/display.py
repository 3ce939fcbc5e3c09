"""Display of radiosity: the table of radiance for the display kernel, and the kernel arguments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from clrender.integrators.descriptor import Pipeline
from clrender.radiosity.corners import Corners
from clrender.radiosity.sides import own_radiance
from clrender.radiosity.solution import Solution

if TYPE_CHECKING:
    from clrender.device.device import Buffer
    from clrender.device.worker import DeviceWorker
    from clrender.radiosity.atlas import Atlas
    from clrender.radiosity.patches import Patches

__all__ = ["GATHER", "Display", "Gather", "looks", "looks_of"]

GATHER: Final = Pipeline("radiosity/gather.cl", "radiosity_gather")
"""Renders the scene before it was divided into patches."""
_ROW: Final = 16

_Floats = NDArray[np.float64]


def looks(solution: Solution, display: str) -> NDArray[np.float32]:
    """The display table for a solution; see `looks_of`."""
    corners = Corners(solution.patches) if display == "smooth" else None
    return looks_of(solution.patches, solution.shown, solution.used, corners)


def looks_of(patches: Patches, shown: _Floats, used: NDArray[np.bool_], corners: Corners | None) -> NDArray[np.float32]:
    """The display table: a row for each side (``kernels/radiosity/display.h``).

    Parameters
    ----------
    patches : Patches
    shown : (2 n + 1, 3) float64
        Reflected radiance; for textured sides as if they were white, because the kernel looks up the texture.
    used : (2 n + 1,) bool
    corners : Corners or None
        For interpolation; None: constant radiance per patch.

    Returns
    -------
    (2 n + 1, 16) float32
    """
    rows = np.zeros((2 * len(patches) + 1, _ROW))
    rows[:, :9] = np.tile(shown, 3)
    rows[-1, :9] = 0.0
    if corners is not None:
        for back in (0, 1):
            side = slice(back, 2 * len(patches), 2)
            rows[side, :9] = corners.values(shown[side], used[side]).reshape(-1, 9)
    rows[:, 9:12] = own_radiance(patches)
    return rows.astype(np.float32)


class Gather:
    """Kernel arguments of the final gather, besides the scene before it was divided into patches.

    Parameters
    ----------
    worker : DeviceWorker
    atlas : Atlas
    """

    def __init__(self, worker: DeviceWorker, atlas: Atlas) -> None:
        self._device = worker.device
        self._tables = [worker.device.upload(atlas.rows), worker.device.upload(atlas.texels)]

    def arguments(self, sample: int) -> Sequence[Buffer | np.generic]:
        """Both tables; `sample` does not matter."""
        return self._tables

    def take_rays(self) -> int:
        """None: those of the solution are traced before there is a worker."""
        return 0

    def release(self) -> None:
        """Release the device's memory."""
        for table in self._tables:
            self._device.release(table)


class Display:
    """Kernel arguments of the integrator ``radiosity``, besides the scene.

    Parameters
    ----------
    worker : DeviceWorker
        Worker of the solution's flat scene.
    table : (2 n + 1, 16) float32
    """

    def __init__(self, worker: DeviceWorker, table: NDArray[np.float32]) -> None:
        self._device = worker.device
        self._table = worker.device.upload(table)

    def arguments(self, sample: int) -> Sequence[Buffer | np.generic]:
        """The table; `sample` does not matter."""
        return [self._table]

    def take_rays(self) -> int:
        """None: those of the solution are traced before there is a worker."""
        return 0

    def release(self) -> None:
        """Release the device's memory."""
        self._device.release(self._table)
