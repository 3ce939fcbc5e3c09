#!/usr/bin/env python3
"""What adaptive sampling could gain: relative MSE of an even allocation over that of one by the noise of each block.

Usage: adaptive_gain.py [SCENE ...]; `docs/notes/adaptive.md` has its results.
"""

from __future__ import annotations

import argparse
from typing import Final

import numpy as np
import numpy.typing as npt

import clrender

SIDE: Final = 64
SPP: Final = 16
"""Samples per pixel of a replicate, an image with its own seed and so its own sample points."""
REPLICATES: Final = 192
BUDGET: Final = 64
"""Replicates per pixel of a uniform allocation."""
PILOT: Final = 16
"""Of these, the replicates that determine the allocation of the others."""
DRAWS: Final = 20
"""Number of pilots drawn from all replicates."""
BLOCK: Final = 4

SCENES: Final = ("room", "cornell", "product", "textures", "candles", "haze", "caustic")

Array = npt.NDArray[np.float64]


def replicates(session: clrender.Session, name: str) -> Array:
    """Mean of the three channels of each replicate: (REPLICATES, SIDE, SIDE) float64."""
    scene = clrender.load(name)
    size = (SIDE, SIDE)
    images = [
        session.render(scene, seed=1000 + number, size=size, spp=SPP, keep_film=False).linear
        for number in range(REPLICATES)
    ]
    grey: Array = np.stack(images).mean(-1).astype(np.float64)
    return grey


def relative_variance(images: Array) -> Array:
    """Variance of one replicate over the squared mean, per pixel, as in the relative MSE."""
    mean = images.mean(0)
    variance: Array = images.var(0, ddof=1) / (mean**2 + 1e-2 * mean.mean() ** 2)
    return variance


def blocks(values: Array) -> Array:
    """Means over blocks of pixels, the smallest unit of work."""
    means: Array = values.reshape(SIDE // BLOCK, BLOCK, SIDE // BLOCK, BLOCK).mean((1, 3))
    return means


def ideal_gain(variance: Array) -> float:
    """Gain with known variances, and the optimal allocation in proportion to their square roots."""
    return float(variance.mean() / np.sqrt(variance).mean() ** 2)


def gain(images: Array, random: np.random.Generator) -> float:
    """Gain with variances estimated by a pilot, combined with the rest by weights fixed in advance, so that the mean is
    unbiased (Kirk and Arvo, "Unbiased Sampling Techniques for Image Synthesis", SIGGRAPH 1991)."""
    order = random.permutation(len(images))
    pilot, others = images[order[:PILOT]], images[order[PILOT:]]
    true, seen = blocks(relative_variance(others)), blocks(relative_variance(pilot))
    padded = np.pad(seen, 1, mode="edge")
    seen = np.lib.stride_tricks.sliding_window_view(padded, (3, 3)).mean((-1, -2))
    wanted = np.sqrt(seen + 0.1 * seen.mean())
    rest = BUDGET - PILOT
    allocated = rest * wanted / wanted.mean()
    combined = (PILOT / BUDGET) ** 2 * true / PILOT + (rest / BUDGET) ** 2 * true / allocated
    return float(true.mean() / BUDGET / combined.mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", default=SCENES, metavar="SCENE")
    print("| scene | ideal, pixels | ideal, blocks | by a pilot |\n|---|---:|---:|---:|")
    with clrender.Session() as session:
        for name in parser.parse_args().scenes:
            images = replicates(session, name)
            variance = relative_variance(images)
            random = np.random.default_rng(1)
            gained = float(np.mean([gain(images, random) for _ in range(DRAWS)]))
            best = ideal_gain(variance), ideal_gain(blocks(variance))
            print(f"| `{name}` | {best[0]:.2f} | {best[1]:.2f} | {gained:.2f} |")


if __name__ == "__main__":
    main()
