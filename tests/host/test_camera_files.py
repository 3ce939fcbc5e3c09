"""Cameras in files: our own, camera matrices, COLMAP, transforms.json and glTF; and what is refused of them."""

from __future__ import annotations

import json
import math
import random
import struct
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest
from camera_support import Calibration, calibrations

import clrender
from clrender.errors import ClrenderError, SceneError, UsageError
from clrender.files.package_data import scenes_folder
from clrender.scene import Camera

if TYPE_CHECKING:
    from clrender.device import Device

PLAIN: dict[str, Any] = {"position": [0.0, 0.5, 3.0], "target": [0.0, 0.0, 0.0]}


def scene_with(camera: Any) -> clrender.Scene:
    return clrender.load(str(scenes_folder() / "point-plane.toml"), camera=camera)


def agree(camera: Camera, calibration: Calibration, shift: float = 0.0) -> None:
    """Both see the same points at the same pixels."""
    points = calibration.points(np.random.default_rng(2), 100)
    found, wanted = camera.project(points), calibration.projected(points) + shift
    there = np.isfinite(found[:, 0])
    assert there.sum() > 60
    np.testing.assert_allclose(found[there], wanted[there], rtol=0.0, atol=1e-6)


def opencv_file(calibration: Calibration) -> dict[str, Any]:
    """What calibration programs write."""
    k = calibration.k
    coefficients = k if calibration.p is None else (*k[:2], *calibration.p, *k[2:])
    return {
        "camera_matrix": {"rows": 3, "cols": 3, "data": calibration.matrix.ravel().tolist()},
        "distortion_model": "equidistant" if calibration.p is None else "plumb_bob",
        "distortion_coefficients": {"rows": 1, "cols": len(coefficients), "data": list(coefficients)},
        "image_width": calibration.size[0],
        "image_height": calibration.size[1],
        "rvec": cv2.Rodrigues(calibration.rotation)[0].ravel().tolist(),
        "tvec": calibration.translation.tolist(),
    }


@pytest.mark.parametrize("number", range(4))
def test_camera_matrices(tmp_path: Path, number: int) -> None:
    calibration = calibrations(4, 7)[number]
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(opencv_file(calibration)))
    scene = scene_with(path)
    agree(scene.camera, calibration)
    assert (scene.image.width, scene.image.height) == calibration.size
    said = opencv_file(calibration)
    short = {"K": calibration.matrix.tolist(), "resolution": list(calibration.size), "fisheye": calibration.p is None}
    short |= {"D": said["distortion_coefficients"]["data"], "R": calibration.rotation.tolist(), "t": said["tvec"]}
    path.write_text(json.dumps(short))
    agree(clrender.load_cameras(path)[""], calibration)


def test_a_matrix_without_a_pose_keeps_that_of_the_scene(tmp_path: Path) -> None:
    path = tmp_path / "camera.toml"
    path.write_text("K = [[500.0, 0.0, 319.5], [0.0, 500.0, 239.5], [0.0, 0.0, 1.0]]\nwidth = 640\nheight = 480\n")
    plain, scene = clrender.load(str(scenes_folder() / "point-plane.toml")), scene_with(path)
    assert scene.camera.position == plain.camera.position and scene.camera.target == plain.camera.target
    assert scene.camera.type == "intrinsics" and scene.image.width == 640
    assert scene.read_files == (path,)
    assert clrender.load_cameras(path)[""].project([0.0, 0.0, 1.0]).tolist() == [319.5, 239.5]


@pytest.mark.parametrize("form", ["table", "whole"])
def test_cameras_of_scene_files(tmp_path: Path, form: str) -> None:
    path = tmp_path / "camera.json"
    camera = {**PLAIN, "vertical_fov": 30.0}
    path.write_text(
        json.dumps({"camera": camera, "image": {"width": 320, "height": 200}} if form == "table" else camera)
    )
    scene = scene_with(str(path))
    assert scene.camera == Camera(**camera)
    assert scene.image.width == (320 if form == "table" else 64)
    assert scene_with(camera).camera == scene_with(Camera(**camera)).camera == scene.camera


