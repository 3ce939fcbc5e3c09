"""Things that touch, and things closely behind others: what is hidden sends no light, what is not hidden does."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from render_support import Studio, disk, lambert, quad, room, scene, sphere

import clrender
from clrender.scene.shapes import Transform
from clrender.scene.transforms import affine, combined

if TYPE_CHECKING:
    from stats_support import Evidence

    from clrender.device import Device
    from clrender.scene import Scene

WAYS: dict[str, dict[str, Any]] = {
    "path": {},
    "light": {"sampling": "light"},
    "bsdf": {"sampling": "bsdf"},
    "reuse": {"integrator": "reuse"},
    "direct": {"integrator": "direct"},
    "whitted": {"integrator": "whitted"},
    "photon": {"integrator": "photon", "photons": 8192, "spp": 2},
    "bdpt": {"integrator": "bdpt"},
}
WITHIN = {"position": [0.0, 0.0, -1.8], "target": [0.0, 0.6, 0.0], "vertical_fov": 70.0}


def above_a_ceiling(gap: float, size: float = 1.0, place: float = 0.0) -> Scene:
    """A dark room: a lamp shines down on the upper side of its ceiling. Lengths in units of `size`."""

    def at(*vector: float) -> list[float]:
        return [size * (x + place) for x in vector]

    walls = {"type": "box", "center": at(0, 0, 0), "size": [4 * size] * 3, "flip_normals": True, "material": "white"}
    lamp = quad(at(-0.5, 2 + gap, -0.5), (size, 0, 0), (0, 0, size), emission=15.0)
    camera = {"position": at(0.0, 0.0, -1.8), "target": at(0.0, 0.6, 0.0), "vertical_fov": 70.0}
    return scene([walls, lamp], camera=camera, white=lambert(0.7))


@pytest.mark.parametrize("way", WAYS)
def test_a_lamp_closely_behind_a_ceiling_is_hidden(studio: Studio, way: str) -> None:
    hidden = {
        "by a hundredth of a millimetre": above_a_ceiling(1e-5),
        "by a millimetre": above_a_ceiling(1e-3),
        "in a room of a kilometre": above_a_ceiling(1e-5, 250.0),
        "in a room of a millimetre": above_a_ceiling(1e-5, 2.5e-4),
        "far from the origin": above_a_ceiling(1e-3, place=1e4),
    }
    for name, what in hidden.items():
        picture = studio.image(what, 24, **{"spp": 16, **WAYS[way]})
        assert picture.max() == 0.0, f"{name}: {np.count_nonzero(picture.max(axis=2))} pixels are lit"


@pytest.mark.parametrize("what", ["lamp", "shade"])
def test_photons_behind_a_ceiling_stay_there(studio: Studio, what: str) -> None:
    """Neither photons on the lamp nor those on a white sheet that faces the ceiling's upper side count below it."""
    above = {
        "lamp": [sphere((0, 2.101, 0), 0.1, emission=15.0)],
        "shade": [
            quad((-1, 2.002, -1), (2, 0, 0), (0, 0, 2), material="white"),
            quad((-1, 2.0005, -1.1), (2, 0, 0), (0, 0.001, 0), emission=100.0),
        ],
    }
    dark = scene([room([4.0] * 3, material="white"), *above[what]], camera=WITHIN, white=lambert(0.7))
    picture = studio.image(dark, 32, integrator="photon", photons=32768, spp=4)
    assert picture.max() == 0.0


def a_lamp_of_many_triangles(distance: float, size: float, turn: float) -> Scene:
    """A surface that sees all of a flat lamp of 50 triangles in one plane, tilted so that no coordinate is alike."""
    across = np.array([math.cos(turn), 0.3 * math.sin(turn), math.sin(turn)])
    down = np.array([0.2, -1.0, 0.3])
    along = np.cross(down, across)
    across = np.cross(along, down)
    across, along = (size * v / np.sqrt((v * v).sum()) for v in (across, along))
    center = np.array([0.13, 1.0, -0.21]) * distance
    steps = np.linspace(-0.5, 0.5, 6)
    vertices = [(center + x * across + y * along).tolist() for y in steps for x in steps]
    faces = [face for i in range(5) for j in range(5) for face in _two(6 * i + j)]
    lamp = {"type": "mesh", "vertices": vertices, "faces": faces, "emission": [1.0, 1.0, 1.0]}
    floor = quad((-1, 0, 1), (2, 0, 0), (0, 0, -2), material="white")
    return scene([floor, lamp], white=lambert(0.7))


