"""Different ways to the same image: strategies, numbers of rays, roulette, integrators; the same scene at other scales.

And the built-in scenes whose answer is exact and which no other file of this folder asks for.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
from render_support import Studio
from stats_support import Evidence

import clrender

if TYPE_CHECKING:
    from clrender.scene import Scene

# Each against the plain way. In the Cornell box: diffuse, so that no caustic makes the distribution long-tailed.
WAYS: dict[str, dict[str, Any]] = {
    "two shadow rays": {"shadow_rays": 2},
    "four shadow rays": {"shadow_rays": 4},
    "five indirect rays": {"indirect_rays": 5},
    "no roulette to depth 60": {"roulette": "none", "max_depth": 60},
    "termination 0.3": {"roulette": "constant", "termination": 0.3},
    "termination by material": {"roulette": "constant"},
    "lights alone": {"sampling": "light"},
    "lights by a tree": {"light_sampler": "bvh"},
    "lights by a tree alone": {"light_sampler": "bvh", "sampling": "light", "indirect_rays": 2},
    "materials alone": {"sampling": "bsdf", "spp": 256},
    "shadow and indirect rays": {"shadow_rays": 3, "indirect_rays": 2},
    "many rays, lights alone": {"shadow_rays": 2, "indirect_rays": 3, "sampling": "light"},
}


SLOW = ("four shadow rays", "lights by a tree alone", "termination by material", "shadow and indirect rays")


@pytest.mark.long
@pytest.mark.parametrize("way", [pytest.param(way, marks=pytest.mark.slow) if way in SLOW else way for way in WAYS])
def test_ways_agree(evidence: Evidence, studio: Studio, way: str) -> None:
    scene = clrender.load("cornell")
    plain = studio.tiles(scene, range(16), spp=32)
    evidence.equal("tiles", plain, studio.tiles(scene, range(100, 116), **{"spp": 32, **WAYS[way]}))


@pytest.mark.long
@pytest.mark.parametrize("way", ["two shadow rays", "lights alone"])
def test_ways_agree_on_direct_light(evidence: Evidence, studio: Studio, way: str) -> None:
    scene = clrender.load("room")
    plain = studio.tiles(scene, range(16), spp=16, integrator="direct")
    evidence.equal("tiles", plain, studio.tiles(scene, range(100, 116), spp=16, integrator="direct", **WAYS[way]))


def test_direct_is_path_without_indirect_rays(studio: Studio) -> None:
    scene = clrender.load("room")
    direct = studio.image(scene, 40, spp=4, integrator="direct")
    assert np.array_equal(direct, studio.image(scene, 40, spp=4, indirect_rays=0))


def test_whitted_is_direct_where_lights_are_points(studio: Studio) -> None:
    scene = clrender.load("point-plane")
    whitted = studio.image(scene, 32, spp=4, integrator="whitted")
    np.testing.assert_allclose(whitted, studio.image(scene, 32, spp=4, integrator="direct"), rtol=1e-5)


# Radiance in the middle of the image; a view of 0.02 degrees sees 1.5 mm of the plane, which changes it by 1e-6.
OVER_A_PLANE = {
    "quad-plane": 0.5 * 10.0 * 4.0 / math.pi / math.sqrt(5.0) * math.atan(1.0 / math.sqrt(5.0)),
    "sphere-plane": 0.8,
    "point-plane": 5.0 / (4.0 * math.pi),
    "directional-plane": 0.4270612,
}


@pytest.mark.parametrize("sampling", ["mis", "light", "bsdf"])
@pytest.mark.parametrize("name", OVER_A_PLANE)
def test_built_in_lights_over_a_plane(evidence: Evidence, studio: Studio, name: str, sampling: str) -> None:
    scene = clrender.load(name)
    middle = scene.model_copy(update={"camera": scene.camera.model_copy(update={"vertical_fov": 0.02})})
    evidence.mean_is("radiance", studio.pixels(middle, spp=64, sampling=sampling), OVER_A_PLANE[name], rounding=1e-5)


def scaled(scene: Scene, factor: float) -> Scene:
    """Geometry and camera times a factor; radiance stays as it is."""

    def times(value: Any) -> Any:
        if isinstance(value, list | tuple):
            return tuple(times(each) for each in value)
        return factor * value

    lengths = {"origin", "edge_u", "edge_v", "center", "radius", "vertices", "size"}
    shapes = []
    for shape in scene.shapes:
        update = {name: times(getattr(shape, name)) for name in lengths & set(type(shape).model_fields)}
        if shape.transform is not None:
            update["transform"] = shape.transform.model_copy(update={"translate": times(shape.transform.translate)})
        shapes.append(shape.model_copy(update=update))
    camera = {name: times(getattr(scene.camera, name)) for name in ("position", "target")}
    return scene.model_copy(update={"shapes": tuple(shapes), "camera": scene.camera.model_copy(update=camera)})


@pytest.mark.parametrize("factor", [1e-3, 1e4])
def test_scaled_scene_gives_the_same_image(evidence: Evidence, studio: Studio, factor: float) -> None:
    """The same tiles, and no acne or leak that would shift them."""
    scene = clrender.load("room")
    larger = scaled(scene, factor)
    plain = studio.tiles(scene, range(16), spp=32, max_depth=4)
    evidence.equal("tiles", plain, studio.tiles(larger, range(100, 116), spp=32, max_depth=4))
    # With the same seed the same numbers are drawn, so nearly every path is the same path.
    same: npt.NDArray[np.float64] = studio.tiles(larger, range(2), spp=32, max_depth=4)
    np.testing.assert_allclose(same, plain[:2], rtol=1e-3)
