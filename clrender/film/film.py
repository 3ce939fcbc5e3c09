"""Film: adds up the samples of every pixel exactly, so that the image never depends on the order of the work.

A channel of a sample is an integer number of quanta of 2^-64, and a pixel's sum is a 128-bit two's complement integer.
Integer addition is associative, so any grouping, order, resumption or merge gives the same bits.
"""

from __future__ import annotations

import copy
import threading
import weakref
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
import numpy.typing as npt

from clrender.errors import RenderError, UsageError
from clrender.film.accumulate import Counts, Rows, Sums, add, rows_of
from clrender.film.file import FilmReader, write_film
from clrender.film.fixed_point import add_words, subtract_words, to_float64
from clrender.film.held import FilmCopy, HeldUnit
from clrender.film.ledger import Ledger
from clrender.film.unit import Unit, UnitSums
from clrender.process.huge_pages import LARGE_BYTES, prefer_large_pages, withdraw_preference
from clrender.process.memory import film_bytes
from clrender.settings import present
from clrender.wording import counted

__all__ = ["Film"]

_BAND_BYTES: Final = 64 << 20
"""Size of a band, above the threshold up to which malloc keeps freed memory, so that it returns to the system."""

_CHUNK: Final = 1 << 16
"""Pixels developed at a time, few enough that their temporaries stay in the cache."""

_Film = TypeVar("_Film", bound="Film")


