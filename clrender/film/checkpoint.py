"""A film saved again and again while it is rendered, so that no more is lost with the process than some seconds.

A thread writes a copy of the film: the render waits only while it is made. The file is replaced by renaming, so that
it is whole at every moment. A disk that is full or gone is told of and tried again; the render goes on.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Final

from clrender.errors import ClrenderError, UsageError
from clrender.files import check_writable
from clrender.film.cadence import Cadence, processors
from clrender.film.film import Film
from clrender.film.lock import FileLock
from clrender.film.request import differences, options_for
from clrender.film.unit import Unit, UnitSums

__all__ = ["Checkpoint", "check_checkpoint"]

_SUMMED: Final = ("rays", "shadow_rays")


def check_checkpoint(path: Path, resume: bool) -> None:
    """Make sure that a render may save itself there.

    Parameters
    ----------
    path : Path
    resume : bool
        Whether it goes on from what the file holds.

    Raises
    ------
    UsageError
        There is a file, and it is not to be resumed; or none can be written.
    """
    if not resume and path.exists():
        raise UsageError(
            f"{path}: there is a file already, which a checkpoint would replace; add --resume (resume=True) to go on "
            "from it, or remove it, or name another"
        )
    check_writable(path)


@dataclass
class _Save:
    """A save on its way, or done."""

    began: float
    samples: int
    elapsed: float = 0.0
    cost: float = 0.0
    error: str | None = None


class Checkpoint:
    """The checkpoint of a render: a context manager that holds the file's lock.

    It takes the units of the render in the place of the film.

    Parameters
    ----------
    path : path
    resume : bool
        Go on from what the file holds, where there is one.
    notify : callable
        Told, in a line, when saving fails, when it works again, and where there is nothing to go on from. Like all else
        it is called in the caller's thread.
    clock : callable, optional
        Seconds.

    Attributes
    ----------
    resumed_samples : int
        Samples that came from the file, over all pixels, those left out included.
    earlier : mapping
        What the file says of them: ``rays``, ``shadow_rays`` and ``max_depth``.

    Raises
    ------
    UsageError
        The file may not be written or is no film, or another process has it.
    """

    def __init__(
        self,
        path: str | Path,
        resume: bool,
        notify: Callable[[str], None],
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.path = Path(path)
        self.resumed_samples = 0
        self.earlier: dict[str, int] = {}
        self._resume, self._notify, self._clock = resume, notify, clock
        self._film: Film | None = None
        self._about: dict[str, Any] = {}
        self._copy: Film | None = None
        self._saving: threading.Thread | None = None
        self._save: _Save | None = None
        self._taken = 0  # samples in the film
        self._held = -1  # samples in the file; below 0 before the render begins, and after its end
        self._whole = threading.Lock()  # nobody commits while it is held
        self._failing = False
        self._writes = self._failures = 0
        self._seconds = self._cost = 0.0
        self._lock = FileLock(self.path, "another render saves itself there; wait for it, or name another file")

    def __enter__(self) -> Checkpoint:
        check_writable(self.path)
        self._lock.take()
        try:
            # What another render has just begun to write counts, too: so only now
            check_checkpoint(self.path, self._resume)
            if self.path.exists():
                self._film = Film.load(self.path)
            elif self._resume:
                self._notify(f"{self.path}: is not there yet, so the render starts from its beginning")
        except BaseException:
            self._lock.release()
            raise
        if not self._lock.works:
            self._notify(f"warning: {self.path}: cannot be locked; make sure that no other render saves itself there")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.finish()
        finally:
            self._lock.release()

    def begin(self, request: Mapping[str, Any], samples: range, about: Mapping[str, Any]) -> Film:
        """The film to go on with.

        Parameters
        ----------
        request : mapping
            Of the render.
        samples : range
            Of each pixel, that it is to have in the end.
        about : mapping
            JSON-able: what the file says of the render.

        Raises
        ------
        UsageError
            The file's film is of another request, or has other samples.
        """
        film = self._film
        if film is None:
            film = self._film = Film(request["width"], request["height"], request)
        elif found := differences(film.request, request):
            cure = options_for(film.request, found)
            raise UsageError(
                f"{self.path}: is the checkpoint of another image: {'; '.join(found.values())}; "
                f"{f'give {cure}' if cure else 'give what it was made from'}, or name another file with --checkpoint"
            )
        elif film.ledger.lacking(samples.start, samples.stop).samples + film.ledger.samples != (
            len(samples) * film.width * film.height
        ):
            raise UsageError(
                f"{self.path}: holds samples, up to {film.ledger.taken().max()} of a pixel, that are not among those "
                f"from {samples.start} to {samples.stop - 1}; ask for as many as it has (--spp) or more, and for the "
                "same part of them (--shard), or name another file with --checkpoint"
            )
        self.resumed_samples = self._held = self._taken = film.ledger.samples
        self.earlier = {name: int(film.provenance.get(name, 0)) for name in (*_SUMMED, "max_depth")}
        self._about = {**about, **self.earlier}
        self._cadence = Cadence(self._clock())
        return film

    def commit(self, unit: Unit, result: UnitSums) -> int:
        """Add what was done of a unit to the film, as `Film.commit` does."""
        assert self._film is not None
        with self._whole:
            try:
                samples = self._film.commit(unit, result)
            except BaseException:
                self._film = None  # it may hold a part of the unit: what is saved stays as it is
                raise
        self._taken += samples
        for name in _SUMMED:
            self._about[name] += getattr(result, name)
        self._about["max_depth"] = max(self._about["max_depth"], result.deepest)
        return samples

    def take_out(self, other: Film) -> None:
        """Subtract what a device did that turned out to be wrong, as `Film.take_out` does."""
        assert self._film is not None
        with self._whole:
            self._film.take_out(other)
        self._taken -= other.ledger.samples

    @property
    def width(self) -> int:
        """Of the image, pixels."""
        assert self._film is not None
        return self._film.width

    @property
    def height(self) -> int:
        """Of the image, pixels."""
        assert self._film is not None
        return self._film.height

    def tick(self) -> None:
        """Save, if it is time and something has come in; called often, by the thread that commits."""
        if self._film is None or self._held < 0:
            return
        if self._saving is not None:
            if self._saving.is_alive():
                return
            self._account()
        if self._taken != self._held and self._cadence.due(self._clock()):
            self._start()

    def finish(self) -> None:
        """Save what is not saved yet, and wait for it. Nothing may be committed after that."""
        if self._saving is not None:
            self._saving.join()
            self._account()
        if self._film is None or self._held < 0:
            return
        if self._taken != self._held:
            self._copy = None
            self._write(self._film, dict(self._about), self._clock(), time.thread_time())
            self._account(last=True)
        self._held = -1

    def stats(self) -> dict[str, Any]:
        """Of ``--stats``: what was resumed, how often the film was saved, and what that took."""
        return {
            "resumed_samples": self.resumed_samples,
            "checkpoint_writes": self._writes,
            "checkpoint_failures": self._failures,
            "checkpoint_seconds": self._seconds,
            "checkpoint_cost_seconds": self._cost,
        }

    def _start(self) -> None:
        assert self._film is not None
        self._saving = threading.Thread(target=self._write_copy, args=(dict(self._about),), daemon=True)
        self._save = None
        self._saving.start()

    def _write_copy(self, about: dict[str, Any]) -> None:
        began = self._clock()
        try:
            if self._copy is None:
                self._copy = self._fresh_copy()
            cpu = time.thread_time()
            with self._whole:
                if self._film is None:
                    return
                self._film.copy_to(self._copy)
        except MemoryError:
            self._save = _Save(began, -1, error=f"{self.path}: there is no memory for a copy of the film")
            return
        self._write(self._copy, about, began, cpu)

    def _fresh_copy(self) -> Film:
        """A film to copy to, whose memory is really there: nobody waits for that while the copy is made."""
        assert self._film is not None
        copy = Film(self._film.width, self._film.height)
        copy.counts.fill(0)
        for band in copy.bands():
            band.fill(0)
        return copy

    def _write(self, film: Film, about: dict[str, Any], began: float, cpu: float) -> None:
        """Write a film, and note how that went, counted from a moment and from this thread's processor time then."""
        save = _Save(began, film.ledger.samples)
        try:
            told = {**about, "samples": save.samples, "nonfinite_samples": save.samples - film.samples}
            film.save(self.path, told, beside=f".{Path(os.path.realpath(self.path)).name}.part")
        except ClrenderError as error:
            save.error = str(error).rstrip(".")
        except MemoryError:
            save.error = f"{self.path}: there is no memory to write it"
        # Workers go on all the while; what they lack is the processor that this thread works on, not the time it waits
        save.cost = (time.thread_time() - cpu) / processors()
        save.elapsed = self._clock() - began
        self._save = save

    def _account(self, last: bool = False) -> None:
        """Take note of a save that has ended, and say what the user should know."""
        save, self._save, self._saving = self._save, None, None
        if save is None and self._film is None:  # there is nothing to save any more
            return
        if save is None:  # its thread died of something that nobody foresaw
            save = _Save(self._clock(), -1, error=f"{self.path}: cannot be written")
        self._cadence.saved(save.began, save.cost)
        self._seconds += save.elapsed
        self._cost += save.cost
        if save.error is None:
            self._writes += 1
            self._held = save.samples
            if self._failing and not last:
                self._notify(f"{self.path}: is being written again")
        else:
            self._failures += 1
            if last:
                self._notify(f"warning: {save.error}; the checkpoint holds {self._held} samples, the image all")
            elif not self._failing:
                self._notify(
                    f"warning: {save.error}; the render goes on, its last checkpoint stays, and the next is tried in "
                    f"{self._cadence.interval:.0f} s"
                )
        self._failing = save.error is not None
