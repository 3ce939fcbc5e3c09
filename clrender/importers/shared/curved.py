"""Colours and numbers behind a curve: of constants, and texel by texel of pictures, which become other pictures."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.image.exr_write import ExrFormat, write_exr
from clrender.image.pictures import open_picture
from clrender.image.texel_values import texel_colors, texel_numbers
from clrender.importers.shared.fresnel import internal_reflectance
from clrender.importers.shared.staging import Staging

__all__ = ["below_boundary", "rooted"]

_Curve: TypeAlias = Callable[[NDArray[np.floating]], NDArray[np.floating]]


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


def _curved(staging: Staging, value: Any, curve: _Curve, told: str, line: int, number: bool) -> Any:
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
            staging.draft.pictures[name] = _picture(staging, value, curve, line, number), ".exr"
        except MemoryError:
            raise SceneError(f"{staging.files.source}: {value['texture']!a} is too large for this machine") from None
        except Exception:  # whatever a library stumbles over: the reader of the picture itself reports it
            return value
    kept = {key: each for key, each in value.items() if key not in used}
    return {**kept, "texture": name, **({"channel": "r"} if number else {})}


def _picture(staging: Staging, texture: dict[str, Any], curve: _Curve, line: int, number: bool) -> bytes:
    """An OpenEXR file of a texture's values behind the curve, in half precision."""
    file, _ = staging.files.open(texture["texture"], f"line {line}")
    scale = np.asarray(texture.get("scale", [1.0] * 3), np.float32)
    srgb = texture.get("color_space", "linear" if number else "srgb") == "srgb"
    with file:
        picture = open_picture(file, Path(texture["texture"]).suffix.lower())
        made = np.empty((picture.height, picture.width, 3), np.float16)
        row = 0
        for band in picture.bands():
            values = (
                texel_numbers(picture, band, srgb, texture.get("channel", "r"))
                if number
                else texel_colors(picture, band, srgb)
            )
            made[row : row + len(band)] = curve(np.clip(values * (scale[:1] if number else scale), 0.0, 1.0))
            row += len(band)
    data = io.BytesIO()
    write_exr(data, made, {}, {}, ExrFormat(type="half", compression="none"))  # type: ignore[arg-type]
    return data.getvalue()
