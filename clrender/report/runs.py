"""Renders for the report: all settings in turns, a reference, and one core in a separate process."""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

import clrender
from clrender.image.compare import RELATIVE_FLOOR, relative_squared_error
from clrender.report.machine_load import MachineLoad
from clrender.report.one_core import one_core_runs
from clrender.report.plan import (
    LIMIT,
    ONE_CORE,
    REFERENCE_SAMPLES,
    SCENE,
    SPECS,
    Spec,
    one_core_turns,
    turns_of,
    work_of,
)
from clrender.report.results import Results, Row, Run
from clrender.report.termination import termination_for

if TYPE_CHECKING:
    from clrender.rendering.rendered_image import Progress, RenderedImage
    from clrender.rendering.session import Session
    from clrender.scene import Scene

__all__ = ["Measured", "Renderer", "Stopped", "measure"]

_REFERENCE_SEEDS: Final = (2**31, 2**31 + 1)
_SECONDS_APART: Final = 10.0
_Image = npt.NDArray[Any]


class Stopped(Exception):
    """The user asked to stop."""


@dataclass
class Renderer:
    """Renders, reports progress, and stops on request.

    Attributes
    ----------
    size : (int, int)
    session : Session
        Renders everything but the runs on one core.
    device : str or None
        As for ``--device``, for the runs on one core.
    should_stop : callable
    say : callable
        Receives a line of text per render.
    total : int
        Samples per pixel of all renders, for progress.
    """

    size: tuple[int, int]
    session: Session
    device: str | None
    should_stop: Callable[[], bool]
    say: Callable[[str], None]
    total: int = 1
    done: int = 0

    def image(self, scene: Scene, what: str, spp: int, **settings: Any) -> RenderedImage:
        """One render.

        Raises
        ------
        Stopped
        """
        next_line = _SECONDS_APART

        def on_progress(progress: Progress) -> None:
            nonlocal next_line
            if progress.seconds >= next_line:
                next_line += _SECONDS_APART
                self.say(f"{self._share(spp * progress.fraction):4.0%}  {what}: {progress.fraction:.0%}")

        image = self.session.render(
            scene,
            size=self.size,
            spp=spp,
            should_stop=self.should_stop,
            on_progress=on_progress,
            code="fast",
            **settings,
        )
        if image.interrupted or self.should_stop():
            raise Stopped
        self.finished(what, spp, image.stats["render_seconds"])
        return image

    def finished(self, what: str, spp: int, seconds: float) -> None:
        """Report that a render is done."""
        self.done += spp
        self.say(f"{self._share(0.0):4.0%}  {what}: {seconds:.2f} s")

    def _share(self, further: float) -> float:
        return min((self.done + further) / self.total, 1.0)


@dataclass
class Measured:
    """Results, and the images for the figures.

    Attributes
    ----------
    results : Results
    images : dict
        Linear images by name: the first run of each row, ``reference``, and those only for figures.
    """

    results: Results
    images: dict[str, _Image] = field(default_factory=dict)


@dataclass(frozen=True)
class Reference:
    """Mean of two renders with many samples; their difference gives its own relMSE."""

    mean: _Image
    noise: float

    def judge(self, image: _Image) -> dict[str, float]:
        """Compute `noise`, `display_error`, `median_ratio` and `mean` of a `Run`.

        Image and reference are independent, so subtracting the reference's relMSE leaves an unbiased estimate of the
        image's.
        """
        lit = self.mean > RELATIVE_FLOOR
        shown = np.sqrt(np.clip(image, 0.0, 1.0)) - np.sqrt(np.clip(self.mean, 0.0, 1.0))
        return {
            "noise": relative_squared_error(image - self.mean, self.mean) - self.noise,
            "display_error": float(np.sqrt((shown**2).mean())),
            "median_ratio": float(np.median(image[lit] / self.mean[lit])) if lit.any() else 1.0,
            "mean": float(image.mean()),
        }


