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
from clrender.datasets import load_spec
from clrender.integrators import INTEGRATORS

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "scenes").glob("*.md")])
COMMANDS = (ROOT / "docs" / "commands.md").read_text()
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


def test_every_command_of_the_table_exists_and_every_command_is_in_it() -> None:
    named = re.findall(r"^\| `clrender ([a-z]+)(?= |`)", COMMANDS, re.MULTILINE)
    assert set(named) == set(commands())


def test_the_readme_is_short() -> None:
    """It is read in two minutes; what is looked up is on the pages, once."""
    readme = ROOT / "README.md"
    assert len(readme.read_bytes()) <= 6 * 1024
    assert not re.search(r"^\|", readme.read_text(), re.MULTILINE), "a table belongs on a page"


def test_every_option_of_a_render_has_a_place_in_its_guide() -> None:
    named = set(re.findall(r"(?<![\w-])--?[a-zA-Z][a-z-]*", (ROOT / "docs" / "rendering.md").read_text()))
    names = {max(each.opts, key=len): set(each.opts) for each in commands()["render"].params if each.opts[0][0] == "-"}
    # Of one integrator, or of another setting: its own page has them
    others = re.compile(r"--(photon|patch|radiosity|reuse|light-paths|guiding-|save-guiding|help)")
    assert [name for name, any_of in names.items() if not named & any_of and not others.match(name)] == []


@for_each("page", [ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
def test_every_option_exists(page: Path) -> None:
    # Of scripts there are a few more, of pipx and podman, and of Dask
    scripts = "".join(path.read_text() for path in (ROOT / "scripts").glob("gpu_*") if path.is_file())
    dask = {"--nthreads", "--memory-limit", "--protocol", "--dashboard-address"}
    installers = {"--spec", "--from", "--rm", "--build-arg", "--python", "--no-deps"}
    installers |= {"--execute", "--to"}  # of nbconvert
    others = {"--install-peers", "--yes", "--by", "--long", *dask, *installers, *re.findall(r"--[a-z][a-z-]+", scripts)}
    named = set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", page.read_text())) - others
    assert named <= set(options())


def test_every_integrator_is_in_its_tables() -> None:
    page = (ROOT / "docs" / "integrators.md").read_text()
    assert all(f"\n| `{name}` |" in page for name in INTEGRATORS)
    heads = re.findall(r"^\| (?:light path )?\|( `path`.*)$|^\| a scene has \|(.*)$", page, re.MULTILINE)
    assert len(heads) == 3
    for head in heads:
        assert set(re.findall(r"`([a-z]+)`", "".join(head))) == set(INTEGRATORS)


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
    for ten, name in ((20, "twenty"), (30, "thirty"), (40, "forty")):
        numbers |= {ten + n: f"{name}{word}" for n, word in enumerate(more)}
    assert (
        f"{numbers[len(files)].capitalize()} built-in scenes, {numbers[exact]} of them"
        in (ROOT / "CHANGELOG.md").read_text()
    )
    assert f"{numbers[exact]} have a known exact answer" in COMMANDS


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
    assert named <= set(clrender.__all__) | {"radiosity", "cluster", "view", "datasets", "version"}
    assert set(clrender.__all__) - {"__version__"} <= named | set(re.findall(r"`([A-Z]\w+Error)`", REFERENCE))


def test_the_notebook_has_the_cells_of_its_page() -> None:
    notebook = json.loads((ROOT / "docs" / "notebook.ipynb").read_text())
    cells = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert cells == [
        block.text.strip() for block in blocks(ROOT / "docs" / "notebook.md") if block.language == "python"
    ]


GUIDED = {
    "Add a lobe of a BSDF": ("sheen", r"(?i)sheen"),
    "Add a light": ("projector", r"(?i)projector"),
    "Add a file format": ("stl", r"\.stl\b|read_stl|stl_text"),
}
"""Examples of the guide for developers: by section, what they add, and what is in every file with a part of it."""


@for_each("title", GUIDED)
def test_the_guide_names_every_file_of_its_examples(title: str) -> None:
    _, section = (ROOT / "docs" / "extend.md").read_text().split(f"## {title}\n")
    section = section.partition("\n## ")[0]
    named = set(re.findall(r"`((?:clrender|kernels|scripts|tests)/[\w/]+\.\w+)`", section))
    assert all((ROOT / name).is_file() for name in named), [name for name in named if not (ROOT / name).is_file()]
    word, pattern = GUIDED[title]
    files = [path for folder in ("clrender", "kernels") for path in (ROOT / folder).rglob("*")]
    found = {
        path.relative_to(ROOT).as_posix()
        for path in files
        if path.suffix in (".py", ".h", ".cl") and re.search(pattern, path.read_text())
    }
    assert len(found) > 4
    assert found - named == set(), f"files with {word} that the guide does not name"
    tests = [name for name in named if name.startswith("tests/")]
    # Those that run over all endings or keys name none
    general = {"tests/host/test_docs.py", "tests/statistics/test_sample_weights.py"}
    assert not [
        name for name in tests if name not in general and not re.search(f"(?i){word}", (ROOT / name).read_text())
    ]


def test_alternative_texts_say_what_is_to_be_seen() -> None:
    for page in PAGES:
        for text, name in re.findall(r"!\[([^\]]*)\]\(([^)]+)\)", page.read_text()):
            assert len(text.split()) >= 6, f"{page.name}: {name} has the text {text!r}"
            assert not re.match(r"(?i)(figures? \d|picture|image)", text), f"{page.name}: {name} has the text {text!r}"
