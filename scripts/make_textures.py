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
from make_clouds import billows
from numpy.typing import NDArray
from PIL import Image

from clrender.exact.angles import sin_cos_degrees

__all__ = ["PICTURES", "main"]

ROOT: Final = Path(__file__).resolve().parent.parent
_SIZE: Final = 128
_JOINT: Final = 6
"""Texels of the joint between two tiles."""


def tile_heights() -> NDArray[np.float64]:
    """(128, 128) heights, in texels, of two by two tiles with rounded edges, and joints between them."""
    half = _SIZE // 2
    to_rim = np.minimum(np.arange(half), np.arange(half)[::-1])
    rim = np.clip((to_rim + 0.5 - _JOINT / 2) / 6.0, 0.0, 1.0)
    profile = 1.0 - (1.0 - rim) ** 2
    return np.tile(np.minimum.outer(profile, profile), (2, 2)) * 5.0


def tiles() -> NDArray[np.uint8]:
    """(128, 128, 3) colours of these tiles, sRGB, with a grain that is a function of position only."""
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


def atlas() -> NDArray[np.uint8]:
    """(256, 512, 3) longitude and latitude, sRGB, of a globe of no real land: heights and depths, lines every 15°."""
    height, width = 256, 512
    rows = [sin_cos_degrees(90.0 - (y + 0.5) * 180.0 / height) for y in range(height)]
    columns = [sin_cos_degrees((x + 0.5) * 360.0 / width - 180.0) for x in range(width)]
    up, level = (np.array([each[i] for each in rows])[:, None] for i in (0, 1))
    sine, cosine = (np.array([each[i] for each in columns])[None, :] for i in (0, 1))
    points = np.stack([level * sine, up + 0.0 * sine, level * cosine], axis=2)
    high = billows(points * 1.5 + 40.0, 11, 6) - 0.515
    tints = [
        (112, 158, 168),
        (138, 180, 182),
        (170, 202, 194),
        (196, 192, 132),
        (214, 182, 112),
        (196, 148, 92),
        (160, 112, 76),
    ]
    band = np.digitize(high, (-0.12, -0.04, 0.0, 0.05, 0.1, 0.15))
    color = np.array(tints)[band]
    color = np.where((abs(up) + 0.6 * high > 0.93)[..., None], np.array([238, 236, 226]), color)
    coast = (band[:, :] >= 3) != (np.roll(band, 1, axis=1) >= 3)
    coast[1:] |= (band[1:] >= 3) != (band[:-1] >= 3)
    color = np.where(coast[..., None], np.array([84, 70, 58]), color)
    y, x = np.mgrid[:height, :width]
    lines = ((x * 24) % width < 24) | ((y * 12 + 6) % height < 12)
    color = np.where((lines & ~coast)[..., None], color * 7 // 8, color)
    return np.asarray(np.where((y // 2 == height // 4)[..., None], np.array([150, 60, 46]), color), np.uint8)


def leaf() -> NDArray[np.uint8]:
    """(128, 128, 4) a leaf, its stalk in the lower left corner, its tip in the upper right one; sRGB, and opacity."""
    y, x = np.mgrid[:512, :512] / 512.0
    along, aside = (x + 1.0 - y) / 2.0, abs(x - 1.0 + y) / 2.0
    blade = np.clip((along - 0.1) / 0.88, 0.0, 1.0)
    teeth = abs((blade * 13.0) % 1.0 - 0.3) * 0.02
    width = 0.26 * np.sqrt(blade) * (1.0 - blade) * (2.4 - 0.6 * blade) - teeth
    inside = (aside < width) | ((aside < 0.012) & (along > 0.01) & (along < 0.5))
    vein = np.clip(1.0 - abs((along - aside * 1.1) * 11.0 % 1.0 - 0.5) * 14.0, 0.0, 1.0) * (aside > 0.01)
    rib = np.clip(1.6 - aside * 110.0, 0.0, 1.0)
    light = np.maximum(rib, 0.45 * vein)[..., None]
    edge = np.clip(1.0 - aside / np.maximum(width, 1e-3), 0.0, 1.0)[..., None]
    green = np.array([92.0, 132.0, 42.0]) + edge * np.array([-12.0, -4.0, -2.0])
    color = green + light * np.array([46.0, 40.0, 40.0])
    return shrunk(np.concatenate([color, inside[..., None] * 255.0], axis=2))


def grass() -> NDArray[np.uint8]:
    """(128, 256, 4) blades of grass, and in the right half daisies between them; sRGB, and opacity."""
    y, x = np.mgrid[:512, :1024]
    up = 512.0 - y
    picture = np.zeros((512, 1024, 4))
    picture[..., :3] = [84.0, 116.0, 40.0]
    for number in range(44):
        half = number % 2 * 512
        foot = half + 70 + number * 197 % 372
        height = 250 + number * 151 % 240
        bend = (number * 89 % 121 - 60) * 1.1
        part = np.clip(up / height, 0.0, 1.0)
        there = (abs(x - foot - bend * part * part) < 11.0 * (1.0 - part * part) + 1.0) & (up < height)
        tone = np.array([(62.0, 104.0, 30.0), (92.0, 128.0, 44.0), (112.0, 136.0, 56.0)][number % 3])
        picture[there] = [*tone, 255.0]
        picture[there, :3] += (part[there] * 34.0)[..., None] * np.array([1.0, 0.8, 0.5])
    for number, (left, height) in enumerate([(640, 420), (760, 330), (905, 455)]):
        stalk = (abs(x - left) < 5) & (up < height)
        picture[stalk] = [96.0, 128.0, 50.0, 255.0]
        dx, dy = x - left, (up - height) * 1.3
        distance = np.sqrt(dx * dx + dy * dy)
        # Petals: a star of twelve, from the shorter of two folded coordinates
        fold = np.minimum(abs(dx), abs(dy)) / np.maximum(np.maximum(abs(dx), abs(dy)), 1.0)
        petal = distance < 46.0 - 14.0 * abs((fold * 3.0 + number * 0.3) % 1.0 - 0.5)
        picture[petal] = [236.0, 234.0, 228.0, 255.0]
        picture[distance < 15.0] = [226.0, 176.0, 40.0, 255.0]
    return shrunk(picture)


def bricks() -> NDArray[np.uint8]:
    """(128, 128, 4) a square metre of bricks, sRGB, by which the colour of a wall is multiplied, and their roughness.

    The middle of a brick is at each sixteenth of the picture, and is white at (1/16, 1/16). Around (9/16, 9/16) the
    surface is as smooth as glass, for parts of a mesh that have these texture coordinates.
    """
    y, x = np.mgrid[:128, :128]
    row = (y + 4) // 8 % 16
    place = (x + 12 - row % 2 * 16 + 128) % 32
    column = (x + 12 - row % 2 * 16 + 128) // 32 % 4
    tone = 222 + (row * 37 + column * 59 + row * column * 23) % 34
    tone = np.where((row == 1) & (column == 0), 255, tone)
    grain = (x * 7 + y * 13 + x * y * 3) % 11 - 5
    joint = (place < 2) | ((y + 4) % 8 < 1)
    color = np.where(joint, 196, np.clip(tone + grain * (tone < 255), 0, 255))
    rough = np.where(joint, 235, 205 - (row * 29 + column * 31) % 40)
    smooth = (abs(x - 72) < 3) & (abs(y - 72) < 3)
    color, rough = np.where(smooth, 255, color), np.where(smooth, 12, rough)
    return np.asarray(np.stack([color, color, color, rough], axis=2)[::-1], np.uint8)


def window() -> NDArray[np.uint8]:
    """(96, 64, 3) what is seen through a window in the evening, sRGB: a lit room between curtains, and a plant."""
    y, x = np.mgrid[:96, :64]
    room = np.array([255.0, 196.0, 120.0]) * (0.62 + 0.38 * np.clip(1.0 - y / 70.0, 0.0, 1.0))[..., None]
    lamp = np.clip(1.0 - ((x - 40) ** 2 + ((y - 26) * 1.6) ** 2) / 260.0, 0.0, 1.0)[..., None]
    room = room + lamp * np.array([40.0, 60.0, 90.0])
    shelf = (y > 58) & (y < 61) | (x > 44) & (x < 60) & (y > 44) & (y < 58) & ((x * 5 + 3) % 11 < 8)
    room = np.where(shelf[..., None], room * 0.62, room)
    away = np.minimum(x, 63 - x)
    fold = abs(x * 5 % 16 - 8) / 8.0
    curtain = away < 11 + (y // 12) % 5
    cloth = np.array([236.0, 168.0, 104.0]) * (0.55 + 0.25 * fold)[..., None]
    room = np.where(curtain[..., None], cloth, room)
    pot = (abs(x - 24) < 5) & (y > 84)
    leaves = ((x - 24) ** 2 + ((y - 76) * 0.8) ** 2 < 70) & ((x * 7 + y * 11) % 5 < 3)
    room = np.where((pot | leaves)[..., None], room * 0.25, room)
    return np.asarray(np.clip(room, 0.0, 255.0).round(), np.uint8)


def planks() -> NDArray[np.uint8]:
    """(256, 256, 3) eight oak boards, sRGB: their grain runs along u, and their ends are at different places."""
    y, x = np.mgrid[:256, :256]
    board = y // 32
    end = (board * 97 + 31) % 256
    piece = board * 2 + ((x - end) % 256 > 128)
    tone = np.array([158.0, 118.0, 78.0]) + ((piece * 53) % 41 - 20.0)[..., None] * np.array([1.0, 0.9, 0.75])
    # Rings: heights that change slowly along the board, cut into bands
    bend = abs((x * 2 + piece * 67) % 256 - 128) / 32.0 + abs((x * 5 + piece * 31) % 256 - 128) / 96.0
    ring = abs((((y % 32) * 3 + bend * 4.0 + piece * 11) % 13.0) - 6.5) / 6.5
    pore = ((x // 3 * 31 + y * 57 + (x // 3) * y * 7) % 29 < 3) * 12.0
    color = tone - (18.0 * ring * ring + pore)[..., None] * np.array([1.0, 1.0, 0.9])
    joint = (y % 32 < 1) | ((x - end) % 128 < 1)
    return np.asarray(np.clip(np.where(joint[..., None], color * 0.45, color), 0.0, 255.0).round(), np.uint8)


def rug() -> NDArray[np.uint8]:
    """(160, 240, 3) a woven rug, sRGB: a border, and rows of diamonds."""
    y, x = np.mgrid[:160, :240]
    diamond = abs(x % 40 - 20) + abs(y % 40 - 20)
    color = np.where((diamond < 14)[..., None], np.array([150, 72, 52]), np.array([222, 210, 188]))
    color = np.where((diamond < 6)[..., None], np.array([228, 196, 120]), color)
    color = np.where(((diamond >= 18) & (diamond < 20))[..., None], np.array([64, 84, 96]), color)
    edge = np.minimum(np.minimum(x, 239 - x), np.minimum(y, 159 - y))
    color = np.where((edge < 14)[..., None], np.array([64, 84, 96]), color)
    color = np.where(((edge < 11) & (edge > 8))[..., None], np.array([222, 210, 188]), color)
    weave = ((x + y) % 2 * 8 + (x * 13 + y * 29) % 9)[..., None]
    return np.asarray(np.clip(color - weave, 0, 255), np.uint8)


def painting() -> NDArray[np.uint8]:
    """(144, 192, 3) a landscape in bands of colour, sRGB: a sun over hills."""
    y, x = np.mgrid[:144, :192]
    sky = np.array([238.0, 208.0, 164.0]) + (y / 144.0)[..., None] * np.array([-6.0, -70.0, -86.0])
    picture = np.where((((x - 128) ** 2 + (y - 50) ** 2) < 420)[..., None], np.array([232.0, 104.0, 62.0]), sky)
    tones = ([196.0, 132.0, 112.0], [132.0, 106.0, 116.0], [70.0, 88.0, 104.0], [38.0, 58.0, 70.0])
    for number, tone in enumerate(tones):
        ridge = 70 + 17 * number + abs((x * (3 + number) + 61 * number) % 128 - 64) // (4 + number)
        ridge = ridge - abs((x * 2 + 90 * number) % 200 - 100) // 7
        picture = np.where((y > ridge)[..., None], np.array(tone), picture)
    return np.asarray(np.clip(picture - ((x * 17 + y * 31 + x * y) % 9)[..., None], 0.0, 255.0).round(), np.uint8)


def shrunk(picture: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Means of 4 × 4 pixels, in integers."""
    height, width, channels = picture.shape
    sums = np.floor(picture).astype(np.int64).reshape(height // 4, 4, width // 4, 4, channels).sum(axis=(1, 3))
    return np.asarray(sums // 16, np.uint8)


PICTURES: Final[Mapping[str, NDArray[np.uint8]]] = {
    "tiles.png": tiles(),
    "tiles-normal.png": tile_normals(),
    "globe.png": globe(),
    "atlas.png": atlas(),
    "leaf.png": leaf(),
    "grass.png": grass(),
    "bricks.png": bricks(),
    "window.png": window(),
    "planks.png": planks(),
    "rug.png": rug(),
    "painting.png": painting(),
}


def main() -> int:
    """Write the images, or compare with them."""
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
