"""Compile every program for GPUs that are not there, and list registers, spills, scratch memory and occupancy.

A program's expanded text, as the driver of a GPU would get it, goes through Clang and libclc: to code of AMD's GPUs,
and to PTX, which NVIDIA's assembler turns into code. Intel's offline compiler compiles it for Intel's. The vendors' own
front ends differ, but the back ends that assign registers are theirs, and the numbers are the same at every run of one
version. `scripts/gpu_static` installs the compilers.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

from elftools.elf.elffile import ELFFile

from clrender.device.info import DeviceInfo
from clrender.device.registers import register_options
from clrender.device.source import load_source
from clrender.flatten.features import Features

__all__ = [
    "BUDGETS",
    "PAGE",
    "PROGRAMS",
    "TARGETS",
    "MissingCompiler",
    "Program",
    "Usage",
    "budgets",
    "measure",
    "over_budget",
    "page_with",
]

BUDGETS: Final = Path(__file__).with_name("gpu_static_budgets.json")
"""The most that each program may take of each target: the same list of objects that `--json` prints."""
PAGE: Final = Path(__file__).resolve().parents[1] / "docs" / "devices.md"
"""The page with the table of budgets."""
_MARK: Final = "<!-- scripts/gpu_static --update -->\n"
_LAUNCH: Final = {"LANES": 1, "PACKETS": 1, "WORK_GROUP": 64}
_OPTIONS: Final = ["-x", "cl", "-cl-std=CL1.2", "-Xclang", "-finclude-default-header", "-nogpulib", "-O3", "-w"]
_ROUNDING: Final = "-cl-fp32-correctly-rounded-divide-sqrt"
_UNPACKED: Final = Path(sys.prefix) / "gpu-compilers"


class MissingCompiler(Exception):
    """A compiler is not installed; the message names it and says what installs it."""


@dataclass(frozen=True)
class Program:
    """A kernel file, and what a scene defines.

    Attributes
    ----------
    entry : str
        Name below the kernels folder.
    macros : mapping of str to int or str
    """

    entry: str
    macros: Mapping[str, int | str]


@dataclass(frozen=True)
class Usage:
    """What a program takes of a GPU; of its kernels, the most of each.

    Attributes
    ----------
    program, target : str
    registers : int
        32-bit registers of a thread.
    spill_bytes : int
        Of a thread, stores of registers that did not fit, in the code.
    scratch_bytes : int
        Memory of a thread: spilled registers, and arrays with indices that are not known before.
    occupancy : float
        Share of the threads that a multiprocessor could hold, as far as registers decide it.
    code_bytes : int
    loads, stores : int
        Of a stage of paths on NVIDIA's GPUs, the words of a path's state that the code loads and stores.
    """

    program: str
    target: str
    registers: int
    spill_bytes: int
    scratch_bytes: int
    occupancy: float
    code_bytes: int
    loads: int = 0
    stores: int = 0


_OF_SETTINGS: Final = {"PIXEL_FILTER": 1, "PIXEL_FILTER_NEGATIVE": 1, "PATH_SPLITS": 1}
"""What settings define, not scenes."""
_EVERYTHING: Final = Features.all()
_TIERS: Final[Mapping[str, Mapping[str, int | str]]] = {
    "simple": Features().macros,
    "materials": Features(materials=True).macros,
    "textures": Features(materials=True, textures=True, environment_map=True).macros,
    "everything": {**_EVERYTHING.macros, **_OF_SETTINGS},
}
_RARE: Final[Mapping[str, tuple[str, ...]]] = {
    "motion": ("motion", "deformation"),
    "grids": ("grids", "glowing_media"),
    "curves": ("curves",),
    "hair": ("curves", "hair"),
    "measured": ("measured",),
    "iridescence": ("iridescence",),
}
"""Features that a program for any scene does not have."""
_SCENELESS: Final = [
    "film/accumulate",
    "geometry/build_collapse",
    "geometry/build_columns",
    "geometry/build_merge",
    "geometry/build_order",
    "geometry/rows",
    "photon/grid",
    "radiosity/sweep",
]
_STAGES: Final = ("begin", "extend", "light", "scatter", "shadow")
_MASKED_STAGES: Final = ("masked", "masked_shadow")
"""Of scenes in which surfaces have holes."""
_STAGES_MARK: Final = "<!-- scripts/gpu_static --update, stages -->\n"
_STAGES_TARGET: Final = "sm_90"
_RADIOSITY: Final = ["direct", "display", "form", "gather", "update"]


def _programs() -> dict[str, Program]:
    made = {name: Program("integrator/path.cl", tier) for name, tier in _TIERS.items()}
    for name in (
        "integrator/first_hit",
        "integrator/guided",
        "integrator/photon",
        "integrator/reuse",
        "integrator/whitted",
        "photon/photons",
    ):
        for tier in ("simple", "everything"):
            made[f"{name}, {tier}"] = Program(f"{name}.cl", _TIERS[tier])
    for stage in _STAGES:
        for tier, macros in _TIERS.items():
            made[f"staged/{stage}, {tier}"] = Program(f"staged/{stage}.cl", macros)
    for stage in _MASKED_STAGES:
        made[f"staged/{stage}, everything"] = Program(f"staged/{stage}.cl", _TIERS["everything"])
    unsplit = {name: value for name, value in _TIERS["everything"].items() if name != "PATH_SPLITS"}
    for name, more in (
        ("integrator/bdpt", {}),
        ("bidirectional/light_paths", {"LIGHTS_IN_MEDIA": 1}),
        ("guiding/training", {}),
    ):
        made[f"{name}, simple"] = Program(f"{name}.cl", _TIERS["simple"])
        made[f"{name}, everything"] = Program(f"{name}.cl", {**unsplit, **more})
    for name in ("integrator/path", "integrator/bdpt"):
        for tier, macros in (("simple", _TIERS["simple"]), ("everything", unsplit)):
            made[f"{name} with chains, {tier}"] = Program(f"{name}.cl", {**macros, "SPECULAR_CHAINS": 1})
    for name in ("integrator/path", "integrator/bdpt"):
        for which, rare in _RARE.items():
            if which == "hair" and name.endswith("bdpt"):  # which does not take it
                continue
            flags: dict[str, Any] = dict.fromkeys(rare, True)
            macros = {**unsplit, **replace(_EVERYTHING, **flags).macros}
            made[f"{name}, everything and {which}"] = Program(f"{name}.cl", macros)
        dispersion = replace(_EVERYTHING, dispersion=True).macros
        made[f"{name}, everything and wavelengths"] = Program(f"{name}.cl", {**unsplit, **dispersion, "SPECTRAL": 1})
    made["film/accumulate, splats"] = Program("film/accumulate.cl", {"SPLATS": 1})
    for name in (*_SCENELESS, *(f"radiosity/{part}" for part in _RADIOSITY)):
        made[name] = Program(f"{name}.cl", {})
    return made


PROGRAMS: Final = _programs()
"""Programs by name; the first four are the tiers of the integrator path."""


def measure(program: str, target: str) -> Usage:
    """Compile a program for a target.

    Parameters
    ----------
    program : str
        Key of `PROGRAMS`.
    target : str
        Key of `TARGETS`.

    Returns
    -------
    Usage

    Raises
    ------
    MissingCompiler
    """
    wanted = PROGRAMS[program]
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder, "program.cl")
        source.write_text(load_source(wanted.entry, {**_LAUNCH, **wanted.macros}).text)
        options = register_options(_device(target), wanted.entry, wanted.macros)
        registers, spills, scratch, occupancy, code = TARGETS[target](target, source, options)
        counts = (0, 0)
        if wanted.entry.startswith("staged/") and TARGETS[target] is _nvidia:
            source.write_text(load_source(wanted.entry, {**_LAUNCH, **wanted.macros, "STATE_COUNTED": 1}).text)
            counts = _state_accesses(source)
    return Usage(program, target, registers, spills, scratch, round(occupancy, 3), code, *counts)


_Numbers = tuple[int, int, int, float, int]


def _device(target: str) -> DeviceInfo:
    """A device of this kind, as its vendor's driver names it."""
    platforms = {"sm": "NVIDIA CUDA", "gf": "AMD Accelerated Parallel Processing", "ac": "Intel(R) OpenCL Graphics"}
    return DeviceInfo(0, target, platforms[target[:2]], "", "gpu", 1, 1)


