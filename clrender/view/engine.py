"""The live view without any transport: messages of viewers in, state and frames out, one thread that renders."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any, Final, Protocol

from clrender.errors import ClrenderError, DeviceError, UsageError
from clrender.rendered_image import Progress, RenderedImage
from clrender.scene import Scene
from clrender.session import Session
from clrender.view import messages, tables
from clrender.view.audience import Audience
from clrender.view.frames import Frames, Shot
from clrender.view.inbox import Inbox
from clrender.view.probe import probe
from clrender.view.progressive import Progressive
from clrender.view.subject import Subject
from clrender.view.viewer import Viewer
from clrender.view.watch import Watcher

__all__ = ["Engine", "Source"]

_PROGRESS_SECONDS: Final = 0.25
_LOOK_SECONDS: Final = 0.1
"""After so long, whoever looks on is told to look again: a frame may have waited for its time."""
_PATIENCE: Final = 5.0
"""Seconds to wait at the end for a device that does not come back."""


class Source(Protocol):
    """Where a scene comes from, which may change."""

    def read(self) -> Scene:
        """The scene as it is now; raises `ClrenderError`."""

    def files(self, scene: Scene) -> Sequence[Path]:
        """What it was read from."""


class Engine:
    """Renders a scene for all who look on. A context manager: at its end all is released.

    Parameters
    ----------
    scene : Scene
    device
        As of `Session`.
    source : Source, optional
        To read the scene anew from when its files change.
    outputs : sequence of path
        Files that a viewer may have written; no others are.
    **settings
        Fields of `RenderSettings`.

    Raises
    ------
    UsageError, SceneError
        The scene cannot be rendered with these settings.
    DeviceError
        No device works.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        device: Any = None,
        source: Source | None = None,
        outputs: Sequence[str | Path] = (),
        **settings: Any,
    ) -> None:
        self.frames = Frames()
        self._audience = Audience()
        self._subject = Subject.of(scene, settings)
        self._outputs = {str(path): Path(path) for path in outputs}
        self._inbox = Inbox()
        self._parting = False
        self._problems: dict[str, str] = {}
        self._told = self._looked = 0.0
        self._seen = threading.Event()
        session, self._device = self._opened(device)
        self._progressive = Progressive(session, self._changed, self._advanced)
        self._progressive.restart(self._subject.job, {})
        self._audience.remember("hello", tables.hello([], list(self._outputs)))
        self._audience.tell("scene", tables.scene(self._subject))
        self._tell_state()
        self._thread = threading.Thread(target=self._live, name="clrender view", daemon=True)
        self._thread.start()
        threading.Thread(target=self._list_devices, daemon=True).start()
        self._source = source
        self._watcher = None if source is None else Watcher(self._files, self._reread)

    def __enter__(self) -> Engine:
        return self

    def __exit__(self, *details: Any) -> None:
        self.close()

    def say_goodbye(self, reason: str = "the view has ended") -> None:
        """Tell viewers that it ends, which `close` does."""
        if not self._parting:
            self._parting = True
            self._audience.say_goodbye(reason)

    @property
    def told(self) -> bool:
        """Whether all viewers have taken what they are told."""
        return self._audience.told

    def close(self, reason: str = "the view has ended") -> None:
        """End: viewers are told, what is on the devices is released."""
        self.say_goodbye(reason)
        if self._watcher is not None:
            self._watcher.close()
        self._inbox.close()
        self._seen.set()
        self._thread.join(_PATIENCE)
        self._audience.end(reason)
        self.frames.release()

    @property
    def ended(self) -> bool:
        """Whether nothing is rendered any more."""
        return self._inbox.closed

    @property
    def shot(self) -> Shot | None:
        """What there is to see."""
        return self._progressive.shot

    @property
    def subject(self) -> Subject:
        """What is looked at."""
        return self._subject

    @property
    def problem(self) -> str | None:
        """Why there is no image, or none of the scene as it is now."""
        return (*self._problems.values(), None)[0]

    def connect(self, wake: Callable[[], None]) -> Viewer:
        """Somebody more looks on.

        Parameters
        ----------
        wake : callable
            Called, in any thread, when there may be something for `Viewer.take`.

        Raises
        ------
        UsageError
            There are as many as there may be.
        """
        viewer = self._audience.join(self, wake)
        self.nudge()
        return viewer

    def disconnect(self, viewer: Viewer) -> None:
        """Somebody looks on no more."""
        self._audience.leave(viewer)

    def post(self, viewer: Viewer, message: messages.Message) -> None:
        """A viewer's message for the thread that renders; raises `UsageError` where too many wait."""
        self._inbox.post(viewer, message)

    def nudge(self) -> None:
        """Have the thread that renders look what is wanted now."""
        self._inbox.nudge()

    def image(self) -> Future[RenderedImage | None]:
        """The image so far, with its numbers; None: there is no sample yet. Later samples leave it as it is."""
        return self._inbox.call(self._progressive.copied)

    # --- the thread that renders ---

    def _live(self) -> None:
        try:
            while not self._inbox.closed:
                self._inbox.follow(self._answer)
                busy = self._step()
                self._tell_state()
                if not busy:
                    self._inbox.wait()
        except Exception as error:  # nobody else would hear of it
            self._problems["render"] = _words(error)
            self.say_goodbye(_words(error))
            raise
        finally:
            self._inbox.refuse_all()
            self._progressive.session.close()

    @property
    def _failed(self) -> bool:
        """Whether the image could not be rendered; a scene file with an error leaves the last image as it is."""
        return "render" in self._problems or "device" in self._problems

    def _step(self) -> bool:
        """Render a little; gives whether there was something to do."""
        self._progressive.wanted = self._audience.first_hits
        try:
            busy = self._progressive.step(lambda: self._inbox.urgent)
        except Exception as error:  # whatever it is, no page may end the view
            self._problems["device" if isinstance(error, DeviceError) else "render"] = _words(error)
            self._progressive.give_up()
            return False
        if busy:
            self._problems.pop("render", None)
            self._problems.pop("device", None)
        return busy

    def _answer(self, viewer: Viewer, message: messages.Message) -> None:
        try:
            self._follow(viewer, message)
        except Exception as error:  # whatever it is, no page may end the view
            viewer.refuse(message, _words(error))

    def _follow(self, viewer: Viewer, message: messages.Message) -> None:
        subject = self._subject
        match message:
            case messages.MoveCamera():
                moved = subject.moved(message.camera)
                viewer.camera_id = message.id
                self._look_at(moved, moved=True)
            case messages.SetSettings():
                self._look_at(subject.set(message.settings))
            case messages.SetMaterial():
                self._look_at(subject.with_material(message.name, message.values))
            case messages.Reset():
                self._look_at(subject.reset(message.what))
            case messages.DeviceChoice():
                session, self._device = self._opened(message.device)
                self._progressive.use(session)
                self._progressive.restart(subject.job, self._audience.camera_ids)
            case messages.Run():
                self._progressive.running = message.run
            case messages.Restart():
                self._progressive.restart(subject.job, self._audience.camera_ids, moved=True)
            case messages.Probe():
                viewer.reply("probe", message, probe(self._progressive, subject, message.x, message.y))
            case messages.Save():
                viewer.reply("saved", message, self._saved(message))

    def _look_at(self, subject: Subject, *, moved: bool = False) -> None:
        before, self._subject = self._subject, subject
        if subject.restarts(before) or self._failed:
            self._progressive.restart(subject.job, self._audience.camera_ids, moved=moved)
        else:
            self._progressive.extend(subject.job, self._audience.camera_ids)
        if subject.checked.scene is not before.checked.scene:
            self._audience.tell("scene", tables.scene(subject), again=False)

    def _opened(self, device: Any) -> tuple[Session, str]:
        """A session whose devices are open, and their names."""
        session = Session(device, notify=self._audience.notice)
        try:
            return session, ", ".join(each.info.title for each in session.devices)
        except BaseException:
            session.close()
            raise

    def _saved(self, message: messages.Save) -> dict[str, Any]:
        path = self._outputs.get(message.name)
        if path is None:
            known = ", ".join(self._outputs) or "none: name some with -o on the command line"
            raise UsageError(f"{message.name[:80]!r} is no file of the command line; there is {known}")
        image = self._progressive.developed()
        if image is None:
            raise UsageError("there is no sample yet, and so nothing to save")
        image.save(path, message.tone_map, message.exposure)
        return {"name": message.name, "bytes": path.stat().st_size}

    # --- what is told ---

    def _changed(self) -> None:
        self._looked = time.monotonic()
        self._seen.set()
        self._audience.see()

    def _advanced(self, progress: Progress) -> None:
        now = time.monotonic()
        if now - self._looked > _LOOK_SECONDS:
            self._changed()
        if now - self._told > _PROGRESS_SECONDS:
            self._told = now
            self._tell_progress(progress)
            self._tell_state()

    def _tell_progress(self, progress: Progress | None) -> None:
        """Of a render under way, or (None) that is done."""
        shot = self.shot
        if shot is None:
            return
        running = progress is not None and progress.seconds > 0.0
        content = {
            "revision": shot.revision,
            "samples": round(shot.samples, 3),
            "spp": shot.spp,
            "seconds": round(self._progressive.seconds, 3),
            "samples_per_second": progress.samples_per_second if progress and running else 0.0,
            "rays_per_second": progress.rays / progress.seconds if progress and running else 0.0,
            "seconds_left": progress.seconds_left if progress and math.isfinite(progress.seconds_left) else None,
            "error": self._progressive.error(),
            "sha256": shot.sha256,
        }
        self._audience.tell("progress", content)

    def _tell_state(self) -> None:
        """Send the state where something of it is another."""
        shot = self.shot
        if self._failed:
            status = "failed"
        elif shot is None or (shot.preview is None and shot.film is None):
            status = "starting"
        elif shot.sha256 is not None:
            status = "done"
        else:
            status = "rendering" if self._progressive.running else "stopped"
        content = {
            "revision": 0 if shot is None else shot.revision,
            "status": status,
            "device": self._device,
            "viewers": len(self._audience),
            "problem": next(({"where": where, "message": text} for where, text in self._problems.items()), None),
            **tables.state(self._subject),
        }
        if self._audience.tell("state", content, again=False) and status == "done":
            self._tell_progress(None)

    # --- other threads ---

    def _files(self) -> Sequence[Path]:
        return self._source.files(self._subject.scene) if self._source is not None else ()

    def _reread(self) -> None:
        """The scene's files have changed."""
        assert self._source is not None
        try:
            scene = self._source.read()
        except Exception as error:  # a scene that cannot be read, in whatever way, is told
            words = _words(error)
            self._inbox.call(lambda: self._broken(words))
        else:
            self._inbox.call(lambda: self._show(scene))

    def _broken(self, message: str) -> None:
        self._problems = {"scene": message} | {where: it for where, it in self._problems.items() if where != "scene"}

    def _show(self, scene: Scene) -> None:
        try:
            subject = self._subject.reread(scene)
            described = tables.scene(subject)
        except Exception as error:  # a scene that cannot be shown, in whatever way, is told
            self._broken(_words(error))
            return
        self._problems.clear()
        self._subject = subject
        self._progressive.restart(subject.job, self._audience.camera_ids)
        self._audience.tell("scene", described)

    def _list_devices(self) -> None:
        self._seen.wait()  # it takes as long as a first picture, which comes first
        if self._inbox.closed:
            return
        devices = tables.devices()
        self._audience.remember("hello", tables.hello(devices, list(self._outputs)))
        self._audience.tell("devices", {"devices": devices})


def _words(error: Exception) -> str:
    return str(error) if isinstance(error, ClrenderError) else f"{type(error).__name__}: {error}"[:500]
