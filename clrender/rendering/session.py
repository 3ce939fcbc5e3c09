"""A session: open devices that keep compiled programs and uploaded scenes from one render job to the next."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

from clrender.aov import SHADOW_CATCHER
from clrender.device import Device
from clrender.device.forked import refuse_forked
from clrender.device.team import DeviceTeam
from clrender.errors import UsageError
from clrender.film import Film
from clrender.film.checkpoint import Checkpoint
from clrender.film.ledger import Ledger
from clrender.film.running import RunningFilm
from clrender.importers.cameras.read import with_camera
from clrender.limits import check_function, checked_flag
from clrender.plugins import as_plugins
from clrender.process.exclusive import Turn
from clrender.process.shield import Call
from clrender.process.stages import Stages
from clrender.rendering.batch import batches
from clrender.rendering.job import RenderJob
from clrender.rendering.job_render import JobRender, Recorded
from clrender.rendering.rendered_image import Progress, RenderedImage
from clrender.rendering.residency import ApartError, Residency
from clrender.rendering.team import Cluster
from clrender.scene import Camera, Scene
from clrender.wording import shown

if TYPE_CHECKING:
    from clrender.device.worker import DeviceWorker
    from clrender.film.unit import Unit, UnitSums
    from clrender.integrators import Pipeline

__all__ = ["Session", "requested_devices"]

_T = TypeVar("_T")


class Session:
    """A set of devices that renders jobs one after another; data that two jobs share stays on the devices.

    If a job differs from the previous one only in its camera, exposure, seed or range of samples, only the camera and
    the settings are uploaded. Programs are built once. A session is a context manager; on exit it releases all
    resources.

    A session renders one job at a time. Threads may share it and wait for each other. A callback that is called during
    a render and itself renders with, or closes, the same session gets a `UsageError`. An interruption (Ctrl-C, or an
    exception of a signal handler) ends the call within a second; what it had begun ends in order in the background, and
    the next call waits for that.

    Parameters
    ----------
    device : str, int, Device, sequence of them, optional
        See ``--device``. Default: ``CLRENDER_DEVICE``, else the best device that works. A `Device` that is already open
        is not closed at the end.
    notify : callable, optional
        Called with one line of text: which device was chosen, or a note or warning about a device or a scene.
    on_stage : callable, optional
        Called, in any thread, with what a render does before it takes samples: a key of
        `clrender.process.stages.STAGES`, such as ``compiling``, or the empty string.
    refit : bool
        For animations: where only vertices, instances, materials and lights of a scene differ from the last one, its
        BVH is refitted in a few milliseconds instead of built, unless it would become half as slow again. The last
        digits of an image may then depend on the scenes before: its hash is not that of another session, and its film
        cannot be merged with those of others, or verified. For one device.
    plugins : Plugin, str, pathlib.Path, or iterable of them, optional
        Plugins that materials of all scenes may use; see `clrender.plugin`.

    Attributes
    ----------
    stages : Stages
        What it is called by.

    Raises
    ------
    UsageError, DeviceError
        When the devices are first needed: no device matches the description, or none works.

    Examples
    --------
    >>> with clrender.Session() as session:  # doctest: +SKIP
    ...     first = session.render(scene, spp=16)
    ...     second = session.render(scene, spp=16, seed=1)
    """

    def __init__(
        self,
        device: str | int | Device | Sequence[str | int | Device] | None = None,
        *,
        notify: Callable[[str], None] | None = None,
        on_stage: Callable[[str], None] | None = None,
        refit: bool = False,
        plugins: Any = None,
    ) -> None:
        check_function(notify, "notify")
        check_function(on_stage, "on_stage")
        refit = checked_flag(refit, "refit")
        self.stages = Stages(on_stage)
        self._plugins = as_plugins(plugins)
        self._notify = notify or (lambda line: None)
        self._residency = Residency(requested_devices(device), self.stages, self.tell, on_stage is not None, refit)
        self._call: Call | None = None
        self._turn = Turn(
            "the session is rendering; its callbacks can neither render with it nor close it: open another, or wait "
            "for the render to end"
        )

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *details: Any) -> None:
        self.close()

    @property
    def devices(self) -> list[Device]:
        """The session's devices, opened at the first access. Devices that were found unusable are left out."""
        if self._call is None and not self._residency.opened:
            return self._exclusively(lambda: self._residency.devices)
        return self._residency.devices

    def close(self) -> None:
        """Release everything on the devices and close those that the session opened. A second call does nothing.

        Raises
        ------
        UsageError
            When a callback of a render of this session calls it; nothing is released then.
        """
        self._exclusively(self._residency.close)

    def render(
        self,
        scene: Scene | RenderJob,
        *,
        on_progress: Callable[[Progress], None] | None = None,
        should_stop: Callable[[], bool] | None = None,
        keep_film: bool = True,
        checkpoint: str | Path | None = None,
        resume: bool = False,
        cluster: Cluster | None = None,
        **settings: Any,
    ) -> RenderedImage:
        """Render a scene or a job.

        Parameters
        ----------
        scene : Scene or RenderJob
        on_progress : callable, optional
            Called in the calling thread after each launch, and a last time after the last commit.
        should_stop : callable, optional
            Called in the calling thread, twenty times a second. If it returns True, the render ends with the samples
            taken so far.
        keep_film : bool
            Keep the exact sums, 52 bytes per pixel (148 with replicates), in the result.
        checkpoint : path, optional
            Film file to which the render is saved every five seconds, or less often if saving would take more than 2 %
            of the render time, and at the end, however the render ends. This needs as many bytes per pixel again.
        resume : bool
            Continue from the checkpoint if the file exists. It must be of the same image, but may have been made with
            fewer samples per pixel.
        cluster : Cluster, optional
            See `clrender.cluster.open_cluster`: its workers take the samples. The session's devices then render only
            the layers and the denoiser's guide images; if neither is requested, they are not opened.
        **settings
            Only with a scene; see `RenderJob.of`: ``size``, ``samples``, ``aov``, ``denoise``, ``plugins`` and the
            fields of `RenderSettings`.

        Returns
        -------
        RenderedImage

        Raises
        ------
        SceneError, UsageError
            When the scene or a setting is invalid, or a package that denoising needs is not installed. When the
            checkpoint file exists but `resume` is False, when it is of another image, or when another render saves to
            it. When it is called by a callback of a render of this session or of one that uses the same `Device`.
        DeviceError
            When no device works.
        RenderError
            When every device fails. It is an `IncompleteRender`, with the image so far, if any samples were finished.
        """
        job = RenderJob.given(self._equipped(scene), **settings)
        check_function(on_progress, "on_progress")
        check_function(should_stop, "should_stop")
        keep_film, resume = checked_flag(keep_film, "keep_film"), checked_flag(resume, "resume")
        if cluster is not None and not hasattr(cluster, "team"):
            raise UsageError(
                f"cluster is {cluster!r}, but a session wants what clrender.cluster.open_cluster opens there; "
                "clrender.render takes addresses"
            )
        if cluster is not None:
            job.check_for_cluster()
        if checkpoint is None and resume:
            raise UsageError("resume has no effect without a checkpoint; name its file")
        if resume and self._residency.refits:
            text = "last digits depend on the scenes before it; resume in a session without refit"
            raise UsageError(f"resume is not for a session that refits BVHs, whose {text}")

        def work() -> RenderedImage:
            render = partial(JobRender, self._residency, job, *self._callbacks(on_progress, should_stop))
            if checkpoint is None:
                return render(None, cluster).image(keep_film)
            with Checkpoint(checkpoint, resume, self.tell) as saved:
                return render(saved, cluster).image(keep_film)

        return self._exclusively(work)

    def render_batch(
        self, scene: Scene, cameras: Iterable[Camera | Mapping[str, Any]], **settings: Any
    ) -> npt.NDArray[np.float32]:
        """Render a scene as many cameras see it.

        Images of cameras that see the same arrays are rendered together, in the launches of one large image; each has
        the bits that `render` gives it.

        Parameters
        ----------
        scene : Scene
        cameras : iterable of Camera or mapping
            Cameras, or keys of them; without a pose they stay where the scene's camera is.
        **settings
            See `render`. All images have the same size and seed. Of the layers only ``alpha`` is for arrays, and no
            `light_groups`, `amodal` or `spectrum` are.

        Returns
        -------
        (n, height, width, 3) float32
            Radiance, denoised if asked for; with the layer ``alpha``, (n, height, width, 4).

        Raises
        ------
        SceneError, UsageError, DeviceError, RenderError
            See `render`.
        """
        given = RenderJob.given(self._equipped(scene), **settings)
        scene = given.scene
        if not isinstance(cameras, Iterable) or isinstance(cameras, str | Path | Mapping | Camera):
            raise UsageError(f"cameras is {shown(cameras)}, but must be a list of cameras, or of their keys")
        _check_fits_array(given)
        views = [with_camera(scene, camera).camera for camera in cameras]
        width, height = given.settings.film_size
        found = np.empty((len(views), height, width, 4 if "alpha" in given.aov else 3), np.float32)
        at = 0
        for some in batches(given, views):
            part = found[at : at + len(some)]
            at += len(some)
            try:
                if len(some) > 1:
                    job = dataclasses.replace(given, scene=scene.with_checked(camera=some[0]), views=some)
                    part[:] = self._exclusively(partial(self._linear, job)).reshape(part.shape)
                    continue
            except ApartError:
                pass
            for camera, image in zip(some, part, strict=True):
                one = self.render(dataclasses.replace(given, scene=scene.with_checked(camera=camera)), keep_film=False)
                image[..., :3] = one.picture
                if one.alpha is not None:
                    image[..., 3] = one.alpha
        return found

    def _equipped(self, scene: Scene | RenderJob) -> Scene | RenderJob:
        """A scene whose materials may use the session's plugins."""
        return scene.with_plugins(self._plugins) if isinstance(scene, Scene) else scene

    def _linear(self, job: RenderJob) -> npt.NDArray[np.float32]:
        return JobRender(self._residency, job, *self._callbacks()).image(False).linear

    def refine(
        self,
        job: RenderJob,
        film: RunningFilm | None = None,
        *,
        on_progress: Callable[[Progress], None] | None = None,
        should_stop: Callable[[], bool] | None = None,
    ) -> RunningFilm:
        """Render progressively for an interactive viewer: start with one sample per pixel, stop quickly, resume later.

        The sums are the same as those of `render`, wherever it stops. The job's layers are not rendered.

        Parameters
        ----------
        job : RenderJob
        film : RunningFilm, optional
            Film to continue: one that `refine` returned for this job, or for the same job with fewer samples per pixel.
        on_progress, should_stop : callable, optional
            See `render`. The render stops within a twentieth of a second, on a device that renders a few thousand
            pixels in that time.

        Returns
        -------
        RunningFilm
            The given film, or a new one. Its request is set by `develop`.

        Raises
        ------
        SceneError, UsageError, DeviceError, RenderError
            See `render`. The film keeps the finished samples.
        """
        return self._exclusively(
            lambda: JobRender(self._residency, job, *self._callbacks(on_progress, should_stop), begun=film).refine()
        )

    def develop(self, job: RenderJob, film: RunningFilm) -> RenderedImage:
        """Develop a film into an image with its statistics, as if a render had been stopped there.

        Parameters
        ----------
        job : RenderJob
            Its layers are rendered; no more samples are taken.
        film : RunningFilm
            A film that `refine` returned for this job; the image holds it.

        Returns
        -------
        RenderedImage
        """
        return self._exclusively(lambda: JobRender(self._residency, job, *self._callbacks(), begun=film).developed())

    def layers(
        self, job: RenderJob, should_stop: Callable[[], bool] | None = None
    ) -> dict[str, npt.NDArray[np.float32]]:
        """Render only the first-hit layers of a job, without its image; see `clrender.aov.first_hits`.

        Parameters
        ----------
        job : RenderJob
        should_stop : callable, optional
            If it returns True, the layers have fewer samples.

        Returns
        -------
        dict of str to (height, width, channels) float32
            Keys are the names in the job's `aov`.
        """
        return self._exclusively(lambda: JobRender(self._residency, job, *self._callbacks(None, should_stop)).layers())

    def recorded(
        self,
        job: RenderJob,
        pipelines: Mapping[str, Pipeline],
        take: Callable[[Unit, UnitSums], None],
        finish: Callable[[DeviceWorker], None],
        *,
        on_progress: Callable[[Progress], None] | None = None,
        should_stop: Callable[[], bool] | None = None,
    ) -> Recorded:
        """Render one pixel by kernels that record its paths, on the first device of the session.

        Parameters
        ----------
        job : RenderJob
            Its crop is one pixel.
        pipelines : mapping of str to Pipeline
            Pipelines with `reads_records`, by the kernels that they stand for.
        take : callable
            Called with each unit of samples and its result.
        finish : callable
            Called with the worker after the last of them.
        on_progress, should_stop : callable, optional
            See `render`.

        Returns
        -------
        Recorded

        Raises
        ------
        SceneError, UsageError, DeviceError, RenderError
            See `render`.
        """

        def work() -> Recorded:
            render = JobRender(self._residency, job, *self._callbacks(on_progress, should_stop))
            return render.recorded(pipelines, take, finish)

        return self._exclusively(work)

    def team(self, job: RenderJob) -> tuple[DeviceTeam, str]:
        """The session's devices as workers for a job; see `clrender.rendering.job_render.JobRender.team`.

        Parameters
        ----------
        job : RenderJob

        Returns
        -------
        team : DeviceTeam
        sha256 : str
            Hash of the scene's arrays.
        """
        return self._exclusively(lambda: JobRender(self._residency, job, None, None).team())

    def render_part(
        self,
        job: RenderJob,
        wanted: Ledger,
        check: Callable[[Mapping[str, Any]], None],
        on_progress: Callable[[Progress], None] | None = None,
        should_stop: Callable[[], bool] | None = None,
    ) -> Film:
        """Render some samples of some pixels of a job; see `clrender.rendering.job_render.JobRender.part`.

        Parameters
        ----------
        job : RenderJob
        wanted : Ledger
            Which samples of which blocks of pixels.
        check : callable
            Called with the request of the job's film before anything is rendered; it may raise.
        on_progress, should_stop : callable, optional
            See `render`.

        Returns
        -------
        Film
        """
        return self._exclusively(
            lambda: JobRender(self._residency, job, *self._callbacks(on_progress, should_stop)).part(wanted, check)
        )

    def _exclusively(self, work: Callable[[], _T]) -> _T:
        """Execute work, shielded from signals, with the session and the devices that others may share locked."""
        refuse_forked()
        call = Call()

        def alone() -> _T:
            with ExitStack() as turns:
                turns.enter_context(self._turn.of(call))
                shared = {id(device.turn): device.turn for device in self._residency.borrowed}
                for _, turn in sorted(shared.items()):  # always in the same order, to avoid deadlock
                    turns.enter_context(turn.of(call))
                turns.enter_context(self._residency.in_turn())
                self._call = call
                try:
                    return work()
                finally:
                    self._call = None

        return call.run(alone)

    def _callbacks(
        self, on_progress: Callable[[Progress], None] | None = None, should_stop: Callable[[], bool] | None = None
    ) -> tuple[Callable[[Progress], None] | None, Callable[[], bool]]:
        """Callbacks of the current call, to be called by its work; the work stops when it is abandoned."""
        call = self._call
        assert call is not None
        check_function(on_progress, "on_progress")
        check_function(should_stop, "should_stop")
        return (
            None if on_progress is None else call.callback(on_progress, None),
            (lambda: call.abandoned) if should_stop is None else call.callback(should_stop, otherwise=True),
        )

    def tell(self, line: str) -> None:
        """Pass a line of text to the session's `notify`.

        Parameters
        ----------
        line : str
        """
        call = self._call
        (self._notify if call is None else call.callback(self._notify, None))(line)


def _check_fits_array(job: RenderJob) -> None:
    """Check that a batch's array holds all that is asked for."""
    known = ("alpha", SHADOW_CATCHER)  # the second one comes with the first
    more = next((f"the layer {name}" for name in job.aov if name not in known), None)
    for name in ("light_groups", "amodal"):
        more = more or (name if getattr(job, name) else None)
    more = more or ("spectrum" if job.bands else None)
    if more is not None:
        raise UsageError(f"render_batch returns an array of images, without {more}; render those one by one")


def requested_devices(device: object) -> list[str | int | Device]:
    """The given devices and descriptions of devices as a list; empty if none is given.

    Parameters
    ----------
    device : str, int, Device, iterable of them, or None
        See `Session`.

    Raises
    ------
    UsageError
        One is of another type.
    """
    given: list[str | int | Device] = []
    whole = isinstance(device, str | bytes | bytearray) or not isinstance(device, Iterable)
    for one in [device] if whole else device:  # type: ignore[attr-defined]
        if isinstance(one, (str, Integral, Device)) and not isinstance(one, bool):
            given.append(int(one) if isinstance(one, Integral) else one)
        elif one is not None:
            raise UsageError(f"device is {one!r}; give an index of clrender.devices(), a name, or a list of such")
    return given
