"""Which light paths were splatted into a pixel: a list of them, and the brightest written down."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from clrender import layout

if TYPE_CHECKING:
    from collections.abc import Callable

    from clrender.device.device import Argument, Buffer
    from clrender.device.worker import DeviceWorker

__all__ = ["ListedSplats"]

_LISTED: Final = 1 << 14
"""Splats of a sample that the list has room for at first."""
_SPLAT: Final = layout.columns("SPLAT")
_ROW_BYTES: Final = 4 * layout.SPLAT_WORDS


class ListedSplats:
    """The splats into one pixel, sample by sample; ``kernels/film/splat.h`` lists them.

    Parameters
    ----------
    worker : DeviceWorker
        Its tracing program has a kernel ``inspect_splats``.
    """

    def __init__(self, worker: DeviceWorker) -> None:
        self._worker = worker
        self._room = _LISTED
        self._list: Buffer | None = None
        self._found: list[npt.NDArray[np.uint32]] = []

    def arguments(self) -> list[Argument]:
        """The empty list, as the last arguments of ``light_paths``."""
        device = self._worker.device
        if self._list is None:
            self._list = device.empty(_ROW_BYTES * (self._room + 1))
        device.write(self._list, np.zeros(layout.SPLAT_WORDS, np.uint32))
        return [self._list, np.uint32(self._room)]

    def keep(self, sample: int, again: Callable[[], None]) -> None:
        """Keep what a launch has listed.

        Parameters
        ----------
        sample : int
            Number of the sample.
        again : callable
            Traces the light paths of the launch once more, with `arguments`, where the list was too short.
        """
        assert self._list is not None, "it was an argument"
        count = self._count()
        if count > self._room:
            self.release()
            self._room = 1 << (count - 1).bit_length()
            again()
        rows = np.empty((count + 1, layout.SPLAT_WORDS), np.uint32)
        self._worker.device.read(self._list, rows)
        rows = rows[1:]
        # Work-items list them in any order
        order = np.lexsort((rows[:, _SPLAT["DEPTH"]], rows[:, _SPLAT["PATH"]]))
        self._found.append(np.column_stack([np.full(count, sample, np.uint32), rows[order]]))

    def _count(self) -> int:
        assert self._list is not None, "it was an argument"
        head = np.empty(layout.SPLAT_WORDS, np.uint32)
        self._worker.device.read(self._list, head)
        return int(head[0])

    def take(self) -> npt.NDArray[np.uint32]:
        """The splats since the last call: the sample and a row of the list each, (n, 1 + `SPLAT_WORDS`) uint32."""
        found, self._found = self._found, []
        return np.concatenate(found) if found else np.zeros((0, 1 + layout.SPLAT_WORDS), np.uint32)

    def recorded(self, splats: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint32]:
        """The light paths of some splats, as ``inspect_splats`` writes them: (n, `INSPECT_ROWS`, `INSPECT_WORDS`)."""
        count, device = len(splats), self._worker.device
        found = np.zeros((count, layout.INSPECT_ROWS, layout.INSPECT_WORDS), np.uint32)
        if count:
            wanted = np.ascontiguousarray(splats[:, [0, 1 + _SPLAT["PATH"], 1 + _SPLAT["DEPTH"]]])
            buffers = [device.upload(wanted), device.empty(found.nbytes)]
            self._worker.launch_beside("inspect_splats", count, [buffers[0], np.uint32(count), buffers[1]])
            device.read(buffers[1], found)
            for each in buffers:
                device.release(each)
        return found

    def release(self) -> None:
        """Release the device memory."""
        if self._list is not None:
            self._worker.device.release(self._list)
            self._list = None
