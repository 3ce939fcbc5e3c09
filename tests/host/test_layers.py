"""Imports point down the list of layers only, and every module says what it offers."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import clrender.errors

PACKAGE = Path(clrender.errors.__file__).parent

# Top to bottom: a module may import what stands at its own place or below. Names that share a line are one layer.
LAYERS = (
    ("__main__",),
    ("cli",),
    ("view",),
    ("bench",),
    ("report",),
    ("__init__",),
    ("agreement", "furnace", "verification"),
    ("rendering",),
    ("cluster",),
    ("session",),
    ("job_render", "job_memory", "job_effort"),
    ("convergence_plot",),
    ("device_team", "rendered_image", "render_stats", "image_html"),
    ("job",),
    ("aov",),
    ("radiosity", "photon_maps"),
    ("scheduling",),
    ("device",),
    ("flatten",),
    ("features",),
    ("film",),
    ("importers", "exporters"),
    ("scene",),
    ("settings",),
    ("integrators",),
    ("limits", "exposure", "memory", "huge_pages", "heap"),
    ("image",),
    ("files", "npy", "turn", "stages"),
    ("resources",),
    ("pixel_filter",),
    ("layout",),
    ("drawing", "chi_squared", "exact", "student"),
    ("extras",),
    ("elapsed", "shield"),
    ("errors", "version"),
)
RANK = {name: rank for rank, names in enumerate(LAYERS) for name in names}
MODULES = sorted(path for path in PACKAGE.rglob("*.py") if "scenes" not in path.parts)
NAMES = [path.relative_to(PACKAGE).as_posix() for path in MODULES]


def layer(path: Path) -> str:
    """Layer of a file of the package."""
    relative = path.relative_to(PACKAGE)
    return relative.parts[0] if len(relative.parts) > 1 else relative.stem


def imports(tree: ast.AST) -> Iterator[tuple[int, str, tuple[str, ...]]]:
    """(line, module, names taken from it) of every import, wherever it stands; those for types only are none."""
    typing_only = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)
        for inner in ast.walk(node)
    }
    for node in ast.walk(tree):
        if id(node) in typing_only:
            continue
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name, ()
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.lineno, node.module, tuple(alias.name for alias in node.names)


def imported(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """(line, layer) of every import of the package."""
    for line, module, taken in imports(tree):
        for name in [f"clrender.{each}" for each in taken] if module == "clrender" and taken else [module]:
            parts = name.split(".")
            if parts[0] == "clrender":
                yield line, parts[1] if len(parts) > 1 and parts[1] in RANK else "__init__"


def import_graph() -> dict[str, set[str]]:
    """Which modules of the package each of them imports."""
    modules = {}
    for path in MODULES:
        parts = ("clrender", *path.relative_to(PACKAGE).with_suffix("").parts)
        modules[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    graph: dict[str, set[str]] = {name: set() for name in modules}
    for name, path in modules.items():
        for _, module, taken in imports(ast.parse(path.read_text())):
            below = [f"{module}.{each}" for each in taken if f"{module}.{each}" in modules]
            graph[name] |= {each for each in below or [module] if each in modules}
    return graph


def circles(graph: dict[str, set[str]]) -> set[frozenset[str]]:
    """Largest sets of modules that each import all others of theirs, by way of others perhaps."""
    reached = {}
    for start in graph:
        found: set[str] = set()
        ahead = [start]
        while ahead:
            for name in graph[ahead.pop()] - found:
                found.add(name)
                ahead.append(name)
        reached[start] = found
    return {frozenset(b for b in found if a in reached[b]) for a, found in reached.items() if a in found}


def test_no_module_imports_itself_by_way_of_others() -> None:
    assert not circles(import_graph())


def test_circles_are_found() -> None:
    graph = {"a": {"b"}, "b": {"c"}, "c": {"b", "d"}, "d": set(), "e": {"e"}}
    assert circles(graph) == {frozenset({"b", "c"}), frozenset({"e"})}


@pytest.mark.parametrize("path", MODULES, ids=NAMES)
def test_imports_point_down(path: Path) -> None:
    own = layer(path)
    assert own in RANK, f"{path.name} has no place in the list of layers"
    wrong = [
        f"{path.relative_to(PACKAGE)}:{line}: {own} imports {name}, which is above it"
        for line, name in imported(ast.parse(path.read_text()))
        if RANK[name] < RANK[own]
    ]
    assert not wrong


@pytest.mark.parametrize("path", MODULES, ids=NAMES)
def test_every_module_says_what_it_is_for_and_what_it_offers(path: Path) -> None:
    tree = ast.parse(path.read_text())
    assert ast.get_docstring(tree), f"{path} begins with no docstring"
    targets = [
        target.id
        for node in tree.body
        if isinstance(node, (ast.Assign, ast.AnnAssign))
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
        if isinstance(target, ast.Name)
    ]
    assert "__all__" in targets, f"{path} has no __all__"


def test_only_the_command_line_prints_or_exits() -> None:
    # child.py and the peers are programs of their own processes, and layout.py writes a generated file when run as one.
    loud = [
        f"{path.relative_to(PACKAGE)}:{node.lineno}"
        for path in MODULES
        if layer(path) not in ("cli", "__main__") and path.name != "child.py" and not path.name.startswith("peer_")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and ast.unparse(node.func) in ("print", "sys.exit", "exit", "input")
    ]
    assert not loud


def test_pyopencl_is_imported_only_below_device() -> None:
    wrong = [
        path.relative_to(PACKAGE).as_posix()
        for path in MODULES
        if layer(path) != "device" and "import pyopencl" in path.read_text()
    ]
    assert not wrong