def measure(renderer: Renderer, quick: bool) -> Measured:
    """Render everything.

    Parameters
    ----------
    renderer : Renderer
    quick : bool
        Fewer runs.

    Raises
    ------
    ClrenderError
        If nothing can be rendered.
    Stopped
        If the user asks to stop.
    """
    begun = time.perf_counter()
    scene = clrender.load(SCENE)
    renderer.total = work_of(quick)
    renderer.image(scene, "preparing", 1)
    terminations = _terminations(renderer, scene)
    references = [
        renderer.image(scene, f"reference {i + 1} of 2", REFERENCE_SAMPLES // 2, seed=seed)
        for i, seed in enumerate(_REFERENCE_SEEDS)
    ]
    halves = [image.linear.astype(np.float64) for image in references]
    mean = (halves[0] + halves[1]) / 2.0
    reference = Reference(mean, relative_squared_error((halves[0] - halves[1]) / 2.0, mean))
    images: dict[str, _Image] = {"reference": mean}
    device = references[0].stats["devices"][0]
    cores = _cores() if all(each["type"] == "cpu" for each in references[0].stats["devices"]) else 0
    rows = {name: _row(name, spec, terminations[spec.deepest], cores, scene) for name, spec in SPECS.items()}
    load = MachineLoad()
    no_one_core = _turns(renderer, scene, rows, reference, images, quick, device["driver"])
    others = load.share()
    limited = [
        renderer.image(scene, f"at most {LIMIT} scattering events", 16, seed=900 + turn, max_depth=LIMIT)
        for turn in range(turns_of(16, quick))
    ]
    emitted = renderer.image(scene, "lights only", 16, max_depth=0)
    _figures(renderer, scene, images, quick)
    results = Results(
        *renderer.size, quick, device["name"], device["driver"], cores, rows, no_one_core, float(mean.mean()),
        reference.noise, REFERENCE_SAMPLES, float(emitted.linear.mean()), float(images["direct"].mean()),
        [float(image.linear.mean()) for image in limited], LIMIT,
        time.perf_counter() - begun, others,
    )  # fmt: skip
    return Measured(results, images)


def _row(name: str, spec: Spec, termination: float | None, cores: int, scene: Scene) -> Row:
    colors = [each.reflectance for each in scene.materials.values() if each.type == "lambert"]
    brightest = max(max(color) for color in colors if isinstance(color, tuple))
    growth = 0.0 if termination is None else brightest**2 / (1.0 - termination)
    return Row(name, spec.samples, spec.shadow_rays, termination, cores, growth)


def _turns(
    renderer: Renderer, scene: Scene, rows: dict[str, Row], reference: Reference, images: dict[str, _Image],
    quick: bool, driver: str,
) -> str:  # fmt: skip
    """Run all settings in turns, so that other load affects all alike; returns why one core was left out, or ""."""
    no_one_core = (
        "" if driver.startswith("Portable Computing Language") else f"{driver} cannot be restricted to one core."
    )
    if rows["base"].cores == 1:
        no_one_core = "This machine has only one core."
    for turn in range(max(turns_of(spec.samples, quick) for spec in SPECS.values())):
        for number, (name, spec) in enumerate(SPECS.items()):
            if turn >= turns_of(spec.samples, quick):
                continue
            row, seed = rows[name], 1000 * (number + 1) + turn
            image = renderer.image(scene, f"turn {turn + 1}, {name}", spec.samples, seed=seed, **settings_of(row))
            row.runs.append(_run(image.stats, row.cores, seed, reference.judge(image.linear)))
            if turn == 0:
                images[name] = image.linear
        if not no_one_core and turn < one_core_turns(quick):
            _one_core(renderer, rows, turn)
    return no_one_core


def _one_core(renderer: Renderer, rows: dict[str, Row], turn: int) -> None:
    twins = {name: rows[twin] for name, twin in ONE_CORE.items()}
    wanted = [{"spp": row.samples, "seed": row.runs[turn].seed, **settings_of(row)} for row in twins.values()]
    all_stats = one_core_runs(SCENE, renderer.size, renderer.device, wanted, renderer.should_stop)
    if all_stats is None:
        raise Stopped
    for (name, twin), stats in zip(twins.items(), all_stats, strict=True):
        row = rows.setdefault(name, dataclasses.replace(twin, name=name, cores=1, runs=[]))
        # The same seed gives the same bits, as the hash confirms: errors need not be measured again.
        run = twin.runs[turn]
        judged = {
            "noise": run.noise,
            "display_error": run.display_error,
            "median_ratio": run.median_ratio,
            "mean": run.mean,
        }
        row.runs.append(_run(stats, 1, run.seed, judged))
        renderer.finished(f"turn {turn + 1}, {name}", twin.samples, stats["render_seconds"])


def settings_of(row: Row) -> dict[str, Any]:
    """Settings of `clrender.render` for a row, without samples and seed."""
    roulette = {} if row.termination is None else {"roulette": "constant", "termination": row.termination}
    return {"shadow_rays": row.shadow_rays, **roulette}


def _run(stats: dict[str, Any], cores: int, seed: int, judged: dict[str, float]) -> Run:
    seconds, cpu = stats["render_seconds"], stats["render_cpu_seconds"]
    return Run(
        seed, seconds, cpu, cpu / cores if cores else seconds, stats["samples"], stats["rays"] - stats["shadow_rays"],
        stats["shadow_rays"], stats["max_depth"], **judged, sha256=stats["image_sha256"],
    )  # fmt: skip


def _terminations(renderer: Renderer, scene: Scene) -> dict[int | None, float | None]:
    """Probability by desired deepest path. A short render measures how many paths end other than by roulette."""
    probe = renderer.image(scene, "finding termination probabilities", 4, roulette="constant", termination=0.5).stats
    rays = probe["rays"] - probe["shadow_rays"]
    goes_on = (1.0 - probe["samples"] / rays) / 0.5  # the mean length of geometric paths is 1 / (1 - survival)
    paths = 16 * renderer.size[0] * renderer.size[1]
    wanted = {spec.deepest for spec in SPECS.values() if spec.deepest is not None}
    return {None: None, **{deepest: round(termination_for(deepest, paths, goes_on), 4) for deepest in wanted}}


def _figures(renderer: Renderer, scene: Scene, images: dict[str, _Image], quick: bool) -> None:
    """Images for figures that no row provides."""
    fine = 64 if quick else 128
    images["direct"] = renderer.image(scene, "direct light only", fine, integrator="direct").linear
    images["mirror"] = renderer.image(clrender.load("room-mirror"), "mirror sphere", fine).linear
    room = clrender.load("room")
    images["path"] = renderer.image(room, "room by path tracing", fine).linear
    images["whitted"] = renderer.image(room, "room by Whitted's ray tracing", 16, integrator="whitted").linear


def _cores() -> int:
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on this system
        return os.cpu_count() or 1
