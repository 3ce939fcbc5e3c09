"""Light paths in the live view's engine on a real device: those of the image, beside a render that goes on."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from paths_support import bits
from view_clients import EngineClient, Received

import clrender
from clrender.errors import DeviceError
from clrender.inspection.surroundings import pose_of
from clrender.process.stages import STAGES
from clrender.view import tracer
from clrender.view.edited_scene import EditedScene

pytestmark = pytest.mark.usefixtures("only_driver")


def answered(page: EngineClient, number: Any, **question: Any) -> Received:
    """The answer to a question for paths."""
    page.say("paths", id=number, **question)
    return page.until(lambda m: m.content.get("id") == number)


@pytest.mark.thorough
def test_the_paths_of_a_pixel_are_those_of_the_image(opened: Callable[..., Any]) -> None:
    """Of the camera and the scene as they are now; and of a crop, in whose pixels one counts."""
    _, page = opened(spp=16)
    page.say("camera", camera={"position": [0.5, 1.5, 4.5]})
    page.say("material", name="white", values={"reflectance": [0.3, 0.6, 0.9]})
    page.until_done()
    page.say("probe", x=40, y=50)
    radiance = page.until_kind("probe").content["radiance"]
    told = answered(page, 1, x=40, y=50).content
    assert told["type"] == "paths" and (told["x"], told["y"]) == (40, 50)
    assert bits(told["paths"]["radiance"]) == bits(np.array(radiance, np.float32))
    assert (told["paths"]["spp"], told["paths"]["width"], len(told["paths"]["samples"])) == (16, 96, 16)
    assert told["revision"] == page.newest["state"].content["revision"]
    around = told["around"]
    assert around["camera"]["position"] == [0.5, 1.5, 4.5] and around["camera"]["projects"]
    assert len(around["points"]) > 1000 and told["crop"] == [0, 0, 96, 64]
    few = answered(page, 2, x=40, y=50, samples=4).content["paths"]
    assert (few["spp"], few["values"]) == (4, told["paths"]["values"][:4])
    page.say("set", settings={"crop": [30, 40, 20, 20]})
    page.until_done()
    cropped = answered(page, 3, x=10, y=10).content
    assert cropped["crop"] == [30, 40, 20, 20] and cropped["paths"]["pixel"] == [40, 50]
    assert cropped["paths"]["values"] == told["paths"]["values"]


@pytest.mark.thorough
def test_paths_of_an_image_with_an_error_are_those_that_its_pixel_has(opened: Callable[..., Any]) -> None:
    """Which stops sooner than others: with more samples the list would be of another number."""
    _, page = opened(error=0.5, spp=4096, replicate_spp=1)
    page.until_done()
    page.say("probe", x=40, y=50)
    told = page.until_kind("probe").content
    assert 0 < told["samples"] < 4096
    found = answered(page, 1, x=40, y=50, samples=4096).content["paths"]
    assert found["spp"] == told["samples"]
    assert bits(found["radiance"]) == bits(np.array(told["radiance"], np.float32))


@pytest.mark.thorough
def test_bidirectional_paths_tell_what_is_splatted(opened: Callable[..., Any]) -> None:
    _, page = opened(integrator="bdpt", spp=4)
    page.until_done()
    page.say("probe", x=40, y=50)
    radiance = page.until_kind("probe").content["radiance"]
    told = answered(page, 1, x=40, y=50).content["paths"]
    assert bits(told["radiance"]) == bits(np.array(radiance, np.float32)) and len(told["splats"]["values"]) == 4
    both = np.array(told["splats"]["camera"]) + np.array(told["splats"]["splatted"])
    np.testing.assert_allclose(both, told["radiance"], rtol=1e-6)


def test_what_has_no_paths_is_refused_with_the_reason(opened: Callable[..., Any]) -> None:
    _, page = opened(integrator="reuse", spp=1)
    assert "shares paths" in answered(page, 1, x=1, y=1).content["message"]
    page.say("set", settings={"integrator": "path"})
    assert "not within the image of 96 x 64" in answered(page, 2, x=96, y=1).content["message"]
    page.say("paths", x=1, y=1, samples=0)
    page.until(lambda m: m.kind == "refused" and m.content["message"].startswith("samples"))


def job_of(pixel: tuple[int, int] = (3, 2), **settings: Any) -> Any:
    edited = EditedScene.of(clrender.load("room"), {"width": 32, "height": 24, **settings})
    return tracer.traced_job(edited.job, pixel, 256)


def test_a_traced_job_is_the_first_samples_of_the_whole_image() -> None:
    job, pixel = job_of(spp=1024, crop=(10, 5, 8, 8), error=0.1)
    assert pixel == (13, 7) and (job.first_sample, job.sample_count) == (0, 256)
    assert job.settings.crop is None and job.settings.error is None and job.settings.spp == 1024
    assert job_of(spp=16)[0].sample_count == 16


def test_paths_are_not_drawn_over_the_image_of_a_camera_that_moves() -> None:
    camera = clrender.load("room").camera
    keys = [{"time": 0.0, "position": [0, 1, 5]}, {"time": 1.0, "position": [1, 1, 5]}]
    assert pose_of(camera)["projects"]
    assert not pose_of(camera.changed({"shutter": (0.0, 1.0), "motion": keys}))["projects"]
    assert pose_of(camera.changed({"motion": keys}))["projects"]  # the shutter opens for a moment


class Asker:
    """A viewer, and what it is told."""

    def __init__(self, number: int = 1) -> None:
        self.number = number
        self.told: list[tuple[str, Any]] = []
        self.heard = threading.Condition()

    def _note(self, kind: str, content: Any) -> None:
        with self.heard:
            self.told.append((kind, content))
            self.heard.notify_all()

    def send(self, kind: str, content: Any) -> None:
        self._note(kind, content)

    def reply(self, kind: str, message: Any, content: Any) -> None:
        self._note(kind, (message.id, content))

    def refuse(self, message: Any, why: str) -> None:
        self._note("refused", (message.id, why))

    def wait(self, count: int) -> list[Any]:
        with self.heard:
            assert self.heard.wait_for(lambda: len(self.answers) >= count, 60)
            return self.answers

    @property
    def answers(self) -> list[Any]:
        return [(kind, *content) for kind, content in self.told if kind != "tracing"]


class Fake:
    """What traces in place of a device: it waits for a sign, or for a stop."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.opened: list[int] = []
        self.closed = 0
        self.begun = threading.Semaphore(0)
        self.go = threading.Event()
        self.fails: Exception | None = None
        monkeypatch.setattr(tracer, "Session", self._session)
        monkeypatch.setattr(tracer, "paths_in", self._paths)
        monkeypatch.setattr(tracer, "document", lambda *parts: {"pixel": parts[1]})

    def _session(self, device: int, on_stage: Any) -> Any:
        self.opened.append(device)
        on_stage("compiling")
        return self

    def close(self) -> None:
        self.closed += 1

    def _paths(self, session: Any, job: Any, pixel: Any, most: int, should_stop: Callable[[], bool]) -> Any:
        self.begun.release()
        while not (self.go.wait(0.005) or should_stop()):
            pass
        if self.fails is not None:
            raise self.fails
        made = dataclasses.make_dataclass(
            "Made", ["about", "pixel", "radiance", "nonfinite_samples", "values", "samples", "splats"]
        )
        return made({}, pixel, None, 0, None, (), None)


