"""What the documentation says of commands, options, files and links is so."""

from __future__ import annotations

import fnmatch
import json
import re
import runpy
from collections.abc import Callable
from pathlib import Path

import click
import pytest
from cases import for_each
from doc_blocks import blocks
from documented_files import make_files

import clrender
from clrender.cli import main
from clrender.cli.options import DomainType
from clrender.datasets import load_spec
from clrender.integrators import INTEGRATORS
from clrender.limits import Choice

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "scenes").glob("*.md")])
README = (ROOT / "README.md").read_text()
REFERENCE = (ROOT / "docs" / "reference.md").read_text()


def generator(name: str) -> Callable[..., str]:
    """`current` of a script that makes a page."""
    found: Callable[..., str] = runpy.run_path(str(ROOT / "scripts" / f"{name}.py"))["current"]
    return found


def commands() -> dict[str, click.Command]:
    """The commands of the command line, by name."""
    context = click.Context(main, **main.context_settings)
    return {name: found for name in main.list_commands(context) if (found := main.get_command(context, name))}


def options() -> dict[str, list[click.Parameter]]:
    """Options of all commands, by their long name."""
    found: dict[str, list[click.Parameter]] = {"--help": [], "--version": []}
    for command in commands().values():
        for parameter in command.params:
            for name in parameter.opts:
                found.setdefault(name, []).append(parameter)
    return found


def test_the_scene_reference_is_that_of_the_schema() -> None:
    page = (ROOT / "docs" / "scene-file.md").read_text()
    assert generator("scene_docs")(page) == page, "run `python scripts/scene_docs.py`"


def test_the_table_of_speeds_is_that_of_its_numbers() -> None:
    pytest.importorskip("matplotlib")
    page = (ROOT / "docs" / "speed.md").read_text()
    data = json.loads((ROOT / "docs" / "speed.json").read_text())
    assert generator("speed_docs")(page, data) == page, "run `python scripts/speed_docs.py`"


def test_the_page_on_scaling_is_that_of_its_numbers() -> None:
    page = (ROOT / "docs" / "scaling.md").read_text()
    data = json.loads((ROOT / "docs" / "scaling.json").read_text())
    assert generator("scaling_docs")(page, data) == page, "run `python scripts/scaling_docs.py`"


def test_the_manual_page_is_that_of_the_command_line() -> None:
    page = (ROOT / "man" / "clrender.1").read_text()
    assert generator("man_page")(page) == page, "run `python scripts/man_page.py`"


@for_each("page", PAGES)
def test_links_lead_somewhere(page: Path) -> None:
    text = page.read_text()
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        place, _, heading = link.partition("#")
        if link.startswith(("http://", "https://")):
            continue
        target = (page.parent / place).resolve() if place else page
        assert target.is_file(), f"{page.name} links to {link}"
        if heading:
            headings = re.findall(r"^#+ (.*)$", target.read_text(), re.MULTILINE)
            assert heading in [re.sub(r"[^\w -]", "", each).strip().lower().replace(" ", "-") for each in headings]


def test_every_command_of_the_readme_exists_and_every_command_is_in_it() -> None:
    named = set(re.findall(r"clrender ([a-z]+)(?= |`)", README)) - {"command", "is", "grew", "does"}
    assert named == set(commands())


@for_each("page", [README, REFERENCE, *(path.read_text() for path in (ROOT / "docs").glob("[!n]*.md"))])
def test_every_option_exists(page: str) -> None:
    # Of scripts there are a few more, of pipx and podman, and of Dask
    scripts = "".join(path.read_text() for path in (ROOT / "scripts").glob("gpu_*") if path.is_file())
    dask = {"--nthreads", "--memory-limit", "--protocol", "--dashboard-address"}
    installers = {"--spec", "--from", "--rm", "--build-arg", "--python"}
    others = {"--install-peers", "--yes", "--by", *dask, *installers, *re.findall(r"--[a-z][a-z-]+", scripts)}
    named = set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", page)) - others
    assert named <= set(options())


def test_choices_of_options_are_those_of_the_command_line() -> None:
    for name, listed in re.findall(r"`(--[a-z-]+) ((?:[a-z]+\\\|)+[a-z]+)`", README):
        domains = [each.type.domain for each in options()[name] if isinstance(each.type, DomainType)]
        assert domains
        assert all(isinstance(each, Choice) and set(listed.split("\\|")) == set(each.members) for each in domains)


def test_every_integrator_is_in_its_tables() -> None:
    for page in (README, (ROOT / "docs" / "integrators.md").read_text()):
        assert all(f"`{name}`" in page for name in INTEGRATORS)


