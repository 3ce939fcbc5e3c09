"""Tests whether integrators agree on a scene: each renders independent batches, and each pair is compared."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from clrender.agreement.batches import LEVEL, Batches, Pair, compare_batches, tile_means
from clrender.errors import RenderError, UsageError
from clrender.flatten.supported import check_materials
from clrender.integrators import INTEGRATORS
from clrender.rendering.rendered_image import Progress, RenderedImage
from clrender.rendering.session import Session
from clrender.settings import settings_for, settings_of
from clrender.wording import quoted, suggestion

if TYPE_CHECKING:
    from clrender.scene import Scene

__all__ = ["check_integrators", "common_indirect_rays", "compare_integrators", "labels"]


def compare_integrators(
    scene: Scene,
    integrators: Sequence[str],
    *,
    spp: int = 256,
    batches: int = 16,
    size: tuple[int, int] | None = None,
    seed: int = 0,
    tile_size: int = 8,
    device: str | int | Sequence[str | int] | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    notify: Callable[[str], None] | None = None,
    **settings: Any,
) -> tuple[list[Batches], list[Pair]]:
    """Render a scene with several integrators and test, for each pair, whether their images have the same mean.

    Parameters
    ----------
    scene : Scene
    integrators : sequence of str
        At least two; one named twice is compared with itself, with different seeds.
    spp : int
        Samples per pixel for each integrator, over all batches; rounded up to a multiple of `batches`.
    batches : int
        Independent renders of each integrator, at least 8.
    size : (int, int), optional
        Width and height; default: the scene's, made smaller to 160 pixels on the longer side.
    seed : int
        The seeds of all batches follow from it.
    tile_size : int
        Side of the compared tiles, pixels; larger ones average fireflies out, smaller ones resolve more.
    device, on_progress, notify, **settings
        See `clrender.render`; progress covers all renders. `radiosity_display` defaults to ``gather``: the other
        displays show the patches themselves.

    Returns
    -------
    batches : list of Batches
    pairs : list of Pair
        In the order of `itertools.combinations`. The probability that any of them is found to differ although no two
        do is `LEVEL`; see `compare_batches`.

    Raises
    ------
    UsageError, SceneError, DeviceError, RenderError
        Like `clrender.render`; also for fewer than two integrators or 8 batches.
    """
    check_integrators(integrators)
    if batches < 8 or tile_size < 1 or spp < 1:
        raise UsageError("comparing needs at least 8 batches, tiles of at least 1 pixel and 1 sample per pixel")
    wanted = size or _small(scene)
    each = -(-spp // batches)
    seeds = _seeds(seed, len(integrators) * batches)

    common = {"radiosity_display": "gather", **common_indirect_rays(scene, integrators, notify), **settings}

    def settings_of_one(name: str, own: int) -> dict[str, Any]:
        """Settings for an integrator and a batch's seed."""
        mine = {**common, "integrator": name, "spp": each, "seed": own}
        return settings_of(name, mine)

    # Before any rendering
    chains = False
    for name in dict.fromkeys(integrators):
        chains |= settings_for(scene, wanted, settings_of_one(name, seeds[0])).specular_chains == "on"
        check_materials(scene, name)
    total = len(integrators) * batches * each * wanted[0] * wanted[1]
    reporter = _Reporter(notify, on_progress, total)

    def image(session: Session, name: str, own: int) -> RenderedImage:
        one = settings_of_one(name, own)
        made = session.render(scene, size=wanted, on_progress=reporter.advance, keep_film=False, **one)
        if made.interrupted:
            raise RenderError(f"a render with {name} did not finish, so nothing can be compared")
        reporter.finish(made)
        return made

    made = []
    with Session(device, notify=reporter.notice) as session:
        for place, (label, name) in enumerate(zip(labels(integrators), integrators, strict=True)):
            own = seeds[place * batches : (place + 1) * batches]
            images = (image(session, name, number) for number in own)
            made.append(_gathered(label, name, tile_size, own, images))
    pairs = list(itertools.combinations(made, 2))
    return made, [compare_batches(scene, a, b, LEVEL / len(pairs), chains) for a, b in pairs]


