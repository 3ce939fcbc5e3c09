"""Settings that mean the same image of a mixed scene, and which scenes they are for."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

from mixed_moves import FAR_LAMP
from mixed_parts import Draw, Json

__all__ = ["SAMPLERS", "UNUSED", "Way", "biased_ways", "black_ways", "has_delta_lights", "ways", "white_ways"]

UNUSED: Final = {
    "seed": "distinguishes the images that are compared",
    "spp": "is chosen by the stages of a comparison",
    "width": "of small images",
    "height": "of small images",
    "replicate_spp": "does not change the image",
    "crop": "has the bits of the whole (tests/image/test_crops.py)",
    "guiding_memory": "bounds the number of cells, which the number of paths varies",
    "light_paths": "of bdpt, as many as pixels",
    "bands": "is set by the spectrum that is asked for (tests/image/test_spectral.py)",
    "patches": "of radiosity, which takes almost none of these scenes",
    "patch_rays": "of radiosity",
    "radiosity_display": "of radiosity",
}
"""Settings of the image that no way varies, and why."""
_DELTA: Final = ("point", "spot", "ies", "projector", "plugin", "directional")
_STAGES: Final = ((8, 16), (32, 64), (64, 256), (128, 512))
SAMPLERS: Final = ("bvh", "power", "uniform", "auto")
"""Ways to choose a light."""


@dataclass(frozen=True)
class Way:
    """Settings, and those of the images to compare with.

    Attributes
    ----------
    name : str
        What is special about it.
    settings, reference : dict
    factor : float or None
        The scene is moved, and this many times as large.
    bias : float
        Relative difference of the means of the images that is allowed.
    stages : tuple of (int, int)
        Seeds and samples per pixel.
    """

    name: str
    settings: Json
    reference: Json = field(default_factory=dict)
    factor: float | None = None
    bias: float = 0.0
    stages: tuple[tuple[int, int], ...] = _STAGES

    def __str__(self) -> str:
        where = "" if self.factor is None else f" by {self.factor}"
        return f"{self.name}{where}: {json.dumps(self.settings)} and {json.dumps(self.reference)}"


def _lights(content: Json) -> list[str]:
    return [light["type"] for light in content["lights"] if light.get("intensity") != FAR_LAMP]


def ways(draw: Draw, content: Json) -> Iterator[Way]:
    """Unbiased ways to the image of a scene, each to be compared with the plain one.

    Parameters
    ----------
    draw : Draw
    content : dict
        The scene.
    """
    depth: Json = {"max_depth": draw.count(1, 6)} if draw.chance(0.4) else {}
    lights = {"sampling": "light", "light_sampler": draw.one(SAMPLERS)}
    yield Way("light", {**depth, **lights}, depth)
    yield Way("sampler", {**depth, "light_sampler": draw.one(SAMPLERS), "shadow_rays": draw.count(1, 4)}, depth)
    if not any(kind in (*_DELTA, "sun_sky") for kind in _lights(content)):  # of no size, or too small
        yield Way("bsdf", {**depth, "sampling": "bsdf"}, depth)
    if draw.chance(0.5):
        yield Way("splitting", {**depth, "indirect_rays": 2, "shadow_rays": draw.count(1, 2)}, depth)
    else:
        yield Way("both", {**depth, **lights, "shadow_rays": 2}, depth)
    if depth and draw.chance(0.5):
        yield Way("no roulette", {**depth, "roulette": "none"}, depth)
    else:
        yield Way("roulette", {**depth, "roulette": "constant", **draw.one(({}, {"termination": 0.1}))}, depth)
    guiding = {"guiding": draw.one(("on", "on", "auto")), "guiding_paths": draw.one((1 << 10, 1 << 13, 1 << 16))}
    yield Way("guided", {**depth, **guiding, **draw.one(({}, {"sampling": "light"}, {"indirect_rays": 2}))}, depth)
    yield Way("reuse", {**depth, "integrator": "reuse", "reuse": draw.one((2, 4, 8, 16))}, depth)
    if _found_by_path(content) and "shadow_terminator_offset" not in json.dumps(content):
        yield Way("bdpt", {**depth, "integrator": "bdpt", "light_sampler": draw.one(("power", "uniform"))}, depth)
    if _found_by_path(content):
        more: Json = draw.one(({}, {"guiding": "on", "guiding_paths": 1 << 13}, {"sampling": "light"}))
        yield Way("chains", {**depth, "specular_chains": "on", **more}, depth)
    yield Way("wavelengths", {**depth, "spectral": True, **lights}, {**depth, "spectral": True})
    direct = {"integrator": "direct", "light_sampler": "power"}  # it has light samples alone
    others = {"light_sampler": draw.one(("bvh", "uniform")), "shadow_rays": draw.count(1, 3)}
    yield Way("direct", {**direct, **others}, direct)
    if all(kind in _DELTA for kind in _lights(content)) and not _shines(content):
        yield Way("whitted", {"integrator": "whitted"}, direct)


def _found_by_path(content: Json) -> bool:
    """Whether `path` finds the light of all lights: there are no delta lights, or neither mirrors nor glass."""
    made = content.get("materials", {}).values()
    smooth = any(each["type"] in ("mirror", "conductor", "dielectric") or "transmission" in each for each in made)
    return not (smooth and has_delta_lights(content))


def has_delta_lights(content: Json) -> bool:
    """Whether there are lights that no ray can meet."""
    return any(kind in _DELTA for kind in _lights(content))


def _shines(content: Json) -> bool:
    """Whether there are lights that are shapes."""
    return '"emission"' in json.dumps([content["shapes"], content.get("groups"), content.get("materials")])


def biased_ways(content: Json) -> Iterator[Way]:
    """Photon maps, where they find the same light: without delta lights, or without mirrors and glass.

    Parameters
    ----------
    content : dict
        The scene.
    """
    if not _found_by_path(content):
        return
    settings: Json = {"integrator": "photon", "photons": 8192, "photon_radius": 0.1}
    yield Way("photon", settings, bias=0.05, stages=((8, 8), (16, 32)))


def white_ways(draw: Draw, content: Json) -> list[Way]:
    """Ways to a white furnace: the plain one and a few others.

    Parameters
    ----------
    draw : Draw
    content : dict
        The scene.
    """
    made = [Way("plain", {}), *(way for way in ways(draw, content) if way.reference.get("integrator") != "direct")]
    made = [way for way in made if "max_depth" not in way.settings]
    made += biased_ways(content)
    wide = {"filter_radius": draw.between(0.25, 4.0)} if draw.chance(0.3) else {}
    name = draw.one(("box", "tent", "gaussian", "blackman-harris", "mitchell"))
    made.append(Way("filter", {"filter": name, **wide}))
    return [way for way in made if way.name == "plain" or draw.chance(0.35)]


def black_ways(draw: Draw) -> list[Way]:
    """Ways to a black image, biased ones too.

    Parameters
    ----------
    draw : Draw
    """
    more: list[Json] = [{"light_sampler": draw.one(SAMPLERS)}, {"integrator": "reuse"}]
    more += [
        {"integrator": "bdpt", "spp": 4},
        {"integrator": "photon", "photons": 4096, "photon_radius": 0.1, "spp": 4},
    ]
    more += [draw.one(({"integrator": "direct"}, {"integrator": "whitted"}))]
    every: list[dict[str, Any]] = [{}, {"sampling": "light"}, {"sampling": "bsdf"}, *more]
    return [Way(settings.get("integrator", "path"), settings) for settings in every]
