"""Hard light: the error of every way to render it at equal time, on scenes whose light paths seldom find.

    .venv/bin/python scripts/hard_bench.py reference SCENE… --way path --minutes 20
    .venv/bin/python scripts/hard_bench.py measure SCENE… [--ways path,reuse,photon] [--peer NAME=PYTHON]
                                                    [--seconds 20] [--seeds 4]
    .venv/bin/python scripts/hard_bench.py agree SCENE…
    .venv/bin/python scripts/hard_bench.py picture --images FOLDER

X1, X8 and X9 are made here (`clrender.bench.hard`). X2 to X7 are scenes of the field, in pbrt's format, whose folder is
`--standard`: veach-ajar, veach-bidir, classroom, dining-room, water-caustic and volumetric-caustic.

The error is relMSE: the mean over pixels and channels of (x - r)² / (r² + (0.1 mean(r))²). Of an unbiased way it falls
as 1 / seconds, so that their product says how good a way is, and says it of each seed; training of a way counts, as it
is part of the render. Peers render the scene that an exporter writes for them; setting it up does not count.

A reference is the mean of many renders by one way, which `reference` adds to; its own error, estimated between them, is
told, and `measure` says where it is more than a fiftieth of an error that is measured with it. `agree` compares
references by different ways with each other, by means and by tiles. `picture` makes docs/hard-light-peers.jpg of images
that `measure --images` has kept.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image

import clrender
from clrender.bench import write_scene
from clrender.bench.hard import HARD_SCENES
from clrender.bench.peers import Peer, Task, peer_from
from clrender.errors import RenderError, SceneError

__all__: list[str] = []

Floats = npt.NDArray[np.float64]

STANDARD: Final[Mapping[str, tuple[str, tuple[int, int]]]] = {
    "X2": ("veach-ajar", (160, 90)),
    "X3": ("veach-bidir", (128, 128)),
    "X4": ("classroom", (160, 90)),
    "X5": ("dining-room", (160, 90)),
    "X6": ("water-caustic", (128, 128)),
    "X7": ("volumetric-caustic", (128, 128)),
}
"""Folders of the scenes of the field, and the image's size."""
WAYS: Final[Mapping[str, Mapping[str, Any]]] = {
    "path": {"integrator": "path"},
    "reuse": {"integrator": "reuse"},
    "photon": {"integrator": "photon"},
    "bdpt": {"integrator": "bdpt"},
    "guided": {"integrator": "path", "guiding": "on"},
    "chains": {"integrator": "path", "specular_chains": "on"},
    "bdpt-chains": {"integrator": "bdpt", "specular_chains": "on"},
}
"""Settings of a render. `photon` has a bias as well, which falls with its passes."""
PICTURE: Final = Path(__file__).resolve().parents[1] / "docs" / "hard-light-peers.jpg"
ROWS: Final = (("X2", "guided"), ("X3", "bdpt"), ("X6", "photon"), ("X7", "bdpt"))
"""Scenes of the picture, and the best way of each."""
COLUMNS: Final = ("path", "", "mitsuba", "cycles-guided", "luxcore-bidir")
"""Ways of its columns; empty: the best."""
CROP: Final = 44
PROBE_SPP: Final = 4
PROBES: Final = 6
BATCH_SECONDS: Final = 30.0
"""CPU seconds of one of the renders of a reference."""
REFERENCE_SEEDS: Final = {way: (1 + number) << 20 for number, way in enumerate(WAYS)}
"""First seeds: ways that are compared share no random numbers."""
SHARE: Final = 50.0
"""How much smaller than an error that is measured with it a reference's own error has to be."""
TILES: Final = 4


