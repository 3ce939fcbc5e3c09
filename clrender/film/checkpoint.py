"""A film saved again and again while it is rendered, so that no more is lost with the process than some seconds.

A thread writes a copy of the film: the render waits only while it is made. The file is replaced by renaming, so that
it is whole at every moment. A disk that is full or gone is told of and tried again; the render goes on.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from clrender.errors import ClrenderError, UsageError
from clrender.files import check_writable
from clrender.film.cadence import Cadence, processors
from clrender.film.lock import FileLock
from clrender.film.request import differences, options_for
from clrender.film.running import RunningFilm
from clrender.image.files import DISPLAY_ENDINGS, LINEAR_ENDINGS

__all__ = ["Checkpoint", "check_checkpoint"]


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
        It has the ending of an image. There is a file, and it is not to be resumed; or none can be written.
    """
    _check_ending(path)
    if not resume and path.exists():
        raise UsageError(
            f"{path}: exists already and would be overwritten by the checkpoint; add --resume (resume=True) to "
            "continue from it, remove it, or name another"
        )
    check_writable(path)


def _check_ending(path: Path) -> None:
    if path.suffix.lower() in DISPLAY_ENDINGS + LINEAR_ENDINGS:
        raise UsageError(f"{path}: a checkpoint is a film; give it a name that ends in .film")


@dataclass
class _Save:
    """A save on its way, or done."""

    began: float
    changes: int = 0
    samples: int = 0
    elapsed: float = 0.0
    cost: float = 0.0
    error: str | None = None
    broken: bool = False


class Checkpoint:
    """The checkpoint of a render: a context manager that holds the file's lock.

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
    resumed : mapping
        What came from the file: ``samples`` over all pixels, those left out included, and what it says of them,
        ``rays``, ``shadow_rays`` and ``max_depth``.

    Raises
    ------
    UsageError
        The file has the ending of an image, may not be written or is no film, or another process has it.
    """

    def __init__(
        self,
        path: str | Path,
        resume: bool,
        notify: Callable[[str], None],
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.path = Path(path)
        _check_ending(self.path)
        target = Path(os.path.realpath(path))
        self._part = target.with_name(f".{target.name}.part")
        self.resumed: Mapping[str, int] = {"samples": 0, "rays": 0, "shadow_rays": 0, "max_depth": 0}
        self._resume, self._notify, self._clock = resume, notify, clock
        self._film: RunningFilm | None = None
        self._about: dict[str, Any] = {}
        self._copy: RunningFilm | None = None
        self._saving: threading.Thread | None = None
        self._save: _Save | None = None
        self._running = False
        self._saved_changes = 0  # of the film, as it is in the file
        self._held = 0  # samples there
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
            if self._lock.works:  # nobody else writes it: a killed process has left it
                with suppress(OSError):
                    self._part.unlink()
            if self.path.exists():
                self._film = RunningFilm.load(self.path)
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

    @property
    def loaded(self) -> bool:
        """Whether there is a film to go on from, which is in memory then."""
        return self._film is not None

    def begin(self, request: Mapping[str, Any], samples: range, about: Mapping[str, Any]) -> RunningFilm:
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
            film = self._film = RunningFilm(request["width"], request["height"], request)
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
        self.resumed = film.take_up()
        self._held = self.resumed["samples"]
        self._about = dict(about)
        self._cadence = Cadence(self._clock())
        self._running = True
        return film

    def tick(self) -> None:
        """Save, if it is time and something has come in; called often, by the thread that commits."""
        if self._film is None or not self._running:
            return
        if self._saving is not None:
            if self._saving.is_alive():
                return
            self._account()
        unsaved = self._running and self._film.changes != self._saved_changes
        if unsaved and self._cadence.due(self._clock()):
            self._saving = threading.Thread(target=self._write_copy, args=(self._film,), daemon=True)
            self._saving.start()

    def finish(self) -> None:
        """Save what is not saved yet, and wait for it. Nothing may be committed after that."""
        if self._saving is not None:
            self._saving.join()
            self._account()
        if self._film is None or not self._running:
            return
        self._running = False
        if self._film.changes != self._saved_changes and self._film.intact:
            self._copy = None
            self._write(self._film, self._clock(), time.thread_time())
            self._account(last=True)

    def stats(self) -> dict[str, Any]:
        """Of ``--stats``: what was resumed, how often the film was saved, and what that took."""
        return {
            "resumed_samples": self.resumed["samples"],
            "checkpoint_writes": self._writes,
            "checkpoint_failures": self._failures,
            "checkpoint_seconds": self._seconds,
            "checkpoint_cost_seconds": self._cost,
        }

    def _write_copy(self, film: RunningFilm) -> None:
        began = self._clock()
        try:
            if self._copy is None:
                self._copy = _fresh_copy(film)
            cpu = time.thread_time()
            if film.copy_if_whole(self._copy):
                self._write(self._copy, began, cpu)
            else:
                self._save = _Save(began, broken=True)
        except MemoryError:
            self._save = _Save(began, error=f"{self.path}: there is no memory for a copy of the film")

    def _write(self, film: RunningFilm, began: float, cpu: float) -> None:
        """Write a film, and note how that went, counted from a moment and from this thread's processor time then."""
        account = film.account()
        save = _Save(began, film.changes, account["samples"])
        try:
            film.save(self.path, {**self._about, **account}, beside=self._part.name)
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
        if save is None:  # its thread died of something that nobody foresaw
            save = _Save(self._clock(), error=f"{self.path}: cannot be written")
        if save.broken:  # what is saved stays as it is
            self._running = False
            return
        self._cadence.saved(save.began, save.cost)
        self._seconds += save.elapsed
        self._cost += save.cost
        if save.error is None:
            self._writes += 1
            self._saved_changes, self._held = save.changes, save.samples
            if self._failing and not last:
                self._notify(f"{self.path}: is being written again")
        else:
            self._failures += 1
            if last:
                kept = f"the checkpoint holds {self._held} samples" if self.path.exists() else "there is no checkpoint"
                self._notify(f"warning: {save.error}; {kept}, the image all")
            elif not self._failing:
                kept = "its last checkpoint stays, " if self.path.exists() else ""
                self._notify(
                    f"warning: {save.error}; the render goes on, {kept}and the next is tried in "
                    f"{self._cadence.interval:.0f} s"
                )
        self._failing = save.error is not None


def _fresh_copy(film: RunningFilm) -> RunningFilm:
    """A film to copy to, whose memory is really there: nobody waits for that while the copy is made."""
    copy = RunningFilm(film.width, film.height, film.request)
    copy.counts.fill(0)
    for band in (*copy.bands(), *copy.square_bands()):
        band.fill(0)
    return copy