def completed(text: str) -> str:
    """A scene of what may be a part of one: with a camera, and a ball of each material that no shape has."""
    if not re.search(r"^\[camera\]", text, re.MULTILINE):
        text += "\n[camera]\nposition = [0.0, 0.0, -3.0]\ntarget = [0.0, 0.0, 0.0]\n"
    if not re.search(r"^\[\[shapes\]\]", text, re.MULTILINE):
        for name in re.findall(r"^\[materials\.(\w+)\]", text, re.MULTILINE) or [""]:
            text += '\n[[shapes]]\ntype = "sphere"\nradius = 1.0\n' + (f'material = "{name}"\n' if name else "")
    return text


@for_each("page", PAGES)
def test_scenes_of_the_documentation_are_valid(tmp_path: Path, page: Path) -> None:
    make_files(tmp_path)
    for block in blocks(page):
        if block.language == "toml" and block.file is not None and block.file.endswith("set.toml"):
            (tmp_path / block.file).write_text(block.text)
            assert load_spec(tmp_path / block.file).images > 0
        elif block.language == "toml":
            (tmp_path / "scene.toml").write_text(completed(block.text))
            if block.file == "wrong.toml":
                with pytest.raises(clrender.SceneError):
                    clrender.load(str(tmp_path / "scene.toml"))
            else:
                assert clrender.load(str(tmp_path / "scene.toml")).shapes


def test_the_settings_are_those_of_the_table() -> None:
    page = (ROOT / "docs" / "settings.md").read_text()
    assert generator("setting_docs")(page) == page, "run `python scripts/setting_docs.py`"


def test_the_rooms_are_those_of_the_package() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text()
    assert generator("rooms")(page) == page, "run `python scripts/rooms.py`"


def test_the_architecture_names_files_that_are_there() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text()
    named = set(re.findall(r"`([\w/]+\.(?:py|h|cl|inc))`", page))
    assert len(named) > 60
    there = [
        path.as_posix()
        for folder in ("clrender", "kernels", "tests", "scripts")
        for path in (ROOT / folder).rglob("*.*")
    ]
    assert not [
        name
        for name in named
        if name != "kernels/material/lobe/NAME.h" and not any(path.endswith(f"/{name}") for path in there)
    ]


def test_every_picture_has_a_script_that_makes_it() -> None:
    pytest.importorskip("matplotlib")
    makers = runpy.run_path(str(ROOT / "scripts" / "figure_docs.py"))
    patterns = [*makers["FIGURES"], *makers["OTHERS"]]
    pictures = [path.name for path in (ROOT / "docs").iterdir() if path.suffix in (".jpg", ".png", ".svg")]
    for name in pictures:
        assert sum(fnmatch.fnmatch(name, pattern) for pattern in patterns) == 1, name
    assert all(fnmatch.filter(pictures, pattern) for pattern in patterns)


def test_built_in_scenes_are_counted_right() -> None:
    files = [path.read_text() for path in (ROOT / "scenes").glob("*.toml")]
    exact = sum("Exact answer" in text for text in files)
    more = ("", "-one", "-two", "-three", "-four", "-five", "-six", "-seven", "-eight", "-nine")
    numbers = {11: "eleven"}
    for ten, name in ((20, "twenty"), (30, "thirty")):
        numbers |= {ten + n: f"{name}{word}" for n, word in enumerate(more)}
    assert (
        f"{numbers[len(files)].capitalize()} built-in scenes, {numbers[exact]} of them"
        in (ROOT / "CHANGELOG.md").read_text()
    )
    assert f"{numbers[exact]} have a known exact answer" in README


def test_variables_of_the_environment_are_read_somewhere() -> None:
    named = set(re.findall(r"`(_?CLRENDER_[A-Z_]+)`", REFERENCE))
    files = [path for folder in ("clrender", "scripts", "tests") for path in (ROOT / folder).rglob("*")]
    read = {
        name
        for path in files
        if path.is_file() and path != Path(__file__) and path.suffix in ("", ".py", ".sh")
        for name in re.findall(r"_?CLRENDER_[A-Z_]+", path.read_text())
    }
    assert named == read


def test_names_of_the_python_interface_exist() -> None:
    named = set(re.findall(r"`clrender\.([A-Za-z_]+)", REFERENCE))
    assert named <= set(clrender.__all__) | {"radiosity", "cluster", "view", "datasets"}
    assert set(clrender.__all__) - {"__version__"} <= named | set(re.findall(r"`([A-Z]\w+Error)`", REFERENCE))


def test_the_notebook_has_the_cells_of_its_page() -> None:
    notebook = json.loads((ROOT / "docs" / "notebook.ipynb").read_text())
    cells = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert cells == [
        block.text.strip() for block in blocks(ROOT / "docs" / "notebook.md") if block.language == "python"
    ]
