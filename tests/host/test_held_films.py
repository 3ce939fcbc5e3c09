"""A worker that holds the sums of its units: every sample is in the film once, whatever fails, and the film says so."""

from __future__ import annotations

import dataclasses
import random
import threading
import time
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from test_scheduling import FakeWorker, OnSlice, ShouldStop, assert_whole, plan_for

from clrender.errors import DeviceFailure, RenderError, UsageError
from clrender.film import Film
from clrender.film.checkpoint import Checkpoint
from clrender.film.held import FilmCopy, HeldUnit
from clrender.film.running import RunningFilm
from clrender.film.unit import Unit
from clrender.scheduling import run as scheduling
from clrender.scheduling.run import Tally, run
from clrender.scheduling.watchdog import TimeLimits
from clrender.scheduling.worker import Candidate, can_hold

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from clrender.scheduling.policy import Plan

LIMITS = TimeLimits(call=2.0, compile=10.0, hurry=1.0, pause=0.001, retries=8)


class Holder(FakeWorker):
    """Holds its sums in a film of its own. Calls whose numbers are in `fails` fail, and the device is then gone."""

    def __init__(self, plan: Plan, fails: dict[str, set[int]] | None = None, *, readable: bool = False) -> None:
        super().__init__(plan)
        self.fails, self.readable = fails or {}, readable
        self.calls = dict.fromkeys(("hold", "render", "copy"), 0)
        self.copies: list[tuple[bool, bool, bool]] = []
        self.film: Film | None = None
        self.gone = False
        self.has_room = True

    def _call(self, name: str) -> None:
        self.calls[name] += 1
        if self.calls[name] in self.fails.get(name, ()):
            self.gone = not self.readable
            raise DeviceFailure(f"it failed at {name} {self.calls[name]}")
        if self.gone:
            raise DeviceFailure("it is gone")

    def hold(self, film: Film) -> bool:
        self.gone = False
        self._call("hold")
        self.film, self.base = Film(film.width, film.height, film.request), film.version
        film.copy_to(self.film)
        return self.has_room

    def render_held(self, unit: Unit, on_slice: OnSlice = None, should_stop: ShouldStop = None) -> HeldUnit:
        self._call("render")
        assert self.film is not None
        result = self.render(unit, on_slice, should_stop)
        self.film.commit(unit, result)
        return HeldUnit(result.done, result.rays, result.shadow_rays, result.deepest)

    def copy_held(self, *, sums: bool, image: bool, last: bool) -> FilmCopy:
        self._call("copy")
        self.copies.append((sums, image, last))
        assert self.film is not None
        bands = [band.copy() for band in self.film.bands()] if sums else None
        found = self.film.mean() if image else None
        copy = FilmCopy(self.film.counts.copy(), bands, [], found, self.base)
        self.base = copy.version
        if last:
            self.film = None
        return copy


def go(plan: Plan, worker: FakeWorker, film: Film, **more: Any) -> Tally:
    candidate = Candidate("the device", partial(lambda each: each, worker))
    return run(plan, [candidate], film, limits=LIMITS, holds=True, **more)


