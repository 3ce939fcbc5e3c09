"""A session: devices with their programs and scenes, which render job after job without starting over."""

from __future__ import annotations

import dataclasses
import importlib
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from clrender.aov import GUIDE_SAMPLES, GUIDES, LAYER_SAMPLES, first_hits
from clrender.device import Buffer, Device, select
from clrender.device.preparation import DevicePreparation, Prepared, Request
from clrender.device.scene_arrays import SceneArrays
from clrender.device.worker import DeviceWorker, LaunchConfig, Scratch, most_lanes
from clrender.errors import RenderError, UsageError
from clrender.film import Film
from clrender.film.unit import tile_side
from clrender.flatten import FlatScene, flatten, scene_origin, seen_by
from clrender.image.denoise import Denoiser
from clrender.image.files import image_sha256
from clrender.integrators.descriptor import Pipeline
from clrender.job import RenderJob
from clrender.render_stats import render_stats
from clrender.rendered_image import IncompleteRender, Progress, RenderedImage
from clrender.scheduling.policy import Plan
from clrender.scheduling.pool import WorkerPool
from clrender.scheduling.run import Tally, run

if TYPE_CHECKING:
    from clrender.scene import Scene
    from clrender.settings import RenderSettings

__all__ = ["Session"]

_Arrays = dict[str, npt.NDArray[np.float32]]


class Session:
    """Devices that render one job after the other; what does not change from one to the next stays on them.

    A job whose camera, exposure, seed or range of samples is another than the last one's has its camera and settings
    uploaded, and nothing else; programs are built once. A context manager: at its end all is released.

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
        self._spec = device
        self._notify = notify or (lambda line: None)
        self._devices: list[Device] | None = None
        self._borrowed: list[Device] = []
        self._flat: tuple[_Geometry, FlatScene] | None = None
        self._before: dict[Device, frozenset[Buffer]] = {}
        self._uploaded: dict[Device, tuple[FlatScene, SceneArrays]] = {}
        self._scratch: dict[Device, Scratch] = {}
        self._closed = False

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *details: Any) -> None:
        self.close()

    @property
    def devices(self) -> list[Device]:
        """The session's devices; opened when they are first asked for."""
        if self._closed:
            raise UsageError("the session is closed; open another")
        if self._devices is None:
            self._devices = self._open()
        return self._devices

    def close(self) -> None:
        """Release everything on the devices, and those that the session opened. A second call does nothing."""
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
        **settings: Any,
    ) -> RenderedImage:
        """Render a scene, or a job.

        Parameters
        ----------
        scene : Scene or RenderJob
        on_progress : callable, optional
            Called in this thread after each launch.
        should_stop : callable, optional
            Asked in this thread, twenty times a second; a yes ends the render with what is done.
        keep_film : bool
            Keep the exact sums, 52 bytes a pixel, in the result.
        **settings
            Of a scene: as `RenderJob.of` takes them, ``size``, ``samples``, ``aov``, ``denoise`` and the fields of
            `RenderSettings`.

        Returns
        -------
        RenderedImage

        Raises
        ------
        SceneError, UsageError
            When the scene or a setting makes no sense, or what denoising needs is not installed.
        DeviceError
            When no device works.
        RenderError
            When every device fails; `IncompleteRender`, with the image so far, when samples were finished by then.
        """
        job = RenderJob.given(scene, **settings)
        return _Render(self, job, on_progress, should_stop).image(keep_film)

    def flat(self, job: RenderJob) -> FlatScene:
        """The job's scene as arrays; those of the session's last job where only the camera is another."""
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
        """A worker for a scene that is, or will be, on a device; one at a time for each device."""
        before = device.buffers
        try:
            return self._worker(device, flat, settings, pipeline, launch, on_device)
        except BaseException:
            self._uploaded.pop(device, None)
            self._scratch.pop(device, None)
            device.release_but(before)
            raise

    def _worker(
        self,
        device: Device,
        flat: FlatScene,
        settings: npt.NDArray[np.void],
        pipeline: Pipeline,
        launch: LaunchConfig,
        on_device: Callable[[DeviceWorker], DevicePreparation] | None,
    ) -> DeviceWorker:
        begin = time.perf_counter()
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
        return worker

    def tell(self, line: str) -> None:
        """Pass a line on to whoever is to be notified."""
        self._notify(line)

    def _open(self) -> list[Device]:
        single = self._spec is None or isinstance(self._spec, (str, int, Device))
        given: list[Any] = [self._spec] if single else list(self._spec)  # type: ignore[arg-type]  # it is a sequence
        self._borrowed = [each for each in given if isinstance(each, Device)]
        names = [each for each in given if each is not None and not isinstance(each, Device)]
        opened = select(names, notify=self._notify) if names or not self._borrowed else []
        devices = [*self._borrowed, *opened]
        self._before = {device: device.buffers for device in devices}
        return devices


