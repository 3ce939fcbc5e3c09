"""Radiosity: light between diffuse patches, solved once on one device and shown by all."""

from __future__ import annotations

from functools import partial
from typing import Final

from clrender.errors import RenderError
from clrender.integrators.descriptor import CAUSTICS, Integrator, Prepared, Request
from clrender.radiosity.atlas import atlas_of
from clrender.radiosity.display import DISPLAY, GATHER, Display, Gather, looks
from clrender.radiosity.solution import RadiositySettings, Solution, solve_scene, summary

__all__ = ["INTEGRATOR"]


def _prepare(request: Request) -> Prepared:
    settings = request.settings
    solution = _solve(request)
    request.notify(summary(solution))
    if settings.radiosity_display == "gather" and solution.complete:
        whole = solution.patches.whole(settings.width, settings.height, settings.light_sampler)
        atlas = atlas_of(solution.patches, solution.indirect, solution.used, solution.open_share)
        return Prepared(whole, GATHER, partial(Gather, atlas=atlas))
    table = looks(solution, settings.radiosity_display)
    return Prepared(solution.flat, DISPLAY, partial(Display, table=table))


def _solve(request: Request) -> Solution:
    """The solution, on the first of the devices that comes through."""
    settings = request.settings
    wanted = RadiositySettings(
        settings.patches, settings.patch_rays, seed=settings.seed, gathered=settings.radiosity_display == "gather"
    )
    size = (settings.width, settings.height)
    *first, last = request.devices
    for device in first:
        try:
            return solve_scene(
                request.scene, device, wanted, size, request.launch, settings.light_sampler, request.should_stop
            )
        except RenderError as error:
            request.notify(f"warning: {error}; radiosity is solved on another device")
    return solve_scene(request.scene, last, wanted, size, request.launch, settings.light_sampler, request.should_stop)


INTEGRATOR: Final = Integrator(DISPLAY, leaves_out=(CAUSTICS,), bias="discretised", prepare=_prepare)
