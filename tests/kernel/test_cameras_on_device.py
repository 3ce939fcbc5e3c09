"""camera/: rays of calibrated cameras, and how they see points, against the host's double precision."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
from camera_support import calibrations
from kernel_support import FOLDER

from clrender import layout
from clrender.flatten.camera_row import camera_row
from clrender.scene import Camera, Scene

if TYPE_CHECKING:
    from clrender.device import Device

Floats = npt.NDArray[np.float64]
COUNT = 512
CALIBRATED = {"CALIBRATED_CAMERA": 1}

FLAT: dict[str, Any] = {
    "type": "intrinsics", "fx": 500.0, "fy": 520.0, "cx": 330.0, "resolution": [640, 480], "skew": 3.0,
    "camera_to_world": np.eye(4),
}  # fmt: skip
BARREL = {"model": "brown-conrady", "k": [-0.25, 0.08], "p": [1e-3, -2e-3]}
LENSES: dict[str, dict[str, Any]] = {
    "skewed": {},
    "barrel": {"distortion": BARREL},
    "behind a lens": {"distortion": BARREL, "aperture_radius": 0.1, "focus_distance": 3.0},
    "fisheye": {"fx": 200.0, "fy": 200.0, "distortion": {"model": "kannala-brandt", "k": [0.05, -0.01]}},
}


def launch(
    device: Device,
    camera: Camera,
    size: tuple[int, int],
    kernel: str,
    values: npt.NDArray[Any],
    outputs: int,
    lanes: int,
) -> npt.NDArray[np.float32]:
    """(outputs, COUNT) results for (n, COUNT) values, on coordinates that begin at the camera."""
    row = camera_row(Scene(camera=camera), *size, camera.position)
    settings = np.zeros(1, layout.dtype("Settings"))
    settings["width"], settings["height"] = size
    inputs = (row.view(np.uint8), settings.view(np.uint8), np.ascontiguousarray(values, np.float32))
    buffers = [*(device.upload(each) for each in inputs), device.empty(4 * outputs * COUNT)]
    program = device.program(FOLDER / "cameras.cl", {"LANES": lanes, **CALIBRATED})
    device.launch(program, kernel, COUNT // lanes, 16, [*buffers[:3], np.uint32(COUNT), buffers[3]])
    results = np.empty((outputs, COUNT), np.float32)
    device.read(buffers[3], results)
    for buffer in buffers:
        device.release(buffer)
    return results


def test_rays_pass_their_pixels(device: Device) -> None:
    """To a thousandth of a pixel, as far as a float tells pixels apart; the same bits in any number of lanes."""
    rng = np.random.default_rng(1)
    seen = 0
    for number, each in enumerate(calibrations(40, 5)):
        camera, size = each.camera, each.size
        places = rng.uniform(0.0, 1.0, (2, COUNT)).astype(np.float32)
        found = launch(device, camera, size, "cameras_rays", places, 8, 8)
        if number < 4:
            for lanes in (1, 16):
                again = launch(device, camera, size, "cameras_rays", places, 8, lanes)
                np.testing.assert_array_equal(again.view(np.uint32), found.view(np.uint32))
        there = found[6] > 0.0
        pixels = (places.T.astype(np.float64) * size) - 0.5
        wanted = camera.unproject(pixels)[1]
        # Both know where the field ends, but for its last thousandth
        assert (there != np.isfinite(wanted[:, 0])).sum() <= 2
        there &= np.isfinite(wanted[:, 0])
        seen_at = camera.project(np.array(camera.position) + found[3:6].T[there].astype(np.float64))
        sure = np.isfinite(seen_at[:, 0])
        error = np.abs(seen_at - pixels[there])[sure].max(axis=1)
        # Near the end of the field a small angle is many pixels, or few
        assert np.quantile(error, 0.99) < 1e-3 * max(1.0, max(size) / 1500.0), number
        assert error.max() < 0.02
        seen += int(there.sum())
    assert seen > 15_000


@pytest.mark.parametrize("name", LENSES)
def test_pixels_per_steradian(device: Device, name: str) -> None:
    """The Jacobian of the projection, by differences."""
    camera = Camera(**FLAT, **LENSES[name]) if "fx" not in LENSES[name] else Camera(**{**FLAT, **LENSES[name]})
    size = (640, 480)
    places = np.random.default_rng(2).uniform(0.05, 0.95, (2, COUNT))
    found = launch(device, camera, size, "cameras_rays", places, 8, 8).astype(np.float64)
    there = found[6] > 0.0
    assert there.sum() > 300
    origins, directions = found[:3].T[there], found[3:6].T[there]
    aside = np.cross(directions, [0.3, 0.9, 0.1])
    aside /= np.linalg.norm(aside, axis=1)[:, None]
    step, focus = 1e-5, camera.focus

    def pixels(ways: Floats) -> Floats:
        # Through the middle of the lens goes the ray that meets the same point in focus
        points = origins + ways * (focus / ways[:, 2:]) if camera.aperture_radius else ways
        return camera.project(points)

    columns = [(pixels(directions + step * way) - pixels(directions - step * way)) / (2.0 * step)
               for way in (aside, np.cross(directions, aside))]  # fmt: skip
    exact = np.abs(columns[0][:, 0] * columns[1][:, 1] - columns[0][:, 1] * columns[1][:, 0])
    np.testing.assert_allclose(found[7][there], exact, rtol=2e-4)


@pytest.mark.parametrize("name", LENSES)
def test_points_are_seen_where_their_rays_pass(device: Device, name: str) -> None:
    """Of points on the plane of focus, whatever the point of the lens; and how many pixels a metre² covers."""
    camera = Camera(**{**FLAT, **LENSES[name]})
    size, depth = (640, 480), camera.focus
    rng = np.random.default_rng(3)
    points = np.stack(
        [rng.uniform(-0.5, 0.5, COUNT) * depth, rng.uniform(-0.4, 0.4, COUNT) * depth, np.full(COUNT, depth)]
    )
    points = points.astype(np.float32)
    found = launch(device, camera, size, "cameras_towards", points, 3, 8).astype(np.float64)
    wanted = camera.project(points.T.astype(np.float64))
    there = np.isfinite(wanted[:, 0])
    assert there.sum() > 400
    np.testing.assert_allclose((found[:2].T * size)[there], wanted[there], rtol=0.0, atol=2e-3)
    if not camera.aperture_radius:
        distance = np.linalg.norm(points.T.astype(np.float64), axis=1)
        ahead = launch(device, camera, size, "cameras_rays", (wanted / size).T, 8, 8)[7]
        inside = there & (ahead > 0.0)
        np.testing.assert_allclose((found[2] * distance * distance)[inside], ahead[inside], rtol=2e-4)


@pytest.mark.parametrize("model", ["brown-conrady", "kannala-brandt"])
def test_a_camera_does_not_see_what_is_outside_of_its_field(device: Device, model: str) -> None:
    camera = Camera(**{**FLAT, "distortion": {"model": model, "k": [-0.3]}})
    points = np.zeros((3, COUNT))
    points[:, ::2] = [[0.0], [0.0], [-1.0]]
    points[:, 1::2] = [[4.0], [0.0], [1.0]]
    assert (launch(device, camera, (640, 480), "cameras_towards", points, 3, 8)[2] == 0.0).all()