@pytest.fixture(autouse=True)
def copies_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Copies are due whenever there is something to copy."""
    monkeypatch.setattr(scheduling, "_COPY_SHARES", (1e9, 1e9))


PLAN = dataclasses.replace(plan_for(26, 19, 6, 8), short_units=True, most_slots=64)


def test_a_run_fills_the_film_and_knows_what_was_done() -> None:
    worker, film, told = Holder(PLAN), RunningFilm(26, 19), list[tuple[int, int]]()
    assert can_hold(worker) and not can_hold(FakeWorker(PLAN))
    tally = go(PLAN, worker, film, on_progress=lambda *done: told.append(done))
    assert_whole(PLAN, film)
    assert tally.complete and tally.samples == PLAN.samples == film.ledger.samples
    assert film.account()["rays"] == tally.rays == 3 * PLAN.samples and film.max_depth == tally.deepest > 0
    assert told[-1] == (PLAN.samples, 3 * PLAN.samples) and not film.held
    assert worker.copies[-1] == (True, True, True) and len(worker.copies) > 1


def test_where_only_the_image_is_wanted_no_sums_are_copied(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scheduling, "_COPY_SHARES", (1e-9, 1e-9))
    film, usual, worker = Film(26, 19), Film(26, 19), Holder(PLAN)
    go(PLAN, worker, film, sums=False)
    go(PLAN, FakeWorker(PLAN), usual)
    assert worker.copies == [(False, True, True)] and film.developed
    np.testing.assert_array_equal(film.counts, usual.counts)
    assert film.ledger == usual.ledger
    image = film.develop()
    np.testing.assert_array_equal(image, usual.mean())


def test_a_worker_without_room_delivers_its_units() -> None:
    worker, film = Holder(PLAN), Film(26, 19)
    worker.has_room = False
    assert go(PLAN, worker, film).complete
    assert_whole(PLAN, film)
    assert not worker.copies and not film.held


def test_several_workers_hold_nothing() -> None:
    workers, film = [Holder(PLAN), Holder(PLAN)], Film(26, 19)
    candidates = [Candidate(f"{n}", partial(lambda each: each, worker)) for n, worker in enumerate(workers)]
    assert run(PLAN, candidates, film, holds=True).complete
    assert_whole(PLAN, film)
    assert not any(worker.copies for worker in workers)


@pytest.mark.parametrize("readable", [False, True])
@pytest.mark.parametrize("seed", range(12))
def test_whatever_fails_no_sample_is_lost_or_counted_twice(seed: int, readable: bool) -> None:
    """Units, copies and set-ups fail at random moments; what was held is read again if possible, or done again."""
    rng = random.Random(seed)
    fails = {name: {rng.randrange(1, 9) for _ in range(2)} for name in ("render", "copy", "hold")}
    worker, film = Holder(PLAN, fails, readable=readable), RunningFilm(26, 19)
    started, told = rng.random() < 0.5, list[tuple[int, int]]()
    if started:
        part = dataclasses.replace(PLAN, sample_count=2)
        assert go(part, FakeWorker(part), film).complete
    plan = dataclasses.replace(PLAN, wanted=film.ledger.lacking(0, 6))
    tally = go(plan, worker, film, on_progress=lambda *done: told.append(done))
    assert tally.complete and sum(worker.calls[name] >= min(fails[name]) for name in fails) > 0
    assert_whole(PLAN, film)
    assert tally.samples == plan.samples and told[-1] == (tally.samples, tally.rays)
    assert film.account()["rays"] == 3 * PLAN.samples
    (done,) = tally.workers
    assert done.failures == len(tally.recovered) > 0 or done.failures > 0


def test_what_was_held_is_rendered_again_unless_it_can_be_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scheduling, "_COPY_SHARES", (1e-9, 1e-9))
    for readable in (False, True):
        worker, film = Holder(PLAN, {"render": {6}}, readable=readable), Film(26, 19)
        tally = go(PLAN, worker, film)
        assert_whole(PLAN, film)
        assert tally.workers[0].requeued == (1 if readable else 6)


def test_a_device_begins_anew_with_what_was_read_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the thread that takes results in is late."""
    monkeypatch.setattr(scheduling, "_COPY_SHARES", (1e-9, 1e-9))
    worker, film = Holder(PLAN, {"render": {4, 6}}, readable=True), Film(26, 19)
    assert go(PLAN, worker, film, on_progress=lambda *done: time.sleep(0.01)).complete
    assert_whole(PLAN, film)


def test_a_device_that_stays_away_leaves_what_was_copied() -> None:
    worker, film = Holder(PLAN, {"render": set(range(8, 99))}), Film(26, 19)
    tally = go(PLAN, worker, film)
    assert tally.all_failed and not tally.complete
    assert 0 < tally.samples == film.ledger.samples == film.samples < PLAN.samples


def test_a_call_that_does_not_return_leaves_what_was_copied() -> None:
    released = threading.Event()
    worker, film = Holder(PLAN), Film(26, 19)
    worker.before = lambda asked, unit: released.wait(20.0) if asked == 9 else None  # type: ignore[assignment]
    tally = go(PLAN, worker, film)
    assert tally.workers[0].state == "hung" and 0 < tally.samples == film.ledger.samples < PLAN.samples
    before = film.counts.copy()
    released.set()
    assert (film.counts == before).all()