def common_indirect_rays(
    scene: Scene, integrators: Sequence[str], notify: Callable[[str], None] | None
) -> dict[str, int]:
    """The setting without which the scene's own would ask another question of some of the integrators."""
    asked = scene.render.indirect_rays
    takes = [INTEGRATORS[name].takes.get("indirect_rays", (asked,)) for name in integrators]
    if asked != 0 or all(asked in each for each in takes):
        return {}
    if notify is not None:
        notify("note: indirect_rays is 0 in the scene, which some of the integrators do not take; all of them take 1")
    return {"indirect_rays": 1}


def check_integrators(integrators: Sequence[str]) -> None:
    """Check that there are at least two integrators, all of them known.

    Raises
    ------
    UsageError
        The message suggests the nearest name.
    """
    for name in integrators:
        if name not in INTEGRATORS:
            raise UsageError(f"there is no integrator {quoted(name)}{suggestion(name, INTEGRATORS)}")
    if len(integrators) < 2:
        raise UsageError(f"comparing takes at least two integrators of {', '.join(INTEGRATORS)}")


class _Reporter:
    """Reports many renders as one: progress over all of them, and each notice once."""

    def __init__(
        self, notify: Callable[[str], None] | None, on_progress: Callable[[Progress], None] | None, total: int
    ) -> None:
        self._notify, self._on_progress, self._total = notify, on_progress, total
        self._said: set[str] = set()
        self._samples = self._rays = 0
        self._begin = time.perf_counter()

    def notice(self, line: str) -> None:
        if self._notify is not None and line not in self._said:
            self._said.add(line)
            self._notify(line)

    def advance(self, done: Progress) -> None:
        if self._on_progress is not None:
            seconds = time.perf_counter() - self._begin
            samples, rays = self._samples + done.samples_done, self._rays + done.rays
            self._on_progress(Progress(samples, self._total, seconds, rays))

    def finish(self, image: RenderedImage) -> None:
        self._samples += image.stats["samples"]
        self._rays += image.stats["rays"]


def _gathered(label: str, name: str, side: int, seeds: Sequence[int], images: Iterable[RenderedImage]) -> Batches:
    """Collect batches of renders, with at most one image in memory at a time."""
    tiles, whole = [], []
    mean: npt.NDArray[np.float64] | None = None
    numbers = {"spp": 0, "rays": 0, "seconds": 0.0, "nonfinite_samples": 0, "seeds": list(seeds)}
    for image in images:
        linear = image.linear.astype(np.float64)
        mean = linear / len(seeds) if mean is None else mean + linear / len(seeds)
        tiles.append(tile_means(linear, side))
        whole.append(float(linear.mean()))
        for key, source in (("rays", "rays"), ("seconds", "render_seconds"), ("spp", "spp")):
            numbers[key] += image.stats[source]
        numbers["nonfinite_samples"] += image.stats["nonfinite_samples"]
    assert mean is not None
    return Batches(label, name, np.array(tiles), side, np.array(whole), mean.astype(np.float32), numbers)


def _small(scene: Scene) -> tuple[int, int]:
    width, height = scene.image.width, scene.image.height
    factor = min(1.0, 160.0 / max(width, height))
    return max(1, math.floor(width * factor + 0.5)), max(1, math.floor(height * factor + 0.5))


def _seeds(seed: int, count: int) -> list[int]:
    """`count` distinct seeds of 32 bits, independent of those that follow from another `seed`."""
    drawn = np.random.SeedSequence(seed).generate_state(2 * count + 16, np.uint32).tolist()
    return list(dict.fromkeys(drawn))[:count]


def labels(names: Sequence[str]) -> list[str]:
    """Names of integrators in results: those that come again are numbered."""
    counts = [names[: place + 1].count(name) for place, name in enumerate(names)]
    return [name if count == 1 else f"{name}-{count}" for name, count in zip(names, counts, strict=True)]
