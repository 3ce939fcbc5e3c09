"""What a command waits for: stages of renders on several devices, and what is said of them."""

from __future__ import annotations

from pathlib import Path

import pytest

import clrender
from clrender.cli.waiting import Waiting
from clrender.process.stages import STAGES, Stages


def test_stages_of_several_devices_end_in_any_order() -> None:
    told: list[str] = []
    stages = Stages(told.append)
    with stages.during("flattening"):
        stages.end("joining")  # had not begun
    with stages.during("building"):
        stages.compiling(True)
        with stages.during("building"):
            stages.compiling(True)
            stages.compiling(False)
        stages.compiling(False)
    assert told == ["flattening", "", "building", "compiling", "building", ""]
    with pytest.raises(RuntimeError), stages.during("reading"):
        raise RuntimeError
    assert told[-2:] == ["reading", ""]


def test_each_wait_is_said_once_and_only_while_it_lasts() -> None:
    said: list[str] = []
    waiting = Waiting(said.append)
    for stage in ("", "reading", "reading", "", "compiling", "reading", "compiling"):
        waiting.stage(stage)
        waiting.look()
    assert said == [f"{STAGES[stage]} …" for stage in ("reading", "compiling")]
    silent = Waiting(None)
    silent.stage("reading")
    silent.look()


def test_a_thread_looks_until_the_wait_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    import threading

    monkeypatch.setattr("clrender.cli.waiting._SECONDS", 0.001)
    said = threading.Event()
    with Waiting(lambda line: said.set()) as waiting:
        waiting.stage("opening")
        assert said.wait(60.0)
    assert waiting._ended.is_set()


def test_every_stage_of_a_session_has_words(tmp_path: Path) -> None:
    """None is reported that could not be said, and all but those that need a device are known to the page."""
    source = Path(clrender.__path__[0])
    names = ("rendering/residency.py", "rendering/job_render.py", "rendering/preparing.py", "process/stages.py")
    text = "".join((source / name).read_text() for name in names)
    used = {stage for stage in STAGES if f'("{stage}")' in text}
    assert used == set(STAGES)
    page = (source / "view" / "page" / "status.js").read_text()
    assert all(f"{stage}: " in page for stage in used - {"joining"})
