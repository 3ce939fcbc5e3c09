"""Polygons as triangles: the triangles cover each polygon exactly once, whatever its shape."""

from __future__ import annotations

import math
import warnings

import numpy as np
import numpy.typing as npt
import pytest
from cases import for_each
from hypothesis import given, settings
from hypothesis import strategies as st

from clrender.errors import SceneError
from clrender.meshes.polygons import CORNER_LIMIT, triangulate

Points = npt.NDArray[np.float64]

L_SHAPE = [(0.0, 0.0), (1.0, 0.0), (1.0, 0.25), (0.25, 0.25), (0.25, 1.0), (0.0, 1.0)]
U_SHAPE = [(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)]
COMB = [(0, 0), (9, 0), (9, 5), (8, 1), (7, 5), (6, 1), (5, 5), (4, 1), (3, 5), (2, 1), (1, 5)]
DART = [(0, 0), (4, 1), (0, 2), (1, 1)]
# A square with a square hole, joined by a bridge that is walked both ways.
KEYHOLE = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)]
ON_A_LINE = [(0, 0), (1, 0), (2, 0), (4, 0), (4, 4), (2, 4), (2, 2), (0, 2)]


def spiral(turns: int) -> list[tuple[float, float]]:
    """A band that winds inwards: hardly any fan, and few ears at a time."""
    angles = np.linspace(0.0, 2.0 * np.pi * turns, 24 * turns)
    outer = [(math.cos(a) * (10 - a / 7), math.sin(a) * (10 - a / 7)) for a in angles]
    return outer + [(0.96 * x, 0.96 * y) for x, y in reversed(outer)]


def area(points: Points) -> float:
    """Area of a polygon in its plane."""
    relative = points - points[0]
    return float(np.linalg.norm(np.cross(relative[1:-1], relative[2:]).sum(axis=0))) / 2.0


def check(points: Points) -> None:
    """The areas of the triangles add up to that of the polygon, from every first corner and both ways round."""
    count = len(points)
    expected = area(points)
    for order in (np.arange(count), np.arange(count)[::-1]):
        for first in range(min(count, 12)):
            corners = np.roll(order, first)
            triangles, crossed = triangulate(points, corners, np.array([count]), "m")
            assert crossed == 0 and triangles.shape == (count - 2, 3)
            assert set(triangles.ravel().tolist()) == set(range(count))
            a, b, c = np.moveaxis(points[corners[triangles]], 1, 0)
            assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(expected, rel=1e-5)


@for_each("shape", [L_SHAPE, U_SHAPE, COMB, DART, KEYHOLE, ON_A_LINE, spiral(3)])
@for_each("turned", [False, True])
def test_concave_polygons_are_covered_once(shape: list[tuple[float, float]], turned: bool) -> None:
    points = np.array([(x, y, 0.0) for x, y in shape])
    if turned:
        axes = np.linalg.qr(np.array([[1.0, 2.0, 0.5], [0.3, 1.0, 2.0], [2.0, -1.0, 1.0]]))[0]
        points = points @ axes * 1e-3 + [5.0, -7.0, 11.0]
    check(points)


def test_the_area_of_an_l_is_exact() -> None:
    points = np.array([(x, y, 0.0) for x, y in L_SHAPE])
    for first in range(6):
        corners = np.roll(np.arange(6), first)
        triangles = points[corners[triangulate(points, corners, np.array([6]), "m")[0]]]
        twice = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])[:, 2]
        assert (twice > 0.0).all() and twice.sum() / 2 == 0.4375


@settings(max_examples=40, deadline=None, derandomize=True)
@given(radii=st.lists(st.floats(0.05, 1.0), min_size=3, max_size=40), seed=st.integers(0, 2**32 - 1))
def test_random_star_shaped_polygons(radii: list[float], seed: int) -> None:
    angles = 2.0 * np.pi * (np.arange(len(radii)) + np.random.default_rng(seed).uniform(0, 0.9, len(radii)))
    angles /= len(radii)
    check(np.stack([np.cos(angles) * radii, np.sin(angles) * radii, 0.0 * angles], axis=1))


def test_convex_polygons_are_fans_from_their_first_corner() -> None:
    sizes = np.array([3, 4, 7, 3, 5])
    rounds = [np.linspace(0, 2 * np.pi, n, endpoint=False) for n in sizes]
    points = np.concatenate([np.stack([np.cos(a), np.sin(a), 0.3 * np.cos(a)], axis=1) for a in rounds])
    found, crossed = triangulate(points, np.arange(len(points)), sizes, "m")
    assert crossed == 0
    first = np.cumsum(sizes) - sizes
    expected = [(at, at + i, at + i + 1) for at, n in zip(first, sizes, strict=True) for i in range(1, n - 1)]
    assert found.tolist() == [list(map(int, triangle)) for triangle in expected]


def test_outlines_that_cross_or_have_no_area_are_fans() -> None:
    fan = [[0, 1, 2], [0, 2, 3]]
    bow_tie, line = [(0, 0, 0), (1, 1, 0), (1, 0, 0), (0, 1, 0)], [(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)]
    for shape, expected in ((bow_tie, 1), (line, 0)):
        triangles, crossed = triangulate(np.array(shape, float), np.arange(4), np.array([4]), "m")
        assert triangles.tolist() == fan and crossed == expected


def test_huge_polygons() -> None:
    angles = np.linspace(0, 2 * np.pi, CORNER_LIMIT + 10, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    assert len(triangulate(circle, np.arange(len(circle)), np.array([len(circle)]), "m")[0]) == CORNER_LIMIT + 8
    with pytest.raises(SceneError, match=f"m has a concave polygon of {CORNER_LIMIT + 10} corners"):
        triangulate(circle * (1 + 0.5 * (np.arange(len(circle)) % 2))[:, None], np.arange(len(circle)),
                    np.array([len(circle)]), "m")  # fmt: skip


@pytest.mark.parametrize("far", [1e200, 1e300, math.inf])
def test_coordinates_out_of_range_warn_of_nothing(far: float) -> None:
    """Whoever reads the file refuses them, in one sentence."""
    line = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [far, 0.0, 0.0], [3.0, 0.0, 0.0], [4.0, 0.0, 0.0]])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        triangulate(line, np.arange(5), np.array([5]), "mesh")
