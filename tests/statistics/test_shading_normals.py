"""Interpolated normals on few triangles: no way to sample light is misled by them, and glass loses no light."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from render_support import Studio
from stats_support import Evidence

import clrender

if TYPE_CHECKING:
    from clrender.scene import Scene

SKY = {"type": "environment", "radiance": [1.0, 1.0, 1.0]}
MATERIALS: dict[str, dict[str, Any]] = {
    "metal": {"type": "conductor", "f0": [1.0, 1.0, 1.0], "roughness": 0.5},
    "satin": {"type": "conductor", "f0": [1.0, 1.0, 1.0], "roughness": 0.3},
    "plastic": {"type": "principled", "base_color": [1.0, 1.0, 1.0], "roughness": 0.5},
    "glass": {"type": "dielectric", "ior": 1.5},
    "ranked": {"type": "dielectric", "ior": 1.5, "priority": 1},
    "rough": {"type": "dielectric", "ior": 1.5, "roughness": 0.5},
    "thin": {"type": "dielectric", "ior": 1.5, "thin": True},
    "floor": {"type": "lambert", "reflectance": [0.7, 0.7, 0.7]},
    "mirror": {"type": "mirror", "reflectance": [1.0, 1.0, 1.0]},
}
TILTED = """v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvn 0.70710678 0 0.70710678\nf 1//1 2//1 3//1\nf 1//1 3//1 4//1\n"""


def ball(slices: int = 8, stacks: int = 4) -> str:
    """An .obj file: a sphere of few triangles with the sphere's own normals."""
    corners = [(0.0, 1.0, 0.0), (0.0, -1.0, 0.0)]
    for i in range(1, stacks):
        for k in range(slices):
            down, turn = math.pi * i / stacks, 2.0 * math.pi * k / slices
            corners.append((math.sin(down) * math.sin(turn), math.cos(down), math.sin(down) * math.cos(turn)))
    faces: list[tuple[int, ...]] = []
    for k in range(slices):
        a, b, last = 3 + k, 3 + (k + 1) % slices, slices * (stacks - 2)
        faces += [(1, a, b), (2, b + last, a + last)]
        for row in range(0, last, slices):
            faces.append((a + row, a + row + slices, b + row + slices, b + row))
    lines = [f"{kind} {x:.9f} {y:.9f} {z:.9f}" for kind in ("v", "vn") for x, y, z in corners]
    lines += ["f " + " ".join(f"{corner}//{corner}" for corner in face) for face in faces]
    return "\n".join(lines) + "\n"


def of(folder: Path, mesh: str, material: str, camera: dict[str, Any], *shapes: dict[str, Any]) -> Scene:
    """The mesh, of a material, with shapes that shine or a sky; one program renders all of them."""
    (folder / "mesh.obj").write_text(mesh)
    others = [
        {"type": "sphere", "center": [0.0, 80.0 + 2.0 * i, 0.0], "radius": 0.1, "material": name}
        for i, name in enumerate(("metal", "ranked"))
    ]
    described = {
        "camera": camera,
        "shapes": [{"type": "mesh", "file": "mesh.obj", "material": material}, *others, *shapes],
        "lights": [] if shapes else [SKY],
        "materials": MATERIALS,
    }
    (folder / "scene.json").write_text(json.dumps(described))
    return clrender.load(folder / "scene.json")


def lamp(center: tuple[float, float, float], radius: float) -> dict[str, Any]:
    """A sphere that shines."""
    return {"type": "sphere", "center": list(center), "radius": radius, "emission": [1.0, 1.0, 1.0]}


BEHIND = {
    "position": [20.0 * math.sin(-1.1781), 0.0, 20.0 * math.cos(1.1781)],
    "target": [0.0, 0.0, 0.0],
    "vertical_fov": 0.01,
}
"""From here the normal of the tilted plate looks away."""
AHEAD = {"position": [0.0, 0.0, 5.0], "target": [0.0, 0.0, 0.0], "vertical_fov": 24.0}


