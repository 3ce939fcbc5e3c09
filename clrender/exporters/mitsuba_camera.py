"""Camera, film and integrator as Mitsuba's."""

from __future__ import annotations

from typing import Final

import numpy as np

from clrender.errors import SceneError
from clrender.exact.matrices import length, product
from clrender.exporters.mitsuba_xml import Element, Target, element, transform, value
from clrender.flatten.bounds import scene_bounds
from clrender.flatten.emission import emits
from clrender.importers.shared.matrices import look_at, scaling
from clrender.scene.light_kinds import EnvironmentLight, SunSkyLight

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
    size = [value("integer", "width", image.width), value("integer", "height", image.height)]
    form = [value("string", "pixel_format", "rgb"), _filter(target)]
    sampler = element("sampler", value("integer", "sample_count", render.spp), type="independent")
    return [element("film", *size, *form, type="hdrfilm"), sampler]


def _filter(target: Target) -> Element:
    render = target.scene.render
    if render.filter == "blackman-harris":
        target.leave_out("the pixel filter blackman-harris, for which there is a gaussian", "render", "filter")
    name, radius = _NEAR_FILTER.get(render.filter, render.filter), render.filter_radius
    if radius is None:
        return element("rfilter", type=name)
    if name == "mitchell":
        if radius != 2.0:
            target.leave_out("the radius of the pixel filter mitchell, which is 2", "render", "filter_radius")
        return element("rfilter", type=name)
    stretch = value("float", "stddev", radius / 3.0) if name == "gaussian" else value("float", "radius", radius)
    return element("rfilter", stretch, type=name)


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
    if _hides_lights(target):
        inside.append(value("boolean", "hide_emitters", True))
    return element("integrator", *inside, type="volpath" if through else "path")


def _hides_lights(target: Target) -> bool:
    """Whether the camera sees no light: Mitsuba hides all of them, or none. What else is hidden is named."""
    scene = target.scene
    shapes = [(at, emits(scene, shape), shape.visible_to_camera) for at, shape in scene.all_shapes()]
    lights = [
        (("lights", i), True, light.visible_to_camera)
        for i, light in enumerate(scene.lights)
        if isinstance(light, EnvironmentLight | SunSkyLight)
    ]
    parts = [*shapes, *lights]
    hides = {visible for _, shines, visible in parts if shines} == {False}
    for at, shines, visible in parts:
        if not visible and not (shines and hides):
            target.leave_out("that the camera does not see it", *at, "visible_to_camera")
    return hides


_NO_ROULETTE: Final = 100_000
