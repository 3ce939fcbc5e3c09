#!/usr/bin/env python3
"""What replicates cost: relative MSE of images made of them over that of images whose pixels have one sequence.

Usage: replicate_loss.py [--spp N] [--seeds N] [--side N] [SCENE ...]; docs/errors.md has its results. The MSE is the
variance between seeds, so no reference is needed.
"""

from __future__ import annotations

import argparse
from typing import Final

import numpy as np

import clrender

SCENES: Final = ("room", "cornell", "candles", "textures", "haze")
SIZES: Final = (None, 4, 16, 64, 256)


def relative_mse(session: clrender.Session, name: str, size: int | None, arguments: argparse.Namespace) -> float:
    """Mean over pixels of the variance between seeds divided by the squared mean."""
    scene = clrender.load(name)
    images = [
        session.render(
            scene,
            size=(arguments.side, arguments.side),
            spp=arguments.spp,
            seed=seed,
            replicate_spp=size,
            keep_film=False,
        ).linear.mean(-1, dtype=np.float64)
        for seed in range(arguments.seeds)
    ]
    stack = np.stack(images)
    mean = stack.mean(0)
    return float((stack.var(0, ddof=1) / (mean**2 + 0.01 * mean.mean() ** 2)).mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", default=SCENES, metavar="SCENE")
    for option, default in {"--spp": 1024, "--seeds": 8, "--side": 32}.items():
        parser.add_argument(option, type=int, default=default)
    arguments = parser.parse_args()
    print("| scene | one sequence |" + "".join(f" replicates of {size} |" for size in SIZES[1:]))
    print("|---|" + "---:|" * len(SIZES))
    with clrender.Session() as session:
        for name in arguments.scenes:
            found = [relative_mse(session, name, size, arguments) for size in SIZES]
            print(
                f"| `{name}` | {found[0]:.3g} |" + "".join(f" {each / found[0]:.2f} |" for each in found[1:]),
                flush=True,
            )


if __name__ == "__main__":
    main()
