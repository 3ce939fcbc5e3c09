"""Converts the cameras of a USD stage."""

from __future__ import annotations

import math
from typing import Any, Final

from clrender.exact.angles import angle_of, logarithm_of, power_of_two
from clrender.exact.matrices import length, product
from clrender.image.exposure import photographic_shutter
from clrender.importers.draft import Draft
from clrender.importers.shared.cameras import camera_keys
from clrender.importers.shared.matrices import Matrix, is_affine, scaling
from clrender.wording import quoted

__all__ = ["camera_of", "image_of"]

_LONG_SIDE: Final = 800
"""Longer side of an image whose aspect ratio the camera gives, pixels."""
_TENTH: Final = 0.1
"""Apertures and focal lengths are in tenths of the stage's unit."""
_EXPOSED_F: Final = 8.0


def camera_of(draft: Draft, item: dict[str, Any], matrix: Matrix) -> dict[str, Any] | None:
    """Table `camera` of a scene file; None if it cannot be used.

    Parameters
    ----------
    draft : Draft
        Gets notes.
    item : dict
        See `clrender.importers.usd.extraction`.
    matrix : (4, 4) float64
        From its space to world space.
    """
    place = quoted(item["path"])
    if not is_affine(matrix):
        draft.note(f"the camera {place} was left out: its transform flattens it")
        return None
    unit = length(matrix[:3, 2])
    wide, high = float(item["horizontalAperture"]), float(item["verticalAperture"])
    focal = float(item["focalLength"])
    if not (wide > 0.0 and high > 0.0 and focal > 0.0 and math.isfinite(wide * high * focal)):
        draft.note(f"the camera {place} was left out: its aperture or focal length is not above 0")
        return None
    distance = float(item.get("focusDistance") or 0.0) * unit
    distance = distance if 0.0 < distance < 1e12 else 0.0
    # It looks along its own -z; ours, in these functions, along +z with +x to the left
    made = camera_keys(product(matrix, scaling(-1.0, 1.0, -1.0)), rightward=False, distance=distance or None)
    shift = [
        float(item.get(f"{name}ApertureOffset") or 0.0) / size
        for name, size in (("horizontal", wide), ("vertical", high))
    ]
    if any(shift):
        made["lens_shift"] = shift
    if item.get("projection") == "orthographic":
        made |= {"type": "orthographic", "height": high * _TENTH * unit}
        return made
    made["vertical_fov"] = math.degrees(2.0 * angle_of(high / 2.0, focal))
    stop = float(item.get("fStop") or 0.0)
    if stop > 0.0 and distance:
        made |= {"aperture_radius": focal * _TENTH * unit / (2.0 * stop), "focus_distance": distance}
    elif stop > 0.0:
        draft.note(f"the camera {place} has an fStop, but no focusDistance: everything is in focus")
    made |= _exposure(draft, item, place)
    if (item.get("shutter:open") or 0.0) != (item.get("shutter:close") or 0.0):
        draft.note(f"the camera {place} has a shutter; what moves is blurred with --shutter A:B, in seconds")
    return made


def _exposure(draft: Draft, item: dict[str, Any], place: str) -> dict[str, Any]:
    """Keys of the exposure of display images; empty if it changes nothing."""
    factor = (item.get("exposure:time") or 1.0) * (item.get("exposure:iso") or 100.0) / 100.0
    factor *= item.get("exposure:responsivity") or 1.0
    stop = item.get("exposure:fStop") or 1.0
    factor /= stop * stop
    stops = float(item.get("exposure") or 0.0) + (logarithm_of(factor) / logarithm_of(2.0) if factor > 0.0 else 0.0)
    whole = round(stops)
    if abs(stops) < 1e-3 or not math.isfinite(stops) or abs(whole) > 60:
        return {}
    shutter = photographic_shutter(whole, _EXPOSED_F) * power_of_two(stops - whole)
    draft.note(f"the camera {place} has an exposure: display images get {stops:+.3g} stops, radiance none")
    return {"f_stop": _EXPOSED_F, "shutter": min(max(shutter, 1e-6), 1e6)}


def image_of(item: dict[str, Any], resolution: list[float] | None) -> dict[str, int]:
    """Size of the image: the resolution of the render settings, or the shape of the camera's aperture."""
    if resolution and len(resolution) == 2 and all(1 <= x <= 65536 for x in resolution):
        return {"width": int(resolution[0]), "height": int(resolution[1])}
    aspect = min(max(float(item["horizontalAperture"]) / float(item["verticalAperture"]), 1.0 / 16.0), 16.0)
    return {"width": round(_LONG_SIDE * min(aspect, 1.0)), "height": round(_LONG_SIDE / max(aspect, 1.0))}