def _two(a: int) -> list[list[int]]:
    """The square from this corner on, as triangles that face down."""
    return [[a, a + 1, a + 7], [a, a + 7, a + 6]]


def test_no_lamp_shades_itself(studio: Studio) -> None:
    """Every sample of light arrives: the triangles beside the one that is sampled are in no way."""
    for distance in (0.3, 3.0, 1000.0):
        for size in (0.01 * distance, distance):
            for turn in (0.1, 1.3):
                what = a_lamp_of_many_triangles(distance, size, turn)
                picture = studio.image(what, 40, integrator="direct", sampling="light", spp=1)
                assert picture.min() > 0.0, (
                    f"{distance} m, {size} m: {np.count_nonzero(picture[..., 0] == 0.0)} samples lost"
                )


def under_a_lamp(gap: float, **lamp: Any) -> Scene:
    """A room with a lamp so far below its ceiling."""
    shapes = [room([4.0] * 3, material="white"), {**quad((-0.5, 2.0 - gap, -0.5), (1, 0, 0), (0, 0, 1)), **lamp}]
    return scene(shapes, camera=WITHIN, white=lambert(0.7))


@pytest.mark.long
@pytest.mark.parametrize("way", WAYS)
def test_a_lamp_in_the_plane_of_a_ceiling_shines(evidence: Evidence, studio: Studio, way: str) -> None:
    """As brightly as a millimetre below it, whose light is that of one in the plane but for less than 1e-3."""
    settings: dict[str, Any] = {"size": 24, "tiles": 2, "spp": 16, **WAYS[way]}
    clear = studio.tiles(under_a_lamp(1e-3, emission=[15.0] * 3), range(16), **settings)
    flush = studio.tiles(under_a_lamp(0.0, emission=[15.0] * 3), range(16, 32), **settings)
    evidence.equal("tiles", flush, clear, rounding=2e-3)


def lamp_shape(name: str) -> dict[str, Any]:
    shapes = {
        "quad": quad((-0.5, 2.0, -0.5), (1, 0, 0), (0, 0, 1)),
        "disk": disk((0.0, 2.0, 0.0), (0, -1, 0), 0.5),
        "box in the ceiling": {"type": "box", "center": [0, 2.1, 0], "size": [1, 0.2, 1]},
        "mesh": {
            "type": "mesh",
            "vertices": [[-0.5, 2, -0.5], [0.5, 2, -0.5], [0, 2, 0.5]],
            "faces": [[0, 1, 2]],
        },
    }
    return {**shapes[name], "emission": [1.0, 1.0, 1.0]}


@pytest.mark.parametrize("name", ["quad", "disk", "box in the ceiling", "mesh"])
@pytest.mark.parametrize("first", [False, True])
def test_a_lamp_in_the_plane_of_a_ceiling_is_seen(studio: Studio, name: str, first: bool) -> None:
    """Whichever comes first in the file; and turned, and far from the origin, where coordinates are rounded."""
    for turn, place in (([0, 0, 0], 0.0), ([10, 20, 30], 0.0), ([10, 20, 30], 1e4)):
        where = {"rotate_degrees": turn, "translate": [place] * 3}
        shapes = [{**room([4.0] * 3, material="black"), "transform": where}, {**lamp_shape(name), "transform": where}]
        carried = affine(Transform(rotate_degrees=tuple(turn), translate=(place,) * 3)).point
        camera = {"position": carried((0.0, 0.5, 0.0)), "target": carried((0.0, 2.0, 0.0)), "vertical_fov": 10.0}
        camera["up"] = list(np.subtract(carried((0.0, 0.0, 1.0)), carried((0.0, 0.0, 0.0))))
        picture = studio.image(scene(shapes[::-1] if first else shapes, camera=camera, black=lambert(0.0)), 24, spp=4)
        assert (picture == 1.0).all(), f"{turn}, {place}: {np.count_nonzero(picture.max(axis=2) != 1.0)} pixels miss it"


def test_a_lamp_that_stands_on_a_floor_does_not_shine_below(studio: Studio) -> None:
    floor = quad((-50, 0, 50), (100, 0, 0), (0, 0, -100), material="white")
    lamp = {"type": "box", "center": [0, 0.5, 0], "size": [1, 1, 1], "emission": [5.0] * 3}
    below = quad((-2, -1, 2), (4, 0, 0), (0, 0, -4), material="white")
    camera = {"position": [0, -0.4, 0.3], "target": [0.1, -1.0, 0], "vertical_fov": 60.0}
    dark = scene([floor, lamp, below], camera=camera, white=lambert(0.8))
    for way in ("light", "bsdf"):
        assert studio.image(dark, 24, spp=16, integrator="direct", sampling=way).max() == 0.0


