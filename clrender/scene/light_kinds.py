"""The lights of a scene that are not shapes."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date
from typing import Annotated, Any, ClassVar, Final, Literal, TypeAlias

from pydantic import AfterValidator, BeforeValidator, Field, Strict, WithJsonSchema, model_validator

from clrender.errors import SceneError
from clrender.exact.angles import sin_cos_degrees
from clrender.exact.elementary import degrees_of
from clrender.scene.frozen import FrozenDict
from clrender.scene.poses import Motion, MotionKey
from clrender.scene.spectra import LightColor
from clrender.scene.sun_position import parsed_time, sun_position
from clrender.scene.textures import Parameter
from clrender.scene.transforms import affine
from clrender.scene.values import (
    POWER_LIMIT,
    Color,
    FileName,
    Finite,
    Flag,
    LayerName,
    Name,
    Part,
    Reflectance,
    Share,
    Vector,
    cross,
    fault,
    length,
)

__all__ = [
    "LIGHT_TYPES",
    "MOVING_LIGHTS",
    "WIDEST_PICTURE",
    "DirectionalLight",
    "EnvironmentLight",
    "IesLight",
    "Light",
    "MovingLight",
    "PluginLight",
    "PointLight",
    "ProjectorLight",
    "SpotLight",
    "SunSkyLight",
]


def _time_as_text(value: Any) -> Any:
    """Converts dates and times of TOML to text, since JSON has no type for them."""
    return value.isoformat() if isinstance(value, date) else value


Time = Annotated[str, BeforeValidator(_time_as_text), Strict(), WithJsonSchema({"type": "string"})]


_LEAST_CONE: Final = 0.01
"""Degrees; in single precision the edge of a narrower cone is not smooth."""


_RIGID: Final = 1e-4
"""Of products of a rotation's rows: the largest error of numbers with four or more digits."""


WIDEST_PICTURE: Final = 170.0
"""Degrees; a picture of 180 degrees would have no end."""


def _check_direction(direction: Vector, key: str = "direction", example: str = "[0, -1, 0]") -> None:
    if length(direction) == 0.0:
        raise fault("light", f"has length zero; give a direction such as {example}", key)


class _Grouped(Part):
    """What every light has."""

    late_keys: ClassVar[frozenset[str]] = frozenset({"light_group"})

    light_group: LayerName | None = Field(None, description="group of its light, for layers of light groups")


def _rigid(keys: tuple[MotionKey, ...]) -> tuple[MotionKey, ...]:
    """Refuse motions that scale, shear or mirror, which no light at a point could follow."""
    for index, key in enumerate(keys):
        rows = affine(key).linear
        products = [[sum(p * q for p, q in zip(a, b, strict=True)) for b in rows] for a in rows]
        uneven = any(abs(products[i][j] - float(i == j)) > _RIGID for i in range(3) for j in range(3))
        if uneven or affine(key).determinant < 0.0:
            where = "scale" if key.matrix is None else "matrix"
            sentence = (
                "scales, shears or mirrors, but a light can only turn and move; give a rotation and a translation"
            )
            raise fault("motion", sentence, index, where)
    return keys


class _Moving(_Grouped):
    """What every light has that is a point or a direction."""

    late_keys: ClassVar[frozenset[str]] = frozenset({"light_group", "motion"})

    motion: Annotated[Motion, AfterValidator(_rigid)] = Field(
        (), description="keys of a motion of rotations and translations; times ascend"
    )


class PointLight(_Moving):
    """Isotropic point light."""

    type: Literal["point"]
    position: Vector
    intensity: LightColor = Field(description="radiant intensity, W/sr")


class SpotLight(_Moving):
    """Point light that emits into a cone with a smooth falloff at its edge."""

    type: Literal["spot"]
    position: Vector
    direction: Vector = Field(description="axis of the cone")
    intensity: LightColor = Field(description="radiant intensity along the axis, W/sr")
    cone_degrees: Annotated[Finite, Field(gt=0.0, le=360.0)] = Field(description="full opening angle of the cone")
    blend: Share = Field(
        0.15, description="fraction of the cone's solid angle over which the intensity falls off to zero"
    )

    @model_validator(mode="after")
    def _has_a_direction(self) -> SpotLight:
        _check_direction(self.direction)
        if self.cone_degrees < _LEAST_CONE:
            raise fault("light", f"is {self.cone_degrees:g}; it must be at least {_LEAST_CONE:g}", "cone_degrees")
        return self


