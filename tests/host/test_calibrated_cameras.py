"""Calibrated cameras on the host: projection as OpenCV's, its inverse, poses, and what is refused."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from camera_support import calibrations

from clrender.cameras.distortion import BrownConrady, KannalaBrandt
from clrender.cameras.poses import CONVENTIONS, pose_matrix
from clrender.errors import SceneError, UsageError
from clrender.flatten.camera_row import camera_row
from clrender.flatten.flat_scene import flatten
from clrender.scene import Scene
from clrender.scene.camera import Camera

Floats = npt.NDArray[np.float64]

PLAIN: dict[str, Any] = {"position": [0, 0, 0], "target": [0, 0, 1]}
OTHERS: dict[str, dict[str, Any]] = {
    "perspective": {"vertical_fov": 60.0, "lens_shift": [0.2, -0.1]},
    "orthographic": {"type": "orthographic", "height": 3.0, "lens_shift": [0.2, -0.1]},
    "panoramic": {"type": "panoramic"},
    "fisheye": {"type": "fisheye", "vertical_fov": 220.0},
    "mirrored": {"mirrored": True},
}


def test_points_are_projected_as_by_opencv() -> None:
    """10^5 points, 200 cameras."""
    rng = np.random.default_rng(1)
    seen = 0
    for each in calibrations(200, 0):
        points = each.points(rng, 500)
        found = each.camera.project(points)
        there = np.isfinite(found[:, 0])
        seen += int(there.sum())
        np.testing.assert_allclose(found[there], each.projected(points)[there], rtol=0.0, atol=1e-6)
    assert seen > 90_000


def test_rays_are_the_inverse_of_projection() -> None:
    rng = np.random.default_rng(2)
    lost = 0
    for each in calibrations(100, 3):
        camera, points = each.camera, each.points(rng, 300)
        pixels = camera.project(points)
        there = np.isfinite(pixels[:, 0])
        origins, directions = camera.unproject(pixels[there])
        np.testing.assert_array_equal(origins, np.broadcast_to(camera.position, origins.shape))
        toward = points[there] - origins
        toward /= np.linalg.norm(toward, axis=1)[:, None]
        found = np.isfinite(directions[:, 0])
        np.testing.assert_allclose(directions[found], toward[found], rtol=0.0, atol=1e-8)
        lost += int((~found).sum())
    assert lost < 10  # where two directions all but share a place


@pytest.mark.parametrize("name", OTHERS)
def test_other_cameras_have_an_inverse_too(name: str) -> None:
    camera = Camera(**{"position": [0.3, -0.2, 0.1], "target": [1.3, 0.6, -0.9], "up": [0.1, 1.0, 0.2], **OTHERS[name]})
    rng = np.random.default_rng(4)
    pixels = np.stack([rng.uniform(40.0, 280.0, 200), rng.uniform(0.0, 200.0, 200)], axis=1).reshape(20, 10, 2)
    origins, directions = camera.unproject(pixels, size=(320, 200))
    there = np.isfinite(directions[..., 0])
    assert there.sum() > 100
    points = origins + directions * rng.uniform(0.5, 9.0, (20, 10, 1))
    again = camera.project(points, size=(320, 200))
    np.testing.assert_allclose(again[there], pixels[there], rtol=0.0, atol=1e-9)


def test_a_shifted_lens_moves_the_image() -> None:
    plain, shifted = Camera(**PLAIN), Camera(**PLAIN, lens_shift=[0.25, 0.1])
    point = [0.1, 0.2, 3.0]
    moved = plain.project(point, size=(400, 200)) - shifted.project(point, size=(400, 200))
    np.testing.assert_allclose(moved, [100.0, -20.0], atol=1e-9)


def test_intrinsics_without_distortion_are_a_perspective_camera() -> None:
    """With square pixels and the principal point in the middle."""
    focal = 0.5 * 200.0 / np.tan(np.radians(25.0))
    calibrated = Scene(camera={**PLAIN, "type": "intrinsics", "fx": focal, "cx": 160.0, "resolution": [320, 200]})
    plain = Scene(camera={**PLAIN, "vertical_fov": 50.0})
    first, second = (camera_row(each, 640, 400, (0.0, 0.0, 0.0))[0] for each in (calibrated, plain))
    assert first["kind"] == second["kind"]
    for name in ("corner", "right", "down", "axis", "lens_u"):
        np.testing.assert_allclose(first[name], second[name], rtol=1e-6, atol=1e-7)


def test_pixels_count_from_the_corner_or_from_the_first_centre() -> None:
    keys = {**PLAIN, "type": "intrinsics", "fx": 100.0, "resolution": [64, 48]}
    corner, center = Camera(**keys, cx=32.5, cy=20.0), Camera(**keys, cx=32.0, cy=19.5, pixel_origin="center")
    points = np.random.default_rng(5).normal(0.0, 1.0, (50, 3)) + np.array([0.0, 0.0, 4.0])
    np.testing.assert_allclose(corner.project(points), center.project(points) + 0.5, rtol=0.0, atol=1e-12)
    middle = Camera(**keys, pixel_origin="center").project([0.0, 0.0, 1.0])
    np.testing.assert_array_equal(middle, [31.5, 23.5])


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_a_pose_says_what_position_target_and_up_say(convention: str) -> None:
    """Of a cube whose corners have names: where the camera's own axes point is where the convention says."""
    plain = Camera(position=[1.0, 2.0, 3.0], target=[2.0, 2.5, 1.0], up=[0.0, 1.0, 0.2])
    right, up, forward = (np.array(each) for each in plain.axes)
    own = {
        "opencv": np.column_stack([right, -up, forward]),
        "opengl": np.column_stack([right, up, -forward]),
        "ros": np.column_stack([forward, -right, up]),
    }[convention]
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = own, plain.position
    np.testing.assert_allclose(pose_matrix(plain.position, [right, -up, forward], convention), matrix, atol=1e-15)
    corners = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    wanted = plain.project(corners, size=(640, 480))
    for given in ({"camera_to_world": matrix}, {"world_to_camera": np.linalg.inv(matrix)[:3]}):
        camera = Camera(**given, convention=convention)
        np.testing.assert_allclose(camera.project(corners, size=(640, 480)), wanted, rtol=0.0, atol=1e-9)
        assert camera.camera_to_world is None and camera.world_to_camera is None
        assert camera.changed(position=[0, 0, 0]).position == (0.0, 0.0, 0.0)


