"""Images for pages: downsampling, colour maps, and embedding."""

from __future__ import annotations

import base64
import io
from html import escape
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["data_uri", "diverging", "figure_of", "jpeg", "shrunk", "slider"]

_Pixels = npt.NDArray[np.uint8]


def shrunk(image: npt.NDArray[Any], most: int) -> npt.NDArray[Any]:
    """Downsample an image by an integer factor to at most `most` pixels per side; the remainder is cut off.

    Parameters
    ----------
    image : (H, W, ...) floats
        Linear, so that averages are physically correct.
    most : int
    """
    factor = -(-max(image.shape[:2]) // most)
    if factor == 1:
        return image
    height, width = (max(1, side // factor) for side in image.shape[:2])
    rows, columns = min(factor, image.shape[0]), min(factor, image.shape[1])
    cut = image[: height * rows, : width * columns]
    return np.asarray(cut.reshape(height, rows, width, columns, *image.shape[2:]).mean(axis=(1, 3)))


def diverging(values: npt.ArrayLike) -> _Pixels:
    """Diverging colour map: blue at -1 and below, white at 0, red at 1 and above; (..., 3) uint8."""
    z = np.clip(np.asarray(values, np.float64), -1.0, 1.0)
    colors = np.stack([1.0 - np.maximum(-z, 0.0), 1.0 - np.abs(z), 1.0 - np.maximum(z, 0.0)], axis=-1)
    return np.asarray(np.round(255.0 * colors), np.uint8)


def data_uri(pixels: _Pixels, *, lossless: bool = False) -> str:
    """An image, (H, W, 3) uint8, as a data URI."""
    if not lossless:
        return "data:image/jpeg;base64," + base64.b64encode(jpeg(pixels, 88)).decode()
    from PIL import Image

    data = io.BytesIO()
    Image.fromarray(pixels).save(data, "PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(data.getvalue()).decode()


def jpeg(pixels: _Pixels, quality: int) -> bytes:
    """An image as a JPEG file."""
    from PIL import Image

    data = io.BytesIO()
    Image.fromarray(pixels).save(data, "JPEG", quality=quality, optimize=True)
    return data.getvalue()


def figure_of(inside: str, caption: str) -> str:
    """A figure of a page.

    Parameters
    ----------
    inside : str
        HTML.
    caption : str
        Text.
    """
    return f"<figure>{inside}<figcaption>{escape(caption)}</figcaption></figure>"


def slider(first: _Pixels, second: _Pixels, names: tuple[str, str]) -> str:
    """Two images of equal size on top of each other, with a divider that can be moved, also with the arrow keys.

    Parameters
    ----------
    first, second : (H, W, 3) uint8
        Shown to the left and to the right of the divider.
    names : (str, str)
    """
    height, width, _ = first.shape
    images = "".join(
        f'<img src="{data_uri(pixels, lossless=True)}" width="{width}" height="{height}" alt="{escape(name)}">'
        for pixels, name in ((second, names[1]), (first, names[0]))
    )
    labels = "".join(f"<span>{escape(name)}</span>" for name in names)
    return (
        f'<div class="slider" style="--cut: 50%; --wide: {width}px">{images}{labels}'
        '<input type="range" min="0" max="100" step="0.5" value="50" '
        f'aria-label="Border between {escape(names[0])} and {escape(names[1])}" '
        "oninput=\"this.parentNode.style.setProperty('--cut', this.value + '%')\"></div>"
    )