class IesLight(_Moving):
    """Point light with the measured angular distribution of an IES file."""

    type: Literal["ies"]
    position: Vector
    direction: Vector = Field((0.0, -1.0, 0.0), description="direction of vertical angle 0 of the file")
    file: FileName = Field(description="`.ies` file; its candela are converted at 683 cd per W/sr")
    horizontal_zero: Vector | None = Field(
        None,
        description="approximate direction of horizontal angle 0; angles increase counter-clockwise seen against "
        "`direction`; default: +z, or +y if `direction` is along z",
    )
    scale: LightColor = Field((1.0, 1.0, 1.0), description="factor for the intensity; a spectrum is that of the lamp")

    @model_validator(mode="after")
    def _has_directions(self) -> IesLight:
        _check_direction(self.direction)
        if self.horizontal_zero is not None and length(cross(self.horizontal_zero, self.direction)) <= (
            1e-6 * length(self.horizontal_zero) * length(self.direction)
        ):
            raise fault("light", "lies along `direction`; give one across it", "horizontal_zero")
        return self

    @property
    def zero(self) -> Vector:
        """`horizontal_zero`, or its default."""
        if self.horizontal_zero is not None:
            return self.horizontal_zero
        x, y, _ = self.direction
        return (0.0, 0.0, 1.0) if max(abs(x), abs(y)) > 1e-3 * length(self.direction) else (0.0, 1.0, 0.0)


class ProjectorLight(_Moving):
    """Point light that throws a picture, as a slide projector does: upright and unmirrored on a screen before it."""

    type: Literal["projector"]
    position: Vector
    direction: Vector = Field(description="direction of the middle of the picture")
    up: Vector = Field(
        (0.0, 1.0, 0.0), description="up direction of the picture; need not be perpendicular to `direction`"
    )
    file: FileName = Field(
        description="the picture: `.exr .hdr .pfm`, or one in sRGB, whose white is 1; interpolated bilinearly"
    )
    vertical_fov: Annotated[Finite, Field(gt=0.0, le=WIDEST_PICTURE)] = Field(
        30.0, description="angle between the picture's upper and lower edge, degrees"
    )
    even: Flag = Field(
        True,
        description="whether a white picture lights a screen across `direction` evenly; otherwise it has the same "
        "radiant intensity in all its directions",
    )
    scale: Color = Field(
        (1.0, 1.0, 1.0), description="radiant intensity along `direction` where the picture is 1, W/sr"
    )

    @model_validator(mode="after")
    def _has_directions(self) -> ProjectorLight:
        _check_direction(self.direction)
        _check_direction(self.up, "up", "[0, 1, 0]")
        if length(cross(self.direction, self.up)) <= 1e-6 * length(self.direction) * length(self.up):
            raise fault("light", "lies along `direction`; give one across it", "up")
        return self


class PluginLight(_Moving):
    """Point light whose radiant intensity by direction is a plugin's formula; `--plugin` gives its file, never a scene.

    In its frame z is `direction`; as seen along it, x is to the right, and y is up.
    """

    type: Literal["plugin"]
    position: Vector
    direction: Vector = Field(description="z axis of the light: the middle of its cone, if it has one")
    up: Vector | None = Field(
        None,
        description="up direction, y; need not be perpendicular to `direction` (default: +y, or +z if that lies along "
        "`direction`)",
    )
    plugin: Name = Field(description="name of the plugin")
    parameters: Annotated[dict[Name, Parameter], Field(max_length=16), AfterValidator(FrozenDict)] = Field(
        default_factory=FrozenDict,
        description="numbers and colours by the names that the plugin has for them (default: the plugin's)",
    )
    scale: LightColor = Field(
        (1.0, 1.0, 1.0), description="factor for the radiant intensity; a spectrum is that of the lamp"
    )

    @model_validator(mode="after")
    def _has_directions(self) -> PluginLight:
        _check_direction(self.direction)
        if self.up is not None:
            _check_direction(self.up, "up", "[0, 1, 0]")
            if length(cross(self.direction, self.up)) <= 1e-6 * length(self.direction) * length(self.up):
                raise fault("light", "lies along `direction`; give one across it", "up")
        return self

    @property
    def upward(self) -> Vector:
        """`up`, or its default."""
        if self.up is not None:
            return self.up
        x, _, z = self.direction
        return (0.0, 1.0, 0.0) if max(abs(x), abs(z)) > 1e-3 * length(self.direction) else (0.0, 0.0, 1.0)