GLASS = {"type": "dielectric", "ior": 1.5}


def on_a_floor(turn: list[float], place: float, size: float, floor: str) -> Scene:
    """A cube of glass exactly on a white floor, and below it a bright green panel: red and green tell them apart."""

    def moved(shape: dict[str, Any], about: float = 0.0) -> dict[str, Any]:
        # The turn about the floor's normal comes first
        outer = affine(Transform(rotate_degrees=tuple(turn), translate=(place,) * 3, scale=(size,) * 3))
        inner = affine(Transform(rotate_degrees=(0.0, about, 0.0)))
        both = combined(outer, inner)
        rows = [[*row, offset] for row, offset in zip(both.linear, both.offset, strict=True)]
        return {**shape, "transform": {"matrix": [*rows, [0, 0, 0, 1]]}}

    floors = {
        "quad": quad((-6, 0, 6), (12, 0, 0), (0, 0, -12), material="white"),
        "disk": disk((0, 0, 0), (0, 1, 0), 8.0, material="white"),
        "box": {"type": "box", "center": [0, -0.1, 0], "size": [12, 0.2, 12], "material": "white"},
        "mesh": {
            "type": "mesh",
            "vertices": [[-6, 0, 6], [6, 0, 5], [5, 0, -6], [-6, 0, -6], [0.1, 0, 0.2]],
            "faces": [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]],
            "material": "white",
        },
    }
    lamp = quad((-2, 4, -2), (4, 0, 0), (0, 0, 4), emission=5.0)
    panel = quad((-6, -0.5, 6), (12, 0, 0), (0, 0, -12), emission=[0.0, 50.0, 0.0])
    cube = {"type": "box", "center": [0, 0.5, 0], "size": [1, 1, 1], "material": "glass"}
    carried = affine(Transform(rotate_degrees=tuple(turn), translate=(place,) * 3, scale=(size,) * 3)).point
    camera: dict[str, Any] = {"position": carried((0, 2.5, 5)), "target": carried((0, 0.4, 0)), "vertical_fov": 20.0}
    camera["up"] = list(np.subtract(carried((0, 1, 0)), carried((0, 0, 0))))
    shapes = [moved(floors[floor]), moved(cube, 30.0), moved(lamp), moved(panel)]
    return scene(shapes, camera=camera, white=lambert(0.7), glass=GLASS)


@pytest.mark.parametrize("floor", ["quad", "disk", "box", "mesh"])
def test_glass_on_a_floor_shows_the_floor(studio: Studio, floor: str) -> None:
    for turn, place, size in (
        ([0.0, 0.0, 0.0], 0.0, 1.0),
        ([10.0, 20.0, 30.0], 0.0, 1.0),
        ([10.0, 20.0, 30.0], 1e4, 1.0),
        ([10.0, 20.0, 30.0], 3.0, 1e-4),
        ([10.0, 20.0, 30.0], 3.0, 1e6),
    ):
        picture = studio.image(on_a_floor(turn, place, size, floor), 32, spp=16)
        green = np.count_nonzero(picture[..., 1] != picture[..., 0])
        assert green == 0, f"{turn}, {place}, {size}: {green} pixels show what is below the floor"


