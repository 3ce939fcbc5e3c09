"""Photons in media: by formulae, and against paths."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from parts_support import apart, judge, rendered
from render_support import disk, lambert, quad, sphere

import clrender

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

PHOTON: Final[dict[str, Any]] = {"integrator": "photon", "photons": 16384, "photon_radius": 0.08}
VIEW: Final = {"position": [0.0, 1.0, 3.4], "target": [0.0, 0.8, 0.0], "vertical_fov": 40.0}
SMOKE: Final = {"scattering": [1.0, 0.7, 0.5], "absorption": 0.1}
FLOOR: Final = quad((-2.0, 0.0, 2.0), (4.0, 0.0, 0.0), (0.0, 0.0, -4.0), material="matt")
WALL: Final = quad((-2.0, 0.0, -2.0), (4.0, 0.0, 0.0), (0.0, 3.0, 0.0), material="matt")
LAMP: Final = sphere((0.6, 1.9, 0.3), 0.25, material="black", emission=8.0)
CLOUD: Final = {"type": "box", "center": [0.0, 0.9, -0.2], "size": [2.6, 1.5, 2.2], "interior": "smoke"}
MATERIALS: Final[dict[str, Any]] = {
    "matt": lambert((0.6, 0.5, 0.4)),
    "black": lambert(0.0),
    "glass": {"type": "dielectric", "ior": 1.5},
    "skin": {"type": "subsurface", "albedo": [0.8, 0.5, 0.3], "radius": 0.3},
}


@pytest.fixture(scope="module")
def session(device: Device) -> Iterator[clrender.Session]:
    """One device for all tests."""
    with clrender.Session(device.info.index) as made:
        yield made


def described(
    shapes: list[dict[str, Any]], lights: tuple[dict[str, Any], ...] = (), g: float = 0.0, **more: Any
) -> Scene:
    media = {"smoke": {**SMOKE, "g": g}, **more.pop("media", {})}
    camera = more.pop("camera", VIEW)
    return clrender.Scene(camera=camera, materials=MATERIALS, media=media, shapes=tuple(shapes), lights=lights, **more)


CASES: Final[dict[str, Any]] = {
    "cloud": lambda: described([FLOOR, WALL, LAMP, CLOUD]),
    "forward": lambda: described([FLOOR, WALL, LAMP, CLOUD], g=0.6),
    "fog": lambda: described([FLOOR, WALL, LAMP], g=0.3, fog="smoke"),
    "lamp inside": lambda: described([FLOOR, WALL, {**LAMP, "center": [0.3, 1.0, 0.0]}, CLOUD]),
    "glass": lambda: described([FLOOR, WALL, LAMP, CLOUD, sphere((-0.3, 0.9, 0.2), 0.4, material="glass")]),
    "milk in glass": lambda: described(
        [FLOOR, LAMP, sphere((-0.3, 0.9, 0.2), 0.6, material="glass", interior="smoke")]
    ),
    "skin": lambda: described([FLOOR, WALL, LAMP, CLOUD, sphere((-0.3, 0.9, 0.2), 0.4, material="skin")]),
    "rough": lambda: described(
        [FLOOR, LAMP, CLOUD, disk((-0.5, 0.5, 0.2), (0.4, 0.8, 0.6), 0.5, material="brushed")],
    ),
}
MATERIALS["brushed"] = {"type": "conductor", "metal": "Au", "roughness": 0.4}


@pytest.mark.parametrize(
    "case", [name if name in ("cloud",) else pytest.param(name, marks=pytest.mark.long) for name in CASES]
)
def test_photons_bring_what_paths_find(session: clrender.Session, case: str) -> None:
    """Smooth light, so that a ball of this radius blurs less than is seen."""
    what = CASES[case]()
    plain = rendered(session, what, 0, {"spp": 256})
    judge([(case, apart(plain, rendered(session, what, 100, {"spp": 16, **PHOTON})))])


def test_a_cloud_that_absorbs_nothing_in_white_is_white(session: clrender.Session) -> None:
    """Every pixel is 1, up to the blur at its surface: all of the ball that is in the cloud is as bright."""
    white = {"type": "environment", "radiance": [1.0, 1.0, 1.0]}
    cloud = sphere((0.0, 0.8, 0.0), 1.0, interior="milk")
    what = described([cloud], (white,), media={"milk": {"scattering": 3.0, "absorption": 0.0}})
    settings: dict[str, Any] = {**PHOTON, "photons": 1 << 17, "photon_radius": 0.1}
    image = session.render(what, size=(12, 9), spp=24, **settings).linear.astype(np.float64)
    assert abs(image.mean() - 1.0) < 5e-3 and np.abs(image.mean(axis=2) - 1.0).max() < 0.15


def test_light_that_is_scattered_once_comes_from_lamps_alone(session: clrender.Session) -> None:
    """Photons leave nothing at their first event, as light samples find that light."""
    what = CASES["cloud"]()
    one = session.render(what, size=(16, 12), spp=8, max_depth=1, **PHOTON).linear
    plain = session.render(what, size=(16, 12), spp=8, max_depth=1, seed=0).linear
    np.testing.assert_allclose(one.mean(axis=(0, 1)), plain.mean(axis=(0, 1)), rtol=0.05)


def test_media_keep_their_photons_apart(session: clrender.Session) -> None:
    """A bright box beside a dark one, both alike but for how they scatter: no light leaks through the black wall."""
    left = {"type": "box", "center": [-0.55, 0.9, 0.0], "size": [1.0, 1.0, 1.0], "interior": "smoke"}
    right = {**left, "center": [0.55, 0.9, 0.0], "interior": "other"}
    wall = {"type": "box", "center": [0.0, 0.9, 0.0], "size": [0.04, 3.0, 2.4], "material": "black"}
    lamp = {"type": "point", "position": [-2.5, 1.2, 0.5], "intensity": [30.0, 30.0, 30.0]}
    other = {"other": {**SMOKE, "g": 0.1}}  # of the same coefficients in all they would be one medium
    what = described([left, right, wall], (lamp,), media=other)
    image = session.render(what, size=(32, 24), spp=16, **{**PHOTON, "photon_radius": 0.3}).linear
    assert image[:, :14].mean() > 0.05 and image[:, 16:].max() == 0.0
