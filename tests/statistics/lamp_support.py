"""IES files of our own making, and what they say by float64 formulas."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from clrender.image.exr_write import write_exr

__all__ = ["LAMPS", "LUMENS_PER_WATT", "LampFile", "Slide", "spot_share"]

Floats = npt.NDArray[np.float64]
LUMENS_PER_WATT = 683.0


def spot_share(cosine: npt.ArrayLike, cone_degrees: float, blend: float) -> Floats:
    """Intensity of a spot over that in its middle (PBR 4ed, 12.2.2), by the cosine from its axis."""
    c, edge = np.asarray(cosine, np.float64), math.cos(math.radians(cone_degrees / 2.0))
    if blend == 0.0:
        return (c >= edge).astype(np.float64)
    t = np.clip((c - edge) / (blend * (1.0 - edge)), 0.0, 1.0)
    share: Floats = t * t * (3.0 - 2.0 * t)
    return share


@dataclass(frozen=True)
class Slide:
    """What a projector throws.

    Attributes
    ----------
    pixels : (H, W, 3) float32
    vertical_fov : float
        Degrees.
    even : bool
    """

    pixels: npt.NDArray[np.float32]
    vertical_fov: float = 40.0
    even: bool = True

    def light(self, folder: Path, name: str = "slide.exr", **more: Any) -> dict[str, Any]:
        """A projector whose picture is in a folder."""
        with (folder / name).open("wb") as file:
            write_exr(file, self.pixels, {}, {})
        light = {"type": "projector", "position": [0.0, 0.0, 0.0], "direction": [0.0, 0.0, -1.0]}
        return {**light, "file": str(folder / name), "vertical_fov": self.vertical_fov, "even": self.even, **more}

    def intensity(self, directions: npt.ArrayLike, axis: Sequence[float], up: Sequence[float]) -> Floats:
        """W/sr into directions (..., 3), for a scale of 1; (..., 3)."""
        d, a = np.asarray(directions, np.float64), np.asarray(axis, np.float64)
        d, a = d / np.linalg.norm(d, axis=-1, keepdims=True), a / np.linalg.norm(a)
        right = np.cross(a, up)
        right /= np.linalg.norm(right)
        cosine = d @ a
        ahead = cosine > 0.0
        screen = d / np.where(ahead, cosine, 1.0)[..., None]
        height, width, _ = self.pixels.shape
        pixel = 2.0 * math.tan(math.radians(self.vertical_fov / 2.0)) / height
        x, y = screen @ right / pixel + width / 2.0, height / 2.0 - screen @ np.cross(right, a) / pixel
        within = ahead & (x >= 0.0) & (x <= width) & (y >= 0.0) & (y <= height)
        total = np.zeros((*x.shape, 3))
        left, top = np.floor(x - 0.5), np.floor(y - 0.5)
        for i in (left, left + 1.0):
            for j in (top, top + 1.0):
                share = (1.0 - np.abs(x - 0.5 - i)) * (1.0 - np.abs(y - 0.5 - j))
                at = np.clip(j, 0, height - 1).astype(int), np.clip(i, 0, width - 1).astype(int)
                total += share[..., None] * self.pixels[at]
        spread = 1.0 / cosine**3 if self.even else np.ones_like(cosine)
        found: Floats = np.where(within[..., None], total * spread[..., None], 0.0)
        return found


@dataclass(frozen=True)
class LampFile:
    """An IES file.

    Attributes
    ----------
    vertical, horizontal : (V,), (H,) float64
        Degrees, as they stand in the file.
    candela : (H, V) float64
        As they stand in the file.
    multiplier : float
    """

    vertical: Floats
    horizontal: Floats
    candela: Floats
    multiplier: float = 1.0

    def text(self, header: str = "IESNA:LM-63-2002", factors: str = "1 1 100") -> str:
        """The file."""
        sizes = f"{len(self.vertical)} {len(self.horizontal)}"
        rows = [self.vertical, self.horizontal, *self.candela]
        lines = [header, "[TEST] none", "TILT=NONE", f"1 1000 {self.multiplier!r} {sizes} 1 2 0 0 0", factors]
        return "\n".join([*lines, *(" ".join(repr(float(x)) for x in row) for row in rows), ""])

    def write(self, folder: Path, name: str = "lamp.ies") -> str:
        """Its name in a folder."""
        (folder / name).write_text(self.text())
        return name

    def intensity(self, directions: npt.ArrayLike, axis: Sequence[float], zero: Sequence[float]) -> Floats:
        """W/sr into directions (..., 3), of a lamp whose vertical angle 0 lies along `axis`."""
        d, a = np.asarray(directions, np.float64), np.asarray(axis, np.float64)
        d, a = d / np.linalg.norm(d, axis=-1, keepdims=True), a / np.linalg.norm(a)
        x = np.asarray(zero, np.float64) - a * (np.asarray(zero, np.float64) @ a)
        x /= np.linalg.norm(x)
        # Counter-clockwise as seen from above, where the axis points down
        y = np.cross(-a, x)
        polar = np.degrees(np.arctan2(np.linalg.norm(np.cross(d, a), axis=-1), d @ a))
        azimuth = np.degrees(np.arctan2(d @ y, d @ x)) % 360.0
        return self.at(polar, azimuth) / LUMENS_PER_WATT

    def at(self, polar: npt.ArrayLike, azimuth: npt.ArrayLike) -> Floats:
        """Candela, by both angles in degrees: symmetry is undone by folding the horizontal one."""
        p, h = np.asarray(polar, np.float64), np.asarray(azimuth, np.float64) % 360.0
        angles, rows = self.horizontal, self.candela
        if len(angles) == 1:
            angles, rows = np.array([0.0, 360.0]), np.repeat(rows, 2, axis=0)
        elif angles[0] == 90.0:
            h = np.where((h < 90.0) | (h > 270.0), (180.0 - h) % 360.0, h)
        elif angles[-1] <= 180.0:
            h = np.where(h > 180.0, 360.0 - h, h)
            h = np.where(h > angles[-1], 180.0 - h, h)
        elif angles[-1] < 360.0:
            angles, rows = np.append(angles, 360.0), np.concatenate([rows, rows[:1]])
        i = np.clip(np.searchsorted(angles, h, side="right") - 1, 0, len(angles) - 2)
        j = np.clip(np.searchsorted(self.vertical, p, side="right") - 1, 0, len(self.vertical) - 2)
        s = (h - angles[i]) / (angles[i + 1] - angles[i])
        t = (p - self.vertical[j]) / (self.vertical[j + 1] - self.vertical[j])
        upper, lower = rows[i, j] * (1 - s) + rows[i + 1, j] * s, rows[i, j + 1] * (1 - s) + rows[i + 1, j + 1] * s
        inside = (p >= self.vertical[0]) & (p <= self.vertical[-1])
        value: Floats = np.where(inside, upper * (1 - t) + lower * t, 0.0) * self.multiplier
        return value

    def flux(self, steps: int = 1440) -> float:
        """Watts: the integral of the intensity over all directions, by the midpoint rule."""
        p, h = (np.arange(steps) + 0.5) * 180.0 / steps, (np.arange(steps) + 0.5) * 360.0 / steps
        edges = np.cos(np.radians(np.arange(steps + 1) * 180.0 / steps))
        values = self.at(p[:, None], h[None, :]).mean(axis=1)
        return float((values * (edges[:-1] - edges[1:])).sum()) * 2.0 * math.pi / LUMENS_PER_WATT


def _wild(vertical: Sequence[float], horizontal: Sequence[float], seed: int, **more: Any) -> LampFile:
    """Some of it dark, some bright; of one value along the poles, and alike where angles meet."""
    rng = np.random.default_rng(seed)
    candela = 10.0 ** rng.uniform(1.0, 3.0, (len(horizontal), len(vertical)))
    candela[rng.random(candela.shape) < 0.2] = 0.0
    for pole in (0.0, 180.0):
        candela[:, np.asarray(vertical) == pole] = 200.0
    if horizontal[-1] == 360.0:
        candela[-1] = candela[0]
    return LampFile(np.array(vertical, float), np.array(horizontal, float), candela.round(2), **more)


_BEAM = np.array([1000.0, 990.0, 900.0, 700.0, 350.0, 100.0, 20.0, 5.0, 1.0, 0.0])
LAMPS: dict[str, LampFile] = {
    "downlight": LampFile(np.arange(0.0, 91.0, 10.0), np.zeros(1), _BEAM[None], 1.5),
    "quadrants": _wild(np.arange(0.0, 181.0, 15.0).tolist(), [0.0, 22.5, 45.0, 67.5, 90.0], 81),
    "halves": _wild([0.0, 3.3, 17.5, 40.0, 41.0, 77.25, 90.0], [0.0, 30.0, 100.0, 180.0], 82),
    "halves across": _wild([0.0, 30.0, 60.0, 90.0], [90.0, 110.0, 160.0, 230.0, 270.0], 83),
    "all around, upwards": _wild(
        [90.0, 100.0, 133.3, 170.0, 180.0], [0.0, 10.0, 120.0, 121.0, 300.0, 360.0], 84, multiplier=0.25
    ),
    "last left out": _wild([0.0, 45.0, 90.0, 120.0, 180.0], [0.0, 60.0, 120.0, 180.0, 240.0, 300.0], 85),
}
