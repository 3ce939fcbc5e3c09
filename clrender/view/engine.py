"""The live view without any transport: messages of viewers in, state and frames out, one thread that renders."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from clrender.errors import DeviceError, UsageError
from clrender.image.tone_map import check_display
from clrender.process.driver_threads import driver_thread
from clrender.rendering.rendered_image import Progress, RenderedImage
from clrender.rendering.session import Session
from clrender.scene import Scene
from clrender.view import messages, tables
from clrender.view.broadcaster import Broadcaster
from clrender.view.edited_scene import EditedScene
from clrender.view.environments import environment_files
from clrender.view.frames import Frames
from clrender.view.history import History
from clrender.view.image_state import ImageState
from clrender.view.inbox import Inbox
from clrender.view.keep import table_text
from clrender.view.priority import lower_priority
from clrender.view.probe import probe
from clrender.view.progressive import Progressive
from clrender.view.status import Problems, StatusReporter, sentence
from clrender.view.viewer import Viewer
from clrender.view.watch import Source, Watcher
from clrender.wording import counted

if TYPE_CHECKING:
    from clrender.view.tracer import Tracer

__all__ = ["Engine"]

_MOST_PICKED: Final = 500
"""Materials and lights that are listed because they were picked or edited; the newest."""
_PATIENCE: Final = 5.0
"""Seconds to wait at the end for a device that does not come back."""
_MOST_TOLD: Final = 6
"""Edits that are named where a scene that was read anew has ended some."""


class Engine:
    """Renders a scene for all viewers. A context manager: at its end all is released.

    One thread renders. Between launches it takes messages and calls from the inbox. Public methods may be called in any
    thread.

    Parameters
    ----------
    scene : Scene
    device
        As of `Session`.
    source : Source, optional
        To read the scene anew from when its files change.
    reading : sequence of str
        Options of the command line that read the scene and that it does not know itself, such as ``--camera FILE``.
    outputs : sequence of path
        Files that a viewer may have written; no others are.
    tone_map : str
        How viewers show the image at first: one of `clrender.image.tone_map.TONE_MAPS`.
    exposure : float
        At first, stops, in addition to that of the camera; from -128 to 128.
    background : bool
        Whether to render at a low priority, so that a browser on the same machine stays responsive. The threads of a
        CPU driver keep it for as long as the process lives.
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
        reading: Sequence[str] = (),
        outputs: Sequence[str | Path] = (),
        tone_map: str = "srgb",
        exposure: float = 0.0,
        background: bool = False,
        **settings: Any,
    ) -> None:
        check_display(tone_map, exposure)
        self._look = {"tone_map": tone_map, "exposure": float(exposure)}
        self.frames = Frames()
        self._broadcaster = Broadcaster()
        self._status = StatusReporter(self._broadcaster)
        self._edited = EditedScene.of(scene, settings)
        self._history = History()
        self._reading = tuple(reading)
        self._picked: dict[str, None] = {}  # materials and places of lights, which pages go on to show
        self._outputs = {str(path): Path(path) for path in outputs}
        self._inbox = Inbox()
        self._problems = Problems()
        self._tracer: Tracer | None = None
        self._goodbye_sent = False
        self._background = background
        with ThreadPoolExecutor(1, initializer=lower_priority if background else None) as opener:
            session, self._device = opener.submit(self._opened, device).result()
        self._progressive = Progressive(session, self._status.frame_available, self._launch_done)
        self._progressive.restart(self._edited.job, {})
        self._broadcaster.retain("hello", tables.hello([], list(self._outputs), self._look))
        self._broadcaster.send("scene", tables.scene(self._edited))
        self._send_state()
        self._thread = driver_thread(self._render_loop, name="clrender view")
        self._thread.start()
        driver_thread(self._list_devices).start()
        self._watcher: Watcher | None = None
        if source is not None:
            self._watcher = Watcher(lambda: source.files(self._edited.scene), lambda: self._reread(source))

    def __enter__(self) -> Engine:
        return self

    def __exit__(self, *details: Any) -> None:
        self.close()

    def send_goodbye(self, reason: str = "the view has ended") -> None:
        """Tell viewers that the view ends, once; `close` does it too."""
        if not self._goodbye_sent:
            self._goodbye_sent = True
            self._broadcaster.send_goodbye(reason)

    @property
    def drained(self) -> bool:
        """Whether no viewer has a message left to take."""
        return self._broadcaster.drained

    def close(self, reason: str = "the view has ended") -> None:
        """End: viewers are told, what is on the devices is released."""
        self.send_goodbye(reason)
        if self._watcher is not None:
            self._watcher.close()
        self._inbox.close()
        self._status.first_frame.set()  # for the thread that waits for it
        if self._tracer is not None:
            self._tracer.close(_PATIENCE)
        self._thread.join(_PATIENCE)
        self._broadcaster.end(reason)
        self.frames.release()

    @property
    def ended(self) -> bool:
        """Whether nothing is rendered any more."""
        return self._inbox.closed

    @property
    def image_state(self) -> ImageState | None:
        """The image in progress, which the render thread fills in."""
        return self._progressive.image_state

    @property
    def displayed(self) -> ImageState | None:
        """The newest image that has pixels: the image in progress, or the one before it."""
        return self._progressive.displayed

    @property
    def superseded(self) -> bool:
        """Whether the displayed image is about to be replaced by another one, on which all time should be spent."""
        return self.displayed is not self.image_state or self._inbox.camera_waits

    @property
    def edited_scene(self) -> EditedScene:
        """The scene with the changes of viewers."""
        return self._edited

    @property
    def problem(self) -> str | None:
        """Why there is no image, or none of the scene as it is now."""
        return (self._problems.newest or {}).get("message")

    def connect(self, wake: Callable[[], None]) -> Viewer:
        """Add a viewer.

        Parameters
        ----------
        wake : callable
            Called, in any thread, when there may be something for `Viewer.take`.

        Raises
        ------
        UsageError
            There are as many as there may be.
        """
        viewer = self._broadcaster.connect(self, wake)
        self.wake_renderer()
        return viewer

    def disconnect(self, viewer: Viewer) -> None:
        """Remove a viewer."""
        self._stop_paths(viewer)
        self._broadcaster.disconnect(viewer)

    def post(self, viewer: Viewer, message: messages.Message) -> None:
        """Queue a viewer's message for the render thread; raises `UsageError` where too many wait."""
        self._inbox.post(viewer, message)

    def wake_renderer(self) -> None:
        """Have the render thread look which layers are wanted now."""
        self._inbox.wake()

    def image(self, alpha: bool = False) -> Future[RenderedImage | None]:
        """The image so far, with its numbers; None: there is no sample yet. Later samples leave it as it is.

        Parameters
        ----------
        alpha : bool
            Whether with the layer ``alpha``.
        """
        return self._inbox.call(partial(self._progressive.copied, alpha))

    def scene_to_keep(self) -> Future[EditedScene]:
        """The scene after all edits that have arrived so far."""
        return self._inbox.call(lambda: self._edited, after_messages=True)

    # --- the render thread ---

    def _render_loop(self) -> None:
        if self._background:
            lower_priority()
        try:
            while not self._inbox.closed:
                self._inbox.process(self._handle)
                busy = self._step()
                self._send_state()
                if not busy:
                    self._inbox.wait()
        except Exception as error:  # a bug: the thread ends, which viewers would not notice
            self._problems.add("render", sentence(error))
            self.send_goodbye(sentence(error))
            raise
        finally:
            self._inbox.refuse_all()
            self._discard(self._progressive.session)

    def _step(self) -> bool:
        """Render a little; returns whether there was something to do."""
        self._progressive.wanted = self._broadcaster.first_hit_layers
        try:
            busy = self._progressive.step(lambda: self._inbox.pending)
        except Exception as error:  # whatever it is, no page may end the view
            self._problems.add("device" if isinstance(error, DeviceError) else "render", sentence(error))
            self._progressive.give_up()
            return False
        if busy:
            self._problems.clear("render", "device")
        return busy

    def _handle(self, viewer: Viewer, message: messages.Message) -> None:
        try:
            self._follow(viewer, message)
        except Exception as error:  # whatever it is, no page may end the view
            viewer.refuse(message, sentence(error))

    def _follow(self, viewer: Viewer, message: messages.Message) -> None:
        """Do what a message asks for."""
        edited = self._edited
        match message:
            case messages.MoveCamera():
                moved = edited.moved(message.camera)
                viewer.camera_id = message.id
                self._render_edited(moved, "camera", (viewer.number, "camera", *sorted(message.camera)))
            case messages.SetSettings():
                names = sorted(message.settings)
                label = ", ".join(names).replace("_", " ")
                self._render_edited(edited.set(message.settings), label, (viewer.number, "settings", *names))
            case messages.SetMaterial():
                self._pick(message.name)
                names = sorted(message.values)
                label = f"{', '.join(names).replace('_', ' ')} of material {message.name}"
                changed = edited.with_material(message.name, message.values)
                self._render_edited(changed, label, (viewer.number, "material", message.name, *names))
            case messages.SetLight():
                self._pick(message.name)
                names = sorted(message.values)
                label = f"{', '.join(names).replace('_', ' ')} of {message.name}"
                changed = edited.with_light(message.name, message.values)
                self._render_edited(changed, label, (viewer.number, "light", message.name, *names))
            case messages.AddLight():
                changed, name = edited.with_added_light(message.kind, message.position)
                self._render_edited(changed, f"added {message.kind} light", None)
                viewer.reply("added", message, {"name": name})
            case messages.RemoveLight():
                self._render_edited(edited.without_light(message.name), f"removed {message.name}", None)
            case messages.SetEnvironment():
                changed = self._read(lambda: edited.with_environment(message.kind, message.file))
                self._render_edited(changed, "environment", None)
            case messages.Environments():
                viewer.reply("environments", message, {"files": environment_files(edited.scene)})
            case messages.Reset():
                self._render_edited(edited.reset(message.what), f"reset of {message.what}", None)
            case messages.Undo() | messages.Redo():
                back = isinstance(message, messages.Undo)
                found = self._history.undo(edited) if back else self._history.redo(edited)
                if found is None:
                    raise UsageError(f"there is no edit to {message.type}")
                self._show_edited(found[0])
                viewer.reply("undone" if back else "redone", message, {"label": found[1]})
            case messages.CopyTable():
                viewer.reply("table", message, {"text": table_text(edited, message.what, message.name, self._reading)})
            case messages.DeviceChoice():
                session, self._device = self._opened(message.device)
                self._discard(self._progressive.use(session))
                self._progressive.restart(edited.job, self._broadcaster.camera_ids)
            case messages.Run():
                self._progressive.running = message.run
            case messages.Restart():
                self._progressive.restart(edited.job, self._broadcaster.camera_ids, only_camera=True)
            case messages.Probe():
                seen = probe(self._progressive, edited, message.x, message.y)
                self._pick(seen["material"])
                viewer.reply("probe", message, seen)
            case messages.Outline():
                width, height, path = self._progressive.outline(message.object)
                about = {"object": message.object, "width": width, "height": height, "path": path}
                viewer.reply("outline", message, about)
            case messages.Paths():
                self._trace(viewer, message)
            case messages.StopPaths():
                self._stop_paths(viewer)
            case messages.Save():
                viewer.reply("saved", message, self._saved(message))

    def _pick(self, name: str | None) -> None:
        """List a material or light from now on, also where the scene has too many to list: pages show it."""
        if name is not None:
            self._picked.pop(name, None)
            self._picked[name] = None
            while len(self._picked) > _MOST_PICKED:
                del self._picked[next(iter(self._picked))]

    def _trace(self, viewer: Viewer, message: messages.Paths) -> None:
        """Have the light paths of a pixel traced, of the scene as it is now."""
        # Only here: a view starts a quarter of a second earlier without
        from clrender.view.tracer import Tracer, surroundings, traced_job

        job = self._edited.job
        samples = message.samples
        if job.settings.error is not None and (taken := self._progressive.samples_of(message.x, message.y)) > 0:
            samples = min(samples, taken)
        job, pixel = traced_job(job, (message.x, message.y), samples)
        self._tracer = self._tracer or Tracer(self._background)
        device = self._progressive.session.devices[0].info.index
        self._tracer.ask(viewer, message, job, pixel, device, surroundings(self._progressive, self._edited))

    def _stop_paths(self, viewer: Viewer) -> None:
        if self._tracer is not None:
            self._tracer.stop(viewer)

    def _read(self, work: Callable[[], EditedScene]) -> EditedScene:
        """Do what may read a file, which viewers are told of."""
        self._broadcaster.stage("reading")
        try:
            return work()
        finally:
            self._broadcaster.stage("")

    def _render_edited(self, edited: EditedScene, label: str, key: Hashable) -> None:
        """Render the scene after an edit, which can be undone; label and key as of `History.record`."""
        before = self._edited
        if (edited.camera, edited.materials, edited.lights, edited.settings) != (
            before.camera,
            before.materials,
            before.lights,
            before.settings,
        ):
            self._history.record(before, label, key)
        self._show_edited(edited)

    def _show_edited(self, edited: EditedScene) -> None:
        """Render another edited scene: a new image, or the same one with another number of samples."""
        before, self._edited = self._edited, edited
        only_camera = edited.checked is before.checked
        if edited.restarts(before) or self._problems.failed:
            self._progressive.restart(edited.job, self._broadcaster.camera_ids, only_camera=only_camera)
        else:
            self._progressive.extend(edited.job, self._broadcaster.camera_ids)
        self._send_state()  # before scenes and replies: whoever sees those knows that another image begins
        if edited.checked.scene is not before.checked.scene:
            self._broadcaster.send_if_changed("scene", tables.scene(edited, self._picked))

    def _opened(self, device: Any) -> tuple[Session, str]:
        """A session whose devices are open, and their names."""
        session = Session(device, notify=self._broadcaster.notice, on_stage=self._broadcaster.stage)
        try:
            return session, ", ".join(each.info.title for each in session.devices)
        except BaseException:
            session.close()
            raise

    def _discard(self, session: Session) -> None:
        """Close a session; its devices may go on in another's."""
        session.close()

    def _saved(self, message: messages.Save) -> dict[str, Any]:
        if (path := self._outputs.get(message.name)) is None:
            known = ", ".join(self._outputs) or "none: name some with -o on the command line"
            raise UsageError(f"{message.name[:80]!r} is no file of the command line; there is {known}")
        if (image := self._progressive.developed(message.alpha)) is None:
            raise UsageError("there is no sample yet, and so nothing to save")
        image.save(path, message.tone_map, message.exposure)
        return {"name": message.name, "bytes": path.stat().st_size}

    def _launch_done(self, progress: Progress) -> None:
        if self._status.launch_done(self._progressive, progress):
            self._send_state()

    def _send_state(self) -> None:
        self._status.send_state(self._edited, self._history, self._progressive, self._device, self._problems)

    def _replace_scene(self, scene: Scene) -> None:
        """Render a scene that was read anew."""
        try:
            edited = self._edited.reread(scene)
            described = tables.scene(edited, self._picked)
        except Exception as error:  # as in `_reread`
            self._problems.add("scene", sentence(error))
            return
        self._problems.clear()
        ended = edited.ended(self._edited)
        self._edited = edited
        self._history.clear()
        self._progressive.restart(edited.job, self._broadcaster.camera_ids)
        self._send_state()
        self._broadcaster.send("scene", described)
        if ended:
            told = ", ".join(ended[:_MOST_TOLD]) + (", …" if len(ended) > _MOST_TOLD else "")
            self._broadcaster.notice(f"the scene has changed: {counted(len(ended), 'edit')} ended: {told}", later=False)

    # --- the thread that watches files, and the one that probes devices ---

    def _reread(self, source: Source) -> None:
        """Read the scene anew, which may take long, and hand it to the render thread."""
        try:
            scene = source.read()
        except Exception as error:  # a scene that cannot be read, in whatever way, is a problem to report
            self._inbox.call(partial(self._problems.add, "scene", sentence(error)))
        else:
            self._inbox.call(partial(self._replace_scene, scene))

    def _list_devices(self) -> None:
        self._status.first_frame.wait()  # probing takes as long as a first picture, which comes first
        if self._inbox.closed:
            return
        importlib.import_module("clrender.view.tracer")  # so that no image waits for it later
        devices = tables.devices()
        self._broadcaster.retain("hello", tables.hello(devices, list(self._outputs), self._look))
        self._broadcaster.send("devices", {"devices": devices})
