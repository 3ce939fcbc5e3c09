"""Images for terminals: the escape sequences of kitty, of iTerm2, and sixel.

Sources: "Terminal graphics protocol" (kitty's documentation); "Inline Images Protocol" (iTerm2's documentation);
VT330/VT340 Programmer Reference Manual, volume 2, chapter 14 (sixel). All three are plain ASCII.
"""

from __future__ import annotations

import io
import re
from base64 import standard_b64encode
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image

__all__ = ["PROTOCOLS", "encode", "fit", "resized"]

PROTOCOLS: Final = ("kitty", "iterm2", "sixel")

_CHUNK: Final = 4096
"""Most characters of image data in one escape sequence: kitty's limit."""

_Picture = npt.NDArray[np.uint8]


def fit(size: tuple[int, int], cells: tuple[int, int], cell: tuple[int, int]) -> tuple[int, int]:
    """The largest area of terminal cells for an image, within the given cells and the image's size.

    Parameters
    ----------
    size : (int, int)
        Width and height of the image, pixels.
    cells : (int, int)
        Available columns and rows.
    cell : (int, int)
        Width and height of a cell, pixels.

    Returns
    -------
    (int, int)
        Columns and rows; the image leaves less than a cell of them free.
    """
    scale = min(1.0, cells[0] * cell[0] / size[0], cells[1] * cell[1] / size[1])
    columns, rows = (max(1, -(-round(scale * side) // unit)) for side, unit in zip(size, cell, strict=True))
    return min(columns, cells[0]), min(rows, cells[1])


def resized(picture: _Picture, width: int, height: int) -> _Picture:
    """An image scaled to fit into width x height pixels with its aspect ratio: (h, w, 3) uint8."""
    scale = min(width / picture.shape[1], height / picture.shape[0])
    size = (max(1, round(scale * picture.shape[1])), max(1, round(scale * picture.shape[0])))
    filtered = Image.Resampling.BOX if scale < 1.0 else Image.Resampling.NEAREST
    return np.asarray(Image.fromarray(picture).resize(size, filtered))


def encode(picture: _Picture, protocol: str, *, number: int = 1, colors: int = 256) -> str:
    """The escape sequences that show an image with its top left corner at the cursor.

    Parameters
    ----------
    picture : (h, w, 3) uint8
        In the size in which it is to appear.
    protocol : str
        One of `PROTOCOLS`.
    number : int
        Identifier of the image: kitty replaces an image with the same identifier.
    colors : int
        Most colours of a sixel image.
    """
    if protocol == "sixel":
        return _sixel(picture, colors)
    data = standard_b64encode(_png(picture)).decode("ascii")
    if protocol == "iterm2":
        height = f"{picture.shape[1]}px;height={picture.shape[0]}px"
        return f"\x1b]1337;File=inline=1;size={len(data) * 3 // 4};width={height};preserveAspectRatio=1:{data}\a"
    parts = [data[start : start + _CHUNK] for start in range(0, len(data), _CHUNK)]
    # a=T displays it; C=1 does not move the cursor; q=2 suppresses responses
    keys = [f"a=T,f=100,i={number},p=1,C=1,q=2,"] + [""] * (len(parts) - 1)
    more = [1] * (len(parts) - 1) + [0]
    return "".join(f"\x1b_G{key}m={m};{part}\x1b\\" for key, m, part in zip(keys, more, parts, strict=True))


def _png(picture: _Picture) -> bytes:
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "png", compress_level=1)
    return file.getvalue()


def _sixel(picture: _Picture, colors: int) -> str:
    """Bands of six rows of pixels; in each, the pixels of one colour after the other."""
    image = Image.fromarray(picture).quantize(max(2, colors), Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    indices = np.asarray(image)
    palette = np.round(np.asarray(image.getpalette(), np.float64).reshape(-1, 3) * (100.0 / 255.0)).astype(int)
    height, width = indices.shape
    # 1:1 pixels; its size; pixels that are not set stay unchanged
    parts = [f'\x1bP0;1;0q"1;1;{width};{height}']
    parts += [f"#{n};2;{r};{g};{b}" for n, (r, g, b) in enumerate(palette)]
    for top in range(0, height, 6):
        band = indices[top : top + 6]
        bits = (1 << np.arange(len(band), dtype=np.uint8))[:, None]
        rows = []
        for color in np.unique(band):
            sixels = ((band == color) * bits).sum(axis=0, dtype=np.uint8) + np.uint8(63)
            text = sixels.tobytes().decode("ascii").rstrip("?")
            rows.append(f"#{color}{_REPEATED.sub(_repeat, text)}")
        parts.append("$".join(rows) + "-")
    return "".join(parts) + "\x1b\\"


_REPEATED: Final = re.compile(r"(.)\1{3,255}")


def _repeat(found: re.Match[str]) -> str:
    return f"!{len(found.group())}{found.group(1)}"
