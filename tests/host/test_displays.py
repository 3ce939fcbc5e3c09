"""Outputs of a notebook that display a view, without a kernel: who is sent what, and when nobody is there any more."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest

import clrender
from clrender.drawing.bundle import widget_module
from clrender.errors import UsageError
from clrender.view import displays as module
from clrender.view.broadcaster import Broadcaster
from clrender.view.displays import Displays
from clrender.view.image_state import ImageState
from clrender.view.viewer import Viewer


class FakeEngine:
    """Viewers alone: those of an engine, which render nothing."""

    def __init__(self) -> None:
        self.broadcaster = Broadcaster()
        self.broadcaster.send("hello", {"protocol": 1})
        self.displayed = None
        self.posted: list[Any] = []

    def connect(self, wake: Callable[[], None]) -> Viewer:
        return self.broadcaster.connect(self, wake)  # type: ignore[arg-type]

    def disconnect(self, viewer: Viewer) -> None:
        self.broadcaster.disconnect(viewer)

    def post(self, viewer: Viewer, message: Any) -> None:
        self.posted.append(message)

    def wake_renderer(self) -> None:
        pass


class Notebook:
    """A front end that keeps what is sent to it."""

    def __init__(self) -> None:
        self.engine = FakeEngine()
        self.sent: list[dict[str, Any]] = []
        self.looks = 0
        self._changed = threading.Condition()
        self.displays = Displays(self.engine, self._take, self._look)  # type: ignore[arg-type]

    def _take(self, content: dict[str, Any], buffers: Any = None) -> None:
        with self._changed:
            self.sent.append(content)
            self._changed.notify_all()

    def _look(self) -> None:
        self.looks += 1

    def wait(self, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        with self._changed:
            assert self._changed.wait_for(lambda: any(map(wanted, self.sent)), 30), self.sent
        return next(filter(wanted, self.sent))

    def wait_kind(self, display: str, kind: str) -> dict[str, Any]:
        found = self.wait(lambda m: m["display"] == display and json.loads(m.get("text", "{}")).get("type") == kind)
        told: dict[str, Any] = json.loads(found["text"])
        return told


@pytest.fixture
def notebook() -> Iterator[Notebook]:
    opened = Notebook()
    yield opened
    opened.displays.close()


def test_each_output_is_a_viewer_of_its_own(notebook: Notebook) -> None:
    assert notebook.displays.unwatched_seconds == 0.0
    notebook.displays.receive({"display": "a"})
    notebook.displays.receive({"display": "b"})
    assert notebook.wait_kind("a", "hello") == notebook.wait_kind("b", "hello")
    assert len(notebook.engine.broadcaster) == 2
    notebook.displays.receive({"display": "a", "text": '{"type": "restart"}'})
    notebook.displays.receive({"display": "a", "text": '{"type": "nonsense", "id": 7}'})
    assert notebook.wait_kind("a", "refused")["to"] is None
    assert len(notebook.engine.posted) == 1
    assert len(notebook.displays) == 2


def test_the_last_output_that_goes_is_noticed(notebook: Notebook) -> None:
    for name in ("a", "b"):
        notebook.displays.receive({"display": name})
    notebook.displays.receive({"display": "a", "leaves": True})
    assert notebook.displays.unwatched_seconds == 0.0
    notebook.displays.receive({"display": "b", "leaves": True})
    time.sleep(0.01)
    assert notebook.displays.unwatched_seconds > 0.0
    assert len(notebook.engine.broadcaster) == 0
    notebook.displays.receive({"display": "c"})
    assert notebook.displays.unwatched_seconds == 0.0


def test_an_output_that_fell_silent_is_forgotten_and_comes_back(
    notebook: Notebook, monkeypatch: pytest.MonkeyPatch
) -> None:
    notebook.displays.receive({"display": "a"})
    monkeypatch.setattr(module, "_SILENT_SECONDS", 0.0)
    end = time.monotonic() + 30
    while len(notebook.displays) and time.monotonic() < end:
        time.sleep(0.02)
    assert len(notebook.displays) == 0 == len(notebook.engine.broadcaster)
    assert notebook.displays.unwatched_seconds == 0.0  # asleep, perhaps: the view goes on
    monkeypatch.setattr(module, "_SILENT_SECONDS", 150.0)
    notebook.displays.receive({"display": "a"})
    assert len(notebook.displays) == 1


@pytest.mark.parametrize(
    "content", [None, 3, [], {}, {"display": 4}, {"display": ""}, {"display": "x" * 65}, {"text": "{}"}]
)
def test_what_makes_no_sense_is_passed_over(notebook: Notebook, content: Any) -> None:
    notebook.displays.receive(content)
    assert len(notebook.displays) == 0


@pytest.mark.parametrize("text", [5, [], {"type": "restart"}, "{", "[]", "x" * 100_000])
def test_what_is_no_message_is_refused(notebook: Notebook, text: Any) -> None:
    notebook.displays.receive({"display": "a", "text": text})
    assert notebook.wait_kind("a", "refused")["message"]
    assert not notebook.engine.posted


def test_who_is_one_too_many_is_told(notebook: Notebook) -> None:
    for number in range(17):
        notebook.displays.receive({"display": f"d{number}"})
    assert "16 viewers" in notebook.wait_kind("d16", "refused")["message"]
    assert len(notebook.displays) == 16


def test_all_are_told_the_end_and_nobody_comes_after_it(notebook: Notebook) -> None:
    notebook.displays.receive({"display": "a"})
    notebook.engine.broadcaster.send_goodbye("the end")
    notebook.displays.close()
    notebook.wait_kind("a", "bye")
    notebook.wait(lambda message: message == {"display": "a", "ended": True})
    notebook.displays.receive({"display": "b"})
    assert len(notebook.displays) == 0


def test_a_front_end_that_is_gone_ends_nothing() -> None:
    engine = FakeEngine()

    def send(content: dict[str, Any], buffers: Any = None) -> None:
        raise OSError("the socket is closed")

    displays = Displays(engine, send, lambda: None)  # type: ignore[arg-type]
    displays.receive({"display": "a"})
    displays.receive({"display": "a", "text": '{"type": "restart"}'})
    assert len(engine.posted) == 1
    displays.close()


def test_an_output_that_fails_ends_alone(notebook: Notebook, monkeypatch: pytest.MonkeyPatch) -> None:
    take = Viewer.take

    def failing(viewer: Viewer) -> Any:
        if viewer.number == 1:
            raise MemoryError("made up")
        return take(viewer)

    monkeypatch.setattr(Viewer, "take", failing)
    notebook.displays.receive({"display": "a"})
    notebook.wait(lambda message: message == {"display": "a", "ended": True})
    notebook.displays.receive({"display": "b"})
    assert notebook.wait_kind("b", "hello")
    assert len(notebook.engine.broadcaster) == 1


def test_the_picture_below_a_view_is_drawn_for_each_finished_image() -> None:
    """Also where more samples of the same image are asked for, which finishes it a second time."""
    from clrender.view.notebook import View

    drawn: list[Any] = []
    view = SimpleNamespace(
        _engine=SimpleNamespace(image_state=ImageState(1, 8, 4, 4)),
        _displays=SimpleNamespace(unwatched_seconds=0.0),
        _stills=["picture"],
        _drawn=None,
        _draw=drawn.append,
        image="image",
    )
    for digest, count in ((None, 0), ("a", 1), ("a", 1), (None, 1), ("b", 2)):
        view._engine.image_state.sha256 = digest
        View._on_tick(view)  # type: ignore[arg-type]
        assert len(drawn) == count


def test_without_the_extra_one_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    from clrender.view import notebook as home

    home._widget_class.cache_clear()
    monkeypatch.setitem(__import__("sys").modules, "anywidget", None)
    with pytest.raises(
        UsageError, match=r"needs anywidget, which is not installed; install it with `.*pip install 'anywidget[^']*'.*`"
    ):
        clrender.View(clrender.load("room"))


def test_the_widget_is_one_module() -> None:
    module_text = widget_module()
    assert "import " not in [line[:7] for line in module_text.splitlines()]
    assert module_text.rstrip().splitlines()[-1] == "export default { render: module_widget.render };"
    assert module_text.count("\nexport ") == 1
