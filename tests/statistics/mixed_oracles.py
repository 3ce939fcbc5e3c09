"""What is asked of mixed scenes: white ones are white, black ones black, and all unbiased ways to an image agree.

A comparison is made of images of different seeds, by tiles of 4 x 4 pixels and as a whole. Few samples come first; only
what is suspicious is rendered again, with other seeds and many more samples, and only those are then judged. The first
stages only let things pass, so they raise no false alarm. The last one asks both for Student's t and for the median of
the seeds' means to deviate: where light is rarely found, single seeds are far from the mean, and t alone would see a
difference where both are right.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from mixed_moves import compiled_for_volumes, moved, with_all_features
from mixed_parts import Draw, Json
from mixed_plugins import PLUGINS
from mixed_scenes import Mixed
from mixed_ways import SAMPLERS, Way, biased_ways, black_ways, ways, white_ways
from scipy import stats

import clrender
from clrender.errors import SceneError

__all__ = ["Comparison", "Oracle", "different", "surprising"]

Floats = npt.NDArray[np.float64]
SUSPICIOUS: Final = 0.01
"""Chance below which a comparison gets to the next stage."""
_SIZE: Final = 8
_WEIGHTS: Final = np.array([0.5, 0.3, 0.2])
_TABLES: Final = 1e-3
"""Error of the energy of rough materials that ``clrender furnace`` allows, beside losses below coats and sheens."""
_ROUNDING: Final = 1e-5
_EVENTS: Final = 64.0
"""Events of a path above which a scene gets fewer samples: fog without end can take hundreds."""


@dataclass(frozen=True)
class Comparison:
    """The outcome of one.

    Attributes
    ----------
    scene, way : str
        Name of the scene; what was compared.
    chance : float
        That a correct renderer deviates as much.
    text : str
        The numbers.
    """

    scene: str
    way: str
    chance: float
    text: str


def different(rows: Floats, wanted: float, allowed: tuple[float, float], robust: bool) -> tuple[float, str]:
    """The chance that independent rows of tiles are so far from a number, beyond what is allowed."""
    low, high = allowed
    columns = np.concatenate([rows, rows.mean(axis=1, keepdims=True)], axis=1) - wanted
    count = len(columns)
    scale = columns.std(axis=0, ddof=1) / math.sqrt(count)
    mean, median = columns.mean(axis=0), np.median(columns, axis=0)
    chances = 2.0 * stats.t.sf(_beyond(mean, low, high, scale), count - 1)
    if robust:
        spread = 1.4826 * np.median(np.abs(columns - median), axis=0) * 1.2533 / math.sqrt(count)
        chances = np.maximum(chances, 2.0 * stats.norm.sf(_beyond(median, low, high, spread)))
    worst = int(np.argmin(chances))
    shown = f"{mean[worst] + wanted:.6g} +- {scale[worst]:.2g} (median {median[worst] + wanted:.6g})"
    where = "all" if worst == len(chances) - 1 else f"tile {worst}"
    return min(1.0, float(chances[worst]) * len(chances)), f"{shown} in place of {wanted:.6g}, {where}"


def _beyond(value: Floats, low: float, high: float, scale: Floats) -> Floats:
    off = np.maximum(np.maximum(value - high, low - value), 0.0)
    return np.divide(off, scale, out=np.where(off > 0.0, 1e9, 0.0), where=scale > 0.0)


class Oracle:
    """Renders mixed scenes in one session and compares.

    Parameters
    ----------
    session : clrender.Session
    folder : Path
        With the files of `mixed_files`.
    more : int
        Factor for all numbers of samples.
    without : collection of str
        Names of ways that are left out; or ``shadow_rays``, of which all ways then have one.
    """

    def __init__(self, session: clrender.Session, folder: Path, more: int = 1, without: Collection[str] = ()) -> None:
        self._session, self._folder, self._more, self._without = session, folder, more, without
        self._events = self._mean = 0.0
        self._share = 1.0
        self._compiled: Callable[[], contextlib.AbstractContextManager[None]] = contextlib.nullcontext

    def judged(self, mixed: Mixed, all_features: bool = True) -> Iterator[Comparison]:
        """All comparisons of a scene.

        Parameters
        ----------
        mixed : Mixed
        all_features : bool
            Whether all features of the kernels are compiled in, so that few programs are needed.
        """
        content = with_all_features(mixed.content) if all_features else mixed.content
        self._compiled = compiled_for_volumes if all_features else contextlib.nullcontext
        draw = Draw(f"{mixed.name}: ways", white=False)
        self._share = 1.0
        self._rows(self._scene(mixed.name, content), range(1), False, spp=1)
        self._share = min(1.0, _EVENTS / self._events)
        if mixed.exact == 0.0:
            yield from self._black(mixed, content, draw)
        elif mixed.exact is not None:
            yield from self._white(mixed, content, draw)
        else:
            yield from self._agreeing(mixed, content, draw)

    def _wanted(self, every: Iterable[Way]) -> list[Way]:
        wanted = [way for way in every if way.name not in self._without]
        if "shadow_rays" not in self._without:
            return wanted
        return [replace(way, settings={k: v for k, v in way.settings.items() if k != "shadow_rays"}) for way in wanted]

    def _scene(self, name: str, content: Json) -> clrender.Scene:
        return clrender.Scene(**content).placed(name, self._folder).with_plugins(PLUGINS)

    def _rows(self, scene: clrender.Scene, seeds: range, inner: bool, **settings: Any) -> Floats:
        """(seeds, tiles) means of tiles; of the middle half of the image only if `inner`."""
        size = 2 * _SIZE if inner else _SIZE
        rows = []
        settings["spp"] = max(1, round(self._share * settings["spp"]))
        for seed in seeds:
            with self._compiled():
                image = self._session.render(scene, size=(size, size), seed=seed, keep_film=False, **settings)
            assert image.stats["nonfinite_samples"] == 0, f"{image.stats['nonfinite_samples']} samples are not finite"
            self._events = (image.stats["rays"] - image.stats["shadow_rays"]) / image.stats["samples"]
            gray = image.linear.astype(np.float64) @ _WEIGHTS
            gray = gray[size // 4 : -size // 4, size // 4 : -size // 4] if inner else gray
            rows.append(gray.reshape(_SIZE // 4, 4, _SIZE // 4, 4).mean(axis=(1, 3)).ravel())
        return np.array(rows)

    def _black(self, mixed: Mixed, content: Json, draw: Draw) -> Iterator[Comparison]:
        scene = self._scene(mixed.name, content)
        for way in self._wanted(black_ways(draw)):
            with contextlib.suppress(SceneError):  # not for this integrator
                tiles = self._rows(scene, range(1), False, **{"spp": 64, **way.settings})
                # Two of ten million rays get out at an edge where walls meet (DECISIONS.md, 27): so may one path
                black = np.count_nonzero(tiles) <= 1
                yield Comparison(mixed.name, str(way), float(black), f"{tiles.max():.4g} in place of 0")

    def _white(self, mixed: Mixed, content: Json, draw: Draw) -> Iterator[Comparison]:
        assert mixed.exact is not None
        scene, loss = self._scene(mixed.name, content), _loss(content)
        for way in self._wanted(white_ways(draw, content)):

            def rows(seeds: range, spp: int, way: Way = way) -> Floats:
                return self._rows(scene, seeds, mixed.inner, spp=spp, **way.settings)

            def allowed(exact: float = mixed.exact, bias: float = way.bias) -> tuple[float, float]:
                events, bias = exact * self._events, exact * bias
                return -events * (loss + _ROUNDING) - bias, events * (min(loss, _TABLES) + _ROUNDING) + bias

            with contextlib.suppress(SceneError):  # not for this integrator
                yield self._stages(mixed, way, rows, mixed.exact, allowed)

    def _stages(self, mixed: Mixed, way: Way, rows: Any, exact: float, allowed: Any) -> Comparison:
        """Compare with more and more samples while there is a suspicion; `allowed` is what may be less, and more."""
        first = 0
        for number, (count, spp) in enumerate(way.stages):
            made = rows(range(first, first + count), spp * self._more)
            first += count
            chance, text = different(made, exact, allowed(), robust=number > 0)
            if chance > SUSPICIOUS:
                break
        return Comparison(mixed.name, str(way), chance, f"{text} after stage {number}")

    def _agreeing(self, mixed: Mixed, content: Json, draw: Draw) -> Iterator[Comparison]:
        scene = self._scene(mixed.name, content)
        factor, by = draw.decades(-4.0, 5.0 if content["lights"] else 6.0), draw.decades(0.0, 5.0)
        elsewhere = self._scene(mixed.name, moved(content, factor, [factor * by * x for x in draw.direction()]))
        plain: dict[tuple[str, int, int], Floats] = {}
        elsewhere_too = Way("moved", {"light_sampler": draw.one(SAMPLERS)}, factor=factor)
        for way in self._wanted((*ways(draw, content), elsewhere_too, *biased_ways(content))):
            where = scene if way.factor is None else elsewhere

            def rows(seeds: range, spp: int, way: Way = way, where: clrender.Scene = where) -> Floats:
                key = (str(way.reference), seeds.start, spp)
                if key not in plain:
                    plain[key] = self._rows(scene, seeds, False, spp=spp, **way.reference)
                others = range(seeds.start + 10**6, seeds.stop + 10**6)
                difference = self._rows(where, others, False, spp=spp, **way.settings) - plain[key]
                self._mean = float(plain[key].mean())
                return difference.mean(axis=1, keepdims=True) if way.bias else difference

            def allowed(way: Way = way) -> tuple[float, float]:
                # Lights send out about 1: what is fainter still comes from so few samples that their mean says nothing
                most = max(way.bias * self._mean, _ROUNDING)
                return -most, most

            with contextlib.suppress(SceneError):  # not for this integrator
                yield self._stages(mixed, way, rows, 0.0, allowed)


def _loss(content: Json) -> float:
    """The share of light that a white material of the scene may lose at an event, as the documentation has it."""
    made = content["materials"].values()
    if any("coat" in each for each in made):
        return 0.03 if any("sheen_color" in each for each in made) else 0.015
    rough = any(
        each["type"] in ("oren_nayar", "conductor", "principled") or each.get("roughness", 0.0) != 0.0 for each in made
    )
    return _TABLES if rough else 0.0


def surprising(comparisons: Sequence[Comparison], alarm: float) -> list[Comparison]:
    """Those whose chance is too small by Holm's method: `alarm` is the chance that a correct renderer has any."""
    ordered = sorted(comparisons, key=lambda each: each.chance)
    found = []
    for rank, each in enumerate(ordered):
        if each.chance > alarm / (len(ordered) - rank):
            break
        found.append(each)
    return found
