"""Camera, film and path tracing as LuxCore's."""

from __future__ import annotations

from typing import Final

from clrender.exporters.luxcore_text import Properties
from clrender.exporters.target import Target
from clrender.exporters.views import check_camera, clip_distances, flat_view, hides_lights, path_depth

__all__ = ["camera_properties", "settings"]

_FILTERS: Final = {"box": "NONE", "gaussian": "GAUSSIAN", "mitchell": "MITCHELL", "blackman-harris": "BLACKMANHARRIS"}
_NEVER: Final = 10**6
_DEEPEST: Final = 1000
"""Most events of a path. LuxCore has random numbers for each of them, and some millions end it without a word."""


def camera_properties(target: Target) -> Properties:
    """The camera.

    Parameters
    ----------
    target : Target

    Raises
    ------
    SceneError
        LuxCore has no such camera.
    """
    check_camera(target, "LuxCore")
    scene = target.scene
    camera, image = scene.camera, scene.image
    aspect = image.width / image.height
    side = camera.height / 2.0 if camera.type == "orthographic" else 1.0
    # LuxCore's film has its rows one pixel lower than its window says
    shift = -2.0 * side / image.height
    across = -side * aspect if camera.mirrored else side * aspect
    view = flat_view(target)
    right, up = 2.0 * view.shift[0] * across, 2.0 * view.shift[1] * side
    values: Properties = {
        "type": "orthographic" if camera.type == "orthographic" else "perspective",
        "lookat.orig": camera.position,
        "lookat.target": camera.target,
        "up": camera.up,
        "screenwindow": [right - across, right + across, up + shift - side, up + shift + side],
        "autofocus.enable": False,
    }
    if camera.type != "orthographic":
        values |= {"fieldofview": view.vertical_fov, "lensradius": camera.aperture_radius}
        if camera.aperture_radius:
            values["focaldistance"] = camera.focus
    distances = clip_distances(scene)
    if distances is not None:
        values |= dict(zip(("cliphither", "clipyon"), distances, strict=True))
    return {f"scene.camera.{name}": value for name, value in values.items()}


def settings(target: Target) -> Properties:
    """Film, sampler, and path tracing to the scene's depth."""
    image, render = target.scene.image, target.scene.render
    if render.filter not in _FILTERS:
        target.leave_out(f"the pixel filter {render.filter}, for which there is a gaussian", "render", "filter")
    if render.filter_radius is not None:
        target.leave_out("the radius of the pixel filter", "render", "filter_radius")
    hides_lights(target, can=False)
    depth = path_depth(target)
    if depth is not None and depth > _DEEPEST:
        target.leave_out(f"scattering events beyond {_DEEPEST}", "render", "max_depth")
    depth = _DEEPEST if depth is None else min(depth, _DEEPEST)
    values: Properties = {
        "renderengine.type": "PATHCPU",
        "film.width": image.width,
        "film.height": image.height,
        "film.filter.type": _FILTERS.get(render.filter, "GAUSSIAN"),
        "film.imagepipelines.0.0.type": "NOP",
        "film.noiseestimation.warmup": _NEVER,
        "sampler.type": "SOBOL",
        "sampler.sobol.adaptive.strength": 0.0,
        "batch.haltspp": render.spp,
    }
    values |= {f"path.pathdepth.{kind}": depth for kind in ("total", "diffuse", "glossy", "specular")}
    if render.roulette == "none":
        values["path.russianroulette.depth"] = _NEVER
    # Nothing is clamped, and no light is traced backward
    return values | {"path.clamping.variance.maxvalue": 0.0, "path.hybridbackforward.enable": False}
