"""The one function that ties all together: a scene, settings and devices become an image.

(Not ``render.py``: a module of that name would take the place of the function `clrender.render`.)
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from clrender.aov import GUIDE_SAMPLES, GUIDES, LAYER_SAMPLES, check_aovs, exr_channels, first_hits
from clrender.device import select
from clrender.device.worker import DeviceWorker, LaunchConfig, Preparation, most_lanes
from clrender.errors import UsageError
from clrender.film import Film
from clrender.film.unit import tile_side
from clrender.flatten import FlatScene, flatten
from clrender.image.denoise import Denoiser
from clrender.image.files import image_sha256, png_bytes, write_image
from clrender.integrators import INTEGRATORS, Integrator
from clrender.render_stats import render_stats
from clrender.scheduling.run import Plan, run
from clrender.settings import RenderSettings, settings_for

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

__all__ = ["Progress", "RenderedImage", "render"]

_Prepare: TypeAlias = Callable[[DeviceWorker], Preparation]


@dataclass(frozen=True)
class Progress:
    """How far a render is: samples done and wanted, rays, seconds since the first launch."""

    samples_done: int
    samples_total: int
    seconds: float
    rays: int

    @property
    def fraction(self) -> float:
        """Between 0 and 1."""
        return self.samples_done / self.samples_total if self.samples_total else 1.0

    @property
    def samples_per_second(self) -> float:
        """Mean so far."""
        return self.samples_done / self.seconds if self.seconds > 0.0 else 0.0

    @property
    def seconds_left(self) -> float:
        """At the mean speed so far; infinite before the first sample."""
        speed = self.samples_per_second
        return (self.samples_total - self.samples_done) / speed if speed > 0.0 else float("inf")


@dataclass
class RenderedImage:
    """A finished (or interrupted) render.

    Attributes
    ----------
    linear : (height, width, 3) float32
        Radiance, linear Rec. 709.
    stats : dict
        What ``--stats`` writes.
    film : Film
        The exact sums; released for huge images unless they were asked for.
    interrupted : bool
        Some of the samples asked for are missing.
    denoised : (height, width, 3) float32 or None
        The image without noise, where that was asked for: what `save` writes.
    aovs : dict of str to (height, width, channels) float32
        The layers asked for; `clrender.aov.first_hits` says what each holds.
    """

    linear: npt.NDArray[np.float32]
    stats: dict[str, Any]
    film: Film
    interrupted: bool
    denoised: npt.NDArray[np.float32] | None = None
    aovs: dict[str, npt.NDArray[np.float32]] = field(default_factory=dict)

    @property
    def picture(self) -> npt.NDArray[np.float32]:
        """What is written and shown: the denoised image where there is one, else the linear one."""
        return self.linear if self.denoised is None else self.denoised

    def save(self, path: str | Path, tone_map: str = "srgb", exposure: float = 0.0) -> None:
        """Write the image; the ending says how. `.film` keeps the exact sums, `.exr` the layers too.

        Parameters
        ----------
        path : str or Path
        tone_map : str
            For display formats.
        exposure : float
            In stops, for display formats.

        Raises
        ------
        UsageError
            When the ending or the tone map is unknown.
        RenderError
            When the file cannot be written; nothing is left half-written.
        """
        if Path(path).suffix.lower() == ".film":
            told = {name: value for name, value in self.stats.items() if not name.startswith("denois")}
            self.film.save(path, {**told, "denoised": False})
        else:
            write_image(path, self.picture, self.stats, tone_map, exposure, exr_channels(self.aovs))

    def _repr_png_(self) -> bytes:
        return png_bytes(self.picture)


def render(
    scene: Scene,
    *,
    device: str | int | Sequence[str | int] | None = None,
    size: tuple[int, int] | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
    notify: Callable[[str], None] | None = None,
    keep_film: bool = True,
    aov: Iterable[str] = (),
    denoise: bool = False,
    **settings: Any,
) -> RenderedImage:
    """Render a scene.

    Parameters
    ----------
    scene : Scene
    device : str, int, sequence of them, optional
        As ``--device``; default: ``CLRENDER_DEVICE``, else the best that works.
    size : (int, int), optional
        Width and height; default: the scene's.
    on_progress : callable, optional
        Called in this thread after each launch.
    should_stop : callable, optional
        Asked between launches; a yes ends the render with what is done.
    notify : callable, optional
        Told in a line which device was chosen, and of anything to know about it or the scene.
    keep_film : bool
        Keep the exact sums, 52 bytes a pixel, in the result.
    aov : iterable of str
        Layers beside the image, of `clrender.aov.AOVS`.
    denoise : bool
        Denoise the image with Open Image Denoise, into `RenderedImage.denoised`; `linear` stays as it is.
    **settings
        Fields of `RenderSettings`; what is not given comes from the scene, then from the defaults.

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
        When a device fails and no other is left.
    """
    begin = time.perf_counter()
    wanted = settings_for(scene, size, settings)
    layers = check_aovs(aov)
    denoiser = Denoiser() if denoise else None
    tell = notify or (lambda line: None)
    flat = flatten(scene, wanted.width, wanted.height, _light_choice(wanted))
    for warning in flat.warnings:
        tell(warning)
    flat = _with_absorption(flat, wanted.absorption)
    loaded = time.perf_counter()
    sample_by_sample = INTEGRATORS[wanted.integrator].sample_by_sample
    side = tile_side(wanted.tile, wanted.width, wanted.height)
    plan = Plan(wanted.width, wanted.height, wanted.spp, side, sample_by_sample)

    def stops() -> bool:
        late = wanted.time_limit is not None and time.perf_counter() - begin >= wanted.time_limit
        return late or (should_stop is not None and should_stop())

    devices = select(device, notify=tell)
    for each in devices:
        if (wanted.lanes or 1) > (limit := most_lanes(each)):
            title = each.info.title
            raise UsageError(
                f"lanes is {wanted.lanes}; {title} takes at most {limit}: leave it out, or choose another device"
            )
    prepared = time.perf_counter()
    # Before the image, so that one stopped early has its layers whole.
    asked, most = [*layers, *(GUIDES if denoise else ())], LAYER_SAMPLES if layers else GUIDE_SAMPLES
    first = first_hits(devices, flat, wanted, asked, _cut(wanted), most, should_stop, tell)
    first_seconds = time.perf_counter() - prepared
    integrator, prepare = INTEGRATORS[wanted.integrator], _prepared(flat, wanted)
    if wanted.integrator == "radiosity":
        flat, integrator, prepare = _radiosity(scene, devices[0], wanted, tell, stops)
    workers = [
        DeviceWorker(each, flat, wanted.struct(plan.tile), integrator, _cut(wanted), prepare) for each in devices
    ]
    film = Film(wanted.width, wanted.height, {**wanted.request(), "scene_sha256": flat.sha256})
    started, cpu_started = time.perf_counter(), time.process_time()

    def advance(samples: int, rays: int) -> None:
        if on_progress is not None:
            total = plan.width * plan.height * plan.spp
            on_progress(Progress(samples, total, time.perf_counter() - started, rays))

    try:
        tally = run(plan, workers, film, advance, stops)
    finally:
        for worker in workers:
            worker.release()
    finished, cpu_finished = time.perf_counter(), time.process_time()
    for failure in tally.failures:
        tell(f"warning: {failure}; its work was done by the others")
    linear = film.mean() if keep_film else film.develop()
    first["samples"] = film.counts[..., None].astype(np.float32)
    times = {
        "setup_seconds": started - begin - first_seconds,
        "load_seconds": loaded - begin,
        "compile_seconds": sum(each.compile_seconds for each in devices),
        "build_seconds": max(worker.build_seconds for worker in workers),
        "aov_seconds": first_seconds,
        "render_seconds": finished - started,
        "render_cpu_seconds": cpu_finished - cpu_started,
        "write_seconds": 0.0,
        "wall_seconds": time.perf_counter() - begin,
    }
    stats = render_stats(scene, flat, wanted, film, linear, tally, workers, times)
    denoised = _denoised(denoiser, linear, first, stats) if denoiser else None
    return RenderedImage(linear, stats, film, not tally.complete, denoised, {name: first[name] for name in layers})


def _denoised(
    denoiser: Denoiser,
    linear: npt.NDArray[np.float32],
    first: Mapping[str, npt.NDArray[np.float32]],
    stats: dict[str, Any],
) -> npt.NDArray[np.float32]:
    """The image without noise; the numbers say so."""
    begin = time.perf_counter()
    denoised = denoiser(linear, first["albedo"], first["normal"])
    denoiser.release()
    seconds = time.perf_counter() - begin
    stats |= {"denoised": True, "denoiser": denoiser.name, "denoised_sha256": image_sha256(denoised)}
    stats |= {"denoise_seconds": seconds, "wall_seconds": stats["wall_seconds"] + seconds}
    return denoised


def _light_choice(wanted: RenderSettings) -> str:
    """As asked for; but photons start at lights and not at points, for which a tree of lights has no answer."""
    if wanted.integrator != "photon":
        return wanted.light_sampler
    if wanted.light_sampler == "bvh":
        raise UsageError("light_sampler is 'bvh'; the integrator photon takes auto, power or uniform")
    return "uniform" if wanted.light_sampler == "uniform" else "power"


def _with_absorption(flat: FlatScene, absorption: float | None) -> FlatScene:
    if absorption is None:
        return flat
    materials = flat.arrays["materials"].copy()
    materials["color"][:, 3] = absorption
    return dataclasses.replace(flat, arrays={**flat.arrays, "materials": materials})


def _cut(wanted: RenderSettings) -> LaunchConfig:
    return LaunchConfig(wanted.lanes, wanted.work_group, wanted.samples_per_pass, wanted.traversal)


def _radiosity(
    scene: Scene, device: Device, wanted: RenderSettings, tell: Callable[[str], None], stops: Callable[[], bool]
) -> tuple[FlatScene, Integrator, _Prepare]:
    """Radiosity is solved once, on one device; all of them show it."""
    # Here, because no other render should wait for what only this one imports.
    from clrender.radiosity.atlas import atlas_of
    from clrender.radiosity.display import GATHER, Display, Gather, looks
    from clrender.radiosity.solution import RadiositySettings, solve_scene, summary

    gathered = wanted.radiosity_display == "gather"
    sought = RadiositySettings(wanted.patches, wanted.patch_rays, seed=wanted.seed, gathered=gathered)
    size = (wanted.width, wanted.height)
    solution = solve_scene(scene, device, sought, size, _cut(wanted), wanted.light_sampler, stops)
    tell(summary(solution))
    if gathered and solution.complete:
        whole = solution.patches.whole(*size, wanted.light_sampler)
        atlas = atlas_of(solution.patches, solution.indirect, solution.used, solution.open_share)
        return whole, GATHER, partial(Gather, atlas=atlas)
    table = looks(solution, wanted.radiosity_display)
    return solution.flat, INTEGRATORS["radiosity"], partial(Display, table=table)


def _prepared(flat: FlatScene, wanted: RenderSettings) -> _Prepare | None:
    if wanted.integrator != "photon":
        return None
    from clrender.photon_map import PhotonMaps

    return partial(PhotonMaps, flat=flat, photons=wanted.photons, radius=wanted.photon_radius)
