"""Interpolated normals on few triangles: no way to sample light is misled by them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from render_support import Studio
from stats_support import Evidence

import clrender

if TYPE_CHECKING:
    from clrender.scene import Scene

SKY = {"type": "environment", "radiance": [1.0, 1.0, 1.0]}
MATERIALS: dict[str, dict[str, Any]] = {
    "metal": {"type": "conductor", "f0": [1.0, 1.0, 1.0], "roughness": 0.5},
    "plastic": {"type": "principled", "base_color": [1.0, 1.0, 1.0], "roughness": 0.5},
    "ranked": {"type": "dielectric", "ior": 1.5, "priority": 1},
    "rough": {"type": "dielectric", "ior": 1.5, "roughness": 0.5},
}
TILTED = """v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvn 0.70710678 0 0.70710678\nf 1//1 2//1 3//1\nf 1//1 3//1 4//1\n"""


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


@pytest.mark.parametrize("material", ["metal", "plastic", "rough"])
def test_ways_agree_on_a_normal_that_looks_away(
    evidence: Evidence, studio: Studio, tmp_path: Path, material: str
) -> None:
    what = of(tmp_path, TILTED, material, BEHIND, lamp((4.0, 0.0, 5.0), 2.5), lamp((2.0, 0.0, -4.0), 2.0))
    seen = {way: studio.pixels(what, 32, spp=64, max_depth=1, sampling=way) for way in ("mis", "light", "bsdf")}
    assert seen["mis"].mean() > 0.01
    evidence.equal("light", seen["light"], seen["mis"])
    evidence.equal("bsdf", seen["bsdf"], seen["mis"])
