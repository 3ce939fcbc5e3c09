"""Make the figures of docs/integrators.md and print its numbers; arguments: pictures, reuse, caustic, hard (all)."""

from __future__ import annotations

import statistics
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt
from doc_pictures import shown, write_sheet

import clrender
from clrender.bench import write_scene
from clrender.image.compare import relative_squared_error

if TYPE_CHECKING:
    from clrender.rendering.rendered_image import RenderedImage

__all__: list[str] = []

_Image = npt.NDArray[np.float64]


def main() -> int:
    """Run the requested parts, or all."""
    parts = {"pictures": _pictures, "reuse": _reuse, "caustic": _caustic, "hard": _hard}
    for name in sys.argv[1:] or parts:
        parts[name]()
    return 0


def _pictures() -> None:
    room, diffuse = clrender.load("room"), clrender.load("room-diffuse")
    wanted: dict[str, Any] = {"size": (256, 256), "spp": 64}
    names = ("path", "direct", "whitted", "reuse", "photon")
    pictures = [shown(clrender.render(room, integrator=name, **wanted)) for name in names]
    pictures.append(shown(clrender.render(diffuse, integrator="radiosity", **wanted)))
    write_sheet("integrators.jpg", [pictures[:3], pictures[3:]], 80)


def _seconds(image: RenderedImage) -> float:
    return float(image.stats["devices"][0]["seconds"])


def _relative(image: RenderedImage, reference: _Image) -> float:
    """relMSE, as in `clrender compare`."""
    return relative_squared_error(image.linear.astype(np.float64) - reference, reference)


def _reuse() -> None:
    """Compare noise and time of path reuse with path tracing, interleaving seeds."""
    print("| scene | pixels per group | error of `path` / `reuse` | time of `reuse` / `path` | efficiency gain |")
    print("|---|---|---|---|---|")
    for name in ("cornell", "room-diffuse", "room"):
        scene = clrender.load(name)
        size: dict[str, Any] = {"size": (128, 128)}
        reference = clrender.render(scene, spp=4096, seed=999, **size).linear.astype(np.float64)
        ways: dict[int, dict[str, Any]] = {1: {}} | {n: {"integrator": "reuse", "reuse": n} for n in (2, 4, 8, 16)}
        errors: dict[int, list[float]] = {n: [] for n in ways}
        seconds: dict[int, list[float]] = {n: [] for n in ways}
        for seed in range(5):
            for n, way in ways.items():
                image = clrender.render(scene, spp=32, seed=seed, **size, **way)
                errors[n].append(_relative(image, reference))
                seconds[n].append(_seconds(image))
        error = {n: statistics.median(values) for n, values in errors.items()}
        time = {n: statistics.median(values) for n, values in seconds.items()}
        for n in (2, 4, 8, 16):
            less, more = error[1] / error[n], time[n] / time[1]
            print(f"| `{name}` | {n} | {less:.2f} | {more:.2f} | {less / more:.2f} |", flush=True)


def _caustic() -> None:
    """The caustic at equal time by three, and the difference of photon mapping's mean from path tracing's."""
    scene = clrender.load("caustic")
    size: dict[str, Any] = {"size": (400, 300)}
    photon = clrender.render(scene, spp=64, integrator="photon", **size)
    pictures = [photon]
    for integrator in ("bdpt", "path"):
        limit = photon.stats["wall_seconds"]
        pictures.insert(0, clrender.render(scene, spp=2**20, time_limit=limit, integrator=integrator, **size))
    for image in pictures:
        spp = image.stats["samples"] / 400 / 300
        print(f"{image.stats['settings']['integrator']}: {spp:.0f} samples in {_seconds(image):.1f} s")
    write_sheet("caustic.jpg", [[shown(image) for image in pictures]], 85)
    for name in ("cornell", "room-glass"):
        scene = clrender.load(name)
        path = clrender.render(scene, size=(64, 64), spp=8192)
        photon = clrender.render(scene, size=(64, 64), spp=77, integrator="photon")
        share = photon.linear.mean(axis=(0, 1)) / path.linear.mean(axis=(0, 1)) - 1.0
        print(f"{name}: mean after ten million photons {', '.join(f'{100 * part:+.2f} %' for part in share)}")


_HARD: Final = {"X1": ("path", "reuse", "bdpt"), "X8": ("path", "photon", "bdpt"), "X9": ("path", "photon", "bdpt")}
_HARD_SECONDS: Final = 5.0
_HARD_RADIUS: Final = 0.04


def _hard() -> None:
    """The benchmark's scenes of hard light by three integrators each, at equal time."""
    rows = []
    with tempfile.TemporaryDirectory() as folder, clrender.Session() as session:
        for name, integrators in _HARD.items():
            scene = clrender.load(write_scene(name, Path(folder)))
            row = []
            for integrator in integrators:
                wanted: dict[str, Any] = {"integrator": integrator, "size": (300, 225)}
                if integrator == "photon":
                    wanted["photon_radius"] = _HARD_RADIUS  # of the scenes, whose floors are large, it would be 0.09
                session.render(scene, spp=32, **wanted)  # compiles
                image = session.render(scene, spp=2**20, time_limit=_HARD_SECONDS, **wanted)
                row.append(shown(image))
                print(f"{name} {integrator}: {image.stats['samples'] / 300 / 225:.0f} samples", flush=True)
            rows.append(row)
    write_sheet("hard-light.jpg", rows, 85)


if __name__ == "__main__":
    sys.exit(main())