@pytest.fixture
def traced(monkeypatch: pytest.MonkeyPatch) -> Any:
    fake, made = Fake(monkeypatch), tracer.Tracer(background=False)
    yield fake, made
    fake.go.set()
    made.close(10.0)


def question(number: int) -> Any:
    return dataclasses.make_dataclass("Asked", ["id", "x", "y"])(number, number, 0)


def ask(made: Any, viewer: Asker, number: int, device: int = 0) -> None:
    made.ask(viewer, question(number), None, (number, 0), device, {"around": number})


def test_a_newer_question_replaces_the_one_before_at_once(traced: Any) -> None:
    fake, made = traced
    viewer, other = Asker(1), Asker(2)
    ask(made, viewer, 1)
    assert fake.begun.acquire(timeout=60)
    assert viewer.told == [
        ("tracing", {"question": 1, "stage": stage, "text": STAGES[stage]}) for stage in ("opening", "compiling")
    ]
    ask(made, other, 5)
    ask(made, viewer, 2)
    assert viewer.answers == [("refused", 1, "another pixel was asked for")]  # while the first is still running
    ask(made, viewer, 3)
    fake.go.set()
    assert viewer.wait(3)[1:] == [
        ("refused", 2, "another pixel was asked for"),
        ("paths", 3, {"x": 3, "y": 0, "paths": {"pixel": (3, 0)}, "around": 3}),
    ]
    assert other.wait(1)[0][:2] == ("paths", 5)
    assert fake.opened == [0] and fake.closed == 0  # the session stays open for the next pixel


def test_tracing_stops_when_it_is_asked_to_and_when_the_view_ends(traced: Any) -> None:
    fake, made = traced
    viewer = Asker()
    ask(made, viewer, 1)
    assert fake.begun.acquire(timeout=60)
    made.stop(viewer)
    made.stop(viewer)
    assert viewer.wait(1) == [("refused", 1, "stopped")]
    ask(made, viewer, 2)
    assert fake.begun.acquire(timeout=60)
    made.close(60.0)
    assert not made._thread.is_alive() and fake.closed == 1
    assert viewer.answers == [("refused", 1, "stopped")]


def test_a_failure_is_told_and_the_next_question_opens_another_session(traced: Any) -> None:
    fake, made = traced
    viewer = Asker()
    fake.fails = DeviceError("it hangs")
    fake.go.set()
    ask(made, viewer, 1)
    assert viewer.wait(1) == [("refused", 1, {"to": "paths", "message": "it hangs"})]
    fake.fails = None
    ask(made, viewer, 2)
    assert viewer.wait(2)[1][0] == "paths"
    ask(made, viewer, 3, device=1)
    viewer.wait(3)
    assert fake.opened == [0, 0, 1] and fake.closed == 2


def test_a_session_without_questions_is_closed(traced: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    fake, made = traced
    monkeypatch.setattr(tracer, "_IDLE_SECONDS", 0.01)
    fake.go.set()
    viewer = Asker()
    ask(made, viewer, 1)
    viewer.wait(1)
    while fake.closed == 0:
        threading.Event().wait(0.01)
    ask(made, viewer, 2)
    viewer.wait(2)
    assert fake.opened == [0, 0]
