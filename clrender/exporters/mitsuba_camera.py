"""Camera, film and integrator as Mitsuba's."""

from __future__ import annotations

from typing import Final

import numpy as np

from clrender.errors import SceneError
from clrender.exact.matrices import length, product
from clrender.exporters.mitsuba_xml import Element, Target, element, transform, value
from clrender.flatten.bounds import scene_bounds
from clrender.importers.shared.matrices import look_at, scaling

__all__ = ["integrator", "sensor"]

_NEAR_FILTER: Final = {"blackman-harris": "gaussian"}
_NEAR, _FAR = 1e-2, 1e4
"""Metres at which Mitsuba's cameras clip unless told otherwise."""


def sensor(target: Target, medium: str | None) -> Element:
    """The camera, with its film and sampler.

    Parameters
    ----------
    target : Target
    medium : str or None
        Id of the medium that it is in.

    Raises
    ------
    SceneError
        Mitsuba has no such camera.
    """
    scene = target.scene
    camera = scene.camera
    if camera.type not in ("perspective", "orthographic"):
        text = f"is of type {camera.type}, which Mitsuba has not; make it perspective or orthographic"
        raise SceneError(f"{scene.source}: camera {text}")
    matrix = look_at(camera.position, camera.target, camera.up)
    if camera.mirrored:
        matrix = product(matrix, scaling(-1.0, 1.0, 1.0))
    inside = []
    kind: str = camera.type
    if kind == "orthographic":
        # The image is 2 wide before the transform
        half = camera.height / 2.0 * scene.image.width / scene.image.height
        matrix = product(matrix, scaling(half, half, 1.0))
        if camera.aperture_radius:
            target.leave_out("the lens of an orthographic camera", "camera", "aperture_radius")
    else:
        inside += [value("string", "fov_axis", "y"), value("float", "fov", camera.vertical_fov)]
        if camera.aperture_radius:
            kind = "thinlens"
            distance = camera.focus_distance or length(np.subtract(camera.target, camera.position))
            inside += [value("float", "aperture_radius", camera.aperture_radius)]
            inside += [value("float", "focus_distance", distance)]
            if camera.blades:
                target.leave_out("the blades of the aperture, which is round", "camera", "blades")
    if camera.exposure is not None:
        target.leave_out("the exposure of display images", "camera", next(iter(camera.exposure)))
    inside += [transform(matrix), *_clipping(target), *_film(target)]
    inside += [] if medium is None else [element("ref", name="medium", id=medium)]
    return element("sensor", *inside, type=kind)


def _clipping(target: Target) -> list[Element]:
    """Distances of clipping planes that clip nothing."""
    low, high = scene_bounds(target.scene)
    if not (low <= high).all():
        return []
    reach = length(high - low) + length(np.maximum(np.abs(low - target.scene.camera.position), high - low))
    near, far = min(_NEAR, 1e-4 * reach), max(_FAR, 2.0 * reach)
    return [value("float", "near_clip", near), value("float", "far_clip", far)]


def _film(target: Target) -> list[Element]:
    """Size of the image, pixel filter and samples."""
    image, render = target.scene.image, target.scene.render
    if render.filter == "blackman-harris":
        target.leave_out("the pixel filter blackman-harris, for which there is a gaussian", "render", "filter")
    size = [value("integer", "width", image.width), value("integer", "height", image.height)]
    form = [
        value("string", "pixel_format", "rgb"),
        element("rfilter", type=_NEAR_FILTER.get(render.filter, render.filter)),
    ]
    if render.filter != "box":
        # Else pixels at the image's edge would have no samples from beyond it
        form.append(value("boolean", "sample_border", True))
    sampler = element("sampler", value("integer", "sample_count", render.spp), type="independent")
    return [element("film", *size, *form, type="hdrfilm"), sampler]


def integrator(target: Target, through: bool) -> Element:
    """Path tracing to the scene's depth.

    Parameters
    ----------
    target : Target
    through : bool
        Whether there are media, invisible surfaces or opacity, which shadow rays of Mitsuba's `path` do not pass.
    """
    render = target.scene.render
    depth = render.max_depth
    if render.integrator == "direct" or render.indirect_rays == 0:
        depth = 1 if depth is None else min(depth, 1)
    elif render.integrator not in ("path", "reuse"):
        target.leave_out(f"the integrator {render.integrator}, for which there is path", "render", "integrator")
    # Mitsuba counts the segments of a path
    inside = [value("integer", "max_depth", -1 if depth is None else depth + 1)]
    if render.roulette == "none":
        inside.append(value("integer", "rr_depth", _NO_ROULETTE))
    return element("integrator", *inside, type="volpath" if through else "path")


_NO_ROULETTE: Final = 100_000
