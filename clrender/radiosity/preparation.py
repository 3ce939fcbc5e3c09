"""Radiosity in a render: solved once on one device, and displayed by all devices."""

from __future__ import annotations

from functools import partial

from clrender.device.prepared import Prepared, Request
from clrender.errors import RenderError
from clrender.radiosity.atlas import atlas_of
from clrender.radiosity.display import GATHER, Display, Gather, looks
from clrender.radiosity.solution import RadiositySettings, Solution, solve_scene, summary

__all__ = ["prepare"]


def prepare(request: Request) -> Prepared:
    """The scene divided into patches with their radiance, or, for a final gather, the scene with an atlas of it."""
    settings = request.settings
    solution = _solve(request)
    request.notify(summary(solution))
    if settings.radiosity_display == "gather" and solution.complete:
        whole = solution.patches.whole(settings.width, settings.height, settings.light_sampler)
        atlas = atlas_of(solution.patches, solution.shown_indirect, solution.used, solution.open_share)
        return Prepared(whole, GATHER, partial(Gather, atlas=atlas))
    table = looks(solution, settings.radiosity_display)
    return Prepared(solution.flat, request.pipeline, partial(Display, table=table))


def _solve(request: Request) -> Solution:
    """The solution, from the first device that does not fail."""
    settings = request.settings
    wanted = RadiositySettings(
        settings.patches, settings.patch_rays, seed=settings.seed, gathered=settings.radiosity_display == "gather"
    )
    size = (settings.width, settings.height)
    for device in request.devices:
        try:
            return solve_scene(
                request.scene, device, wanted, size, request.launch, settings.light_sampler, request.should_stop
            )
        except RenderError as error:
            failure = error
            request.notify(f"warning: {error}; radiosity is solved on another device, if there is one")
    raise failure
