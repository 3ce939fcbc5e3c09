"""Every kernel in the Oclgrind interpreter: no access beyond a buffer, no race, nothing read that was never written.

And the same bits as elsewhere. What Oclgrind 21.10 says wrongly is kept away from it: released buffers
(interpreted.py), and in 16 lanes its search for values never written, which takes the fourth number of the upper half
of a vector of sixteen for one: ``int16 v = vload16(0, a); int8 h = v.hi; out[0] = h.s3;``.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from interpreted import RENDERS, perform
from kernel_support import FOLDER

import clrender
from clrender.files.package_data import kernels_folder

if TYPE_CHECKING:
    from clrender.device import Device

pytestmark = [
    pytest.mark.oclgrind,
    pytest.mark.skipif(shutil.which("oclgrind") is None, reason="Oclgrind is not installed"),
]

ERROR = re.compile(r"^(Invalid|Uninitialized|Controlflow|Read-write|Write-write|Unaligned|Work-group|Work-item)", re.M)
QUICK = ("path-4", "path-1-rough")
"""The plainest way to render, and every kind of material in one lane: values that one lane leaves unset, where several
compute them for their neighbours, show there alone. The other ways are slow tests."""


def _environment() -> dict[str, str]:
    """One in which the package is found, and what interpreted.py has of the tests of the host."""
    path = os.pathsep.join([str(Path(clrender.__file__).parents[1]), str(FOLDER.parent / "host")])
    return {**os.environ, "PYTHONPATH": path}


def interpreted(names: list[str], folder: Path, *options: str) -> tuple[dict[str, str], str]:
    """What came out, and Oclgrind's complaints."""
    log = folder / "complaints"
    command = ["oclgrind", *options, "--max-errors", "100", "--log", str(log), sys.executable]
    command += ["-W", "ignore", str(FOLDER / "interpreted.py"), *names]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=_environment(), cwd=folder)
    assert done.returncode == 0, done.stderr
    lines = dict(line.split(" ", 1) for line in done.stdout.splitlines() if " " in line)
    assert lines["device"] == "Oclgrind"
    return lines, log.read_text() if log.exists() else ""


def check(device: Device, names: list[str], folder: Path) -> set[str]:
    """Complain of what Oclgrind complains of; gives the kernels that ran."""
    options = ["--data-races"]
    if all(name not in RENDERS or RENDERS[name].lanes < 16 for name in names):
        options.append("--uninitialized")
    lines, complaints = interpreted(names, folder, *options)
    assert complaints == ""
    assert {name: lines[name] for name in names} == {name: perform(device, name) for name in names}
    return set(lines["launched"].split())


def every_kernel() -> set[str]:
    texts = [path.read_text(encoding="utf-8") for path in kernels_folder().rglob("*.cl")]
    return {name for text in texts for name in re.findall(r"\b_*kernel\s+(?:GROUPED\s+)?void\s+(\w+)", text)}


@pytest.mark.long
def test_trees_of_few_and_of_many(device: Device, tmp_path: Path) -> None:
    launched = check(device, ["trees"], tmp_path)
    assert launched >= {"build_merge_few", "build_merge", "build_nearest", "build_merge_count", "build_sort_scatter"}


@pytest.mark.slow
def test_every_kernel_on_a_small_scene(device: Device, tmp_path: Path) -> None:
    renders = ["path-4", "path-4-instances", "path-4-replicates", "whitted-4", "reuse-4", "photon-4", "bdpt-4"]
    renders += ["guided-4", "training-4", "staged-1", "staged-1-holes"]
    others = ["light_paths", "layers", "radiosity", "furnace", "formulas", "film", "refit"]
    launched = check(device, ["scan", "trees", "statistics", "arithmetic", *renders, *others], tmp_path)
    assert launched == every_kernel()


@pytest.mark.long
def test_two_ways_to_render(device: Device, tmp_path: Path) -> None:
    check(device, list(QUICK), tmp_path)


@pytest.mark.long
def test_recorded_paths(device: Device, tmp_path: Path) -> None:
    check(device, ["light_paths"], tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in RENDERS if name not in QUICK])
def test_every_other_way_to_render(device: Device, tmp_path: Path, name: str) -> None:
    check(device, [name], tmp_path)


BROKEN = """// For a test.
__kernel void beyond(__global uint* a) { a[get_global_id(0) + 1] = 1; }
__kernel void race(__global uint* a) { a[0] = (uint)get_global_id(0); }
__kernel void unwritten(__global uint* a) { uint b[2]; b[0] = 1; if (b[get_global_id(0) & 1]) a[0] = 1; }
"""


@pytest.mark.long
@pytest.mark.parametrize("kernel", ["beyond", "race", "unwritten"])
def test_oclgrind_does_complain(tmp_path: Path, kernel: str) -> None:
    """Of each of the three, or its silence would say nothing."""
    (tmp_path / "broken.cl").write_text(BROKEN)
    (tmp_path / "broken.py").write_text(
        f"import sys; sys.path.insert(0, {str(FOLDER)!r})\n"
        "from interpreted import open_first\n"
        "device = open_first()\n"
        "a = device.empty(64)\n"
        f"device.launch(device.program({str(tmp_path / 'broken.cl')!r}), {kernel!r}, 16, 8, [a])\n"
        "device.finish()\n"
    )
    log = tmp_path / "complaints"
    command = ["oclgrind", "--data-races", "--uninitialized", "--log", str(log), sys.executable, "-W", "ignore"]
    subprocess.run([*command, str(tmp_path / "broken.py")], capture_output=True, check=True, env=_environment())
    assert ERROR.search(log.read_text())