class Film:
    """Exact sums and sample counts of an image, and the ledger of the samples they hold.

    Parameters
    ----------
    width, height : int
        Pixels.
    request : mapping, optional
        Everything that determines the image, as JSON values (hashes of scene and kernels, seed, integrator, …). Films
        of different requests cannot be merged. If it has `replicate_spp`, the film also holds squares of replicates.

    Attributes
    ----------
    counts : (height, width) uint32
        Samples accepted so far.
    ledger : Ledger
        The samples of each pixel that were taken, accepted or not.
    provenance : dict
        Statistics from the film file; empty for a film that was not loaded from a file.
    replicate_spp : int or None
        Samples per replicate. None: the samples of a pixel are one sequence, and errors are unknown.
    version : object
        Another object after each change; after `receive` that of the copy.
    held : bool
        Whether a device holds further samples, of which it delivers a copy now and then.
    asked : bool
        Whether somebody has read the film, or asked for a copy, since the last one.

    Notes
    -----
    A pixel takes 52 bytes (148 with replicates), in bands of rows that `develop` releases one by one. `commit`,
    `snapshot`, `merge` and `save` may be called from several threads at once.
    """

    def __init__(self, width: int, height: int, request: Mapping[str, Any] | None = None) -> None:
        if width < 1 or height < 1:
            raise UsageError(f"a film of {width} x {height} pixels holds nothing; both sides must be at least 1.")
        self.width = width
        self.height = height
        self.request: dict[str, Any] = dict(request or {})
        self.provenance: dict[str, Any] = {}
        self.ledger = Ledger(width, height)
        self.replicate_spp: int | None = self.request.get("replicate_spp")
        self.counts: Counts = np.zeros((height, width), np.uint32)
        self.band_rows = max(1, min(height, _BAND_BYTES // (48 * width)))
        # A band is (rows, width, channel, low/high word); zero pages take no memory until they are written.
        self._bands: list[Sums | None] = [
            np.zeros((min(self.band_rows, height - top), width, 3, 2), np.uint64)
            for top in range(0, height, self.band_rows)
        ]
        # Likewise with four words, in quanta of 2^-128
        self._squares: list[Sums] = [
            np.zeros((min(self.band_rows, height - top), width, 3, 4), np.uint64)
            for top in range(0, height if self.replicate_spp else 0, self.band_rows)
        ]
        for band in self._bands:
            if band is not None and band.nbytes >= LARGE_BYTES:
                prefer_large_pages(band.ctypes.data, band.nbytes)
                weakref.finalize(band, withdraw_preference, band.ctypes.data, band.nbytes).atexit = False
        self.version = object()
        self.held = self.asked = False
        self._shared = False  # whether another film has the same arrays
        self._image: npt.NDArray[np.float32] | None = None  # the mean, if a device has computed it
        self._intact = True  # False during a change, and after one that an exception ended half-way
        self._whole = threading.RLock()  # guards the consistency of the sums with the ledger
        self._pixels = threading.Lock()  # guards the consistency of a pixel's sums with its count

    @property
    def samples(self) -> int:
        """Samples accepted so far, over all pixels."""
        return int(self.counts.sum(dtype=np.uint64))

    def __getstate__(self) -> dict[str, Any]:
        with self._whole:
            return {name: value for name, value in vars(self).items() if name not in ("_whole", "_pixels")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._whole, self._pixels = threading.RLock(), threading.Lock()

    def __copy__(self: _Film) -> _Film:
        """An independent film, because two of the same arrays would not know of each other's changes."""
        return copy.deepcopy(self)

    @property
    def pixel_bytes(self) -> int:
        """Memory per pixel, bytes."""
        return film_bytes(self.replicate_spp is not None)

    @property
    def developed(self) -> bool:
        """Whether `develop` has released the sums. Such a film cannot be added to, saved or merged."""
        return any(band is None for band in self._bands)

    def bands(self) -> list[Sums]:
        """Sums of all rows, top first: (rows, width, 3, 2) uint64, low word first, in quanta of 2^-64.

        Raises
        ------
        RenderError
            After `develop`, and when a change of the film was interrupted half-way.
        """
        if self.developed:
            raise RenderError("the film is developed and its sums are released; call mean() to keep them.")
        self.asked = True
        if not self._intact:
            with self._whole:  # another thread may be changing it
                if not self._intact:
                    raise RenderError(
                        "a change of the film was interrupted, so its sums are not those of its samples; load it again"
                    )
        return [band for band in self._bands if band is not None]

    def square_bands(self) -> list[Sums]:
        """Sums of the squared sums of replicates, like `bands`: (rows, width, 3, 4) uint64, in quanta of 2^-128.

        It is empty without replicates.

        Raises
        ------
        RenderError
            After `develop`.
        """
        self.bands()
        return list(self._squares)

    def commit(self, unit: Unit, result: UnitSums, part: Film | None = None) -> int:
        """Add the result of a unit to the sums and the ledger; samples enter a film only this way, or by `merge`.

        Parameters
        ----------
        unit : Unit
        result : UnitSums
            Result of the unit, complete or stopped early.
        part : Film, optional
            A film of this size and request that holds some of this film's samples. The result is added to it too, at
            little extra cost.

        Returns
        -------
        int
            Number of added samples, over all pixels of the image, accepted or not.

        Raises
        ------
        UsageError
            When the film already holds some of these samples. It is then unchanged.
        RenderError
            When the result does not fit the unit; the film is then unchanged. Also when a sum exceeds the film's range,
            which ends the render.
        """
        slots = unit.slot_count
        if result.sums.shape != (slots, 3, 4) or result.counts.shape != (slots,) or 16 * len(result.done) != slots:
            raise RenderError(
                f"a unit of {counted(slots, 'slot')} came with sums of shape {result.sums.shape}, counts of shape "
                f"{result.counts.shape} and {counted(len(result.done), 'block')}."
            )
        self._check_done(unit, result.done)
        words, squares = _words(result.sums), None  # (slots, 3, 2)
        if self.replicate_spp and result.done.any():
            if result.squares is None or result.squares.shape != (slots, 3, 8):
                raise RenderError(f"a unit of {counted(slots, 'slot')} came without the squares of its replicates.")
            squares = _words(result.squares)
        films = (self,) if part is None else (self, part)
        with ExitStack() as held:
            for film in films:
                held.enter_context(film._whole)
                film.bands()
            for film in films:
                held.enter_context(film._changing())
                film.ledger.add(unit.blocks(self.width, self.height), unit.first_sample, result.done)
            for rows in rows_of(unit, words, result.counts, self.width, self.height, squares):
                for film in films:
                    film._add(rows)
        return int((unit.pixels(self.width, self.height) * result.done).sum())

    def _check_done(self, unit: Unit, done: npt.NDArray[np.uint32]) -> None:
        """Check that the numbers of samples of a unit's blocks are possible."""
        if int(done.max(initial=0)) > unit.sample_count:
            raise RenderError(f"a unit of {counted(unit.sample_count, 'sample')} came with {int(done.max())}.")
        whole = self.replicate_spp or 1
        if unit.first_sample % whole or (done % np.uint32(whole)).any():
            raise RenderError(f"a unit came with parts of replicates of {counted(whole, 'sample')}.")

    def receive(self, delivered: FilmCopy, units: Sequence[tuple[Unit, HeldUnit]]) -> None:
        """Replace the sums by those that a device holds: this film's, and those of some units.

        Parameters
        ----------
        delivered : FilmCopy
            Its arrays belong to this film from then on. Without sums, the film is then developed.
        units : sequence of (Unit, HeldUnit)
            The units that the device added to this film's sums.

        Raises
        ------
        UsageError
            When the film already holds some of these samples. It is then unchanged.
        RenderError
            When a unit is impossible, or the copy is not of this film; the film is then unchanged.
        """
        for unit, result in units:
            self._check_done(unit, result.done)
        with self._whole:
            self.bands()
            if delivered.base is not self.version:
                raise RenderError("the film was changed while a device held it.")
            ledger = self.ledger.copy()
            for unit, result in units:
                ledger.add(unit.blocks(self.width, self.height), unit.first_sample, result.done)
            self._shared = False  # as all arrays are replaced
            with self._changing(), self._pixels:
                self.ledger, self.counts = ledger, delivered.counts
                self._bands = [*delivered.bands] if delivered.bands else [None] * len(self._bands)
                self._squares = [*delivered.squares]
            self.version, self._image, self.asked = delivered.version, delivered.image, False

    def _share(self: _Film, other: _Film) -> None:
        """Make another film one of the same sums, with the same arrays until this one changes."""
        with self._whole:
            self._shared = True
            other.request, other.provenance, other.ledger = self.request, self.provenance, self.ledger.copy()
            other.counts, other._bands, other._squares = self.counts, list(self._bands), list(self._squares)

    def ask(self) -> bool:
        """Ask for a copy of what a device holds; returns whether one is still to come."""
        self.asked = True
        return self.held

    def mean(self) -> npt.NDArray[np.float32]:
        """Mean of the samples of each pixel; the film is not changed.

        Returns
        -------
        (height, width, 3) float32
            Radiance; 0 for pixels without samples. The exact sum is rounded to float64, divided by the count in float64
            and rounded to float32, each to nearest.

        Raises
        ------
        RenderError
            After `develop`.
        """
        with self._whole:
            if self._image is not None:
                return self._image.copy()
            return self._mean(self.bands(), release=False)

    def mean_of(self, rows: slice, columns: slice) -> npt.NDArray[np.float32]:
        """Mean of the samples for a rectangle of pixels: (h, w, 3) float32.

        Parameters
        ----------
        rows, columns : slice
            Half-open ranges within the image.

        Returns
        -------
        (h, w, 3) float32
        """
        bands = self.bands()
        places = [divmod(row, self.band_rows) for row in range(rows.start, rows.stop)]
        sums = np.stack([bands[band][row, columns] for band, row in places])
        return _mean_of(sums, self.counts[rows, columns])

    def develop(self) -> npt.NDArray[np.float32]:
        """Same image as `mean`, (height, width, 3) float32, while releasing the memory of the sums.

        The counts are kept.
        """
        with self._whole:
            image, self._image = self._image, None
            if image is not None:
                self._bands, self._squares = [None] * len(self._bands), []
                return image
            return self._mean(self.bands(), release=True)

    def snapshot(self, most: int = 512) -> npt.NDArray[np.float32]:
        """A smaller image of the current contents, for display during a render.

        It reads only every n-th pixel of every n-th row. Commits are blocked only while these are copied.

        Parameters
        ----------
        most : int
            Pixels of the longer side, at most.

        Returns
        -------
        (h, w, 3) float32
            The `mean` of these pixels.

        Raises
        ------
        RenderError
            After `develop`.
        """
        step = max(1, -(-max(self.width, self.height) // most))
        sums, counts = [], []
        self.bands()
        with self._pixels:  # of one time, as `receive` replaces both
            bands, of_all = list(self._bands), self.counts
        for index, band in enumerate(bands):
            assert band is not None, "nobody develops a film while it is looked at"
            top = index * self.band_rows
            rows = slice(-top % step, None, step)
            with self._pixels:
                sums.append(band[rows, ::step].copy())
                counts.append(of_all[top : top + len(band)][rows, ::step].copy())
        return _mean_of(np.concatenate(sums), np.concatenate(counts))

    def merge(self, other: Film, ours: str = "one film", theirs: str = "another") -> None:
        """Add another film of the same request, whose samples are not in this one.

        Parameters
        ----------
        other : Film
        ours, theirs : str
            Names of the two films in messages.

        Raises
        ------
        UsageError
            When the size or the request differs, or both films hold a sample. This film is then unchanged.
        """
        if (self.width, self.height) != (other.width, other.height):
            raise UsageError(
                f"{ours} has {self.width} x {self.height} pixels and {theirs} {other.width} x {other.height}; only "
                "films of one request can be merged."
            )
        a, b = present(self.request), present(other.request)
        different = [key for key in sorted({*a, *b}) if a.get(key) != b.get(key)]
        if different:
            raise UsageError(
                f"{ours} and {theirs} differ in {', '.join(different)}: "
                + "; ".join(f"{key} {a.get(key)!r} and {b.get(key)!r}" for key in different)
                + "; only films of one request can be merged."
            )
        if other is self:
            raise UsageError(f"{ours} and {theirs} are the same film; each sample counts once.")
        with other._whole, self._whole:
            added = other.bands()
            with self._changing() as bands:
                try:
                    self.ledger.unite(other.ledger)
                except UsageError as error:
                    raise UsageError(f"{ours} and {theirs} overlap: {error}") from None
                for index, (band, more) in enumerate(zip(bands, added, strict=True)):
                    top = index * self.band_rows
                    with self._pixels:
                        rows = slice(top, top + len(band))
                        add(band, self.counts[rows], more, other.counts[rows])
                        if self.replicate_spp:
                            add_words(self._squares[index], other._squares[index])

    def take_out(self, other: Film) -> None:
        """Subtract a film of this size whose samples are all in this one, exactly as if they had never been added.

        Parameters
        ----------
        other : Film

        Raises
        ------
        UsageError
            When some of its samples are not in this film. This film is then unchanged.
        RenderError
            After `develop`.
        """
        with other._whole, self._whole:
            taken = other.bands()
            with self._changing() as bands:
                self.ledger.take_out(other.ledger)
                for index, (band, less) in enumerate(zip(bands, taken, strict=True)):
                    top = index * self.band_rows
                    rows = slice(top, top + len(band))
                    with self._pixels:
                        subtract_words(band, less)
                        self.counts[rows] -= other.counts[rows]
                        if self.replicate_spp:
                            subtract_words(self._squares[index], other._squares[index])

    @contextmanager
    def _changing(self) -> Iterator[list[Sums]]:
        """Context of a change of the `bands`, with the film locked; after an exception it can no longer be used."""
        bands = self.bands()
        self.version, self._image = object(), None
        self._intact = False
        if self._shared:
            self._bands, self._squares = copy.deepcopy((self._bands, self._squares))
            self.counts, self._shared = self.counts.copy(), False
            bands = [band for band in self._bands if band is not None]
        try:
            yield bands
        except UsageError:  # nothing was changed
            self._intact = True
            raise
        self._intact = True

    def copy_to(self, other: Film) -> None:
        """Copy the current contents to another film of this size.

        Commits are blocked during the copy. The memory of `other` is reused; no other thread may use it meanwhile.

        Parameters
        ----------
        other : Film
        """
        with self._whole:
            mine, copies = (*self.bands(), *self._squares), (*other.bands(), *other._squares)
            with other._changing():
                other.request, other.provenance, other.ledger = self.request, self.provenance, self.ledger.copy()
                np.copyto(other.counts, self.counts)
                for band, copy in zip(mine, copies, strict=True):
                    np.copyto(copy, band)

    def save(self, path: str | Path, provenance: Mapping[str, Any] | None = None, *, beside: str | None = None) -> None:
        """Write the film to a `.film` file atomically.

        Parameters
        ----------
        path : path
            Output file; an existing film is replaced.
        provenance : mapping, optional
            JSON values; default: the provenance that the film was loaded with.
        beside : str, optional
            See `clrender.files.access.atomic_write`.

        Raises
        ------
        RenderError
            After `develop`, or when the file cannot be written.
        """
        with self._whole:
            table, blocks = self.ledger.to_file()
            header = {
                "width": self.width,
                "height": self.height,
                "request": self.request,
                "ledger": table,
                "provenance": self.provenance if provenance is None else dict(provenance),
            }
            write_film(Path(path), header, blocks, self.counts, self.bands(), self._squares, beside)

    @classmethod
    def load(cls: type[_Film], path: str | Path) -> _Film:
        """Read a film from a `.film` file.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        Film

        Raises
        ------
        UsageError
            When the file does not exist or is no complete film.
        """
        with FilmReader(Path(path)) as reader:
            film = cls(reader.header["width"], reader.header["height"], reader.header["request"])
            film.provenance = dict(reader.header["provenance"])
            film.ledger = reader.ledger()
            reader.fill(film.counts, film.bands(), film.square_bands())
            reader.require(film._agrees(), "it holds more samples than its ledger knows of")
            reader.require(film.ledger.divides(film.replicate_spp or 1), "it holds parts of replicates")
        return film

    def _agrees(self) -> bool:
        """Whether no pixel has more accepted samples than the ledger has for its block."""
        taken = self.ledger.taken().reshape(-(-self.height // 4), -1)
        for row in range(0, self.height, 4):
            most = np.repeat(taken[row // 4], 4)[: self.width]
            if (self.counts[row : row + 4] > most).any():
                return False
        return True

    def _add(self, rows: Rows) -> None:
        """Add the sums and counts of a rectangle of pixels."""
        height, width = rows.counts.shape
        top = 0
        while top < height:
            index, inside = divmod(rows.top + top, self.band_rows)
            end = min(height, top + self.band_rows - inside)
            across = slice(rows.left, rows.left + width)
            band = self._bands[index]
            assert band is not None, "nobody develops a film while it is added to"
            there = slice(inside, inside + end - top), across
            with self._pixels:
                counts = self.counts[rows.top + top : rows.top + end, across]
                add(band[there], counts, rows.sums[top:end], rows.counts[top:end])
                if rows.squares is not None:
                    add_words(self._squares[index][there], rows.squares[top:end])
            top = end

    def _mean(self, bands: list[Sums], *, release: bool) -> npt.NDArray[np.float32]:
        if release:
            self._squares = []
        image = np.empty((self.height * self.width, 3), np.float32)
        counts = self.counts.reshape(-1)
        for index in range(len(bands)):
            pixels = bands[index].reshape(-1, 3, 2)
            start = index * self.band_rows * self.width
            for first in range(0, len(pixels), _CHUNK):
                part = slice(start + first, start + min(first + _CHUNK, len(pixels)))
                image[part] = _mean_of(pixels[first : first + _CHUNK], counts[part])
            if release:
                del pixels
                self._bands[index] = None
                bands[index] = np.empty((0, 0, 3, 2), np.uint64)
        return image.reshape(self.height, self.width, 3)


def _words(halves: npt.NDArray[np.uint32]) -> Sums:
    """Combine 32-bit words to 64-bit words, least significant first."""
    words: Sums = np.ascontiguousarray(halves, "<u4").view("<u8").astype(np.uint64, copy=False)
    return words


def _mean_of(sums: Sums, counts: Counts) -> npt.NDArray[np.float32]:
    weights = np.maximum(counts, 1).astype(np.float64)
    return (to_float64(sums) / weights[..., None]).astype(np.float32)
