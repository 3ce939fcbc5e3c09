"""What viewers are told of the render: its state, its problems, its progress, and that there is a new frame."""

from __future__ import annotations

import math
import threading
import time
from typing import TYPE_CHECKING, Any, Final

from clrender.errors import ClrenderError
from clrender.view import tables

if TYPE_CHECKING:
    from clrender.rendering.rendered_image import Progress
    from clrender.view.broadcaster import Broadcaster
    from clrender.view.edited_scene import EditedScene
    from clrender.view.history import History
    from clrender.view.progressive import Progressive

__all__ = ["Problems", "StatusReporter", "sentence"]

_PROGRESS_SECONDS: Final = 0.25
_FRAME_SECONDS: Final = 0.1
"""After so long viewers ask for a frame again: one may have waited until it was time for it."""


class Problems:
    """What is wrong with the scene file, the device or the render; one message for each."""

    def __init__(self) -> None:
        self._messages: dict[str, str] = {}  # the newest is first

    def add(self, where: str, message: str) -> None:
        """Replace the problem of ``scene``, ``device`` or ``render``."""
        self._messages = {where: message} | {key: text for key, text in self._messages.items() if key != where}

    def clear(self, *where: str) -> None:
        """Forget the problems of these, or all."""
        for each in where or tuple(self._messages):
            self._messages.pop(each, None)

    @property
    def newest(self) -> dict[str, str] | None:
        """The newest one as it is sent: ``where`` and ``message``."""
        return next(({"where": where, "message": text} for where, text in self._messages.items()), None)

    @property
    def failed(self) -> bool:
        """Whether the image cannot be rendered. A broken scene file is no such problem: the last image goes on."""
        return "render" in self._messages or "device" in self._messages


class StatusReporter:
    """Broadcasts how the render stands. The render thread alone calls it.

    Parameters
    ----------
    broadcaster : Broadcaster

    Attributes
    ----------
    first_frame : threading.Event
        Set when there is something to show for the first time.
    """

    def __init__(self, broadcaster: Broadcaster) -> None:
        self.first_frame = threading.Event()
        self._broadcaster = broadcaster
        self._frame_time = self._progress_time = 0.0

    def frame_available(self) -> None:
        """The image has changed."""
        self._frame_time = time.monotonic()
        self.first_frame.set()
        self._broadcaster.frame_available()

    def launch_done(self, progressive: Progressive, progress: Progress) -> bool:
        """A launch has ended; returns whether it was time to send progress."""
        now = time.monotonic()
        if now - self._frame_time > _FRAME_SECONDS:
            self.frame_available()
        if now - self._progress_time <= _PROGRESS_SECONDS:
            return False
        self._progress_time = now
        self.send_progress(progressive, progress)
        return True

    def send_progress(self, progressive: Progressive, progress: Progress | None) -> None:
        """Send the progress of a render under way, or (None) of one that is done."""
        state = progressive.image_state
        if state is None:
            return
        running = progress is not None and progress.seconds > 0.0
        content = {
            "revision": state.revision,
            "samples": round(state.samples, 3),
            "spp": state.spp,
            "seconds": round(progressive.seconds, 3),
            "samples_per_second": progress.samples_per_second if progress and running else 0.0,
            "rays_per_second": progress.rays / progress.seconds if progress and running else 0.0,
            "seconds_left": progress.seconds_left if progress and math.isfinite(progress.seconds_left) else None,
            "error": progressive.error(),
            "sha256": state.sha256,
        }
        self._broadcaster.send("progress", content)

    def send_state(
        self, edited: EditedScene, history: History, progressive: Progressive, device: str, problems: Problems
    ) -> None:
        """Send the state where it has changed; before the state ``done`` comes the final progress."""
        state = progressive.image_state
        status = _status(progressive, problems)
        content: dict[str, Any] = {
            "revision": 0 if state is None else state.revision,
            "status": status,
            "device": device,
            "viewers": len(self._broadcaster),
            "problem": problems.newest,
            "is_black": state is not None and state.is_black,
            "undo": history.undo_label,
            "redo": history.redo_label,
            **tables.state(edited),
        }
        # Whoever is told that it is done, or shown the final frame, knows the numbers of the end.
        if status == "done" and self._broadcaster.is_news("state", content):
            self.send_progress(progressive, None)
        self._broadcaster.send_if_changed("state", content)


def _status(progressive: Progressive, problems: Problems) -> str:
    state = progressive.image_state
    if problems.failed:
        return "failed"
    if state is None or (state.preview is None and state.film is None):
        return "starting"
    if state.sha256 is not None:
        return "done"
    return "rendering" if progressive.running else "stopped"


def sentence(error: Exception) -> str:
    """An exception in words that a viewer can be shown."""
    return str(error) if isinstance(error, ClrenderError) else f"{type(error).__name__}: {error}"[:500]
