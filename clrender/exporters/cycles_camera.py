"""Camera and settings as Blender's and Cycles'."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.angles import tan_degrees
from clrender.exact.matrices import length
from clrender.exporters.target import Target
from clrender.exporters.views import check_camera, clip_distances, flat_view, path_depth
from clrender.importers.shared.matrices import look_at

__all__ = ["along", "camera", "settings"]

_FILTERS: Final = {"box": "BOX", "blackman-harris": "BLACKMAN_HARRIS", "gaussian": "GAUSSIAN"}
_RADIUS: Final = {"box": 0.5, "blackman-harris": 1.5}
"""Of pixel filters, pixels, unless the scene gives another."""
_SENSOR: Final = 24.0
"""Height of the sensor, millimetres."""
_DEEPEST: Final = 1024
"""Most bounces of a path."""


def along(position: Any, direction: Any, up: Any = None) -> NDArray[np.float64]:
    """A place, (4, 4), from which -z is in a direction, as lights and cameras of Blender look.

    Parameters
    ----------
    position, direction : three floats
    up : three floats, optional
        Direction of +y, as far as it is across.
    """
    origin, axis = np.array(position, np.float64), np.array(direction, np.float64) / length(direction)
    upward = np.eye(3)[int(np.abs(axis).argmin())] if up is None else np.array(up, np.float64)
    # Of which x points to the left, and z forward
    return np.asarray(look_at(origin, origin + axis, upward) * np.array([-1.0, 1.0, -1.0, 1.0]), np.float64)


def camera(target: Target) -> dict[str, Any]:
    """The camera: its place, and its attributes.

    Parameters
    ----------
    target : Target

    Raises
    ------
    SceneError
        Blender has no such camera.
    """
    check_camera(target, "Blender")
    given = target.scene.camera
    if given.mirrored:
        target.leave_out("the mirroring of the image", "camera", "mirrored")
    values: dict[str, Any] = {"sensor_fit": "VERTICAL", "sensor_height": _SENSOR}
    view, image = flat_view(target), target.scene.image
    if any(view.shift):  # in units of the side that the sensor fits
        values |= {"shift_x": view.shift[0] * image.width / image.height, "shift_y": view.shift[1]}
    if given.type == "orthographic":
        values |= {"type": "ORTHO", "ortho_scale": given.height}
    else:
        tangent = tan_degrees(view.vertical_fov / 2.0)
        sensor = max(_SENSOR, 2.0 * tangent)  # Blender has no lens below 1 mm
        lens = sensor / 2.0 / tangent
        values |= {"type": "PERSP", "lens": lens, "sensor_height": sensor}
        if given.aperture_radius:
            stop = 1e-3 * lens / (2.0 * given.aperture_radius)
            values |= {"dof.use_dof": True, "dof.focus_distance": given.focus, "dof.aperture_fstop": stop}
    distances = clip_distances(target.scene)
    if distances is not None:
        values |= dict(zip(("clip_start", "clip_end"), distances, strict=True))
    direction = np.subtract(given.target, given.position)
    return {"matrix": along(given.position, direction, given.up).tolist(), "values": values}


def settings(target: Target) -> dict[str, Any]:
    """Size of the image, and path tracing to the scene's depth: attributes of Blender's scene."""
    image, render = target.scene.image, target.scene.render
    if render.filter not in _FILTERS:
        target.leave_out(f"the pixel filter {render.filter}, for which there is a gaussian", "render", "filter")
    depth = path_depth(target)
    if depth is not None and depth > _DEEPEST:
        target.leave_out(f"scattering events beyond {_DEEPEST}", "render", "max_depth")
    # The last event of a path is where light is added, after which it does not go on
    if depth == 0:
        target.leave_out("that surfaces reflect nothing, as they do once at least", "render", "max_depth")
    bounces = _DEEPEST if depth is None else min(max(depth - 1, 0), _DEEPEST)
    kind = _FILTERS.get(render.filter, "GAUSSIAN")
    radius = render.filter_radius or _RADIUS.get(render.filter, 2.0)
    values: dict[str, Any] = {
        "render.resolution_x": image.width,
        "render.resolution_y": image.height,
        "render.resolution_percentage": 100,
        "view_settings.view_transform": "Standard",
        "cycles.samples": render.spp,
        "cycles.seed": render.seed % 2**31,
        "cycles.pixel_filter_type": kind,
        # A gaussian of Blender has a deviation of a twelfth of its width, and clrender's of a third of its radius
        "cycles.filter_width": min(4.0 * radius if kind == "GAUSSIAN" else 2.0 * radius, 10.0),
        "cycles.transparent_max_bounces": _DEEPEST,
        "cycles.min_light_bounces": _DEEPEST if render.roulette == "none" else 0,
        "cycles.min_transparent_bounces": _DEEPEST if render.roulette == "none" else 0,
        "cycles.caustics_reflective": True,
        "cycles.caustics_refractive": True,
    }
    values |= {f"cycles.{kind}_bounces": bounces for kind in ("max", "diffuse", "glossy", "transmission", "volume")}
    # Nothing is clamped, blurred, guided, or left to a denoiser
    values |= {f"cycles.sample_clamp_{kind}": 0.0 for kind in ("direct", "indirect")}
    values |= {f"cycles.{name}": 0.0 for name in ("blur_glossy", "light_sampling_threshold")}
    return values | {f"cycles.use_{name}": False for name in ("adaptive_sampling", "denoising", "guiding")}
