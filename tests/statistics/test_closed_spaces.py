"""Radiance that is the same everywhere: furnaces, what is invisible in uniform light, lights inside spheres."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest
from render_support import Studio, lambert, quad, scene, sphere
from stats_support import Evidence

import clrender

if TYPE_CHECKING:
    from clrender.scene import Scene

INSIDE = {"position": [0.2, -0.1, 0.3], "target": [1.0, 0.4, -0.5], "vertical_fov": 90.0}
OUTSIDE = {"position": [0.0, 0.0, 4.0], "target": [0.0, 0.0, 0.0], "vertical_fov": 40.0}
WHITE_SKY = {"type": "environment", "radiance": [1.0, 1.0, 1.0]}


def uniform(evidence: Evidence, studio: Studio, what: Scene, exact: float, spp: int = 32, **settings: Any) -> None:
    """Every part of the image is `exact`, and so is its mean: pixels are the batches, because all see the same."""
    patches = studio.patches(what, spp=spp, **settings)
    evidence.mean_is("patches", patches, exact)
    evidence.mean_is("image", patches.ravel(), exact)


def every_pixel(evidence: Evidence, studio: Studio, what: Scene, exact: float, **settings: Any) -> None:
    """Where nothing is left to chance every single pixel is `exact`, but for rounding."""
    evidence.mean_is("pixels", [studio.pixels(what, 48, spp=8, seed=seed, **settings) for seed in range(8)], exact)


def furnace(kind: str, reflectance: float, emission: float) -> Scene:
    """A closed space that emits and reflects, seen from inside."""
    common = {"material": "wall", "emission": [emission] * 3, "flip_normals": True}
    shape: dict[str, Any] = {"type": "box", "center": [0.0, 0.0, 0.0], "size": [2.0, 1.5, 3.0], **common}
    if kind == "sphere":
        shape = sphere([0.0, 0.0, 0.0], 1.0, **common)
    if kind == "tetrahedron":
        corners = [[3.0, 3.0, 3.0], [3.0, -3.0, -3.0], [-3.0, 3.0, -3.0], [-3.0, -3.0, 3.0]]
        shape = {"type": "tetrahedron", "vertices": corners, **common}
    return scene([shape], camera=INSIDE, wall=lambert(reflectance))


@pytest.mark.thorough
@pytest.mark.parametrize("reflectance", [0.2, 0.5, 0.8])
@pytest.mark.parametrize("kind", ["sphere", "box", "tetrahedron"])
def test_furnace(evidence: Evidence, studio: Studio, kind: str, reflectance: float) -> None:
    # e / (1 - a): emission, and the share a of all that arrives. What lies beyond 80 events is less than 2e-8 of it.
    exact = 0.75 / (1.0 - reflectance)
    uniform(evidence, studio, furnace(kind, reflectance, 0.75), exact, roulette="none", max_depth=80)


@pytest.mark.parametrize("roulette", ["throughput", "constant"])
@pytest.mark.parametrize("reflectance", [0.2, 0.5, 0.8])
def test_furnace_with_roulette(evidence: Evidence, studio: Studio, reflectance: float, roulette: str) -> None:
    # Only the image as a whole: few paths survive, so a patch of it is not near to normally distributed.
    pixels = studio.pixels(furnace("box", reflectance, 1.0), 64, spp=128, roulette=roulette)
    evidence.mean_is("image", pixels, 1.0 / (1.0 - reflectance))


def test_furnace_lit_by_sampled_lights_alone(evidence: Evidence, studio: Studio) -> None:
    # Not in a box: near its edges that estimator has no variance that would let it be judged.
    uniform(evidence, studio, furnace("sphere", 0.5, 1.0), 2.0, sampling="light", roulette="none", max_depth=60)


@pytest.mark.parametrize("kind", ["sphere", "box", "tetrahedron"])
def test_furnace_lit_by_sampled_materials_alone(evidence: Evidence, studio: Studio, kind: str) -> None:
    what = furnace(kind, 0.5, 1.0)
    every_pixel(evidence, studio, what, 2.0, sampling="bsdf", roulette="none", max_depth=60)


@pytest.mark.parametrize("reflectance", [0.2, 0.5, 0.8])
@pytest.mark.parametrize("depth", [0, 1, 2, 5])
def test_furnace_cut_off(evidence: Evidence, studio: Studio, depth: int, reflectance: float) -> None:
    # e (1 + a + ... + a^n): depth n is n scattering events at most.
    exact = (1.0 - reflectance ** (depth + 1)) / (1.0 - reflectance)
    uniform(evidence, studio, furnace("box", reflectance, 1.0), exact, max_depth=depth, roulette="none")


def test_furnace_of_colours(evidence: Evidence, studio: Studio) -> None:
    # Each channel on its own: (1, 2, 4) / (1 - (0.8, 0.5, 0.2)) = (5, 4, 5).
    box = {"type": "box", "center": [0.0, 0.0, 0.0], "size": [2.0, 2.0, 2.0], "material": "wall", "flip_normals": True}
    what = scene([{**box, "emission": [1.0, 2.0, 4.0]}], camera=INSIDE, wall=lambert([0.8, 0.5, 0.2]))
    picture = studio.image(what, 64, spp=32, roulette="none", max_depth=120)
    for channel, exact in enumerate((5.0, 4.0, 5.0)):
        evidence.mean_is(f"channel {channel}", picture[..., channel].ravel(), exact)


@pytest.mark.parametrize("name, exact", [("furnace", 2.0), ("furnace-room", 5.0)])
def test_built_in_furnaces(evidence: Evidence, studio: Studio, name: str, exact: float) -> None:
    evidence.mean_is("image", studio.pixels(clrender.load(name), 64, spp=128), exact)


@pytest.mark.parametrize("name", ["furnace-sphere", "furnace-glass"])
def test_invisible_in_white_surroundings(evidence: Evidence, studio: Studio, name: str) -> None:
    what = clrender.load(name)
    uniform(evidence, studio, what, 1.0, 64)
    every_pixel(evidence, studio, what, 1.0, sampling="bsdf", roulette="none", max_depth=1000)


@pytest.mark.parametrize(
    "shape, material",
    [
        (sphere([0.0, 0.0, 0.0], 1.0), {"type": "mirror"}),
        ({"type": "box", "size": [1.2, 1.2, 1.2]}, lambert(1.0)),
        ({"type": "box", "size": [1.2, 1.2, 1.2]}, {"type": "dielectric", "ior": 1.5}),
        (sphere([0.0, 0.0, 0.0], 1.0), {"type": "dielectric", "ior": 2.4, "exterior_ior": 1.33}),
        (sphere([0.0, 0.0, 0.0], 1.0), {"type": "dielectric", "ior": 0.6}),
        ({"type": "disk", "normal": [0.1, 0.2, 1.0], "radius": 1.0}, lambert(1.0)),
    ],
    ids=["mirror sphere", "white box", "glass box", "dense glass", "bubble", "white disk"],
)
def test_what_loses_nothing_is_invisible(
    evidence: Evidence, studio: Studio, shape: dict[str, Any], material: dict[str, Any]
) -> None:
    turned = {**shape, "material": "it"}
    if shape["type"] == "box":
        turned["transform"] = {"rotate_degrees": [20.0, 30.0, 40.0]}
    what = scene([turned], [WHITE_SKY], OUTSIDE, it=material)
    # Light that total reflection keeps inside a box for long must not be cut off: no roulette, no limit that counts.
    uniform(evidence, studio, what, 1.0, 64, roulette="none", max_depth=1000)
    every_pixel(evidence, studio, what, 1.0, sampling="bsdf", roulette="none", max_depth=1000)


def test_two_spheres_that_lose_nothing_are_invisible(evidence: Evidence, studio: Studio) -> None:
    # Nearly touching, so that light goes to and fro between them.
    shapes = [sphere([-0.6, 0.0, 0.0], 0.59, material="white"), sphere([0.6, 0.0, 0.0], 0.6, material="glass")]
    what = scene(shapes, [WHITE_SKY], OUTSIDE, white=lambert(1.0), glass={"type": "dielectric", "ior": 1.5})
    uniform(evidence, studio, what, 1.0)


@pytest.mark.long
@pytest.mark.parametrize("material", [lambert(1.0), {"type": "mirror"}, {"type": "dielectric", "ior": 1.5}])
def test_invisible_in_a_furnace(evidence: Evidence, studio: Studio, material: dict[str, Any]) -> None:
    # A ball that loses nothing in a box that emits e and reflects a: e / (1 - a) everywhere, on the ball as well.
    box = {"type": "box", "size": [2.0, 1.5, 3.0], "material": "wall", "emission": [1.0] * 3, "flip_normals": True}
    ball = sphere([0.5, 0.2, -0.5], 0.3, material="it")
    what = scene([box, ball], camera=INSIDE, wall=lambert(0.4), it=material)
    uniform(evidence, studio, what, 1.0 / 0.6, roulette="none", max_depth=200)


def test_point_light_inside_a_sphere(evidence: Evidence, studio: Studio) -> None:
    # scenes/inside-sphere.toml: a I / (pi R^2 (1 - a)).
    what, exact = clrender.load("inside-sphere"), 10.0 / (4.0 * math.pi)
    every_pixel(evidence, studio, what, exact, roulette="none", max_depth=60)
    evidence.mean_is("image", studio.pixels(what, 64, spp=128), exact)


@pytest.mark.parametrize("sampling", ["mis", "light", "bsdf"])
def test_sphere_light_inside_a_sphere(evidence: Evidence, studio: Studio, sampling: str) -> None:
    # Radiosity of two concentric spheres, share F = (r/R)^2 of what leaves the outer one meets the inner one:
    # B_in = E + b B, B = a (F B_in + (1 - F) B), so B = a F E / (1 - a (1 - F) - a b F).
    a, b, ratio = 0.6, 0.3, 0.5
    shapes = [
        sphere([0.0, 0.0, 0.0], 2.0, material="outer", flip_normals=True),
        sphere([0.0, 0.0, 0.0], 2.0 * ratio, material="inner", emission=3.0),
    ]
    camera = {"position": [1.5, 0.1, 0.2], "target": [3.0, 0.4, 0.0], "vertical_fov": 60.0}
    share = ratio**2
    exact = a * share * 3.0 / (1.0 - a * (1.0 - share) - a * b * share)
    what = scene(shapes, camera=camera, outer=lambert(a), inner=lambert(b))
    uniform(evidence, studio, what, exact, sampling=sampling, roulette="none", max_depth=60)


def test_half_a_sphere_on_a_mirror_is_a_whole_one(evidence: Evidence, studio: Studio) -> None:
    # The mirror completes the half that emits e and reflects a: e / (1 - a) again, seen in the mirror too.
    shapes = [
        sphere([0.0, 0.0, 0.0], 1.0, material="wall", flip_normals=True, emission=1.0),
        quad([-2.0, 0.0, 2.0], [4.0, 0.0, 0.0], [0.0, 0.0, -4.0], material="mirror"),
    ]
    camera = {"position": [0.1, 0.4, 0.2], "target": [1.0, 0.1, -0.5], "vertical_fov": 90.0}
    what = scene(shapes, camera=camera, wall=lambert(0.5), mirror={"type": "mirror"})
    uniform(evidence, studio, what, 2.0, roulette="none", max_depth=60)
