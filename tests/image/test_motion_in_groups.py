"""Shapes that move, or change their form, within groups that are placed anywhere and move, too."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import clrender
from clrender.errors import SceneError
from clrender.flatten.assembly import assemble
from clrender.flatten.flat_scene import flatten
from clrender.scene import Scene
from clrender.scene.motion import Track, matrices_of
from clrender.scene.resting import opened
from clrender.scene.transforms import affine

if TYPE_CHECKING:
    import numpy.typing as npt

    from clrender.device import Device
    from clrender.flatten.motion import Knots

BOX: dict[str, Any] = {"type": "box", "size": [0.5, 0.4, 0.1], "material": "grey"}
ROLLS: list[dict[str, Any]] = [
    {"time": 0.0, "translate": [-0.4, 0.0, 0.0]},
    {"time": 1.0, "translate": [-0.3, 0.2, 0.0], "rotate_degrees": [0.0, 0.0, 200.0]},
]
WHEEL = {**BOX, "motion": ROLLS}
LAMP = {"type": "disk", "center": [0.0, 0.5, 0.3], "normal": [0.0, 0.0, 1.0], "radius": 0.1, "emission": [9, 8, 7],
        "motion": [{"time": 0.0}, {"time": 1.0, "translate": [0.4, 0.0, 0.1]}]}  # fmt: skip
FLAG = {"type": "mesh", "vertices": [[0, 0, 0], [0.4, 0, 0], [0, 0.4, 0]], "faces": [[0, 1, 2]], "material": "grey",
        "poses": [{"time": 0.0, "vertices": [[0, 0, 0.2], [0.4, 0, 0.2], [0, 0.4, 0.2]]},
                  {"time": 1.0, "vertices": [[0, 0.5, 0.2], [0.6, 0, 0.2], [0, 0.3, 0.4]]}]}  # fmt: skip
SHEAR = [[0.9, 0.3, 0.0, 0.4], [0.0, 1.1, 0.2, -0.3], [0.1, 0.0, -0.8, 0.1], [0.0, 0.0, 0.0, 1.0]]
DRIVES = [{"time": 0.0}, {"time": 0.7, "translate": [0.3, 0.1, 0.0], "rotate_degrees": [10.0, 70.0, 0.0]}]


def scene(instances: list[dict[str, Any]], *parts: dict[str, Any], **camera: Any) -> Scene:
    return Scene(
        camera={"position": [0, 0.5, 4], "target": [0, 0, 0], **camera},
        materials={"grey": {"type": "lambert", "reflectance": [0.6] * 3}},
        groups={"car": {"shapes": [*parts, {**BOX, "center": [0.4, -0.3, 0.0]}]}},
        shapes=[{"type": "instance", "group": "car", **each} for each in instances],
        lights=[{"type": "environment", "radiance": [1, 1, 1]}],
    )


def taken(knots: Knots, share: float, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Where kernels take (n, 3) points at a time, without roundings."""
    after = int(np.clip(np.searchsorted(knots.shares, share, side="right"), 1, len(knots.shares) - 1))
    begin, end = knots.shares[after - 1], knots.shares[after]
    f = (share - begin) / (end - begin)
    turn, stretch, offset = (
        (1.0 - f) * each[after - 1] + f * each[after] for each in (knots.rotations, knots.stretches, knots.offsets)
    )
    linear = matrices_of(turn / np.sqrt((turn * turn).sum())) @ stretch
    moved: npt.NDArray[np.float64] = points @ knots.before[0, :, :3].T @ linear.T + offset
    return moved


@pytest.mark.parametrize(
    ("place", "drives", "most"),
    [
        ({"translate": [0.3, 9.0, 0.1], "rotate_degrees": [10.0, 50.0, -70.0], "scale": -1.5}, False, 4e-6),
        ({"matrix": SHEAR}, False, 2e-5),
        ({"translate": [0.3, 2.0, 0.1], "scale": [1.0, -1.0, 1.0]}, True, 1e-4),
    ],
    ids=["similar", "sheared", "moving"],
)
def test_ways_are_those_of_both_motions(place: dict[str, Any], drives: bool, most: float) -> None:
    """Whole numbers of degrees apart, interpolation is off by 3e-6 of a turn; arcs by 1e-5 of their radius."""
    placed = scene([{"transform": place, **({"motion": DRIVES} if drives else {})}], WHEEL, shutter=[0.0, 1.0])
    assembly = assemble(placed)
    knots = assembly.motions[0]
    points = np.random.default_rng(3).uniform(-0.5, 0.5, (20, 3))
    own, outer = Track(placed.groups["car"].shapes[0].motion), affine(placed.shapes[0].transform)
    for time in np.linspace(0.0, 1.0, 37):
        path = own.at(np.array([time]))
        there = points @ path.linear[0].T + path.offsets[0]
        there = there @ np.array(outer.linear).T + np.array(outer.offset)
        if drives:
            path = Track(placed.shapes[0].motion).at(np.array([time]))
            there = there @ path.linear[0].T + path.offsets[0]
        assert np.abs(taken(knots, float(time), points) - there).max() < most