def test_a_run_that_is_stopped_keeps_all_that_was_done(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scheduling, "_COPY_SHARES", (1e-9, 1e-9))
    for after in (1, 20, 40):
        worker, film, seen = Holder(PLAN), Film(26, 19), list[int]()

        def stop(seen: list[int] = seen, after: int = after) -> bool:
            return len(seen) >= after

        tally = go(PLAN, worker, film, on_progress=lambda *done, seen=seen: seen.append(done[0]), should_stop=stop)
        assert tally.stopped and not tally.complete
        assert tally.samples == film.ledger.samples == film.samples == seen[-1] > 0
        rest = dataclasses.replace(PLAN, wanted=film.ledger.lacking(0, 6))
        assert go(rest, Holder(PLAN), film).complete
        assert_whole(PLAN, film)


def test_an_exception_of_a_listener_ends_the_run() -> None:
    def interrupt(samples: int, rays: int) -> None:
        raise KeyboardInterrupt

    film, before = Film(26, 19), threading.active_count()
    with pytest.raises(KeyboardInterrupt):
        go(PLAN, Holder(PLAN), film, on_progress=interrupt)
    assert threading.active_count() == before and not film.held


def test_a_checkpoint_is_of_a_copy_that_was_made_for_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("clrender.film.cadence.EVERY_SECONDS", 0.0)
    monkeypatch.setattr(scheduling, "_COPY_SHARES", (1e9, 1e-9))  # only when somebody asks
    saved = list[Film]()
    save = Film.save

    def saving(self: Film, *arguments: Any, **more: Any) -> None:
        save(self, *arguments, **more)
        saved.append(Film.load(tmp_path / "a.film"))

    monkeypatch.setattr(Film, "save", saving)
    request = {"width": 26, "height": 19}
    with Checkpoint(tmp_path / "a.film", False, print) as checkpoint:
        film = checkpoint.begin(request, range(6), {})
        worker = Holder(PLAN)
        worker.before = lambda asked, unit: time.sleep(0.0005)
        go(PLAN, worker, film, should_stop=lambda: checkpoint.tick() or False)  # type: ignore[func-returns-value]
    assert len(saved) >= 2 and saved[-1].ledger.samples == PLAN.samples
    assert [each.ledger.samples for each in saved] == sorted(each.ledger.samples for each in saved)
    assert all(each.samples == each.ledger.samples for each in saved)
    assert_whole(PLAN, saved[-1])


def copy_of(film: Film, base: object) -> FilmCopy:
    return FilmCopy(film.counts.copy(), [band.copy() for band in film.bands()], [], None, base)


def test_a_copy_is_of_the_film_that_the_device_began_with() -> None:
    film, device = Film(26, 19), Film(26, 19)
    unit = Unit(0, 64, 0, 2, 8)
    result = FakeWorker(PLAN).render(unit)
    held = HeldUnit(result.done, 1, 1, 1)
    device.commit(unit, result)
    begun = film.version
    film.commit(Unit(64, 64, 0, 2, 8), FakeWorker(PLAN).render(Unit(64, 64, 0, 2, 8)))
    with pytest.raises(RenderError, match="changed while a device held it"):
        film.receive(copy_of(device, begun), [(unit, held)])
    with pytest.raises(RenderError, match="came with 3"):
        film.receive(copy_of(device, film.version), [(unit, HeldUnit(np.full(4, 3, np.uint32), 1, 1, 1))])
    whole = Film(26, 19)
    whole.receive(copy_of(device, whole.version), [(unit, held)])
    with pytest.raises(UsageError, match="held already"):
        whole.receive(copy_of(device, whole.version), [(unit, held)])
    assert whole.samples == whole.ledger.samples == 2 * 64
    np.testing.assert_array_equal(whole.counts, device.counts)


def test_what_is_being_saved_does_not_change() -> None:
    """A film that a device delivered is saved as it is, and is copied before anything else is added to it."""
    film, device = RunningFilm(26, 19), Film(26, 19)
    units = [Unit(64 * k, 64, 0, 2, 8) for k in range(3)]
    results = [FakeWorker(PLAN).render(unit) for unit in units]
    device.commit(units[0], results[0])
    film.receive(copy_of(device, film.version), [(units[0], HeldUnit(results[0].done, 1, 1, 1))])
    shared = film.as_received()
    changes: list[Callable[[], Any]] = [
        lambda: film.commit(units[1], results[1]),
        lambda: film.take_out(device),
    ]
    for change in changes:
        change()
        np.testing.assert_array_equal(shared.counts, device.counts)
        np.testing.assert_array_equal(np.concatenate(shared.bands()), np.concatenate(device.bands()))
        shared = film.as_received()
        device = Film(26, 19)
        film.copy_to(device)
