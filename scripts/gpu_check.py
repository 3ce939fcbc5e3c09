"""All that is to be known of a new GPU: builds, bits, work-groups, speed. Prints Markdown."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "image"))

from image_support import SCENES, Cutting, render

import clrender
from clrender.bench import measure, summary, write_scene
from clrender.bench.peers import SEGMENTS, Peer, Task
from clrender.device import select
from clrender.errors import ClrenderError

if TYPE_CHECKING:
    from clrender.device import Device

__all__: list[str] = []

_RENDERS: Final[dict[str, tuple[str, dict[str, Any]]]] = {
    **{scene: (scene, {}) for scene in SCENES},
    "avenue": ("avenue", {}),
    "room, reuse": ("room", {"integrator": "reuse"}),
    "room, photon": ("room", {"integrator": "photon", "photons": 20000}),
    "room-diffuse, radiosity": ("room-diffuse", {"integrator": "radiosity", "patches": 1000}),
}
"""What is rendered: a title, the scene, settings."""
_CUTS: Final = (Cutting(), Cutting(tile=16, samples_per_pass=1), Cutting(order="shuffled", samples_per_pass=4))
_GROUPS: Final = (32, 64, 128, 256)
_ROOT: Final = Path(__file__).resolve().parents[1]


def main() -> int:
    """Print the page; 0 when every device gives the bits of all others."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="gpu", help="which are new (default: gpu); any word that names some")
    parser.add_argument("--scenes", nargs="*", default=["S1", "S1-tess", "S2", "S3-1M", "S4"], help="to be timed")
    parser.add_argument("--size", type=int, default=800)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    try:
        new = select([options.device], notify=_say)
    except ClrenderError as error:
        print(f"gpu_check: {error}", file=sys.stderr)
        return error.exit_code
    try:
        known = [device for device in select(["cpu"], notify=_say) if device.info.title not in _titles(new)]
    except ClrenderError:
        known = []
    equal = True
    for device in new:
        equal &= _bits(device, known)
        _groups(device, options.size, options.spp)
        _speed(device, options.scenes, Task(options.size, options.size, options.spp), options.repeats)
    return 0 if equal else 1


def _titles(devices: Sequence[Device]) -> set[str]:
    return {device.info.title for device in devices}


def _bits(device: Device, known: Sequence[Device]) -> bool:
    """The first build of everything, then hashes beside those of other devices."""
    print(f"## {device.info.title}\n\n| scene | built and rendered, s | again, s | hash | same as |")
    print("|---|---|---|---|---|")
    equal = True
    for title, (scene, settings) in _RENDERS.items():
        begin = time.perf_counter()
        hashes = {render(scene, [device], **settings).stats["image_sha256"]}
        middle = time.perf_counter()
        hashes |= {render(scene, [device], cut, **settings).stats["image_sha256"] for cut in _CUTS}
        again = (time.perf_counter() - middle) / len(_CUTS)
        shown = ", ".join(sorted(one[:12] for one in hashes))
        others = {each.info.title: render(scene, [each], **settings).stats["image_sha256"] for each in known}
        same = [other for other, one in others.items() if hashes == {one}]
        equal &= len(hashes) == 1 and len(same) == len(others)
        told = (
            "; ".join(same) or "(no other device)"
            if len(same) == len(others)
            else f"NOT {'; '.join(others.keys() - set(same))}"
        )
        print(f"| {title} | {middle - begin:.1f} | {again:.2f} | {shown} | {told} |", flush=True)
    print(f"\n{'The same bits.' if equal else 'OTHER BITS: do not trust this device.'}\n")
    return equal


def _groups(device: Device, size: int, spp: int) -> None:
    """How many work-items a group should have."""
    print("| work-items a group | S1, Mpaths/s | S3-100k, Mpaths/s |\n|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        scenes = []
        for name in ("S1", "S3-100k"):
            place = Path(folder) / name
            place.mkdir()
            scenes.append(clrender.load(str(write_scene(name, place))))
        for group in _GROUPS:
            rates = []
            for scene in scenes:
                settings: dict[str, Any] = {
                    "spp": spp,
                    "roulette": "none",
                    "max_depth": SEGMENTS - 1,
                    "work_group": group,
                }
                try:
                    for _ in range(2):
                        image = clrender.render(scene, device=device.info.name, size=(size, size), **settings)
                    rates.append(f"{size * size * spp / image.stats['render_seconds'] / 1e6:.2f}")
                except ClrenderError as error:
                    rates.append(str(error))
            print(f"| {group} | {' | '.join(rates)} |", flush=True)
    print()


def _speed(device: Device, scenes: Sequence[str], task: Task, repeats: int) -> None:
    """By the wall clock: a GPU has no CPU time."""
    python = _ROOT / ".peers/mitsuba/bin/python"
    peers = [Peer("mitsuba-cuda", str(python))] if python.exists() else []
    try:
        runs = measure(scenes, peers, task, repeats, device.info.name)
    except ClrenderError as error:
        print(f"Without a peer: {error}\n")
        runs = measure(scenes, [], task, repeats, device.info.name)
    walls: dict[tuple[str, str], list[float]] = {(run.scene, run.renderer): [] for run in runs}
    for run in runs:
        walls[run.scene, run.renderer].append(run.paths / run.wall_seconds / 1e6)
    print("| scene | renderer | Mpaths/s of elapsed time | lowest | highest |\n|---|---|---|---|---|")
    for row in summary(runs):
        rates = sorted(walls[row["scene"], row["renderer"]])
        middle = rates[len(rates) // 2]
        print(f"| {row['scene']} | {row['renderer']} | {middle:.2f} | {rates[0]:.2f} | {rates[-1]:.2f} |", flush=True)
    print()


def _say(line: str) -> None:
    print(line, file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
