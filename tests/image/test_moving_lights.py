"""Lights that are no surfaces and move while the shutter is open: against integrals, and the mean of their moments."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import clrender
from clrender.errors import SceneError
from clrender.flatten.flat_scene import flatten
from clrender.flatten.lamps import LAMP_KINDS
from clrender.image.files import write_image
from clrender.scene import Scene
from clrender.scene.resting import opened

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

    from clrender.device import Device

SHARE, HEIGHT = 0.6, 1.5
FLOOR: dict[str, Any] = {"type": "quad", "origin": [-50, 0, 50], "edge_u": [100, 0, 0], "edge_v": [0, 0, -100],
                         "material": "white"}  # fmt: skip
TURN: list[dict[str, Any]] = [
    {"time": 0.0},
    {"time": 1.0, "translate": [0.5, 0.3, -0.4], "rotate_degrees": [10.0, 80.0, -10.0]},
]
LAMP = """IESNA:LM-63-1995
TILT=NONE
1 -1 1 3 3 1 2 0 0 0
1 1 10
0 45 90
0 90 180
900 500 0
700 100 50
400 800 20
"""


def lit(*lights: dict[str, Any], **camera: Any) -> Scene:
    """A floor four metres by one, seen from above."""
    view = {"type": "orthographic", "position": [0, 5, 0], "target": [0, 0, 0], "up": [0, 0, -1], "height": 1.0}
    materials = {"white": {"type": "lambert", "reflectance": [SHARE] * 3}}
    return Scene(camera=view | camera, materials=materials, shapes=[FLOOR], lights=list(lights))


def test_a_lamp_that_moves_on_a_line(device: Device) -> None:
    """Irradiance below a point from x = -1 to 2: the integral of I h / d³ is I h x / (b² d), b being the least d."""
    keys = [{"time": 0.0}, {"time": 1.0, "translate": [3, 0, 0]}, {"time": 2.0}]
    lamp = {"type": "point", "position": [-1, HEIGHT, 0.2], "intensity": [7, 7, 7], "motion": keys}
    with clrender.Session(device.info.index) as session:
        settings: dict[str, Any] = {"size": (32, 8), "spp": 256, "integrator": "direct"}
        found = session.render(lit(lamp, shutter=[0.0, 1.0]), **settings).linear[..., 0]
    x, z = (np.arange(32 * 8) + 0.5) / 64 - 2.0, (np.arange(8 * 8) + 0.5) / 64 - 0.5
    beside = HEIGHT * HEIGHT + (z[:, None] - 0.2) ** 2

    def until(way: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        share: npt.NDArray[np.float64] = way / (beside * np.sqrt(way * way + beside))
        return share

    exact = SHARE / math.pi * 7.0 * HEIGHT / 3.0 * (until(2.0 - x) - until(-1.0 - x))
    means = exact.reshape(8, 8, 32, 8).mean(axis=(1, 3))
    assert np.abs(found / means - 1.0).max() < 0.02
    assert abs(float((found / means).mean()) - 1.0) < 3e-4


def test_sunlight_that_turns(device: Device) -> None:
    """From the zenith by 60 degrees: the mean cosine is that of the angles, though the middle one is at a key."""
    keys = [{"time": 0.0}, {"time": 0.5, "rotate_degrees": [0, 0, 30]}, {"time": 1.0, "rotate_degrees": [0, 0, 60]}]
    sun = {"type": "directional", "direction": [0, -2, 0], "irradiance": [3, 3, 3], "motion": keys}
    with clrender.Session(device.info.index) as session:
        settings: dict[str, Any] = {"size": (16, 4), "spp": 256, "integrator": "direct"}
        found = session.render(lit(sun, shutter=[0.0, 1.0]), **settings).linear[..., 0]
    exact = SHARE / math.pi * 3.0 * math.sin(math.pi / 3.0) / (math.pi / 3.0)
    assert np.abs(found / exact - 1.0).max() < 5e-3 and abs(float(found.mean()) / exact - 1.0) < 3e-4


def kinds(folder: Path, motion: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A light of each kind, which all move in the same way."""
    (folder / "lamp.ies").write_text(LAMP)
    write_image(folder / "slide.exr", np.random.default_rng(5).uniform(0, 2, (3, 4, 3)).astype("f4"))
    at = {"position": [0.3, 1.2, 0.4], "motion": motion}
    aimed = {**at, "direction": [0.2, -1.0, 0.1]}
    return [
        {"type": "point", "intensity": [3, 1, 1], **at},
        {"type": "spot", "intensity": [9, 9, 1], "cone_degrees": 70.0, "blend": 0.5, **aimed},
        {"type": "ies", "file": "lamp.ies", "horizontal_zero": [1.0, 0.0, 0.4], "scale": [2, 3, 2], **aimed},
        {"type": "projector", "file": "slide.exr", "vertical_fov": 50.0, "scale": [3, 3, 9], **aimed},
        {"type": "directional", "direction": [0.5, -1.0, 0.2], "irradiance": [1, 1, 1], "motion": motion},
    ]


