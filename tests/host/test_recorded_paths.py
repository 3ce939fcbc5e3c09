"""What records paths is nothing in the programs that render, and its records are read as they are written."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from typing import Any

import numpy as np
import pytest
from cases import for_each

from clrender import layout
from clrender.device.source import load_source
from clrender.flatten.features import Features
from clrender.inspection.document import plain
from clrender.inspection.pipelines import PIPELINES
from clrender.inspection.reading import as_rows, counts, highest, sample_values, written
from clrender.integrators import INTEGRATORS

EVERYTHING: dict[str, int | str] = {**Features.all(()).macros, "SPECULAR_CHAINS": 1, "SEVERAL_SHADOW_RAYS": 1}
PROGRAMS: dict[str, tuple[str, dict[str, int | str]]] = {
    "path": ("integrator/path.cl", {"LANES": 1}),
    "path of everything": ("integrator/path.cl", {"LANES": 16, "PACKETS": 8, **EVERYTHING}),
    "guided": ("integrator/guided.cl", {"LANES": 1, **EVERYTHING}),
    "whitted": ("integrator/whitted.cl", {"LANES": 1, **EVERYTHING}),
    "bdpt": ("integrator/bdpt.cl", {"LANES": 1, **EVERYTHING}),
    "light paths": ("bidirectional/light_paths.cl", {"LANES": 1, **EVERYTHING}),
    "photons": ("photon/photons.cl", {"LANES": 1, **EVERYTHING}),
    "training": ("guiding/training.cl", {"LANES": 1, **EVERYTHING}),
    "staged": ("staged/scatter.cl", {"LANES": 1, **EVERYTHING}),
}


def preprocessed(entry: str, defines: dict[str, int | str]) -> str:
    """What a compiler gets of a program."""
    given = load_source(entry, defines).text
    text = "\n".join(line for line in given.splitlines() if not line.startswith("#line"))
    done = subprocess.run(["cpp", "-P", "-undef", "-w", "-"], input=text, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.skipif(shutil.which("cpp") is None, reason="there is no C preprocessor")
@for_each("name", PROGRAMS)
def test_programs_that_render_hold_nothing_of_it(name: str) -> None:
    entry, defines = PROGRAMS[name]
    text = preprocessed(entry, defines)
    assert "path" in text and not re.findall(r"\w*inspect\w*", text, re.IGNORECASE)


@pytest.mark.skipif(shutil.which("cpp") is None, reason="there is no C preprocessor")
def test_programs_that_record_do() -> None:
    for pipeline in PIPELINES.values():
        assert "inspect_end(" in preprocessed(pipeline.entry, {"LANES": 1, **EVERYTHING})


def test_every_integrator_is_recorded_or_refused() -> None:
    recorded = {name for name, each in INTEGRATORS.items() if each.pipeline.kernel in PIPELINES}
    assert recorded == {"path", "direct", "whitted", "bdpt"}
    for pipeline in PIPELINES.values():
        assert pipeline.reads_records and pipeline.packets == 1


def record(value: tuple[float, float, float], used: int, *, ends: bool = True) -> np.ndarray[Any, Any]:
    rows = np.zeros((layout.INSPECT_ROWS, layout.INSPECT_WORDS), np.uint32)
    head = layout.columns("INSPECT_SAMPLE")
    rows[0, head["USED"]], rows[0, head["ENDS"]] = used, ends
    rows[0, head["VALUE"] : head["VALUE"] + 3] = np.array(value, np.float32).view(np.uint32)
    rows[1:used, 0] = layout.INSPECT_VERTEX
    return rows


def test_samples_are_sorted_by_what_they_contribute() -> None:
    values = [(0.0, 1.0, 0.0), (3.0, 0.0, 0.0), (0.0, np.nan, 0.0), (0.0, -2.0, 0.0), (np.inf, 0.0, 0.0), (1e13, 0, 0)]
    records = np.stack([record(value, 3).ravel() for value in values])
    found, complete = sample_values(records)
    assert np.array_equal(found, np.array(values, np.float32), equal_nan=True) and complete.all()
    assert counts(found).tolist() == [True, True, False, True, False, False]
    assert highest(found, counts(found), 5).tolist() == [2, 4, 5, 3, 0]  # a luminance of 0.64 comes after 0.72
    assert not sample_values(record((1.0, 1.0, 1.0), 3, ends=False).ravel()[None])[1].any()


def test_rows_that_were_written_are_kept() -> None:
    for used, kept in ((0, 1), (1, 1), (7, 7), (layout.INSPECT_ROWS, layout.INSPECT_ROWS), (9999, layout.INSPECT_ROWS)):
        rows = record((1.0, 1.0, 1.0), min(used, layout.INSPECT_ROWS))
        rows[0, layout.columns("INSPECT_SAMPLE")["USED"]] = used
        assert len(written(as_rows(rows.ravel())[0])) == kept


def test_numbers_have_the_fewest_digits_that_give_the_same() -> None:
    rng = np.random.default_rng(4)
    values = rng.integers(0, 2**32, 2000, dtype=np.uint32).view(np.float32)
    values = values[np.isfinite(values)]
    read = json.loads(json.dumps(plain(values)))
    assert np.array_equal(np.array(read, np.float32).view(np.uint32), values.view(np.uint32))
    assert plain(np.array([0.1, np.nan, np.inf], np.float32)) == [0.1, None, None]
    assert plain({"a": (np.float64(0.1), np.int64(3), None, "x", float("nan"))}) == {"a": [0.1, 3, None, "x", None]}
