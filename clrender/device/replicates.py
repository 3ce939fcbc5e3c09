"""Sums of squared replicates of a unit on a device, from which the film computes standard errors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from clrender.errors import RenderError
from clrender.film.unit import BLOCK_SLOTS

if TYPE_CHECKING:
    from clrender.device.device import Buffer, Device
    from clrender.device.launch import Scratch

__all__ = ["ReplicateSums"]

_Words = npt.NDArray[np.uint32]


class ReplicateSums:
    """Squared replicates of one unit at a time (``kernels/film/accumulate.cl``, `film_accumulate_replicates`).

    Parameters
    ----------
    device : Device
    scratch : Scratch
        Holds the buffers.
    replicate_spp : int
        Samples per replicate.
    """

    def __init__(self, device: Device, scratch: Scratch, replicate_spp: int) -> None:
        self.replicate_spp = replicate_spp
        self._device, self._scratch = device, scratch

    def begin(self, slots: int, first_sample: int) -> list[Buffer | np.generic]:
        """Prepare the buffers for a unit; returns the arguments of `film_clear_replicates`.

        Raises
        ------
        RenderError
            When the unit begins within a replicate.
        """
        if first_sample % self.replicate_spp:
            raise RenderError(f"a unit begins with sample {first_sample}, within a replicate of {self.replicate_spp}.")
        self._squares = self._scratch.buffer("squares", 96 * slots)
        self._start_sums = self._scratch.buffer("start_sums", 48 * slots)
        self._start_counts = self._scratch.buffer("start_counts", 4 * slots)
        return [*self.buffers, np.uint32(slots)]

    @property
    def buffers(self) -> list[Buffer]:
        """Last arguments of `film_accumulate_replicates`."""
        return [self._squares, self._start_sums, self._start_counts]

    def read(self, sums: _Words, counts: _Words, done: _Words) -> _Words:
        """Read the squares of whole replicates; samples of an incomplete replicate are removed.

        Parameters
        ----------
        sums, counts, done
            Fields of `clrender.film.unit.UnitSums`; reset in place to their state after the last whole replicate.

        Returns
        -------
        (slots, 3, 8) uint32
            See `clrender.film.unit.UnitSums`.
        """
        slots = len(counts)
        squares = self._read(self._squares, (slots, 3, 8))
        begun = done % np.uint32(self.replicate_spp)
        if begun.any():
            cut = np.repeat(begun > 0, BLOCK_SLOTS)
            sums[cut] = self._read(self._start_sums, (slots, 3, 4))[cut]
            counts[cut] = self._read(self._start_counts, (slots,))[cut]
            done -= begun
        return squares

    def cut(self, sums: Buffer, counts: Buffer, done: _Words) -> Buffer:
        """Remove the samples of incomplete replicates from a unit's sums on the device.

        Parameters
        ----------
        sums, counts : Buffer
            The unit's, as `film_accumulate_replicates` made them.
        done
            See `read`; reduced in place to whole replicates.

        Returns
        -------
        Buffer
            The squares of the whole replicates.
        """
        begun = done % np.uint32(self.replicate_spp)
        if begun.any():
            slots = np.uint32(BLOCK_SLOTS * len(done))
            cut = self._scratch.buffer("cut", 4 * len(done))
            self._device.write(cut, (begun > 0).astype(np.uint32))
            arguments: list[Buffer | np.generic] = [slots, cut, self._start_sums, self._start_counts, sums, counts]
            self._device.launch_each(self._device.common_program(), "film_cut_replicates", int(slots), arguments)
            done -= begun
        return self._squares

    def _read(self, buffer: Buffer, shape: tuple[int, ...]) -> npt.NDArray[Any]:
        words = np.empty(shape, np.uint32)
        self._device.read(buffer, words)
        return words
