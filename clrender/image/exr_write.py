"""Writes OpenEXR files: an image and its layers, with the chosen precision and compression, directly to disk."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Set
from dataclasses import dataclass
from typing import IO, Any, Final

import numpy as np
import numpy.typing as npt

from clrender.errors import UsageError

__all__ = ["COMPRESSIONS", "ExrFormat", "half_of", "write_exr"]

COMPRESSIONS: Final[Mapping[str, bool]] = {
    "none": False,
    "rle": False,
    "zips": False,
    "zip": False,
    "piz": False,
    "pxr24": True,
    "dwaa": True,
    "dwab": True,
}
"""Every compression, and whether it is lossy."""

_TYPES: Final = ("float", "half")
_TILES: Final = (16, 4096)
_LARGEST_HALF: Final = np.float16(65504.0)
_ROWS: Final = 256


@dataclass(frozen=True)
class ExrFormat:
    """Storage format of pixels in an OpenEXR file.

    Attributes
    ----------
    type : str
        ``float``: 32 bits, lossless; ``half``: 16 bits, except for the exact channels of `write_exr`. Finite values
        beyond 65504 become 65504.
    compression : str
        One of `COMPRESSIONS`.
    tile : int or None
        Side of square tiles, pixels; None: scan lines.

    Raises
    ------
    UsageError
        An invalid value.
    """

    type: str = "float"
    compression: str = "zip"
    tile: int | None = None

    def __post_init__(self) -> None:
        if self.type not in _TYPES:
            raise UsageError(f"exr_type is {self.type!r}, but must be {' or '.join(_TYPES)}")
        if self.compression not in COMPRESSIONS:
            raise UsageError(f"exr_compression is {self.compression!r}, but must be one of {', '.join(COMPRESSIONS)}")
        low, high = _TILES
        if self.tile is not None and not (isinstance(self.tile, int) and low <= self.tile <= high):
            raise UsageError(f"exr_tile is {self.tile!r}, but must be a whole number from {low} to {high}")

    @property
    def lossy(self) -> bool:
        """Whether the compression is lossy."""
        return COMPRESSIONS[self.compression]


def write_exr(
    file: IO[bytes],
    image: npt.NDArray[np.float32],
    attributes: Mapping[str, str],
    channels: Mapping[str, npt.NDArray[np.float32]],
    layout: ExrFormat | None = None,
    exact: Set[str] = frozenset(),
) -> None:
    """Write R, G and B, and more channels.

    Besides `image` and `channels`, it needs memory for a few lines or tiles, and for copies in half precision.

    Parameters
    ----------
    file : binary file
        Open for writing, with ``tell`` and ``seek``.
    image : (H, W, 3) float32
        Linear Rec. 709.
    attributes : mapping of str to str
        Stored in the header.
    channels : mapping of str to (H, W) float32
        Must be contiguous: otherwise the library writes wrong numbers.
    layout : ExrFormat, optional
    exact : set of str
        Names of `channels` that are always 32-bit floats.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    layout = layout or ExrFormat()
    library: Any = importlib.import_module("OpenEXR")
    compression = "no" if layout.compression == "none" else layout.compression
    header: dict[str, Any] = {
        "compression": getattr(library, f"{compression.upper()}_COMPRESSION"),
        "type": library.scanlineimage if layout.tile is None else library.tiledimage,
        **attributes,
    }
    if layout.tile is not None:
        tiles = library.TileDescription()
        tiles.xSize = tiles.ySize = layout.tile
        header["tiles"] = tiles
    half = layout.type == "half"
    held = {"RGB": image, **channels}
    planes = {
        name: half_of(plane) if half and name not in exact else np.ascontiguousarray(plane)
        for name, plane in held.items()
    }
    # Write to the open file, not to a path: then a full disk raises OSError.
    with library.File(header, planes) as picture:
        picture.write(file)


def half_of(plane: npt.NDArray[np.float32]) -> npt.NDArray[np.float16]:
    """Rounded to nearest; finite values stay finite."""
    result = np.empty(plane.shape, np.float16)
    for first in range(0, len(plane), _ROWS):
        rows = plane[first : first + _ROWS]
        with np.errstate(over="ignore"):
            made = rows.astype(np.float16)
        beyond = np.isinf(made) & np.isfinite(rows)
        made[beyond] = np.copysign(_LARGEST_HALF, rows[beyond])
        result[first : first + _ROWS] = made
    return result
