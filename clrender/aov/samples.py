"""Hits of individual samples, stored until a pixel has all its samples."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from clrender.errors import RenderError
from clrender.film.unit import BLOCK_SLOTS, Unit, UnitSums, tile_slots

if TYPE_CHECKING:
    from clrender.aov.label_numbers import LabelNumbers
    from clrender.flatten.flat_scene import FlatScene

__all__ = ["PrimitiveSamples"]

_NOTHING = 0
_HALF: Final = 1 << 16
_CHUNK: Final = 1 << 20


class PrimitiveSamples:
    """The primitives that samples in some rows of tiles hit; `clrender.scheduling.run` commits units to it.

    Parameters
    ----------
    width, height : int
        Size of the image, pixels.
    rows : (int, int)
        The first row of tiles, and the one after the last.
    samples : int
        Samples of each pixel.
    tile : int
        Side of a tile.

    Attributes
    ----------
    top, bottom : int
        The first row of pixels, and the one after the last.
    numbers : (bottom - top, width, samples) uint32
        Primitive + 1 of each sample; 0 if it hit nothing or was not taken.
    taken : (bottom - top, width) uint32
        Samples of each pixel.
    """

    def __init__(self, width: int, height: int, rows: tuple[int, int], samples: int, tile: int) -> None:
        self._width, self._height, self._tile = width, height, tile
        self.top, self.bottom = rows[0] * tile, min(rows[1] * tile, height)
        # A sample at a time is written, and a pixel at a time read
        self._planes = np.zeros((samples, self.bottom - self.top, width), np.uint32)
        self.numbers = np.moveaxis(self._planes, 0, 2)
        self.taken = np.zeros((self.bottom - self.top, width), np.uint32)

    def commit(self, unit: Unit, result: UnitSums) -> int:
        """Add samples of some tiles.

        Parameters
        ----------
        unit : Unit
        result : UnitSums
            Samples of `layout.FIRST_HIT_PRIMITIVE`: the primitive in two halves, below 2^16 each.

        Returns
        -------
        int
            Number of samples added.

        Raises
        ------
        RenderError
            The unit has sums of samples.
        """
        if result.samples is None:
            raise RenderError("sums came where single samples are told apart.")
        done = np.repeat(result.done, BLOCK_SLOTS)
        area, across = self._tile * self._tile, -(-self._width // self._tile)
        order = tile_slots(self._tile).reshape(self._tile, self._tile)
        planes = self._planes[unit.first_sample : unit.first_sample + unit.sample_count]
        for first in range(0, unit.slot_count, area):
            row, column = divmod((unit.first_slot + first) // area, across)
            top, left = row * self._tile, column * self._tile
            rows, columns = min(self._tile, self._height - top), min(self._tile, self._width - left)
            if rows > 0:
                slots = order[:rows, :columns]
                there = np.s_[top - self.top : top - self.top + rows, left : left + columns]
                low, high = (result.samples[:, half, first : first + area][:, slots] for half in (0, 1))
                hit = low < _HALF  # others met nothing, or are not there
                words = [np.where(hit, half, 0.0).astype(np.uint32) for half in (low, high)]
                primitive = words[0] | words[1] << np.uint32(16)
                planes[(slice(None), *there)] = np.where(hit, primitive + np.uint32(1), np.uint32(_NOTHING))
                self.taken[there] += done[first : first + area][slots]
        return int((unit.pixels(self._width, self._height) * result.done).sum())

    def told_apart(self, flat: FlatScene) -> npt.NDArray[np.uint32]:
        """The objects of `FlatInstances.seen` in place of primitives.

        Returns
        -------
        (pixels, samples) uint32
            Counted from 1; 0 for nothing.
        """
        shapes = flat.arrays["primitive_shape"]
        return self._mapped(lambda primitives: flat.instances.seen(primitives, shapes) + 1)

    def labelled(self, layer: str, labels: LabelNumbers, flat: FlatScene) -> npt.NDArray[np.uint32]:
        """The numbers of a layer of labels in place of primitives.

        Parameters
        ----------
        layer : str
            One of `clrender.aov.names.LABELS`.
        labels : LabelNumbers
        flat : FlatScene

        Returns
        -------
        (pixels, samples) uint32
            From 1; 0 for nothing.
        """
        shapes = flat.arrays["primitive_shape"]

        def numbers(primitives: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
            rows, instance = flat.instances.rows_of(primitives)
            return labels.of(layer, shapes[rows].astype(np.int64), instance)

        return self._mapped(numbers)

    def _mapped(self, numbers: Callable[[npt.NDArray[np.int64]], npt.NDArray[np.int64]]) -> npt.NDArray[np.uint32]:
        """Numbers in place of primitives, (pixels, samples) uint32; some rows at a time, to save memory."""
        found = np.zeros(self.numbers.shape, np.uint32)
        step = max(1, _CHUNK // max(found[0].size, 1)) if len(found) else 1
        for begin in range(0, len(found), step):
            rows = self.numbers[begin : begin + step]
            hit = rows > 0
            found[begin : begin + step][hit] = numbers(rows[hit].astype(np.int64) - 1)
        return found.reshape(-1, found.shape[2])