@dataclass
class Reference:
    """Sums over renders of one way.

    Attributes
    ----------
    count : int
        Renders.
    total, squares : (H, W, 3) float64
    tiles : list of (TILES²,) float64
        Of each render.
    """

    count: int
    total: Floats
    squares: Floats
    tiles: list[Floats]

    @property
    def mean(self) -> Floats:
        """(H, W, 3) radiance."""
        return self.total / self.count

    @property
    def error(self) -> float:
        """Its relMSE, estimated from the variance between its renders."""
        if self.count < 2:
            return math.inf
        variance = (self.squares - np.square(self.total) / self.count) / (self.count - 1) / self.count
        return float(np.mean(variance / (np.square(self.mean) + floor(self.mean))))


def floor(reference: Floats) -> float:
    """Added to the square of a pixel, so that black ones do not decide."""
    return float((0.1 * reference.mean()) ** 2)


def relative_error(image: npt.NDArray[Any], reference: Floats) -> float:
    """relMSE of an image, (H, W, 3)."""
    return float(np.mean(np.square(image - reference) / (np.square(reference) + floor(reference))))


@dataclass(frozen=True)
class Subject:
    """A scene to render.

    Attributes
    ----------
    file : Path
    scene : clrender.Scene
        What the file holds.
    size : (int, int)
        Of its image, pixels.
    """

    file: Path
    scene: clrender.Scene
    size: tuple[int, int]


