"""Light paths of a pixel for viewers: traced in a thread and a session of their own, beside the render."""

from __future__ import annotations

import contextlib
import dataclasses
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from clrender.errors import SceneError, UsageError
from clrender.image.exposure import photographic_stops
from clrender.image.tone_map import to_display
from clrender.inspection.document import document
from clrender.inspection.page import sketched
from clrender.inspection.pipelines import check_integrator
from clrender.inspection.pixel_paths import check_pixel
from clrender.inspection.surroundings import pose_of
from clrender.inspection.tracing import paths_in
from clrender.process.driver_threads import driver_thread
from clrender.process.pooled_threads import PooledThread
from clrender.process.stages import STAGES
from clrender.rendering.session import Session
from clrender.view.priority import lower_priority
from clrender.view.status import sentence

if TYPE_CHECKING:
    from clrender.rendering.job import RenderJob
    from clrender.view.edited_scene import EditedScene
    from clrender.view.messages import Paths
    from clrender.view.progressive import Progressive
    from clrender.view.viewer import Viewer

__all__ = ["Tracer", "surroundings", "traced_job"]

_KEPT: Final = 64
"""Samples whose vertices a page is sent, those that contribute most: a few hundred kilobytes."""
_IDLE_SECONDS: Final = 120.0
"""After so long without a question the session is closed: it holds the scene on the device a second time."""


@dataclass(frozen=True)
class _Question:
    """A pixel that a viewer asks for, with the render that it is of."""

    viewer: Viewer
    message: Paths
    job: RenderJob
    pixel: tuple[int, int]
    device: int
    around: Mapping[str, Any]


def traced_job(job: RenderJob, pixel: tuple[int, int], samples: int) -> tuple[RenderJob, tuple[int, int]]:
    """The first samples of a job's pixel, as a render of the whole image, and the pixel in it.

    Parameters
    ----------
    job : RenderJob
    pixel : (int, int)
        Column and row in the image that is shown: the crop, where there is one.
    samples : int
        At most so many are taken. Where the image stops by its error, the caller limits them to those of the pixel.

    Raises
    ------
    UsageError
        There is no such pixel, or the integrator has no paths that can be shown, with the reason.
    """
    settings = job.settings
    check_integrator(settings.integrator)
    x, y = check_pixel(pixel, *settings.film_size)
    left, top = (0, 0) if settings.crop is None else settings.crop[:2]
    whole = dataclasses.replace(settings, crop=None, error=None)
    count = min(samples, settings.spp)
    first = dataclasses.replace(job, settings=whole, first_sample=0, sample_count=count, aov=(), denoise=False)
    return first, (left + x, top + y)


def surroundings(progressive: Progressive, edited: EditedScene) -> dict[str, Any]:
    """What a page shows around the light paths of a pixel, as JSON values: ``revision``, ``crop`` and ``around``.

    Parameters
    ----------
    progressive : Progressive
        Which does not render meanwhile.
    edited : EditedScene
    """
    state, camera, settings = progressive.image_state, edited.camera, edited.checked.settings
    cloud = progressive.cloud()
    points, linear, rows = cloud or (np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32), 1)
    colors = to_display(linear[None], "srgb", photographic_stops(**(camera.exposure or {})))[0]
    width, height = settings.film_size
    return {
        "revision": 0 if state is None else state.revision,
        "crop": list(settings.crop or (0, 0, width, height)),
        "around": sketched(points, colors, rows, pose_of(camera)),
    }


