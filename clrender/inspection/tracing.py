"""`paths()`: the light paths of a pixel, traced by the integrator's own kernels."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from clrender import layout
from clrender.errors import RenderError, UsageError
from clrender.files.kernel_hash import kernels_sha256
from clrender.film.fixed_point import add_words, subtract_words, to_float64
from clrender.inspection.light_path import Splats
from clrender.inspection.names import Names
from clrender.inspection.pipelines import PIPELINES, check_integrator
from clrender.inspection.pixel_paths import PixelPaths, check_pixel
from clrender.inspection.reading import (
    as_rows,
    counts,
    highest,
    light_path,
    luminance,
    sample_values,
    splat,
    splat_values,
    written,
)
from clrender.inspection.surroundings import surroundings_of
from clrender.rendering.job import RenderJob
from clrender.rendering.session import Session
from clrender.rendering.telling import once
from clrender.version import __version__

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.device.worker import DeviceWorker
    from clrender.film.unit import Unit, UnitSums
    from clrender.rendering.rendered_image import Progress
    from clrender.scene import Scene

__all__ = ["SAMPLES", "check_settings", "paths", "paths_in"]

SAMPLES: Final = 256
"""Samples whose paths are kept by default."""

_RECORDED: Final = 256
"""Light paths that are written down together."""

_NOT_OF_A_PIXEL: Final = ("crop", "time_limit", "error")
"""Settings that say which samples are taken of which pixels."""


def paths(
    scene: Scene,
    pixel: tuple[int, int],
    *,
    samples: int | None = None,
    surroundings: bool = False,
    device: str | int | Device | Sequence[str | int | Device] | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
    notify: Callable[[str], None] | None = None,
    **settings: Any,
) -> PixelPaths:
    """Trace the light paths of a pixel: every vertex, density, weight and contribution, as the integrator has them.

    The paths are those of a render with the same settings, of all samples of the pixel. What they contribute adds up
    to the pixel of that render, bit for bit; with `bdpt` together with what paths from lights that the camera sees
    bring to it.

    Parameters
    ----------
    scene : Scene
    pixel : (int, int)
        Column and row, from (0, 0) at the upper left.
    samples : int, optional
        Number of samples whose vertices are kept, those that contribute most; default: 256. All are traced. With `bdpt`
        also the number of paths from lights that are kept beside them.
    surroundings : bool
        Whether to render pictures and points of the scene as well, for a page.
    device : str, int, Device, sequence of them, optional
        See `clrender.render`; the first traces the paths.
    on_progress, should_stop : callable, optional
        See `Session.render`.
    notify : callable, optional
        See `Session`.
    **settings
        See `clrender.render`: ``size``, ``plugins``, ``guiding_field`` and the fields of `RenderSettings`. The
        integrator is ``path``, ``direct``, ``whitted`` or ``bdpt``.

    Returns
    -------
    PixelPaths

    Raises
    ------
    SceneError, UsageError, DeviceError, RenderError
        See `Session.render`. `UsageError` also when there is no such pixel, or for another integrator.

    Examples
    --------
    >>> found = clrender.paths(clrender.load("caustic"), (400, 300), spp=64)  # doctest: +SKIP
    >>> found.samples[0].value  # of the sample that contributes most  # doctest: +SKIP
    """
    job = RenderJob.of(scene, **check_settings(settings))
    with Session(device, notify=once(notify)) as session:
        return paths_in(session, job, pixel, samples, surroundings, on_progress, should_stop)


def check_settings(settings: dict[str, Any]) -> dict[str, Any]:
    """Check that no setting says which pixels or samples there are, or asks for more than paths.

    Raises
    ------
    UsageError
    """
    more = ("aov", "denoise", "light_groups", "amodal", "spectrum")
    for name in (*_NOT_OF_A_PIXEL, *more):
        if settings.get(name):
            raise UsageError(f"{name} has no effect on the light paths of a pixel; leave it out")
    return settings


def paths_in(
    session: Session,
    job: RenderJob,
    pixel: tuple[int, int],
    samples: int | None = None,
    surroundings: bool = False,
    on_progress: Callable[[Progress], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> PixelPaths:
    """Trace the light paths of a pixel in a session; see `paths`.

    Parameters
    ----------
    session : Session
    job : RenderJob
        The render of the whole image.
    pixel, samples, surroundings, on_progress, should_stop
        See `paths`.
    """
    settings = job.settings
    check_integrator(settings.integrator)
    x, y = check_pixel(pixel, settings.width, settings.height)
    most = SAMPLES if samples is None else samples
    if isinstance(most, bool) or not isinstance(most, (int, np.integer)) or most < 1:
        raise UsageError(f"samples is {samples!r}, but must be a whole number from 1 on")
    single = dataclasses.replace(job, settings=dataclasses.replace(settings, crop=(x, y, 1, 1)))
    kept = _Kept(int(most))
    recorded = session.recorded(
        single, PIPELINES, kept.take, kept.finish, on_progress=on_progress, should_stop=should_stop
    )
    values = kept.values()
    if len(values) < job.sample_count:
        raise RenderError("the light paths are not complete: they were stopped early")
    radiance = recorded.film.mean()[0, 0]
    guided = bool(recorded.told.get("guided", False))
    about = {
        "scene": job.scene.source,
        "scene_sha256": job.scene.sha256(),
        "kernel_sha256": kernels_sha256(),
        "version": __version__,
        "integrator": settings.integrator,
        "guided": guided,
        "spectral": settings.spectral,
        "width": settings.width,
        "height": settings.height,
        "seed": settings.seed,
        "spp": job.sample_count,
        "device": recorded.told["device"],
        "driver": recorded.told["driver"],
    }
    names, flat = Names(job.scene, recorded.flat), recorded.flat
    bright = luminance(values)
    total = float(bright[counts(values)].sum()) + kept.splatted()
    splats = kept.splats(names, flat.origin, total)
    found = [
        light_path(
            number,
            values[number],
            None if splats is None else splats.values[number],
            rows,
            names,
            flat.origin,
            float(bright[number]) / total if total and np.isfinite(bright[number]) else 0.0,
            settings.integrator,
            settings.spectral,
        )
        for number, rows in kept.best()
    ]
    around = surroundings_of(session, job, (x, y), recorded, should_stop) if surroundings else None
    lost = int(len(values) - np.count_nonzero(counts(values)))
    return PixelPaths(about, (x, y), radiance, values, lost, tuple(found), splats, around)


class _Kept:
    """Values of all samples, and the records of those that contribute most; and what light paths brought."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._values: list[npt.NDArray[np.float32]] = []
        self._rows: dict[int, npt.NDArray[np.uint32]] = {}
        self._best = np.zeros((0, 3), np.float32)
        self._brought: list[npt.NDArray[np.float32]] = []
        self._sums = np.zeros((2, 3, 2), np.uint64)  # of light paths, and of all
        self._listed = np.zeros((0, 1 + layout.SPLAT_WORDS), np.uint32)
        self._splat_count = 0
        self._splat_rows: list[npt.NDArray[np.uint32]] = []

    def take(self, unit: Unit, sums: UnitSums) -> None:
        """Take a unit of samples."""
        if sums.records is None:
            return  # it was stopped before the first sample
        found, complete = sample_values(sums.records)
        found = np.where(complete[:, None], found, np.float32(np.nan))
        self._values.append(found)
        if sums.splats is not None:
            # Of samples that are left out nothing counts
            brought = np.where(counts(found)[:, None, None], _words(sums.splats), np.uint64(0))
            self._brought.append(_floats(brought))
            for each in brought:
                add_words(self._sums[0], each)
            add_words(self._sums[1], _words(sums.sums[0]))
        if sums.listed is not None:
            listed = sums.listed[counts(found)[sums.listed[:, 0] - np.uint32(unit.first_sample)]]
            self._splat_count += len(listed)
            listed = np.concatenate([self._listed, listed])
            self._listed = listed[highest(splat_values(listed), np.ones(len(listed), np.bool_), self._most)]
        of_unit = dict(enumerate(as_rows(sums.records), unit.first_sample))
        numbers, values = [*self._rows, *of_unit], np.concatenate([self._best, found])
        order = highest(values, counts(values), self._most)
        self._best = values[order]
        # Most rows are empty: only those that were written stay in memory
        self._rows = {
            number: self._rows[number] if number in self._rows else written(of_unit[number])
            for number in (numbers[place] for place in order.tolist())
        }

    def values(self) -> npt.NDArray[np.float32]:
        """What each sample adds to the sum of its pixel, (n, 3) float32."""
        return np.concatenate(self._values) if self._values else np.zeros((0, 3), np.float32)

    def finish(self, worker: DeviceWorker) -> None:
        """Have the light paths that brought most written down."""
        for first in range(0, len(self._listed), _RECORDED):  # 48 kB each, of which few are written
            rows = worker.recorded_splats(self._listed[first : first + _RECORDED])
            self._splat_rows += [written(each) for each in rows]

    def splatted(self) -> float:
        """Luminance of all that light paths brought."""
        return sum(float(luminance(each).sum()) for each in self._brought)

    def splats(self, names: Names, origin: Sequence[float], total: float) -> Splats | None:
        """What light paths that the camera sees brought, of a pixel of so much luminance; None: there are none."""
        if not self._brought:
            return None
        by_camera = self._sums[1].copy()
        subtract_words(by_camera, self._sums[0])
        count = max(int(counts(self.values()).sum()), 1)
        shares = luminance(splat_values(self._listed)) / total if total else np.zeros(len(self._listed))
        paths = tuple(
            splat(each, rows, names, origin, float(share))
            for each, rows, share in zip(self._listed, self._splat_rows, shares, strict=True)
        )
        splatted, by_camera = _floats(self._sums[0], count), _floats(by_camera, count)
        return Splats(np.concatenate(self._brought), splatted, by_camera, self._splat_count, paths)

    def best(self) -> list[tuple[int, npt.NDArray[np.uint32]]]:
        """Numbers and rows of the samples that contribute most, in that order."""
        return list(self._rows.items())


def _words(halves: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint64]:
    """128-bit sums as the film has them, (..., 4) uint32, as (..., 2) uint64."""
    words: npt.NDArray[np.uint64] = np.ascontiguousarray(halves, "<u4").view("<u8").astype(np.uint64)
    return words


def _floats(sums: npt.NDArray[np.uint64], count: int = 1) -> npt.NDArray[np.float32]:
    """Sums over `count` samples as means, rounded as those of a film."""
    return (to_float64(sums) / count).astype(np.float32)
