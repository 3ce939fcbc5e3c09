"""All that is to be known of a new GPU, within a given time: what was found, bits, tuning, speed, faults.

One JSON file and one page of Markdown, written anew after every step, so that a run that is cut off leaves what it has.
"""

from __future__ import annotations

import argparse
import itertools
import json
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "image"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "host"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "statistics"))

from faulty_device import CALLS, Fault, FaultyDevice
from image_support import SCENES, Cutting, render
from mixed_files import written
from mixed_moves import with_all_features
from mixed_scenes import KINDS, Mixed, mixed_scene

import clrender
from clrender.bench import measure, write_scene
from clrender.bench.peers import SEGMENTS, Peer, Task
from clrender.drivers import inventory, select
from clrender.drivers.diagnose import diagnose
from clrender.drivers.probe import examine
from clrender.errors import ClrenderError

if TYPE_CHECKING:
    from clrender.device import Device

__all__: list[str] = []

_ROOT: Final = Path(__file__).resolve().parents[1]
_HASHES: Final = _ROOT / "scripts" / "gpu_check_hashes.json"
"""Hashes of the known images, by title, written on a CPU by ``--update-hashes``."""
_RENDERS: Final[dict[str, tuple[str, dict[str, Any]]]] = {
    **{scene: (scene, {}) for scene in SCENES},
    "avenue": ("avenue", {}),
    "room, reuse": ("room", {"integrator": "reuse"}),
    "room, photon": ("room", {"integrator": "photon", "photons": 20000}),
    "room-diffuse, radiosity": ("room-diffuse", {"integrator": "radiosity", "patches": 1000}),
    "surfaces, wavelengths": ("surfaces", {"spectral": True}),
    "prism": ("prism", {}),
    "prism, path": ("prism", {"integrator": "path"}),
}
"""Test renders: scene and settings by title."""
_MIXED: Final = 12
"""Of each kind of random scene so many are rendered, by few programs, since each has all features."""
_CUTS: Final = (
    Cutting(tile=16, samples_per_pass=1),
    Cutting(order="shuffled", samples_per_pass=4),
    Cutting(kernels="staged", samples_per_pass=4),
)
_GROUPS: Final = (32, 64, 128, 256)
_PASSES: Final = (1, 4, 16)
_BENCHMARK: Final = ("S1", "S2", "S3-100k", "S3-1M", "S4", "S5", "S6", "S7")


@dataclass
class Check:
    """A run: its options, its results so far, and its output files."""

    folder: Path
    seconds: float
    begin: float = field(default_factory=time.monotonic)
    found: dict[str, Any] = field(default_factory=dict)
    lines: list[str] = field(default_factory=list)

    @property
    def left(self) -> float:
        """Seconds that remain."""
        return self.seconds - (time.monotonic() - self.begin)

    def say(self, *lines: str) -> None:
        """Add lines to the page."""
        self.lines += lines
        print(*lines, sep="\n", flush=True)

    def write(self) -> None:
        """Write both files atomically."""
        self.found["seconds"] = round(time.monotonic() - self.begin, 1)
        for name, text in (
            ("gpu_check.json", json.dumps(self.found, indent=1)),
            ("gpu_check.md", "\n".join(self.lines)),
        ):
            (self.folder / f".{name}").write_text(text + "\n", encoding="utf-8")
            (self.folder / f".{name}").replace(self.folder / name)

    def stopped(self, where: str) -> None:
        """Note that a step ends early."""
        self.say("", f"Stopped {where}: out of time.")
        self.found.setdefault("skipped", []).append(f"the rest ({where})")

    def step(self, title: str, needed: float, do: Callable[..., Any], *arguments: Any) -> None:
        """Run a step and store its result, if there is time for it; a clrender error ends only this step."""
        self.say(f"\n## {title}\n")
        if self.left < needed:
            self.say(f"Skipped: {self.left:.0f} s are left, and it may take {needed:.0f} s.")
            self.found.setdefault("skipped", []).append(title)
        else:
            try:
                self.found[title] = do(*arguments)
            except (ClrenderError, OSError) as error:
                self.say(f"FAILED: {error}")
                self.found.setdefault("failed", []).append(f"{title}: {error}")
        self.write()


