"""Whenever a call is interrupted, the next ones give the right image, and no thread of it is left behind."""

from __future__ import annotations

import contextlib
import gc
import itertools
import random
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import pytest
from interruptions import KINDS, Alarm, Point, Tracer

import clrender
from clrender.device import Device
from clrender.errors import ClrenderError
from clrender.film import Film
from clrender.process.pooled_threads import PooledThread
from clrender.process.shield import Call
from clrender.rendering.job import RenderJob
from clrender.rendering.residency import Residency

# Files that were open when they were interrupted are closed by the garbage collector, which warns
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")

HOW: Final[dict[str, Any]] = {"size": (16, 16), "spp": 4, "tile": 8}
SECONDS: Final = 5.0
"""After which no thread of an interrupted call is left."""

Attempt = Callable[[], Any]


class Bench:
    """A session, with what its calls give if nobody interrupts them."""

    def __init__(self, device: Device, folder: Path) -> None:
        self.session = clrender.Session(device)
        self.scene = clrender.load("room")
        self.folder = folder
        self.right = self.render()
        self._numbers = itertools.count()

    def render(self, **more: Any) -> str:
        return str(self.session.render(self.scene, **HOW, **more).stats["image_sha256"])

    def check(self) -> None:
        assert self.render() == self.right

    def rendering(self) -> tuple[Attempt, Attempt]:
        """Another image than the one before and after, with all callbacks."""
        heard: list[Any] = []
        more: dict[str, Any] = {"seed": 1, "on_progress": heard.append, "should_stop": lambda: False}
        return lambda: self.session.render(self.scene, **HOW, **more), self.check

    def another_scene(self) -> tuple[Attempt, Attempt]:
        """What the device holds is replaced."""
        scene = clrender.load("cornell")
        return lambda: self.session.render(scene, **HOW, aov=("depth",)), self.check

    def refining(self) -> tuple[Attempt, Attempt]:
        """A film that is there already gets more samples, and still others afterwards."""
        short, job = (RenderJob.of(self.scene, **{**HOW, "spp": spp}) for spp in (1, 4))
        film = self.session.refine(short)

        def then() -> None:
            assert self.session.develop(job, self.session.refine(job, film)).stats["image_sha256"] == self.right

        return lambda: self.session.refine(job, film), then

    def saving(self) -> tuple[Attempt, Attempt]:
        """The checkpoint of an interrupted render is continued."""
        path = self.folder / f"{next(self._numbers)}.film"

        def then() -> None:
            assert self.render(checkpoint=path, resume=True) == self.right
            path.unlink()

        return lambda: self.render(checkpoint=path), then

    def merging(self) -> tuple[Attempt, Attempt]:
        """A film is merged with another, or says that it is broken, or has all samples already."""
        parts = [
            self.session.render(self.scene, **HOW, samples=samples, replicate_spp=1).film
            for samples in ((0, 1), (1, 4))
        ]
        whole = self.session.render(self.scene, **HOW, replicate_spp=1).film

        def then() -> None:
            for number, copy in enumerate(parts):
                with contextlib.suppress(ClrenderError):
                    copy.save(self.folder / f"part{number}.film")
            try:
                parts[0].merge(parts[1])
            except ClrenderError as error:
                assert "interrupted" in str(error) or "are held already" in str(error)
                if "interrupted" in str(error):
                    with pytest.raises(ClrenderError, match="interrupted"):
                        parts[0].mean()
                    return
            assert (parts[0].mean() == whole.mean()).all() and parts[0].ledger == whole.ledger
            assert all((a == b).all() for a, b in zip(parts[0].square_bands(), whole.square_bands(), strict=True))

        def attempt() -> None:
            parts[0].save(self.folder / "before.film")
            parts[0].merge(parts[1])

        return attempt, then

    def closing(self) -> tuple[Attempt, Attempt]:
        """A session of its own on the same device is opened, renders and is closed."""

        def attempt() -> None:
            with clrender.Session(self.session.devices) as other:
                other.render(self.scene, **HOW, seed=3)

        return attempt, self.check


SCENARIOS: Final = ("rendering", "another_scene", "refining", "saving", "merging", "closing")


@pytest.fixture
def bench(device: Device, tmp_path: Path) -> Iterator[Bench]:
    made = Bench(device, tmp_path)
    yield made
    made.session.close()


def threads_left(before: set[threading.Thread]) -> set[threading.Thread]:
    """Threads of this program that are not gone in time."""
    end = time.monotonic() + SECONDS
    while (
        left := {each for each in set(threading.enumerate()) - before if each.is_alive()}
    ) and time.monotonic() < end:
        time.sleep(0.001)
    return left


