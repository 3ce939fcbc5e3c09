"""Colours of diffuse surfaces below a boundary, where light is reflected to and fro: of constants and of pictures."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.image.exr_write import ExrFormat, write_exr
from clrender.image.pictures import Picture, open_picture
from clrender.image.texel_tiles import coded_values
from clrender.importers.shared.fresnel import internal_reflectance
from clrender.importers.shared.staging import Staging

__all__ = ["below_boundary"]


def below_boundary(staging: Staging, base: Any, ior: float, line: int) -> Any:
    """The colour of all the light that a diffuse surface returns to a smooth boundary above it, over its first share.

    Of light in the denser medium the boundary reflects the share i on average, so that a surface of reflectance x
    returns x (1 - i) / (1 - x i) as if there were no boundary inside (Egan & Hilgeman 1979). The curve applies to the
    texels of a picture, which becomes another one in half precision.

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
    inner = internal_reflectance(ior)
    if isinstance(base, list):
        return _bent(np.array(base), inner).tolist()
    if "checker" in base:
        return {**base, "checker": [_bent(np.array(color), inner).tolist() for color in base["checker"]]}
    if "texture" not in base:
        staging.note("light that is reflected inside of a plastic with a ramp of colours is left out: it is lighter")
        return base
    scale = base.get("scale", [1.0] * 3)
    srgb = base.get("color_space")
    kept = {key: value for key, value in base.items() if key not in ("scale", "color_space", "texture")}
    name = f"{base['texture']} (below an index of {ior!r}, times {scale!r}, {srgb})"
    if name not in staging.draft.pictures:
        try:
            staging.draft.pictures[name] = _picture(staging, base["texture"], srgb, scale, inner, line), ".exr"
        except Exception as fault:  # whatever a library stumbles over: the reader of the picture itself reports it
            if isinstance(fault, MemoryError):
                raise SceneError(f"{staging.files.source}: {base['texture']!a} is too large for this machine") from None
            return base
    return {**kept, "texture": name}


def _bent(x: NDArray[np.floating], inner: float) -> NDArray[np.floating]:
    return np.asarray(x * (1.0 - inner) / (1.0 - x * inner))


def _picture(staging: Staging, name: str, srgb: str | None, scale: Any, inner: float, line: int) -> bytes:
    """An OpenEXR file of the picture behind the curve."""
    file, _ = staging.files.open(name, f"line {line}")
    with file:
        picture = open_picture(file, Path(name).suffix.lower())
        bent = np.empty((picture.height, picture.width, 3), np.float16)
        row = 0
        for band in picture.bands():
            linear = _linear(picture, band[..., :3], srgb) * np.asarray(scale, np.float32)
            bent[row : row + len(band)] = _bent(np.clip(linear, 0.0, 1.0), inner)
            row += len(band)
    data = io.BytesIO()
    write_exr(data, bent, {}, {}, ExrFormat(type="half", compression="none"))  # type: ignore[arg-type]
    return data.getvalue()


def _linear(picture: Picture, band: NDArray[Any], color_space: str | None) -> NDArray[np.float32]:
    """Linear values of texels, (h, w, 1 or 3)."""
    if picture.coding == "float":
        return np.asarray(band, np.float32)
    return np.asarray(coded_values(picture.coding, color_space != "linear")[band])
