"""A session: devices with their programs and scenes, which render job after job without starting over."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from clrender.device import Buffer, Device, select
from clrender.device.preparation import DevicePreparation
from clrender.device.scene_arrays import SceneArrays
from clrender.device.worker import DeviceWorker, LaunchConfig, Scratch
from clrender.device_team import DeviceTeam
from clrender.errors import DeviceError, UsageError
from clrender.film import Film
from clrender.film.checkpoint import Checkpoint
from clrender.film.ledger import Ledger
from clrender.film.running import RunningFilm
from clrender.flatten import FlatScene, flatten, scene_origin, seen_by
from clrender.integrators.descriptor import Pipeline
from clrender.job import RenderJob
from clrender.job_render import JobRender
from clrender.rendered_image import Progress, RenderedImage
from clrender.scheduling.cluster import Cluster
from clrender.turn import Turn

if TYPE_CHECKING:
    from clrender.scene import Scene

__all__ = ["Session"]


class Session:
    """Devices that render one job after the other; what does not change from one to the next stays on them.

    A job whose camera, exposure, seed or range of samples is another than the last one's has its camera and settings
    uploaded, and nothing else; programs are built once. A context manager: at its end all is released.

    It renders one job at a time. Threads may share it, and wait for each other; a callback that renders, or closes the
    session, while it is called by a render of that session, gets a `UsageError`.

    Parameters
    ----------
    device : str, int, Device, sequence of them, optional
        As ``--device``; default: ``CLRENDER_DEVICE``, else the best that works. A `Device` that is already open stays
        open at the end.
    notify : callable, optional
        Told in a line which device was chosen, and of anything to know about it or a scene.

    Raises
    ------
    UsageError, DeviceError
        When the devices are first needed: there is none of that description, or none that works.

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
    ) -> None:
        self._notify = notify or (lambda line: None)
        self._devices: list[Device] | None = None
        self._given = _given(device)
        self._borrowed = [each for each in self._given if isinstance(each, Device)]
        self._dismissed: set[Device] = set()
        self._flat: tuple[_Geometry, FlatScene] | None = None
        self._before: dict[Device, frozenset[Buffer]] = {}
        self._uploaded: dict[Device, tuple[FlatScene, SceneArrays]] = {}
        self._scratch: dict[Device, Scratch] = {}
        self._closed = False
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
        """The session's devices; opened when they are first asked for. Those that were found unusable are left out."""
        if self._closed:
            raise UsageError("the session is closed; open another")
        if self._devices is None:
            self._devices = self._open()
        usable = [device for device in self._devices if not (device.lost or device in self._dismissed)]
        if not usable:
            raise DeviceError("every device of the session hangs or computes wrong results; open another session")
        return usable

    def close(self) -> None:
        """Release everything on the devices, and those that the session opened. A second call does nothing.

        Raises
        ------
        UsageError
            Called by a callback of a render of this session; all stays as it is.
        """
        with self._turn:
            self._closed = True
            for device in self._devices or []:
                device.release_but(self._before[device])
                if device not in self._borrowed:
                    device.close()
            self._uploaded, self._scratch, self._flat, self._devices = {}, {}, None, None

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
        """Render a scene, or a job.

        Parameters
        ----------
        scene : Scene or RenderJob
        on_progress : callable, optional
            Called in this thread after each launch, and at the end, when the film has all that was done.
        should_stop : callable, optional
            Asked in this thread, twenty times a second; a yes ends the render with what is done.
        keep_film : bool
            Keep the exact sums, 52 bytes a pixel (148 with replicates), in the result.
        checkpoint : path, optional
            A film that the render is saved to every five seconds, or less often where that would take more than 2 % of
            its time, and at its end, whatever ends it. As many bytes a pixel again.
        resume : bool
            Go on from what the checkpoint holds, if it is there yet; it must be of the same image, and may have been
            made with fewer samples per pixel.
        cluster : Cluster, optional
            As of `clrender.cluster.open_cluster`: its workers take the samples. The session's devices then make the
            layers and what guides the denoiser, and are not opened where neither is asked for.
        **settings
            Of a scene: as `RenderJob.of` takes them, ``size``, ``samples``, ``aov``, ``denoise`` and the fields of
            `RenderSettings`.

        Returns
        -------
        RenderedImage

        Raises
        ------
        SceneError, UsageError
            When the scene or a setting makes no sense, or what denoising needs is not installed. When there is a file
            in the checkpoint's place that is not to be resumed, or is of another image, or another render saves itself
            there. When a callback of a render of this session, or one that uses the same `Device`, calls it.
        DeviceError
            When no device works.
        RenderError
            When every device fails; `IncompleteRender`, with the image so far, when samples were finished by then.
        """
        job = RenderJob.given(scene, **settings)
        if isinstance(cluster, str):
            raise UsageError(
                f"cluster is {cluster!r}, but a session wants what clrender.cluster.open_cluster opens there; "
                "clrender.render takes addresses"
            )
        if checkpoint is None:
            if resume:
                raise UsageError("resume has no effect without a checkpoint; name its file")
            with self._alone():
                return JobRender(self, job, on_progress, should_stop, None, cluster).image(keep_film)
        with self._alone(), Checkpoint(checkpoint, resume, self.tell) as saved:
            return JobRender(self, job, on_progress, should_stop, saved, cluster).image(keep_film)

    def refine(
        self,
        job: RenderJob,
        film: RunningFilm | None = None,
        *,
        on_progress: Callable[[Progress], None] | None = None,
        should_stop: Callable[[], bool] | None = None,
    ) -> RunningFilm:
        """Render for somebody who watches: begin with one sample of each pixel, stop soon, and go on later.

        The sums are those of `render`, whatever the stops. Only samples are taken: the job's layers are not rendered.

        Parameters
        ----------
        job : RenderJob
        film : RunningFilm, optional
            To go on from: one that `refine` returned for this job, or for the same with fewer samples per pixel.
        on_progress, should_stop : callable, optional
            As of `render`. A yes is answered within a twentieth of a second on a device that is not slower than that
            with a few thousand pixels.

        Returns
        -------
        RunningFilm
            The one given, or a new one. Which request it is of is noted by `develop`.

        Raises
        ------
        SceneError, UsageError, DeviceError, RenderError
            As `render`. The film keeps what was finished.
        """
        with self._alone():
            return JobRender(self, job, on_progress, should_stop, begun=film).refine()

    def develop(self, job: RenderJob, film: RunningFilm) -> RenderedImage:
        """The image of what a film holds, with its numbers, as if a render had been stopped there.

        Parameters
        ----------
        job : RenderJob
            Its layers are rendered; no more samples are taken.
        film : RunningFilm
            That `refine` returned for this job; the image holds it.

        Returns
        -------
        RenderedImage
        """
        with self._alone():
            return JobRender(self, job, None, None, begun=film).developed()

    def layers(
        self, job: RenderJob, should_stop: Callable[[], bool] | None = None
    ) -> dict[str, npt.NDArray[np.float32]]:
        """The layers of a job that are seen first, without its image, as of `clrender.aov.first_hits`.

        Parameters
        ----------
        job : RenderJob
        should_stop : callable, optional
            After a yes, samples are missing.

        Returns
        -------
        dict of str to (height, width, channels) float32
            By the names of the job's `aov`.
        """
        with self._alone():
            return JobRender(self, job, None, should_stop).layers()

    def team(self, job: RenderJob) -> tuple[DeviceTeam, str]:
        """The devices at a job's disposal, as of `clrender.job_render.JobRender.team`.

        Parameters
        ----------
        job : RenderJob

        Returns
        -------
        team : DeviceTeam
        sha256 : str
            Hash of the scene's arrays.
        """
        with self._alone():
            return JobRender(self, job, None, None).team()

    def render_part(
        self,
        job: RenderJob,
        wanted: Ledger,
        check: Callable[[Mapping[str, Any]], None],
        on_progress: Callable[[Progress], None] | None = None,
        should_stop: Callable[[], bool] | None = None,
    ) -> Film:
        """Some samples of some pixels of a job, as of `clrender.job_render.JobRender.part`.

        Parameters
        ----------
        job : RenderJob
        wanted : Ledger
            Which samples of which blocks of pixels.
        check : callable
            Told the request of the job's film before anything is rendered; it may raise.
        on_progress, should_stop : callable, optional
            As of `render`.

        Returns
        -------
        Film
        """
        with self._alone():
            return JobRender(self, job, on_progress, should_stop).part(wanted, check)

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """The session, and devices that others may use as well, for this thread."""
        with ExitStack() as turns:
            turns.enter_context(self._turn)
            shared = {id(device.turn): device.turn for device in self._borrowed}
            for _, turn in sorted(shared.items()):  # in one order everywhere: nobody waits in a circle
                turns.enter_context(turn)
            yield

    def flat(self, job: RenderJob) -> FlatScene:
        """The job's scene as arrays; those of the session's last job where only the camera is another.

        Parameters
        ----------
        job : RenderJob

        Returns
        -------
        FlatScene
        """
        geometry = _Geometry.of(job)
        if self._flat is None or not self._flat[0].same(geometry):
            self._flat = geometry, _flattened(job)
        settings = job.settings
        return seen_by(self._flat[1], job.scene, settings.width, settings.height)

    def worker(
        self,
        device: Device,
        flat: FlatScene,
        settings: npt.NDArray[np.void],
        pipeline: Pipeline,
        launch: LaunchConfig,
        on_device: Callable[[DeviceWorker], DevicePreparation] | None = None,
    ) -> DeviceWorker:
        """A worker for a scene that is, or will be, on a device; one at a time for each device.

        Parameters
        ----------
        device : Device
        flat : FlatScene
        settings : (1,) `Settings`
            As of `clrender.settings.RenderSettings.struct`.
        pipeline : Pipeline
            The kernels of an integrator.
        launch : LaunchConfig
            How the work is cut.
        on_device : callable, optional
            Given the worker, prepares what its integrator needs there.

        Returns
        -------
        DeviceWorker
        """
        begin, before = time.perf_counter(), device.buffers
        with ExitStack() as failed:
            failed.callback(self._forget, device, before)
            held, arrays = self._uploaded.get(device, (None, None))
            if held is None or arrays is None or held.arrays is not flat.arrays:
                if arrays is not None:
                    del self._uploaded[device]
                    arrays.release()
                arrays = SceneArrays(device, flat)
            else:
                arrays.look(flat.camera)
            self._uploaded[device] = flat, arrays
            built = time.perf_counter() - begin
            scratch = self._scratch.setdefault(device, Scratch(device))
            worker = DeviceWorker(device, flat, settings, pipeline, launch, on_device, arrays=arrays, scratch=scratch)
            worker.build_seconds += built
            failed.pop_all()
        return worker

    def _forget(self, device: Device, before: frozenset[Buffer]) -> None:
        """Release what a worker that could not be made left on its device."""
        self._uploaded.pop(device, None)
        self._scratch.pop(device, None)
        device.release_but(before)

    def restart(self, device: Device) -> None:
        """Make a device that failed ready for another try: nothing of before is on it, or is used.

        Parameters
        ----------
        device : Device
        """
        self._forget(device, self._before[device])
        if device not in self._borrowed:
            device.reopen()

    def dismiss(self, device: Device) -> None:
        """Use a device no more in this session: it hangs, or its results are wrong.

        Parameters
        ----------
        device : Device
        """
        self._dismissed.add(device)

    def tell(self, line: str) -> None:
        """Pass a line on to whoever is to be notified.

        Parameters
        ----------
        line : str
        """
        self._notify(line)

    def _open(self) -> list[Device]:
        names = [each for each in self._given if not isinstance(each, Device)]
        opened = select(names, notify=self._notify) if names or not self._borrowed else []
        devices = [*self._borrowed, *opened]
        self._before = {device: device.buffers for device in devices}
        return devices


