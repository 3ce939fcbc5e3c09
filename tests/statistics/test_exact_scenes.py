"""The built-in scenes with an exact answer, and variants of them, against that answer.

Samples of one pixel are not independent (they are stratified), renders with other seeds are: those are the batches.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from significance import assert_means

import clrender

BATCHES = 12


def estimates(scene: clrender.Scene, size: int = 12, spp: int = 32, **settings: Any) -> npt.NDArray[np.float64]:
    """Mean radiance of the image for each of `BATCHES` seeds: (n, 3)."""
    images = [
        clrender.render(scene, device="pocl", size=(size, size), spp=spp, seed=seed, **settings)
        for seed in range(BATCHES)
    ]
    assert all(image.stats["nonfinite_samples"] == 0 for image in images)
    return np.array([image.linear.mean(axis=(0, 1), dtype=np.float64) for image in images])


def seen_through(scene: clrender.Scene, **camera: Any) -> clrender.Scene:
    """The scene with another camera."""
    return scene.model_copy(update={"camera": scene.camera.model_copy(update=camera)})


def with_material(scene: clrender.Scene, name: str, **values: Any) -> clrender.Scene:
    """The scene with another value in a material."""
    material = scene.materials[name].model_copy(update=values)
    return scene.model_copy(update={"materials": {**scene.materials, name: material}})


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_furnace(share: float) -> None:
    scene = with_material(clrender.load("furnace"), "wall", reflectance=(share, share, share))
    assert_means(estimates(scene), 1.0 / (1.0 - share), f"closed sphere, reflectance {share}")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("furnace-room", 5.0),
        ("furnace-sphere", 1.0),
        ("furnace-glass", 1.0),
        ("inside-sphere", 10.0 / (4.0 * math.pi)),
        ("directional-plane", 0.4270612),
        ("mirror-light", 4.0),
        ("slab", 12.0 / 13.0),
    ],
)
def test_uniform_scene(name: str, expected: float) -> None:
    assert_means(estimates(clrender.load(name)), expected, name, rounding=1e-5)


@pytest.mark.parametrize("sampling", ["both", "lights", "materials"])
@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("quad-plane", 0.5 * 10.0 * 4.0 / math.pi / math.sqrt(5.0) * math.atan(1.0 / math.sqrt(5.0))),
        ("sphere-plane", 0.8),
        ("point-plane", 5.0 / (4.0 * math.pi)),
    ],
)
def test_light_over_a_plane(name: str, expected: float, sampling: str) -> None:
    """At the middle of the image; a view of 0.02 degrees sees 1.5 mm of the plane, which changes the answer by 1e-6."""
    scene = seen_through(clrender.load(name), vertical_fov=0.02)
    assert_means(estimates(scene, spp=64, sampling=sampling), expected, f"{name}, {sampling}", rounding=1e-5)


def off_axis_quad(x: float, z: float) -> float:
    """Form factor of the square [-½, ½]² at height 1 seen from (x, 0, z) on a plane: Lambert's polygon formula."""
    corners = np.array([[-0.5, 1, -0.5], [0.5, 1, -0.5], [0.5, 1, 0.5], [-0.5, 1, 0.5]]) - [x, 0.0, z]
    unit = corners / np.linalg.norm(corners, axis=1, keepdims=True)
    total = 0.0
    for a, b in zip(unit, np.roll(unit, -1, axis=0), strict=True):
        normal = np.cross(a, b)
        total += math.acos(float(a @ b)) * normal[1] / float(np.linalg.norm(normal))
    return abs(total) / (2.0 * math.pi)


@pytest.mark.parametrize("place", [(0.0, 0.0), (0.7, 0.2), (-2.0, 1.0), (4.0, -3.0)])
def test_polygon_formula_off_axis(place: tuple[float, float]) -> None:
    x, z = place
    scene = seen_through(clrender.load("quad-plane"), position=(x, 0.5, z + 2.0), target=(x, 0.0, z), vertical_fov=0.02)
    assert_means(
        estimates(scene, spp=64), 0.5 * 10.0 * off_axis_quad(x, z), f"square light from {place}", rounding=1e-5
    )


