"""Colours of a mesh's vertices: how they are encoded in files, and what they are in linear light."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.scene.texels import coded_values

__all__ = ["VertexColors", "linear_colors"]

VertexColors: TypeAlias = Literal["auto", "srgb", "linear"]
"""How a shape says that its file's colours are encoded; auto: as files of its kind mostly are."""


def linear_colors(colors: NDArray[np.floating], srgb: bool, label: str) -> NDArray[np.float32]:
    """Colours of vertices in linear light.

    Parameters
    ----------
    colors : (V, 3) float
        From 0 to 1.
    srgb : bool
        Whether they are encoded as sRGB; then 16 bits of them count. All multiples of 1/255 are among those.
    label : str
        Start of an error message.

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
    # A table, since power functions round differently on different machines
    return coded_values("unorm16", True)[np.round(colors.astype(np.float64) * 65535.0).astype(np.uint16)]