def _given(device: object) -> list[str | int | Device]:
    """Descriptions of devices, and devices, as a list; none where nothing is given."""
    given: list[str | int | Device] = []
    for one in device if isinstance(device, Iterable) and not isinstance(device, str) else [device]:
        if isinstance(one, (str, int, Device)) and not isinstance(one, bool):
            given.append(one)
        elif one is not None:
            raise UsageError(f"device is {one!r}; give an index of clrender.devices(), a name, or a list of such")
    return given


@dataclass(frozen=True)
class _Geometry:
    """What the arrays of a scene are made from, all but the camera."""

    scene: Scene
    light_sampler: str
    compensated: bool
    absorption: float | None
    origin: tuple[float, float, float]

    @classmethod
    def of(cls, job: RenderJob) -> _Geometry:
        origin = scene_origin(job.scene.camera)
        return cls(job.scene, _light_sampler(job), _compensated(job), job.settings.absorption, origin)

    def same(self, other: _Geometry) -> bool:
        a, b = self.scene, other.scene
        if dataclasses.replace(self, scene=b) != other:  # all but the scene
            return False
        if all(
            getattr(a, name) is getattr(b, name)
            for name in ("shapes", "groups", "materials", "lights", "_meshes", "_transforms", "_pictures")
        ):
            return True
        return a.content_sha256() == b.content_sha256()


def _light_sampler(job: RenderJob) -> str:
    """As asked for; ``auto`` is what the integrator makes of it."""
    asked = job.settings.light_sampler
    return job.integrator.auto_light_sampler if asked == "auto" else asked


def _compensated(job: RenderJob) -> bool:
    """Whether there is an environment, and samples of the BSDF find it wherever light samples do."""
    if job.scene.environment is None and job.scene.sky is None:
        return False
    settings = job.settings.struct(1, job.integrator.fixed)
    return bool(settings["light_samples"][0] and settings["bsdf_samples"][0])


def _flattened(job: RenderJob) -> FlatScene:
    settings = job.settings
    flat = flatten(
        job.scene,
        settings.width,
        settings.height,
        _light_sampler(job),
        compensated=_compensated(job),
    )
    if settings.absorption is None:
        return flat
    materials = flat.arrays["materials"].copy()
    materials["color"][:, 3] = settings.absorption
    return dataclasses.replace(flat, arrays={**flat.arrays, "materials": materials})
