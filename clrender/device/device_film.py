"""A film on a device: units are added to its sums where they were made, and means are computed there.

A host adds a few million pixels a second, and a device as many as its memory allows.
"""

from __future__ import annotations

import time
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from clrender.errors import RenderError
from clrender.film.held import FilmCopy
from clrender.film.unit import tile_rows

if TYPE_CHECKING:
    from collections.abc import Sequence

    from clrender.device.device import Argument, Buffer, Device
    from clrender.film import Film
    from clrender.film.unit import Unit

__all__ = ["DeviceFilm"]


class DeviceFilm:
    """Sums of all pixels of an image in the memory of a device (``kernels/film/accumulate.cl``).

    Parameters
    ----------
    device : Device
    settings : Buffer
        The render's `Settings`.
    film : Film
        What it starts from; the film may be changed afterwards.

    Raises
    ------
    RenderError, DeviceError
        When the device lacks the memory, or its driver fails. Nothing is then left on the device.
    """

    def __init__(self, device: Device, settings: Buffer, film: Film) -> None:
        self._device, self._program, self._settings = device, device.common_program(), settings
        self.width, self.height = film.width, film.height
        self._rows = film.band_rows
        self._tops = range(0, film.height, film.band_rows)
        self._owned = ExitStack()
        self._bands = [ExitStack() for _ in self._tops]
        self._whole = True
        self._base: object = film.version
        with ExitStack() as undone:
            undone.callback(self.release)
            sizes = [self.width * len(self._rows_of(top)) for top in self._tops]
            parts = list(zip(self._bands, sizes, strict=True))
            self._sums = [self._empty(band, 48 * pixels) for band, pixels in parts]
            self._counts = [self._empty(band, 4 * pixels) for band, pixels in parts]
            self._squares = [self._empty(band, 96 * pixels) for band, pixels in parts if film.replicate_spp]
            self._means = self._empty(self._owned, 12 * sizes[0])
            self._beyond = self._empty(self._owned, 8)
            self._clear(self._beyond)
            self._fill(film, sizes)
            undone.pop_all()

    def _empty(self, owner: ExitStack, nbytes: int) -> Buffer:
        buffer = self._device.empty(nbytes)
        owner.callback(self._device.release, buffer)
        return buffer

    def _rows_of(self, top: int) -> range:
        return range(top, min(top + self._rows, self.height))

    def _fill(self, film: Film, sizes: Sequence[int]) -> None:
        """Begin with the samples of a film."""
        if film.ledger.samples:
            for index, (top, band) in enumerate(zip(self._tops, film.bands(), strict=True)):
                self._device.write(self._sums[index], band)
                self._device.write(self._counts[index], film.counts[top : top + len(band)])
            for buffer, squares in zip(self._squares, film.square_bands(), strict=True):
                self._device.write(buffer, squares)
            return
        for index, pixels in enumerate(sizes):
            self._launch("film_clear", pixels, [self._sums[index], self._counts[index], np.uint32(pixels)])
        for buffer in self._squares:
            self._clear(buffer)

    def _clear(self, buffer: Buffer) -> None:
        words = np.uint32(buffer.nbytes // 8)
        self._launch("film_clear_words", int(words), [buffer, words])

    def add(self, unit: Unit, sums: Buffer, counts: Buffer, squares: Buffer | None = None) -> None:
        """Add the sums of a unit, and wait until that is done.

        Parameters
        ----------
        unit : Unit
        sums, counts, squares : Buffer
            As `film_accumulate` and `film_accumulate_replicates` made them.

        Raises
        ------
        RenderError
            When a sum exceeds the range of a film, or the driver fails. It can then no longer be copied.
        """
        self._whole = False
        head: list[Argument] = [self._settings, np.uint32(unit.first_slot), np.uint32(unit.slot_count)]
        rows = tile_rows(unit, self.width, self.height)
        for index in range(rows.start // self._rows, (rows.stop - 1) // self._rows + 1):
            top = self._tops[index]
            band: list[Argument] = [*head, np.uint32(top), np.uint32(len(self._rows_of(top)))]
            more: list[Argument] = [sums, counts, self._sums[index], self._counts[index], self._beyond]
            self._launch("film_add_unit", unit.slot_count, [*band, *more])
            if squares is not None:
                self._launch("film_add_squares", unit.slot_count, [*band, squares, self._squares[index]])
        beyond = np.empty(2, np.uint32)
        self._device.read(self._beyond, beyond)
        if beyond[0]:
            raise RenderError("a pixel has more than 4294967295 samples, the most a film counts; ask for fewer.")
        if beyond[1]:
            raise RenderError("the sum of a pixel's samples is beyond 2^62, the range of a film; use dimmer lights.")
        self._whole = True

    def copy(self, *, sums: bool, image: bool, last: bool = False) -> FilmCopy:
        """Copy what it holds.

        Parameters
        ----------
        sums, image : bool
            What is wanted besides the counts.
        last : bool
            Release each part on the device when it is copied: it then needs no more memory than one of them does.

        Raises
        ------
        RenderError
            When the driver fails, or failed before while a unit was added.
        """
        if not self._whole:
            raise RenderError("a unit was added only in part.")
        begin = time.perf_counter()
        self._whole = not last
        counts = np.empty((self.height, self.width), np.uint32)
        means = np.empty((self.height, self.width, 3), np.float32) if image else None
        bands: list[npt.NDArray[np.uint64]] = []
        squares: list[npt.NDArray[np.uint64]] = []
        for index, top in enumerate(self._tops):
            rows = self._rows_of(top)
            part = slice(top, rows.stop)
            if means is not None:
                self._develop(index, means[part])
            self._device.read(self._counts[index], counts[part])
            if sums:
                bands.append(self._read(self._sums[index], (len(rows), self.width, 3, 2)))
            if sums and self._squares:
                squares.append(self._read(self._squares[index], (len(rows), self.width, 3, 4)))
            if last:
                self._bands[index].close()
        seconds = time.perf_counter() - begin
        copy = FilmCopy(counts, bands if sums else None, squares, means, self._base, seconds)
        self._base = copy.version
        return copy

    def _read(self, buffer: Buffer, shape: tuple[int, ...]) -> npt.NDArray[np.uint64]:
        words = np.empty(shape, np.uint64)
        self._device.read(buffer, words)
        return words

    def _develop(self, index: int, image: npt.NDArray[np.float32]) -> None:
        """Compute the means of a band's pixels, (rows, width, 3)."""
        pixels = np.uint32(image.size // 3)
        self._launch("film_develop", int(pixels), [self._sums[index], self._counts[index], pixels, self._means])
        self._device.read(self._means, image)

    def _launch(self, kernel: str, count: int, arguments: list[Any]) -> None:
        self._device.launch_each(self._program, kernel, count, arguments)

    def release(self) -> None:
        """Release its memory on the device."""
        for each in (self._owned, *self._bands):
            each.close()