def subject(name: str, arguments: argparse.Namespace, folder: Path) -> Subject:
    """The scene of this name; those that are made here are written into a folder."""
    if name in HARD_SCENES:
        file = write_scene(name, folder)
        scene = clrender.load(file)
        size = scene.image.width, scene.image.height
    elif name not in STANDARD:
        raise SystemExit(f"there is no scene {name}; choose of {', '.join((*HARD_SCENES, *STANDARD))}")
    elif arguments.standard is None:
        raise SystemExit(f"{name} is {STANDARD[name][0]}: name the folder that has it by --standard")
    else:
        place, size = STANDARD[name]
        (file,) = sorted((arguments.standard / place).glob("scene*.pbrt"))
        scene = clrender.load(file)
    width, height = size
    return Subject(file, scene, (width // arguments.reduce, height // arguments.reduce))


@dataclass(frozen=True)
class Timed:
    """An image and what it took."""

    image: Floats
    cpu_seconds: float


Renders = Callable[[int, int], Timed]
"""A render of so many samples a pixel, by a seed."""


def renders_by(session: clrender.Session, of: Subject, settings: Mapping[str, Any]) -> Renders:
    """Renders by clrender."""

    def timed(spp: int, seed: int) -> Timed:
        begun = time.process_time()
        # The same code from the first sample on
        image = session.render(of.scene, spp=spp, seed=seed, size=of.size, keep_film=False, code="fast", **settings)
        return Timed(image.linear.astype(np.float64), time.process_time() - begun)

    timed(1, 0)  # compiles
    return timed


def renders_by_peer(peer: Peer, of: Subject, folder: Path) -> Renders:
    """Renders by a peer."""

    def timed(spp: int, seed: int) -> Timed:
        image = folder / "image.npy"
        done = peer.run(of.file, Task(*of.size, spp, seed=seed, own_paths=True), image, folder)
        return Timed(np.load(image).astype(np.float64), float(done["cpu_seconds"]))

    return timed


def samples_for(seconds: float, renders: Renders) -> int:
    """Samples a pixel that take about so many CPU seconds, by renders of ever more, as fixed costs make a guess low."""
    spp = PROBE_SPP
    for _ in range(PROBES):
        wanted = max(1, round(seconds * spp / renders(spp, 0).cpu_seconds))
        if wanted <= 2 * spp:
            return wanted
        spp = wanted // 2
    return wanted


def tiles_of(image: Floats) -> Floats:
    """Means of TILES × TILES parts."""
    parts = [part for row in np.array_split(image, TILES) for part in np.array_split(row, TILES, axis=1)]
    return np.array([part.mean() for part in parts])


def read_reference(path: Path) -> Reference | None:
    if not path.exists():
        return None
    with np.load(path) as kept:
        return Reference(int(kept["count"]), kept["total"], kept["squares"], list(kept["tiles"]))


def add_to_references(arguments: argparse.Namespace) -> None:
    arguments.references.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder, clrender.Session(arguments.device) as session:
        for name in arguments.scenes:
            of = subject(name, arguments, Path(folder))
            path = arguments.references / f"{name}.{arguments.way}.npz"
            found = read_reference(path)
            renders = renders_by(session, of, WAYS[arguments.way])
            spp = samples_for(min(BATCH_SECONDS, 15.0 * arguments.minutes), renders)
            end = time.process_time() + 60.0 * arguments.minutes
            while time.process_time() < end:
                image = renders(spp, REFERENCE_SEEDS[arguments.way] + (0 if found is None else found.count)).image
                if found is None:
                    found = Reference(0, np.zeros_like(image), np.zeros_like(image), [])
                found.count += 1
                found.total += image
                found.squares += np.square(image)
                found.tiles.append(tiles_of(image))
                part = path.with_suffix(".part")
                with part.open("wb") as file:
                    tiles = np.array(found.tiles)
                    np.savez(file, count=found.count, total=found.total, squares=found.squares, tiles=tiles)
                part.replace(path)
            if found is not None:
                print(f"{name} {arguments.way}: {found.count} renders, relMSE {found.error:.2e}", flush=True)


def references_of(folder: Path, name: str) -> dict[str, Reference]:
    """The references of a scene, of two renders at least, by the way that made them."""
    found = {path.name.split(".")[1]: read_reference(path) for path in sorted(folder.glob(f"{name}.*.npz"))}
    return {way: each for way, each in found.items() if each is not None and each.count > 1}


def measure(arguments: argparse.Namespace) -> None:
    ways = arguments.ways.split(",")
    if unknown := [way for way in ways if way not in WAYS]:
        raise SystemExit(f"there is no way {unknown[0]}; choose of {', '.join(WAYS)}")
    with tempfile.TemporaryDirectory() as folder, clrender.Session(arguments.device) as session:
        for name in arguments.scenes:
            known = references_of(arguments.references, name)
            if not known:
                raise SystemExit(f"{name} has no reference in {arguments.references}; make one by `reference {name}`")
            by, reference = min(known.items(), key=lambda item: item[1].error)
            of = subject(name, arguments, Path(folder))
            every = {way: renders_by(session, of, WAYS[way]) for way in ways}
            every |= {peer.name: renders_by_peer(peer, of, Path(folder)) for peer in arguments.peer}
            plain = math.nan
            for way, renders in every.items():
                row: dict[str, Any] = {"scene": name, "way": way}
                try:
                    row |= row_of(name, way, renders, reference, arguments)
                except (RenderError, SceneError) as error:
                    print(json.dumps(row | {"error": str(error)}), flush=True)
                    continue
                plain = row["product"] if way == "path" else plain
                row |= {"against_path": round(plain / row["product"], 3), "reference": by}
                row["reference_suffices"] = reference.error * SHARE <= row["relmse"]
                print(json.dumps(row), flush=True)


def row_of(
    name: str, way: str, renders: Renders, reference: Reference, arguments: argparse.Namespace
) -> dict[str, Any]:
    """Errors of several seeds."""
    spp = samples_for(arguments.seconds, renders)
    made = [renders(spp, 1 + seed) for seed in range(arguments.seeds)]
    if arguments.images:
        arguments.images.mkdir(parents=True, exist_ok=True)
        np.save(arguments.images / f"{name}.{way}.npy", made[0].image.astype(np.float32))
    errors = np.array([relative_error(each.image, reference.mean) for each in made])
    seconds = np.array([each.cpu_seconds for each in made])
    return {
        "spp": spp,
        "cpu_seconds": round(float(seconds.mean()), 2),
        "relmse": float(f"{errors.mean():.4g}"),
        "relmse_of_seeds": [float(f"{each:.4g}") for each in errors],
        "reference_relmse": float(f"{reference.error:.3g}"),
        "mean": float(f"{np.mean([each.image.mean() for each in made]):.6g}"),
        "reference_mean": float(f"{reference.mean.mean():.6g}"),
        "product": float(f"{errors.mean() * seconds.mean():.5g}"),
    }


def agree(arguments: argparse.Namespace) -> None:
    for name in arguments.scenes:
        found = references_of(arguments.references, name)
        for way, each in found.items():
            print(f"{name} {way}: {each.count} renders, relMSE {each.error:.2e}, mean {each.mean.mean():.6g}")
        names = list(found)
        for i, one in enumerate(names):
            for other in names[i + 1 :]:
                a, b = np.array(found[one].tiles), np.array(found[other].tiles)
                means = f"means {a.mean() / b.mean():.5f}, z {z_of(a.mean(axis=1), b.mean(axis=1)):.2f}"
                print(f"{name} {one}, {other}: {means}; tiles: largest |z| {np.abs(z_of(a, b)).max():.2f}")


def z_of(a: Floats, b: Floats) -> Floats:
    """Differences of means over the first axis, in standard errors."""
    error = np.sqrt(a.var(axis=0, ddof=1) / len(a) + b.var(axis=0, ddof=1) / len(b))
    return np.asarray((a.mean(axis=0) - b.mean(axis=0)) / error)


def picture(arguments: argparse.Namespace) -> None:
    rows = []
    for scene, best in ROWS:
        images = [np.load(arguments.images / f"{scene}.{way or best}.npy").astype(np.float64) for way in COLUMNS]
        white = 3.0 * float(np.median(images[COLUMNS.index("")].mean(axis=2)))
        row = [np.pad(shown(image, white), ((0, 4), (0, 4), (0, 0)), constant_values=255) for image in images]
        rows.append(np.concatenate(row, axis=1))
    Image.fromarray(np.concatenate(rows)[:-4, :-4]).save(PICTURE, quality=88)
    print(PICTURE)


def shown(image: Floats, white: float) -> npt.NDArray[np.uint8]:
    """A square of the middle of an image, four times as large, where `white` is white."""
    top, left = (image.shape[0] - CROP) // 2, (image.shape[1] - CROP) // 2
    part = np.clip(image[top : top + CROP, left : left + CROP] / white, 0.0, 1.0)
    return np.repeat(np.repeat((np.sqrt(part) * 255.0).astype(np.uint8), 4, axis=0), 4, axis=1)


def main(given: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    for name, run in (("reference", add_to_references), ("measure", measure), ("agree", agree)):
        each = commands.add_parser(name)
        each.set_defaults(run=run)
        each.add_argument("scenes", nargs="+", metavar="SCENE")
        each.add_argument("--standard", type=Path, help="folder with the scenes X2 to X7")
        each.add_argument(
            "--references", type=Path, default=Path("references"), help="folder of references (./references)"
        )
        each.add_argument("--device", help="as for `clrender render`")
        each.add_argument("--reduce", type=int, default=1, help="divide the image's sides by this")
        if name == "reference":
            each.add_argument("--way", choices=WAYS, default="path")
            each.add_argument("--minutes", type=float, default=10.0, help="CPU minutes to add to each scene's (10)")
        if name == "measure":
            each.add_argument("--ways", default="path,reuse,photon")
            each.add_argument("--seconds", type=float, default=20.0, help="CPU seconds of a render (20)")
            each.add_argument("--seeds", type=int, default=4)
            each.add_argument("--peer", type=peer_from, action="append", default=[], help="NAME=PYTHON, repeated")
            each.add_argument("--images", type=Path, help="folder for the first image of each way")
    shows = commands.add_parser("picture")
    shows.set_defaults(run=picture)
    shows.add_argument("--images", type=Path, required=True)
    arguments = parser.parse_args(given)
    arguments.run(arguments)


if __name__ == "__main__":
    main()
