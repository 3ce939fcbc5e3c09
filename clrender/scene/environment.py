"""Environment maps: reads and validates the pictures that scenes name."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError, UsageError
from clrender.files.named import allowed_file, open_named_file
from clrender.image.files import read_open_image
from clrender.image.raster import RASTER_ENDINGS
from clrender.scene.values import POWER_LIMIT
from clrender.wording import quoted

__all__ = ["ENDINGS", "EnvironmentPicture"]

ENDINGS: Final = (".exr", ".hdr", ".pfm", ".png", ".jpg", ".jpeg", *RASTER_ENDINGS)
_PIXEL_LIMIT: Final = 2**28
"""Most pixels, such as 16384 x 16384; each takes 16 bytes on the device."""
_FILE_LIMIT: Final = 2**33


@dataclass(frozen=True)
class EnvironmentPicture:
    """Radiance by latitude and longitude, as stored in a file.

    Attributes
    ----------
    pixels : (H, W, 3) float32
        Linear Rec. 709, finite, not below 0; the first row is at +y, the middle column at +z, the right edge at -z.
    """

    pixels: NDArray[np.float32]

    def sha256(self) -> str:
        """Hash of the size and the pixels."""
        return self._sha256

    @cached_property
    def _sha256(self) -> str:
        digest = hashlib.sha256(f"{self.pixels.shape}".encode())
        for row in self.pixels:
            digest.update(np.ascontiguousarray(row, "<f4").data)
        return digest.hexdigest()

    @classmethod
    def read(cls, name: str, base_folder: Path, allow_paths: Sequence[Path], place: str) -> EnvironmentPicture:
        """Read an environment map named by a scene.

        Parameters
        ----------
        name, base_folder, allow_paths
            See `clrender.files.named.allowed_file`.
        place : str
            Location of the name in the scene, for error messages.

        Raises
        ------
        SceneError
            If it may not be read, or is not an image of radiance.
        """
        label = f"{place}: {quoted(name)}"
        ending = Path(name).suffix.lower()
        if ending not in ENDINGS:
            allowed_file(name, base_folder, allow_paths, label)
            raise SceneError(f"{label} is of no kind that can be read; environments may be {_listed()}")
        file, _ = open_named_file(name, base_folder, allow_paths, label, _FILE_LIMIT)
        try:
            with file:
                pixels = read_open_image(file, ending, f"{label} is not a readable {ending} image", _PIXEL_LIMIT)
        except UsageError as error:
            raise SceneError(str(error).rstrip(".")) from None
        except OSError as error:
            raise SceneError(f"{label} cannot be read: {error.strerror or error}") from None
        return cls.checked(pixels, label)

    @classmethod
    def checked(cls, pixels: NDArray[np.float32], label: str) -> EnvironmentPicture:
        """An environment map of these pixels, if all are valid radiance.

        Raises
        ------
        SceneError
            The message begins with `label`.
        """
        for y, row in enumerate(pixels):
            if row.min() >= 0.0 and row.max() <= POWER_LIMIT:
                continue
            bad = ~((row >= 0.0) & (row <= POWER_LIMIT)).all(axis=1)
            if bad.any():
                x = int(np.argmax(bad))
                values = ", ".join(f"{value:g}" for value in row[x])
                limit = f"finite, at least 0 and at most {POWER_LIMIT:g}"
                raise SceneError(f"{label}: pixel ({x}, {y}) is ({values}), but radiance must be {limit}")
        return cls(pixels)


def _listed() -> str:
    return f"{', '.join(ENDINGS[:-1])} or {ENDINGS[-1]}"
