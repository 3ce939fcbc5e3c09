"""Optional packages: what the error of a missing one says, and that `scripts/clrender` is asked to install it."""

from __future__ import annotations

import configparser
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from cases import for_each
from gltf_files import Model

import clrender
from clrender import extras

ROOT = Path(clrender.__path__[0]).parent
SETUP = configparser.ConfigParser(interpolation=None)
SETUP.read(ROOT / "setup.cfg")
ALONE = ("cluster", "denoise", "gltf", "notebook", "report", "view")

RENDER = ("render", "room", "-o", "a.png")
LACKING = {
    "view": ("uvicorn", ("view", "room", "--no-open")),
    "denoise": ("pyoidn", (*RENDER, "--denoise")),
    "cluster": ("distributed", (*RENDER, "--cluster", "local:2")),
    "report": ("matplotlib", ("report", "--quick", "-o", "r")),
    "report, pages": ("matplotlib", ("furnace", "lambert", "-o", "f")),
    "gltf": ("DracoPy", ("check", "m.glb")),
}
"""By extra: a module of it, and a command that needs it."""


def parts(requirement: str) -> tuple[str, frozenset[str], str]:
    """Name, limits and environment of a requirement; build tools reorder the limits."""
    match = re.fullmatch(r"([\w.-]+)([^;]*);?(.*)", requirement.strip())
    assert match
    name, limits, environment = match.groups()
    return name, frozenset(limits.replace(" ", "").split(",")), environment.strip(" ()")


@for_each("extra", ALONE)
def test_the_command_installs_what_the_extra_declares(extra: str) -> None:
    declared = SETUP["options.extras_require"][extra].strip().splitlines()
    assert {parts(each) for each in extras.packages(extra)} == {parts(each) for each in declared}
    command = shlex.split(extras.install_command(extra))
    assert command[:4] == [sys.executable, "-m", "pip", "install"]
    assert {parts(each)[:2] for each in command[4:]} <= {parts(each)[:2] for each in declared}
    assert len({parts(each)[0] for each in command[4:]}) == len(command[4:]), "a package is there once"


@for_each("version, machine, wanted", [
    ((3, 10), "x86_64", ["usd-core>=25.11", "numcodecs>=0.13,<1"]),
    ((3, 12), "aarch64", ["usd-core>=25.11", "numcodecs>=0.13,<1", "meshopt"]),
    ((3, 13), "x86_64", ["usd-core>=25.11", "numcodecs>=0.15", "meshopt"]),
    ((3, 11), "aarch64", ["numcodecs>=0.13,<1", "meshopt"]),
])  # fmt: skip
def test_the_command_has_no_conditions_but_what_they_select(
    monkeypatch: pytest.MonkeyPatch, version: tuple[int, int], machine: str, wanted: list[str]
) -> None:
    declared = [
        'usd-core>=25.11; (platform_machine == "x86_64" or sys_platform == "darwin" or python_version >= "3.12")',
        'numcodecs>=0.13,<1; python_version < "3.13"',
        'numcodecs>=0.15; python_version >= "3.13"',
        'meshopt; python_version >= "3.11"',
        'ktx; sys_platform == "linux" and platform_machine == "never"',
    ]
    monkeypatch.setattr(extras, "packages", lambda extra: declared)
    monkeypatch.setattr(sys, "version_info", version)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr("platform.machine", lambda: machine)
    assert shlex.split(extras.install_command("usd"))[4:] == wanted


def test_a_python_without_pip_is_served_by_uv_and_an_uninstalled_clone_names_its_folder(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "pip", None)
    monkeypatch.setattr(extras, "packages", lambda extra: [])
    command = shlex.split(extras.install_command("view"))
    assert command == ["uv", "pip", "install", "--python", sys.executable, f"{ROOT}[view]"]


def clrender_without(module: str, folder: Path, *arguments: str, **variables: str) -> tuple[int, str]:
    """Exit status and errors of the command line where a module is not installed."""
    code = f"import sys; sys.modules[{module!r}] = None; from clrender.__main__ import main; main()"
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **variables}
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        cwd=folder, capture_output=True, text=True, timeout=120, check=False, env=environment,
    )  # fmt: skip
    assert done.stdout == ""
    return done.returncode, done.stderr


@pytest.mark.long
@pytest.mark.parametrize("case", LACKING)
def test_the_script_that_started_a_command_is_asked_for_the_extra(tmp_path: Path, case: str) -> None:
    module, command = LACKING[case]
    extra = case.partition(",")[0]
    model = Model()
    model.extend("KHR_draco_mesh_compression", required=True)
    draco = {"bufferView": model.view(bytes(64)), "attributes": {"POSITION": 0}}
    position = model.add(
        "accessors", {"componentType": 5126, "count": 3, "type": "VEC3", "min": [0] * 3, "max": [1] * 3}
    )
    primitive = {"attributes": {"POSITION": position}, "extensions": {"KHR_draco_mesh_compression": draco}}
    model.node(mesh=model.add("meshes", {"primitives": [primitive]}))
    model.write(tmp_path / "m.glb")
    before = sorted(tmp_path.iterdir())
    script = tmp_path.with_name("script")
    script.write_text('#!/bin/sh\nprintf "%s\\n" "$@" >&2\nexit 7\n')
    script.chmod(0o755)
    # Before anything is said or written; where it has been tried, and without the script, the cure is told.
    asked = clrender_without(module, tmp_path, *command, CLRENDER_SCRIPT=str(script))
    assert asked == (7, "\n".join(["--extra", extra, *command, ""]))
    again = {"CLRENDER_SCRIPT": str(script), "CLRENDER_EXTRA": extra}
    for tried in ({}, again) if case == "gltf" else ({},):
        status, said = clrender_without(module, tmp_path, *command, **tried)
        assert status == 2 and said.startswith("error: ") and said.count("\n") == 1
        assert extras.install_command(extra) in said
    assert sorted(tmp_path.iterdir()) == before


def test_no_page_names_a_package_that_no_index_has() -> None:
    pages = [ROOT / "README.md", ROOT / "man" / "clrender.1", *(ROOT / "docs").rglob("*.md")]
    pages += [path for path in (ROOT / "clrender").rglob("*") if path.suffix in (".py", ".js", ".html")]
    wrong = [f"{path}: {line}" for path in pages for line in path.read_text().splitlines() if "clrender[" in line]
    assert wrong == []
