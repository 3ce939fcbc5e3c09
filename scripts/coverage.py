#!/usr/bin/env python3
"""How often confidence intervals hold what they should, at the end that `--error` chose: many seeds, small images.

Usage: coverage.py [--seeds N] [--side N] [--error E] [SCENE ...]; docs/errors.md has its results. For each scene, of
pixels and of the image's mean: the share of the seeds whose interval holds the truth, that of a long render.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

import clrender
from clrender.film.convergence import judge
from clrender.film.replicates import image_error, replicate_counts
from clrender.settings import RenderSettings
from clrender.statistics.student_t import critical_value

SCENES: Final = {"room": 0.6, "lens": 0.4, "candles": 0.8, "textures": 0.1, "haze": 0.8}
"""Scenes and the error at which they end: after about 500 samples of each pixel."""
REFERENCE_SPP: Final = 1 << 17
ROUNDING: Final = 1e-6
"""Relative error of single precision, which the spread does not include."""

LENS: Final = """
title = "A caustic that paths find: a glass ball between a large light and a floor"
[camera]
position = [0.0, 1.6, -3.0]
target = [0.0, 0.2, 0.0]
vertical_fov = 40.0
[materials.white]
type = "lambert"
reflectance = [0.7, 0.7, 0.7]
[materials.glass]
type = "dielectric"
ior = 1.5
[[shapes]]
type = "quad"
origin = [-3.0, 0.0, 3.0]
edge_u = [6.0, 0.0, 0.0]
edge_v = [0.0, 0.0, -6.0]
material = "white"
[[shapes]]
type = "sphere"
center = [0.0, 0.7, 0.0]
radius = 0.5
material = "glass"
[[shapes]]
type = "quad"
origin = [-1.5, 3.0, -1.5]
edge_u = [3.0, 0.0, 0.0]
edge_v = [0.0, 0.0, 3.0]
emission = [2.0, 2.0, 2.0]
"""

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Coverage:
    """Coverage for one scene.

    Attributes
    ----------
    planned : (pixels,) float64
        Fraction of the seeds whose interval of the stopping rule contains the pixel's luminance.
    plain : (pixels,) float64
        Likewise for each channel's mean, by Student's interval of that level, as if there had been no earlier tests.
    mean : float
        Likewise for the image's mean, by the interval of the stopping rule.
    plain_mean : float
        Likewise for the image's mean, by 1.96 standard errors.
    bias : float
        Mean of pixels' deviations from the truth, in standard errors of one image.
    samples : float
        Mean number of samples per pixel at the end.
    """

    planned: Floats
    plain: Floats
    mean: float
    plain_mean: float
    bias: float
    samples: float


def scene_of(name: str) -> clrender.Scene:
    """A built-in scene, or `lens`."""
    if name != "lens":
        return clrender.load(name)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "lens.toml"
        path.write_text(LENS)
        return clrender.load(path)


def coverage(session: clrender.Session, name: str, seeds: int, side: int, error: float, **more: Any) -> Coverage:
    """Render a scene with many seeds, each until its own error is small enough."""
    scene = scene_of(name)
    weights = np.array([0.2126, 0.7152, 0.0722])
    how = {"size": (side, side), "error": error, **more}
    settings = RenderSettings(width=side, height=side, error=error, spp=16384, **more)
    reference = session.render(scene, size=(side, side), spp=REFERENCE_SPP, seed=2**31)
    truth = reference.linear.astype(np.float64)
    planned, plain, of_mean, plain_mean, offsets, samples = [], [], [], [], [], []
    for seed in range(seeds):
        image = session.render(scene, seed=seed, **how)
        found = judge(image.film, settings)
        mean = image.linear.astype(np.float64)
        off = np.abs(mean - truth)
        allowed = ROUNDING * np.abs(truth)
        planned.append(np.abs((mean - truth) @ weights) <= found.intervals + allowed @ weights)
        quantile = critical_value(1.0 - settings.confidence, replicate_counts(image.film)[..., None] - 1.0)
        plain.append((off <= quantile * found.errors + allowed).mean(axis=2))
        whole = np.abs((mean - truth).mean(axis=(0, 1)))
        of_mean.append((whole <= image.stats["mean_interval"]).mean())
        plain_mean.append((whole <= 1.96 * image_error(found.errors)).mean())
        offsets.append(mean - truth)
        samples.append(image.film.ledger.taken().mean())
    spread = np.std(offsets, axis=0, ddof=1)
    known = spread > ROUNDING * np.abs(truth).mean()
    bias = float((np.mean(offsets, axis=0)[known] / spread[known]).mean())
    return Coverage(
        np.mean(planned, axis=0).ravel(),
        np.mean(plain, axis=0).ravel(),
        float(np.mean(of_mean)),
        float(np.mean(plain_mean)),
        bias,
        float(np.mean(samples)),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", default=list(SCENES), metavar="SCENE")
    parser.add_argument("--seeds", type=int, default=400)
    parser.add_argument("--side", type=int, default=12)
    parser.add_argument("--error", type=float, help="of all scenes")
    arguments = parser.parse_args()
    print("| scene | samples | planned | its worst pixel | plain | its worst pixel | of the mean | plain | bias |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|---:|")
    with clrender.Session() as session:
        for name in arguments.scenes:
            error = arguments.error or SCENES[name]
            found = coverage(session, name, arguments.seeds, arguments.side, error)
            numbers = [found.planned.mean(), found.planned.min(), found.plain.mean(), found.plain.min()]
            numbers += [found.mean, found.plain_mean]
            words = " | ".join(f"{each:.3f}" for each in numbers)
            print(f"| `{name}` | {found.samples:.0f} | {words} | {found.bias:+.3f} |", flush=True)


if __name__ == "__main__":
    main()