def main() -> int:
    """Run all steps; returns 0 if all bits are right, 1 if not, 2 and 3 as clrender itself."""
    options = _options()
    options.output.mkdir(parents=True, exist_ok=True)
    check = Check(options.output, options.seconds)
    check.say(f"# GPU check of clrender {clrender.__version__}, {time.strftime('%Y-%m-%d %H:%M')}")
    check.step("Machine", 0.0, _machine, check)
    check.step("Drivers", 0.0, _drivers, check)
    try:
        devices = select([options.device], notify=_say)
    except ClrenderError as error:
        check.say(f"\n{error}")
        check.write()
        return error.exit_code
    for device in devices:
        name = device.info.title
        check.step(f"Bits of {name}", 5.0, _bits, check, device, options.update_hashes)
        check.step(f"Faults of {name}", 20.0, _faults, check, device)
        check.step(f"Mixed scenes on {name}", 30.0, _mixed, check, device, options.update_hashes)
        check.step(f"Tuning of {name}", 30.0, _tuning, check, device, options.size, options.spp)
        for scene in options.scenes:
            task = Task(options.size, options.size, options.spp)
            check.step(f"{scene} on {name}", 20.0, _speed, check, device, scene, task, options.repeats)
        check.step(f"Stages on {name}", 30.0, _stages, check, device, options)
    wrong = [title for title, told in check.found.items() if isinstance(told, dict) and told.get("equal") is False]
    failed = [*wrong, *check.found.get("failed", [])]
    check.found["ok"] = not failed
    skipped = check.found.get("skipped", [])
    passed = f"All is right that was checked; skipped: {', '.join(skipped)}." if skipped else "All checks passed."
    check.say("", passed if not failed else f"NOT ALL IS WELL: {'; '.join(failed)}")
    check.write()
    return 1 if failed else 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="scripts/gpu_check", description=__doc__)
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("gpu_check"), help="folder for the results (gpu_check)"
    )
    parser.add_argument("--device", default="gpu", help="which are new (default: gpu); any word that names some")
    parser.add_argument("--seconds", type=float, default=540.0, help="no step begins that may last longer (540)")
    parser.add_argument("--scenes", nargs="*", default=_BENCHMARK, help="to be timed")
    parser.add_argument("--size", type=int, default=800)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--update-hashes", action="store_true", help="keep this device's images as the known ones")
    return parser.parse_args()


def _machine(check: Check) -> dict[str, Any]:
    """Description of the machine; with the output of NVIDIA's tool, if installed."""
    query = ["nvidia-smi", "--query-gpu=name,driver_version,memory.total,power.limit", "--format=csv,noheader"]
    try:
        told = subprocess.run(query, capture_output=True, text=True, check=False, timeout=20.0).stdout.splitlines()
    except (OSError, subprocess.TimeoutExpired):
        told = []
    check.say(f"- {platform.platform()}, Python {platform.python_version()}", *(f"- {line}" for line in told))
    return {"machine": platform.platform(), "python": platform.python_version(), "nvidia_smi": told}


def _drivers(check: Check) -> dict[str, Any]:
    """Every driver, its location, and the output of `clrender doctor`."""
    reports = examine(notify=_say)
    for report in reports:
        check.say(f"- {report.driver.library or report.driver.origin} ({report.driver.origin}) {report.fault}".rstrip())
        check.say(
            *(
                f"  - {info.title}, {info.type}, {info.compute_units} units: {info.probe} {info.detail}".rstrip()
                for info in report.devices
            )
        )
    findings = diagnose(reports)
    check.say(*(f"- {each.subject}: {each.cause}. Cure: {each.cure}" for each in findings))
    return {"devices": [asdict(info) for info in inventory()], "findings": [asdict(each) for each in findings]}


