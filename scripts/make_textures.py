"""Writes the pictures in scenes/; they are committed, and the same pixels come out on every machine.

Run ``python scripts/make_textures.py`` to write them, with ``--check`` to compare their pixels with what is committed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

__all__ = ["PICTURES", "main"]

ROOT: Final = Path(__file__).resolve().parent.parent
_SIZE: Final = 128
_JOINT: Final = 6
"""Texels of the joint between two tiles."""


def tile_heights() -> NDArray[np.float64]:
    """(128, 128) heights, in texels, of two by two tiles with rounded rims, and joints between them."""
    half = _SIZE // 2
    to_rim = np.minimum(np.arange(half), np.arange(half)[::-1])
    rim = np.clip((to_rim + 0.5 - _JOINT / 2) / 6.0, 0.0, 1.0)
    profile = 1.0 - (1.0 - rim) ** 2
    return np.tile(np.minimum.outer(profile, profile), (2, 2)) * 5.0


def tiles() -> NDArray[np.uint8]:
    """(128, 128, 3) colours of these tiles, sRGB, with a grain that is a function of the place alone."""
    y, x = np.mgrid[:_SIZE, :_SIZE]
    grain = ((x * 7 + y * 13 + x * y * 3) % 17 - 8) / 2.0
    second = ((x // (_SIZE // 2) + y // (_SIZE // 2)) % 2 == 1)[..., None]
    color = np.where(second, np.array([186.0, 120.0, 88.0]), np.array([214.0, 196.0, 164.0])) + grain[..., None]
    joint = (tile_heights() < 0.5)[..., None]
    return np.asarray(np.where(joint, np.array([96.0, 92.0, 86.0]), color).round(), np.uint8)


def tile_normals() -> NDArray[np.uint8]:
    """(128, 128, 3) normals of these tiles: red along u, green along v, which runs upward, blue outward."""
    heights = tile_heights()
    along_u = (np.roll(heights, -1, axis=1) - np.roll(heights, 1, axis=1)) / 2.0
    along_v = (np.roll(heights, 1, axis=0) - np.roll(heights, -1, axis=0)) / 2.0
    normals = np.stack([-along_u, -along_v, np.ones_like(heights)], axis=2)
    normals /= np.sqrt((normals**2).sum(axis=2, keepdims=True))
    return np.asarray((normals * 127.0 + 128.0).round(), np.uint8)


def globe() -> NDArray[np.uint8]:
    """(64, 128, 3) longitude and latitude, sRGB: land and sea that join at both sides, white poles, lines every 30°."""
    y, x = np.mgrid[:64, :128]
    # Triangle waves: no sine, which machines round differently
    wave = abs((x * 3 + y * 2) % 128 - 64) + abs((x * 5 + 256 - y * 3) % 128 - 64) + abs(y * 2 % 64 - 32)
    color = np.where((wave > 84)[..., None], np.array([92, 138, 70]), np.array([36, 84, 150]))
    color = np.where(((y < 6) | (y >= 58))[..., None], np.array([235, 240, 245]), color)
    lines = ((x * 12) % 128 < 12) | ((y * 6 + 3) % 64 < 6)
    return np.asarray(np.where(lines[..., None], color * 3 // 4, color), np.uint8)


PICTURES: Final[Mapping[str, NDArray[np.uint8]]] = {
    "tiles.png": tiles(),
    "tiles-normal.png": tile_normals(),
    "globe.png": globe(),
}


def main() -> int:
    """Write the pictures, or compare them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--check", action="store_true", help="compare with what is committed")
    check = parser.parse_args().check
    for name, pixels in PICTURES.items():
        path = ROOT / "scenes" / name
        if not check:
            Image.fromarray(pixels).save(path, optimize=True)
        elif not np.array_equal(np.asarray(Image.open(path)), pixels):
            sys.stderr.write(f"scenes/{name} is stale; run python scripts/make_textures.py\n")
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
