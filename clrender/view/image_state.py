"""The state of the image that a view renders: written by the render thread, read by all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from clrender.film.running import RunningFilm

__all__ = ["ImageState", "Pixels"]

Pixels: TypeAlias = npt.NDArray[np.float32]


@dataclass
class ImageState:
    """An image while it is rendered. There is another object for each image.

    The render thread alone writes: first the fields, and last `changes`, which publishes them. Other threads read
    `changes` first; a reader in between has older pixels under an older number at worst.

    Attributes
    ----------
    revision : int
        Number of the image.
    width, height : int
        Pixels: of the crop, where there is one.
    spp : int
        Samples per pixel that are asked for.
    preview : (h, w, 3) float32 or None
        The image with fewer pixels, for the time before the first sample.
    film : RunningFilm or None
        The samples so far, which the render thread adds to.
    layers : dict of str to (h, w, c) float32
        First-hit layers; those of fewer pixels are replaced.
    camera_ids : dict of int to (int, str or None)
        By viewer, the `id` of its newest camera message that the image shows.
    changes : int
        Grows whenever there is something new to see.
    sha256 : str or None
        Of the finished image.
    is_black : bool
        Whether all its pixels are black; before it has pixels, whether those of the image before it are.
    idle : bool
        Whether nothing is rendered for the time being.
    """

    revision: int
    width: int
    height: int
    spp: int
    preview: Pixels | None = None
    film: RunningFilm | None = None
    layers: dict[str, Pixels] = field(default_factory=dict)
    camera_ids: Mapping[int, int | str | None] = field(default_factory=dict)
    changes: int = 0
    sha256: str | None = None
    is_black: bool = False
    idle: bool = False

    @property
    def samples(self) -> float:
        """Samples per pixel so far, mean."""
        return 0.0 if self.film is None else self.film.samples_taken / (self.width * self.height)

    def is_whole(self, layer: str) -> bool:
        """Whether a first-hit layer is there with all pixels."""
        found = self.layers.get(layer)
        return found is not None and found.shape[:2] == (self.height, self.width)