def colmap(folder: Path, chosen: list[Calibration], binary: bool) -> None:
    """COLMAP's two files, as it writes them: an image of each camera, with points."""
    lines, views = ["# cameras"], ["# images"]
    binaries = [struct.pack("<Q", len(chosen)), struct.pack("<Q", len(chosen))]
    for number, each in enumerate(chosen):
        (fx, _, cx), (_, fy, cy), _ = each.matrix.tolist()
        k = [*each.k, *[0.0] * 6]
        model, code, more = "FULL_OPENCV", 6, [*k[:2], *(each.p or ()), *k[2:6]]
        if each.p is None:
            model, code, more = "OPENCV_FISHEYE", 5, k[:4]
        parameters = [fx, fy, cx + 0.5, cy + 0.5, *more]
        turn = cv2.Rodrigues(each.rotation)[0].ravel()
        angle = float(np.linalg.norm(turn))
        quaternion = [math.cos(angle / 2.0), *(math.sin(angle / 2.0) * turn / angle).tolist()]
        name, (width, height) = f"views/image {number}.png", each.size
        lines.append(f"{number + 5} {model} {width} {height} " + " ".join(map(repr, parameters)))
        pose = [*quaternion, *each.translation.tolist()]
        views += [f"{number} " + " ".join(map(repr, pose)) + f" {number + 5} {name}", "1.0 2.0 -1 3.0 4.0 7"]
        binaries[0] += struct.pack("<iiQQ", number + 5, code, width, height) + struct.pack(
            f"<{len(parameters)}d", *parameters
        )
        binaries[1] += struct.pack("<i7di", number, *pose, number + 5) + name.encode() + b"\0"
        binaries[1] += struct.pack("<Q", 2) + struct.pack("<ddqddq", 1.0, 2.0, -1, 3.0, 4.0, 7)
    folder.mkdir(exist_ok=True)
    for name, text, data in zip(("cameras", "images"), (lines, views), binaries, strict=True):
        if binary:
            (folder / f"{name}.bin").write_bytes(data)
        else:
            (folder / f"{name}.txt").write_text("\n".join(text) + "\n")


def without_skew(count: int) -> list[Calibration]:
    chosen = calibrations(count, 9)
    for each in chosen:
        each.matrix[0, 1] = 0.0
    return chosen


@pytest.mark.parametrize("binary", [False, True])
def test_cameras_of_colmap(tmp_path: Path, binary: bool) -> None:
    chosen = without_skew(8)
    colmap(tmp_path / "sparse", chosen, binary)
    cameras = clrender.load_cameras(tmp_path / "sparse")
    assert list(cameras) == [f"views/image {number}.png" for number in range(8)]
    for camera, each in zip(cameras.values(), chosen, strict=True):
        agree(camera, each, 0.5)
    for name in ("views/image 3.png", "image 3.png", "image 3", "3"):
        assert scene_with(f"{tmp_path / 'sparse'}#{name}").camera == cameras["views/image 3.png"]


@pytest.mark.parametrize("damage", ["short", "model", "camera", "zero"])
@pytest.mark.parametrize("binary", [False, True])
def test_damaged_files_of_colmap(tmp_path: Path, damage: str, binary: bool) -> None:
    colmap(tmp_path, without_skew(2), binary)
    path = tmp_path / ("images" if damage in ("short", "camera", "zero") else "cameras")
    path = path.with_suffix(".bin" if binary else ".txt")
    data = path.read_bytes()
    if damage == "short":
        path.write_bytes(data[: len(data) - (60 if binary else 90)])
    elif binary:
        at = {"model": 12, "camera": 8 + 4 + 56, "zero": 8 + 4}[damage]
        new = (
            struct.pack("<i", 10) if damage == "model" else struct.pack("<i", 99) if damage == "camera" else b"\0" * 32
        )
        path.write_bytes(data[:at] + new + data[at + len(new) :])
    elif damage == "model":
        path.write_bytes(data.replace(b"FULL_OPENCV", b"FOV"))
    else:
        lines = data.decode().split("\n")
        number, *pose, camera, first, second = lines[1].split(maxsplit=10)
        pose = ["0"] * 4 + pose[4:] if damage == "zero" else pose
        camera = "99" if damage == "camera" else camera
        lines[1] = " ".join([number, *pose, camera, first, second])
        path.write_text("\n".join(lines))
    words = {"short": "damaged|finite|missing", "model": "model", "camera": "is not in cameras", "zero": "length zero"}
    with pytest.raises(SceneError, match=words[damage]):
        clrender.load_cameras(tmp_path)


