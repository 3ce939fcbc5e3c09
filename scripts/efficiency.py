"""Compare the efficiency of two versions: `python scripts/efficiency.py measure DIRECTORY FILE`, then `compare`.

Efficiency is 1 / (relative variance × rays). `measure` renders scenes with many seeds by the package in DIRECTORY, a
checkout, and keeps the images and the numbers of rays; `compare` prints how much more efficient the second file is than
the first, with a 95 % confidence interval by bootstrap over seeds. Time does not come in, so other load does no harm.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

__all__: list[str] = []

SCENES: Final = """
    avenue bumpy candles caustic cornell drink fisheye foliage furnace-room haze lamps metals product room
    room-diffuse room-glass room-mirror room-report sky slab sundial surfaces textures
"""
RESAMPLES: Final = 2000

Floats = npt.NDArray[np.float64]


def measure(arguments: argparse.Namespace) -> None:
    """Render every scene with every seed, and write images and numbers of rays."""
    sys.path.insert(0, str(arguments.directory.resolve()))
    import clrender

    size, spp = arguments.size, arguments.spp
    kept: dict[str, Any] = dict(np.load(arguments.file)) if arguments.file.exists() else {}
    with clrender.Session() as session:
        for name in arguments.scenes or SCENES.split():
            scene = clrender.load(name)
            images, rays = [], []
            for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
                made = session.render(scene, size=(size, size), spp=spp, seed=seed)
                images.append(made.linear)
                rays.append(made.stats["rays"] + made.stats["shadow_rays"])
            kept[f"{Path(name).stem} images"] = np.array(images, np.float32)
            kept[f"{Path(name).stem} rays"] = np.array(rays, np.float64)
            print(f"{name}: {np.mean(rays) / (size * size * spp):.2f} rays per path", flush=True)
            np.savez(arguments.file, **kept)


def relative_variances(images: Floats, mean: Floats) -> Floats:
    """(seeds,) what each image adds to the relative variance: squared differences over the square of the mean."""
    floor = 0.01 * np.square(mean).mean()
    own = images.mean(axis=0)
    squares = np.square(images - own) / (np.square(mean) + floor)
    means: Floats = squares.reshape(len(images), -1).mean(axis=1)
    return means


def ratio(first: dict[str, Any], second: dict[str, Any], name: str) -> tuple[Floats, float, float]:
    """(RESAMPLES + 1,) efficiency of the second over the first, and resampled; ratios of variance and of rays."""
    both = [np.asarray(each[f"{name} images"], np.float64) for each in (first, second)]
    mean = np.concatenate(both).mean(axis=0)
    variances = [relative_variances(images, mean) for images in both]
    rays = [np.asarray(each[f"{name} rays"]) for each in (first, second)]
    count = len(rays[0])
    picks = np.random.default_rng(1).integers(0, count, (RESAMPLES + 1, count))
    picks[0] = np.arange(count)
    sums = [(v[picks].mean(axis=1), r[picks].mean(axis=1)) for v, r in zip(variances, rays, strict=True)]
    efficiency = (sums[0][0] * sums[0][1]) / (sums[1][0] * sums[1][1])
    return efficiency, sums[1][0][0] / sums[0][0][0], sums[1][1][0] / sums[0][1][0]


def compare(arguments: argparse.Namespace) -> None:
    """Print a row a scene, and the geometric mean."""
    first, second = dict(np.load(arguments.first)), dict(np.load(arguments.second))
    names = [key.removesuffix(" rays") for key in second if key.endswith(" rays") and key in first]
    logs = []
    print("| scene | rays | variance | efficiency | 95 % |\n|---|---:|---:|---:|---:|")
    for name in names:
        efficiency, variance, rays = ratio(first, second, name)
        low, high = np.quantile(efficiency[1:], [0.025, 0.975])
        logs.append(np.log(efficiency))
        print(f"| {name} | {rays:.3f} | {variance:.3f} | {efficiency[0]:.3f} | {low:.3f}–{high:.3f} |")
    means = np.exp(np.mean(logs, axis=0))
    low, high = np.quantile(means[1:], [0.025, 0.975])
    print(f"| geometric mean | | | {means[0]:.3f} | {low:.3f}–{high:.3f} |")


def main(given: Sequence[str] | None = None) -> int:
    """Measure or compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    one = commands.add_parser("measure")
    one.add_argument("directory", type=Path)
    one.add_argument("file", type=Path)
    one.add_argument("scenes", nargs="*", help="names or files; those that are built in")
    one.add_argument("--seeds", type=int, default=32)
    one.add_argument("--first-seed", type=int, default=0)
    one.add_argument("--size", type=int, default=48)
    one.add_argument("--spp", type=int, default=16)
    one.set_defaults(run=measure)
    two = commands.add_parser("compare")
    two.add_argument("first", type=Path)
    two.add_argument("second", type=Path)
    two.set_defaults(run=compare)
    arguments = parser.parse_args(given)
    arguments.run(arguments)
    return 0


if __name__ == "__main__":
    os.environ.setdefault("PYOPENCL_NO_CACHE", "1")
    sys.exit(main())
