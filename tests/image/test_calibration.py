"""A chequerboard that is rendered, found and calibrated by OpenCV gives back the camera."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

import clrender
from clrender.cameras.rotations import rotation_of
from clrender.scene import Camera, Scene

if TYPE_CHECKING:
    from clrender.device import Device

COLUMNS, ROWS, SQUARE = 9, 6, 0.03
SIZE = (480, 360)
SIGMAS = 3.0

LENS: dict[str, Any] = {"type": "intrinsics", "resolution": SIZE, "pixel_origin": "center"}
PLAIN = {**LENS, "fx": 412.0, "fy": 408.5, "cx": 243.2, "cy": 175.4}
PLAIN["distortion"] = {"model": "brown-conrady", "k": [-0.21, 0.07], "p": [0.0012, -0.0008]}
FISHEYE = {**LENS, "fx": 210.0, "fy": 212.0, "cx": 237.5, "cy": 182.0}
FISHEYE["distortion"] = {"model": "kannala-brandt", "k": [0.03, -0.008]}


def board() -> dict[str, Any]:
    """A scene of a board of bright and dark squares in the plane z = 0, which shine: edges alone are noisy."""
    shapes = []
    for column in range(-2, COLUMNS + 1):
        for row in range(-2, ROWS + 1):
            edge = column in (-2, COLUMNS) or row in (-2, ROWS)
            origin = [column * SQUARE, row * SQUARE, 0.0]
            shapes.append(
                {"type": "quad", "origin": origin, "edge_u": [SQUARE, 0.0, 0.0], "edge_v": [0.0, SQUARE, 0.0],
                 "emission": [0.8 if edge or (column + row) % 2 else 0.05] * 3, "flip_normals": True}
            )  # fmt: skip
    return {"shapes": shapes, "lights": [{"type": "environment", "radiance": [0.5] * 3}]}


def corners() -> npt.NDArray[np.float32]:
    """(COLUMNS·ROWS, 3) inner corners of the board, metres, in the order in which OpenCV finds them."""
    places = [[column * SQUARE, row * SQUARE, 0.0] for row in range(ROWS) for column in range(COLUMNS)]
    return np.array(places, np.float32)


def poses(count: int, distance: float) -> list[npt.NDArray[np.float64]]:
    """World to camera: the board tilted in front of the camera, where all of it is seen."""
    rng = np.random.default_rng(4)
    middle = np.array([(COLUMNS - 1) / 2.0 * SQUARE, (ROWS - 1) / 2.0 * SQUARE, 0.0])
    made = []
    for _ in range(count):
        rotation = rotation_of(rng.uniform(-0.45, 0.45, 3))
        aside = np.array([*rng.uniform(-0.12, 0.12, 2) * distance, rng.uniform(0.9, 1.3) * distance])
        made.append(np.column_stack([rotation, aside - rotation @ middle]))
    return made


def views(device: Device, lens: dict[str, Any], distance: float) -> list[npt.NDArray[np.float32]]:
    """Pixels of the corners in rendered images."""
    found = []
    with clrender.Session(device.info.index) as session:
        for pose in poses(14, distance):
            scene = Scene(**board(), camera={**lens, "world_to_camera": pose})
            image = session.render(scene, size=SIZE, spp=64, integrator="direct", filter="gaussian")
            gray = np.clip(image.linear[..., 1] * 255.0, 0.0, 255.0).astype(np.uint8)
            there, points = cv2.findChessboardCornersSB(gray, (COLUMNS, ROWS))
            if there:
                # What the first function finds is biased: of any lens it gives focal lengths that are 0.2 % too long
                points = cv2.cornerSubPix(gray, points, (5, 5), (-1, -1), (3, 100, 1e-4)).reshape(-1, 2)
                # It may begin at either end of the board
                camera = Camera(**lens, world_to_camera=pose)
                expected = camera.project(corners())
                if np.abs(points - expected).max() > np.abs(points[::-1] - expected).max():
                    points = points[::-1]
                found.append((points.astype(np.float32), np.abs(points - expected).max()))
    assert len(found) >= 10
    assert max(error for _, error in found) < 0.5
    return [np.ascontiguousarray(points) for points, _ in found]


@pytest.mark.long
def test_opencv_calibrates_the_camera(device: Device) -> None:
    points = views(device, PLAIN, 0.36)
    calibrate: Any = cv2.calibrateCameraExtended
    rms, matrix, coefficients, _, _, deviations, _, _ = calibrate(
        [corners()] * len(points), points, SIZE, None, None, flags=cv2.CALIB_FIX_K3
    )
    assert rms <= 0.05
    distortion = PLAIN["distortion"]
    given = np.array([*(PLAIN[key] for key in ("fx", "fy", "cx", "cy")), *distortion["k"], *distortion["p"]])
    found = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *coefficients.ravel()[:4]])
    assert (np.abs(found - given) <= SIGMAS * deviations.ravel()[:8]).all(), (found - given, deviations.ravel()[:8])


@pytest.mark.long
def test_opencv_calibrates_the_fisheye(device: Device) -> None:
    """Its function gives no deviations: those of the pixels are small, and so is what they leave open."""
    points = views(device, FISHEYE, 0.2)
    # OpenCV 5 has the flags elsewhere than version 4
    here = cv2.fisheye if hasattr(cv2.fisheye, "CALIB_FIX_SKEW") else cv2
    names = ("CALIB_RECOMPUTE_EXTRINSIC", "CALIB_FIX_SKEW", "CALIB_FIX_K3", "CALIB_FIX_K4")
    flags = sum(getattr(here, name) for name in names)
    rms, matrix, coefficients, _, _ = cv2.fisheye.calibrate(
        [corners()[None].astype(np.float64)] * len(points), [each[None].astype(np.float64) for each in points],
        SIZE, np.eye(3), np.zeros((4, 1)), flags=flags,
    )  # fmt: skip
    assert rms <= 0.05
    given = [FISHEYE[key] for key in ("fx", "fy", "cx", "cy")]
    found = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]]
    np.testing.assert_allclose(found, given, rtol=0.0, atol=0.5)
    np.testing.assert_allclose(coefficients.ravel()[:2], FISHEYE["distortion"]["k"], atol=0.01)