def transforms(chosen: list[Calibration]) -> dict[str, Any]:
    """A ``transforms.json`` whose frames have their own intrinsics."""
    made = []
    for number, each in enumerate(chosen):
        (fx, _, cx), (_, fy, cy), _ = each.matrix.tolist()
        pose = np.linalg.inv(each.pose) @ np.diag([1.0, -1.0, -1.0, 1.0])
        k = {f"k{n + 1}": value for n, value in enumerate(each.k[:4] if each.p is None else each.k[:3])}
        p = {} if each.p is None else {"p1": each.p[0], "p2": each.p[1]}
        frame = {"file_path": f"images/{number:04}.png", "transform_matrix": pose.tolist(), **k, **p}
        frame |= {"fl_x": fx, "fl_y": fy, "cx": cx + 0.5, "cy": cy + 0.5, "w": each.size[0], "h": each.size[1]}
        made.append({**frame, "camera_model": "OPENCV" if each.p else "OPENCV_FISHEYE"})
    return {"aabb_scale": 4, "frames": made}


def test_cameras_of_transforms_json(tmp_path: Path) -> None:
    chosen = [each for each in without_skew(8) if len(each.k) != 6]
    path = tmp_path / "transforms.json"
    path.write_text(json.dumps(transforms(chosen)))
    cameras = clrender.load_cameras(path)
    for camera, each in zip(cameras.values(), chosen, strict=True):
        agree(camera, each, 0.5)
    assert scene_with(f"{path}#0002").camera == list(cameras.values())[2]
    with pytest.raises(UsageError, match=r"has 6 cameras; write .*#NAME or #NUMBER for one of \"images/0000.png\", "):
        scene_with(path)
    with pytest.raises(UsageError, match=r"has no camera \"images/0009.png\"; did you mean"):
        scene_with(f"{path}#images/0009.png")
    (tmp_path / "own.toml").write_text("[camera]\nposition = [0.0, 0.0, 5.0]\ntarget = [0.0, 0.0, 0.0]\n")
    with pytest.raises(UsageError, match=r"has no camera \"x\"; the only one has no name: leave out #x"):
        scene_with(f"{tmp_path / 'own.toml'}#x")


def test_angles_in_transforms_json(tmp_path: Path) -> None:
    """Those of NeRF's synthetic scenes say no more."""
    path = tmp_path / "transforms.json"
    pose = np.eye(4).tolist()
    path.write_text(json.dumps({"camera_angle_x": 0.8, "frames": [{"file_path": "a", "transform_matrix": pose}]}))
    (camera,) = clrender.load_cameras(path).values()
    assert camera.type == "perspective" and camera.vertical_fov == pytest.approx(math.degrees(0.8))
    assert camera.axes[2] == (0.0, 0.0, -1.0) and camera.axes[1] == (0.0, 1.0, 0.0)
    sized = {"camera_angle_x": 0.8, "w": 640, "h": 480, "frames": [{"file_path": "a", "transform_matrix": pose}]}
    path.write_text(json.dumps(sized))
    (camera,) = clrender.load_cameras(path).values()
    assert camera.resolution == (640, 480) and camera.fx == pytest.approx(320.0 / math.tan(0.4), rel=1e-14)


def test_cameras_of_gltf(tmp_path: Path) -> None:
    nodes = [
        {"name": "left", "camera": 0, "translation": [1.0, 2.0, 3.0]},
        {"name": "right", "camera": 0, "translation": [2.0, 2.0, 3.0]},
        {"camera": 1},
    ]
    lenses = [
        {"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1, "aspectRatio": 2.0}},
        {
            "name": "above",
            "type": "orthographic",
            "orthographic": {"xmag": 2.0, "ymag": 1.0, "znear": 0.0, "zfar": 9.0},
        },
    ]
    path = tmp_path / "cameras.gltf"
    content = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1, 2]}],
        "nodes": nodes,
        "cameras": lenses,
    }
    path.write_text(json.dumps(content))
    cameras = clrender.load_cameras(path)
    assert list(cameras) == ["left", "right", "above"]
    scene = scene_with(f"{path}#right")
    assert scene.camera == cameras["right"] and scene.camera.position == (2.0, 2.0, 3.0)
    assert (scene.image.width, scene.image.height) == (800, 400)
    assert scene_with(f"{path}#above").camera.type == "orthographic"


def test_images_of_a_camera_from_a_file_are_verified(device: Device, tmp_path: Path) -> None:
    """Without that file; the size of its image is part of the scene."""
    path = tmp_path / "camera.toml"
    path.write_text('[camera]\ntype = "intrinsics"\nfx = 30.0\n[image]\nwidth = 40\nheight = 24\n')
    with clrender.Session(device.info.index) as session:
        image = session.render(clrender.load("room", camera=path, hide_environment=True), spp=2)
    assert image.linear.shape == (24, 40, 3)
    image.save(tmp_path / "a.exr")
    path.unlink()
    assert clrender.verify(tmp_path / "a.exr", fraction=1.0, device=device.info.index).sound


