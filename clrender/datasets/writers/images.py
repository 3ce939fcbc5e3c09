"""The writer `images`: for each image a picture, radiance with layers, masks, and what is known of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import IO, Any

import numpy as np

from clrender.datasets.files import ImageFiles, json_bytes
from clrender.datasets.rendered import Rendered
from clrender.datasets.variation import DatasetPlan
from clrender.datasets.writers.writer import Records
from clrender.errors import UsageError

__all__ = ["Images", "mask_pixels"]


class Images:
    """``images/NUMBER.png``, ``.exr``, ``.json``, and ``.LAYER.png`` of layers of labels."""

    layers = ()
    amodal = False

    def write(self, rendered: Rendered, files: ImageFiles) -> Any:
        """See `Writer`."""
        stem = f"images/{rendered.name}"
        files.png(f"{stem}.png", rendered.picture)
        note = {"image": rendered.varied.index, "image_sha256": rendered.linear_sha256}
        files.exr(f"{stem}.exr", rendered.image.linear, rendered.layers, note, rendered.attributes)
        for layer in rendered.label_layers:
            files.png(f"{stem}.{layer}.png", mask_pixels(rendered, layer))
        files.text(f"{stem}.json", json_bytes(rendered.told()))
        return None

    def summary(self, plan: DatasetPlan, records: Records) -> dict[str, Callable[[IO[bytes]], None]]:
        """See `Writer`: there is none."""
        return {}


def mask_pixels(rendered: Rendered, layer: str) -> np.ndarray[Any, np.dtype[np.uint16]]:
    """Numbers of a layer of labels as pixels of a file, (H, W) uint16.

    Raises
    ------
    UsageError
        They are too large.
    """
    numbers = rendered.mask(layer)
    if (largest := int(numbers.max(initial=0))) > 65535:
        raise UsageError(
            f"image {rendered.varied.index}: {layer} {largest} is more than a .png holds; leave the layer out"
        )
    return numbers.astype(np.uint16)