def placed(folder: Path, motion: list[dict[str, Any]], more: int = 0, **camera: Any) -> Scene:
    """All kinds of lights, a box that throws shadows, and as many more lamps."""
    lights = kinds(folder, motion)
    random = np.random.default_rng(8)
    for _ in range(more):
        far = [*random.uniform(-1.0, 1.0, 3) + np.array([0.0, 3.0, 0.0])]
        spot = {"direction": [*random.uniform(-1.0, 1.0, 3)], "cone_degrees": float(random.uniform(5.0, 90.0))}
        lights.append({"type": "spot", "position": far, "intensity": [2, 2, 2], "motion": motion, **spot})
    scene = lit(*lights, **camera)
    box = {"type": "box", "center": [0.5, 0.2, 0.1], "size": [0.3, 0.4, 0.3], "material": "white"}
    floor = {**FLOOR, "origin": [-2, 0, 1], "edge_u": [4, 0, 0], "edge_v": [0, 0, -2]}  # sunlight falls on all of it
    return scene.changed({"shapes": [floor, box]}).placed("here", folder)


def test_a_motion_of_zero_length_changes_no_bit(tmp_path: Path) -> None:
    """The arrays are the same, and so is the program."""
    still = [placed(tmp_path, [{"time": 0.0}]), placed(tmp_path, [], shutter=[0.0, 1.0])]
    resting = [
        placed(tmp_path, [{"time": 0.0}, {"time": 1.0}], shutter=[0.0, 1.0]),
        placed(tmp_path, TURN, shutter=[-1.0, 0.0]),
        placed(tmp_path, TURN, time=-3.0),
    ]
    found = [flatten(each, 8, 8) for each in (*still, *resting)]
    assert len({(each.sha256, each.features) for each in found}) == 1
    assert flatten(placed(tmp_path, TURN, shutter=[0.0, 1.0]), 8, 8).features.moving_lights


def test_a_moment_is_the_scene_there(tmp_path: Path) -> None:
    """A light is turned and moved as a shape is, and the marks of a lamp turn with it."""
    keys: list[dict[str, Any]] = [
        {"time": 0.0},
        {"time": 1.0, "rotate_degrees": [0.0, 90.0, 0.0], "translate": [0.0, 1.0, 0.0]},
    ]
    moved: Any = opened(placed(tmp_path, keys, time=1.0)).lights
    assert moved[0].position == pytest.approx((0.4, 2.2, -0.3))
    assert moved[2].direction == pytest.approx((0.1, -1.0, -0.2))
    assert moved[2].horizontal_zero == pytest.approx((0.4, 0.0, -1.0))
    assert moved[3].up == pytest.approx((0.0, 1.0, 0.0))
    assert moved[4].direction == pytest.approx((0.2, -1.0, -0.5))
    assert not any(light.motion for light in moved)


def test_cones_of_the_light_tree_hold_all_directions_of_a_motion(tmp_path: Path) -> None:
    """And its spheres all places: else light would be lost."""
    scene = placed(tmp_path, TURN, more=20, shutter=[0.0, 1.0])
    tree = flatten(scene, 8, 8, "bvh")
    order, rows = tree.arrays["light_order"], tree.arrays["light_nodes"]
    kinds_of, cones = tree.arrays["lights"]["kind"], tree.arrays["light_cones"]
    scale = float(rows[0, 0])
    seen = 0
    for time in np.linspace(0.0, 1.0, 23):
        there: Any = opened(scene.changed({"camera.shutter": None, "camera.time": float(time)})).lights
        for place, number in enumerate(order.tolist()):
            child = len(order) + place
            node, side = divmod(child, 2)
            light = there[number]
            if tree.arrays["lights"]["place"][number] != child or light.type == "directional":
                continue
            center, radius = rows[node, 8 * side : 8 * side + 3], float(rows[node, 8 * side + 3])
            assert math.dist(center / scale, light.position) <= radius / scale * 1.0001 + 1e-6
            if light.type == "spot" and kinds_of[number] in LAMP_KINDS:
                axis, cosine = cones[node, 4 * side : 4 * side + 3], float(cones[node, 4 * side + 3])
                between = math.acos(min(float(axis @ np.array(light.direction)) / math.hypot(*light.direction), 1.0))
                reach = between + math.radians(light.cone_degrees) / 2.0
                assert reach >= math.pi or math.cos(reach) >= cosine - 1e-6
                seen += 1
    assert seen == 23 * 21


