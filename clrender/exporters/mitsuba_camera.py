"""Camera, film and integrator as Mitsuba's."""

from __future__ import annotations

from typing import Final

from clrender.exact.matrices import product
from clrender.exporters.mitsuba_xml import Element, element, transform, value
from clrender.exporters.target import Target
from clrender.exporters.views import check_camera, clip_distances, flat_view, hides_lights, path_depth
from clrender.importers.shared.matrices import look_at, scaling, translation

__all__ = ["integrator", "sensor"]

_NEAR_FILTER: Final = {"blackman-harris": "gaussian"}


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
    check_camera(target, "Mitsuba")
    matrix = look_at(camera.position, camera.target, camera.up)
    if camera.mirrored:
        matrix = product(matrix, scaling(-1.0, 1.0, 1.0))
    inside = []
    kind: str = "perspective" if camera.type == "intrinsics" else camera.type
    view = flat_view(target)
    if kind == "orthographic":
        # The image is 2 wide before the transform
        half = camera.height / 2.0 * scene.image.width / scene.image.height
        # Its +x points to the left
        aside = translation(-2.0 * half * view.shift[0], camera.height * view.shift[1], 0.0)
        matrix = product(product(matrix, aside), scaling(half, half, 1.0))
    else:
        offsets = (("x", view.shift[0]), ("y", -view.shift[1]))
        inside += [value("float", f"principal_point_offset_{axis}", each) for axis, each in offsets if each]
        inside += [value("string", "fov_axis", "y"), value("float", "fov", view.vertical_fov)]
        if camera.aperture_radius:
            kind = "thinlens"
            inside += [value("float", "aperture_radius", camera.aperture_radius)]
            inside += [value("float", "focus_distance", camera.focus)]
    inside += [transform(matrix), *_clipping(target), *_film(target)]
    inside += [] if medium is None else [element("ref", name="medium", id=medium)]
    return element("sensor", *inside, type=kind)


def _clipping(target: Target) -> list[Element]:
    """Distances of clipping planes that clip nothing."""
    distances = clip_distances(target.scene)
    if distances is None:
        return []
    return [value("float", name, each) for name, each in zip(("near_clip", "far_clip"), distances, strict=True)]


def _film(target: Target) -> list[Element]:
    """Size of the image, pixel filter and samples."""
    image, render = target.scene.image, target.scene.render
    size = [value("integer", "width", image.width), value("integer", "height", image.height)]
    form = [value("string", "pixel_format", "rgb"), _filter(target)]
    if render.filter != "box" or render.filter_radius not in (None, 0.5):
        # Else pixels at the image's edge would have no samples from beyond it
        form.append(value("boolean", "sample_border", True))
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
    depth = path_depth(target)
    # Mitsuba counts the segments of a path
    inside = [value("integer", "max_depth", -1 if depth is None else depth + 1)]
    if render.roulette == "none":
        inside.append(value("integer", "rr_depth", _NO_ROULETTE))
    if hides_lights(target, can=True):
        inside.append(value("boolean", "hide_emitters", True))
    return element("integrator", *inside, type="volpath" if through else "path")


_NO_ROULETTE: Final = 100_000