# Ways to find the same light; each against the plain one by Welch's test on independent seeds, tile by tile.
WAYS: dict[str, dict[str, Any]] = {
    "two shadow rays": {"shadow_rays": 2},
    "four shadow rays": {"shadow_rays": 4},
    "five indirect rays": {"indirect_rays": 5},
    "no roulette to depth 60": {"roulette": "none", "max_depth": 60},
    "absorption 0.3": {"roulette": "absorption", "absorption": 0.3},
    "absorption by material": {"roulette": "absorption"},
    "lights alone": {"sampling": "lights"},
    "shadow and indirect rays": {"shadow_rays": 3, "indirect_rays": 2},
}


def tiles(scene: clrender.Scene, seeds: range, **settings: Any) -> npt.NDArray[np.float64]:
    """Mean radiance of a 3 x 3 grid of tiles, the channels averaged, for each seed: (n, 9)."""
    result = []
    for seed in seeds:
        linear = clrender.render(scene, device="pocl", size=(48, 48), spp=32, seed=seed, **settings).linear
        result.append(linear.reshape(3, 16, 3, 16, 3).mean(axis=(1, 3, 4), dtype=np.float64).reshape(-1))
    return np.array(result)


@pytest.mark.parametrize("way", WAYS)
def test_ways_agree(way: str) -> None:
    # The Cornell box: diffuse, so that no caustic makes the estimates' distribution long-tailed.
    scene = clrender.load("cornell")
    plain, other = tiles(scene, range(16)), tiles(scene, range(100, 116), **WAYS[way])
    assert_means(plain - other, 0.0, way)


def test_depth_counts_scattering_events() -> None:
    """In a furnace the radiance with at most n scattering events is e (1 + a + … + a^n)."""
    scene = clrender.load("furnace")
    for depth in range(4):
        expected = sum(0.5**k for k in range(depth + 1))
        assert_means(estimates(scene, max_depth=depth, roulette="none"), expected, f"depth {depth}", rounding=1e-5)


def test_direct_is_path_without_indirect_rays() -> None:
    scene = clrender.load("room")
    direct = clrender.render(scene, device="pocl", size=(40, 40), spp=4, integrator="direct")
    path = clrender.render(scene, device="pocl", size=(40, 40), spp=4, indirect_rays=0)
    assert direct.stats["image_sha256"] == path.stats["image_sha256"]


def test_whitted_is_direct_where_lights_are_points() -> None:
    scene = clrender.load("point-plane")
    whitted = clrender.render(scene, device="pocl", size=(32, 32), spp=4, integrator="whitted")
    direct = clrender.render(scene, device="pocl", size=(32, 32), spp=4, integrator="direct")
    np.testing.assert_allclose(whitted.linear, direct.linear, rtol=1e-5)


@pytest.mark.parametrize("factor", [1e-3, 1e4])
def test_scaled_scene_gives_the_same_image(factor: float) -> None:
    """Geometry times a factor, radiance kept: the same tiles, and no acne or leak that would shift them."""

    def scaled(shape: Any) -> Any:
        names = {"origin", "edge_u", "edge_v", "center", "radius", "vertices", "size"} & set(type(shape).model_fields)
        update: dict[str, Any] = {}
        for name in names:
            value = np.asarray(getattr(shape, name), float) * factor
            update[name] = float(value) if value.ndim == 0 else _tuples(value.tolist())
        moved = shape.transform
        if moved is not None:
            translate = tuple(factor * x for x in moved.translate)
            update["transform"] = moved.model_copy(update={"translate": translate})
        return shape.model_copy(update=update)

    scene = clrender.load("room")
    camera = scene.camera
    larger = scene.model_copy(
        update={
            "shapes": tuple(scaled(shape) for shape in scene.shapes),
            "camera": camera.model_copy(
                update={
                    "position": tuple(factor * x for x in camera.position),
                    "target": tuple(factor * x for x in camera.target),
                }
            ),
        }
    )
    plain, other = tiles(scene, range(16), max_depth=4), tiles(larger, range(100, 116), max_depth=4)
    assert_means(plain - other, 0.0, f"scale {factor}")
    # With the same seed the same numbers are drawn, so nearly every path is the same path.
    np.testing.assert_allclose(tiles(larger, range(2), max_depth=4), plain[:2], rtol=1e-3)


def _tuples(value: Any) -> Any:
    return tuple(_tuples(each) for each in value) if isinstance(value, list) else value
