"""Film: adds up the samples of every pixel exactly, so that the picture never depends on the order of the work.

A channel of a sample is an integer number of quanta of 2^-64, and a pixel's sum is a 128-bit two's complement
integer. Integer addition is associative: any grouping, order, resumption or merge gives the same bits.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from clrender.errors import RenderError, UsageError
from clrender.film.file import read_arrays, read_header, write_film
from clrender.film.fixed_point import QUANTUM_BITS, SAMPLE_LIMIT_BITS, to_float64
from clrender.film.ledger import UnitSet

__all__ = ["Film"]

_UNIT_LIMIT: Final = 1 << (126 - QUANTUM_BITS - SAMPLE_LIMIT_BITS)
"""Samples a pixel may hold before its sum has to be watched: fewer cannot pass 2^126 quanta."""

_BAND_BYTES: Final = 64 << 20
"""Bands are larger than any size malloc keeps for itself, so that a released one returns to the system."""

_CHUNK: Final = 1 << 16
"""Pixels developed at a time: their temporaries stay in the cache."""

_Sums = npt.NDArray[np.uint64]
_Integers = npt.NDArray[np.integer[Any]]


class Film:
    """Exact sums and sample counts of an image, and which units of work they hold.

    Parameters
    ----------
    width, height : int
        Pixels.
    request : mapping, optional
        What makes the image what it is, JSON-able (scene hash, seed, integrator, …). Films of different
        requests refuse to merge.
    cut : mapping, optional
        How units are numbered, JSON-able; see `clrender.film.ledger.UnitSet`.

    Attributes
    ----------
    counts : (height, width) uint32
        Samples accepted so far.
    units : UnitSet
        Finished units; whoever adds a unit's sums records it here.
    provenance : dict
        What the film file said about its making; empty for a film not loaded from a file.

    Notes
    -----
    A pixel takes 52 bytes, in bands of rows that `develop` releases one by one. Not thread-safe.
    """

    def __init__(
        self, width: int, height: int, request: Mapping[str, Any] | None = None, cut: Mapping[str, Any] | None = None
    ) -> None:
        if width < 1 or height < 1:
            raise UsageError(f"a film of {width} x {height} pixels holds nothing; both sides must be at least 1.")
        self.width = width
        self.height = height
        self.request: dict[str, Any] = dict(request or {})
        self.provenance: dict[str, Any] = {}
        self.units = UnitSet(cut)
        self.counts: npt.NDArray[np.uint32] = np.zeros((height, width), np.uint32)
        self.band_rows = max(1, min(height, _BAND_BYTES // (48 * width)))
        # A band is (rows, width, channel, low/high word); zero pages cost nothing until they are written.
        self._bands: list[_Sums | None] = [
            np.zeros((min(self.band_rows, height - top), width, 3, 2), np.uint64)
            for top in range(0, height, self.band_rows)
        ]

    @property
    def samples(self) -> int:
        """Samples accepted so far, over all pixels."""
        return int(self.counts.sum(dtype=np.uint64))

    @property
    def developed(self) -> bool:
        """Whether `develop` has released the sums; such a film can be neither added to, saved nor merged."""
        return any(band is None for band in self._bands)

    def bands(self) -> list[_Sums]:
        """Sums of all rows, top first: (rows, width, 3, 2) uint64, low word first, in quanta of 2^-64.

        Raises
        ------
        RenderError
            After `develop`.
        """
        if self.developed:
            raise RenderError("the film is developed and its sums are released; call mean() to keep them.")
        return [band for band in self._bands if band is not None]

    def add(
        self, rows: _Integers, columns: _Integers, sums: npt.NDArray[np.uint32], counts: npt.NDArray[np.uint32]
    ) -> None:
        """Add sums of some pixels, with carry.

        Parameters
        ----------
        rows, columns : (n,) integers
            The pixels, each at most once. Whole rectangles in row-major order go fastest.
        sums : (n, 3, 4) uint32
            128-bit two's complement sums in quanta of 2^-64, least significant word first.
        counts : (n,) uint32
            Samples in each sum.

        Raises
        ------
        RenderError
            A pixel outside the film or named twice, wrong shapes, or a sum beyond the film's range. The film
            is then unchanged, except for a sum out of range, which ends the render.
        """
        n = len(rows)
        if len(columns) != n or np.shape(sums) != (n, 3, 4) or np.shape(counts) != (n,):
            raise RenderError(
                f"a unit of {n} pixels came with {len(columns)} columns, sums of shape {np.shape(sums)} and counts of "
                f"shape {np.shape(counts)}; expected ({n}, 3, 4) and ({n},)."
            )
        if n == 0:
            return
        rows, columns = np.asarray(rows), np.asarray(columns)
        if rows.min() < 0 or columns.min() < 0 or rows.max() >= self.height or columns.max() >= self.width:
            raise RenderError(f"a unit has pixels outside its film of {self.width} x {self.height}.")
        words = np.ascontiguousarray(sums, "<u4").view("<u8").astype(np.uint64, copy=False)  # (n, 3, 2)
        counts = np.asarray(counts, np.uint32)
        area = _rectangle(rows, columns)
        if area is None:
            self._add_scattered(rows.astype(np.int64), columns.astype(np.int64), words, counts)
        else:
            self._add_rectangle(area, words, counts)

    def mean(self) -> npt.NDArray[np.float32]:
        """Mean of the samples of each pixel; the film stays as it is.

        Returns
        -------
        (height, width, 3) float32
            Radiance; 0 where there is no sample. The exact sum is rounded to float64, divided by the count
            in float64 and rounded to float32, each to nearest.

        Raises
        ------
        RenderError
            After `develop`.
        """
        return self._mean(self.bands(), release=False)

    def develop(self) -> npt.NDArray[np.float32]:
        """Same picture as `mean`, giving back the memory of the sums on the way: 52 bytes a pixel at most.

        The counts stay.
        """
        return self._mean(self.bands(), release=True)

    def merge(self, other: Film) -> None:
        """Add another film of the same request whose units are not in this one.

        Raises
        ------
        UsageError
            Another size or request, units numbered in another way, or units that both hold. This film is then
            unchanged.
        """
        if (self.width, self.height) != (other.width, other.height):
            raise UsageError(
                f"films of {self.width} x {self.height} and {other.width} x {other.height} pixels are not of one "
                "request; only films of one request can be merged."
            )
        keys = sorted({*self.request, *other.request})
        different = [key for key in keys if self.request.get(key) != other.request.get(key)]
        if different:
            raise UsageError(
                f"the films differ in {', '.join(different)}: "
                + "; ".join(f"{key} {self.request.get(key)!r} and {other.request.get(key)!r}" for key in different)
                + "; only films of one request can be merged."
            )
        theirs = other.bands()
        ours = self.bands()
        self.units.update(other.units)
        for index, (band, added) in enumerate(zip(ours, theirs, strict=True)):
            top = index * self.band_rows
            area = np.s_[top : top + len(band)]
            _accumulate(band, self.counts[area], added, other.counts[area])

    def save(self, path: str | Path, provenance: Mapping[str, Any] | None = None) -> None:
        """Write the film to a `.film` file, all of it or nothing.

        Parameters
        ----------
        path : path
            Where to; an existing film is replaced.
        provenance : mapping, optional
            JSON-able; by default what the film was loaded with.

        Raises
        ------
        RenderError
            After `develop`, or when the file cannot be written.
        """
        header = {
            "width": self.width,
            "height": self.height,
            "request": self.request,
            "units": self.units.to_json(),
            "provenance": self.provenance if provenance is None else dict(provenance),
        }
        write_film(Path(path), header, self.counts, self.bands())

    @classmethod
    def load(cls, path: str | Path) -> Film:
        """Film from a `.film` file.

        Raises
        ------
        UsageError
            No such file, or it is not a whole film.
        """
        file = Path(path)
        header = read_header(file)
        film = cls(header["width"], header["height"], header["request"])
        film.provenance = dict(header["provenance"])
        try:
            film.units = UnitSet.from_json(header["units"])
        except (KeyError, TypeError, ValueError) as error:
            raise UsageError(
                f"{file}: the list of finished units is damaged ({error}); render the film again."
            ) from None
        read_arrays(file, film.counts, film.bands())
        return film

    def _add_rectangle(self, area: tuple[int, int, int, int], words: _Sums, counts: npt.NDArray[np.uint32]) -> None:
        top, left, height, width = area
        bands = self.bands()
        words = words.reshape(height, width, 3, 2)
        counts = counts.reshape(height, width)
        row = top
        while row < top + height:
            band = row // self.band_rows
            stop = min(top + height, (band + 1) * self.band_rows)
            inside = np.s_[row - band * self.band_rows : stop - band * self.band_rows, left : left + width]
            part = np.s_[row - top : stop - top]
            _accumulate(bands[band][inside], self.counts[row:stop, left : left + width], words[part], counts[part])
            row = stop

    def _add_scattered(
        self, rows: npt.NDArray[np.int64], columns: npt.NDArray[np.int64], words: _Sums, counts: npt.NDArray[np.uint32]
    ) -> None:
        bands = self.bands()
        flat = rows * self.width + columns
        order = np.argsort(flat, kind="stable")
        flat = flat[order]
        if np.any(flat[1:] == flat[:-1]):
            raise RenderError("a unit names a pixel twice; each pixel may occur once.")
        band_pixels = self.band_rows * self.width
        all_counts = self.counts.reshape(-1)
        for index in range(int(flat[0]) // band_pixels, int(flat[-1]) // band_pixels + 1):
            first, last = np.searchsorted(flat, (index * band_pixels, (index + 1) * band_pixels))
            if first == last:
                continue
            chosen, source = flat[first:last], order[first:last]
            pixels = bands[index].reshape(-1, 3, 2)
            inside = chosen - index * band_pixels
            total, total_counts = pixels[inside], all_counts[chosen]
            _accumulate(total, total_counts, words[source], counts[source])
            pixels[inside], all_counts[chosen] = total, total_counts

    def _mean(self, bands: list[_Sums], *, release: bool) -> npt.NDArray[np.float32]:
        image = np.empty((self.height * self.width, 3), np.float32)
        counts = self.counts.reshape(-1)
        for index in range(len(bands)):
            pixels = bands[index].reshape(-1, 3, 2)
            start = index * self.band_rows * self.width
            for first in range(0, len(pixels), _CHUNK):
                part = np.s_[start + first : start + min(first + _CHUNK, len(pixels))]
                weights = np.maximum(counts[part], 1).astype(np.float64)
                image[part] = (to_float64(pixels[first : first + _CHUNK]) / weights[:, None]).astype(np.float32)
            if release:
                del pixels
                self._bands[index] = None
                bands[index] = np.empty((0, 0, 3, 2), np.uint64)
        return image.reshape(self.height, self.width, 3)


def _rectangle(rows: _Integers, columns: _Integers) -> tuple[int, int, int, int] | None:
    """(top, left, height, width) when the pixels are exactly a rectangle in row-major order."""
    top, left = int(rows[0]), int(columns[0])
    height, width = int(rows[-1]) - top + 1, int(columns[-1]) - left + 1
    if height < 1 or width < 1 or height * width != len(rows):
        return None
    if np.any(rows.reshape(height, width) != np.arange(top, top + height)[:, None]):
        return None
    if np.any(columns.reshape(height, width) != np.arange(left, left + width)):
        return None
    return top, left, height, width


def _accumulate(
    total: _Sums, total_counts: npt.NDArray[np.uint32], words: _Sums, counts: npt.NDArray[np.uint32]
) -> None:
    """Add `words` (…, 3, 2) to `total` in place, and the counts (…)."""
    low, high = total[..., 0], total[..., 1]
    low += words[..., 0]
    carry = low < words[..., 0]
    high += words[..., 1]
    high += carry
    total_counts += counts
    if np.any(total_counts < counts):
        raise RenderError("a pixel has more than 4294967295 samples, the most a film counts; ask for fewer.")
    if total_counts.max(initial=0) >= _UNIT_LIMIT and np.any(high.astype(np.int64) + (1 << 62) < 0):
        raise RenderError("the sum of a pixel's samples is beyond 2^62, the range of a film; use dimmer lights.")
