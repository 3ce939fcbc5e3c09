"""Random calibrated cameras, and what OpenCV says of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from clrender.scene.camera import Camera

__all__ = ["Calibration", "calibrations"]

Floats = npt.NDArray[Any]


@dataclass(frozen=True)
class Calibration:
    """A camera as OpenCV has it.

    Attributes
    ----------
    size : (int, int)
        Of the image, pixels.
    matrix : (3, 3) float64
        Intrinsics, with the centre of the first pixel at 0, 0.
    k : tuple of float
    p : tuple of float or None
        None: the fisheye model.
    rotation, translation : (3, 3), (3,) float64
        From world to camera.
    """

    size: tuple[int, int]
    matrix: Floats
    k: tuple[float, ...]
    p: tuple[float, ...] | None
    rotation: Floats
    translation: Floats

    @property
    def pose(self) -> Floats:
        """(4, 4), from world to camera."""
        return np.vstack([np.column_stack([self.rotation, self.translation]), [0.0, 0.0, 0.0, 1.0]])

    @property
    def camera(self) -> Camera:
        """The same as ours."""
        (fx, skew, cx), (_, fy, cy), _ = self.matrix.tolist()
        distortion: dict[str, Any] = {"model": "kannala-brandt", "k": self.k}
        if self.p is not None:
            distortion = {"model": "brown-conrady", "k": self.k, "p": self.p}
        return Camera(
            type="intrinsics", fx=fx, fy=fy, cx=cx, cy=cy, skew=skew, resolution=self.size, pixel_origin="center",
            distortion=distortion, world_to_camera=self.pose,
        )  # fmt: skip

    def points(self, rng: np.random.Generator, count: int) -> Floats:
        """(count, 3) points in front of the camera, world space."""
        wide = 0.8 if self.p is not None else 1.5
        seen = np.stack([rng.uniform(-wide, wide, count), rng.uniform(-0.6, 0.6, count), np.ones(count)], axis=1)
        return (seen * rng.uniform(0.5, 20.0, count)[:, None] - self.translation) @ self.rotation

    def projected(self, points: Floats) -> Floats:
        """(count, 2) pixels by OpenCV, which knows no skew but in its fisheye model."""
        turned = cv2.Rodrigues(self.rotation)[0]
        plain = self.matrix.copy()
        skew, plain[0, 1] = plain[0, 1], 0.0
        if self.p is None:
            alpha = skew / plain[0, 0]
            return cv2.fisheye.projectPoints(
                points[:, None].copy(), turned, self.translation[:, None], plain, np.array(self.k), alpha=alpha
            )[0][:, 0]
        k = self.k
        coefficients = np.array([*k[:2], *self.p, *k[2:]])
        found = cv2.projectPoints(points, turned, self.translation, plain, coefficients)[0][:, 0]
        found[:, 0] += skew * (found[:, 1] - plain[1, 2]) / plain[1, 1]
        return found


def calibrations(count: int, seed: int) -> list[Calibration]:
    """Radial, with a few terms of the denominator, and fisheye; each turned and moved at random."""
    rng = np.random.default_rng(seed)
    made = []
    for number in range(count):
        kind = number % 4
        width, height = int(rng.integers(320, 4000)), int(rng.integers(240, 3000))
        fx = rng.uniform(0.5, 1.6) * width * (0.35 if kind == 3 else 1.0)
        matrix = np.array(
            [
                [fx, rng.normal(0.0, 0.01) * fx, width * rng.normal(0.5, 0.03)],
                [0.0, fx * rng.uniform(0.9, 1.1), height * rng.normal(0.5, 0.03)],
                [0.0, 0.0, 1.0],
            ]
        )
        k = rng.normal(0.0, (0.2, 0.1, 0.02))
        if kind == 2:
            k = np.concatenate([k, rng.normal(0.0, (0.1, 0.05, 0.01))])
        elif kind == 3:
            k = rng.normal(0.0, (0.05, 0.02, 0.01, 0.003))
        p = None if kind == 3 else tuple(rng.normal(0.0, 1e-3, 2).tolist())
        rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        rotation *= np.sign(np.linalg.det(rotation))
        made.append(Calibration((width, height), matrix, tuple(k.tolist()), p, rotation, rng.normal(0.0, 3.0, 3)))
    return made
