"""Rendering of one job in a session: layers, preparation, samples, and the image with its statistics."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import cache, partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from clrender.aov import LABELS, alpha_samples, labels_told, matte_names
from clrender.device import Device
from clrender.device.launch import LaunchConfig
from clrender.device.prepared import Prepared
from clrender.device.team import DeviceTeam, check_lanes, member, most_slots
from clrender.device.worker import DeviceWorker
from clrender.drivers.probe import passes_probe
from clrender.errors import RenderError
from clrender.film import Film
from clrender.film.checkpoint import Checkpoint
from clrender.film.convergence import Convergence
from clrender.film.ledger import Ledger
from clrender.film.replicates import standard_error
from clrender.film.running import RunningFilm
from clrender.film.unit import Unit, UnitSums, slot_count, tile_side
from clrender.flatten.flat_scene import FlatScene
from clrender.flatten.light_groups import group_names
from clrender.image.denoise import Denoiser
from clrender.image.files import image_sha256
from clrender.process.memory import largest_tile, room
from clrender.rendering.effort import effort_told
from clrender.rendering.further_renders import FurtherRenders
from clrender.rendering.job import RenderJob
from clrender.rendering.layers import Layers
from clrender.rendering.memory import limited, needs, told
from clrender.rendering.outcome import lost_light, outcome_told
from clrender.rendering.preparing import prepare
from clrender.rendering.rendered_image import IncompleteRender, Progress, RenderedImage
from clrender.rendering.residency import Residency
from clrender.rendering.statistics import error_stats, film_layers, job_stats, peak_rss, render_stats
from clrender.rendering.taken import Taken
from clrender.rendering.team import Cluster, Team
from clrender.scheduling.contributions import MOST_BYTES
from clrender.scheduling.policy import Plan
from clrender.scheduling.run import Tally, run
from clrender.scheduling.tally import failures_told
from clrender.scheduling.until_converged import run_until_converged

if TYPE_CHECKING:
    from clrender.guiding.field import GuidingField
    from clrender.integrators import Pipeline
    from clrender.settings import RenderSettings

__all__ = ["JobRender", "Recorded"]

STAND_INS: Final = True
"""Whether programs for any scene may trace samples while a scene's own is not compiled."""

_LIVE_SECONDS: Final = 0.008
"""Target duration of a launch in interactive rendering, where a different image may be requested at any time."""

_DEPTH: Final = 64
"""Samples per pixel in a unit that goes to a cluster: a third of the bytes that units of 16 samples would take."""

_RECORDED: Final = 256
"""Samples whose records are read together."""

_Arrays = dict[str, npt.NDArray[np.float32]]


