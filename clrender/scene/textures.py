"""Textures of a scene file: images, checkers and ramps that replace a colour or a number."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Final, Literal, TypeAlias, get_args

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, StringConstraints, Tag, WithJsonSchema

from clrender.scene.frozen import FrozenDict
from clrender.scene.spectra import light_branch, reflectance_branch, spectrum_form
from clrender.scene.values import Color, Finite, Name, Part, Power, Reflectance, Share, fault

__all__ = [
    "AnyTexture",
    "BumpMap",
    "Checker",
    "ColorOrTexture",
    "ImageTexture",
    "MaterialTexture",
    "NormalMap",
    "ParameterOrTexture",
    "PictureShare",
    "PluginTexture",
    "Ramp",
    "ReflectanceOrTexture",
    "ShareOrTexture",
    "Texture",
    "TextureTransform",
    "ThicknessMap",
    "ThicknessOrTexture",
    "textures_of",
]

FileName = Annotated[str, StringConstraints(strict=True, min_length=1, max_length=4096)]
Wrap: TypeAlias = Literal["repeat", "clamp", "mirror"]
_UV_LIMIT: Final = 1e6


def _pair(value: Any) -> Any:
    """Accepts one number, or name, for both directions."""
    return value if isinstance(value, list | tuple) else (value, value)


def _triple(value: Any) -> Any:
    """Accepts one number as a grey."""
    return value if isinstance(value, list | tuple) else (value, value, value)


def _or_list(one: dict[str, Any], count: int) -> WithJsonSchema:
    """JSON Schema of one value, or of a list of `count`."""
    return WithJsonSchema({"anyOf": [one, {"type": "array", "items": one, "minItems": count, "maxItems": count}]})


_NUMBER: Final = {"type": "number"}
Coordinate = Annotated[Finite, Field(ge=-_UV_LIMIT, le=_UV_LIMIT)]
FilmThickness: TypeAlias = Annotated[Finite, Field(ge=0.0, le=10000.0)]
Step = Annotated[Finite, Field(gt=0.0, le=_UV_LIMIT)]
Grey: TypeAlias = Annotated[tuple[Power, Power, Power], BeforeValidator(_triple), _or_list(_NUMBER, 3)]
Wraps: TypeAlias = Annotated[
    tuple[Wrap, Wrap],
    BeforeValidator(_pair),
    _or_list({"enum": list(get_args(Wrap)), "type": "string"}, 2),
]


class TextureTransform(Part):
    """Transform of texture coordinates before the lookup: scale, counter-clockwise rotation, offset, in this order."""

    offset: tuple[Coordinate, Coordinate] = (0.0, 0.0)
    rotate_degrees: Finite = 0.0
    scale: Annotated[tuple[Coordinate, Coordinate], BeforeValidator(_pair), _or_list(_NUMBER, 2)] = Field(
        (1.0, 1.0), description="scale of the coordinates; 2: the texture repeats twice as often"
    )


class _Mapped(Part):
    """What every texture has."""

    uv_set: Literal[0, 1] = Field(0, description="index of the texture coordinate set")
    transform: TextureTransform = TextureTransform()


class ImageTexture(_Mapped):
    """Image texture: `.png .jpg .webp .tga .bmp .ppm .tif .gif .dds`, or linear `.exr .hdr .pfm`.

    (0, 0) is its lower left corner, (1, 1) upper right.
    """

    texture: FileName = Field(description="image file")
    color_space: Literal["srgb", "linear"] | None = Field(
        None, description="encoding of the file; default: linear for .exr, .hdr and .pfm, and for numbers, else srgb"
    )
    wrap: Wraps = Field(
        ("repeat", "repeat"), description="wrap mode outside of [0, 1]; a list of two sets u and v separately"
    )
    filter: Literal["linear", "nearest"] = Field("linear", description="interpolation between texels")
    channel: Literal["r", "g", "b", "a", "luminance"] | None = Field(
        None, description="channel to use as a grey value or number; default: all for a colour, r for a number"
    )
    scale: Grey = Field((1.0, 1.0, 1.0), description="factor for the values, or one per colour channel")


class Checker(_Mapped):
    """Checkerboard of two colours or numbers; the first square is at (0, 0)."""

    checker: tuple[Grey, Grey]
    size: Annotated[tuple[Step, Step], BeforeValidator(_pair), _or_list(_NUMBER, 2)] = Field(
        (0.5, 0.5), description="size of a square, in texture coordinates"
    )


class Ramp(_Mapped):
    """Colours or numbers at equidistant values of u from 0 to 1, interpolated linearly and constant outside."""

    ramp: Annotated[tuple[Grey, ...], Field(min_length=2, max_length=256)]


class PluginTexture(_Mapped):
    """Texture of a plugin, computed from texture coordinates or the place in the world; `--plugin` gives its file."""

    plugin: Name = Field(description="name of the plugin")
    parameters: Annotated[dict[Name, Parameter], Field(max_length=16), AfterValidator(FrozenDict)] = Field(
        default_factory=FrozenDict, description="numbers and colours by the names that the plugin has for them"
    )


class NormalMap(_Mapped):
    """Tangent-space normal map: red along u, green along v, blue outward; the middle value of red and green is 0."""

    texture: FileName = Field(description="image file")
    scale: Annotated[Finite, Field(ge=-100.0, le=100.0)] = Field(1.0, description="factor for red and green")
    wrap: Wraps = ("repeat", "repeat")
    filter: Literal["linear", "nearest"] = "linear"


class BumpMap(_Mapped):
    """Height map that perturbs the shading normal."""

    texture: FileName = Field(description="image file")
    scale: Annotated[Finite, Field(ge=-1e6, le=1e6)] = Field(1.0, description="height of the value 1, metres")
    wrap: Wraps = ("repeat", "repeat")
    channel: Literal["r", "g", "b", "a", "luminance"] = "r"


class ThicknessMap(_Mapped):
    """Thickness of a thin film, from an image."""

    texture: FileName = Field(description="image file")
    range: tuple[FilmThickness, FilmThickness] = Field(description="thickness where the image is 0 and 1, nanometres")
    wrap: Wraps = ("repeat", "repeat")
    filter: Literal["linear", "nearest"] = "linear"
    channel: Literal["r", "g", "b", "a", "luminance"] = "r"


Texture: TypeAlias = ImageTexture | Checker | Ramp
AnyTexture: TypeAlias = Texture | NormalMap | BumpMap | ThicknessMap
MaterialTexture: TypeAlias = AnyTexture | PluginTexture
_FORMS: Final[Mapping[str, type[Part]]] = {
    "texture": ImageTexture,
    "checker": Checker,
    "ramp": Ramp,
    "plugin": PluginTexture,
}


def _form(value: Any) -> str:
    """Tag of the union member below that a value is meant for; `validation_errors` knows these tags."""
    if isinstance(value, Part):
        return next((f"<{name}>" for name, table in _FORMS.items() if isinstance(value, table)), "<constant>")
    if spectrum_form(value):
        return "<spectrum>"
    if isinstance(value, Mapping):
        return next((f"<{name}>" for name in ("checker", "ramp", "plugin") if name in value), "<texture>")
    return "<constant>"


def _picture(value: Any) -> Any:
    """Refuses the textures of plugins where the host has to know the values before it renders."""
    if isinstance(value, PluginTexture) or (isinstance(value, Mapping) and "plugin" in value):
        raise fault("texture", "is the texture of a plugin, which only materials can have that reflect; give a picture")
    return value


def _parameter_form(value: Any) -> str:
    form = _form(value)
    return form if form != "<constant>" else "<color>" if isinstance(value, list | tuple) else "<number>"


_Texture: TypeAlias = (
    Annotated[ImageTexture, Tag("<texture>")] | Annotated[Checker, Tag("<checker>")] | Annotated[Ramp, Tag("<ramp>")]
)
_Made: TypeAlias = Annotated[PluginTexture, Tag("<plugin>")]
ReflectanceOrTexture: TypeAlias = Annotated[
    Annotated[Reflectance, Tag("<constant>")] | reflectance_branch | _Texture | _Made, Discriminator(_form)
]
ColorOrTexture: TypeAlias = Annotated[
    Annotated[Color, Tag("<constant>")] | light_branch | _Texture, Discriminator(_form), BeforeValidator(_picture)
]
ShareOrTexture: TypeAlias = Annotated[Annotated[Share, Tag("<constant>")] | _Texture | _Made, Discriminator(_form)]
PictureShare: TypeAlias = Annotated[
    Annotated[Share, Tag("<constant>")] | _Texture, Discriminator(_form), BeforeValidator(_picture)
]
"""A number, or a texture whose values are known before anything is rendered."""
_Number: TypeAlias = Annotated[Finite, Tag("<number>")]
_Triple: TypeAlias = Annotated[tuple[Finite, Finite, Finite], Tag("<color>")]
Parameter: TypeAlias = Annotated[_Number | _Triple, Discriminator(_parameter_form)]
"""A parameter of a plugin's texture."""
ParameterOrTexture: TypeAlias = Annotated[_Number | _Triple | _Texture | _Made, Discriminator(_parameter_form)]
"""A parameter of a plugin's material."""


def _thickness_form(value: Any) -> str:
    return "<texture>" if isinstance(value, Mapping | ThicknessMap) else "<constant>"


ThicknessOrTexture: TypeAlias = Annotated[
    Annotated[FilmThickness, Tag("<constant>")] | Annotated[ThicknessMap, Tag("<texture>")],
    Discriminator(_thickness_form),
]


def textures_of(part: Part) -> Iterator[tuple[str, MaterialTexture]]:
    """Textures of a material, with their keys; that of a plugin's parameter is ``parameters.NAME``.

    Parameters
    ----------
    part : Part
        A material.
    """
    for name in type(part).model_fields:
        value = getattr(part, name)
        if isinstance(value, _Mapped):
            yield name, value  # type: ignore[misc]  # there are no others
        elif isinstance(value, FrozenDict):
            yield from (
                (f"{name}.{key}", each) for key, each in value.items() if isinstance(each, Texture | PluginTexture)
            )