def _bits(check: Check, device: Device, update: bool) -> dict[str, Any]:
    """First build of everything, and renders with different launch configurations; compares hashes with the known."""
    known = _known_hashes()
    check.say("| scene | built and rendered, s | again, s | hash | |", "|---|---|---|---|---|")
    rows: dict[str, Any] = {}
    longest = 10.0
    for title, (scene, settings) in _RENDERS.items():
        if check.left < 2.0 * longest:  # mostly compilation
            check.stopped(f"before {title}")
            break
        begin = time.perf_counter()
        try:
            hashes = {render(scene, [device], **settings).stats["image_sha256"]}
            middle = time.perf_counter()
            hashes |= {render(scene, [device], cut, **settings).stats["image_sha256"] for cut in _CUTS}
        except ClrenderError as error:
            rows[title] = {"equal": False, "error": str(error)}
            check.say(f"| {title} | | | FAILED | {error} |")
            continue
        first, again = middle - begin, (time.perf_counter() - middle) / len(_CUTS)
        if update:
            known[title] = min(hashes)
        longest = max(longest, time.perf_counter() - begin)
        equal = hashes == {known.get(title)}
        rows[title] = {"hashes": sorted(hashes), "equal": equal, "first_seconds": first, "seconds": again}
        shown = ", ".join(sorted(one[:12] for one in hashes))
        check.say(f"| {title} | {first:.1f} | {again:.2f} | {shown} | {'as known' if equal else 'OTHER BITS'} |")
    if update:
        _keep_hashes(known)
    equal = all(row["equal"] for row in rows.values())
    check.say("", "The known bits." if equal else "OTHER BITS: do not trust this device.")
    return {"equal": equal, "rows": rows}


def _mixed(check: Check, device: Device, update: bool) -> dict[str, Any]:
    """Random scenes in which everything meets, each whole and with its work cut; compares hashes with the known."""
    known = _known_hashes()
    wrong: dict[str, str] = {}
    done, longest = 0, 10.0
    with tempfile.TemporaryDirectory() as folder, clrender.Session([device]) as session:
        files = written(Path(folder))
        for number, kind in itertools.product(range(_MIXED), KINDS):
            if check.left < 2.0 * longest:
                check.stopped(f"after {done} mixed scenes")
                break
            begin = time.perf_counter()
            mixed = mixed_scene(kind, number)
            scene = Mixed(mixed.name, with_all_features(mixed.content)).scene(files)
            try:
                cuts: tuple[dict[str, Any], ...] = ({}, {"tile": 16, "samples_per_pass": 1}, {"kernels": "staged"})
                made = [session.render(scene, size=(24, 20), spp=4, **cut) for cut in cuts]
                hashes = {image.stats["image_sha256"] for image in made}
            except ClrenderError as error:
                wrong[mixed.name] = str(error)
                continue
            done, longest = done + 1, max(longest, time.perf_counter() - begin)
            if update:
                known[f"mixed {mixed.name}"] = min(hashes)
            if hashes != {known.get(f"mixed {mixed.name}")}:
                wrong[mixed.name] = ", ".join(sorted(hashes))
    if update:
        _keep_hashes(known)
    check.say(f"{done} scenes, {len(wrong)} of them with other bits than known.")
    check.say(*(f"- {name}: {told}" for name, told in wrong.items()))
    return {"equal": not wrong, "scenes": done, "wrong": wrong}


def _known_hashes() -> dict[str, str]:
    return json.loads(_HASHES.read_text(encoding="utf-8")) if _HASHES.exists() else {}


def _keep_hashes(known: dict[str, str]) -> None:
    _HASHES.write_text(json.dumps(known, indent=1) + "\n", encoding="utf-8")


def _faults(check: Check, device: Device) -> dict[str, Any]:
    """Open the device twice, one with a fault at each kind of call in turn: the image must stay the same."""
    how: dict[str, Any] = {"size": (96, 64), "spp": 32, "tile": 16, "samples_per_pass": 2}
    wanted = render("cornell", [device], **how).stats["image_sha256"]
    rows: dict[str, bool] = {}
    for call in CALLS:
        fault = Fault(call, after=2, how="gone")
        broken = FaultyDevice(device, fault)
        rows[call] = render("cornell", [device, broken], **how).stats["image_sha256"] == wanted
        check.say(f"- gone at {call} ({fault.met} calls failed): {'the same image' if rows[call] else 'ANOTHER IMAGE'}")
    return {"equal": all(rows.values()), "rows": rows}