REFUSED: list[tuple[str, str, str]] = [
    ("a.toml", "K = [[1.0, 0.0], [0.0, 1.0]]", "a.toml: K has 4 numbers, but must have 9"),
    ("a.toml", "K = 'wide'", 'a.toml: K is "wide", but must be a list of numbers'),
    ("a.json", '{"K": [1, 0, 0, 1, 1, 0, 0, 0, 1]}', "a.json: K is no camera matrix"),
    ("a.json", '{"K": [1, 0, 0, 0, 1, 0, 0, 0, 1], "D": [1, 2], "model": "tilted"}', "the distortion model"),
    ("a.json", '{"K": [1, 0, 0, 0, 1, 0, 0, 0, 1], "D": [0, 0, 0, 0, 0, 0, 0, 0, 1]}', "a thin prism"),
    ("a.json", '{"K": [-1, 0, 0, 0, 1, 0, 0, 0, 1]}', "a.json: fx is -1.0, but must be greater than 0"),
    ("a.json", '{"position": [0, 0, 1]}', "a.json: the key `target` is missing; add it"),
    ("a.json", '{"positoin": [0, 0, 1]}', "a.json: positoin is an unknown key; did you mean"),
    ("a.json", "[1, 2]", "a.json: is no table of a camera"),
    ("a.json", '{"camera": 3}', "a.json: camera is"),
    ("a.json", '{"frames": [{}]}', "a.json: frames[0] has no transform_matrix"),
    ("a.json", '{"frames": [{"transform_matrix": [[1]]}]}', "a.json: frames[0] has no camera_angle_x; add it"),
    ("a.json", '{"frames": []}', "a.json: has no camera; name another file"),
    ("a.json", '{"frames": 1}', "a.json: frames is no list"),
    ("a.yaml", "", "a.yaml: is no file of cameras: name one that ends in .toml, .json, .gltf, .glb"),
]


@pytest.mark.parametrize(("name", "text", "words"), REFUSED)
def test_wrong_files_are_refused(tmp_path: Path, name: str, text: str, words: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(ClrenderError) as caught:
        scene_with(path)
    assert words in str(caught.value)


def test_missing_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"none\.json"):
        scene_with(tmp_path / "none.json")
    with pytest.raises(SceneError, match=r"has no cameras.bin and images.bin, or .txt, of COLMAP"):
        scene_with(tmp_path)
    with pytest.raises(UsageError, match="must be a Camera, its keys, or the name of a file"):
        scene_with(3)


@pytest.mark.parametrize("count", [300, pytest.param(10_000, marks=pytest.mark.slow)])
def test_mutated_files_are_read_or_refused(tmp_path: Path, count: int) -> None:
    chosen = without_skew(3)
    colmap(tmp_path / "text", chosen, binary=False)
    colmap(tmp_path / "binary", chosen, binary=True)
    (tmp_path / "matrix.json").write_text(json.dumps(opencv_file(chosen[0])))
    (tmp_path / "transforms.json").write_text(json.dumps(transforms(chosen[:2])))
    originals = {path: path.read_bytes() for path in sorted(tmp_path.rglob("*.*"))}
    rng, refused = random.Random(3), 0
    for _ in range(count):
        path, data = rng.choice(list(originals.items()))
        path.write_bytes(mutated(rng, data))
        try:
            clrender.load_cameras(path)
        except ClrenderError:
            refused += 1
        path.write_bytes(data)
    assert count // 10 < refused < count


def mutated(rng: random.Random, data: bytes) -> bytes:
    """A byte changed, some bytes taken out, put in or said twice, or the end cut off."""
    at = rng.randrange(len(data))
    ways: list[Callable[[], bytes]] = [
        lambda: data[:at] + bytes([rng.randrange(256)]) + data[at + 1 :],
        lambda: data[:at] + data[at + rng.randrange(1, 9) :],
        lambda: data[:at] + rng.choice([b"1e999", b"-", b"nan", b"\0", b'"', b"[", b"null"]) + data[at:],
        lambda: data[:at] + data[max(0, at - 20) :],
        lambda: data[:at],
    ]
    return rng.choice(ways)()
