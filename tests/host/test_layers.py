"""Imports, those for types included, point down the list of layers only, and every module says what it offers."""

from __future__ import annotations

import ast

from rooms import MODULES, PACKAGE, RANK, circles, import_graph, imported, room_of


def test_no_module_imports_itself_by_way_of_others() -> None:
    assert not circles(import_graph())


def test_circles_are_found() -> None:
    graph = {"a": {"b"}, "b": {"c"}, "c": {"b", "d"}, "d": set(), "e": {"e"}}
    assert circles(graph) == {frozenset({"b", "c"}), frozenset({"e"})}


def test_imports_point_down() -> None:
    wrong = [
        f"{path.relative_to(PACKAGE)}:{line}: {room_of(path)} imports {name}, which is above it"
        for path in MODULES
        for line, name in imported(ast.parse(path.read_text()))
        if RANK[name] < RANK[room_of(path)]
    ]
    assert not wrong


def test_every_module_has_a_layer_and_says_what_it_is_for_and_what_it_offers() -> None:
    wrong = []
    for path in MODULES:
        tree = ast.parse(path.read_text())
        if room_of(path) not in RANK:
            wrong.append(f"{path} has no place in the list of layers")
        if not ast.get_docstring(tree):
            wrong.append(f"{path} begins with no docstring")
        targets = [
            target.id
            for node in tree.body
            if isinstance(node, (ast.Assign, ast.AnnAssign))
            for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
            if isinstance(target, ast.Name)
        ]
        if "__all__" not in targets:
            wrong.append(f"{path} has no __all__")
    assert not wrong


def test_few_modules_lie_loose_at_the_root() -> None:
    assert len([path for path in MODULES if path.parent == PACKAGE]) <= 10


def test_only_the_command_line_prints_or_exits() -> None:
    # child.py and the peers are programs of their own processes, and layout.py writes a generated file when run as one.
    loud = [
        f"{path.relative_to(PACKAGE)}:{node.lineno}"
        for path in MODULES
        if room_of(path) not in ("cli", "__main__") and path.name != "child.py" and not path.name.startswith("peer_")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and ast.unparse(node.func) in ("print", "sys.exit", "exit", "input")
    ]
    assert not loud


def test_pyopencl_is_imported_only_by_devices_and_drivers() -> None:
    wrong = [
        path.relative_to(PACKAGE).as_posix()
        for path in MODULES
        if room_of(path) not in ("device", "drivers") and "import pyopencl" in path.read_text()
    ]
    assert not wrong
