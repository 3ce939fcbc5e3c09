"""The tree of lights: no light that shines on a point is left out, and each is chosen as often as the tree says."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from render_support import Studio, disk, down, lambert, quad, scene, sphere, triangle
from sampling_support import LightTable
from stats_support import Evidence

import clrender
from clrender import layout
from clrender.flatten.flat_scene import flatten

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

POINTS = [
    ((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    ((1.9, -0.5, 0.2), (-0.6, 0.0, 0.8)),
    ((-30.0, 8.0, 40.0), (0.0, 0.0, -1.0)),
]


def many_lights(
    infinite: bool,
    floor: dict[str, Any] | None = None,
    camera: dict[str, Any] | None = None,
    size: float = 1.0,
    bright: float = 1.0,
    points: bool = True,
) -> Scene:
    """Triangles, spheres, disks and points of all powers, any way round, some of them about each of `POINTS`."""
    rng = np.random.default_rng(45)
    shapes = [] if floor is None else [floor]
    for number in range(45):
        center, emission = size * rng.uniform(-2.0, 2.0, 3), bright * float(10.0 ** rng.uniform(-1.0, 1.0))
        if number % 3 == 0:
            shapes.append(triangle((center + size * rng.normal(0.0, 0.2, (3, 3))).tolist(), emission=emission))
        elif number % 3 == 1:
            shapes.append(sphere(center.tolist(), 0.05 * size, emission=emission))
        else:
            shapes.append(disk(center.tolist(), rng.normal(size=3).tolist(), 0.1 * size, emission=emission))
    places = [size * rng.uniform(-2.0, 2.0, 3) for _ in range(4)]
    intensity = bright * size * size
    lights: list[dict[str, Any]] = [
        {"type": "point", "position": place.tolist(), "intensity": [intensity] * 3} for place in places
    ]
    if not points:
        lights.clear()
    if infinite:
        lights.append({"type": "directional", "direction": [0.3, -1.0, 0.2], "irradiance": [0.5 * bright] * 3})
        lights.append({"type": "environment", "radiance": [0.2 * bright] * 3})
    return scene(shapes, lights, camera, white=lambert(0.7))


@pytest.mark.parametrize("infinite", [False, True], ids=["near", "near and infinitely far"])
@pytest.mark.parametrize(("origin", "normal"), POINTS)
def test_lights_are_chosen_as_the_tree_says(
    evidence: Evidence, device: Device, origin: tuple[float, ...], normal: tuple[float, ...], infinite: bool
) -> None:
    table = LightTable(device, many_lights(infinite))
    assert table.flat.light_levels > 0, "so many lights have a tree"
    chosen, likely, asked, shares = table.choose(origin, normal)
    assert np.array_equal(likely, asked), "what is found by chance is told the probability that it was chosen with"
    shares = shares.astype(np.float64)
    assert shares.sum() == pytest.approx(1.0, abs=1e-5)
    order = np.argsort(-shares)
    evidence.histogram("lights", np.bincount(chosen, minlength=len(shares))[order], shares[order] / shares.sum())
    assert (shares[shining(table, origin, normal)] > 0.0).all(), "no light that shines there is left out"
    assert shares.max() > 3.0 / len(shares), "and it does choose"


def test_small_lights_seen_edge_on_do_not_hide_their_neighbours(device: Device) -> None:
    """Of some of them the normal is longer than 1 by a rounding."""
    rng = np.random.default_rng(46)
    shapes = []
    for _ in range(64):
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        center = np.cross(normal, rng.normal(size=3))
        center *= np.copysign(10.0, center[2]) / np.linalg.norm(center)
        shapes.append(disk(center.tolist(), normal.tolist(), 1e-3, emission=1.0))
        shapes.append(disk((center * 1.001).tolist(), (-center).tolist(), 1e-3, emission=1.0))
    shares = LightTable(device, scene(shapes, [], white=lambert(0.7))).choose((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))[3]
    assert (shares[1::2] > 0.0).all()
    assert shares.astype(np.float64).sum() == pytest.approx(1.0, abs=1e-5)


def shining(table: LightTable, origin: tuple[float, ...], normal: tuple[float, ...]) -> np.ndarray[Any, Any]:
    """Triangles whose every corner is above the surface, and that show it their front."""
    arrays = table.flat.arrays
    shines = np.zeros(table.flat.light_count, bool)
    for number, light in enumerate(arrays["lights"]):
        if light["kind"] != layout.LIGHT_AREA_TRIANGLE:
            continue
        corners = arrays["vertices"][arrays["triangles"][light["primitive"]]].astype(np.float64) - np.array(origin)
        above = (corners @ np.array(normal) > 0.0).all()
        front = np.cross(corners[1] - corners[0], corners[2] - corners[0]) @ corners[0] < 0.0
        shines[number] = above and front
    assert shines.any()
    return shines


@pytest.mark.parametrize("sampling", ["mis", "light"])
def test_the_image_does_not_depend_on_how_lights_are_chosen(evidence: Evidence, studio: Studio, sampling: str) -> None:
    """Over a floor, under all that can shine."""
    floor = quad((-3.0, -2.5, 3.0), (6.0, 0.0, 0.0), (0.0, 0.0, -6.0), material="white")
    camera = {"position": [0.0, 9.0, 0.01], "target": [0.0, -2.5, 0.0], "vertical_fov": 25.0}
    what = many_lights(infinite=True, floor=floor, camera=camera)
    settings: dict[str, Any] = {"spp": 64, "max_depth": 2, "sampling": sampling}
    by_power = studio.tiles(what, range(16), light_sampler="power", **settings)
    evidence.equal("tiles", by_power, studio.tiles(what, range(100, 116), light_sampler="bvh", **settings))


def test_the_tree_holds_every_light_once() -> None:
    flat = flatten(many_lights(infinite=True), 16, 16)
    rows, order = flat.arrays["light_nodes"], flat.arrays["light_order"]
    places = flat.arrays["lights"]["place"]
    assert len(rows) == len(order) == 1 << flat.light_levels
    assert np.array_equal(order[places - len(order)], np.arange(flat.light_count))
    powers = rows.reshape(-1, 8)[:, 7].astype(np.float64)
    assert np.count_nonzero(powers[len(order) :]) == flat.light_count
    # Two children have shares of what is theirs: bring them all to the scale of the root
    absolute = np.zeros_like(powers)
    absolute[1] = 1.0
    for node in range(1, len(order)):
        shares = powers[2 * node : 2 * node + 2]
        if not shares.any():
            continue
        assert shares.sum() == pytest.approx(1.0, abs=1e-6)
        absolute[2 * node : 2 * node + 2] = absolute[node] * shares
    emitted = flat.arrays["lights"]["probability"].astype(np.float64)
    near = np.flatnonzero(flat.arrays["lights"]["primitive"] != layout.NONE)
    found = absolute[places[near]] / emitted[near]
    assert found == pytest.approx(np.full(len(near), found[0]), rel=1e-5), "in proportion to their power"


def lamp_beside_a_far_one(others: int) -> Scene:
    """A floor beside a shining box, and a point light of 1e-4 W/sr 40 m away; and as many such lights above."""
    floor = quad((-1.0, 0.0, 1.0), (2.0, 0.0, 0.0), (0.0, 0.0, -2.0), material="white")
    box = {"type": "box", "center": [1.15, 0.3, 0.0], "size": [0.2, 0.6, 2.0], "emission": [1.0] * 3}
    rng = np.random.default_rng(51)
    lights: list[dict[str, Any]] = [{"type": "point", "position": [-40.0, 3.0, 9.0], "intensity": [1e-4] * 3}]
    for x, z in rng.uniform(-1.0, 1.0, (others, 2)).tolist():
        lights.append({"type": "point", "position": [x, 3.0, z], "intensity": [1e-4] * 3})
    return scene([floor, box], lights, {**down(height=2.0), "vertical_fov": 50.0}, white=lambert(0.7))


@pytest.mark.parametrize("others", [0, 3], ids=["a place to spare", "as many as places"])
def test_a_lamp_beside_the_point_is_found_though_another_is_far_away(
    evidence: Evidence, studio: Studio, device: Device, others: int
) -> None:
    """Its branch of the tree may span them both, which tells little about either: its power still counts."""
    what = lamp_beside_a_far_one(others)
    table = LightTable(device, what)
    power = table.flat.arrays["lights"]["probability"][: table.flat.light_count].astype(np.float64)
    beside = np.flatnonzero((power > 0.5 * power.max()) & (table.choose((0.9, 0.0, 0.0), (0.0, 1.0, 0.0))[3] > 0.0))
    shares = table.choose((0.9, 0.0, 0.0), (0.0, 1.0, 0.0))[3].astype(np.float64)
    assert len(beside) and (shares[beside] >= power[beside] / 16.5).all()
    settings: dict[str, Any] = {"spp": 64, "max_depth": 2}
    sure = studio.tiles(what, range(16), light_sampler="power", **settings)
    evidence.equal("light", sure, studio.tiles(what, range(40, 56), light_sampler="bvh", sampling="light", **settings))


@pytest.mark.parametrize(("size", "bright"), [(27, 33), (-13, 0), (-23, -39)])
def test_the_tree_does_not_depend_on_the_scale(device: Device, size: int, bright: int) -> None:
    """From a cosmic scene to a microscopic one that hardly shines, by powers of two: the same bits."""
    points = size < 0  # no intensity of a point may be that large
    scaled = LightTable(device, many_lights(True, None, down_by(2.0**size), 2.0**size, 2.0**bright, points))
    usual = LightTable(device, many_lights(True, points=points))
    for origin, normal in POINTS:
        there = tuple(2.0**size * x for x in origin)
        for here, alike in zip(usual.choose(origin, normal), scaled.choose(there, normal), strict=True):
            assert np.array_equal(np.asarray(here), np.asarray(alike)), origin


def down_by(size: float) -> dict[str, Any]:
    """The usual camera in a scene of another size."""
    return {**down(height=0.25 * size), "vertical_fov": 90.0}


@pytest.mark.parametrize("choice", ["power", "uniform"])
def test_there_is_no_tree_where_none_is_wanted(choice: str) -> None:
    flat = flatten(many_lights(infinite=False), 16, 16, choice)
    assert flat.light_levels == 0 and (flat.arrays["lights"]["place"] == layout.NONE).all()


@pytest.mark.parametrize(("count", "tree"), [(4, False), (5, True)])
def test_a_few_lights_have_a_tree_unless_told_otherwise(count: int, tree: bool) -> None:
    lamps = [{"type": "point", "position": [float(i), 1.0, 0.0], "intensity": 1.0} for i in range(count)]
    scene = clrender.Scene(camera={"position": [0.0, 0.0, 1.0], "target": [0.0] * 3}, shapes=[], lights=lamps)
    assert (flatten(scene, 16, 16).light_levels > 0) is tree


@pytest.mark.parametrize("choice", ["uniform", "power", "bvh"])
def test_the_point_on_a_light_has_all_its_digits(evidence: Evidence, device: Device, choice: str) -> None:
    """Choosing one of 4096 takes 12 binary digits of a random number; the last of the 24 are as random as ever.

    Those that are left of a walk down the tree are rounded: the last four of twenty are looked at.
    """
    rng = np.random.default_rng(47)
    lights = [
        {"type": "point", "position": rng.uniform(0.5, 2.0, 3).tolist(), "intensity": [float(power)] * 3}
        for power in rng.uniform(0.5, 2.0, 4096)
    ]
    chosen, left = LightTable(device, scene([], lights), choice).places((0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    count = 20 if choice == "bvh" else 24
    digits = (left * 2.0**count).astype(np.int64)
    for axis in range(2):
        evidence.histogram(f"last digits {axis}", np.bincount(digits[axis] % 16, minlength=16), np.full(16, 1 / 16))
        evidence.histogram(
            f"first digits {axis}", np.bincount(digits[axis] >> (count - 4), minlength=16), np.full(16, 1 / 16)
        )
    half = np.bincount(chosen % 2 * 2 + (left[0] < 0.5), minlength=4)
    evidence.share("independent of the light", int(half[0] + half[3]), len(chosen), 0.5)


def test_the_alias_of_many_lights_has_all_its_digits(evidence: Evidence, device: Device) -> None:
    """One of 4096 lights is as bright as the others and two more: each of their entries belongs to it by half.

    The number that decides between an entry and its alias is independent of the one that picks the point on the light.
    """
    count = 4096
    powers = [1.0] * (count - 1) + [count + 1.0]
    lights = [{"type": "point", "position": [0.0, 1.0, 0.0], "intensity": [power] * 3} for power in powers]
    table = LightTable(device, scene([], lights), "power")
    assert (table.flat.arrays["lights"]["alias_threshold"][:-1] == 0.5).all()
    chosen, left = table.places((0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    bright = chosen == count - 1
    evidence.share("bright", int(bright.sum()), len(chosen), (count + 1) / (2 * count))
    digits = (left[0, bright] * 2.0**24).astype(np.int64)
    evidence.histogram("last digits", np.bincount(digits % 16, minlength=16), np.full(16, 1 / 16))
    evidence.histogram("first digits", np.bincount(digits >> 20, minlength=16), np.full(16, 1 / 16))


def test_a_walk_down_the_tree_uses_up_no_digits(evidence: Evidence, device: Device) -> None:
    """Two points on the same light have the first twenty digits in common as seldom as two random numbers have.

    A walk to one of 4096 lights takes twelve of the twenty-four digits that it begins with: of what is left every
    number would come up 4096 times too often.
    """
    rng = np.random.default_rng(49)
    places = rng.uniform(0.5, 2.0, (4096, 3)).tolist()
    lights = [{"type": "point", "position": place, "intensity": [1.0] * 3} for place in places]
    chosen, left = LightTable(device, scene([], lights), "bvh").places((0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    digits = (left[0] * 2.0**20).astype(np.int64)
    alike = np.unique(chosen.astype(np.int64) << 20 | digits, return_counts=True)[1]
    same_light = np.bincount(chosen)
    pairs = int((same_light * (same_light - 1) // 2).sum())
    evidence.share("pairs", int((alike * (alike - 1) // 2).sum()), pairs, 2.0**-20)


def test_light_from_behind_counts_where_it_is_scattered_too(device: Device) -> None:
    """A surface that transmits is told by a normal of zero: then each light has a twin on the other side as likely."""
    rng = np.random.default_rng(48)
    lights = []
    for _ in range(16):
        x, y, z = rng.uniform(0.5, 2.0, 3).tolist()
        for side in (z, -z):
            lights.append({"type": "point", "position": [x, y, side], "intensity": [1.0] * 3})
    table = LightTable(device, scene([], lights), "bvh")
    _, likely, asked, shares = table.choose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert np.array_equal(likely, asked)
    assert shares.astype(np.float64).sum() == pytest.approx(1.0, abs=1e-5)
    np.testing.assert_allclose(shares[::2].sum(), shares[1::2].sum(), rtol=0.05)
    assert shares.min() > 0.005, "none is left out"
    one_sided = table.choose((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))[3]
    assert (one_sided[1::2] == 0.0).all(), "an opaque surface has no use for those behind it"


@pytest.mark.parametrize("kind", ["sphere", "point"])
def test_what_shines_all_around_counts_as_much_as_a_disk_that_faces_the_point(device: Device, kind: str) -> None:
    """A small sphere sends to a far point what a disk of its size does that is turned to it, and a point may, too."""
    rng = np.random.default_rng(50)
    shapes: list[dict[str, Any]] = []
    lights: list[dict[str, Any]] = []
    for x, y, z in rng.uniform([3.0, 3.0, -0.5], [4.0, 4.0, 0.5], (16, 3)).tolist():
        shapes.append(disk([x, y, z], [-x, -y, -z], 0.01, emission=1.0))
        if kind == "sphere":
            shapes.append(sphere([-x, y, z], 0.01, emission=1.0))
        else:
            lights.append({"type": "point", "position": [-x, y, z], "intensity": [1e-4 * np.pi] * 3})
    table = LightTable(device, scene(shapes, lights))
    shares = table.choose((0.0, 0.0, 0.0), (0.0, 1.0, 0.0))[3].astype(np.float64)
    flat = table.flat.arrays["lights"]["kind"][: len(shares)] == layout.LIGHT_AREA_DISK
    assert flat.sum() == 16
    # Not exactly: what the tree knows of a group are means
    assert shares[~flat].sum() == pytest.approx(0.5, abs=0.05)
