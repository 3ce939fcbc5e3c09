"""The rooms of the package, and which of them may import which: what `docs/architecture.md` shows and tests enforce.

``python scripts/rooms.py`` writes the generated part of that page.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from made_part import with_part

import clrender.errors

__all__ = ["LAYERS", "MODULES", "PACKAGE", "RANK", "circles", "current", "import_graph", "imported", "room_of", "rooms"]

PACKAGE: Final = Path(clrender.errors.__file__).parent
PAGE: Final = Path(__file__).resolve().parents[1] / "docs" / "architecture.md"

LAYERS: Final = (
    ("__main__",),
    ("cli",),
    ("bench",),
    ("report",),
    ("__init__",),
    ("view", "inspection"),
    ("agreement", "furnace", "verification", "datasets"),
    ("api",),
    ("cluster",),
    ("rendering",),
    ("aov",),
    ("radiosity", "photon", "bidirectional", "guiding"),
    ("drivers",),
    ("device",),
    ("scheduling",),
    ("importers", "exporters", "blender"),
    ("flatten",),
    ("film",),
    ("scene",),
    ("settings",),
    ("integrators",),
    ("sensor",),
    ("meshes", "image", "cameras", "plugins", "grids", "curves", "measured"),
    ("spectra",),
    ("limits",),
    ("version",),
    ("files",),
    ("process",),
    ("layout",),
    ("drawing", "statistics", "exact"),
    ("extras",),
    ("wording",),
    ("errors",),
)
RANK: Final = {name: rank for rank, names in enumerate(LAYERS) for name in names}
MODULES: Final = sorted(path for path in PACKAGE.rglob("*.py") if "scenes" not in path.parts)


def room_of(path: Path) -> str:
    """Room of a file of the package; the name of a file at its root is a room too."""
    relative = path.relative_to(PACKAGE)
    return relative.parts[0] if len(relative.parts) > 1 else relative.stem


def imports(tree: ast.AST) -> Iterator[tuple[int, str, tuple[str, ...]]]:
    """(line, module, names taken from it) of every import, wherever it stands, for types only too."""
    for node in ast.walk(tree):
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


def rooms() -> str:
    """A table in Markdown: every room with the first line of its docstring, from the command line down."""
    rows = ["| room | what it is for | files |", "|---|---|---|"]
    for names in LAYERS:
        for name in names:
            folder = PACKAGE / name
            path = folder / "__init__.py" if folder.is_dir() else PACKAGE / f"{name}.py"
            about = (ast.get_docstring(ast.parse(path.read_text())) or "").partition("\n")[0]
            count = len(list(folder.rglob("*.py"))) if folder.is_dir() else 1
            rows.append(f"| `{name}{'/' if folder.is_dir() else '.py'}` | {about} | {count} |")
    return "\n".join(rows) + "\n"


def current(page: str) -> str:
    """The page with an updated table.

    Parameters
    ----------
    page : str
        Text with the two marks around the table.
    """
    return with_part(page, "rooms.py", rooms())


def main() -> int:
    """Rewrite the page."""
    PAGE.write_text(current(PAGE.read_text()))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