def _to_ptx(source: Path, output: Path, *more: str) -> None:
    # What `ptxas` cannot inline would be called, with arguments in memory
    whole = ["-mllvm", "-inline-threshold=1000000"]
    bitcode = _library("nvptx64--nvidiacl.bc")
    front = ["-target", "nvptx64-nvidia-nvcl", *_OPTIONS, _ROUNDING, "-Xclang", "-target-cpu", "-Xclang", "sm_75"]
    _run(_clang(), *front, *bitcode, *whole, *more, "-S", str(source), "-o", str(output))


def _state_accesses(source: Path) -> tuple[int, int]:
    """Calls that load and store words of a path's state, after the compiler has left out what is of no use."""
    code = source.with_suffix(".ll")
    _to_ptx(source, code, "-emit-llvm")
    calls = re.findall(r"call .*@state_(load|store)\(", code.read_text())
    return calls.count("load"), calls.count("store")


def _nvidia(target: str, source: Path, options: str) -> _Numbers:
    ptx, cubin = source.with_suffix(".ptx"), source.with_suffix(".cubin")
    _to_ptx(source, ptx)
    limit = [f"-maxrregcount={options.rpartition('=')[2]}"] if options else []
    text = _run(_ptxas(), "-v", "-O3", *limit, f"-arch={target}", str(ptx), "-o", str(cubin))
    registers = max(map(int, re.findall(r"Used (\d+) registers", text)))
    frame, spills = 0, 0
    for stack, stores in re.findall(r"(\d+) bytes stack frame, (\d+) bytes spill stores", text):
        frame, spills = max(frame, int(stack)), max(spills, int(stores))
    with cubin.open("rb") as file:
        sizes = [part.data_size for part in ELFFile(file).iter_sections() if part.name.startswith(".text.")]
    # 65536 registers of a multiprocessor, given out to 4 warps at a time, and 8 to a thread
    most = {"sm_75": 32}.get(target, 64)
    warps = 65536 // (32 * 8 * math.ceil(registers / 8)) // 4 * 4
    return registers, spills, frame, min(warps, most) / most, max(sizes)