@pytest.mark.long
def test_the_bits_do_not_depend_on_how_the_work_is_done(device: Device, tmp_path: Path) -> None:
    scene = placed(tmp_path, TURN, more=20, shutter=[0.0, 1.0])
    ways: tuple[dict[str, Any], ...] = ({}, {"tile": 16}, {"lanes": 1}, {"kernels": "staged"})
    with clrender.Session(device.info.index) as session:
        images = [session.render(scene, size=(16, 8), spp=4, **way).stats["image_sha256"] for way in ways]
    assert len(set(images)) == 1


@pytest.mark.long
@pytest.mark.parametrize("integrator", ["path", "guided", "whitted", "bdpt", "photon", "reuse"])
def test_blur_is_the_mean_of_moments(device: Device, tmp_path: Path, integrator: str) -> None:
    """Blocks of pixels within five standard errors of sixteen seeds; moments of a grid are off by much less."""
    guided: dict[str, Any] = {"integrator": "path", "guiding": "on"} if integrator == "guided" else {}
    settings: dict[str, Any] = {"size": (32, 8), "spp": 32, "integrator": integrator, **guided}
    blurred = placed(tmp_path, TURN, more=20 if integrator in ("path", "guided") else 0, shutter=[0.0, 1.0])

    def blocks(image: npt.NDArray[np.float32]) -> npt.NDArray[np.float64]:
        means: npt.NDArray[np.float64] = image.astype(np.float64).reshape(2, 4, 8, 4, 3).mean(axis=(1, 3))
        return means

    with clrender.Session(device.info.index) as session:
        made = np.stack([blocks(session.render(blurred, seed=seed, **settings).linear) for seed in range(16)])
        times = [(number + 0.5) / 32 for number in range(32)]
        moments = [blurred.changed({"camera.shutter": None, "camera.time": time}) for time in times]
        still = np.stack(
            [blocks(session.render(each, seed=99 + n, **settings).linear) for n, each in enumerate(moments)]
        )
    error = np.sqrt(made.var(axis=0, ddof=1) / 16 * 2.0)
    assert (np.abs(made.mean(axis=0) - still.mean(axis=0)) < 5.0 * error + 2e-3 * still.mean(axis=0)).all()


@pytest.mark.parametrize(
    ("keys", "problem"),
    [
        ([{"time": 0.0, "scale": 2.0}], r"lights\[0\]\.motion\[0\]\.scale scales, shears or mirrors, but a light"),
        ([{"time": 0.0, "matrix": [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}], "matrix scales, shears"),
        ([{"time": 1.0}, {"time": 1.0}], "later than that of the key before"),
    ],
)
def test_faults(keys: list[dict[str, Any]], problem: str) -> None:
    with pytest.raises(SceneError, match=problem):
        lit({"type": "point", "position": [0, 1, 0], "intensity": [1, 1, 1], "motion": keys})


def test_lights_that_do_not_move_have_none(tmp_path: Path) -> None:
    around = {"type": "environment", "radiance": [1, 1, 1], "motion": [{"time": 0.0}]}
    with pytest.raises(SceneError, match="motion"):
        lit(around)


def test_programs_without_moving_lights_know_none(tmp_path: Path) -> None:
    """Nor do those of scenes without any light."""
    assert not flatten(lit(), 8, 8).features.moving_lights
    assert not flatten(placed(tmp_path, []), 8, 8).features.moving_lights


def test_radiosity_takes_none(tmp_path: Path) -> None:
    openings: dict[str, dict[str, Any]] = {
        "camera.shutter out": {"shutter": [0.0, 1.0]},
        "camera.rolling_shutter out": {"rolling_shutter": 1.0},
        "camera.shutter and camera.rolling_shutter out": {"shutter": [0.0, 0.5], "rolling_shutter": 0.5},
    }
    for cure, opening in openings.items():
        scene = placed(tmp_path, TURN, **opening)
        words = rf"lights\[0\]\.motion: the integrator radiosity takes nothing that moves .*; leave {cure}, or"
        with pytest.raises(SceneError, match=words):
            clrender.render(scene, integrator="radiosity", size=(8, 8), spp=1)