@pytest.mark.long
@pytest.mark.parametrize("what", ["glass", "floor", "both", "mirrored"])
def test_instances_of_glass_on_a_floor_show_the_floor(studio: Studio, what: str) -> None:
    """As above, with the cube, the floor or both in instances of a group in another place, size and orientation."""
    across = {"rotate_degrees": [12.0, 34.0, 56.0], "translate": [7.0, -8.0, 9.0], "scale": [0.3, 0.3, 0.3]}
    inner = affine(Transform(**across))
    lines = np.array(inner.linear) * 1.0
    inverse = np.linalg.inv(lines)
    away = -inverse @ np.array(inner.offset)
    flip = np.diag([-1.0, 1.0, 1.0]) if what == "mirrored" else np.eye(3)
    plain = on_a_floor([10.0, 20.0, 30.0], 2.0, 1.0, "quad").model_dump(exclude_unset=True)
    groups: dict[str, Any] = {}
    shapes = list(plain["shapes"])
    for index in {"glass": [1], "floor": [0], "both": [0, 1], "mirrored": [0, 1]}[what]:
        own = np.array(shapes[index].pop("transform")["matrix"])
        own[:3] = flip @ own[:3]
        back = np.concatenate([(inverse @ own[:3, :3]), (inverse @ own[:3, 3] + away)[:, None]], axis=1)
        to_world = np.concatenate([flip @ lines, (flip @ np.array(inner.offset))[:, None]], axis=1)
        place, name = ({"matrix": [*rows.tolist(), [0, 0, 0, 1]]} for rows in (back, to_world)), f"g{index}"
        within, outside = place
        groups[name] = {"shapes": [{**shapes[index], "transform": within}]}
        shapes[index] = {"type": "instance", "group": name, "transform": outside}
    picture = studio.image(clrender.Scene(**{**plain, "shapes": shapes, "groups": groups}), 32, spp=16)
    assert picture.mean() > 0.1
    green = np.count_nonzero(picture[..., 1] != picture[..., 0])
    assert green == 0, f"{green} pixels show what is below the floor"


def test_a_floor_below_glass_looks_the_same_from_below(studio: Studio) -> None:
    """No film of glass is on the other side of a sheet that glass stands on."""
    floor = quad((-2, 0, 2), (4, 0, 0), (0, 0, -4), material="white")
    cube = {"type": "box", "center": [0, 0.5, 0], "size": [1, 1, 1], "material": "glass"}
    camera = {"position": [0.3, -2.0, 0.2], "target": [0, 0, 0], "vertical_fov": 60.0}
    lights = [{"type": "point", "position": [1.0, -1.5, 0.5], "intensity": [1.0, 1.0, 1.0]}]
    pictures = [
        studio.image(scene(shapes, lights, camera, white=lambert(0.7), glass=GLASS), 32, spp=4, integrator="direct")
        for shapes in ([floor, cube], [floor])
    ]
    np.testing.assert_allclose(pictures[0], pictures[1], rtol=1e-4)


@pytest.mark.parametrize("turn", [[0, 0, 0], [10, 20, 30]], ids=str)
def test_a_label_on_glass_is_seen_from_both_sides(studio: Studio, turn: list[float]) -> None:
    """It shines with 1, whoever looks: nothing reflects before it from outside, and from inside it is in the glass."""
    where = {"rotate_degrees": turn}
    pane = {"type": "box", "size": [4, 4, 1], "material": "glass", "transform": where}
    label = [
        {**quad((-2, -2, 0.5), (4, 0, 0), (0, 4, 0), emission=1.0), "transform": where},
        {**quad((-2, -2, 0.5), (0, 4, 0), (4, 0, 0), emission=1.0), "transform": where},
    ]
    turned = affine(Transform(rotate_degrees=tuple(turn))).point
    for z in (3.0, 0.2):
        up = list(turned((0, 1, 0)))
        camera = {"position": turned((0, 0, z)), "target": turned((0, 0, 0.5)), "up": up, "vertical_fov": 20.0}
        for pair in (label, label[::-1]):
            picture = studio.image(scene([pane, *pair], camera=camera, glass=GLASS), 24, spp=8)
            assert (picture == 1.0).all(), f"from {z}: {np.count_nonzero(picture.max(axis=2) != 1.0)} pixels"


HAZE = {"scattering": [0.3, 0.2, 0.1], "g": 0.3}


@pytest.mark.long
@pytest.mark.parametrize("kind", ["box", "sphere", "turned box"])
def test_haze_that_fills_a_room_is_lossless(evidence: Evidence, studio: Studio, kind: str) -> None:
    """In a furnace haze that absorbs nothing changes nothing: walls of albedo 0.5 that send out 1 look like 2."""
    where = {"transform": {"rotate_degrees": [10, 20, 30]}} if "turned" in kind else {}
    shape = {"type": "sphere", "radius": 2.0} if kind == "sphere" else {"type": "box", "size": [4, 4, 4], **where}
    walls = {**shape, "flip_normals": True, "material": "wall", "emission": [1.0, 1.0, 1.0]}
    what = clrender.Scene(
        camera={"position": [0.0, 0.1, -1.2], "target": [0.0, 0.0, 0.0], "vertical_fov": 60.0},
        shapes=(walls, {**shape, "interior": "haze"}),
        materials={"wall": lambert(0.5)},
        media={"haze": HAZE},
    )
    evidence.mean_is("tiles", studio.tiles(what, range(16), size=24, tiles=2, spp=32), 2.0)