def test_eyes_are_a_baseline_apart() -> None:
    camera = Camera(position=[1, 2, 3], target=[1, 2, 0], vertical_fov=40.0)
    left, right = camera.stereo_pair(0.1)
    np.testing.assert_allclose(np.subtract(right.position, left.position), [0.1, 0.0, 0.0], atol=1e-15)
    focal = 0.5 * 100.0 / np.tan(np.radians(20.0))
    far = [1.2, 2.1, 1.0]
    disparity = left.project(far, size=(100, 100)) - right.project(far, size=(100, 100))
    np.testing.assert_allclose(disparity, [focal * 0.1 / 2.0, 0.0], atol=1e-9)


def test_eyes_and_pixels_of_a_moving_camera() -> None:
    """Each key is moved along its own axis; points are seen from where the camera is as the shutter opens."""
    keys = [
        {"time": 0.0, "position": (0, 0, 4), "target": (0, 0, 0)},
        {"time": 2.0, "position": (4, 0, 0), "target": (0, 0, 0)},
    ]
    camera = Camera(position=(9, 9, 9), target=(0, 0, 0), motion=keys, time=2.0)
    left, right = camera.stereo_pair(0.4)
    np.testing.assert_allclose(left.opened.position, (4.0, 0.0, 0.2), atol=1e-12)
    np.testing.assert_allclose(right.opened.position, (4.0, 0.0, -0.2), atol=1e-12)
    np.testing.assert_allclose(left.changed(time=0.0).opened.position, (-0.2, 0.0, 4.0), atol=1e-12)
    still = Camera(position=(4, 0, 0), target=(0, 0, 0))
    points = [[0.5, 0.2, 0.1], [-1.0, 0.3, 0.4]]
    pixels = still.project(points, size=(80, 60))
    np.testing.assert_allclose(camera.project(points, size=(80, 60)), pixels, atol=1e-9)
    for mine, wanted in zip(camera.unproject(pixels, (80, 60)), still.unproject(pixels, (80, 60)), strict=True):
        np.testing.assert_allclose(mine, wanted, atol=1e-9)


