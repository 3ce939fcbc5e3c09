"""An image that refines: coarse pictures first, then sample by sample; of one job after the other, on one session."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from clrender.film.replicates import relative_error
from clrender.film.running import RunningFilm
from clrender.image.files import image_sha256
from clrender.session import Session
from clrender.view.frames import Shot

if TYPE_CHECKING:
    from clrender.job import RenderJob
    from clrender.rendered_image import Progress, RenderedImage

__all__ = ["PROBED", "Progressive"]

_PREVIEW_SECONDS: Final = 0.06
"""What the first picture may take: with what comes before and after it, it is there within a tenth of a second."""
_COARSEST: Final = 32
"""Side of the square of pixels that are one pixel of a preview, at most."""
_FIRST_RATE: Final = 3e5
"""Pixels a second of a preview, while nobody knows."""
_LAYER_SAMPLES: Final = 4
"""Of the layers that are shown."""
_PROBE_PIXELS: Final = 1 << 20
"""Pixels of the layers that are looked up, at most."""
PROBED: Final = ("object", "material", "depth", "position", "normal")


class Progressive:
    """Renders what it is told, a piece at a time, until all samples are taken; one thread calls it.

    Parameters
    ----------
    session : Session
    changed : callable
        Called whenever there is something new to see.
    advanced : callable
        Told how far the render is, after each launch.

    Attributes
    ----------
    shot : Shot or None
        What there is to see; another one for each image.
    running : bool
        Whether samples are taken beyond the first picture.
    wanted : set of str
        Layers of what is seen first that somebody looks at.
    """

    def __init__(self, session: Session, changed: Callable[[], None], advanced: Callable[[Progress], None]) -> None:
        self.shot: Shot | None = None
        self.running = True
        self.wanted: set[str] = set()
        self.seconds = 0.0
        self._session = session
        self._changed, self._advanced = changed, advanced
        self._job: RenderJob | None = None
        self._steps: list[int] = []
        self._rate = _FIRST_RATE
        self._warm = False
        self._failed = False
        # Both know their image by its revision: the image itself would keep its film when another one has begun.
        self._error: tuple[int, float, float | None] = (0, 0.0, None)
        self._probed: tuple[int, int, dict[str, npt.NDArray[np.float32]]] = (0, 1, {})

    @property
    def session(self) -> Session:
        """Whose devices render."""
        return self._session

    def use(self, session: Session) -> None:
        """Render with another session from now on; the image begins anew with the next `restart`."""
        before, self._session = self._session, session
        self._rate, self._warm = _FIRST_RATE, False
        before.close()

    def restart(self, job: RenderJob, moves: Mapping[int, int | str | None], *, moved: bool = False) -> None:
        """Begin another image.

        Parameters
        ----------
        job : RenderJob
        moves : mapping
            As of `Shot.moves`.
        moved : bool
            Whether only the camera is another: what is known of the speed holds.
        """
        revision = 1 if self.shot is None else self.shot.revision + 1
        settings = job.settings
        self._job, self.seconds, self._warm, self._failed = job, 0.0, self._warm and moved, False
        self.shot = Shot(revision, settings.width, settings.height, settings.spp, moves=dict(moves))
        self._steps = self._previews(job)

    def extend(self, job: RenderJob, moves: Mapping[int, int | str | None]) -> None:
        """Go on with the same image, of which more or fewer samples are wanted."""
        shot = self.shot
        taken = 0 if shot is None or shot.film is None else int(shot.film.ledger.taken().max(initial=0))
        if shot is None or job.settings.spp < taken:
            self.restart(job, moves, moved=True)
            return
        self._job, self._failed = job, False
        shot.moves, shot.spp, shot.sha256, shot.still = dict(moves), job.settings.spp, None, False
        self._publish(shot)

    def step(self, should_stop: Callable[[], bool]) -> bool:
        """Do what comes next, or as much of it as there is time for; gives whether there was something to do.

        Raises
        ------
        ClrenderError
            As of `Session.render`. The image keeps what was finished.
        """
        job, shot = self._job, self.shot
        if job is None or shot is None or self._failed:
            return False
        if self._steps:
            self._preview(job, shot, self._steps[0], should_stop)
            return True
        if missing := [name for name in sorted(self.wanted) if not shot.is_whole(name)]:
            self._layers(job, shot, missing, should_stop)
            return True
        if not self.running or shot.sha256 is not None:
            if not shot.still:
                shot.still = True
                self._changed()
            return False
        shot.still = False
        self._refine(job, shot, should_stop)
        return True

    def give_up(self) -> None:
        """The image cannot be rendered: leave it as it is."""
        self._failed = True
        if self.shot is not None:
            self.shot.still = True
            self._publish(self.shot)

    def developed(self) -> RenderedImage | None:
        """The image so far with its numbers, if there is a sample. Its film is the one that is rendered on."""
        job, shot = self._job, self.shot
        if job is None or shot is None or shot.film is None or not shot.film.ledger.samples:
            return None
        return self._session.develop(job, shot.film)

    def copied(self) -> RenderedImage | None:
        """The same with a film of its own, for other threads: it stays as its numbers say while the render goes on."""
        image = self.developed()
        if image is None:
            return None
        film = RunningFilm(image.film.width, image.film.height, image.film.request)
        image.film.copy_to(film)
        return dataclasses.replace(image, film=film)

    def probed(self, x: int, y: int) -> dict[str, Any]:
        """What the pixel's first sample sees: numbers of `PROBED`, each an array."""
        job, shot = self._job, self.shot
        if job is None or shot is None or self._failed:
            return {}
        if self._probed[0] != shot.revision:
            step = max(1, round((shot.width * shot.height / _PROBE_PIXELS) ** 0.5))
            self._probed = shot.revision, step, self._session.layers(_smaller(job, step, 1, PROBED))
        _, step, layers = self._probed
        height, width = layers["depth"].shape[:2]
        row, column = min(y // step, height - 1), min(x // step, width - 1)
        return {name: layer[row, column] for name, layer in layers.items()}

    def error(self) -> float | None:
        """The error of the image as `clrender.film.replicates.relative_error` has it, worked out now and then only."""
        shot, film = self.shot, None if self.shot is None else self.shot.film
        if shot is None or film is None:
            return None
        now = time.monotonic()
        if self._error[0] != shot.revision or shot.still or now >= self._error[1]:
            error = relative_error(film)
            self._error = shot.revision, now + max(1.0, 20.0 * (time.monotonic() - now)), error
        return self._error[2]

    def _previews(self, job: RenderJob) -> list[int]:
        """Sides of the squares of pixels that are one in the pictures to come."""
        if job.integrator.preparation and not job.integrator.pipeline.sample_by_sample:
            return []  # what it prepares takes longer than all samples of a pixel
        pixels = job.settings.width * job.settings.height
        step = 1
        while step < _COARSEST and pixels / step**2 > self._rate * _PREVIEW_SECONDS:
            step *= 2
        steps = [step, step // 2] if step > 2 else [step]
        if self.running:
            return [each for each in steps if each > 1]
        return [*steps, 1] if steps[-1] > 1 else steps

    def _preview(self, job: RenderJob, shot: Shot, step: int, should_stop: Callable[[], bool]) -> None:
        """A picture of fewer pixels. The first is made whatever comes, so that a moving camera shows something."""
        first = shot.preview is None
        begin = time.perf_counter()
        stopped = _Asked(should_stop)
        small = _smaller(job, step, 1)
        film = self._session.refine(small, should_stop=None if first else stopped)
        if self.wanted and not stopped.yes:
            layers = self._session.layers(_smaller(job, step, 1, tuple(sorted(self.wanted))))
            shot.layers |= {name: layer for name, layer in layers.items() if not shot.is_whole(name)}
        seconds = time.perf_counter() - begin
        if stopped.yes:
            return
        self._steps.pop(0)
        shot.preview = film.mean()
        self._publish(shot)
        pixels = small.settings.width * small.settings.height
        if self._warm and pixels >= 4096:
            self._rate = pixels / seconds
        self._warm = True

    def _layers(self, job: RenderJob, shot: Shot, names: list[str], should_stop: Callable[[], bool]) -> None:
        stopped = _Asked(should_stop)
        layers = self._session.layers(_smaller(job, 1, _LAYER_SAMPLES, tuple(names)), stopped)
        if not stopped.yes:
            shot.layers |= layers
            self._publish(shot)

    def _refine(self, job: RenderJob, shot: Shot, should_stop: Callable[[], bool]) -> None:
        """Take samples until somebody wants something else, or all are there."""
        before, seen = self.seconds, 0

        def advance(progress: Progress) -> None:
            nonlocal seen
            shot.film = progress.film  # type: ignore[assignment]  # of `Session.refine` it is a `RunningFilm`
            self.seconds = before + progress.seconds
            if shot.film is not None and shot.film.changes != seen:
                seen = shot.film.changes
                self._publish(shot)
            self._advanced(progress)

        stopped = _Asked(should_stop)
        film = self._session.refine(job, shot.film, on_progress=advance, should_stop=stopped)
        if film.changes:
            shot.film = film
        if not stopped.yes and (job.settings.error is not None or film.ledger.holds(0, job.settings.spp)):
            shot.sha256, shot.still = image_sha256(film.mean()), True
        self._publish(shot)

    def _publish(self, shot: Shot) -> None:
        """Say that there is something new to see, when all of it is in place.

        A frame with this number is kept, and shown, until there is a higher one: it must hold all that is new.
        """
        shot.changes += 1
        self._changed()


class _Asked:
    """A question whether to stop that remembers a yes."""

    def __init__(self, ask: Callable[[], bool]) -> None:
        self._ask = ask
        self.yes = False

    def __call__(self) -> bool:
        self.yes = self.yes or self._ask()
        return self.yes


def _smaller(job: RenderJob, step: int, spp: int, aov: tuple[str, ...] = ()) -> RenderJob:
    """The same job with fewer pixels and so many samples of each, and without errors."""
    settings = job.settings
    plain = dataclasses.replace(
        settings,
        width=-(-settings.width // step),
        height=-(-settings.height // step),
        spp=spp,
        replicate_spp=None,
        error=None,
    )
    return dataclasses.replace(job, settings=plain, first_sample=0, sample_count=spp, aov=aov, denoise=False)