def _amd(target: str, source: Path, _: str) -> _Numbers:
    assembly = source.with_suffix(".s")
    front = ["-target", "amdgcn-amd-amdhsa", f"-mcpu={target}", *_OPTIONS, _ROUNDING]
    _run(_clang(), *front, *_library("amdgcn--amdhsa.bc"), "-S", str(source), "-o", str(assembly))
    text = assembly.read_text()

    def most(pattern: str) -> int:
        return max(map(int, re.findall(pattern, text)))

    waves = min(map(int, re.findall(r"; Occupancy: (\d+)", text)))
    return (
        most(r"\.vgpr_count: +(\d+)"),
        4 * most(r"\.vgpr_spill_count: +(\d+)"),
        most(r"\.private_segment_fixed_size: +(\d+)"),
        waves / (8 if target == "gfx90a" else 16),
        most(r"; codeLenInByte = (\d+)"),
    )


def _intel(target: str, source: Path, options: str) -> _Numbers:
    compiler, environment = _ocloc()
    given = ["-device", target, "--format", "zebin", "-options", f"-cl-std=CL1.2 -w {options}"]
    output = ["-output", "program", "-out_dir", str(source.parent)]
    _run(compiler, "compile", "-file", str(source), *given, *output, environment=environment)
    with next(source.parent.glob("program*.bin")).open("rb") as file:
        parts = list(ELFFile(file).iter_sections())
        sizes = [part.data_size for part in parts if part.name.startswith(".text.")]
        about = b"".join(part.data() for part in parts if part.name == ".ze_info").decode()
    found = []
    for kernel in about.split("- name: ")[1:]:
        simd = re.search(r"simd_size: +(\d+)", kernel)
        if simd is None:  # of the arguments' names
            continue
        memory = dict.fromkeys(("spill_fill_space", "private_space"), 0)
        for usage, size in re.findall(r"usage: +(\w+)\s+size: +(\d+)", kernel):
            memory[usage] = int(size)
        spills = memory["spill_fill_space"] // int(simd[1])  # of a thread of the hardware, which has as many lanes
        found.append((spills, spills + memory["private_space"]))
    # Of 32 bytes, for 8 lanes or more: with 128 of them all threads fit, with 256 half as many
    registers = 256 if options else 128
    return registers, max(each[0] for each in found), max(each[1] for each in found), 128 / registers, max(sizes)


