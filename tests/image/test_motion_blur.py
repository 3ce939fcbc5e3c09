"""Motion blur: streaks, rotations and cameras against their integrals, and the same bits however the work is done."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import clrender
from clrender.errors import SceneError
from clrender.scene import Scene

if TYPE_CHECKING:
    import numpy.typing as npt

    from clrender.device import Device

SIZE = (64, 16)
SPP = 256
FLAT: dict[str, Any] = {"type": "orthographic", "position": [0, 0, 5], "target": [0, 0, 0], "height": 1.0}
"""Four metres by one, of what is near the origin."""
BAR: dict[str, Any] = {"type": "quad", "origin": [-1.5, -2, 0], "edge_u": [0.5, 0, 0], "edge_v": [0, 4, 0],
                       "emission": [1, 1, 1]}  # fmt: skip
FOREVER = {"type": "quad", "origin": [0, -50, -10], "edge_u": [500, 0, 0], "edge_v": [0, 100, 0], "emission": [1, 1, 1]}
"""Seen from the origin, all that is to the right of the direction -z."""
IDENTITY = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


def described(camera: dict[str, Any], *shapes: dict[str, Any], **more: Any) -> Scene:
    return Scene.model_validate({"camera": camera, "shapes": list(shapes), **more})


def shown(device: Device, scene: Scene, **more: Any) -> npt.NDArray[np.float32]:
    """One channel of an image of what shines."""
    settings = {"size": SIZE, "spp": SPP, "integrator": "direct", **more}
    with clrender.Session(device.info.index) as session:
        image: npt.NDArray[np.float32] = session.render(scene, **settings).linear
    return image[..., 0]


def agrees(found: npt.NDArray[np.float32], expected: npt.NDArray[np.float64], spp: int = SPP) -> None:
    """Whether shares are what they should be.

    Independent samples would be off by up to five standard deviations, and so would their mean; those of a pixel are
    stratified, which makes them better.
    """
    variance = np.maximum(expected * (1.0 - expected), 1e-4) / spp
    assert (np.abs(found - expected) <= 5.0 * np.sqrt(np.maximum(variance, 0.02 / spp))).all()
    assert abs(float((found - expected).mean())) < 5.0 * math.sqrt(float(variance.mean()) / variance.size)


def columns(share: Any) -> npt.NDArray[np.float64]:
    """A row of the mean of `share`, a function of the place, over each pixel of four metres."""
    fine = (np.arange(SIZE[0] * 100) + 0.5) / (SIZE[0] * 100) * 4.0 - 2.0
    means: npt.NDArray[np.float64] = share(fine).reshape(SIZE[0], 100).mean(axis=1)
    rows: npt.NDArray[np.float64] = np.tile(means, (SIZE[1], 1))
    return rows


def streak(x: npt.NDArray[np.float64], begin: float, way: float) -> npt.NDArray[np.float64]:
    """Share of the time for which `BAR` covers a place, whose left edge goes from `begin` by `way`."""
    enters, leaves = (x - begin) / way, (x - 0.5 - begin) / way
    share: npt.NDArray[np.float64] = np.maximum(np.minimum(enters, 1.0) - np.maximum(leaves, 0.0), 0.0)
    return share


def test_a_streak(device: Device) -> None:
    moving = {**BAR, "motion": [{"time": 1.0}, {"time": 3.0, "translate": [2.0, 0.0, 0.0]}]}
    image = shown(device, described({**FLAT, "time": 1.0, "shutter": [0.5, 1.5]}, moving))
    agrees(image, columns(lambda x: streak(x, -1.0, 1.0)))


def test_a_streak_between_keys(device: Device) -> None:
    """It rests for half the time, goes for a fifth, and rests again."""
    keys = [{"time": 0.5, "translate": [0, 0, 0]}, {"time": 0.7, "matrix": [[1, 0, 0, 1], *IDENTITY[1:]]}]
    image = shown(device, described({**FLAT, "shutter": [0.0, 1.0]}, {**BAR, "motion": keys}))

    def share(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        first, last = (x > -1.5) & (x < -1.0), (x > -0.5) & (x < 0.0)
        return 0.5 * first + 0.2 * streak(x, -1.5, 1.0) + 0.3 * last

    agrees(image, columns(share))


def turning(keys: list[dict[str, Any]]) -> Scene:
    bar = {"type": "quad", "origin": [-0.45, -0.05, 0], "edge_u": [0.9, 0, 0], "edge_v": [0, 0.1, 0]}
    return described({**FLAT, "shutter": [0.0, 1.0]}, {**bar, "emission": [1, 1, 1], "motion": keys})


@pytest.mark.parametrize(
    "keys",
    [
        [{"time": 0.0}, {"time": 1.0, "rotate_degrees": [0.0, 0.0, 360.0]}],
        [{"time": 0.0}, {"time": 1.0, "rotate_degrees": [0.0, 0.0, -1080.0]}],
    ],
    ids=["a turn", "three turns"],
)
def test_a_bar_that_turns(device: Device, keys: list[dict[str, Any]]) -> None:
    """At the distance r from its centre it is seen for 2 asin(h / r) / pi of the time, h being half its width."""
    image = shown(device, turning(keys))
    offsets = (np.arange(10) + 0.5) / 10
    x = ((np.arange(SIZE[0])[:, None] + offsets) * 4.0 / SIZE[0] - 2.0)[None, :, None, :]
    y = ((np.arange(SIZE[1])[:, None] + offsets) / SIZE[1] - 0.5)[:, None, :, None]
    r = np.sqrt(x * x + y * y)
    share = np.where(r < 0.05, 1.0, 2.0 / math.pi * np.arcsin(np.minimum(0.05 / np.maximum(r, 1e-9), 1.0)))
    inside = np.broadcast_to(r < 0.44, share.shape).all(axis=(2, 3))
    outside = np.broadcast_to(r > 0.46, share.shape).all(axis=(2, 3))
    agrees(image[inside], share.mean(axis=(2, 3))[inside])
    assert not image[outside].any()


def test_a_quarter_turn_by_matrices(device: Device) -> None:
    """By polar decomposition along the shortest way: only one quarter, and the opposite one, are swept."""
    quarter = [[0.0, -1.0, 0, 0], [1.0, 0.0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    image = shown(device, turning([{"time": 0.0, "matrix": IDENTITY}, {"time": 1.0, "matrix": quarter}]))
    x = (np.arange(SIZE[0]) + 0.5) * 4.0 / SIZE[0] - 2.0
    y = 0.5 - (np.arange(SIZE[1]) + 0.5) / SIZE[1]
    r = np.sqrt(x * x + y[:, None] * y[:, None])
    swept = ((x * y[:, None]) > 0.0) & (r > 0.2) & (r < 0.4)
    well_inside = swept & (np.abs(x) > 0.13) & (np.abs(y[:, None]) > 0.13)
    expected = 4.0 / math.pi * np.arcsin(np.minimum(0.05 / r, 1.0))
    assert abs(float((image - expected)[well_inside].mean())) < 0.01
    assert not image[((x * y[:, None]) < 0.0) & (np.abs(x) > 0.13) & (np.abs(y[:, None]) > 0.13)].any()


def test_a_camera_that_moves(device: Device) -> None:
    """To its left, which is a streak to the right."""
    keys = [{"time": 0.0}, {"time": 1.0, "position": [-1, 0, 5], "target": [-1, 0, 0]}]
    image = shown(device, described({**FLAT, "shutter": [0.0, 1.0], "motion": keys}, BAR))
    agrees(image, columns(lambda x: streak(x, -1.5, 1.0)))


@pytest.mark.parametrize("kind", ["perspective", "intrinsics", "panoramic"])
def test_a_camera_that_turns(device: Device, kind: str) -> None:
    """By 0.2 radians to its right: each direction is bright from the moment on when it passes the edge."""
    turn = 0.2
    camera: dict[str, Any] = {"type": kind, "position": [0, 0, 0], "target": [0, 0, -1], "shutter": [0.0, 1.0]}
    camera["motion"] = [{"time": 0.0}, {"time": 1.0, "target": [math.sin(turn), 0.0, -math.cos(turn)]}]
    lenses: dict[str, Any] = {"intrinsics": {"fx": 64.0, "resolution": SIZE, "distortion": {"model": "brown-conrady"}}}
    camera |= lenses.get(kind, {})
    image = shown(device, described(camera, FOREVER))
    fine = (np.arange(SIZE[0] * 100) + 0.5) / (SIZE[0] * 100) - 0.5
    spread = {"perspective": 4.0 * math.tan(math.radians(22.5)) * 2.0, "intrinsics": 1.0}.get(kind, 0.0)
    angle = np.arctan(fine * spread) if spread else fine * 2.0 * math.pi
    share = np.clip((angle + turn) / turn, 0.0, 1.0) * (np.abs(angle) < 1.2)
    rows = slice(6, 10) if kind == "panoramic" else slice(None)
    expected = np.broadcast_to(share.reshape(SIZE[0], 100).mean(axis=1), (SIZE[1], SIZE[0]))
    near = np.broadcast_to(np.abs(angle).reshape(SIZE[0], 100).max(axis=1) < 1.2, expected.shape)
    agrees(image[rows][near[rows]], expected[rows][near[rows]])


@pytest.mark.parametrize("exposure", [0.0, 0.25])
def test_rows_that_open_one_after_the_other(device: Device, exposure: float) -> None:
    """Row number r of 16 opens r / 16 s after the first."""
    shutter = {"shutter": [0.0, exposure]} if exposure else {}
    moving = {**BAR, "motion": [{"time": 0.0}, {"time": 2.0, "translate": [3.0, 0.0, 0.0]}]}
    image = shown(device, described({**FLAT, **shutter, "rolling_shutter": 1.0}, moving))
    for row in range(SIZE[1]):
        begin = -1.5 + 1.5 * row / SIZE[1]
        agrees(image[row : row + 1], columns(lambda x, begin=begin: streak(x, begin, 1.5 * exposure or 1e-9))[:1])


ROOM_MOTION: dict[Any, Any] = {
    "camera.shutter": [0.0, 1.0],
    ("shapes", 6, "motion"): [{"time": 0.0}, {"time": 1.0, "translate": [0.3, -0.3, 0.0]}],
    ("shapes", 8, "motion"): [{"time": 0.0}, {"time": 0.6, "rotate_degrees": [0.0, 40.0, 0.0], "scale": 1.2}],
    ("shapes", 12, "motion"): [{"time": 0.0}, {"time": 1.0, "translate": [-0.2, 0.3, 0.1]}],
}


def room(**more: Any) -> Scene:
    scene = clrender.load("room").changed(ROOM_MOTION)
    x, y, z = scene.camera.position
    keys = [{"time": 0.0}, {"time": 1.0, "position": [x + 0.2, y, z]}]
    return scene.changed({"camera.motion": keys, **more})


def test_the_bits_do_not_depend_on_how_the_work_is_done(device: Device) -> None:
    scene = room()
    ways: tuple[dict[str, Any], ...] = (
        {}, {"tile": 16}, {"lanes": 1}, {"lanes": 8, "traversal": "single"}, {"kernels": "staged"}
    )  # fmt: skip
    with clrender.Session(device.info.index) as session:
        images = [session.render(scene, size=(48, 40), spp=4, **way).stats["image_sha256"] for way in ways]
    assert len(set(images)) == 1


def test_a_motion_of_zero_length_changes_no_bit(device: Device) -> None:
    still, settings = clrender.load("room"), dict[str, Any](size=(40, 32), spp=4)
    resting = [{"time": 0.0, "translate": [0.0, 0.0, 0.0]}, {"time": 1.0}]
    x, y, z = still.camera.position
    scenes = [
        still.changed({"camera.shutter": [0.0, 0.5]}),
        room(**{"camera.shutter": [-1.0, 0.0]}),
        room(**{"camera.time": -3.0}),
        still.changed({("shapes", n, "motion"): resting for n in range(6, 12)} | {"camera.shutter": [0.2, 0.5]}),
        still.changed(
            {"camera.motion": [{"time": 0.0, "position": [x, y, z]}, {"time": 1.0}], "camera.shutter": [0, 1]}
        ),
    ]
    with clrender.Session(device.info.index) as session:
        expected = session.render(still, **settings).stats["image_sha256"]
        for scene in scenes:
            assert session.render(scene, **settings).stats["image_sha256"] == expected


def test_an_image_of_one_moment_is_that_of_the_scene_there(device: Device) -> None:
    """A motion at a key, in an instance and in a shape, is its transform."""
    turned = {"translate": [0.1, 0.2, 0.0], "rotate_degrees": [10.0, 30.0, 0.0], "scale": 0.8}
    keys = [{"time": 0.0}, {"time": 1.0, **turned}, {"time": 2.0}]
    box = {"type": "box", "center": [0.3, 0, 0], "size": [0.4, 0.4, 0.4], "material": "m"}
    groups = {"g": {"shapes": [box]}}
    light = {
        "lights": [{"type": "environment", "radiance": [1, 1, 1]}],
        "materials": {"m": {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]}},
    }
    camera = {"position": [0, 1, 4], "target": [0, 0, 0]}
    images = []
    with clrender.Session(device.info.index) as session:
        for where, at in (({"transform": turned}, {}), ({"motion": keys}, {"time": 1.0})):
            pair = [{**box, **where}, {"type": "instance", "group": "g", **where}]
            scene = described({**camera, **at}, *pair, groups=groups, **light)
            images.append(session.render(scene, size=(32, 32), spp=4).linear)
    np.testing.assert_array_equal(images[0], images[1])


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({("shapes", 8, "motion"): [{"time": 1.0}, {"time": 1.0}]}, "later than that of the key before"),
        ({("shapes", 8, "motion"): [{"time": 0.0}, {"time": 1.0, "scale": [-1.0, 1.0, 1.0]}]}, "flat on the way"),
        ({("shapes", 10, "motion"): [{"time": 0.0, "scale": [1.0, 2.0, 1.0]}]}, "unevenly"),
        ({"camera.shutter": [1.0, 0.0]}, "before it opens"),
        ({"camera.motion": [{"time": 0.0, "target": [0.0, 1.0, 0.0], "position": [0.0, 1.0, 0.0]}]}, "same point"),
        ({"camera.rolling_shutter": -1.0}, "rolling_shutter"),
    ],
)
def test_faults(change: dict[Any, Any], problem: str) -> None:
    with pytest.raises(SceneError, match=problem):
        clrender.load("room").changed(change)


def test_what_cannot_be_rendered(device: Device) -> None:
    with pytest.raises(SceneError, match="radiosity"):
        clrender.render(clrender.load("cornell").changed({**CORNELL}), integrator="radiosity", size=(8, 8), spp=1)
    rolling = clrender.load("room").changed({"camera.rolling_shutter": 0.5, ("shapes", 8, "motion"): [
        {"time": 0.0}, {"time": 1.0, "translate": [0.1, 0.0, 0.0]}]})  # fmt: skip
    with pytest.raises(SceneError, match="rolling_shutter"):
        clrender.render(rolling, integrator="bdpt", size=(8, 8), spp=1)


CORNELL: dict[Any, Any] = {
    "camera.shutter": [0.0, 1.0],
    ("shapes", 5, "motion"): [{"time": 0.0}, {"time": 1.0, "translate": [0.1, 0.0, 0.0]}],
}


def crowd(count: int, **camera: Any) -> Scene:
    """Instances that each go their own way, of a group of a box and a ball."""
    random = np.random.default_rng(3)
    parts: list[dict[str, Any]] = [
        {"type": "box", "size": [0.1, 0.06, 0.04]},
        {"type": "sphere", "center": [0, 0.06, 0], "radius": 0.04},
    ]
    shapes = []
    for _ in range(count):
        place, step, turn = (random.uniform(-most, most, 3) for most in (1.0, 0.1, 90.0))
        motion: list[dict[str, Any]] = [
            {"time": 0.0, "translate": place},
            {"time": 1.0, "translate": place + step, "rotate_degrees": turn},
        ]
        shapes.append({"type": "instance", "group": "one", "motion": motion})
    return Scene(
        camera=dict[str, Any](position=[0, 0.5, 4], target=[0, 0, 0], vertical_fov=35.0, **camera),
        materials={"m": {"type": "lambert", "reflectance": [0.7, 0.6, 0.5]}},
        groups={"one": {"shapes": [{**part, "material": "m"} for part in parts]}},
        shapes=shapes,
        lights=[{"type": "environment", "radiance": [1, 1, 1]}],
    )


@pytest.mark.long
def test_a_thousand_instances_are_the_mean_of_their_moments(device: Device) -> None:
    """Blocks of pixels, within five standard errors of sixteen seeds."""
    blurred, size = crowd(1000, shutter=[0.0, 1.0]), (32, 32)

    def blocks(image: npt.NDArray[np.float32]) -> npt.NDArray[np.float64]:
        means: npt.NDArray[np.float64] = image.astype(np.float64).reshape(4, 8, 4, 8, 3).mean(axis=(1, 3, 4))
        return means

    with clrender.Session(device.info.index) as session:
        made = np.stack([blocks(session.render(blurred, size=size, spp=16, seed=seed).linear) for seed in range(16)])
        moments = [crowd(1000, time=(number + 0.5) / 16) for number in range(16)]
        still = np.stack(
            [blocks(session.render(each, size=size, spp=16, seed=99 + n).linear) for n, each in enumerate(moments)]
        )
        ways: tuple[dict[str, Any], ...] = ({}, {"lanes": 1, "tile": 16}, {"kernels": "staged"})
        hashes = {session.render(blurred, size=size, spp=2, **way).stats["image_sha256"] for way in ways}
    error = np.sqrt(2.0 * made.var(axis=0, ddof=1) / 16)
    assert (np.abs(made.mean(axis=0) - still.mean(axis=0)) < 5.0 * error).all()
    assert len(hashes) == 1


def test_the_time_is_no_part_of_the_hash_of_what_rests() -> None:
    """So a frame of a scene at rest is found whatever its number; seconds of exposure do not matter either."""
    still = clrender.load("room")
    for more in ({"camera.time": 0.5}, {"camera.shutter": [0.0, 1.0]}, {"camera.rolling_shutter": 0.1}):
        assert still.changed(more).sha256() == still.sha256()
    keys = [{"time": 0.0}, {"time": 1.0, "translate": [0.1, 0.0, 0.0]}]
    moving = still.changed({"shapes[10].motion": keys})
    assert moving.changed({"camera.time": 0.5}).sha256() != moving.sha256()
    led = still.changed({"camera.motion": [{"time": 0.0}, {"time": 1.0, "position": [0.0, 0.5, -3.0]}]})
    assert led.changed({"camera.shutter": [0.0, 1.0]}).sha256() != led.sha256()