def test_the_end_of_the_field() -> None:
    assert BrownConrady().limit == np.inf
    # r - r³/3 grows to r = 1
    assert BrownConrady((-1.0 / 3.0, 0.0, 0.0, 0.0, 0.0, 0.0)).limit == pytest.approx(1.0, abs=1e-12)
    # r / (1 - r²) has a pole at 1
    assert BrownConrady((0.0, 0.0, 0.0, -1.0, 0.0, 0.0)).limit == pytest.approx(1.0, abs=1e-12)
    assert KannalaBrandt().limit == np.pi
    assert KannalaBrandt((-1.0 / 3.0, 0.0, 0.0, 0.0)).limit == pytest.approx(1.0, abs=1e-12)
    lens = BrownConrady((-1.0 / 3.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert np.isnan(lens.places(np.array([1.2, 0.0, 1.0]))).all()
    assert np.isnan(lens.directions(np.array([0.7, 0.0]))).all()
    assert np.isfinite(lens.directions(np.array([0.66, 0.0]))).all()


REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"type": "intrinsics"}, "camera: the key `fx` is missing; add it: "),
    ({"fx": 100.0}, "camera.fx is for cameras of type intrinsics only; leave it out"),
    ({"type": "intrinsics", "fx": -1.0}, "camera.fx is -1.0, but must be greater than 0"),
    ({"type": "intrinsics", "fx": 9.0, "vertical_fov": 30.0}, "camera.vertical_fov is for cameras of type"),
    ({"type": "intrinsics", "fx": 9.0, "lens_shift": [0.1, 0.0]}, "camera.lens_shift is for cameras of type"),
    (
        {"type": "intrinsics", "fx": 9.0, "distortion": {"model": "kannala-brandt", "k": [0, 0, 0, 0, 1]}},
        "camera.distortion.k has 5 numbers, but kannala-brandt has at most 4",
    ),
    (
        {"type": "intrinsics", "fx": 9.0, "distortion": {"model": "kannala-brandt", "p": [0.0, 1.0]}},
        "camera.distortion.p is for the model brown-conrady only; leave it out",
    ),
    (
        {"type": "intrinsics", "fx": 9.0, "distortion": {"model": "brown", "k": []}},
        'camera.distortion.model is "brown", which is not known; known here: brown-conrady, kannala-brandt',
    ),
    (
        {"type": "intrinsics", "fx": 9.0, "aperture_radius": 0.1, "distortion": {"model": "kannala-brandt"}},
        "camera.aperture_radius is not for cameras with the distortion kannala-brandt",
    ),
    ({"convention": "ros"}, "camera.convention is for camera_to_world and world_to_camera only; leave it out"),
]


@pytest.mark.parametrize(("keys", "words"), REFUSED)
def test_wrong_keys_are_refused(keys: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError) as caught:
        Scene(camera={**PLAIN, **keys})
    assert words in str(caught.value)


