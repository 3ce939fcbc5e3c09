"""Print the table of equal hashes: every driver, number of lanes and traversal, with every cut of the work."""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "image"))

from image_support import LANES, SCENES, SPP, TRAVERSALS, WIDTH_HEIGHT, Cutting, product, render

from clrender.drivers import select
from clrender.errors import ClrenderError
from clrender.integrators import INTEGRATORS

if TYPE_CHECKING:
    from clrender.device import Device

__all__: list[str] = []

_INTERPRETED: Final = {"size": (32, 32), "spp": 1}
"""A render that Oclgrind can do in minutes; its reference has the same size."""
_OWN: Final = {"photon": {"photons": 2000}}
"""Settings with which an integrator takes no longer than others."""
_HELP: Final = """Without an option: every driver that passes the probe, and Oclgrind where it is there. A row stands
for 36 renders of each scene: tiles of 16, 64 and the whole image x 1, 4 and 16 samples in a launch x groups of 16 and
64 work-items x units in order and shuffled. rusticl is asked for one lane and the packet traversal only, as it is used:
its compiler takes a quarter of an hour and 9 GiB for four lanes."""

Table = dict[str, set[str]]


def main() -> int:
    """Print the table; returns 0 if there is one hash for each scene and size."""
    parser = argparse.ArgumentParser(description=_HELP)
    parser.add_argument("--device", action="append", help="only devices with this in their name; repeatable")
    parser.add_argument("--lanes", type=int, action="append", choices=LANES, help="only so many; repeatable")
    parser.add_argument("--traversal", action="append", choices=TRAVERSALS)
    parser.add_argument("--integrator", choices=INTEGRATORS, default="path", help="how light is followed (path)")
    parser.add_argument("--quick", action="store_true", help="one cut of the work instead of 36")
    parser.add_argument("--no-oclgrind", action="store_true")
    parser.add_argument("--interpreted", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    lanes, traversals = options.lanes or LANES, options.traversal or TRAVERSALS
    seen: dict[str, Table] = {"": defaultdict(set), "32x32": defaultdict(set)}
    devices = select(options.device or ("oclgrind" if options.interpreted else "all"), notify=_say)
    settings: dict[str, Any] = {"integrator": options.integrator, **_OWN.get(options.integrator, {})}
    if options.interpreted:
        _rows(devices[0], [Cutting(), Cutting(1, "single", 16, 1, 16)], seen["32x32"], **settings, **_INTERPRETED)
        return 0
    width, height = WIDTH_HEIGHT
    print(f"image_sha256 (its first 12 digits) of {width}x{height} images with {SPP} samples a pixel\n")
    print(f"| driver | lanes | traversal | cuts | {' | '.join(SCENES)} | seconds |")
    print(f"|---|---|---|---|{'---|' * len(SCENES)}---|", flush=True)
    for device in devices:
        for one, cuttings in _programs(device, lanes, traversals, options.lanes is not None):
            _rows(device, [one] if options.quick else cuttings, seen[""], **settings)
    if not options.no_oclgrind and shutil.which("oclgrind"):
        _rows(devices[0], [Cutting()], seen["32x32"], **settings, **_INTERPRETED)
        _oclgrind(seen["32x32"], options.integrator)
    return _conclusion(seen)


def _say(line: str) -> None:
    print(line, file=sys.stderr)


def _programs(
    device: Device, lanes: Sequence[int], traversals: Sequence[str], insist: bool
) -> Iterator[tuple[Cutting, list[Cutting]]]:
    """For each program of a device: one launch configuration, and all of them."""
    for count in lanes:
        for traversal in traversals:
            if "rusticl" in device.info.platform and (count, traversal) != (1, "packet") and not insist:
                continue
            yield Cutting(count, traversal), list(product((count,), (traversal,)))


def _rows(device: Device, cuttings: Sequence[Cutting], seen: Table, **settings: Any) -> None:
    """Render all scenes with all launch configurations, which share a program, and print the row."""
    begin, cells = time.perf_counter(), []
    for scene in SCENES:
        hashes = defaultdict(list)
        for cutting in cuttings:
            try:
                image = render(scene, [device], cutting, **settings)
                hashes[image.stats["image_sha256"][:12]].append(cutting)
            except ClrenderError as error:
                hashes[f"failed: {error}"].append(cutting)
        seen[scene] |= hashes.keys()
        cells.append(" ".join(f"{each} ({len(found)})" if len(hashes) > 1 else each for each, found in hashes.items()))
        for each, found in list(hashes.items())[1:]:
            _say(f"{device.info.title}, {scene}: {each} with {'; '.join(map(str, found[:8]))}")
    size = " 32x32" if "size" in settings else ""
    first = cuttings[0] if len({(each.lanes, each.traversal) for each in cuttings}) == 1 else Cutting()
    words = [f"{device.info.platform} {device.info.driver}{size}", first.lanes or "own", first.traversal or "own"]
    row = [*map(str, words), str(len(cuttings)), *cells, f"{time.perf_counter() - begin:.0f}"]
    print(f"| {' | '.join(row)} |", flush=True)


def _oclgrind(seen: Table, integrator: str) -> None:
    """Run this script in Oclgrind, which must be present when the process starts, and read its row."""
    command = ["oclgrind", sys.executable, "-W", "ignore", __file__, "--interpreted", "--integrator", integrator]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    rows = [line for line in done.stdout.splitlines() if line.startswith("| Oclgrind")]
    print("\n".join(rows) or f"| Oclgrind | failed: {done.stderr.strip().splitlines()[-1:]} |", flush=True)
    for row in rows:
        for scene, cell in zip(SCENES, row.split(" | ")[4:], strict=False):
            seen[scene] |= {each for each in cell.split() if not each.startswith("(")}
    if not rows:
        seen["Oclgrind"] |= {"failed", "no row"}


def _conclusion(seen: dict[str, Table]) -> int:
    several = [f"{scene} {size}".strip() for size, table in seen.items() for scene in table if len(table[scene]) != 1]
    if several:
        print(f"\nNOT THE SAME BITS: {', '.join(several)}")
        return 1
    print("\nOne hash for each scene and size.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