class Tracer:
    """Answers questions for the light paths of a pixel, one after the other.

    A session of its own on the same device leaves that of the render alone: the image goes on meanwhile, and a compiler
    that runs for the kernels of paths delays no frame. The newest question of a viewer replaces its earlier one.

    Parameters
    ----------
    background : bool
        As of `clrender.view.engine.Engine`.
    """

    def __init__(self, background: bool) -> None:
        self._background = background
        self._changed = threading.Condition()
        self._questions: dict[int, _Question] = {}  # by viewer, those that wait
        self._running: _Question | None = None
        self._unwanted = self._closed = False
        self._session: tuple[int, Session] | None = None
        self._thread: PooledThread | None = None

    def ask(
        self,
        viewer: Viewer,
        message: Paths,
        job: RenderJob,
        pixel: tuple[int, int],
        device: int,
        around: Mapping[str, Any],
    ) -> None:
        """Have the paths of a pixel traced; the reply is a message ``paths``, or ``refused``.

        Parameters
        ----------
        viewer : Viewer
        message : Paths
            Its question.
        job, pixel
            As of `traced_job`.
        device : int
            Index of the device.
        around : mapping
            JSON-able; sent with the reply.
        """
        with self._changed:
            self._drop(viewer, "another pixel was asked for")
            self._questions[viewer.number] = _Question(viewer, message, job, pixel, device, around)
            if self._thread is None and not self._closed:
                self._thread = driver_thread(self._loop, name="clrender view paths")
                self._thread.start()
            self._changed.notify_all()

    def stop(self, viewer: Viewer) -> None:
        """Answer a viewer's question no more."""
        with self._changed:
            self._drop(viewer, "stopped")

    def close(self, patience: float) -> None:
        """End the thread; waits for it, at most so many seconds."""
        with self._changed:
            self._closed = self._unwanted = True
            self._questions.clear()
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join(patience)

    def _drop(self, viewer: Viewer, why: str) -> None:
        waiting = self._questions.pop(viewer.number, None)
        if waiting is not None:
            viewer.refuse(waiting.message, why)
        if self._running is not None and self._running.viewer is viewer and not self._unwanted:
            self._unwanted = True
            viewer.refuse(self._running.message, why)  # now: a compiler that runs cannot be interrupted

    # --- the thread ---

    def _loop(self) -> None:
        if self._background:
            lower_priority()
        while (question := self._next()) is not None:
            try:
                kind, content = "paths", self._answer(question)
            except Exception as error:  # whatever it is, the next question is answered
                kind, content = "refused", {"to": "paths", "message": sentence(error)}
                if not (self._unwanted or isinstance(error, UsageError | SceneError)):
                    self._discard()  # its device may have failed
            with self._changed:
                wanted, self._running = not self._unwanted, None
            if wanted:
                question.viewer.reply(kind, question.message, content)
        self._discard()

    def _next(self) -> _Question | None:
        """The question that has waited longest; None: the view ends."""
        with self._changed:
            while not self._questions and not self._closed:
                if not self._changed.wait(_IDLE_SECONDS) and self._session is not None:
                    self._discard()
            if self._closed:
                return None
            number = next(iter(self._questions))
            self._running, self._unwanted = self._questions.pop(number), False
            return self._running

    def _answer(self, question: _Question) -> dict[str, Any]:
        self._tell("opening")
        session = self._opened(question.device)
        found = paths_in(session, question.job, question.pixel, _KEPT, should_stop=self._is_unwanted)
        parts = (found.about, found.pixel, found.radiance, found.nonfinite_samples, found.values, found.samples)
        paths = document(*parts, found.splats)
        return {"x": question.message.x, "y": question.message.y, "paths": paths, **question.around}

    def _is_unwanted(self) -> bool:
        return self._unwanted

    def _opened(self, device: int) -> Session:
        if self._session is not None and self._session[0] == device:
            return self._session[1]
        self._discard()
        self._session = device, Session(device, on_stage=self._tell)
        return self._session[1]

    def _discard(self) -> None:
        before, self._session = self._session, None
        if before is not None:
            with contextlib.suppress(Exception):  # of a device that failed
                before[1].close()

    def _tell(self, stage: str) -> None:
        """Tell the viewer what its question waits for."""
        question = self._running
        if question is not None and not self._unwanted:
            text = STAGES.get(stage, "")
            question.viewer.send("tracing", {"question": question.message.id, "stage": stage, "text": text})
