"""Notebooks of exercises: each is its solutions without the answers, and holds nothing of a machine."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, Final

import pytest
from cases import for_each
from exercise_notebooks import FOLDER, exercise, sources, written

DOCS: Final = FOLDER.parent
NAMES: Final = [path.name for path in sources()]
BOTH: Final = [path.relative_to(DOCS).as_posix() for path in sorted(FOLDER.rglob("*.ipynb"))]
OF_A_MACHINE: Final = re.compile(r"(?<![\w.])/(home|root|tmp|work|mnt|opt|Users|var)\b|[A-Z]:\\")


def cells(path: Path) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(path.read_text())["cells"]
    return found


def test_there_are_as_many_exercises_as_solutions() -> None:
    assert len(NAMES) == 7
    assert [path.name for path in sorted(FOLDER.glob("*.ipynb"))] == NAMES


@for_each("name", NAMES)
def test_an_exercise_is_its_solutions_without_the_answers(name: str) -> None:
    solutions = json.loads((FOLDER / "solutions" / name).read_text())
    assert (FOLDER / name).read_text() == written(exercise(solutions)), "run `python scripts/exercise_notebooks.py`"
    assert solutions["metadata"] == {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    answers = ["".join(cell["source"]) for cell in solutions["cells"] if cell["metadata"].get("tags") == ["solution"]]
    given = (FOLDER / name).read_text()
    assert len(answers) >= 3
    for answer in answers:
        assert all(
            json.dumps(line, ensure_ascii=False)[1:-1] not in given for line in answer.split("\n") if len(line) > 30
        )
    sources_given = ["".join(cell["source"]) for cell in cells(FOLDER / name)]
    assert sources_given.count("# Your code") + sources_given.count("*Your answer:*") == len(answers)
    assert any("**Task.**" in text for text in sources_given)


@for_each("name", BOTH)
def test_it_is_a_notebook_as_jupyter_writes_it_without_outputs(name: str) -> None:
    nbformat = pytest.importorskip("nbformat", reason="the extra for notebooks is not installed")
    text = (DOCS / name).read_text()
    notebook = nbformat.reads(text, 4)
    nbformat.validate(notebook)
    assert text == written(json.loads(text))
    ids = [cell.id for cell in notebook.cells]
    assert len(set(ids)) == len(ids)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            assert cell.outputs == [] and cell.execution_count is None
        assert OF_A_MACHINE.search(cell.source) is None


@for_each("name", BOTH)
def test_its_links_lead_somewhere(name: str) -> None:
    path = DOCS / name
    for cell in cells(path):
        for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", "".join(cell["source"])):
            if cell["cell_type"] == "markdown":
                assert target.startswith("https://") or (path.parent / target).is_file(), target


@for_each("name", BOTH)
def test_the_page_for_teachers_links_it(name: str) -> None:
    assert f"]({name})" in (DOCS / "teaching.md").read_text()


def test_the_first_page_leads_to_the_exercises() -> None:
    assert "(teaching.md#exercises-as-notebooks)" in (DOCS / "index.md").read_text()


def test_what_is_not_for_students_is_found() -> None:
    made = exercise(
        {
            "cells": [
                {"cell_type": "code", "metadata": {"tags": ["solution"]}, "source": ["x = 1"], "outputs": [1]},
                {"cell_type": "markdown", "metadata": {"tags": ["solution"]}, "source": ["Because."]},
                {"cell_type": "code", "metadata": {}, "source": ["y = 2"], "outputs": [2], "execution_count": 3},
            ]
        }
    )
    assert [cell["source"] for cell in made["cells"]] == [["# Your code"], ["*Your answer:*"], ["y = 2"]]
    assert [cell.get("outputs") for cell in made["cells"]] == [[], None, []]
    assert OF_A_MACHINE.search('"/home/someone/x"') and not OF_A_MACHINE.search("docs/home.md and a/tmp/b")
