"""The package as it is installed, and the rules of the kernels with the linter that enforces them."""

from __future__ import annotations

import configparser
import importlib.util
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
from cases import for_each

from clrender.files.package_data import kernels_folder, scenes_folder

ROOT = Path(__file__).resolve().parents[2]
GOOD = "// For a test.\nkernel void f(global float* a) { a[0] = 1.0f; }\n"


def _linter() -> ModuleType:
    spec = importlib.util.spec_from_file_location("lint_kernels", ROOT / "scripts" / "lint_kernels.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


LINTER = _linter()
lint: Callable[[Path], list[str]] = LINTER.lint
lint_text: Callable[[str, str], list[str]] = LINTER.lint_text


def test_the_kernels_keep_their_rules() -> None:
    assert LINTER.main([]) == 0


@for_each(
    ("line", "fault"),
    [
        ("float a = dot(b, c);", "dot differs from driver to driver"),
        ("float a = rsqrt(b);", "rsqrt differs"),
        ("float a = native_divide(b, c);", "unspecified precision"),
        ("float a = mad(b, c, d);", "write fma"),
        ("double a;", "not exist on every device"),
        ("double4 a;", "not exist on every device"),
        ("half a;", "not exist on every device"),
        ("float a = b / c;", "core/quotient.h"),
        ("float a = 2.0f * b[3] / (c + d);", "core/quotient.h"),
        ("a /= b;", "core/quotient.h"),
        ("float a = sqrt(b);", "core/quotient.h"),
        ("float a = 1.0;", "needs the suffix f"),
        ("float a = .5;", "needs the suffix f"),
        ("float a = 1e-3;", "needs the suffix f"),
        ('printf("hello");', "linkers"),
        ("read_imagef(a, b, c);", "filters differently"),
        ("#pragma OPENCL FP_CONTRACT ON", "round differently"),
        ("// harmless\n/* -cl-fast */ int a; -cl-fast-relaxed-math", "round differently"),
        ("vfloat a = l.row[6];", "is a bare column"),
        ("static Ray f(Ray r, uint n) {\n    r.limit *= n;", "given by value"),
        ("static vec3 f(const Ray* r,\n     vec3 v) {\n    v = r->origin;", "given by value"),
        ("__attribute__((always_inline)) static Hit f(int a) {", "Oclgrind runs no inlined function"),
        ("#include <b.h>", "includes read"),
        ('#include "../b.h"', "includes read"),
    ],
)
def test_the_linter_finds(line: str, fault: str) -> None:
    faults = lint_text("room/a.cl", f"// For a test.\n{line}\n")
    assert len(faults) == 1
    assert fault in faults[0]
    assert faults[0].startswith(f"room/a.cl:{1 + line.count(chr(10)) + 1}: ")


def test_the_linter_leaves_good_code_alone(tmp_path: Path) -> None:
    (tmp_path / "a.cl").write_text(GOOD)
    assert lint(tmp_path) == []
    assert (
        lint_text("core/exact.h", "// x\n#ifndef CORE_EXACT_H\n#define CORE_EXACT_H\nfloat s = cos(1.0f);\n#endif\n")
        == []
    )
    assert lint_text("a.cl", "// dot(a, b), 1.0 and double in a comment; x.yz 0x1.8p3f 1.5e-3f 3u\n") == []


def test_the_linter_looks_at_whole_programs(tmp_path: Path) -> None:
    (tmp_path / "b.cl").write_text('// x\n#include "none.h"\n')
    (tmp_path / "c.h").write_text("// no guard\n")
    (tmp_path / "d.txt").write_text("")
    (tmp_path / "e.cl").write_text("int a;\n")
    faults = "\n".join(lint(tmp_path))
    for part in ('b.cl:2: kernel file "none.h"', "c.h:1: a header has the include guard C_H"):
        assert part in faults
    for part in ("d.txt:1: kernels are", "e.cl:1: the first line says", "e.cl:1: a .cl file holds entry points"):
        assert part in faults


def test_shared_structs_hold_plain_members_only() -> None:
    header = "// x\n#ifndef TYPES_H\n#define TYPES_H\ntypedef struct {{\n    float4 a;\n    {}\n}} S;\n#endif\n"
    assert lint_text("types.h", header.format("uint b;")) == []
    for member in ("float3 b;", "bool b;", "size_t b;", "float *b;", "float2 b;"):
        assert "shared structs hold" in lint_text("types.h", header.format(member))[0]


def test_resources_are_found() -> None:
    assert (kernels_folder() / "types.h").is_file()
    assert scenes_folder().is_dir()


def test_every_room_is_packed() -> None:
    """And every file of a room that is no module. The tests run from the folder itself, where none can be missing."""
    told = configparser.ConfigParser()
    told.read(ROOT / "setup.cfg")
    packages = set(told["options"]["packages"].split()) - {"clrender.kernels", "clrender.scenes"}
    folders = {path.parent.relative_to(ROOT) for path in (ROOT / "clrender").rglob("*.py")}
    assert packages == {".".join(folder.parts) for folder in folders}
    data = told["options.package_data"]
    others = {path for path in _files(ROOT / "clrender") if path.suffix not in (".py", ".pyc")}
    packed = {path for name in packages & set(data) for path in _matching(ROOT / name.replace(".", "/"), data[name])}
    assert others == packed


def _matching(folder: Path, patterns: str) -> set[Path]:
    return {path for pattern in patterns.split() for path in folder.glob(pattern) if path.is_file()}


@pytest.mark.long
def test_a_wheel_brings_kernels_and_scenes_and_nothing_of_an_earlier_build(tmp_path: Path) -> None:
    source = tmp_path / "source"
    ignored = shutil.ignore_patterns(".venv", ".git", "build", "*.egg-info", "__pycache__", ".*_cache", ".hypothesis")
    shutil.copytree(ROOT, source, ignore=ignored)
    for stale in ("kernels/camera/old.h", "kernels/old.cl", "integrators/old.py", "scenes/old.toml"):
        left = source / "build" / "lib" / "clrender" / stale
        left.parent.mkdir(parents=True, exist_ok=True)
        left.write_text("from an earlier build")
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "-w", str(tmp_path), str(source)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (wheel,) = tmp_path.glob("clrender-*.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    wanted = {f"clrender/{path.relative_to(ROOT).as_posix()}" for path in _files(ROOT / "kernels", ROOT / "scenes")}
    wanted |= {
        path.relative_to(ROOT).as_posix() for path in _files(ROOT / "clrender") if "__pycache__" not in path.parts
    }
    assert {name for name in names if name.startswith("clrender/")} == wanted


@pytest.mark.slow
def test_the_package_works_in_empty_environments() -> None:
    """With the oldest and the newest dependencies, of every Python here; needs a network, as any installation does."""
    done = subprocess.run([str(ROOT / "scripts" / "package_check")], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "oldest dependencies" in done.stdout and "newest dependencies" in done.stdout


def _files(*folders: Path) -> list[Path]:
    return [path for folder in folders for path in folder.rglob("*") if path.is_file() and path.suffix != ".pyc"]
