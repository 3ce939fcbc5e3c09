"""Every command that the documentation shows is run, page by page in the order of the page, as a reader would.

Renders are made smaller where the page does not show what they print. What it shows has to come out.
"""

from __future__ import annotations

import configparser
import os
import re
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import click.testing
import pytest
from cases import for_each
from doc_blocks import Block, blocks
from documented_files import make_files

from clrender.cli import main

ROOT = Path(__file__).resolve().parents[2]
DEVICE = os.environ.get("CLRENDER_TEST_DEVICE", "pocl")
FIRST = ("README.md", "docs/start.md")
"""Pages that are read first. The others are slow."""
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
NO_COMMANDS = ("text", "toml", "python", "json", "c", "{eval-rst}")
"""Languages of blocks that are no commands; scenes and Python are run by other tests, and plugins by commands."""


@dataclass(frozen=True)
class Command:
    """A line to type, and what has to be printed then, if the page says that."""

    line: str
    printed: list[str]


def commands(block: Block) -> list[Command]:
    """Of a block: each line, or each line that begins with a prompt, with what follows up to the next one."""
    lines = block.text.strip("\n").split("\n")
    if not lines[0].startswith("$ "):
        return [Command(line, []) for line in lines if line.strip()]
    found: list[Command] = []
    for line in lines:
        if line.startswith("$ "):
            found.append(Command(line[2:], []))
        elif line.strip():
            found[-1].printed.append(line)
    return found


def named(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


RUN = [
    pytest.param(page, id=named(page), marks=pytest.mark.long if named(page) in FIRST else pytest.mark.slow)
    for page in PAGES
    if any(block.not_run is None and block.language == "console" for block in blocks(page))
]


def smaller(arguments: list[str]) -> list[str]:
    """A command that is as good an example and takes less time."""
    name, more = arguments[0], arguments[1:]

    def given(option: str, value: str) -> None:
        if option in more:
            more[more.index(option) + 1] = value
        else:
            more.extend([option, value])

    if name == "render" and "64x64" not in more:  # which is small enough
        errors = any(each in more for each in ("--error", "--replicate-spp")) or any("stderr" in each for each in more)
        given("--size", "24x16")
        given("--spp", "256" if errors else "4")
    if name == "radiosity":
        for option, value in (("--size", "24x16"), ("--patches", "200"), ("--frames", "2"), ("--spp", "1")):
            given(option, value)
    if name == "furnace":
        more.append("--quick")
    return [name, *more]


def matches(line: str, printed: str) -> bool:
    """Whether a printed line is that of the page, in which `...` stands for anything and blanks count alike."""
    parts = (re.escape(part) for part in " ".join(line.split()).split("..."))
    return re.fullmatch(".*".join(parts), " ".join(printed.split())) is not None


def check(command: Command) -> None:
    """Run a command, and look for the lines that the page shows, in their order, among those that it prints."""
    words = shlex.split(command.line, comments=True)
    if words[:2] == ["pip", "install"]:
        setup = configparser.ConfigParser()
        setup.read(ROOT / "setup.cfg")
        wanted = re.findall(r"\[([a-z,]+)\]", " ".join(words))
        if words[2:] == ["."]:
            return
        assert wanted and set(",".join(wanted).split(",")) <= set(setup["options.extras_require"])
        return
    assert Path(words[0]).name == "clrender", f"{command.line!r} is no command of clrender: say why it is not run"
    arguments = words[1:] if command.printed or len(words) == 2 else smaller(words[1:])
    code, output = ran(arguments)
    refused = any(line.startswith("error:") for line in command.printed)
    assert code == (2 if refused else 0), f"{command.line}\n{output}"
    printed = iter(output.splitlines())
    for line in command.printed:
        assert any(matches(line, each) for each in printed), f"{command.line}\n{line!r} is not printed:\n{output}"


def ran(arguments: list[str]) -> tuple[int, str]:
    """Exit code and output of a command; where its memory counts, of a process of its own."""
    if "--max-memory" in arguments:
        command = [sys.executable, "-m", "clrender", *arguments]
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        return done.returncode, done.stdout
    inside = click.testing.CliRunner().invoke(main, arguments, prog_name="clrender")
    return inside.exit_code, inside.output


@pytest.mark.thorough
@pytest.mark.usefixtures("only_driver")
@pytest.mark.parametrize("page", RUN)
def test_the_commands_of_a_page_do_what_it_says(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("CLRENDER_DEVICE", DEVICE)
    make_files(tmp_path)
    for block in blocks(page):
        if block.file is not None:
            (tmp_path / block.file).write_text(block.text)
        if block.language == "console" and block.not_run is None:
            for command in commands(block):
                check(command)


@for_each("page", PAGES)
def test_every_block_is_run_or_says_why_not(page: Path) -> None:
    for block in blocks(page):
        place = f"{page.name}:{block.line}"
        if block.not_run is not None:
            assert len(block.not_run) > 10, f"{place}: the reason is too short"
        elif block.language == "console":
            starts = re.compile(r"\./scripts/clrender |clrender |pip install ")
            assert all(starts.match(each.line) for each in commands(block)), f"{place}: no command that tests can run"
        else:
            assert block.language in NO_COMMANDS, f"{place}: {block.language!r} is run by no test"
            if block.language == "text":
                assert not re.search(r"^\$? ?(\./scripts/)?clrender ", block.text, re.MULTILINE), f"{place}: a command"


def test_a_command_that_fails_or_prints_something_else_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(AssertionError):
        check(Command("clrender scenes", ["no such line"]))
    with pytest.raises(AssertionError):
        check(Command("clrender check no-such-scene", []))
    check(Command("clrender scenes", ["room  ..."]))
