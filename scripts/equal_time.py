"""docs/speed-equal-time.jpg: crops of images that clrender and other renderers make of benchmark scenes in equal time.

    .venv/bin/python scripts/equal_time.py --peer mitsuba=PYTHON --peer cycles=PYTHON [--references FOLDER]

Time is CPU time, so that other load on the machine has little influence; setting a scene up does not count for peers.
For each scene the numbers of samples and the errors (relMSE, as in scripts/hard_bench.py) are printed, as rows of a
table. References are clrender's, with `TIMES` its samples, and are kept in a folder.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Final

import numpy as np
from hard_bench import Floats, Renders, Subject, relative_error, renders_by, renders_by_peer, samples_for
from PIL import Image

import clrender
from clrender.bench import write_scene
from clrender.bench.peers import Peer, peer_from

__all__: list[str] = []

CROPS: Final = {"S4": (130, 190), "S2": (190, 150), "S6": (130, 120)}
"""Scenes, and the upper left corner of what is shown of their images."""
SIZE: Final = 400
CROP: Final = 110
SCALE: Final = 2
TIMES: Final = 32
"""Samples of a reference, relative to the image's."""
PICTURE: Final = Path(__file__).resolve().parents[1] / "docs" / "speed-equal-time.jpg"


def reference_of(name: str, renders: Renders, spp: int, folder: Path) -> Floats:
    """The mean of some renders of other seeds than the image's; kept from run to run."""
    path = folder / f"{name}.npy"
    if not path.exists():
        np.save(path, np.mean([renders(spp * TIMES // 4, seed).image for seed in range(100, 104)], axis=0))
    return np.asarray(np.load(path), np.float64)


def shown(image: Floats, name: str, white: float) -> Floats:
    """The crop of an image for the picture, from 0 to 1, with a white margin: (side, side, 3)."""
    top, left = CROPS[name]
    part = np.sqrt(np.clip(image[top : top + CROP, left : left + CROP] / white, 0.0, 1.0))
    large = np.repeat(np.repeat(part, SCALE, axis=0), SCALE, axis=1)
    return np.pad(large, ((0, 4), (0, 4), (0, 0)), constant_values=1.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peer", type=peer_from, action="append", required=True, help="NAME=PYTHON, repeated")
    parser.add_argument("--seconds", type=float, default=10.0, help="CPU seconds of an image (10)")
    parser.add_argument(
        "--references", type=Path, default=Path("references"), help="folder of references (./references)"
    )
    arguments = parser.parse_args()
    arguments.references.mkdir(parents=True, exist_ok=True)
    peers: list[Peer] = arguments.peer
    print("| scene |", *(f"{name}: spp, relMSE |" for name in ("clrender", *(peer.name for peer in peers))))
    rows = []
    with clrender.Session() as session:
        for name in CROPS:
            with tempfile.TemporaryDirectory() as folder:
                file = write_scene(name, Path(folder))
                of = Subject(file, clrender.load(file), (SIZE, SIZE))
                ways = [renders_by(session, of, {}), *(renders_by_peer(peer, of, Path(folder)) for peer in peers)]
                samples = [samples_for(arguments.seconds, way) for way in ways]
                images = [way(spp, 1).image for way, spp in zip(ways, samples, strict=True)]
                reference = reference_of(name, ways[0], samples[0], arguments.references)
            errors = [relative_error(image, reference) for image in images]
            print(
                f"| {name} |",
                *(f"{spp}, {error:.4f} |" for spp, error in zip(samples, errors, strict=True)),
                flush=True,
            )
            white = 2.5 * float(np.median(reference.mean(axis=2)))
            rows.append(np.concatenate([shown(image, name, white) for image in (*images, reference)], axis=1))
    picture = np.concatenate(rows)[:-4, :-4]
    Image.fromarray((picture * 255.0 + 0.5).astype(np.uint8)).save(PICTURE, quality=88)


if __name__ == "__main__":
    main()