class DirectionalLight(_Moving):
    """Directional light: parallel light from infinity."""

    type: Literal["directional"]
    direction: Vector = Field(description="direction in which the light travels")
    irradiance: LightColor = Field(description="irradiance on a perpendicular surface, W/m2")

    @model_validator(mode="after")
    def _has_a_direction(self) -> DirectionalLight:
        _check_direction(self.direction)
        return self


class EnvironmentLight(_Grouped):
    """Environment light: constant radiance, or an environment map in latitude-longitude format.

    The top of the map is at +y, its middle column at +z, and the column at a quarter of its width from the left edge
    at +x. The map is interpolated bilinearly.
    """

    late_keys: ClassVar[frozenset[str]] = frozenset({"visible_to_camera", "light_group"})

    type: Literal["environment"]
    radiance: LightColor | None = Field(None, description="constant radiance, W/(sr m2)")
    file: FileName | None = Field(
        None,
        description="environment map, instead of `radiance`: `.exr .hdr .pfm`, or a picture in sRGB, whose white is 1",
    )
    rotate_degrees: Finite = Field(0.0, description="rotation of the map about +y, from +z towards +x")
    scale: Color = Field((1.0, 1.0, 1.0), description="factor for the radiance")
    visible_to_camera: Flag = Field(
        True, description="false: the camera sees black in its place; it still lights the scene"
    )

    @model_validator(mode="after")
    def _is_one_of_both(self) -> EnvironmentLight:
        if (self.radiance is None) == (self.file is None):
            both = "needs" if self.file is None else "has both"
            words = "either `radiance` or `file`" if self.file is None else "`radiance` and `file`; keep one of them"
            raise fault("light", f"{both} {words}")
        if max(self.constant) > POWER_LIMIT:
            raise fault(
                "light", f"makes a radiance of {max(self.constant):g}; at most {POWER_LIMIT:g} is known", "scale"
            )
        return self

    @property
    def constant(self) -> Vector:
        """Radiance times scale, W/(sr m2), if it is constant; else black."""
        red, green, blue = (r * s for r, s in zip(self.radiance or (0.0, 0.0, 0.0), self.scale, strict=True))
        return (red, green, blue)