class JobRender:
    """The rendering of one job by a session.

    Parameters
    ----------
    residency : Residency
        Its devices render the job.
    job : RenderJob
    on_progress, should_stop : callable, optional
        See `Session.render`.
    checkpoint : Checkpoint, optional
        An open checkpoint.
    cluster : Cluster, optional
        Its workers take the samples. The session's devices then render only the layers.
    begun : RunningFilm, optional
        A film of the job from an earlier `refine`; the samples that it holds are not taken again.
    """

    def __init__(
        self,
        residency: Residency,
        job: RenderJob,
        on_progress: Callable[[Progress], None] | None,
        should_stop: Callable[[], bool] | None,
        checkpoint: Checkpoint | None = None,
        cluster: Cluster | None = None,
        begun: RunningFilm | None = None,
    ) -> None:
        self._begin = time.perf_counter()
        self._residency = residency
        self._job = job
        self._settings: RenderSettings = job.settings
        self._on_progress = on_progress
        self._should_stop = should_stop or (lambda: False)
        self._checkpoint = checkpoint
        self._cluster = cluster
        self._begun = begun
        self._plan = _plan_of(job)
        if cluster is not None:
            self._plan = dataclasses.replace(self._plan, short_units=True, depth=_DEPTH)
        self._total = self._plan.samples
        self._launch = LaunchConfig(
            self._settings.lanes,
            self._settings.work_group,
            self._settings.samples_per_pass,
            self._settings.traversal,
            staged=self._settings.kernels == "staged",
            code=self._settings.code,
        )
        self._seconds: dict[str, float] = {}
        self._started: float | None = None
        self._film: Film | None = None
        self._found: Convergence | None = None
        self._apart_bytes = MOST_BYTES
        self._holds, self._sums = False, True
        self._compiled = 0.0
        launch = dataclasses.replace(self._launch, stand_ins=STAND_INS)
        self._layers = Layers(residency, job, self._plan.tile, launch, self._should_stop)
        self._prepared_stats: Mapping[str, Any] = {}
        self._guiding_field: GuidingField | None = None
        self._has_prepared = False
        self._resumed: Mapping[str, int] = dict.fromkeys(("samples", "rays", "shadow_rays", "max_depth"), 0)

    @property
    def _devices(self) -> list[Device]:
        """The session's devices that take samples; none if a cluster takes them."""
        return self._residency.devices if self._cluster is None else []

    def image(self, keep_film: bool) -> RenderedImage:
        """Render the job; see `Session.render` for the return value and the exceptions."""
        denoiser = Denoiser() if self._job.denoise else None
        if line := effort_told(self._job):
            self._residency.tell(line)
        flat, memory = self._flat()
        with self._memory_held(may_hold=True):
            self._film = film = self._new_film(flat)
            self._check_devices()
            self._sums = keep_film or film.replicate_spp is not None or self._checkpoint is not None
            first = self._timed_layers(flat)
            taken = self._samples(flat, film)
            if first and taken.wrong and not taken.tally.all_failed:
                first = self._timed_layers(flat)  # they may be wrong too
            self._check_progress(taken.tally, film)
            image = self._image(flat, memory, film, first, taken, keep_film, denoiser)
            if taken.tally.all_failed and not taken.tally.complete:
                raise IncompleteRender(str(taken.tally.failures[-1]), image) from taken.tally.failures[-1]
            self._tell(outcome_told(self._job, flat, taken.tally, image))
        FurtherRenders(
            image,
            self._job,
            groups=group_names(flat) if self._job.light_groups else (),
            areas=self._layers.areas,
            render=lambda job: self._other(job, self._cluster).image(False),
            count_hits=lambda job, samples: self._other(job)._hit_counts(samples),
            field=cache(lambda: self._field_of(image, flat)),
            stopped=self._should_stop,
            tell=self._residency.tell,
        ).add()
        return image

    def _struct(self) -> npt.NDArray[np.void]:
        """The kernels' settings."""
        struct = self._settings.struct(self._plan.tile, self._job.integrator.fixed)
        if self._job.views:
            struct["views"], struct["view_rows"] = len(self._job.views), self._settings.height
        return struct

    def _field_of(self, image: RenderedImage, flat: FlatScene) -> GuidingField | None:
        """The field that guided the image.

        It is trained once more, to the bit, where workers of a cluster keep theirs, or a checkpoint had all samples.
        """
        if self._has_prepared or image.interrupted or not self._job.guided:
            return image.guiding_field
        with self._memory_held():
            self._prepared(flat)
        return self._guiding_field

    def _other(self, job: RenderJob, cluster: Cluster | None = None) -> JobRender:
        """The rendering of another job on the way to this one's image."""
        return JobRender(self._residency, job, None, self._should_stop, cluster=cluster)

    def _hit_counts(self, samples: int) -> npt.NDArray[np.uint32]:
        return self._layers.hit_counts(self._residency.flat(self._job), samples)

    def _tell(self, lines: Iterable[str]) -> None:
        for line in lines:
            self._residency.tell(line)

    def recorded(
        self,
        pipelines: Mapping[str, Pipeline],
        take: Callable[[Unit, UnitSums], None],
        finish: Callable[[DeviceWorker], None],
    ) -> Recorded:
        """Take the samples by kernels that record their paths, on one device; see `Session.recorded`."""
        flat, _ = self._flat()
        with self._memory_held():
            self._film = film = self._new_film(flat)
            prepared = self._prepared(flat)
            # Paths are written down one by one, but light paths of the whole image are traced as for a render
            whole = self._settings.width * self._settings.height * self._plan.samples
            launch = dataclasses.replace(
                self._launch,
                lanes=1,
                staged=False,
                samples=self._plan.samples,
                prepared=dataclasses.replace(self._launch, samples=whole),
            )
            pipeline = pipelines[prepared.pipeline.kernel]
            worker = self._residency.worker(
                self._residency.devices[0], prepared.flat, self._struct(), pipeline, launch, prepared.on_device
            )
            self._ready()
            counted = np.zeros(2, np.int64)

            def on_slice(samples: int, rays: int) -> None:
                counted[:] += samples, rays
                self._advance(*counted.tolist())

            try:
                for first in range(self._job.first_sample, self._job.first_sample + self._job.sample_count, _RECORDED):
                    count = min(_RECORDED, self._job.first_sample + self._job.sample_count - first)
                    unit = Unit(0, slot_count(*self._job.film_size, self._plan.tile), first, count, self._plan.tile)
                    found = worker.render(unit, on_slice, self._stops)
                    film.commit(unit, found)
                    take(unit, found)
                    if self._stops():
                        break
                finish(worker)
            finally:
                worker.release()
        member_of = member(self._residency.devices[0], worker)
        told = {"device": member_of.name, "driver": member_of.driver, **self._prepared_stats}
        return Recorded(flat, film, told, self._guiding_field)

    def developed(self) -> RenderedImage:
        """The image of the film that was begun, without further samples; see `Session.develop`."""
        flat, memory = self._flat()
        self._film = film = self._new_film(flat)
        lacking = self._plan.samples > 0
        self._want(Ledger(film.width, film.height))
        self._check_devices()
        first = self._timed_layers(flat)
        self._note_setup(time.perf_counter())
        taken = Taken.none(self._devices)
        image = self._image(flat, memory, film, first, taken, True, None, lacking)
        self._tell(outcome_told(self._job, flat, taken.tally, image))
        return image

    @contextmanager
    def _memory_held(self, *, may_hold: bool = False) -> Iterator[None]:
        """Enforce the memory limit; a job that would exceed it is refused before anything is allocated.

        Where that `may_hold` and there is the memory, a single device holds the film.
        """
        devices, checkpoint = self._devices, self._checkpoint
        most = most_slots(devices, self._settings.max_memory, self._settings.replicate_spp is not None)
        self._plan = dataclasses.replace(self._plan, most_slots=most)
        resumed = checkpoint is not None and checkpoint.loaded
        need = partial(needs, self._job, len(devices), checkpoint=checkpoint is not None, resumed=resumed)
        wanted = need(held=True)
        total = sum(wanted.values()) + wanted["a copy of what the device holds"]  # it takes as much itself
        limit = self._settings.max_memory
        prepares = limit is not None and bool(self._job.preparation)  # which needs memory later
        self._holds = may_hold and len(devices) == 1 and not prepares and total <= room(limit)
        wanted = wanted if self._holds else need(held=False)
        with limited(devices, self._settings.max_memory, wanted) as self._apart_bytes:
            if line := told(self._job):
                self._residency.tell(line)
            yield

    def _check_devices(self) -> None:
        """Open the devices, and note how long their compilers have run before."""
        check_lanes(self._settings, self._devices)
        self._compiled = sum(device.compile_seconds for device in self._devices)

    def _timed_layers(self, flat: FlatScene) -> _Arrays:
        with self._timed("aov_seconds"):
            return self._layers.rendered(flat)

    def _note_setup(self, end: float) -> None:
        self._seconds["setup_seconds"] = end - self._begin - self._seconds["aov_seconds"]

    def _samples(self, flat: FlatScene, film: Film) -> Taken:
        """Take the samples of the plan, after the integrator's preparation, until the error is as small as wanted."""
        devices = self._devices
        prepared = self._prepared(flat) if self._plan.samples and self._cluster is None else None
        self._note_setup(time.perf_counter())
        cpu = time.process_time()
        taken = self._run(flat, prepared, film, self._settings.error is not None)
        if self._started is not None:
            self._note_setup(self._started)
        wrong = self._cluster is None and self._dismissed(devices, taken.tally)
        return dataclasses.replace(taken, cpu_seconds=time.process_time() - cpu, wrong=wrong)

    def _image(
        self,
        flat: FlatScene,
        memory: Mapping[str, float],
        film: Film,
        first: _Arrays,
        taken: Taken,
        keep_film: bool,
        denoiser: Denoiser | None,
        lacking: bool = False,
    ) -> RenderedImage:
        """The image of a film, with layers and statistics; `lacking`: samples were left out on purpose."""
        job, tally, members = self._job, taken.tally, taken.members
        errors = self._found.errors if self._found else standard_error(film) if film.replicate_spp else None
        linear = film.mean() if keep_film else film.develop()
        layers = first | film_layers(film, errors, self._found)
        measured = {
            "load_seconds": self._seconds["read_seconds"] + self._seconds["flatten_seconds"],
            **self._seconds,
            **memory,
            "compile_seconds": sum(member.compile_seconds for member in members) - self._compiled,
            "build_seconds": max((member.build_seconds for member in members), default=0.0),
            "render_seconds": taken.finished - (self._started or taken.finished),
            "render_cpu_seconds": taken.cpu_seconds,
            "write_seconds": 0.0,
            "wall_seconds": time.perf_counter() - self._begin,
        }
        resumed, checkpoint = self._resumed, self._checkpoint
        stats = render_stats(job, flat, film, linear, tally, members, measured, resumed, checkpoint) | dict(taken.told)
        stats |= self._prepared_stats
        stats |= {"refit": True} if self._residency.refits else {}
        if errors is not None:
            stats |= error_stats(job, film, errors, self._found, tally.complete)
        denoised = self._denoised(denoiser, linear, layers, stats) if denoiser else None
        wanted = {name: layers[name] for name in job.aov if name in layers}
        mattes = {name: names for name, names in matte_names(job.scene).items() if name in wanted} if job.aov else {}
        incomplete = not tally.complete or lacking
        image = RenderedImage(linear, stats, film, incomplete, denoised, wanted, mattes, self._guiding_field)
        if "alpha" in wanted:
            stats["alpha_samples"] = alpha_samples(job.settings)
        if any(name in LABELS for name in wanted):
            areas: dict[str, dict[int, float]] = {name: self._layers.areas[name] for name in LABELS if name in wanted}
            image.labels = labels_told(job.scene, areas, {})
            stats["labels"] = {layer: [each.told() for each in some] for layer, some in image.labels.items()}
        return image

    def part(self, wanted: Ledger, check: Callable[[Mapping[str, Any]], None]) -> Film:
        """Render only some samples of some blocks of pixels.

        Parameters
        ----------
        wanted : Ledger
            A subset of the job's samples.
        check : callable
            Called with the request of the job's film before anything is rendered; it may raise.

        Returns
        -------
        Film
            It lacks some of the samples if `should_stop` returned True.
        """
        flat, _ = self._flat()
        check(self._request(flat))
        with self._memory_held():
            self._film = film = Film(wanted.width, wanted.height, self._request(flat))
            self._want(wanted)
            self._run(flat, None, film).tally.raise_failure()
        return film

    def refine(self) -> RunningFilm:
        """Add the missing samples to the film that was begun, or to a new one; see `Session.refine`."""
        settings = self._settings
        self._plan = dataclasses.replace(self._plan, gradual=True)
        self._launch = dataclasses.replace(self._launch, slice_seconds=_LIVE_SECONDS)
        flat, _ = self._flat()
        film = self._begun or RunningFilm(*self._job.film_size, {"replicate_spp": settings.replicate_spp})
        self._film, self._resumed = film, film.account()
        if film.ledger.samples:
            first = self._job.first_sample
            self._want(film.ledger.lacking(first, first + self._job.sample_count))
        with self._memory_held():
            devices = self._devices
            check_lanes(settings, devices)
            tally = self._run(flat, None, film, settings.error is not None).tally
        self._dismissed(devices, tally)
        if tally.all_failed and not tally.complete:
            raise tally.failures[-1]
        self._tell(failures_told(tally))
        return film

    def layers(self) -> _Arrays:
        """Render only the job's layers, except those that come from its film."""
        flat, _ = self._flat()
        return self._layers.rendered(flat)

    def _flat(self) -> tuple[FlatScene, dict[str, float]]:
        """The scene as arrays, and the memory that reading and flattening it took."""
        known = self._residency.has_read(self._job.scene)
        with self._timed("read_seconds"):
            if not known:
                with self._residency.stages.during("reading"):
                    self._job.scene.read_named()
        memory: dict[str, float] = {"read_peak_rss_bytes": peak_rss()}
        with self._timed("flatten_seconds"):
            flat = self._residency.flat(self._job)
        flattened = memory["read_peak_rss_bytes"] if known else peak_rss()
        memory |= {"flatten_peak_rss_bytes": flattened, "flat_bytes": flat.nbytes}
        self._tell(flat.messages_with(lost_light(self._job, flat)))
        if flat.film is not None and not self._job.settings.spectral:
            self._residency.tell("warning: the response of the camera counts with wavelengths only; set spectral")
        return flat, memory

    def _request(self, flat: FlatScene) -> dict[str, Any]:
        """The request of the film."""
        refits = {"refit": True} if self._residency.refits else {}
        return {**self._job.request(), "arrays_sha256": flat.sha256, **refits}

    def _new_film(self, flat: FlatScene) -> Film:
        """The film that receives the samples: the checkpoint's, the one that was begun, or an empty one."""
        job = self._job
        request = self._request(flat)
        samples = range(job.first_sample, job.first_sample + job.sample_count)
        if self._checkpoint is not None:
            film = self._checkpoint.begin(request, samples, job_stats(job, request))
            self._resumed = self._checkpoint.resumed
            self._plan = dataclasses.replace(self._plan, short_units=True)
        elif self._begun is not None:
            film, self._resumed = self._begun, self._begun.account()
            film.request = request
        else:
            return Film(*self._job.film_size, request)
        if film.ledger.samples:
            self._want(film.ledger.lacking(samples.start, samples.stop))
        return film

    def _want(self, wanted: Ledger) -> None:
        """Restrict the plan to some samples."""
        self._plan = dataclasses.replace(self._plan, wanted=wanted)
        self._total = self._plan.samples

    def _run(self, flat: FlatScene, prepared: Prepared | None, film: Film, until_converged: bool = False) -> Taken:
        """Take the samples of the plan; prepare the integrator first if `prepared` is None."""
        if self._plan.samples:
            with self._team(flat, prepared) as team:
                tally = self._take(team, film, until_converged)
                taken = Taken.of(tally, team, time.perf_counter())
        else:
            if until_converged:
                _, self._found = run_until_converged(self._plan, [], film, self._settings)
            taken = Taken.none(self._devices)
        if self._checkpoint is not None:
            self._checkpoint.finish()
        return taken

    def _take(self, team: Team, film: Film, until_converged: bool) -> Tally:
        """Have a team take the samples of the plan, or fewer if the error criterion is met earlier."""
        take = partial(
            run,
            should_stop=self._stops,
            tell=self._residency.tell,
            limits=team.limits,
            apart_bytes=self._apart_bytes,
            holds=self._holds,
            sums=self._sums,
        )
        if not until_converged:
            return take(self._plan, team.candidates, film, self._advance)
        tally, self._found = run_until_converged(self._plan, team.candidates, film, self._settings, take, self._advance)
        return tally

    def _team(self, flat: FlatScene, prepared: Prepared | None) -> AbstractContextManager[Team]:
        """The workers that take the samples."""
        if self._cluster is not None:
            self._residency.stages.begin("joining")
            return self._cluster.team(self._job, flat.sha256, self._ready)
        return self._device_team(prepared or self._prepared(flat))

    def _prepared(self, flat: FlatScene) -> Prepared:
        """The scene and kernels that the integrator renders with, after its preparation."""
        found = prepare(self._job, flat, self._residency, self._launch, self._stops)
        self._prepared_stats, self._guiding_field, self._has_prepared = found.stats, found.result, True
        return found

    def _stops(self) -> bool:
        if self._checkpoint is not None:
            self._checkpoint.tick()
        limit = self._settings.time_limit
        late = limit is not None and time.perf_counter() - self._begin >= limit
        return late or self._should_stop()

    def _advance(self, samples: int, rays: int) -> None:
        if self._on_progress is not None:
            begun = self._started or time.perf_counter()
            seconds = time.perf_counter() - begun
            resumed = self._resumed["samples"]
            total = resumed + self._total
            self._on_progress(Progress(resumed + samples, total, seconds, rays, self._film, resumed))

    def team(self) -> tuple[DeviceTeam, str]:
        """The session's devices for an external scheduler, and the hash of the scene's arrays.

        The caller must release the team.
        """
        flat, _ = self._flat()
        check_lanes(self._settings, self._residency.devices)
        return self._device_team(self._prepared(flat)), flat.sha256

    def _device_team(self, prepared: Prepared) -> DeviceTeam:
        residency = self._residency
        make = partial(
            residency.worker,
            flat=prepared.flat,
            settings=self._struct(),
            pipeline=prepared.pipeline,
            launch=dataclasses.replace(
                self._launch,
                samples=-(-self._plan.samples // len(residency.devices)) or 1,
                stand_ins=STAND_INS and prepared.on_device is None,
            ),
            on_device=prepared.on_device,
        )

        def ready(device: Device) -> DeviceWorker:
            worker = make(device)
            self._ready()
            return worker

        return DeviceTeam(residency.devices, ready, residency.restart, passes_probe)

    def _ready(self) -> None:
        """Note the time at which the first worker is ready."""
        self._residency.stages.end("joining")
        self._started = self._started or time.perf_counter()

    def _dismissed(self, devices: Sequence[Device], tally: Tally) -> bool:
        """Exclude devices that hung or were wrong from the session; returns whether any results were wrong."""
        for device, done in zip(devices, tally.workers, strict=True):
            if done.state in ("hung", "wrong"):
                self._residency.dismiss(device)
        return any(done.state == "wrong" for done in tally.workers)

    def _check_progress(self, tally: Tally, film: Film) -> None:
        """Raise an error with the reason if there is no sample at all, unless the render was stopped on request."""
        if tally.samples or film.ledger.samples:
            return
        if tally.all_failed:
            raise tally.failures[-1]
        if self._settings.time_limit is not None and not self._should_stop():
            raise RenderError(
                f"no sample was finished within {self._settings.time_limit:g} s, which includes set-up; increase the "
                "time limit"
            )

    def _denoised(
        self, denoiser: Denoiser, linear: npt.NDArray[np.float32], first: _Arrays, stats: dict[str, Any]
    ) -> npt.NDArray[np.float32]:
        """The denoised image; it is noted in the statistics."""
        begin = time.perf_counter()
        premultiplied = "alpha" in first and not self._job.scene.shows_environment
        coverage = first["alpha"][..., 0] if premultiplied else None
        denoised = denoiser(linear, first["albedo"], first["normal"], coverage)
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


@dataclass(frozen=True)
class Recorded:
    """What remains of a render by kernels that record their paths, beside the records.

    Attributes
    ----------
    flat : FlatScene
    film : Film
        The sums of the samples.
    told : mapping
        ``device`` and ``driver``, and what the integrator's preparation adds to the statistics of a render.
    guiding_field : GuidingField or None
        The field that guided the paths.
    """

    flat: FlatScene
    film: Film
    told: Mapping[str, Any]
    guiding_field: GuidingField | None


def _plan_of(job: RenderJob) -> Plan:
    """The plan for all of a job's samples."""
    settings = job.settings
    tile = largest_tile(settings.max_memory, settings.tile, settings.replicate_spp is not None)
    return Plan(
        *job.film_size,
        job.first_sample,
        job.sample_count,
        tile_side(tile, *job.film_size),
        job.integrator.pipeline.sample_by_sample,
        whole=settings.replicate_spp or 1,
    )
