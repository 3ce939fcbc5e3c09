"""Specular chains: light over mirrors and through glass by formulae, and against paths that find it by chance."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from parts_support import SIZE, apart, judge, rendered
from render_support import Studio, disk, down, lambert, quad, scene, sphere

import clrender

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

CHAINS: Final[dict[str, Any]] = {"specular_chains": "on"}
FLOOR: Final = quad((-4.0, 0.0, 4.0), (8.0, 0.0, 0.0), (0.0, 0.0, -8.0), material="grey")
GREY: Final = lambert(0.5)
MIRROR: Final = {"type": "mirror", "reflectance": [0.9, 0.8, 0.7]}
GLASS: Final = {"type": "dielectric", "ior": 1.5}
INTENSITY: Final = 2.0
BLACK: Final = lambert(0.0)


@pytest.fixture(scope="module")
def session(device: Device) -> Iterator[clrender.Session]:
    """One device for all tests."""
    with clrender.Session(device.info.index) as made:
        yield made


@pytest.fixture(scope="module")
def studio(session: clrender.Session) -> Studio:
    return Studio(session)


def lamp(position: tuple[float, float, float], **more: Any) -> dict[str, Any]:
    return {"type": "point", "position": list(position), "intensity": [INTENSITY] * 3, **more}


def by_chains(studio: Studio, what: Scene, **settings: Any) -> np.ndarray[Any, Any]:
    """(1024, 3) radiance that chains find beside what paths do: all pixels see the same."""
    asked: dict[str, Any] = {"spp": 256, "max_depth": 3, **settings}
    return (studio.image(what, **CHAINS, **asked) - studio.image(what, **asked)).reshape(-1, 3)


def agrees(found: np.ndarray[Any, Any], wanted: np.ndarray[Any, Any] | float, slack: float = 1e-3) -> None:
    """The mean of batches is that number, to four standard errors and a share for what is narrow but not a point."""
    error = found.std(axis=0, ddof=1) / math.sqrt(len(found))
    np.testing.assert_array_less(np.abs(found.mean(axis=0) - wanted), 4.0 * error + slack * np.abs(wanted))


def fresnel(cosine: float, eta: float) -> tuple[float, float]:
    """Reflected share, and the cosine beyond."""
    beyond = math.sqrt(1.0 - (1.0 - cosine * cosine) / (eta * eta))
    parallel = (eta * cosine - beyond) / (eta * cosine + beyond)
    across = (cosine - eta * beyond) / (cosine + eta * beyond)
    return (parallel * parallel + across * across) / 2.0, beyond


@pytest.mark.parametrize("at", [(0.0, 0.0, 0.0), (1.2, 0.0, -0.7)])
def test_a_plane_mirror_shows_an_image_light(studio: Studio, at: tuple[float, float, float]) -> None:
    """Two triangles, a chain over either of which would be the same."""
    wall = quad((-3.0, 0.0, -2.0), (6.0, 0.0, 0.0), (0.0, 4.0, 0.0), material="mirror")
    what = scene([FLOOR, wall], [lamp((0.3, 1.0, 0.2))], down(at), grey=GREY, mirror=MIRROR)
    dx, dy, dz = at[0] - 0.3, 1.0, at[2] + 4.2
    irradiance = INTENSITY * dy / (dx * dx + dy * dy + dz * dz) ** 1.5
    agrees(by_chains(studio, what), 0.5 / math.pi * irradiance * np.array(MIRROR["reflectance"]))


@pytest.mark.parametrize("facing", [-1.0, 1.0])
def test_a_mirror_ball_spreads_a_lamp(studio: Studio, facing: float) -> None:
    """Alhazen's problem, where point and lamp are as far from the ball: reflected in the middle. Convex, and concave.

    A bundle reflected at cosine c is as if it came from the two foci of a mirror of that radius: 1/s' = 2/(R c) - 1/s
    in the plane of incidence, and 1/s' = 2 c / R - 1/s across it.
    """
    # The mirror's point is the origin of these; both others are on lines at +-40 degrees from its normal
    angle, s = math.radians(40.0), 1.1
    radius = 0.6 if facing < 0.0 else 3.0
    c, sine = math.cos(angle), math.sin(angle)
    # The normal at the point of reflection is +x: the point seen is at (s c, s sine), the lamp at (s c, -s sine)
    ball = sphere((-radius if facing < 0.0 else radius, 0.0, 0.0), radius, material="mirror")
    if facing > 0.0:
        ball["flip_normals"] = True
    seen, light = (s * c, -s * sine, 0.0), (s * c, s * sine, 0.0)
    plate = disk(seen, (0.0, 1.0, 0.0), 0.02, material="grey")
    what = scene([plate, ball], [lamp(light)], down(seen), grey=GREY, mirror=MIRROR)
    power = 2.0 / radius * (1.0 if facing > 0.0 else -1.0)
    in_plane, across = power / c - 1.0 / s, power * c - 1.0 / s  # vergences after reflection, along the ray
    spread = (1.0 - s * in_plane) * (1.0 - s * across) * s * s
    toward = np.array([-s * c, s * sine])
    cosine = toward[1] / math.hypot(*toward)
    wanted = 0.5 / math.pi * INTENSITY * cosine / abs(spread) * np.array(MIRROR["reflectance"])
    # Of a concave ball other points of it reflect the lamp there too; there it is compared only where one does
    found = by_chains(studio, what, max_depth=2)
    agrees(found, wanted, 2e-3)


@pytest.mark.parametrize("sides", [1, 2])
def test_a_flat_boundary_bends_light(studio: Studio, sides: int) -> None:
    """A lamp above a plate of glass: the point is in the glass, where it is thick, or behind it."""
    eta, top, bottom, height = 1.5, 1.0, (-0.5 if sides == 1 else 0.6), 1.7
    plate = {"type": "box", "center": [0.0, (top + bottom) / 2.0, 0.0], "size": [7.0, top - bottom, 7.0]}
    at, light = (0.9, 0.0, 0.0), (0.0, height, 0.0)
    what = scene([FLOOR, {**plate, "material": "glass"}], [lamp(light)], down(at, 0.1), grey=GREY, glass=GLASS)
    inside, outside = (top, height - top) if sides == 1 else (top - bottom, height - top + bottom)

    def arrives(sine: float) -> float:
        """How far aside a ray of this sine in air is at the floor."""
        tangent = sine / eta / math.sqrt(1.0 - (sine / eta) ** 2)
        return outside * sine / math.sqrt(1.0 - sine * sine) + inside * tangent

    low, high = 0.0, 1.0 - 1e-12
    for _ in range(80):
        middle = (low + high) / 2.0
        low, high = (middle, high) if arrives(middle) < at[0] else (low, middle)
    sine = low
    step = 1e-6
    slope = (arrives(sine + step) - arrives(sine - step)) / (2.0 * step)
    # The lamp's light between two cones falls on a ring of the floor
    cosine = math.sqrt(1.0 - sine * sine)
    irradiance = INTENSITY * sine / cosine / (slope * at[0])
    reflected, _ = fresnel(cosine, eta)
    passes = (1.0 - reflected) ** sides
    wanted = 0.5 / math.pi * irradiance * passes
    found = by_chains(studio, what, max_depth=sides + 1)
    # Radiance is seen in glass by a camera in glass, or in air by one in air: no factor of the index
    agrees(found, wanted, 2e-3)


def test_a_thin_wall_of_glass_lets_light_straight_through(studio: Studio) -> None:
    pane = quad((-3.0, 1.0, 3.0), (6.0, 0.0, 0.0), (0.0, 0.0, -6.0), material="pane")
    thin = {"type": "dielectric", "ior": 1.5, "thin": True}
    what = scene([FLOOR, pane], [lamp((0.0, 2.0, 0.0))], down(), grey=GREY, pane=thin)
    once, _ = fresnel(1.0, 1.5)
    both = 1.0 - 2.0 * once / (1.0 + once)
    agrees(by_chains(studio, what), 0.5 / math.pi * INTENSITY / 4.0 * both)


BALLS: Final = [
    FLOOR,
    sphere((-0.4, 0.7, -0.2), 0.5, material="glass"),
    sphere((1.1, 0.4, 0.6), 0.4, material="mirror"),
]
SHINING: Final[dict[str, dict[str, Any]]] = {
    "ball": sphere((0.9, 1.6, 0.5), 0.3, material="black", emission=10.0),
    "quad": quad((0.6, 1.8, 0.2), (0.6, 0.0, 0.0), (0.0, 0.0, 0.6), material="black", emission=20.0),
    "disk": disk((0.7, 1.7, 0.3), (-0.3, -1.0, 0.1), 0.3, material="black", emission=20.0),
}


@pytest.mark.long
@pytest.mark.parametrize("light", SHINING)
def test_lights_that_paths_find_are_shared_with_them(session: clrender.Session, light: str) -> None:
    """Caustics of a glass and a mirror ball, whose light paths find by chance, in every way to render them."""
    view = {"position": [0.2, 5.0, 0.0], "target": [0.2, 0.0, 0.0], "up": [0.0, 0.0, -1.0], "vertical_fov": 36.0}
    what = scene([*BALLS, SHINING[light]], (), view, grey=GREY, glass=GLASS, mirror=MIRROR, black=BLACK)
    plain = rendered(session, what, 0, {"spp": 1024})
    ways: list[dict[str, Any]] = [
        {},
        {"guiding": "on", "guiding_paths": 1 << 13},
        {"integrator": "bdpt"},
        {"sampling": "light"},
    ]
    found = [
        (f"{way}", apart(plain, rendered(session, what, 100 * k + 100, {"spp": 256, **CHAINS, **way})))
        for k, way in enumerate(ways)
    ]
    judge(found)


def test_near_a_focus_paths_and_chains_share_the_light(studio: Studio) -> None:
    """Below a ball of glass that gathers the light of a lamp: without right weights a part of it would count twice."""
    shapes = [*BALLS[:2], SHINING["ball"]]
    what = scene(shapes, (), down((-1.125, 0.0, -0.625)), grey=GREY, glass=GLASS, black=BLACK)
    plain = studio.image(what, 16, spp=2048, max_depth=3).reshape(-1, 3)[:, 1]
    shared = studio.image(what, 16, spp=512, max_depth=3, seed=1, **CHAINS).reshape(-1, 3)[:, 1]
    error = math.sqrt(plain.var(ddof=1) / len(plain) + shared.var(ddof=1) / len(shared))
    assert error < 0.02 * plain.mean()
    assert abs(shared.mean() - plain.mean()) < 4.0 * error


@pytest.mark.long
@pytest.mark.parametrize("name", ["room", "drink", "haze", "textures", "bumpy", "surfaces", "foliage", "metals"])
def test_built_in_scenes_stay_the_same(session: clrender.Session, name: str) -> None:
    what = clrender.load(name)
    plain = rendered(session, what, 0, {"spp": 256})
    judge([(name, apart(plain, rendered(session, what, 100, {"spp": 128, **CHAINS})))])


@pytest.mark.long
def test_what_the_camera_sees_in_a_mirror(session: clrender.Session) -> None:
    """Where `bdpt` has no way of its own: what its chains find is what those of `path` do."""
    wall = quad((-3.0, 0.0, -2.0), (6.0, 0.0, 0.0), (0.0, 4.0, 0.0), material="mirror")
    view = {"position": [0.0, 1.2, 1.0], "target": [0.0, 0.3, -2.0], "vertical_fov": 40.0}
    lights = [
        lamp((0.3, 1.0, 0.2)),
        {"type": "directional", "direction": [0.2, -1.0, -0.5], "irradiance": [1.0, 1.0, 1.0]},
    ]
    ball = sphere((0.4, 0.35, -0.9), 0.3, material="glass")
    what = scene([FLOOR, wall, ball], lights, view, grey=GREY, mirror=MIRROR, glass=GLASS)
    first = rendered(session, what, 0, {"spp": 256, "max_depth": 3, **CHAINS})
    second = rendered(session, what, 100, {"spp": 256, "max_depth": 3, "integrator": "bdpt", **CHAINS})
    without = rendered(session, what, 200, {"spp": 64, "max_depth": 3, "integrator": "bdpt"})
    assert first.mean() > 1.02 * without.mean()
    judge([("bdpt", apart(first, second))])


def test_no_table_no_chains(session: clrender.Session) -> None:
    """Without mirrors or glass the program and the image are those of paths."""
    what = scene([FLOOR], [lamp((0.0, 1.0, 0.0))], down(), grey=GREY)
    plain, asked = (session.render(what, size=SIZE, spp=2, **how).stats["image_sha256"] for how in ({}, CHAINS))
    assert plain == asked


@pytest.mark.long
def test_a_lamp_that_shines_inwards_is_closed(studio: Studio) -> None:
    """No chain passes the near side to the far one, which is turned to it."""
    lit = sphere((0.0, 3.0, 0.0), 1.0, material="grey", emission=[1.0, 1.0, 1.0])
    glass = sphere((0.0, 1.0, 0.0), 0.7, material="glass")
    camera = {"position": [0.0, 3.0, 6.0], "target": [0.0, 1.0, 0.0], "vertical_fov": 45.0}
    what = scene([FLOOR, glass, {**lit, "flip_normals": True}], camera=camera, grey=GREY, glass=GLASS)
    assert studio.image(what, spp=64, **CHAINS).max() == 0.0