@dataclass(frozen=True)
class _Geometry:
    """What the arrays of a scene are made from, all but the camera."""

    scene: Scene
    light_sampler: str
    absorption: float | None
    origin: tuple[float, float, float]

    @classmethod
    def of(cls, job: RenderJob) -> _Geometry:
        return cls(job.scene, _light_sampler(job), job.settings.absorption, scene_origin(job.scene.camera))

    def same(self, other: _Geometry) -> bool:
        if (self.light_sampler, self.absorption, self.origin) != (other.light_sampler, other.absorption, other.origin):
            return False
        a, b = self.scene, other.scene
        if all(getattr(a, name) is getattr(b, name) for name in ("shapes", "materials", "lights", "_meshes")):
            return True
        return a.content_sha256() == b.content_sha256()


def _light_sampler(job: RenderJob) -> str:
    """As asked for; ``auto`` is what the integrator makes of it."""
    asked = job.settings.light_sampler
    return job.integrator.auto_light_sampler if asked == "auto" else asked


def _flattened(job: RenderJob) -> FlatScene:
    settings = job.settings
    flat = flatten(job.scene, settings.width, settings.height, _light_sampler(job))
    if settings.absorption is None:
        return flat
    materials = flat.arrays["materials"].copy()
    materials["color"][:, 3] = settings.absorption
    return dataclasses.replace(flat, arrays={**flat.arrays, "materials": materials})


