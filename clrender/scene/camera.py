"""The camera: its position, its direction, and its projection."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, ClassVar, Final, Literal

from pydantic import Field, Strict, model_validator

from clrender.image.exposure import PHOTOGRAPHIC
from clrender.meshes.data import COORDINATE_LIMIT
from clrender.scene.values import Finite, Flag, Length, Part, Vector, cross, fault, length

__all__ = ["Camera"]

_OF_CAMERAS: Final[Mapping[str, tuple[str, ...]]] = {
    "vertical_fov": ("perspective", "fisheye"),
    "height": ("orthographic",),
    "aperture_radius": ("perspective", "orthographic"),
    "focus_distance": ("perspective", "orthographic"),
    "blades": ("perspective", "orthographic"),
    "blade_rotation_degrees": ("perspective", "orthographic"),
    "mirrored": ("perspective", "orthographic"),
}
"""Camera types that allow these keys; all types allow the others."""

_FStop = Annotated[Finite, Field(ge=PHOTOGRAPHIC["f_stop"].low, le=PHOTOGRAPHIC["f_stop"].high)]
_Shutter = Annotated[Finite, Field(ge=PHOTOGRAPHIC["shutter"].low, le=PHOTOGRAPHIC["shutter"].high)]
_Speed = Annotated[Finite, Field(ge=PHOTOGRAPHIC["iso"].low, le=PHOTOGRAPHIC["iso"].high)]


class Camera(Part):
    """Camera. With an `aperture_radius` above 0, only objects at the `focus_distance` are in focus."""

    late_keys: ClassVar[frozenset[str]] = frozenset({"mirrored"})

    type: Literal["perspective", "orthographic", "panoramic", "fisheye"] = Field(
        "perspective",
        description="orthographic: parallel projection; panoramic: all directions, latitude-longitude; fisheye: "
        "equidistant projection, black outside of vertical_fov",
    )
    position: Vector = Field(description="position, metres, world space")
    target: Vector = Field(description="point at the centre of the image, metres, world space")
    up: Vector = Field((0.0, 1.0, 0.0), description="up direction; need not be perpendicular to the view direction")
    vertical_fov: Annotated[Finite, Field(gt=0.0, le=360.0)] = Field(
        45.0, description="field of view, degrees; perspective: below 180; fisheye: at most 360, usually 180"
    )
    height: Length = Field(2.0, description="orthographic only: height of the visible region, metres")
    aperture_radius: Annotated[Finite, Field(ge=0.0, le=COORDINATE_LIMIT)] = Field(
        0.0, description="radius of the lens, metres; 0: pinhole"
    )
    focus_distance: Length | None = Field(
        None, description="metres along the view direction; default: distance of the target"
    )
    blades: Annotated[int, Strict(), Field(ge=0, le=64)] = Field(
        0, description="number of aperture blades, at least 3; 0: circular aperture"
    )
    blade_rotation_degrees: Annotated[Finite, Field(ge=-360.0, le=360.0)] = Field(
        0.0, description="rotation of the aperture, from image right towards image up"
    )
    mirrored: Flag = Field(
        False, description="flips the image horizontally, for scenes from left-handed coordinate systems"
    )
    f_stop: _FStop | None = Field(
        None,
        description="f-number; with shutter, sets the exposure of display images; does not affect depth of field",
    )
    shutter: _Shutter | None = Field(
        None, description="exposure time of display images, seconds; there is no motion blur"
    )
    iso: _Speed | None = Field(None, description="film speed, with f_stop and shutter (default: 100)")

    @model_validator(mode="after")
    def _has_a_frame(self) -> Camera:
        view: Vector = tuple(t - p for t, p in zip(self.target, self.position, strict=True))  # type: ignore[assignment]
        if length(view) == 0.0:
            raise fault("camera", "is the same point as the camera's position; give another point to look at", "target")
        if length(self.up) == 0.0:
            raise fault("camera", "has length zero; give a direction such as [0, 1, 0]", "up")
        unit = tuple(v / length(view) for v in view)
        upward = tuple(v / length(self.up) for v in self.up)
        if length(cross(unit, upward)) < 1e-7:  # type: ignore[arg-type]
            raise fault("camera", "is parallel to the view from position to target; give another direction", "up")
        return self

    @property
    def reach(self) -> float:
        """Largest distance from `position` to a ray's origin, metres; infinite for an orthographic camera."""
        return math.inf if self.type == "orthographic" else self.aperture_radius

    @property
    def exposure(self) -> dict[str, float] | None:
        """The exposure settings, which affect only display images and not radiance; None if not given."""
        given = {name: getattr(self, name) for name in PHOTOGRAPHIC}
        return {name: value for name, value in given.items() if value is not None} or None

    @model_validator(mode="after")
    def _is_a_whole_exposure(self) -> Camera:
        for given in self.exposure or ():
            for missing in ("f_stop", "shutter"):
                if getattr(self, missing) is None:
                    cure = f"give f_stop and shutter, or leave {given} out"
                    raise fault("camera", f"is given without {missing}; {cure}", given)
        return self

    @model_validator(mode="after")
    def _has_what_its_type_has(self) -> Camera:
        for key, types in _OF_CAMERAS.items():
            if self.type not in types and getattr(self, key) != type(self).model_fields[key].default:
                raise fault("camera", f"is for cameras of type {' and '.join(types)} only; leave it out", key)
        if self.type == "perspective" and self.vertical_fov >= 180.0:
            raise fault(
                "camera", f"is {self.vertical_fov:g}, but of type perspective must be less than 180", "vertical_fov"
            )
        if self.blades in (1, 2):
            raise fault("camera", f"is {self.blades}, but must be 0, or at least 3", "blades")
        return self
