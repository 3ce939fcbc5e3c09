"""The table of docs/integrators.md, cell by cell: each kind of light alone in a scene whose answer is known."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from render_support import Studio, down, lambert, quad, scene

import clrender
from clrender.errors import SceneError
from clrender.integrators import INTEGRATORS
from clrender.scene import Scene

PAGE = Path(__file__).parents[2] / "docs" / "integrators.md"
# What a method may be off by where it finds the light. Photons: all pixels here look at one place and share its some
# 3000 photons, which is a standard error of 0.018. Radiosity: the size of its patches.
ALLOWED = {"photon": 0.06, "radiosity": 0.05}
NOISE = 0.02
SETTINGS: dict[str, dict[str, Any]] = {
    "photon": {"spp": 16, "photons": 1 << 15},
    "radiosity": {"spp": 4, "patches": 4000},
}
CHAINS = "with `--specular-chains on"
FROM_A_MIRROR: dict[str, Any] = {"spp": 32, "photons": 1 << 18, "photon_radius": 0.3}
WHITE = lambert(0.8)
MIRROR = {"type": "mirror", "reflectance": [0.9, 0.9, 0.9]}


def table() -> dict[tuple[str, str], str]:
    """(light, integrator) -> yes, no, refused or `CHAINS`, as the page says."""
    lines = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("|")]
    rows = [[cell.strip(" `") for cell in line.strip("|").split("|")] for line in lines]
    rows = rows[next(i for i, row in enumerate(rows) if row[0] == "light path") :]
    first, *body = rows[: next(i for i, row in enumerate(rows) if row[0] == "")]
    return {(row[0], name): cell for row in body[1:] for name, cell in zip(first[1:], row[1:], strict=True)}


CELLS = table()


def irradiance(x: np.ndarray[Any, Any], y: np.ndarray[Any, Any], z: np.ndarray[Any, Any], cosine: Any) -> float:
    """Of the floor at the origin, by the midpoint rule over points of a light of radiance 1 and area 1.

    `cosine` is the light's, times the distance.
    """
    distance2 = x * x + y * y + z * z
    return float(np.mean(np.maximum(y, 0.0) * np.maximum(cosine, 0.0) / distance2**2))


def middles(low: float, high: float, count: int = 400) -> np.ndarray[Any, Any]:
    return low + (np.arange(count) + 0.5) * (high - low) / count


def floor(half: float = 2.0) -> dict[str, Any]:
    return quad((-half, 0, half), (2 * half, 0, 0), (0, 0, -2 * half), material="white")


def looked_at() -> tuple[Scene, float]:
    light = quad((-1, 0, 1), (2, 0, 0), (0, 0, -2), material="white", emission=2.0)
    return scene([light], white=lambert(0.0)), 2.0


def built_in(name: str, exact: float) -> tuple[Scene, float]:
    what = clrender.load(name)
    return what.model_copy(update={"camera": what.camera.model_copy(update={"vertical_fov": 0.05})}), exact


def past_an_edge() -> tuple[Scene, float]:
    """A square light two metres up; a black screen at half the height hides what is beyond x = 0.2 of it."""
    light = quad((-0.5, 2, -0.5), (1, 0, 0), (0, 0, 1), emission=10.0)
    screen = quad((0.1, 1, -1), (1, 0, 0), (0, 0, 2), material="black")
    x, z = np.meshgrid(middles(-0.5, 0.5), middles(-0.5, 0.5))
    seen = irradiance(x, np.full_like(x, 2.0), z, np.where(x < 0.2, 2.0, 0.0))
    return scene([floor(), light, screen], white=WHITE, black=lambert(0.0)), 10.0 * seen * 0.8 / math.pi


def environment() -> tuple[Scene, float]:
    return scene([floor()], [{"type": "environment", "radiance": [1, 1, 1]}], white=WHITE), 0.8


def off_a_mirror() -> tuple[Scene, float]:
    """A lamp that faces a wide mirror at x = 1 and turns its back on the origin: what arrives comes from its image."""
    lamp = quad((0.5, 0.5, -0.5), (0, 1, 0), (0, 0, 1), emission=10.0)
    mirror = quad((1, 0, -3), (0, 0, 6), (0, 4, 0), material="mirror")
    y, z = np.meshgrid(middles(0.5, 1.5), middles(-0.5, 0.5))
    exact = 10.0 * 0.9 * irradiance(np.full_like(y, 1.5), y, z, np.full_like(y, 1.5)) * 0.8 / math.pi
    return scene([floor(), lamp, mirror], white=WHITE, mirror=MIRROR), exact


def point_off_a_mirror(degrees: float = 0.01) -> tuple[Scene, float]:
    """The same with a point behind a screen; the answer is that of a narrow view."""
    screen = quad((0.3, 0.3, -0.6), (0, 1.2, 0), (0, 0, 1.2), material="black")
    mirror = quad((1, 0, -3), (0, 0, 6), (0, 4, 0), material="mirror")
    point = {"type": "point", "position": [0.5, 1.0, 0.0], "intensity": [5, 5, 5]}
    distance2 = 1.5**2 + 1.0
    exact = 5.0 * 0.9 / distance2 * (1.0 / math.sqrt(distance2)) * 0.8 / math.pi
    materials = {"white": WHITE, "mirror": MIRROR, "black": lambert(0.0)}
    return scene([floor(), screen, mirror], [point], down(degrees=degrees), **materials), exact


LIGHT: dict[str, Callable[[], tuple[Scene, float]]] = {
    "a light, seen directly": looked_at,
    "from a point light to a surface": lambda: built_in("point-plane", 5.0 / (4.0 * math.pi)),
    "from a sphere light to a surface": lambda: built_in("sphere-plane", 0.8),
    "from an area light past an edge: soft shadows": past_an_edge,
    "from the environment to a surface": environment,
    "between diffuse surfaces": lambda: built_in("furnace-room", 5.0),
    "seen in a mirror": lambda: built_in("mirror-light", 4.0),
    "seen through glass": lambda: built_in("slab", 12.0 / 13.0),
    "from an area light off a mirror to a surface: caustics": off_a_mirror,
    "from a point light off a mirror to a surface": point_off_a_mirror,
}


def test_the_page_has_a_cell_for_each() -> None:
    assert set(CELLS) == {(light, name) for light in LIGHT for name in INTEGRATORS}


@pytest.mark.long
@pytest.mark.parametrize(("light", "name"), list(CELLS), ids=[f"{light}-{name}" for light, name in CELLS])
def test_cell(studio: Studio, light: str, name: str) -> None:
    what, exact = LIGHT[light]()
    settings = {"spp": 256, "integrator": name, **SETTINGS.get(name, {})}
    if name == "photon" and "off a mirror" in light:
        settings |= FROM_A_MIRROR
    if name == "bdpt" and light == "from a point light off a mirror to a surface":
        # Light paths alone find it, and few of them end in a narrow view
        what, exact = point_off_a_mirror(degrees=60.0)
        settings["light_paths"] = 1 << 16
    if CELLS[light, name] == CHAINS:
        assert not studio.image(what, 16, **settings).any()
        settings["specular_chains"] = "on"
    if CELLS[light, name] == "refused":
        with pytest.raises(SceneError, match=r"of type (mirror|dielectric)"):
            studio.image(what, 16, **settings)
        return
    if name == "radiosity" and light == "between diffuse surfaces":
        settings["patches"] = 1000  # all are as bright, however large
    # Each patch sees a light from 32 points: single seeds spread by 3 %
    seeds = range(3) if name == "radiosity" else range(1)
    share = float(np.mean([studio.image(what, 16, seed=seed, **settings).mean() for seed in seeds])) / exact
    if CELLS[light, name] in ("yes", CHAINS):
        assert abs(share - 1.0) < ALLOWED.get(name, NOISE)
    else:
        assert CELLS[light, name] == "no"
        assert abs(share - 1.0) > 0.1