class _Render:
    """One job on its way through a session."""

    def __init__(
        self,
        session: Session,
        job: RenderJob,
        on_progress: Callable[[Progress], None] | None,
        should_stop: Callable[[], bool] | None,
    ) -> None:
        self._begin = time.perf_counter()
        self._session = session
        self._job = job
        self._settings: RenderSettings = job.settings
        self._on_progress = on_progress
        self._should_stop = should_stop or (lambda: False)
        self._launch = LaunchConfig(
            self._settings.lanes,
            self._settings.work_group,
            self._settings.samples_per_pass,
            self._settings.traversal,
        )
        self._seconds: dict[str, float] = {}
        self._started: float | None = None
        self._film: Film | None = None

    def image(self, keep_film: bool) -> RenderedImage:
        job, settings, session = self._job, self._settings, self._session
        denoiser = Denoiser() if job.denoise else None
        with self._timed("load_seconds"):
            flat = session.flat(job)
        for warning in flat.warnings:
            session.tell(warning)
        devices = session.devices
        _check_lanes(settings, devices)
        compiled = sum(device.compile_seconds for device in devices)
        with self._timed("aov_seconds"):
            first = self._layers(flat)
        prepared = self._prepared(flat)
        self._film = film = Film(settings.width, settings.height, {**job.request(), "arrays_sha256": flat.sha256})
        self._seconds["setup_seconds"] = time.perf_counter() - self._begin - self._seconds["aov_seconds"]
        cpu = time.process_time()
        with self._pool(prepared) as pool:
            tally = run(self._plan(), pool.candidates, film, self._advance, self._stops)
            finished = time.perf_counter()
            workers = pool.workers
        self._check_progress(tally)
        if self._started is not None:
            self._seconds["setup_seconds"] = self._started - self._begin - self._seconds["aov_seconds"]
        linear = film.mean() if keep_film else film.develop()
        first["samples"] = film.counts[..., None].astype(np.float32)
        times = {
            **self._seconds,
            "compile_seconds": sum(device.compile_seconds for device in devices) - compiled,
            "build_seconds": max((worker.build_seconds for worker in workers.values()), default=0.0),
            "render_seconds": finished - (self._started or finished),
            "render_cpu_seconds": time.process_time() - cpu,
            "write_seconds": 0.0,
            "wall_seconds": time.perf_counter() - self._begin,
        }
        stats = render_stats(job, flat, film, linear, tally, devices, workers, times)
        denoised = self._denoised(denoiser, linear, first, stats) if denoiser else None
        layers = {name: first[name] for name in job.aov if name in first}
        image = RenderedImage(linear, stats, film, not tally.complete, denoised, layers)
        if tally.all_failed and not tally.complete:
            raise IncompleteRender(str(tally.failures[-1]), image) from tally.failures[-1]
        for failure in tally.failures:
            session.tell(f"warning: {failure}; its work was done by the others")
        if lost := stats["nonfinite_samples"]:
            session.tell(
                f"warning: {lost} of {tally.samples} samples were not finite, or brighter than 2^43, and are left out: "
                "the image is too dark where they were"
            )
        return image

    def _prepared(self, flat: FlatScene) -> Prepared:
        """What the integrator renders with."""
        job, session, integrator = self._job, self._session, self._job.integrator
        if not integrator.preparation:
            return Prepared(flat, integrator.pipeline)
        module = importlib.import_module(integrator.preparation)
        request = Request(
            job.scene, flat, job.settings, integrator.pipeline, session.devices, self._launch, session.tell, self._stops
        )
        prepared: Prepared = module.prepare(request)
        return prepared

    def _stops(self) -> bool:
        limit = self._settings.time_limit
        late = limit is not None and time.perf_counter() - self._begin >= limit
        return late or self._should_stop()

    def _advance(self, samples: int, rays: int) -> None:
        if self._on_progress is not None:
            begun = self._started or time.perf_counter()
            seconds = time.perf_counter() - begun
            self._on_progress(Progress(samples, self._plan().samples, seconds, rays, self._film))

    def _plan(self) -> Plan:
        settings, job = self._settings, self._job
        return Plan(
            settings.width,
            settings.height,
            job.first_sample,
            job.sample_count,
            tile_side(settings.tile, settings.width, settings.height),
            job.integrator.pipeline.sample_by_sample,
        )

    def _pool(self, prepared: Prepared) -> WorkerPool:
        """The devices as workers; the render begins when the first of them is ready."""
        settings = self._settings.struct(self._plan().tile, self._job.integrator.fixed)
        make = partial(
            self._session.worker,
            flat=prepared.flat,
            settings=settings,
            pipeline=prepared.pipeline,
            launch=self._launch,
            on_device=prepared.on_device,
        )

        def ready(device: Device) -> DeviceWorker:
            worker = make(device)
            self._started = self._started or time.perf_counter()
            return worker

        return WorkerPool(self._session.devices, ready)

    def _layers(self, flat: FlatScene) -> _Arrays:
        """What is seen first. It comes before the image, so that one stopped early has its layers whole."""
        job = self._job
        make = partial(
            self._session.worker, flat=flat, settings=self._settings.struct(self._plan().tile), launch=self._launch
        )
        names = [*job.aov, *(GUIDES if job.denoise else ())]
        most = LAYER_SAMPLES if job.aov else GUIDE_SAMPLES
        return first_hits(
            self._session.devices, make, flat, self._settings, names, most, self._should_stop, self._session.tell
        )

    def _check_progress(self, tally: Tally) -> None:
        """An image without any sample is none: say why there is nothing to show."""
        if tally.samples:
            return
        if tally.all_failed:
            raise tally.failures[-1]
        if self._settings.time_limit is not None and not self._should_stop():
            raise RenderError(
                f"not one sample was finished within {self._settings.time_limit:g} s, which set-up is part of; give it "
                "more time"
            )

    def _denoised(
        self, denoiser: Denoiser, linear: npt.NDArray[np.float32], first: _Arrays, stats: dict[str, Any]
    ) -> npt.NDArray[np.float32]:
        """The image without noise; the numbers say so."""
        begin = time.perf_counter()
        denoised = denoiser(linear, first["albedo"], first["normal"])
        denoiser.release()
        seconds = time.perf_counter() - begin
        stats |= {"denoised": True, "denoiser": denoiser.name, "denoised_sha256": image_sha256(denoised)}
        stats |= {"denoise_seconds": seconds, "wall_seconds": stats["wall_seconds"] + seconds}
        return denoised

    @contextmanager
    def _timed(self, name: str) -> Iterator[None]:
        begin = time.perf_counter()
        yield
        self._seconds[name] = time.perf_counter() - begin


def _check_lanes(settings: RenderSettings, devices: Sequence[Device]) -> None:
    for device in devices:
        if (settings.lanes or 1) > (limit := most_lanes(device)):
            raise UsageError(
                f"lanes is {settings.lanes}; {device.info.title} takes at most {limit}: leave it out, or choose "
                "another device"
            )
