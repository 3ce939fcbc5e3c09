"""Shadow terminators of coarse meshes that are moved to where those of the curved surface would be (Hanika 2021)."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from render_support import Studio
from stats_support import Evidence
from test_shading_normals import AHEAD, SKY, ball, lamp

import clrender
from clrender.errors import SceneError
from clrender.flatten.flat_scene import flatten

if TYPE_CHECKING:
    from clrender.scene import Scene

MATERIALS: dict[str, dict[str, Any]] = {
    "white": {"type": "lambert", "reflectance": [1.0, 1.0, 1.0]},
    "grey": {"type": "lambert", "reflectance": [0.6, 0.6, 0.6]},
    "satin": {"type": "conductor", "f0": [1.0, 1.0, 1.0], "roughness": 0.4},
    "plastic": {"type": "principled", "base_color": [0.6, 0.6, 0.6], "roughness": 0.4},
    "glass": {"type": "dielectric", "ior": 1.5},
    "lamp": {"type": "principled", "base_color": [0.6, 0.6, 0.6], "emission": [1.0, 1.0, 1.0]},
}
FLOOR = {
    "type": "quad",
    "origin": [-3.0, -1.0, 3.0],
    "edge_u": [6.0, 0.0, 0.0],
    "edge_v": [0.0, 0.0, -6.0],
    "material": "grey",
}
ABOVE = {"position": [0.0, 5.0, 6.0], "target": [0.0, -0.4, 0.0], "vertical_fov": 28.0}


def of(
    folder: Path,
    material: str | None,
    camera: dict[str, Any],
    *shapes: dict[str, Any],
    offset: bool = True,
    lights: list[dict[str, Any]] | None = None,
    mesh: str | None = None,
    **more: Any,
) -> Scene:
    """A ball of 48 faces, with other shapes and lights."""
    (folder / "mesh.obj").write_text(mesh or ball())
    ours = {"type": "mesh", "file": "mesh.obj", "shadow_terminator_offset": offset, **more}
    if material is not None:
        ours["material"] = material
    described = {"camera": camera, "shapes": [ours, *shapes], "lights": lights or [], "materials": MATERIALS}
    (folder / "scene.json").write_text(json.dumps(described))
    return clrender.load(folder / "scene.json")


@pytest.mark.long
def test_a_white_ball_of_few_triangles_shows_all_of_the_sky(studio: Studio, tmp_path: Path) -> None:
    """What is below an interpolated normal's horizon meets the ball again, and comes out later: no light is lost.

    Of a million paths ten get between two triangles (DECISIONS.md, 27).
    """
    settings: dict[str, Any] = {"spp": 16, "roulette": "none", "max_depth": 200, "sampling": "bsdf"}
    moved = studio.image(of(tmp_path, "white", AHEAD, lights=[SKY]), 32, **settings)
    assert np.count_nonzero(moved.min(axis=2) < 0.999) <= 4
    assert moved.mean() == pytest.approx(1.0, abs=5e-4) and moved.max() < 1.0001
    plain = studio.image(of(tmp_path, "white", AHEAD, lights=[SKY], offset=False), 32, **settings)
    assert plain.mean() < 0.99, "which is not so otherwise"


@pytest.mark.long
def test_light_ends_where_interpolated_normals_say(studio: Studio, tmp_path: Path) -> None:
    """Lit by the sun, every point of a convex mesh is as bright as its own normal makes it."""
    to_sun = np.array([math.cos(0.3), 0.2, math.sin(0.3)])
    sun = [{"type": "directional", "direction": (-to_sun).tolist(), "irradiance": [math.pi] * 3}]
    normal = studio.layer(of(tmp_path, "grey", AHEAD, lights=sun), 64, "normal")
    inside = (normal * normal).sum(axis=2) > 0.97
    expected = 0.6 * np.maximum(normal @ to_sun, 0.0) / np.sqrt(to_sun @ to_sun)

    def wrong(offset: bool) -> int:
        what = of(tmp_path, "grey", AHEAD, lights=sun, offset=offset)
        seen = studio.image(what, 64, spp=16, integrator="direct")[:, :, 0]
        return int(np.count_nonzero(np.abs(seen - expected)[inside] > 0.05))

    assert wrong(offset=False) > 200
    assert wrong(offset=True) < 20


@pytest.mark.long
@pytest.mark.parametrize("material", ["grey", "satin", "plastic"])
def test_ways_agree(evidence: Evidence, studio: Studio, tmp_path: Path, material: str) -> None:
    lamps = [lamp((3.0, 0.5, 0.5), 0.7), lamp((-1.0, 3.0, -1.0), 0.5)]
    what = of(tmp_path, material, ABOVE, FLOOR, *lamps)
    first, second, third = range(16), range(100, 116), range(200, 216)
    plain = studio.tiles(what, first, spp=32)
    evidence.equal("light", studio.tiles(what, second, spp=64, sampling="light"), plain)
    evidence.equal("bsdf", studio.tiles(what, third, spp=64, sampling="bsdf"), plain)
    evidence.equal("reuse", studio.tiles(what, range(300, 316), spp=32, integrator="reuse"), plain)


@pytest.mark.slow
def test_photons_find_the_same_light(studio: Studio, tmp_path: Path) -> None:
    what = of(tmp_path, "grey", ABOVE, FLOOR, lamp((3.0, 1.5, 0.5), 0.7))
    paths = studio.image(what, 16, spp=256)
    photons = studio.image(what, 16, spp=16, integrator="photon", photons=40000, photon_radius=0.1)
    assert photons.mean() == pytest.approx(paths.mean(), rel=0.02)


@pytest.mark.long
def test_whitted_agrees_with_direct_light(evidence: Evidence, studio: Studio, tmp_path: Path) -> None:
    lights = [{"type": "point", "position": [3.0, 1.0, 1.0], "intensity": [9.0, 9.0, 9.0]}]
    what = of(tmp_path, "grey", ABOVE, FLOOR, lights=lights)
    direct = studio.tiles(what, range(16), spp=16, integrator="direct")
    evidence.equal("light", studio.tiles(what, range(40, 56), spp=16, integrator="whitted"), direct)


@pytest.mark.long
def test_no_light_gets_into_a_closed_mesh(studio: Studio, tmp_path: Path) -> None:
    """Seen from inside it is hollow: no tangent plane is above it, and its triangles remain before what is outside."""
    inside = {"position": [0.2, 0.1, 0.3], "target": [1.0, 0.3, 0.0], "vertical_fov": 120.0}
    for flip in (False, True):
        what = of(tmp_path, "white", inside, lamp((3.0, 0.5, 0.5), 1.5), lights=[SKY], flip_normals=flip)
        assert (studio.image(what, 32, spp=64, max_depth=6) == 0.0).all()


@pytest.mark.long
@pytest.mark.parametrize("scale", [[-2.0, 2.0, 2.0], [1.0, 1.3, 0.7]], ids=["mirrored", "uneven"])
def test_instances_are_lit_as_shapes_are(
    evidence: Evidence, studio: Studio, tmp_path: Path, scale: list[float]
) -> None:
    lights = [lamp((6.0, 3.0, 1.0), 1.0)]
    place: dict[str, Any] = {"transform": {"scale": scale, "rotate_degrees": [0.0, 20.0, 10.0]}}
    plain = of(tmp_path, "grey", ABOVE, FLOOR, *lights, **place)
    shape = {"type": "mesh", "file": "mesh.obj", "material": "grey", "shadow_terminator_offset": True}
    described = {
        "camera": ABOVE,
        "shapes": [FLOOR, *lights, {"type": "instance", "group": "ball", **place}],
        "groups": {"ball": {"shapes": [shape]}},
        "materials": MATERIALS,
    }
    (tmp_path / "instance.json").write_text(json.dumps(described))
    placed = clrender.load(tmp_path / "instance.json")
    found, expected = studio.tiles(placed, range(16), spp=16), studio.tiles(plain, range(50, 66), spp=16)
    if scale[0] == -2.0:
        evidence.equal("light", found, expected)
    else:  # normals are interpolated before they are stretched, not after
        assert found.mean() == pytest.approx(expected.mean(), rel=0.01)


@pytest.mark.parametrize(
    ("material", "more", "message"),
    [
        ("glass", {}, "lets light inside"),
        ("lamp", {}, "is a light"),
        (None, {"emission": [1.0, 1.0, 1.0]}, "is a light"),
    ],
)
def test_only_what_is_opaque_has_its_terminator_moved(
    tmp_path: Path, material: str | None, more: dict[str, Any], message: str
) -> None:
    with pytest.raises(SceneError, match=rf"shapes\[0\].shadow_terminator_offset is given, but the shape {message}"):
        of(tmp_path, material, AHEAD, **more)


def test_a_mesh_without_vertex_normals_is_told(tmp_path: Path) -> None:
    flat = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nf 1 2 3\n"
    warnings = flatten(of(tmp_path, "grey", AHEAD, mesh=flat), 8, 8).warnings
    assert any("shadow_terminator_offset changes nothing: the mesh has no vertex normals" in text for text in warnings)
    assert not flatten(of(tmp_path, "grey", AHEAD, lights=[SKY]), 8, 8).warnings
