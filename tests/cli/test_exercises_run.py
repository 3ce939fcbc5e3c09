"""Exercises as a teacher runs them: every cell of the notebooks with solutions, and their claims."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
from exercise_notebooks import sources

import clrender

nbformat = pytest.importorskip("nbformat", reason="the extra for notebooks is not installed")
nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed")
pytest.importorskip("ipykernel", reason="ipykernel is not installed")
pytest.importorskip("matplotlib", reason="the extra for notebooks is not installed")

# Jupyter's own warnings, on how it finds its folders and its event loops, are not this package's.
pytestmark = [pytest.mark.filterwarnings("default"), pytest.mark.usefixtures("only_driver")]


def executed(path: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A notebook after all of its cells; a cell that raises ends the test."""
    for name in ("IPYTHONDIR", "JUPYTER_CONFIG_DIR", "JUPYTER_RUNTIME_DIR", "MPLCONFIGDIR"):
        monkeypatch.setenv(name, str(folder / name))
    monkeypatch.setenv("PYTHONPATH", str(Path(clrender.__path__[0]).parent))
    monkeypatch.setenv("PYDEVD_DISABLE_FILE_VALIDATION", "1")
    monkeypatch.setenv("CLRENDER_DEVICE", os.environ.get("CLRENDER_TEST_DEVICE", "pocl"))
    notebook = nbformat.read(path, 4)
    nbclient.NotebookClient(
        notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(folder)}}
    ).execute()
    return notebook


@pytest.mark.long
@pytest.mark.parametrize("path", sources(), ids=lambda path: path.stem)
def test_the_solutions_run_and_hold(
    path: Path, tmp_path: Path, cache_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    notebook = executed(path, tmp_path, monkeypatch)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(cell.execution_count for cell in code)
    for cell in code:
        if cell.source.splitlines()[-1].strip() == "plot":  # drawn, not a sentence on what is missing
            assert "<svg" in cell.outputs[-1].data["text/html"]
