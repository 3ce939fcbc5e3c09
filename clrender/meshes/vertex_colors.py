"""Vertex colours of meshes: their encoding in files, and conversion to linear light."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.image.texel_tiles import coded_values

__all__ = ["VertexColors", "linear_colors"]

VertexColors: TypeAlias = Literal["auto", "srgb", "linear"]
"""Encoding of vertex colours in a shape's file; auto: the usual one of the file format."""


def linear_colors(colors: NDArray[np.floating], srgb: bool, label: str) -> NDArray[np.float32]:
    """Vertex colours in linear light.

    Parameters
    ----------
    colors : (V, 3) float
        From 0 to 1.
    srgb : bool
        Whether they are sRGB-encoded; they are then rounded to 16 bits, which keeps all multiples of 1/255.
    label : str
        Prefix of error messages.

    Raises
    ------
    SceneError
        A number is not from 0 to 1.
    """
    bad = ~((colors >= 0.0) & (colors <= 1.0)).all(axis=1)
    if bad.any():
        row = int(np.argmax(bad))
        values = ", ".join(f"{x:g}" for x in colors[row])
        raise SceneError(f"{label}: vertex {row} has the colour ({values}), but the numbers must be from 0 to 1")
    if not srgb:
        return colors.astype(np.float32)
    # Use a table, as power functions round differently on different machines
    return coded_values("unorm16", True)[np.round(colors.astype(np.float64) * 65535.0).astype(np.uint16)]
