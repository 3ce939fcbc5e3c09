"""Surfaces and media that absorb nearly nothing: the mean is right and the variance small, however long light stays."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from render_support import Studio, lambert, scene, sphere
from stats_support import Evidence

import clrender

if TYPE_CHECKING:
    from clrender.scene import Scene

SLOW = pytest.mark.slow
WITHIN = {"position": [0.0, 0.0, -0.5], "target": [0.0, 0.0, 1.0]}
OUTSIDE = {"position": [0.0, 0.0, -4.0], "target": [0.0, 0.0, 0.0], "vertical_fov": 10.0}
WHITE_SKY = {"type": "environment", "radiance": [1.0, 1.0, 1.0]}
SEEDS = 8
SPP = 64


def integrating_sphere(albedo: float) -> Scene:
    """Lit by a lamp of 1 W/sr at its centre: radiance is ρ / (π (1 − ρ)) everywhere."""
    shell = sphere((0.0, 0.0, 0.0), 1.0, flip_normals=True, material="wall")
    lamp = {"type": "point", "position": [0.0, 0.0, 0.0], "intensity": [1.0, 1.0, 1.0]}
    return scene([shell], [lamp], WITHIN, wall=lambert(albedo))


def cloud(paths: float, glass: bool) -> Scene:
    """A ball in a white environment, of so many mean free paths to its centre: radiance is 1 everywhere."""
    ball: dict[str, Any] = {"interior": "cloud", **({"material": "glass"} if glass else {})}
    return clrender.Scene(
        camera=OUTSIDE,
        shapes=[sphere((0.0, 0.0, 0.0), 1.0, **ball)],
        lights=[WHITE_SKY],
        media={"cloud": {"scattering": paths}},
        materials={"glass": {"type": "dielectric", "ior": 1.5}} if glass else {},
    )


def fog(paths: float) -> Scene:
    """Within a shining ball full of fog, so many mean free paths to its centre: radiance is 1 everywhere."""
    wall = sphere((0.0, 0.0, 0.0), 1.0, flip_normals=True, material="wall", emission=[0.4, 0.4, 0.4])
    return clrender.Scene(
        camera=WITHIN,
        shapes=[wall],
        lights=[],
        materials={"wall": lambert(0.6)},
        media={"fog": {"scattering": paths}},
        fog="fog",
    )


def judge(evidence: Evidence, studio: Studio, what: Scene, exact: float, size: int, **settings: Any) -> None:
    """The mean, by pixels of all seeds; and what each sample adds to the square of the relative error."""
    pixels = np.array([studio.pixels(what, size, spp=SPP, seed=seed, **settings) for seed in range(SEEDS)])
    evidence.mean_is("radiance", pixels.ravel(), exact, rounding=2e-3)
    squares = np.square(pixels / exact - 1.0) * SPP
    evidence.note("relMSE x spp", float(squares.mean()))
    assert squares.mean() <= 2.0
    error = pixels.std(ddof=1) / math.sqrt(pixels.size)
    assert abs(pixels.mean() - exact) <= 3.5 * error + 2e-3 * exact


@pytest.mark.parametrize(
    "albedo", [0.9, 0.98, 0.99, 0.995, pytest.param(0.999, marks=SLOW), pytest.param(0.9999, marks=SLOW)]
)
def test_integrating_spheres(evidence: Evidence, studio: Studio, albedo: float) -> None:
    judge(evidence, studio, integrating_sphere(albedo), albedo / (math.pi * (1.0 - albedo)), 4 if albedo > 0.99 else 6)


@pytest.mark.parametrize("glass", [False, pytest.param(True, marks=SLOW)], ids=["bare", "in glass"])
@pytest.mark.parametrize("paths", [10.0, pytest.param(100.0, marks=SLOW), pytest.param(1000.0, marks=SLOW)])
def test_white_clouds(evidence: Evidence, studio: Studio, paths: float, glass: bool) -> None:
    judge(evidence, studio, cloud(paths, glass), 1.0, 4 if paths > 10.0 else 6)


@pytest.mark.parametrize("paths", [1.0, 20.0])
def test_white_fog(evidence: Evidence, studio: Studio, paths: float) -> None:
    """Each free path weighs something else than 1, where distances are also sampled about a lamp."""
    judge(evidence, studio, fog(paths), 1.0, 4)
