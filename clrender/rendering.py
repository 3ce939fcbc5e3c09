"""The one function that ties all together: a scene, settings and devices become an image.

(Not ``render.py``: a module of that name would take the place of the function `clrender.render`.)
"""

from __future__ import annotations

import dataclasses
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from clrender.device import select
from clrender.device.source import kernels_sha256
from clrender.device.worker import Cut, DeviceWorker, Preparation
from clrender.film import Film
from clrender.flatten import FlatScene, flatten
from clrender.image_io import image_sha256, png_bytes, write_image
from clrender.integrators import INTEGRATORS
from clrender.radiosity.display import Display, looks
from clrender.radiosity.solution import Sought, solve_scene, summary
from clrender.schedule import Plan, Tally, run
from clrender.settings import RenderSettings, settings_for
from clrender.version import __version__
from clrender.work import tile_side

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
    """

    linear: npt.NDArray[np.float32]
    stats: dict[str, Any]
    film: Film
    interrupted: bool

    def save(self, path: str | Path, tone_map: str = "srgb", exposure: float = 0.0) -> None:
        """Write the image; the ending says how. `.film` keeps the exact sums.

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
            self.film.save(path, self.stats)
        else:
            write_image(path, self.linear, self.stats, tone_map, exposure)

    def _repr_png_(self) -> bytes:
        return png_bytes(self.linear)


def render(
    scene: Scene,
    *,
    device: str | int | Sequence[str | int] | None = None,
    size: tuple[int, int] | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
    notify: Callable[[str], None] | None = None,
    keep_film: bool = True,
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
    **settings
        Fields of `RenderSettings`; what is not given comes from the scene, then from the defaults.

    Returns
    -------
    RenderedImage

    Raises
    ------
    SceneError, UsageError
        When the scene or a setting makes no sense.
    DeviceError
        When no device works.
    RenderError
        When a device fails and no other is left.
    """
    begin = time.perf_counter()
    wanted = settings_for(scene, size, settings)
    tell = notify or (lambda line: None)
    flat = flatten(scene, wanted.width, wanted.height, wanted.light_choice)
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

    devices = select(device, notify=tell, alone=notify is not None)
    prepare: _Prepare | None = None
    if wanted.integrator == "radiosity":
        flat, prepare = _radiosity(scene, devices[0], wanted, tell, stops)
    workers = _workers(devices, flat, wanted, plan.tile, prepare)
    film = Film(wanted.width, wanted.height, {**wanted.request(), "scene_sha256": flat.sha256})
    started = time.perf_counter()

    def advance(samples: int, rays: int) -> None:
        if on_progress is not None:
            total = plan.width * plan.height * plan.spp
            on_progress(Progress(samples, total, time.perf_counter() - started, rays))

    try:
        tally = run(plan, workers, film, advance, stops)
    finally:
        for worker in workers:
            worker.release()
    finished = time.perf_counter()
    for failure in tally.failures:
        tell(f"warning: {failure}; its work was done by the others")
    linear = film.mean() if keep_film else film.develop()
    times = {
        "setup_seconds": started - begin,
        "load_seconds": loaded - begin,
        "compile_seconds": sum(each.compile_seconds for each in devices),
        "build_seconds": max(worker.build_seconds for worker in workers),
        "render_seconds": finished - started,
        "write_seconds": 0.0,
        "wall_seconds": time.perf_counter() - begin,
    }
    stats = _stats(scene, flat, wanted, film, linear, tally, workers, times)
    return RenderedImage(linear, stats, film, not tally.complete)


def _with_absorption(flat: FlatScene, absorption: float | None) -> FlatScene:
    if absorption is None:
        return flat
    materials = flat.arrays["materials"].copy()
    materials["color"][:, 3] = absorption
    return dataclasses.replace(flat, arrays={**flat.arrays, "materials": materials})


def _cut(wanted: RenderSettings) -> Cut:
    return Cut(wanted.lanes, wanted.work_group, wanted.samples_per_pass, wanted.traversal)


def _radiosity(
    scene: Scene, device: Device, wanted: RenderSettings, tell: Callable[[str], None], stops: Callable[[], bool]
) -> tuple[FlatScene, _Prepare]:
    """Radiosity is solved once, on one device; all of them show it."""
    sought = Sought(wanted.patches, wanted.patch_rays, seed=wanted.seed)
    size = (wanted.width, wanted.height)
    solution = solve_scene(scene, device, sought, size, _cut(wanted), wanted.light_choice, stops)
    tell(summary(solution))
    table = looks(solution, wanted.radiosity_display)
    return solution.flat, lambda worker: Display(worker, table, wanted.radiosity_display)


def _workers(
    devices: Sequence[Device], flat: FlatScene, wanted: RenderSettings, tile: int, prepare: _Prepare | None
) -> list[DeviceWorker]:
    cut, integrator = _cut(wanted), INTEGRATORS[wanted.integrator]
    return [DeviceWorker(each, flat, wanted.struct(tile), integrator, cut, prepare) for each in devices]


def _stats(
    scene: Scene,
    flat: FlatScene,
    wanted: RenderSettings,
    film: Film,
    linear: npt.NDArray[np.float32],
    tally: Tally,
    workers: Sequence[DeviceWorker],
    times: Mapping[str, float],
) -> dict[str, Any]:
    seconds = max(times["render_seconds"], 1e-9)
    return {
        "image_sha256": image_sha256(linear),
        "scene_sha256": scene.sha256(),
        "kernel_sha256": kernels_sha256(),
        "version": __version__,
        "width": wanted.width,
        "height": wanted.height,
        "spp": wanted.spp,
        "seed": wanted.seed,
        "integrator": wanted.integrator,
        "settings": {**wanted.request(), "spp": wanted.spp},
        "samples": tally.samples,
        "rays": tally.rays,
        "shadow_rays": tally.shadow_rays,
        "max_depth": tally.deepest,
        "nonfinite_samples": tally.samples - film.samples,
        **times,
        "msamples_per_second": tally.samples / seconds / 1e6,
        "mrays_per_second": tally.rays / seconds / 1e6,
        "peak_rss_bytes": _peak_rss(),
        "device_bytes": sum(worker.device.allocated_bytes for worker in workers),
        "triangles": flat.triangle_count,
        "devices": [
            {
                "name": worker.device.info.name,
                "driver": f"{worker.device.info.platform} {worker.device.info.driver}",
                "type": worker.device.info.type,
                "units": done.units,
                "samples": done.samples,
                "seconds": worker.busy_seconds,
                "requeued": done.requeued,
            }
            for worker, done in zip(workers, tally.workers, strict=True)
        ],
    }


def _peak_rss() -> int:
    """Most memory this process ever held, bytes; 0 where the system does not tell."""
    try:
        import resource
    except ImportError:
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
