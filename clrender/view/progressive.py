"""Progressive rendering: coarse previews first, then sample by sample; one job after the other, on one session."""

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
from clrender.rendering.session import Session
from clrender.view.frames import shown_image
from clrender.view.image_state import ImageState, Pixels
from clrender.view.outline import outline

if TYPE_CHECKING:
    from clrender.rendering.job import RenderJob
    from clrender.rendering.rendered_image import Progress, RenderedImage

__all__ = ["PROBED", "Progressive"]

_PREVIEW_SECONDS: Final = 0.06
"""What the first preview may take, so that with all around it, it is shown within a tenth of a second."""
_COARSEST: Final = 32
"""Side of the square of pixels that are one pixel of a preview, at most."""
_FIRST_RATE: Final = 3e5
"""Pixels a second of a preview, before it is measured."""
_LAYER_SAMPLES: Final = 4
"""Samples per pixel of first-hit layers."""
_SHOWN_ALPHA_SAMPLES: Final = 16
_ALPHA_SAMPLES: Final = 64
"""Of alpha that is shown, and that is saved. The image waits meanwhile, and 64 are nearly as fine as eight bits."""
_PROBE_PIXELS: Final = 1 << 20
"""Pixels of the layers that the probe reads, at most."""
_CLOUD_SIDE: Final = 192
"""Longer side of the grid of points of a sketch of the scene."""
PROBED: Final = ("object", "material", "depth", "position", "normal")


