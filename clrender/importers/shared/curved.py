"""Colours and numbers behind a curve: of constants, and texel by texel of pictures, which become other pictures."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.errors import OutOfMemory
from clrender.exact.matrices import total
from clrender.image.exr_write import ExrFormat, write_exr
from clrender.image.pictures import Picture, open_picture
from clrender.image.texel_values import texel_colors, texel_numbers
from clrender.image.tone_map import srgb_decode
from clrender.importers.shared.fresnel import below_coat, immersed, internal_reflectance
from clrender.importers.shared.staging import Staging

__all__ = [
    "below_boundary",
    "coated_metal",
    "decoded",
    "green_reversed",
    "inverted",
    "map_of",
    "mean_color",
    "mean_of_picture",
    "number_channel",
    "rooted",
]

_Curve: TypeAlias = Callable[[NDArray[np.floating]], NDArray[np.floating]]
_OF_MAPS: Final = ("texture", "wrap", "transform")
_OPAQUE: Final = {"unorm8": 255, "unorm16": 65535, "half": 0x3C00, "float": 1}
"""Values of alpha where a picture hides everything."""


def below_boundary(staging: Staging, base: Any, ior: float, line: int) -> Any:
    """The colour of all the light that a diffuse surface returns to a smooth boundary above it, over its first share.

    Of light in the denser medium the boundary reflects the share i on average, so that a surface of reflectance x
    returns x (1 - i) / (1 - x i) as if there were no boundary inside (Egan & Hilgeman 1979).

    Parameters
    ----------
    staging : Staging
        Receives the picture.
    base : list of float, or dict
        A reflectance, or a texture of one as in a scene file.
    ior : float
        Index of refraction inside relative to that outside; at least 1.
    line : int
        Of the texture, for messages.
    """
    inside = internal_reflectance(ior)

    def curve(x: NDArray[np.floating]) -> NDArray[np.floating]:
        return np.asarray(x * (1.0 - inside) / (1.0 - x * inside))

    return _curved(staging, base, curve, f"below an index of {ior!r}", line, number=False)


def coated_metal(staging: Staging, reflectance: Any, ior: float, line: int) -> Any:
    """The colour of all that a metal below a smooth coat returns, at normal incidence, over the coat's own reflection.

    Parameters
    ----------
    staging : Staging
        Receives the picture.
    reflectance : list of float, or dict
        That of the metal in vacuum, or a texture of it as in a scene file.
    ior : float
        Index of refraction of the coat; at least 1.
    line : int
        Of the texture, for messages.
    """

    def curve(x: NDArray[np.floating]) -> NDArray[np.floating]:
        return below_coat(immersed(x, ior), ior)

    return _curved(staging, reflectance, curve, f"metal below a coat of index {ior!r}", line, number=False)


def rooted(staging: Staging, value: Any, times: int, line: int) -> Any:
    """The square root of a number between 0 and 1, taken so many times: our roughness for that of other renderers.

    Parameters
    ----------
    staging : Staging
        Receives the picture.
    value : float or dict
        A number, or a texture of one as in a scene file.
    times : int
    line : int
        Of the texture, for messages.
    """

    def curve(x: NDArray[np.floating]) -> NDArray[np.floating]:
        for _ in range(times):
            x = np.sqrt(x)
        return x

    return _curved(staging, value, curve, f"square root, {times} times", line, number=True)


def decoded(staging: Staging, value: dict[str, Any], line: int) -> Any:
    """A number from a channel that is taken as it is, such as alpha, as if it were coded as sRGB.

    For the parameters see `rooted`.
    """
    return _curved(staging, value, srgb_decode, "as sRGB", line, number=True)


def map_of(staging: Staging, texture: dict[str, Any], line: int, number: bool = True) -> dict[str, Any]:
    """A bump or normal map, whose numbers are taken as they are, from a texture; decoded if that is coded as sRGB.

    Parameters
    ----------
    staging : Staging
        Receives the picture.
    texture : dict
        As in a scene file. Its scale is not that of the map.
    line : int
        Of the texture, for messages.
    number : bool
        Whether it is a map of heights, of one channel.
    """
    own = (*_OF_MAPS, "channel" if number else "filter")
    kept = {key: texture[key] for key in own if key in texture}
    if texture.get("color_space") != "srgb":
        return kept
    made = _curved(staging, {**kept, "color_space": "srgb"}, lambda x: x, "decoded", line, number, precise=True)
    return {key: made[key] for key in own if key in made}


def green_reversed(staging: Staging, texture: dict[str, Any]) -> dict[str, Any]:
    """A normal map whose green points the other way.

    Parameters
    ----------
    staging : Staging
        Receives the picture.
    texture : dict
        As in a scene file.
    """

    def turned(picture: Picture, band: NDArray[Any]) -> NDArray[np.floating]:
        most = _OPAQUE[picture.coding] if picture.coding.startswith("unorm") else None
        # Of integers the middle is 0 in a normal map, and the step is that above it
        middle, steepness = (0.5, 1.0) if most is None else ((most + 1.0) / 2.0 / most, most / (most - 1.0))
        slopes = (texel_colors(picture, band, False).astype(np.float64) - middle) * steepness
        return slopes * (1.0, -1.0, 1.0) + 0.5

    name = f"{texture['texture']} (green reversed)"
    if name not in staging.draft.pictures:
        try:
            staging.draft.pictures[name] = _made(staging, texture["texture"], 0, turned, precise=True), ".exr"
        except MemoryError:
            raise OutOfMemory(f"{staging.files.source}: {texture['texture']!a} is too large for this machine") from None
        except Exception:  # whatever a library stumbles over: the reader of the picture itself reports it
            return texture
    return {**texture, "texture": name}


def inverted(staging: Staging, value: Any, line: int, number: bool) -> Any:
    """One minus a colour, or a number, of 0 to 1.

    Parameters
    ----------
    staging : Staging
        Receives the picture.
    value : list of float, or dict
    line : int
        Of the texture, for messages.
    number : bool
        Whether it is a number, of one channel.
    """
    return _curved(staging, value, lambda x: 1.0 - x, "inverted", line, number)


def number_channel(staging: Staging, name: str, line: int) -> str:
    """The channel of a picture that pbrt takes as a number: alpha, unless it is 1 everywhere; else the mean of colours.

    Parameters
    ----------
    staging : Staging
    name : str
        File name of the picture.
    line : int
        Of the texture, for messages.

    Returns
    -------
    str
        ``r`` for a grey picture, ``luminance`` for others without alpha.
    """
    grey = True
    try:
        with _opened(staging, name, line) as picture:
            for band in picture.bands() if picture.channels > 1 else ():
                if (band[..., 3] != _OPAQUE[picture.coding]).any():
                    return "a"
                grey = grey and bool((band[..., :1] == band[..., 1:3]).all())
    except Exception:  # whatever a library stumbles over: the reader of the picture itself reports it
        return "r"
    return "r" if grey else "luminance"


def mean_color(staging: Staging, texture: dict[str, Any], default: float, line: int) -> list[float]:
    """The mean colour of a texture, 0 to 1.

    Parameters
    ----------
    staging : Staging
    texture : dict
        As in a scene file.
    default : float
        Grey that stands for a picture that cannot be read.
    line : int
        Of the texture, for messages.
    """
    for key in ("checker", "ramp"):
        if key in texture:
            found: list[float] = np.clip(total(texture[key]) / len(texture[key]), 0.0, 1.0).tolist()
            return found
    mean = mean_of_picture(staging, texture, line)
    if mean is None:
        return [default] * 3
    scale = np.asarray(texture.get("scale", 1.0), np.float64)
    made: list[float] = np.clip(mean * scale * np.ones(3), 0.0, 1.0).tolist()
    return made


def mean_of_picture(staging: Staging, texture: dict[str, Any], line: int) -> NDArray[np.float64] | None:
    """The mean colour of the picture of a texture, (3,), without its scale; None if it cannot be read.

    For the parameters see `mean_color`.
    """
    try:
        with _opened(staging, texture["texture"], line) as picture:
            srgb = texture.get("color_space", "srgb") == "srgb"
            rows = [total(texel_colors(picture, band, srgb)) for band in picture.bands()]
    except Exception:  # whatever a library stumbles over
        return None
    return np.asarray(total(total(np.array(rows))) / (picture.width * picture.height))


def _curved(
    staging: Staging, value: Any, curve: _Curve, told: str, line: int, number: bool, precise: bool = False
) -> Any:
    """A colour or number, or a texture, behind a curve; `precise` where slopes count, which half precision spoils."""
    if not isinstance(value, dict):
        made = curve(np.clip(np.array(value, np.float64), 0.0, 1.0))
        return float(made) if made.ndim == 0 else made.tolist()
    for key in ("checker", "ramp"):
        if key in value:
            return {**value, key: [curve(np.clip(np.array(each), 0.0, 1.0)).tolist() for each in value[key]]}
    used = {key: value[key] for key in ("channel", "color_space", "scale") if key in value}
    name = f"{value['texture']} ({told}, {used!r})"
    if name not in staging.draft.pictures:
        try:
            staging.draft.pictures[name] = _picture(staging, value, curve, line, number, precise), ".exr"
        except MemoryError:
            raise OutOfMemory(f"{staging.files.source}: {value['texture']!a} is too large for this machine") from None
        except Exception:  # whatever a library stumbles over: the reader of the picture itself reports it
            return value
    kept = {key: each for key, each in value.items() if key not in used}
    return {**kept, "texture": name, **({"channel": "r"} if number else {})}


@contextmanager
def _opened(staging: Staging, name: str, line: int) -> Iterator[Picture]:
    """A picture of the draft, or of a file."""
    if name in staging.draft.pictures:
        data, ending = staging.draft.pictures[name]
        yield open_picture(io.BytesIO(data), ending)
        return
    file, _ = staging.files.open(name, f"line {line}")
    with file:
        yield open_picture(file, Path(name).suffix.lower())


def _picture(staging: Staging, texture: dict[str, Any], curve: _Curve, line: int, number: bool, precise: bool) -> bytes:
    """An OpenEXR file of a texture's values behind the curve, in half or in single precision."""
    scale = np.asarray(texture.get("scale", [1.0] * 3), np.float32)
    srgb = texture.get("color_space", "linear" if number else "srgb") == "srgb"

    def curved(picture: Picture, band: NDArray[Any]) -> NDArray[np.floating]:
        values = (
            texel_numbers(picture, band, srgb, texture.get("channel", "r"))
            if number
            else texel_colors(picture, band, srgb)
        )
        return curve(np.clip(values * (scale[:1] if number else scale), 0.0, 1.0))

    return _made(staging, texture["texture"], line, curved, precise)


def _made(
    staging: Staging,
    name: str,
    line: int,
    convert: Callable[[Picture, NDArray[Any]], NDArray[np.floating]],
    precise: bool,
) -> bytes:
    """An OpenEXR file of what becomes of a picture's bands, in half or in single precision."""
    with _opened(staging, name, line) as picture:
        made = np.empty((picture.height, picture.width, 3), np.float32 if precise else np.float16)
        row = 0
        for band in picture.bands():
            made[row : row + len(band)] = convert(picture, band)
            row += len(band)
    data = io.BytesIO()
    write_exr(data, made, {}, {}, ExrFormat(type="float" if precise else "half", compression="none"))
    return data.getvalue()