class SunSkyLight(_Grouped):
    """Clear sky and sun by the model of Hosek and Wilkie; the lower hemisphere is the ground.

    +y is up, -z north and +x east.
    """

    late_keys: ClassVar[frozenset[str]] = frozenset({"visible_to_camera", "light_group"})

    type: Literal["sun_sky"]
    sun_direction: Vector | None = Field(None, description="direction towards the sun")
    latitude: Annotated[Finite, Field(ge=-90.0, le=90.0)] | None = Field(
        None, description="degrees north; with `longitude` and `time`, instead of `sun_direction`"
    )
    longitude: Annotated[Finite, Field(ge=-180.0, le=180.0)] | None = Field(None, description="degrees east")
    time: Time | None = Field(
        None, description="date and time in ISO 8601 with the offset from UTC: `2026-06-21T18:30:00+02:00`"
    )
    turbidity: Annotated[Finite, Field(ge=1.0, le=10.0)] = Field(3.0, description="haze: 2 very clear, 3 clear, 6 hazy")
    ground_albedo: Reflectance = Field((0.3, 0.3, 0.3), description="albedo of the ground")
    ground: Flag = Field(
        True, description="whether the lower hemisphere is a ground lit by sun and sky; otherwise it is black"
    )
    sky_scale: Color = Field((1.0, 1.0, 1.0), description="factor for the sky's radiance; 0: sun only")
    sun_scale: Color = Field((1.0, 1.0, 1.0), description="factor for the sun's radiance; 0: sky only")
    scale: Color = Field((1.0, 1.0, 1.0), description="factor for both")
    rotate_degrees: Finite = Field(0.0, description="rotation of sun and sky about +y, from +z towards +x")
    visible_to_camera: Flag = Field(
        True, description="false: the camera sees black in its place; it still lights the scene"
    )

    @model_validator(mode="after")
    def _has_a_sun(self) -> SunSkyLight:
        place = {"latitude": self.latitude, "longitude": self.longitude, "time": self.time}
        given, missing = ([key for key, value in place.items() if (value is None) == none] for none in (False, True))
        if self.sun_direction is not None and given:
            raise fault("light", f"has both `sun_direction` and `{given[0]}`; keep one of them")
        if self.sun_direction is None and missing:
            words = "`sun_direction`, or `latitude`, `longitude` and `time`"
            raise fault("light", f"needs {words}" if not given else f"has `{given[0]}`, but no `{missing[0]}`; give it")
        if self.sun_direction is not None:
            _check_direction(self.sun_direction, "sun_direction", "[0, 1, 0]")
        elif self.time is not None:
            try:
                parsed_time(self.time)
            except ValueError as error:
                raise fault("light", str(error), "time") from None
        try:
            elevation = self.sun_elevation
        except SceneError as error:
            raise fault("light", f"cannot be placed: {error}", "time") from None
        if elevation < 0.0:
            sentence = f"puts the sun {-elevation:.4g} degrees below the horizon, but the sky is known by day only"
            if self.sun_direction is not None:
                raise fault("light", f"{sentence}; give a direction whose y is at least 0", "sun_direction")
            raise fault("light", f"{sentence}; give another time", "time")
        return self

    @property
    def sun_elevation(self) -> float:
        """Elevation of the sun above the horizon, degrees."""
        if self.sun_direction is None:
            return self._angles[0]
        x, y, z = self.sun_direction
        return degrees_of(y, length((x, 0.0, z)))

    @property
    def sun_turn(self) -> float:
        """Azimuth of the sun, degrees about +y from +z towards +x."""
        if self.sun_direction is None:
            return (180.0 - self._angles[1]) + self.rotate_degrees
        x, _, z = self.sun_direction
        return degrees_of(x, z) + self.rotate_degrees

    @property
    def sun_axis(self) -> Vector:
        """Unit vector towards the sun."""
        (rise, level), (right, ahead) = sin_cos_degrees(self.sun_elevation), sin_cos_degrees(self.sun_turn)
        return (level * right, rise, level * ahead)

    @property
    def _angles(self) -> tuple[float, float]:
        assert self.latitude is not None and self.longitude is not None and self.time is not None
        return sun_position(self.latitude, self.longitude, self.time)


MovingLight: TypeAlias = PointLight | SpotLight | IesLight | ProjectorLight | PluginLight | DirectionalLight
"""Lights that may have a motion."""
MOVING_LIGHTS: Final = (PointLight, SpotLight, IesLight, ProjectorLight, PluginLight, DirectionalLight)
LIGHT_TYPES: Final[Mapping[str, type[Part]]] = {
    "point": PointLight,
    "spot": SpotLight,
    "ies": IesLight,
    "projector": ProjectorLight,
    "plugin": PluginLight,
    "directional": DirectionalLight,
    "environment": EnvironmentLight,
    "sun_sky": SunSkyLight,
}
Light: TypeAlias = Annotated[
    PointLight
    | SpotLight
    | IesLight
    | ProjectorLight
    | PluginLight
    | DirectionalLight
    | EnvironmentLight
    | SunSkyLight,
    Field(discriminator="type"),
]