class Progressive:
    """Renders a job step by step until all samples are taken. The render thread alone calls it.

    Parameters
    ----------
    session : Session
    changed : callable
        Called whenever the image state has changed.
    advanced : callable
        Called with the progress after each launch.

    Attributes
    ----------
    image_state : ImageState or None
        Of the image that is rendered; another object for each image.
    displayed : ImageState or None
        The newest image that has pixels: while the camera moves, an image is replaced before anybody has seen it.
    running : bool
        Whether samples are taken beyond the preview.
    wanted : set of str
        First-hit layers that viewers show.
    """

    def __init__(self, session: Session, changed: Callable[[], None], advanced: Callable[[Progress], None]) -> None:
        self.image_state: ImageState | None = None
        self.displayed: ImageState | None = None
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

    def use(self, session: Session) -> Session:
        """Render with another session from now on, and return the one before; `restart` has to follow."""
        before, self._session = self._session, session
        self._rate, self._warm = _FIRST_RATE, False
        return before

    def restart(self, job: RenderJob, camera_ids: Mapping[int, int | str | None], *, only_camera: bool = False) -> None:
        """Begin another image.

        Parameters
        ----------
        job : RenderJob
        camera_ids : mapping
            As of `ImageState.camera_ids`.
        only_camera : bool
            Whether only the camera is another: what is known of the speed holds.
        """
        revision = 1 if self.image_state is None else self.image_state.revision + 1
        settings = job.settings
        self._job, self.seconds, self._warm, self._failed = job, 0.0, self._warm and only_camera, False
        self.image_state = ImageState(
            revision,
            *settings.film_size,
            settings.spp,
            camera_ids=dict(camera_ids),
            is_black=self.image_state is not None and self.image_state.is_black,
        )
        self._steps = self._previews(job)

    def extend(self, job: RenderJob, camera_ids: Mapping[int, int | str | None]) -> None:
        """Go on with the same image, of which more or fewer samples are wanted."""
        state = self.image_state
        taken = 0 if state is None or state.film is None else int(state.film.ledger.taken().max(initial=0))
        if state is None or job.settings.spp < taken:
            self.restart(job, camera_ids, only_camera=True)
            return
        self._job, self._failed = job, False
        state.camera_ids, state.spp, state.sha256, state.idle = dict(camera_ids), job.settings.spp, None, False
        self._publish(state)

    def step(self, should_stop: Callable[[], bool]) -> bool:
        """Do the next piece of work, until it is done or to stop; returns whether there was any.

        Raises
        ------
        ClrenderError
            As of `Session.render`. The image keeps what was finished.
        """
        job, state = self._job, self.image_state
        if job is None or state is None or self._failed:
            return False
        if self._steps:
            self._preview(job, state, self._steps[0], should_stop)
            return True
        if missing := [name for name in sorted(self.wanted) if not state.is_whole(name)]:
            self._layers(job, state, missing, should_stop)
            return True
        if not self.running or state.sha256 is not None:
            if not state.idle:
                state.idle = True
                self._changed()
            return False
        state.idle = False
        self._refine(job, state, should_stop)
        return True

    def give_up(self) -> None:
        """Stop after a failure; the image stays as it is until the next `restart`."""
        self._failed = True
        if self.image_state is not None:
            self.image_state.idle = True
            self._publish(self.image_state)

    def developed(self, alpha: bool = False) -> RenderedImage | None:
        """The image so far with its numbers, if there is a sample. It shares the film to which samples are added.

        Parameters
        ----------
        alpha : bool
            Whether with the layer ``alpha``, of as many samples, but at most `_ALPHA_SAMPLES`.
        """
        job, state = self._job, self.image_state
        if job is None or state is None or state.film is None or not state.film.ledger.samples:
            return None
        image = self._session.develop(job, state.film)
        if alpha:
            samples = min(max(int(state.film.ledger.taken().max(initial=1)), 1), _ALPHA_SAMPLES)
            layers = self._session.layers(_smaller(job, 1, samples, ("alpha",)))
            image.aovs |= _cropped(job, 1, layers)
            image.stats["alpha_samples"] = samples
        return image

    def copied(self, alpha: bool = False) -> RenderedImage | None:
        """The same with a copy of the film, for other threads: later samples do not change it."""
        image = self.developed(alpha)
        if image is None:
            return None
        film = RunningFilm(image.film.width, image.film.height, image.film.request)
        image.film.copy_to(film)
        return dataclasses.replace(image, film=film)

    def probed(self, x: int, y: int) -> dict[str, Any]:
        """What the pixel's first sample sees: numbers of `PROBED`, each an array."""
        job, state = self._job, self.image_state
        if job is None or state is None or self._failed:
            return {}
        if self._probed[0] != state.revision:
            step = max(1, round((state.width * state.height / _PROBE_PIXELS) ** 0.5))
            layers = self._session.layers(_smaller(job, step, 1, PROBED))
            self._probed = state.revision, step, _cropped(job, step, layers)
        _, step, layers = self._probed
        height, width = layers["depth"].shape[:2]
        row, column = min(y // step, height - 1), min(x // step, width - 1)
        return {name: layer[row, column] for name, layer in layers.items()}

    def samples_of(self, x: int, y: int) -> int:
        """Samples that a pixel of the image has so far; 0 where there is none."""
        state = self.image_state
        if state is None or state.film is None or x >= state.width or y >= state.height:
            return 0
        return int(state.film.counts[y, x])

    def cloud(self) -> tuple[Pixels, Pixels, int] | None:
        """Points that the camera sees, their radiance, and the rows of the grid of pixels that they are of."""
        self.probed(0, 0)
        state, layers = self.image_state, self._probed[2]
        if state is None or not layers or self._probed[0] != state.revision:
            return None
        pixels, _ = shown_image(state, -(-max(state.width, state.height) // _CLOUD_SIDE))
        step = -(-max(layers["position"].shape[:2]) // _CLOUD_SIDE)
        points = layers["position"][::step, ::step]
        (height, width), hit = points.shape[:2], np.isfinite(points).all(axis=2)
        if pixels is None:
            return points[hit], np.ones_like(points[hit]), height
        rows, columns = (
            np.minimum(((np.arange(side) + 0.5) * whole / side).astype(int), whole - 1)
            for side, whole in zip((height, width), pixels.shape[:2], strict=True)
        )
        return points[hit], pixels[rows][:, columns][hit], height

    def outline(self, number: int) -> tuple[int, int, str]:
        """Where an object is seen, as of `clrender.view.outline.outline`."""
        self.probed(0, 0)  # which renders the layers, unless those of this image are there
        layers = self._probed[2]
        return outline(layers["object"][..., 0] == number) if layers else (1, 1, "")

    def error(self) -> float | None:
        """The error of the image as `clrender.film.replicates.relative_error` has it, worked out now and then only."""
        state, film = self.image_state, None if self.image_state is None else self.image_state.film
        if state is None or film is None:
            return None
        now = time.monotonic()
        if self._error[0] != state.revision or state.idle or now >= self._error[1]:
            error = relative_error(film)
            self._error = state.revision, now + max(1.0, 20.0 * (time.monotonic() - now)), error
        return self._error[2]

    def _previews(self, job: RenderJob) -> list[int]:
        """Sides, in pixels, of the squares that are one pixel of the previews to come."""
        if job.preparation and not job.integrator.pipeline.sample_by_sample:
            return []  # what it prepares takes longer than all samples of a pixel
        pixels = job.settings.width * job.settings.height
        step = 1
        while step < _COARSEST and pixels / step**2 > self._rate * _PREVIEW_SECONDS:
            step *= 2
        steps = [step, step // 2] if step > 2 else [step]
        if self.running:
            return [each for each in steps if each > 1]
        return [*steps, 1] if steps[-1] > 1 else steps

    def _preview(self, job: RenderJob, state: ImageState, step: int, should_stop: Callable[[], bool]) -> None:
        """Render a preview. The first of an image is not stopped, so that a moving camera shows something."""
        first = state.preview is None
        begin = time.perf_counter()
        stopped = _StopRequest(should_stop)
        small = _smaller(job, step, 1)
        film = self._session.refine(small, should_stop=None if first else stopped)
        if self.wanted and not stopped.yes:
            layers = self._session.layers(_smaller(job, step, 1, tuple(sorted(self.wanted))))
            layers = _cropped(job, step, layers)
            state.layers |= {name: layer for name, layer in layers.items() if not state.is_whole(name)}
        seconds = time.perf_counter() - begin
        if stopped.yes:
            return
        self._steps.pop(0)
        state.preview = _cropped(job, step, {"image": film.mean()})["image"]
        state.is_black = not state.preview.any()
        self._publish(state)
        pixels = small.settings.width * small.settings.height
        if self._warm and pixels >= 4096:
            self._rate = pixels / seconds
        self._warm = True

    def _layers(self, job: RenderJob, state: ImageState, names: list[str], should_stop: Callable[[], bool]) -> None:
        stopped = _StopRequest(should_stop)
        # Edges of alpha are seen, where those of other layers are not
        names = [name for name in names if name != "alpha"] or names
        samples = _SHOWN_ALPHA_SAMPLES if names == ["alpha"] else _LAYER_SAMPLES
        layers = self._session.layers(_smaller(job, 1, samples, tuple(names)), stopped)
        if not stopped.yes:
            state.layers |= _cropped(job, 1, layers)
            self._publish(state)

    def _refine(self, job: RenderJob, state: ImageState, should_stop: Callable[[], bool]) -> None:
        """Take samples until all are taken, or it is to stop."""
        before, seen = self.seconds, 0

        def advance(progress: Progress) -> None:
            nonlocal seen
            state.film = progress.film  # type: ignore[assignment]  # of `Session.refine` it is a `RunningFilm`
            self.seconds = before + progress.seconds
            if state.film is not None and state.film.changes != seen:
                seen = state.film.changes
                state.is_black = state.is_black and not state.film.mean().any()
                self._publish(state)
            self._advanced(progress)

        stopped = _StopRequest(should_stop)
        film = self._session.refine(job, state.film, on_progress=advance, should_stop=stopped)
        if film.changes:
            state.film = film
            state.is_black = (state.is_black or state.preview is None) and not film.mean().any()
        if not stopped.yes and (job.settings.error is not None or film.ledger.holds(0, job.settings.spp)):
            state.sha256, state.idle = image_sha256(film.mean()), True
        self._publish(state)

    def _publish(self, state: ImageState) -> None:
        """Publish the image state, after all its fields are set.

        A frame is cached under the number of changes until there is a higher one, so it must hold all that is new.
        """
        state.changes += 1
        if state.preview is not None or state.film is not None:
            self.displayed = state
        self._changed()


class _StopRequest:
    """Asks whether to stop, and remembers a yes."""

    def __init__(self, ask: Callable[[], bool]) -> None:
        self._ask = ask
        self.yes = False

    def __call__(self) -> bool:
        self.yes = self.yes or self._ask()
        return self.yes


def _smaller(job: RenderJob, step: int, spp: int, aov: tuple[str, ...] = ()) -> RenderJob:
    """The same job with fewer pixels and so many samples of each, of the whole image, and without errors."""
    settings = job.settings
    plain = dataclasses.replace(
        settings,
        width=-(-settings.width // step),
        height=-(-settings.height // step),
        crop=None,  # whose edges need not lie between these pixels
        spp=spp,
        replicate_spp=None,
        error=None,
    )
    return dataclasses.replace(job, settings=plain, first_sample=0, sample_count=spp, aov=aov, denoise=False)


def _cropped(job: RenderJob, step: int, layers: Mapping[str, Pixels]) -> dict[str, Pixels]:
    """The part of a job's crop in layers of the whole image, of which each pixel is a square of `step` pixels."""
    if job.settings.crop is None:
        return dict(layers)
    x, y, width, height = job.settings.crop
    rows, columns = (slice(low // step, -(-(low + size) // step)) for low, size in ((y, height), (x, width)))
    return {name: layer[rows, columns] for name, layer in layers.items()}
