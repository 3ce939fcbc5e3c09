"""Means of textures over triangles by integrals along their edges, against what can be counted and many points."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import clrender
from clrender.flatten.texture_integrals import reflectance_means
from clrender.flatten.texture_means import TextureMeans
from clrender.flatten.texture_rows import flat_textures
from clrender.image.files import write_image
from clrender.radiosity.patches import Patches, cut_into_patches

Floats = npt.NDArray[np.float64]
GREY = {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]}
RNG = np.random.default_rng(17)
PICTURE = RNG.random((7, 9, 3)).astype(np.float32)
SQUARE = np.array([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]], float)


def texture(where: Path, reflectance: Any) -> TextureMeans:
    write_image(where / "p.exr", PICTURE)
    what = clrender.Scene(
        camera={"position": [0, 0, 3], "target": [0, 0, 0]},
        materials={"m": {"type": "lambert", "reflectance": reflectance}},
        shapes=({"type": "sphere", "radius": 1.0, "material": "m"},),
    )
    return TextureMeans(flat_textures(what.placed("here", where)), 0)


def middles(count: int) -> Floats:
    """Weights of the second and third corner of the middles of count² equal parts of a triangle."""
    i, j = (each.ravel() for each in np.meshgrid(np.arange(count), np.arange(count), indexing="ij"))
    upright, turned = i + j < count, i + j < count - 1
    parts = [np.stack([i[m] + k / 3, j[m] + k / 3], 1) for m, k in ((upright, 1), (turned, 2))]
    return np.concatenate(parts) / count


@pytest.mark.parametrize("wrap", [["repeat", "clamp"], ["mirror", "repeat"], ["clamp", "mirror"]], ids=str)
@pytest.mark.parametrize("filter_", ["nearest", "linear"])
def test_many_points_have_the_same_mean(tmp_path: Path, filter_: str, wrap: list[str]) -> None:
    """Large triangles, over rims and repetitions, and small ones inside a texel; either way round."""
    turned = {"rotate_degrees": 20.0, "scale": [1.5, 0.7], "offset": [0.1, -3.0]}
    t = texture(tmp_path, {"texture": "p.exr", "filter": filter_, "wrap": wrap, "transform": turned})
    corners = RNG.random((12, 3, 2)) * 3.0 - 1.0
    corners[6:] = corners[6:, :1] + RNG.random((6, 3, 2)) * 0.05
    exact = reflectance_means(t, corners)
    # A mean is the difference of integrals over the plane, divided by the triangle's area
    edges = corners[:, 1:] - corners[:, :1]
    areas = np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
    assert (np.abs(reflectance_means(t, corners[:, ::-1]) - exact) <= 1e-12 + 1e-14 / areas[:, None]).all()
    weights = middles(160)
    for triangle, mean in zip(corners, exact, strict=True):
        a, b, c = triangle
        points = a + (b - a) * weights[:, :1] + (c - a) * weights[:, 1:]
        many = np.stack(t._values(points[:, 0], points[:, 1]), axis=-1).mean(axis=0)
        # Each of some hundred edges of texels within is off by a share of the row of points that it runs through
        np.testing.assert_allclose(many, mean, atol=5e-3 if filter_ == "nearest" else 5e-5)


def test_a_whole_picture_has_its_mean(tmp_path: Path) -> None:
    for filter_ in ("nearest", "linear"):
        mean = reflectance_means(texture(tmp_path, {"texture": "p.exr", "filter": filter_}), SQUARE).mean(axis=0)
        np.testing.assert_allclose(mean, PICTURE.astype(np.float64).mean(axis=(0, 1)), rtol=1e-12)


def test_parts_add_up(tmp_path: Path) -> None:
    """However a triangle is cut: no part of a texel is counted twice or left out."""
    for filter_ in ("nearest", "linear"):
        t = texture(tmp_path, {"texture": "p.exr", "filter": filter_, "transform": {"rotate_degrees": 33.0}})
        parts = whole = np.array([[[0.1, -0.3], [1.9, 0.2], [0.4, 1.7]]])
        for _ in range(7):
            a, b, c = parts.transpose(1, 0, 2)
            middle = (a + b) / 2.0
            parts = np.concatenate([np.stack([c, a, middle], axis=1), np.stack([b, c, middle], axis=1)])
        np.testing.assert_allclose(reflectance_means(t, parts).mean(axis=0), reflectance_means(t, whole)[0], rtol=1e-12)


def test_halves_of_patches_have_means_of_their_own(tmp_path: Path) -> None:
    """Those that were not halved keep theirs; all are what a fresh start gives."""
    write_image(tmp_path / "p.exr", PICTURE)
    what = clrender.Scene(
        camera={"position": [0, 0, 3], "target": [0, 0, 0]},
        materials={"m": {"type": "lambert", "reflectance": {"texture": "p.exr"}}, "plain": GREY},
        shapes=(
            {"type": "sphere", "radius": 1.0, "material": "m"},
            {"type": "box", "size": [3, 3, 3], "material": "plain"},
        ),
    ).placed("here", tmp_path)
    patches = cut_into_patches(what, 300)
    assert patches.reflectance.std() > 0.1
    finer = patches.bisected(np.arange(len(patches)) % 3 == 0)
    assert "reflectance" in finer.__dict__
    fresh = Patches(finer.scene, finer.corners, finer.shape, finer.primitive)
    np.testing.assert_array_equal(finer.reflectance, fresh.reflectance)


def test_areas_of_a_checker(tmp_path: Path) -> None:
    """Half of the square is of each colour, and half of what is below its diagonal."""
    t = texture(tmp_path, {"checker": [0.25, 0.75], "size": 0.5})
    np.testing.assert_allclose(reflectance_means(t, SQUARE), 0.5, rtol=1e-12)
    # Of this triangle a quarter is above 1/2, where it is bright
    steep = np.array([[[0.0, 0.0], [0.5, 0.0], [0.5, 1.0]]])
    np.testing.assert_allclose(reflectance_means(t, steep), 0.25 * 0.75 + 0.75 * 0.25, rtol=1e-12)


def test_triangles_without_area_and_with_too_many_texels(tmp_path: Path) -> None:
    """Both take points: a line has a mean of texels along it, and what sees a picture often has nearly its mean."""
    t = texture(tmp_path, {"texture": "p.exr", "filter": "nearest"})
    line = np.array([[[0.0, 0.5], [1.0, 0.5], [0.5, 0.5]]])
    assert np.isfinite(reflectance_means(t, line)).all()
    point = np.full((1, 3, 2), 0.5)
    np.testing.assert_allclose(reflectance_means(t, point)[0], PICTURE[3, 4], rtol=1e-6)
    often = np.array([[[0.0, 0.0], [3000.0, 1.0], [10.0, 3000.0]]])
    np.testing.assert_allclose(reflectance_means(t, often)[0], PICTURE.mean(axis=(0, 1)), atol=0.02)


def test_numbers_beyond_one_count_as_one(tmp_path: Path) -> None:
    t = texture(tmp_path, {"texture": "p.exr", "filter": "nearest", "scale": 3.0})
    mean = reflectance_means(t, SQUARE).mean(axis=0)
    np.testing.assert_allclose(mean, np.minimum(PICTURE * 3.0, 1.0).mean(axis=(0, 1)), rtol=1e-6)