@pytest.mark.parametrize("distance", [5.0, 80.0, 2000.0])
@pytest.mark.parametrize("place", [0.0, 1e-3, 0.25])
def test_a_lamp_on_a_flat_wall_is_seen_from_any_distance(studio: Studio, place: float, distance: float) -> None:
    """Nothing else tells how far rays come, and the wall may have no coordinate at all along them."""
    turn = {"x": ((0, 0, 1), (0, 1, 0), (1, 0, 0)), "slanted": ((0.8, 0.0, -0.6), (0.0, 1.0, 0.0), (0.6, 0.0, 0.8))}
    for name, axes in turn.items():
        u, v, n = (np.array(axis, np.float64) for axis in axes)
        wall = quad((place * n - 2 * u - 2 * v).tolist(), (4 * u).tolist(), (4 * v).tolist(), material="white")
        lamp = quad((place * n - u - v).tolist(), (2 * u).tolist(), (2 * v).tolist(), emission=1.0)
        if np.dot(np.cross(u, v), n) < 0.0:
            wall, lamp = ({**each, "flip_normals": True} for each in (wall, lamp))
        camera = {
            "position": (distance * n).tolist(),
            "target": (place * n).tolist(),
            "up": v.tolist(),
            "vertical_fov": math.degrees(2.0 * math.atan(0.9 / distance)),
        }
        for shapes in ([wall, lamp], [lamp, wall]):
            picture = studio.image(scene(shapes, camera=camera, white=lambert(0.5)), 16, spp=4)
            assert (picture == 1.0).all(), (name, picture.mean())


def test_a_camera_that_moves_far_away_leaves_no_bit_of_before(device: Device) -> None:
    """The same session has the image of a new one: what touches is decided again where the camera comes further."""
    wall = quad((-2, -2, 0), (4, 0, 0), (0, 4, 0), material="white")
    lamp = quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), emission=1.0)
    near = scene([wall, lamp], camera={"position": [0.3, 0.2, 0.5], "target": [0.0, 0.0, 0.0]}, white=lambert(0.5))
    far = near.changed({"camera.position": [30.0, 20.0, 200.0], "camera.vertical_fov": 1.0})
    how: dict[str, Any] = {"size": (16, 16), "spp": 4}
    with clrender.Session([device]) as one, clrender.Session([device]) as other:
        one.render(near, **how)
        moved, new = one.render(far, **how), other.render(far, **how)
    assert moved.stats["image_sha256"] == new.stats["image_sha256"] and (moved.linear > 0.9).any()


@pytest.mark.long
@pytest.mark.parametrize("moving", ["the lamp", "both"])
def test_lamps_in_the_plane_of_what_they_lie_on_may_move(device: Device, moving: str) -> None:
    """A lamp that slides in its ceiling, or moves with its board, was dark: only what rests was compared."""

    def mean(height: float) -> float:
        rise = 0.05 if moving == "both" else 0.0
        keys = [{"time": 0.0, "translate": [-0.2, 0.0, 0.0]}, {"time": 1.0, "translate": [0.2, rise, 0.0]}]
        lamp = {"type": "quad", "origin": [-0.3, height, -0.3], "edge_u": [0.6, 0.0, 0.0], "edge_v": [0.0, 0.0, 0.6]}
        board = {"type": "quad", "origin": [-1.0, 1.0, -1.0], "edge_u": [2.0, 0.0, 0.0], "edge_v": [0.0, 0.0, 2.0]}
        floor = {"type": "quad", "origin": [-1.0, -1.0, 1.0], "edge_u": [2.0, 0.0, 0.0], "edge_v": [0.0, 0.0, -2.0]}
        shapes = [
            {**floor, "material": "white"},
            {**board, "material": "white", **({"motion": keys} if moving == "both" else {})},
            {**lamp, "emission": [5.0, 5.0, 5.0], "motion": keys},
        ]
        scene = clrender.Scene(
            camera={"position": [0, -0.5, 4], "target": [0, 0, 0], "vertical_fov": 40.0, "shutter": [0.0, 1.0]},
            materials={"white": {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]}},
            shapes=shapes,
        )
        return float(clrender.render(scene, device=device, size=(16, 16), spp=64).linear.mean(dtype=np.float64))

    assert mean(1.0) == pytest.approx(mean(0.999), rel=0.03)