def _tuning(check: Check, device: Device, size: int, spp: int) -> list[dict[str, Any]]:
    """Measure speed by lanes, work-group size, and samples per launch."""
    cuts: list[dict[str, int]] = [{}, *({"work_group": each} for each in _GROUPS)]
    cuts += [
        *({"samples_per_pass": each} for each in _PASSES),
        *({"lanes": each} for each in ((1, 4) if not device.is_cpu else ())),
    ]
    rows: list[dict[str, Any]] = []
    check.say("| | S1, Mpaths/s | S3-100k, Mpaths/s |", "|---|---|---|")
    with tempfile.TemporaryDirectory() as folder, clrender.Session([device]) as session:
        scenes = {}
        for name in ("S1", "S3-100k"):
            (Path(folder) / name).mkdir()
            scenes[name] = clrender.load(str(write_scene(name, Path(folder) / name)))
        for cut in cuts:
            if check.left < 30.0:
                check.stopped("while tuning")
                break
            row: dict[str, Any] = {"cut": cut}
            for name, scene in scenes.items():
                settings: dict[str, Any] = {"spp": spp, "roulette": "none", "max_depth": SEGMENTS - 1, **cut}
                try:
                    for _ in range(2):  # the first one compiles
                        stats = session.render(scene, size=(size, size), **settings).stats
                    row[name] = round(size * size * spp / stats["render_seconds"] / 1e6, 2)
                except ClrenderError as error:
                    row[name] = str(error)
            rows.append(row)
            shown = ", ".join(f"{key} {value}" for key, value in cut.items()) or "as it chooses"
            check.say(f"| {shown} | {row['S1']} | {row['S3-100k']} |")
    return rows


def _stages(check: Check, device: Device, options: argparse.Namespace) -> list[dict[str, Any]]:
    """Measure speed with one kernel for whole paths and with one for each stage, in turns."""
    rows: list[dict[str, Any]] = []
    check.say("| scene | whole, Mpaths/s | staged, Mpaths/s | staged / whole |", "|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder, clrender.Session([device]) as session:
        for name in options.scenes:
            if check.left < 30.0:
                check.stopped(f"before {name}")
                break
            (Path(folder) / name).mkdir()
            scene = clrender.load(str(write_scene(name, Path(folder) / name)))
            settings = {"spp": options.spp, "roulette": "none", "max_depth": SEGMENTS - 1}
            rates: dict[str, list[float]] = {"whole": [], "staged": []}
            for turn, (way, found) in itertools.product(range(options.repeats + 1), rates.items()):
                stats = session.render(scene, size=(options.size, options.size), kernels=way, **settings).stats
                if turn:  # the first one compiles
                    found.append(options.size**2 * options.spp / stats["render_seconds"] / 1e6)
            whole, staged = (statistics.median(found) for found in rates.values())
            rows.append({"scene": name, "whole": whole, "staged": staged})
            check.say(f"| {name} | {whole:.2f} | {staged:.2f} | {staged / whole:.2f} |")
    return rows


def _speed(check: Check, device: Device, scene: str, task: Task, repeats: int) -> list[dict[str, Any]]:
    """Measure wall-clock speed, since a GPU has no CPU time; also of Mitsuba on the GPU, if installed."""
    python = _ROOT / ".peers/mitsuba/bin/python"
    peers: Sequence[Peer] = [Peer("mitsuba-cuda", str(python))] if python.exists() else []
    try:
        runs = measure([scene], peers, task, repeats, device.info.name)
    except ClrenderError as error:
        if not peers:
            raise
        check.say(f"Without a peer: {error}", "")
        runs = measure([scene], [], task, repeats, device.info.name)
    rates: dict[str, list[float]] = {}
    for run in runs:
        rates.setdefault(run.renderer, []).append(run.paths / run.wall_seconds / 1e6)
    check.say("| renderer | Mpaths/s of elapsed time | lowest | highest |", "|---|---|---|---|")
    rows = []
    for renderer, each in rates.items():
        row = {"mpaths_per_second": statistics.median(each), "lowest": min(each), "highest": max(each)}
        check.say(f"| {renderer} | " + " | ".join(f"{rate:.2f}" for rate in row.values()) + " |")
        rows.append({"scene": scene, "renderer": renderer, "runs": len(each), **row})
    return rows


def _say(line: str) -> None:
    print(line, file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