def test_where_a_group_is_moved_its_shapes_have_other_keys() -> None:
    """To the last bit: those that say where it is moved to."""
    by = [0.25, -0.5, 0.125]
    keys = [{**key, "translate": [a + b for a, b in zip(key["translate"], by, strict=True)]} for key in ROLLS]
    grouped = scene([{"transform": {"translate": by}}], WHEEL, shutter=[0.0, 1.0])
    alone = grouped.changed({"groups": {}, "shapes": [{**WHEEL, "motion": keys}]})
    first, second = (assemble(each).motions[0] for each in (grouped, alone))
    assert np.array_equal(first.rotations, second.rotations) and np.array_equal(first.stretches, second.stretches)
    np.testing.assert_allclose(first.offsets, second.offsets, rtol=0.0, atol=1e-15)


def test_what_rests_in_a_group_is_where_it_is_then() -> None:
    """The arrays are those of a group without keys, in which it is there."""
    there = {"translate": [-0.4, 0.0, 0.0]}
    still = scene([{}, {"transform": {"translate": [0, 1, 0]}}], {**BOX, "transform": there}, shutter=[0.0, 1.0])
    for camera in ({"shutter": [-2.0, -1.0]}, {"time": -1.0}, {"time": 0.0}):
        resting = scene([{}, {"transform": {"translate": [0, 1, 0]}}], WHEEL, **camera)
        assert flatten(resting, 8, 8).sha256 == flatten(still, 8, 8).sha256
    moment = opened(scene([{}], FLAG, time=1.0)).groups["car"].shapes[0]
    assert moment.type == "mesh" and moment.vertices[0] == (0.0, 0.5, 0.2) and not moment.poses


def test_geometry_is_shared_by_all_places() -> None:
    """But of lamps, each of which is a light."""
    places = [{"transform": {"translate": [x, 0.0, 0.0], "scale": sign}} for x in range(5) for sign in (1.0, -1.0)]
    flat = flatten(scene(places, WHEEL, FLAG, LAMP, shutter=[0.0, 1.0]), 8, 8)
    # The body, the flag, the wheel and its mirror image; and ten lamps
    assert len(flat.instances.groups) == 4 + 10 and flat.instances.count == 4 * 10
    assert flat.light_count == 10 + 1 and (flat.instances.motion_of >= 0).sum() == 30


def test_numbers_of_instances_are_those_of_their_places() -> None:
    """Labels tell places apart and not the parts that move in them."""
    places = [{"transform": {"translate": [x, 0.0, 0.0]}} for x in (-1.0, 1.0)]
    assembly = assemble(scene([{}, {"transforms": [SHEAR, SHEAR]}, *places], WHEEL, FLAG, shutter=[0.0, 1.0]))
    found = Counter(map(tuple, assembly.placed.tolist()))
    assert found == {(0, 0): 3, (1, 0): 3, (1, 1): 3, (2, 0): 3, (3, 0): 3}  # body, wheel and flag
    assert set(assembly.seen_place.tolist()) == {0, 1, 2, 3}


@pytest.mark.long
@pytest.mark.parametrize("integrator", ["path", "bdpt"])
def test_blur_is_the_mean_of_moments(device: Device, integrator: str) -> None:
    """Blocks of pixels, within five standard errors of twelve seeds, and what 32 moments miss of edges."""
    places: list[dict[str, Any]] = [
        {"transforms": [[[1, 0, 0, -0.8], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], SHEAR]},
        {"transform": {"translate": [0.0, -0.7, 0.0], "scale": [-1.0, 1.0, 1.0]}, "motion": DRIVES},
    ]
    plate = {"type": "box", "center": [0.0, 0.5, 0.3], "size": [0.2, 0.2, 0.01], "emission": [3, 2, 1]}
    parts = (WHEEL, FLAG, {**plate, "motion": LAMP["motion"]})
    settings: dict[str, Any] = {"size": (32, 24), "spp": 32, "integrator": integrator}

    def blocks(image: npt.NDArray[np.float32]) -> npt.NDArray[np.float64]:
        means: npt.NDArray[np.float64] = image.astype(np.float64).reshape(6, 4, 8, 4, 3).mean(axis=(1, 3))
        return means

    with clrender.Session(device.info.index) as session:
        blurred = scene(places, *parts, shutter=[0.0, 1.0])
        made = np.stack([blocks(session.render(blurred, seed=seed, **settings).linear) for seed in range(12)])
        moments = [scene(places, *parts, time=(n + 0.5) / 32) for n in range(32)]
        still = np.stack(
            [blocks(session.render(each, seed=99 + n, **settings).linear) for n, each in enumerate(moments)]
        )
        ways: tuple[dict[str, Any], ...] = ({}, {"lanes": 1, "tile": 16})
        hashes = {session.render(blurred, **{**settings, "spp": 2}, **way).stats["image_sha256"] for way in ways}
    error = np.sqrt(made.var(axis=0, ddof=1) * 2.0 / 12.0)
    assert (np.abs(made.mean(axis=0) - still.mean(axis=0)) < 5.0 * error + 4e-3).all()
    assert len(hashes) == 1


def test_grids_stay_where_nothing_moves() -> None:
    smoke = {"type": "box", "size": [0.2] * 3, "interior": "smoke", "motion": DRIVES}
    content = {
        "camera": {"position": [0, 0, 4], "target": [0, 0, 0], "shutter": [0.0, 1.0]},
        "media": {"smoke": {"scattering": 1.0, "density": {"file": "smoke.npy"}}},
        "groups": {"car": {"shapes": [smoke]}},
        "shapes": [{"type": "instance", "group": "car"}],
    }
    with pytest.raises(
        SceneError, match=r'groups.car.shapes\[0\].motion is of a shape with the medium "smoke", which has a grid'
    ):
        assemble(Scene(**content))
