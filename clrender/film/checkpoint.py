"""Checkpoints: a film is saved repeatedly during a render, so that a crash loses only a few seconds of work.

A thread writes a copy of the film; the render waits only while the copy is made. The file is replaced by renaming, so
it is complete at all times. If the disk is full or missing, the user is warned, saving is retried and the render
continues.
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
from clrender.files.access import check_writable
from clrender.film.cadence import Cadence, processors
from clrender.film.consistency import check_consistency
from clrender.film.lock import FileLock
from clrender.film.request import differences, film_size, options_for
from clrender.film.running import RunningFilm
from clrender.image.files import DISPLAY_ENDINGS, LINEAR_ENDINGS
from clrender.limits import checked_path
from clrender.wording import counted

__all__ = ["Checkpoint", "check_checkpoint"]


def check_checkpoint(path: Path, resume: bool) -> None:
    """Check that a render may save its checkpoint to a path.

    Parameters
    ----------
    path : Path
    resume : bool
        Whether the render continues from the file.

    Raises
    ------
    UsageError
        When the path has the suffix of an image, the file exists but `resume` is False, or it cannot be written.
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
    """A save in progress, or done."""

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
        Continue from the file, if it exists.
    notify : callable
        Called with one line of text when saving fails, when it works again, or when there is no file to resume. Like
        everything else it is called in the caller's thread.
    clock : callable, optional
        Clock in seconds.

    Attributes
    ----------
    resumed : mapping
        Counts from the file: ``samples`` over all pixels, including those left out, ``rays``, ``shadow_rays`` and
        ``max_depth``.

    Raises
    ------
    UsageError
        When the file has the suffix of an image, cannot be written, is no film, or is in use by another process.
    """

    def __init__(
        self,
        path: str | Path,
        resume: bool,
        notify: Callable[[str], None],
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.path = checked_path(path, "checkpoint")
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
        self._saved_changes = 0  # `changes` of the film in the file
        self._asked = False  # whether a device was asked for what it holds
        self._before: object | None = None  # `version` of the film then
        self._held = 0  # samples in the file
        self._failing = False
        self._writes = self._failures = 0
        self._seconds = self._cost = 0.0
        self._lock = FileLock(self.path, "another render saves itself there; wait for it, or name another file")

    def __enter__(self) -> Checkpoint:
        check_writable(self.path)
        self._lock.take()
        try:
            # Checked only under the lock, as another render may just have created the file
            check_checkpoint(self.path, self._resume)
            if self._lock.works:  # no other process writes it: it was left by a killed one
                with suppress(OSError):
                    self._part.unlink()
            if self.path.exists():
                self._film = RunningFilm.load(self.path)
                check_consistency(self._film, self.path)
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
        """Whether a film to resume has been loaded."""
        return self._film is not None

    def begin(self, request: Mapping[str, Any], samples: range, about: Mapping[str, Any]) -> RunningFilm:
        """Begin the render: return the resumed film, or a new one.

        Parameters
        ----------
        request : mapping
            Request of the render.
        samples : range
            Samples that each pixel should have at the end.
        about : mapping
            Statistics of the render for the file, as JSON values.

        Raises
        ------
        UsageError
            When the film in the file is of another request, or has samples outside the range.
        """
        film = self._film
        if film is None:
            film = self._film = RunningFilm(*film_size(request), request)
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
        """Save if a save is due and the film has changed; called often, by the thread that commits."""
        if self._film is None or not self._running:
            return
        if self._saving is not None:
            if self._saving.is_alive():
                return
            self._account()
        if not self._running or not self._cadence.due(self._clock()):
            return
        if self._film.held and (not self._asked or self._film.version is self._before):
            if not self._asked:
                self._asked, self._before = True, self._film.version
            self._film.ask()  # a device has what is newer, and will deliver it
        elif self._film.changes != self._saved_changes:
            self._asked = False
            self._saving = threading.Thread(target=self._write_copy, args=(self._film,), daemon=True)
            self._saving.start()

    def finish(self) -> None:
        """Save what is not saved yet, and wait for it. Nothing may be committed afterwards."""
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
        """Entries of ``--stats``: the resumed samples, the number of saves and their cost."""
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
            if film.held:
                self._write(film.as_received(), began, time.thread_time())
                return
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
        """Write a film and record the outcome; `began` and `cpu` are clock and thread time at the start, seconds."""
        account = film.account()
        save = _Save(began, film.changes, account["samples"])
        try:
            film.save(self.path, {**self._about, **account}, beside=self._part.name)
        except ClrenderError as error:
            save.error = str(error).rstrip(".")
        except MemoryError:
            save.error = f"{self.path}: there is no memory to write it"
        # Workers continue meanwhile: the cost to them is this thread's processor time, not the time that it waits
        save.cost = (time.thread_time() - cpu) / processors()
        save.elapsed = self._clock() - began
        self._save = save

    def _account(self, last: bool = False) -> None:
        """Take in the outcome of a save that has ended, and notify the user."""
        save, self._save, self._saving = self._save, None, None
        if save is None:  # its thread died of an unexpected exception
            save = _Save(self._clock(), error=f"{self.path}: cannot be written")
        if save.broken:  # the saved file is kept
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
                kept = (
                    f"the checkpoint holds {counted(self._held, 'sample')}"
                    if self.path.exists()
                    else "there is no checkpoint"
                )
                self._notify(f"warning: {save.error}; {kept}; the image has all samples")
            elif not self._failing:
                kept = "its last checkpoint stays, " if self.path.exists() else ""
                self._notify(
                    f"warning: {save.error}; the render goes on, {kept}and the next is tried in "
                    f"{self._cadence.interval:.0f} s"
                )
        self._failing = save.error is not None


def _fresh_copy(film: RunningFilm) -> RunningFilm:
    """An empty film to copy to, with its memory pages already allocated, so that copying is fast."""
    copy = RunningFilm(film.width, film.height, film.request)
    copy.counts.fill(0)
    for band in (*copy.bands(), *copy.square_bands()):
        band.fill(0)
    return copy
