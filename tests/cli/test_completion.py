"""Completion as a shell has it: the script that it reads, and what then comes of a word half typed."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from unittest.mock import patch

import pytest
from cli_support import call

import clrender
from clrender.cli import COMMANDS

SHELLS = ("bash", "zsh", "fish")


@pytest.fixture
def command(tmp_path: Path) -> Path:
    """A folder with the program `clrender`, which is this one."""
    program = tmp_path / "bin" / "clrender"
    program.parent.mkdir()
    package = Path(clrender.__path__[0]).parent
    program.write_text(f'#!/bin/sh\nPYTHONPATH={shlex.quote(str(package))} exec "{sys.executable}" -m clrender "$@"\n')
    program.chmod(0o755)
    return program.parent


def completed(command: Path, shell: str, *words: str) -> list[str]:
    """What a shell offers in place of the last word."""
    if shell == "bash":
        script = call("completion", shell)
        assert script.returncode == 0, script.stderr
        path = {"PATH": f"{command}{os.pathsep}{os.environ['PATH']}"}
        listed = " ".join(map(shlex.quote, words))
        ask = f"COMP_WORDS=({listed}); COMP_CWORD={len(words) - 1}; _clrender_completion clrender"
        ask += '; printf "%s\\n" "${COMPREPLY[@]}"'
        line = [shell, "-c", f"compopt() {{ :; }}\n{script.stdout}\n{ask}"]
        done = subprocess.run(line, capture_output=True, text=True, check=False, timeout=60, env={**os.environ, **path})
    else:  # what the functions of those shells do, without their editors
        last = str(len(words) - 1) if shell == "zsh" else words[-1]
        asked = {"_CLRENDER_COMPLETE": f"{shell}_complete", "COMP_WORDS": " ".join(words), "COMP_CWORD": last}
        with patch.dict(os.environ, asked):
            done = call()
    assert done.returncode == 0 and not done.stderr, done.stderr
    lines = done.stdout.splitlines()
    if shell == "zsh":  # type, word, help
        return lines[1::3]
    return [each.removeprefix("plain,").partition("\t")[0] for each in lines]


@pytest.mark.long
@pytest.mark.parametrize("shell", SHELLS)
def test_commands_scenes_options_settings_and_devices(command: Path, shell: str) -> None:
    assert completed(command, shell, "clrender", "co") == [name for name in COMMANDS if name.startswith("co")]
    assert {"room", "room-glass"} <= set(completed(command, shell, "clrender", "render", "roo"))
    assert set(completed(command, shell, "clrender", "render", "--ex")) == {
        "--exposure", "--exr-type", "--exr-compression", "--exr-tile"
    }  # fmt: skip
    assert completed(command, shell, "clrender", "render", "--integrator", "re") == ["reuse"]
    assert {"auto", "all"} <= set(completed(command, shell, "clrender", "render", "-d", "a"))
    assert {"room", "room-glass"} <= set(completed(command, shell, "clrender", "view", "roo"))
    assert {"auto", "all"} <= set(completed(command, shell, "clrender", "view", "-d", "a"))
    assert completed(command, shell, "clrender", "completion", "f") == ["fish"]


@pytest.mark.long  # probes all drivers
def test_devices_by_index(command: Path) -> None:
    listed = call("devices", "--json")
    assert listed.returncode == 0
    if listed.stdout.strip() != "[]":
        assert completed(command, "bash", "clrender", "render", "-d", "0") == ["0"]


def test_lists_of_layers_are_completed_at_their_end(command: Path) -> None:
    found = run_raw(command, "clrender render --aov albedo,de", "albedo,de")
    assert found == ["plain,albedo,depth"]
    assert not [each for each in run_raw(command, "clrender render --aov albedo,al", "x") if "albedo,albedo" in each]


def run_raw(command: Path, words: str, _last: str) -> list[str]:
    """Lines that bash is told."""
    asked = {"_CLRENDER_COMPLETE": "bash_complete", "COMP_WORDS": words, "COMP_CWORD": str(len(words.split()) - 1)}
    done = subprocess.run(
        [str(command / "clrender")],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        env={**os.environ, **asked},
    )
    assert not done.stderr
    return done.stdout.splitlines()


@pytest.mark.parametrize(
    "words", ["clrender render ./x", "clrender render -o x", "clrender tonemap x", "clrender render --environment x"]
)
def test_files_are_left_to_the_shell(command: Path, words: str) -> None:
    assert [each.partition(",")[0] for each in run_raw(command, words, "x")] == ["file"]


def test_commands_are_not_loaded_to_complete_their_names() -> None:
    code = "import sys; from clrender.cli import main\ntry: main()\nfinally: print(*sys.modules, file=sys.stderr)"
    asked = {"_CLRENDER_COMPLETE": "bash_complete", "COMP_WORDS": "clrender re", "COMP_CWORD": "1"}
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env={**os.environ, **asked},
    )
    assert "plain,render" in done.stdout
    assert not {"numpy", "pydantic", "clrender.cli.render"} & set(done.stderr.split())


def test_an_unknown_shell_gets_the_nearest() -> None:
    done = call("completion", "bsh")
    assert done.returncode == 2 and "bash" in done.stderr and done.stderr.count("\n") == 1


@pytest.mark.parametrize("shell", SHELLS)
def test_the_script_is_one_that_the_shell_reads(tmp_path: Path, shell: str) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    script = tmp_path / "script"
    script.write_text(call("completion", shell).stdout)
    done = subprocess.run([shell, "-n", str(script)], capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
