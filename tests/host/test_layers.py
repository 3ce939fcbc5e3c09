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
    ("bench",),
    ("report",),
    ("__init__",),
    ("agreement",),
    ("rendering",),
    ("session",),
    ("rendered_image", "render_stats"),
    ("job",),
    ("aov",),
    ("radiosity", "photon_maps"),
    ("scheduling",),
    ("device",),
    ("flatten",),
    ("film",),
    ("scene",),
    ("settings",),
    ("integrators",),
    ("limits",),
    ("image",),
    ("files",),
    ("resources",),
    ("layout",),
    ("student",),
    ("errors", "version"),
)
RANK = {name: rank for rank, names in enumerate(LAYERS) for name in names}
MODULES = sorted(path for path in PACKAGE.rglob("*.py") if "scenes" not in path.parts)
NAMES = [path.relative_to(PACKAGE).as_posix() for path in MODULES]


def layer(path: Path) -> str:
    """Layer of a file of the package."""
    relative = path.relative_to(PACKAGE)
    return relative.parts[0] if len(relative.parts) > 1 else relative.stem


def imported(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """(line, layer) of every import of the package, wherever it stands; those for types only are no imports."""
    typing_only = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)
        for inner in ast.walk(node)
    }
    for node in ast.walk(tree):
        names: list[str] = []
        if id(node) in typing_only:
            continue
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module] if node.module != "clrender" else [f"clrender.{alias.name}" for alias in node.names]
        line = getattr(node, "lineno", 0)
        for name in names:
            parts = name.split(".")
            if parts[0] == "clrender":
                yield line, parts[1] if len(parts) > 1 and parts[1] in RANK else "__init__"


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
