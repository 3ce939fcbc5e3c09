"""Make the notebooks of docs/exercises from those with solutions: cells with the tag `solution` are emptied.

A notebook in docs/exercises/solutions is the only source: it has the text, the tasks and the answers. To change one,
edit it in Jupyter, clear all outputs, save it, and run `python scripts/exercise_notebooks.py`.
"""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any, Final

__all__ = ["FOLDER", "exercise", "sources", "written"]

FOLDER: Final = Path(__file__).resolve().parents[1] / "docs" / "exercises"
_TAG: Final = "solution"
_EMPTY: Final = {"code": "# Your code\n", "markdown": "*Your answer:*\n"}


def sources() -> list[Path]:
    """The notebooks with solutions, in order."""
    return sorted((FOLDER / "solutions").glob("*.ipynb"))


def exercise(solutions: dict[str, Any]) -> dict[str, Any]:
    """A notebook without its solutions and outputs.

    Parameters
    ----------
    solutions : dict
        A notebook, as JSON values. It is not changed.
    """
    notebook = copy.deepcopy(solutions)
    notebook["cells"] = [_emptied(cell) for cell in notebook["cells"]]
    return notebook


def written(notebook: dict[str, Any]) -> str:
    """Text of the file of a notebook, in the layout that Jupyter writes."""
    return json.dumps(notebook, indent=1, ensure_ascii=False, sort_keys=True) + "\n"


def _emptied(cell: dict[str, Any]) -> dict[str, Any]:
    tags = cell["metadata"].pop("tags", [])
    if _TAG in tags:
        cell["source"] = [_EMPTY[cell["cell_type"]].rstrip("\n")]
    if cell["cell_type"] == "code":
        cell["outputs"], cell["execution_count"] = [], None
    return cell


def main() -> None:
    """Write all exercises."""
    for path in sources():
        text = written(exercise(json.loads(path.read_text())))
        (FOLDER / path.name).write_text(text)


if __name__ == "__main__":
    main()