TARGETS: Final[Mapping[str, Callable[[str, Path, str], _Numbers]]] = {
    "sm_75": _nvidia,
    "sm_90": _nvidia,
    "gfx90a": _amd,
    "gfx1100": _amd,
    "gfx1200": _amd,
    "acm-g10": _intel,
}
"""Turing, Hopper, CDNA 2, RDNA 3, RDNA 4, and Intel's Arc."""


def over_budget(usages: Sequence[Usage], budgets: Sequence[Usage]) -> Iterator[str]:
    """A line for each number that is above its budget, or that has none.

    Parameters
    ----------
    usages, budgets : sequence of Usage
    """
    allowed = {(each.program, each.target): each for each in budgets}
    for usage in usages:
        where = f"{usage.program} on {usage.target}"
        budget = allowed.get((usage.program, usage.target))
        if budget is None:
            yield f"{where}: no budget in {BUDGETS.name}"
            continue
        for name in ("registers", "spill_bytes", "scratch_bytes", "code_bytes", "loads", "stores"):
            found, most = getattr(usage, name), getattr(budget, name)
            # Compilers lay out code a little differently after small changes
            if found > (most * 1.05 if name == "code_bytes" else most):
                yield f"{where}: {name} is {found}, and {most} is the most"


def budgets() -> list[Usage]:
    """The committed budgets."""
    return [Usage(**each) for each in json.loads(BUDGETS.read_text())]


def page_with(usages: Sequence[Usage]) -> str:
    """The text of the page with tables of these numbers.

    Parameters
    ----------
    usages : sequence of Usage
    """
    text = PAGE.read_text()
    for mark, rows in ((_MARK, _table(usages)), (_STAGES_MARK, _stages_table(usages))):
        before, _, after = text.partition(mark)
        rest = after[after.index("\n\n", after.index("|---|")) + 1 :]  # behind the table that is there
        text = before + mark + "\n" + "\n".join(rows) + "\n" + rest
    return text


def _clang() -> str:
    found = [name for version in range(22, 18, -1) if (name := shutil.which(f"clang-{version}"))]
    if not found:
        raise MissingCompiler("Clang 19 or newer is not installed; scripts/gpu_static --install does that")
    return found[-1]  # the oldest of them, for the same numbers everywhere


def _library(name: str) -> list[str]:
    """Options that link libclc for a target. Only one version of it can be installed, so it is unpacked."""
    path = _UNPACKED / "usr" / "lib" / "clc" / name
    if not path.exists():
        raise MissingCompiler(f"{path} is missing; scripts/gpu_static --install unpacks it")
    return ["-Xclang", "-mlink-builtin-bitcode", "-Xclang", str(path)]


def _ptxas() -> str:
    beside = Path(sys.prefix).glob("lib/python*/site-packages/nvidia/cuda_nvcc/bin/ptxas")
    found = next(map(str, beside), None) or shutil.which("ptxas")
    if found is None:
        raise MissingCompiler("ptxas is not installed; scripts/gpu_static --install does that")
    return found


