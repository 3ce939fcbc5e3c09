"""Random scenes of everything are exported, or refused in one sentence; what is written for Mitsuba is read again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from mixed_files import written
from mixed_scenes import KINDS, mixed_scene

import clrender
from clrender.errors import ClrenderError
from clrender.exporters import write_cycles, write_luxcore, write_mitsuba

MANY = 160


@pytest.mark.slow
@pytest.mark.parametrize(
    ("write", "ending"),
    [(write_mitsuba, "xml"), (write_luxcore, "scn"), (write_cycles, "py")],
    ids=["mitsuba", "luxcore", "cycles"],
)
def test_mixed_scenes_are_exported(tmp_path: Path, write: Callable[..., Any], ending: str) -> None:
    folder = tmp_path / "files"
    folder.mkdir()
    written(folder)
    exported = 0
    for number in range(MANY):
        scene = mixed_scene(KINDS[number % len(KINDS)], number // len(KINDS)).scene(folder)
        out = tmp_path / str(number) / f"scene.{ending}"
        out.parent.mkdir()
        try:
            write(scene, out)
        except ClrenderError as error:
            assert "\n" not in str(error)
            continue
        exported += 1
        if ending == "xml":
            clrender.load(out)
    assert exported > MANY / 3