@pytest.mark.long
@pytest.mark.parametrize("material", ["metal", "plastic", "rough"])
def test_ways_agree_on_a_normal_that_looks_away(
    evidence: Evidence, studio: Studio, tmp_path: Path, material: str
) -> None:
    what = of(tmp_path, TILTED, material, BEHIND, lamp((4.0, 0.0, 5.0), 2.5), lamp((2.0, 0.0, -4.0), 2.0))
    seen = {way: studio.pixels(what, 32, spp=64, max_depth=1, sampling=way) for way in ("mis", "light", "bsdf")}
    assert seen["mis"].mean() > 0.01
    evidence.equal("light", seen["light"], seen["mis"])
    evidence.equal("bsdf", seen["bsdf"], seen["mis"])


@pytest.mark.long
@pytest.mark.parametrize("material", ["glass", "ranked", "thin"])
def test_smooth_glass_of_few_triangles_loses_no_light(studio: Studio, tmp_path: Path, material: str) -> None:
    """Below a white sky every path that comes out again brings 1; few are caught by total reflection."""
    what = of(tmp_path, ball(), material, AHEAD)
    seen = np.stack([studio.image(what, 16, spp=1, max_depth=60, roulette="none", seed=seed) for seed in range(16)])
    white = np.abs(seen - 1.0) < 1e-4
    assert (white | (seen == 0.0)).all(), "as often as a path crosses the surface, its radiance is scaled back again"
    assert 1.0 - white.mean() < (0.02 if material != "thin" else 1e-6)


@pytest.mark.long
def test_rough_glass_of_few_triangles_loses_no_light(studio: Studio, tmp_path: Path) -> None:
    seen = studio.image(of(tmp_path, ball(), "rough", AHEAD), 16, spp=1024)
    assert seen.mean() == pytest.approx(1.0, abs=0.01)


@pytest.mark.long
def test_a_mirror_of_few_triangles_has_no_dark_rim(studio: Studio, tmp_path: Path) -> None:
    seen = studio.image(of(tmp_path, ball(), "mirror", AHEAD), 16, spp=64)
    assert seen.max() <= 1.0
    assert seen.min() > 0.9


@pytest.mark.parametrize(("material", "least"), [("satin", 0.973), ("plastic", 0.9833)])
def test_rims_of_metal_and_plastic(studio: Studio, tmp_path: Path, material: str, least: float) -> None:
    """They still lose the part of a lobe that is below the surface, but its middle is above: 0.9799 and 0.9850.

    By the normals as they are it would be 0.9658 and 0.9816.
    """
    assert studio.image(of(tmp_path, ball(), material, AHEAD), 32, spp=256).mean() > least


@pytest.mark.slow
def test_photons_through_glass_of_few_triangles(studio: Studio, tmp_path: Path) -> None:
    """None of them becomes brighter from wall to wall, and together they bring what paths find, but for their blur."""
    floor = {
        "type": "quad",
        "origin": [-6.0, -1.2, 6.0],
        "edge_u": [12.0, 0.0, 0.0],
        "edge_v": [0.0, 0.0, -12.0],
        "material": "floor",
    }
    camera = {"position": [0.0, 6.0, 6.0], "target": [0.0, -1.2, 0.0], "vertical_fov": 35.0}
    what = of(tmp_path, ball(), "glass", camera, lamp((0.0, 6.0, -2.0), 1.0), floor)
    paths = studio.image(what, 16, spp=256)
    photons = studio.image(what, 16, spp=16, integrator="photon", photons=20000)
    assert photons.mean() == pytest.approx(paths.mean(), rel=0.05)
    assert photons.max() < 2.0 * paths.max()


@pytest.mark.long
def test_ways_agree_on_glass_of_few_triangles(evidence: Evidence, studio: Studio, tmp_path: Path) -> None:
    """With lamps behind, from which light comes on either side of the surface."""
    what = of(tmp_path, ball(), "rough", AHEAD, *(lamp((2.5 * x, 2.5 * (1 - abs(x)), -2.5), 1.2) for x in (-1, 0, 1)))
    seen = {
        way: studio.tiles(what, spp=spp, sampling=way, max_depth=3)
        for way, spp in (("mis", 16), ("light", 64), ("bsdf", 64))
    }
    evidence.equal("light", seen["light"], seen["mis"])
    evidence.equal("bsdf", seen["bsdf"], seen["mis"])