def _ocloc() -> tuple[str, dict[str, str]]:
    """The compiler, and the environment with its libraries: unpacked, because installed it would be a driver."""
    program = _UNPACKED / "usr" / "bin" / "ocloc"
    if not program.exists():
        raise MissingCompiler(f"{program} is missing; scripts/gpu_static --install unpacks it")
    libraries = sorted({str(each.parent) for each in _UNPACKED.rglob("*.so*")})
    return str(program), {**os.environ, "LD_LIBRARY_PATH": os.pathsep.join(libraries)}


def _run(program: str, *arguments: str, environment: Mapping[str, str] | None = None) -> str:
    ended = subprocess.run([program, *arguments], capture_output=True, text=True, env=environment, check=False)
    if ended.returncode != 0:
        raise RuntimeError(
            f"{Path(program).name} {' '.join(arguments)}: {ended.stderr.strip() or ended.stdout.strip()}"
        )
    return ended.stdout + ended.stderr


def _table(usages: Sequence[Usage]) -> Iterator[str]:
    """Rows of Markdown: registers, and in brackets bytes of spills and of scratch memory, where there are any."""
    targets = list(dict.fromkeys(each.target for each in usages))
    yield f"| program | {' | '.join(targets)} |"
    yield f"|---|{'---|' * len(targets)}"
    for program in dict.fromkeys(each.program for each in usages):
        cells = []
        for target in targets:
            one = next((each for each in usages if (each.program, each.target) == (program, target)), None)
            if one is None:
                cells.append("–")
                continue
            memory = f" ({one.spill_bytes}, {one.scratch_bytes})" if one.spill_bytes or one.scratch_bytes else ""
            cells.append(f"{one.registers}{memory}")
        yield f"| {program} | {' | '.join(cells)} |"


def _stages_table(usages: Sequence[Usage]) -> Iterator[str]:
    """Rows of Markdown: of each stage the share of a GPU's threads, and words of a path's state."""
    found = {each.program: each for each in usages if each.target == _STAGES_TARGET}
    yield f"| stage | {' | '.join(_TIERS)} |"
    yield f"|---|{'---|' * len(_TIERS)}"
    for stage in (*_STAGES, *_MASKED_STAGES):
        each = (found.get(f"staged/{stage}, {tier}") for tier in _TIERS)
        yield (
            f"| {stage} | "
            + " | ".join(f"{one.occupancy:.0%}, {one.loads} + {one.stores}" if one else "–" for one in each)
            + " |"
        )
    whole = (found.get(tier) for tier in _TIERS)
    yield "| one kernel | " + " | ".join(f"{one.occupancy:.0%}" if one else "–" for one in whole) + " |"


def main() -> int:
    """Print what programs take; returns 1 if one is over its budget, 3 if a compiler is missing."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("--target", action="append", choices=TARGETS, help="only this GPU; repeatable")
    parser.add_argument("--program", action="append", choices=PROGRAMS, help="only this program; repeatable")
    parser.add_argument("--json", action="store_true", help="print a list of objects in the place of a table")
    parser.add_argument(
        "--update", action="store_true", help=f"make what was found the budgets, in {BUDGETS.name} and docs/{PAGE.name}"
    )
    options = parser.parse_args()
    wanted = [(program, target) for program in options.program or PROGRAMS for target in options.target or TARGETS]
    try:
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            usages = list(pool.map(lambda each: measure(*each), wanted))
    except MissingCompiler as error:
        print(f"error: {error}", file=sys.stderr)
        return 3
    print(json.dumps([asdict(each) for each in usages], indent=1) if options.json else "\n".join(_table(usages)))
    if options.update:
        kept = {(each.program, each.target): each for each in (budgets() if BUDGETS.exists() else [])}
        kept |= {(each.program, each.target): each for each in usages}
        ordered = [
            kept[key] for key in ((program, target) for program in PROGRAMS for target in TARGETS) if key in kept
        ]
        BUDGETS.write_text("[\n" + ",\n".join(f" {json.dumps(asdict(each))}" for each in ordered) + "\n]\n")
        PAGE.write_text(page_with(ordered))
        return 0
    found = list(over_budget(usages, budgets() if BUDGETS.exists() else []))
    for line in found:
        print(line, file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
