"""Worlds of Blender as environments of clrender."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["BlenderWorld", "linear", "pfm_bytes", "world_table"]

_TILT: Final = 1e-4
"""Radians that a map may be tilted before it is noted."""


@dataclass(frozen=True)
class BlenderWorld:
    """A world of Blender.

    Attributes
    ----------
    color : tuple of float
        Times its strength, where there is no picture.
    strength : float
        Of the picture.
    file : str or None
        Environment map in latitude and longitude, beside the scene file.
    rotation : tuple of float
        Of the node `Mapping`, radians.
    inverse : bool
        Whether that node has the type `TEXTURE`, which turns the picture the other way.
    visible_camera : bool
    """

    color: tuple[float, float, float] = (0.0, 0.0, 0.0)
    strength: float = 1.0
    file: str | None = None
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inverse: bool = False
    visible_camera: bool = True


def world_table(world: BlenderWorld) -> tuple[dict[str, Any] | None, list[str]]:
    """The table of the environment, None for a black one, and notes of what is left out.

    Parameters
    ----------
    world : BlenderWorld
    """
    hidden = {} if world.visible_camera else {"visible_to_camera": False}
    if world.file is None:
        if not any(share > 0.0 for share in world.color):
            return None, []
        return {"type": "environment", "radiance": [max(share, 0.0) for share in world.color], **hidden}, []
    notes = []
    if max(abs(angle) for angle in world.rotation[:2]) > _TILT:
        notes.append("the tilt of the environment map was left out: it turns about the vertical axis only")
    # A node of the type POINT turns the direction that is looked up, and so the picture the other way.
    # The middle of Blender's maps is at +x, of clrender's at +z
    turn = math.degrees(world.rotation[2]) * (1.0 if world.inverse else -1.0)
    made = {"type": "environment", "file": world.file, "rotate_degrees": (90.0 + turn + 180.0) % 360.0 - 180.0}
    if world.strength != 1.0:
        made["scale"] = max(world.strength, 0.0)
    return {**made, **hidden}, notes


def linear(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Linear values of sRGB's, both of 1 for white (IEC 61966-2-1).

    Parameters
    ----------
    pixels : array of float32
    """
    low = pixels <= 0.04045
    return np.where(low, pixels / 12.92, ((np.maximum(pixels, 0.0) + 0.055) / 1.055) ** 2.4).astype(np.float32)


def pfm_bytes(pixels: NDArray[np.float32]) -> bytes:
    """A picture in the format PFM.

    Parameters
    ----------
    pixels : (height, width, 3) float32
        The lowest row first, as Blender and the format have it.
    """
    height, width, _ = pixels.shape
    header = f"PF\n{width} {height}\n-1.0\n".encode()
    return header + np.ascontiguousarray(pixels, "<f4").tobytes()