POSES: list[tuple[Any, str]] = [
    (np.eye(4) * 2.0, "camera_to_world has a last row that is not 0, 0, 0, 1"),
    (np.diag([2.0, 2.0, 2.0, 1.0]), "camera_to_world is not a rotation and a translation"),
    (np.diag([1.0, 1.0, -1.0, 1.0]), "camera_to_world turns right into left"),
    (np.eye(4)[:2], "camera.camera_to_world"),
    ("none", 'camera.camera_to_world is the text "none", but must be a list'),
]


@pytest.mark.parametrize(("matrix", "words"), POSES)
def test_matrices_that_are_no_pose_are_refused(matrix: Any, words: str) -> None:
    with pytest.raises(SceneError) as caught:
        Scene(camera={"camera_to_world": matrix})
    assert words in str(caught.value)


def test_a_pose_is_given_once() -> None:
    with pytest.raises(SceneError, match=r"camera\.target is given with camera_to_world, which says it too"):
        Scene(camera={"camera_to_world": np.eye(4), "target": [0, 0, 1]})
    with pytest.raises(SceneError, match=r"camera\.world_to_camera is given with camera_to_world"):
        Scene(camera={"camera_to_world": np.eye(4), "world_to_camera": np.eye(4)})
    with pytest.raises(SceneError, match="the key `position` is missing; add it: position, metres"):
        Scene(camera={"target": [0, 0, 1]})
    with pytest.raises(SceneError, match="the key `focus_distance` is missing"):
        Scene(camera={"camera_to_world": np.eye(4), "aperture_radius": 0.1})


def test_images_of_another_shape_show_the_same_height() -> None:
    camera = Camera(**PLAIN, type="intrinsics", fx=100.0, cx=30.0, resolution=[64, 48])
    points = np.random.default_rng(6).normal(0.0, 0.1, (50, 3)) + np.array([0.0, 0.0, 1.0])
    wide, usual = camera.project(points, size=(84, 48)), camera.project(points)
    np.testing.assert_allclose(wide, usual + np.array([10.0, 0.0]), rtol=0.0, atol=1e-12)
    scene = Scene(camera=camera, lights=[{"type": "point", "position": [0, 1, 0], "intensity": [1, 1, 1]}])
    assert flatten(scene, 333, 250).warnings == ()  # to the nearest pixel
    (warning,) = flatten(scene, 64, 64).warnings
    assert "camera: its numbers are of images of 64x48 pixels, and one of 64x64 has another shape" in warning


def test_sizes_and_points_are_needed() -> None:
    camera = Camera(**PLAIN, type="intrinsics", fx=100.0, resolution=[64, 48])
    with pytest.raises(UsageError, match="size of the image is needed"):
        Camera(**PLAIN).project([0.0, 0.0, 1.0])
    with pytest.raises(UsageError, match=r"points are .*, but must be an array of shape \(\.\.\., 3\)"):
        camera.project([[0.0, 0.0]])


def test_intrinsics_apply_to_the_size_of_the_scene() -> None:
    """An image of half the size shows the same."""
    scene = Scene(camera={**PLAIN, "type": "intrinsics", "fx": 100.0, "cx": 20.0}, image={"width": 64, "height": 48})
    small, whole = (camera_row(scene, *size, (0.0, 0.0, 0.0)) for size in ((32, 24), (64, 48)))
    assert small.tobytes() == whole.tobytes()


def test_a_scene_with_a_pose_is_written_and_hashed_like_any_other() -> None:
    pose = pose_matrix([1.0, 2.0, 3.0], np.eye(3), "opencv")
    by_pose = Scene(camera={"camera_to_world": pose, "type": "intrinsics", "fx": 90.0})
    plain = Scene(
        camera={"position": [1, 2, 3], "target": [1, 2, 6], "up": [0, -1, 0], "type": "intrinsics", "fx": 90.0}
    )
    assert by_pose.sha256() == plain.sha256()
    again = Scene.model_validate_json(json.dumps(by_pose.model_dump(mode="json", exclude_unset=True)))
    assert again.sha256() == by_pose.sha256()