def interrupted(bench: Bench, scenario: str, tracer: Tracer) -> None:
    """Interrupt a scenario, and check what follows."""
    attempt, then = getattr(bench, scenario)()
    before = set(threading.enumerate())
    with contextlib.suppress(KeyboardInterrupt, SystemExit, Alarm):
        tracer.run(attempt)
    assert not threads_left(before)
    then()


def points_of(bench: Bench, scenario: str) -> list[tuple[Point, int]]:
    """Every point of a scenario at its first visit, and those that are passed often at a later one too."""
    tracer = Tracer()
    interrupted(bench, scenario, tracer)
    visits = [(point, 0) for point in tracer.points]
    return visits + [(point, times // 2) for point, times in tracer.points.items() if times > 1]


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_a_call_that_is_interrupted_leaves_nothing_wrong_behind(bench: Bench, scenario: str) -> None:
    points = points_of(bench, scenario)
    chosen = random.Random(1).sample(points, 8)
    met = 0
    for (point, visit), kind in zip(chosen, itertools.cycle(KINDS)):
        tracer = Tracer(point, visit, kind)
        interrupted(bench, scenario, tracer)
        met += tracer.met
    assert met >= 5, "all but those that depend on how fast the threads were"


@pytest.mark.slow
def test_interruptions_at_every_point(bench: Bench) -> None:
    """3000 and more, and not one wrong image."""
    met = 0
    points = {scenario: points_of(bench, scenario) for scenario in SCENARIOS}
    while met < 3000:
        for scenario in SCENARIOS:
            for (point, visit), kind in itertools.product(points[scenario], KINDS):
                tracer = Tracer(point, visit, kind)
                interrupted(bench, scenario, tracer)
                met += tracer.met
    print(f"{met} interruptions at {sum(map(len, points.values()))} points")


def test_threads_that_were_just_started_do_not_render_on(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """An interruption right after the start of the worker threads, deterministically."""
    from clrender.scheduling.threads import WorkerThreads

    start = WorkerThreads.start

    def interrupted_start(threads: WorkerThreads) -> None:
        start(threads)
        raise KeyboardInterrupt

    for seed in range(1, 4):
        with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
            patched.setattr(WorkerThreads, "start", interrupted_start)
            bench.session.render(bench.scene, size=(16, 16), spp=4096, seed=seed)
        bench.check()


def test_a_second_interruption_while_the_first_is_handled(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    leave = Call._leave
    times = itertools.count()

    def interrupted_leave(call: Call, thread: PooledThread) -> None:
        if next(times) == 0:
            raise KeyboardInterrupt
        leave(call, thread)

    def stop(_progress: object) -> None:
        raise KeyboardInterrupt

    before = set(threading.enumerate())
    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(Call, "_leave", interrupted_leave)
        bench.session.render(bench.scene, size=(16, 16), spp=2**20, samples_per_pass=1, on_progress=stop)
    assert not threads_left(before)
    bench.check()


def test_a_render_that_was_left_is_waited_for(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """What does not end within a moment goes on in the background; the next call waits, and may be interrupted too."""
    go = threading.Event()
    flat = Residency.flat
    monkeypatch.setattr("clrender.process.shield.PATIENCE", 0.05)

    def slow(residency: Residency, job: RenderJob) -> Any:
        assert go.wait(60.0)
        return flat(residency, job)

    session = clrender.Session(bench.session.devices)
    main = threading.get_ident()
    for _ in range(2):  # the second one waits for its turn, behind the first
        with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
            patched.setattr(Residency, "flat", slow)
            timer = threading.Timer(0.1, signal.pthread_kill, (main, signal.SIGINT))
            timer.start()
            session.render(bench.scene, **HOW, seed=5)
        gc.collect()
    go.set()
    assert session.render(bench.scene, **HOW).stats["image_sha256"] == bench.right
    session.close()


def test_a_film_whose_change_was_interrupted_is_refused(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its sums and its ledger may contradict each other, so it neither gives an image nor is saved or merged."""
    parts = [bench.session.render(bench.scene, **HOW, samples=samples).film for samples in ((0, 1), (1, 4))]

    def interrupt(*_arguments: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr("clrender.film.film.add", interrupt)
        parts[0].merge(parts[1])
    uses: list[Callable[[Film], Any]] = [
        Film.mean, Film.develop, Film.snapshot, Film.bands, Film.square_bands,
        lambda film: film.save(bench.folder / "broken.film"),
        parts[1].merge, lambda film: film.merge(parts[1]), lambda film: film.take_out(film),
    ]  # fmt: skip
    for use in uses:
        with pytest.raises(ClrenderError, match="a change of the film was interrupted"):
            use(parts[0])
    assert not (bench.folder / "broken.film").exists()
