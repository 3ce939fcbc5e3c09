"""What is done twice, who is wrong when that differs, and how long silence may last."""

from __future__ import annotations

import math
import random
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from cases import for_each
from test_scheduling import FakeWorker, assert_whole, cut_as, no_threads_left, plan_for, small_units

from clrender.errors import DeviceFailure, RenderError, UsageError
from clrender.film import Film
from clrender.film.running import RunningFilm
from clrender.film.unit import Unit, UnitSums
from clrender.process.elapsed import processor_seconds
from clrender.scheduling import run as scheduling
from clrender.scheduling.contributions import MOST_BYTES, Contributions
from clrender.scheduling.dispute import judge
from clrender.scheduling.policy import Plan, Remaining
from clrender.scheduling.run import Tally, run
from clrender.scheduling.spot_check import SHARE, Piece, Sampler
from clrender.scheduling.tally import failures_told
from clrender.scheduling.watchdog import TimeLimits, Watchdog
from clrender.scheduling.work import Kind, Task, Work
from clrender.scheduling.worker import Candidate


def sums(unit: Unit, seed: int = 0) -> UnitSums:
    rng = np.random.default_rng([unit.first_slot, unit.first_sample, seed])
    words = rng.integers(0, 2**32, (unit.slot_count, 3, 4), dtype=np.uint32)
    words[..., 3] %= 1000
    count, done = (np.full(n, unit.sample_count, np.uint32) for n in (unit.slot_count, unit.slot_count // 16))
    return UnitSums(words, count, done, 0, 0, 0)


# --- films that give samples back ------------------------------------------------------------------------------------


def test_a_film_gives_back_what_came_in() -> None:
    """Whatever came before, between and after: sums, counts and ledger are as if it had never been there."""
    units = [Unit(0, 256, 0, 4, 16), Unit(0, 256, 4, 3, 16), Unit(256, 256, 0, 7, 16), Unit(0, 256, 7, 2, 16)]
    whole, gone, left = Film(30, 13), Film(30, 13), Film(30, 13)
    for number, unit in enumerate(units):
        whole.commit(unit, sums(unit))
        (gone if number in (1, 2) else left).commit(unit, sums(unit))
    whole.take_out(gone)
    assert whole.ledger == left.ledger and (whole.counts == left.counts).all()
    for band, expected in zip(whole.bands(), left.bands(), strict=True):
        np.testing.assert_array_equal(band, expected)
    with pytest.raises(UsageError, match=r"samples 0 to 6 of some pixels are not held"):
        whole.take_out(gone)
    assert whole.ledger == left.ledger
    whole.merge(gone)
    assert whole.ledger.holds(0, 7) is False and whole.samples == gone.samples + left.samples


@pytest.mark.parametrize("resumed", [False, True], ids=["empty before", "with samples of before"])
@pytest.mark.parametrize("shared", [False, True], ids=["a film each", "none for each"])
def test_what_a_worker_did_is_withdrawn(shared: bool, resumed: bool) -> None:
    """A film may hold samples of before; where workers are not told apart, all that came since is done again."""
    before, units = Unit(0, 256, 90, 4, 16), [Unit(0, 256, sample, 1, 16) for sample in range(6)]
    film, expected = Film(16, 16), Film(16, 16)
    for each in (film, expected) if resumed else ():
        each.commit(before, sums(before))
    apart = Contributions(film, 2, 0 if shared else MOST_BYTES)
    for number, unit in enumerate(units):
        assert apart.commit(number % 2, unit, sums(unit)) == 256
        if number % 2 and not shared:
            expected.commit(unit, sums(unit))
    gone = apart.withdraw(0)
    assert gone == ({0: units[::2], 1: units[1::2]} if shared else {0: units[::2]})
    assert film.ledger == expected.ledger
    np.testing.assert_array_equal(film.bands()[0], expected.bands()[0])
    np.testing.assert_array_equal(film.counts, expected.counts)
    assert not any(apart.withdraw(0).values())


def test_a_running_film_notices_a_merge() -> None:
    """A film that gets back what it held before is saved, unless the merge broke off half-way."""
    film, other, unit = RunningFilm(16, 16), Film(16, 16), Unit(0, 256, 0, 4, 16)
    other.commit(unit, sums(unit))
    film.merge(other)
    assert film.changes == 1 and film.intact
    with pytest.raises(UsageError, match="overlap"):
        film.merge(other)
    assert film.changes == 1 and film.intact
    other.ledger = Film(16, 16).ledger
    with patch("clrender.film.film.add", side_effect=MemoryError), pytest.raises(MemoryError):
        film.merge(other)
    assert not film.intact


# --- what is checked -------------------------------------------------------------------------------------------------


def pieces(plan: Plan, units: list[Unit], share: float = SHARE, seed: int = 1) -> tuple[list[Any], Sampler]:
    sampler = Sampler(plan, share, random.Random(seed))
    return [sampler.piece(0, unit, sums(unit)) for unit in units], sampler


def test_a_piece_is_a_part_of_its_unit_with_the_same_sums() -> None:
    plan = Plan(800, 800, 0, 64, 64)
    units = [Unit(4096 * 8 * k, 4096 * 8, 0, 16, 64) for k in range(10)]
    for piece, unit in zip(*(pieces(plan, units)[0], units), strict=True):
        assert piece is not None, "of every unit"
        at = piece.unit.first_slot - unit.first_slot
        assert at % 16 == 0 and 0 <= at < unit.slot_count and piece.unit.slot_count % 16 == 0
        assert (piece.unit.first_sample, piece.unit.sample_count) == (unit.first_sample, unit.sample_count)
        part = slice(at, at + piece.unit.slot_count)
        assert piece.agrees(UnitSums(sums(unit).sums[part], sums(unit).counts[part], sums(unit).done, 0, 0, 0))
        assert piece.samples == piece.unit.slot_count * 16


@pytest.mark.parametrize(("width", "height", "tile", "samples"), [(800, 800, 64, 16), (64, 48, 16, 2), (37, 21, 8, 1)])
def test_the_share_is_kept(width: int, height: int, tile: int, samples: int) -> None:
    plan = plan_for(width, height, 64, tile)
    units = list(small_units(plan, samples))
    found = [piece for piece in pieces(plan, units)[0] if piece is not None]
    total = sum(int(unit.pixels(width, height).sum()) * unit.sample_count for unit in units)
    least = int(units[0].pixels(width, height)[:1].sum()) * samples
    assert 0.5 * SHARE * total <= sum(piece.samples for piece in found) <= SHARE * total + least


def test_the_first_unit_is_checked_however_small_it_is() -> None:
    plan = plan_for(5, 3, 1, 8)
    (piece,), _ = pieces(plan, [Unit(0, 64, 0, 1, 8)])
    assert piece.samples > 0
    assert pieces(plan, [Unit(0, 64, 0, 1, 8)], share=0.0)[0] == [None]


def test_every_block_of_the_image_has_its_chance() -> None:
    plan, unit = plan_for(40, 24, 64, 16), Unit(0, 6 * 256, 0, 16, 16)
    hits = np.zeros(unit.slot_count // 16, int)
    for seed in range(1500):
        (piece,), _ = pieces(plan, [unit], 0.02, seed)
        first = piece.unit.first_slot // 16
        hits[first : first + piece.unit.slot_count // 16] += 1
    inside = unit.pixels(40, 24) > 0
    expected = hits[inside].mean()
    assert hits[inside].min() > 0.4 * expected and hits[inside].max() < 1.8 * expected


def test_units_that_were_stopped_are_not_checked() -> None:
    unit = Unit(0, 256, 0, 4, 16)
    half = sums(unit)
    half.done[3] = 2
    assert Sampler(plan_for(16, 16, 4, 16)).piece(0, unit, half) is None


# --- who is wrong ----------------------------------------------------------------------------------------------------

A, B, C = b"a", b"b", b"c"


@for_each(
    ("answers", "drivers", "wrong", "undecided"),
    [
        ({0: [A, B, B], 1: [B, B, B]}, "xx", {0}, set()),
        ({0: [A, A, A], 1: [B, A, A]}, "xx", {1}, set()),
        ({0: [A, B, C], 1: [C, B, A]}, "xy", {0, 1}, set()),
        ({0: [A, A, A], 1: [B, B, B]}, "xy", set(), {0, 1}),
        ({0: [A, A, A], 1: []}, "xy", {1}, set()),
        ({0: [], 1: []}, "xy", {0, 1}, set()),
        ({0: [A, A, A], 1: [B, B, B], 2: [B, B]}, "xyz", {0}, set()),
        ({0: [A, A, A], 1: [B, B, B], 2: [B, B]}, "xxx", {0}, set()),
        # two devices of one driver are one witness against another driver
        ({0: [A, A, A], 1: [B, B, B], 2: [B, B]}, "xyy", set(), {0, 1, 2}),
        ({0: [A, A, A], 1: [B, B, B], 2: [C, A]}, "xyz", {2}, {0, 1}),
        ({0: [A, A, A], 1: [B, B, B], 2: [C, C]}, "xyz", set(), {0, 1, 2}),
    ],
)
def test_who_is_wrong(answers: dict[int, list[bytes]], drivers: str, wrong: set[int], undecided: set[int]) -> None:
    assert judge(answers, list(drivers)) == (wrong, undecided)


class Liar(FakeWorker):
    """Its sums are wrong: in each block of a share of its units."""

    def __init__(self, plan: Plan, share: float, constant: bool, seed: int = 0) -> None:
        super().__init__(plan, "liar")
        self.rng, self.share, self.constant = random.Random(seed), share, constant

    def render(self, unit: Unit, on_slice: Any = None, should_stop: Any = None) -> UnitSums:
        result = super().render(unit, on_slice, should_stop)
        if self.rng.random() < self.share:
            result.sums[::16, 1, 0] ^= np.uint32(1 if self.constant else self.rng.randrange(1, 256))
        return result


def meet(
    plan: Plan,
    film: Film,
    *workers: FakeWorker,
    proof: Callable[[FakeWorker], bool] | None = None,
    apart_bytes: int = MOST_BYTES,
) -> Tally:
    candidates = [
        Candidate(worker.name, partial(lambda each: each, worker), prove=proof and partial(proof, worker))
        for worker in workers
    ]
    return run(plan, candidates, film, apart_bytes=apart_bytes)


@pytest.mark.parametrize("apart_bytes", [MOST_BYTES, 0], ids=["films apart", "no memory for them"])
@pytest.mark.parametrize("constant", [False, True])
@pytest.mark.parametrize("order", [1, -1])
def test_a_liar_is_found_and_its_units_are_done_again(constant: bool, order: int, apart_bytes: int) -> None:
    plan, film = plan_for(40, 24, 12, 8), Film(40, 24)
    pair = [Liar(plan, 1.0, constant), FakeWorker(plan, "honest")][::order]
    with cut_as(small_units):
        tally = meet(plan, film, *pair, proof=lambda worker: worker.name == "honest", apart_bytes=apart_bytes)
    assert_whole(plan, film)
    assert tally.complete and tally.samples == 40 * 24 * 12
    states = {each.name: each.state for each in tally.workers}
    assert states == {"liar": "wrong", "honest": "ok"} and tally.differences >= 1
    (line,) = failures_told(tally)
    assert line.startswith("warning: liar computes wrong results: it ")


def test_when_nobody_can_tell_both_are_named() -> None:
    plan, film = plan_for(40, 24, 12, 8), Film(40, 24)
    with cut_as(small_units):
        tally = meet(plan, film, Liar(plan, 1.0, True), FakeWorker(plan, "honest"), proof=lambda worker: True)
    assert tally.all_failed and not tally.complete
    with pytest.raises(RenderError, match=r"liar and honest give different results .* render on one of them alone"):
        tally.raise_failure()
    assert film.samples == 0


def test_a_liar_that_dies_when_it_is_asked_again_is_not_believed() -> None:
    plan, film = plan_for(40, 24, 12, 8), Film(40, 24)

    class Coward(Liar):
        def render(self, unit: Unit, *more: Any) -> UnitSums:
            if unit.slot_count < 64:  # a piece
                raise RenderError("coward is gone")
            return super().render(unit, *more)

    with cut_as(small_units):
        tally = meet(plan, film, Coward(plan, 1.0, True), FakeWorker(plan, "honest"))
    assert_whole(plan, film)
    assert tally.complete and tally.workers[0].state in ("wrong", "failed")


# --- devices that come back, and those that never do -----------------------------------------------------------------


@pytest.fixture
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scheduling, "TIME_LIMITS", TimeLimits(pause=0.01, call=0.5, compile=0.6, hurry=0.3))


def test_a_device_that_failed_is_set_up_again(hasty: None) -> None:
    plan, film = plan_for(30, 22, 6, 8), Film(30, 22)
    restarts: list[int] = []
    told: list[str] = []

    def fails_twice(asked: int, unit: Unit) -> None:
        if asked in (3, 4):
            raise DeviceFailure("out of resources")

    worker = FakeWorker(plan, "alone", fails_twice)
    candidate = Candidate("alone", lambda: worker, restart=lambda: restarts.append(1))
    with cut_as(small_units):
        tally = run(plan, [candidate], film, tell=told.append)
    assert_whole(plan, film)
    assert tally.complete and not tally.failures and len(restarts) == 2 and len(told) == 2
    assert [str(error) for error in tally.recovered] == ["out of resources"]
    assert (tally.workers[0].failures, tally.workers[0].requeued, tally.workers[0].state) == (2, 2, "ok")


def test_a_device_that_always_fails_is_given_up(hasty: None) -> None:
    plan, before = plan_for(30, 22, 6, 8), threading.active_count()

    def fails(asked: int, unit: Unit) -> None:
        if asked > 2:
            raise DeviceFailure("out of resources")

    film = Film(30, 22)
    with cut_as(small_units):
        tally = run(plan, [Candidate("alone", lambda: FakeWorker(plan, "alone", fails))], film)
    # Each time two units are done; then it fails once more
    assert tally.all_failed and tally.workers[0].failures == 1 + scheduling.TIME_LIMITS.retries
    assert film.samples == tally.samples > 0
    assert no_threads_left(before)


def test_a_worker_that_is_not_there_is_waited_for_while_others_work() -> None:
    """It gets work once it is there, under the name that it has by then; till then nobody waits for it."""
    plan, film, there = plan_for(30, 22, 40, 8), Film(30, 22), threading.Event()
    done: list[str] = []

    def of(name: str, asked: int, unit: Unit) -> None:
        if name == "here" and asked == 20:
            there.set()
        elif name == "here" and asked > 20 and "late" not in done:
            time.sleep(0.02)
        done.append(name)

    late = Candidate("nobody", lambda: FakeWorker(plan, "late", partial(of, "late")), present=there.is_set)
    here = Candidate("here", lambda: FakeWorker(plan, "here", partial(of, "here")))

    def present() -> bool:
        late.name = "late"
        return there.is_set()

    late.present = present
    with cut_as(small_units):
        tally = run(plan, [here, late], film)
    assert_whole(plan, film)
    assert [each.name for each in tally.workers] == ["here", "late"]
    assert all(each.units for each in tally.workers) and "late" not in done[:20]
    assert not tally.failures


def test_nobody_waits_at_the_end_for_a_worker_that_never_came() -> None:
    plan, film, before = plan_for(30, 22, 6, 8), Film(30, 22), threading.active_count()
    never = Candidate("never", lambda: FakeWorker(plan, "never"), present=lambda: False)
    here = Candidate("here", lambda: FakeWorker(plan, "here"))
    ended: list[Tally] = []
    other = threading.Thread(target=lambda: ended.append(run(plan, [here, never], film)), daemon=True)
    other.start()
    other.join(600.0)  # so that a wait without end fails
    (tally,) = ended
    assert_whole(plan, film)
    assert tally.complete and not tally.failures
    assert no_threads_left(before)


def test_a_worker_that_will_never_come_says_why() -> None:
    def present() -> bool:
        raise RenderError("nobody is there")

    plan, film = plan_for(30, 22, 6, 8), Film(30, 22)
    tally = run(plan, [Candidate("never", lambda: FakeWorker(plan, "never"), present=present)], film)
    assert tally.all_failed and [str(error) for error in tally.failures] == ["nobody is there"]


def test_who_is_being_set_up_when_all_is_done_is_told() -> None:
    plan, film, told = plan_for(30, 22, 6, 8), Film(30, 22), threading.Event()

    def set_up() -> FakeWorker:
        assert told.wait(30.0)
        return FakeWorker(plan, "slow")

    slow = Candidate("slow", set_up, give_up=told.set)
    tally = run(plan, [Candidate("here", lambda: FakeWorker(plan, "here")), slow], film, check_share=0.0)
    assert_whole(plan, film)
    assert told.is_set() and tally.complete and not tally.failures


def test_what_happened_often_is_told_once() -> None:
    tally = Tally(failures=[RenderError("a")], recovered=[RenderError("b"), RenderError("b")])
    assert [line.partition("; ")[2] for line in failures_told(tally)] == [
        "its work was done by the others",
        "it worked again when it was set up anew (2 times)",
    ]


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def test_silence_is_measured_against_what_calls_took() -> None:
    clock, calls = Clock(), [0]
    watch = Watchdog([lambda: (calls[0], False)], TimeLimits(), clock)

    def pass_time(seconds: float, **how: Any) -> bool:
        late: list[int] = []
        for _ in range(round(seconds * 10)):
            clock.now += 0.1
            late += watch.silent({0}, **how)
        return bool(late)

    assert not pass_time(1700.0), "it may compile, or be slow: nothing is known yet"
    watch.beat(0, slice_done=True)
    assert not pass_time(59.0)
    watch.beat(0)
    assert not pass_time(600.0), "a call took 59 s, so twenty times as much is no fault"
    calls[0] += 1
    assert pass_time(13000.0)


def test_time_in_which_the_process_did_not_run_does_not_count() -> None:
    """Stopped by a signal or a debugger, or starved: the device was not asked."""
    clock = Clock()
    watch = Watchdog([None], TimeLimits(), clock)
    watch.beat(0, slice_done=True)
    clock.now = 1e6
    assert watch.silent({0}) == []
    clock.now += 30.0
    assert watch.silent({0}) == []
    for _ in range(7200):
        clock.now += 0.5
        assert watch.silent({0}) == [], "woken twice a second: an hour in which nobody could answer"
    for _ in range(610):
        clock.now += 0.1
        late = watch.silent({0})
    assert late == [0]


def processor(clock: Clock, share: float, period: float) -> Callable[[], float]:
    """Processor seconds of a computation that gets a share of a processor, at the end of each period if it has one."""
    return lambda: (math.floor(clock.now / period) * period if period else clock.now) * share


@pytest.mark.parametrize(
    ("share", "period", "seconds"),
    [
        (0.0, 1.0, 60.0),  # asleep for ever
        (0.001, 1.0, 67.0),  # so, while another thread of the driver wakes up each second
        (1.0, 0.0, 60.0),  # round and round
        (8.0, 0.0, 60.0),  # on several processors
        (0.02, 0.5, 3000.0),  # starved: as long as it takes to have computed for a minute
        (0.02, 1.0, 3000.0),
        (0.3, 0.0, 200.0),
    ],
)
def test_a_starved_computation_does_not_hang_but_one_that_sleeps_does(
    share: float, period: float, seconds: float
) -> None:
    clock = Clock()
    watch = Watchdog([None], TimeLimits(), clock, [processor(clock, share, period)])
    watch.beat(0, slice_done=True)
    while not watch.silent({0}):
        clock.now += 0.1
    assert clock.now == pytest.approx(seconds, rel=0.05)


@pytest.mark.parametrize(
    ("stopped", "samples", "seconds"), [(False, False, 1800.0), (True, False, 1800.0), (True, True, 60.0)]
)
def test_a_compiler_may_finish_when_a_stop_is_asked_for_before_there_is_a_sample(
    stopped: bool, samples: bool, seconds: float
) -> None:
    clock = Clock()
    watch = Watchdog([lambda: (7, True)], TimeLimits(), clock)
    while not watch.silent({0}, waited_for=samples, hurry=stopped):
        clock.now += 0.2
    assert clock.now == pytest.approx(seconds, rel=0.01)


@pytest.mark.parametrize("samples", [0, 4])
def test_a_device_that_does_not_end_a_render_that_is_to_stop_has_not_failed(hasty: None, samples: int) -> None:
    """There is an image, or the caller says that no sample was finished."""
    plan, film = plan_for(30, 22, 6, 8), Film(30, 22)
    release, asked_for = threading.Event(), threading.Event()

    def hangs(asked: int, unit: Unit) -> None:
        if asked > samples:
            asked_for.set()
            release.wait()

    worker = FakeWorker(plan, "slow", hangs)
    with cut_as(small_units):
        tally = run(plan, [Candidate("slow", lambda: worker)], film, should_stop=asked_for.is_set)
    release.set()
    assert tally.stopped and not tally.complete and not tally.all_failed
    assert tally.workers[0].state == "hung", "but it is not used again"
    assert failures_told(tally) == ["warning: slow did not stop in time; it is not used any more"]
    assert (tally.samples > 0) == (samples > 0)
    tally.raise_failure()


@pytest.mark.parametrize("how", ["error before", "error after"])
def test_only_failures_before_the_stop_count(hasty: None, how: str) -> None:
    plan, film = plan_for(30, 22, 6, 8), Film(30, 22)
    stop, noticed = threading.Event(), threading.Event()

    def fails(asked: int, unit: Unit) -> None:
        if asked > 2:
            if how == "error after":
                stop.set()
                noticed.wait()
            raise RenderError("it broke")

    def should_stop() -> bool:
        if stop.is_set():
            noticed.set()
        return stop.is_set()

    worker = FakeWorker(plan, "slow", fails)
    with cut_as(small_units):
        tally = run(plan, [Candidate("slow", lambda: worker)], film, should_stop=should_stop)
    assert tally.all_failed == (how == "error before")


def test_the_processor_time_of_a_worker_is_not_that_of_other_threads() -> None:
    """A busy thread elsewhere in the program does not make a driver that sleeps look busy."""
    end = threading.Event()

    def burn() -> None:
        while not end.is_set():
            pass

    sleeps, burns = threading.Thread(target=end.wait), threading.Thread(target=burn)
    for thread in (sleeps, burns):
        thread.start()
    one, other = processor_seconds(lambda: [sleeps]), processor_seconds(lambda: [burns])
    begun = one(), other()
    used = time.process_time()
    while time.process_time() - used < 0.3:
        time.sleep(0.01)
    asleep, busy = one() - begun[0], other() - begun[1]
    end.set()
    for thread in (sleeps, burns):
        thread.join()
    assert busy > 0.1 and asleep < 0.5 * busy


def test_compilers_have_time_unless_all_others_wait() -> None:
    clock = Clock()
    watch = Watchdog([lambda: (7, True)], TimeLimits(), clock)
    watch.beat(0, slice_done=True)
    for _ in range(1000):
        clock.now += 0.1
        assert watch.silent({0}) == []
    clock.now += 0.1
    assert watch.silent({0}, waited_for=True) == [0]
    assert watch.silent(set(), waited_for=True) == []


@pytest.mark.thorough
@pytest.mark.parametrize("others", [0, 1])
def test_a_call_that_never_returns_does_not_hold_up_the_render(hasty: None, others: int) -> None:
    plan, film, before = plan_for(30, 22, 6, 8), Film(30, 22), threading.active_count()
    release, lost = threading.Event(), []

    def hangs(asked: int, unit: Unit) -> None:
        if asked == 4:
            release.wait()

    bad, good = (
        FakeWorker(plan, "bad", hangs),
        FakeWorker(plan, "good", lambda asked, unit: time.sleep(0.02)),
    )
    candidates = [
        Candidate("bad", lambda: bad, lose=lambda: lost.append("bad")),
        Candidate("good", lambda: good, lose=lambda: lost.append("good")),
    ]
    with cut_as(small_units):
        tally = run(plan, candidates[: 1 + others], film)
    assert lost == ["bad"] and tally.workers[0].state == "hung" and tally.workers[0].requeued == 1
    assert [str(error) for error in tally.failures] == ["bad hangs: a call of its driver did not come back"]
    if others:
        assert_whole(plan, film)
    samples = film.samples
    assert tally.complete == bool(others) and film.samples == tally.samples
    release.set()  # its late result is nobody's business
    assert no_threads_left(before)
    assert film.samples == samples


def test_whoever_wants_the_render_to_end_does_not_wait_for_a_call_that_hangs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scheduling, "TIME_LIMITS", TimeLimits(call=1e6, hurry=0.2))
    plan, film, before = plan_for(30, 22, 6, 8), Film(30, 22), threading.active_count()
    release, hanging = threading.Event(), threading.Event()
    patience = threading.Timer(300.0, release.set)  # whoever waits for the call sees it return, and no device that hung

    def hangs(asked: int, unit: Unit) -> None:
        if asked == 4:
            hanging.set()
            release.wait()

    patience.start()
    with cut_as(small_units):
        worker = FakeWorker(plan, "bad", hangs)
        tally = run(plan, [Candidate("bad", lambda: worker)], film, None, hanging.is_set)
    patience.cancel()
    patience.join()
    assert tally.workers[0].state == "hung" and 0 < film.samples == tally.samples
    release.set()
    assert no_threads_left(before)


# --- together they are as fast as the sum of them --------------------------------------------------------------------


class Sleeper:
    """A device of a given speed that leaves the processor alone: samples of nothing."""

    def __init__(self, plan: Plan, rate: float) -> None:
        self.plan, self.rate = plan, rate

    def render(self, unit: Unit, on_slice: Any = None, should_stop: Any = None) -> UnitSums:
        pixels = unit.pixels(self.plan.width, self.plan.height)
        left = int(pixels.sum()) * unit.sample_count
        end = time.perf_counter()
        while left > 0:
            part = min(left, max(256, int(self.rate * 0.15)))
            end, left = end + part / self.rate, left - part
            time.sleep(max(0.0, end - time.perf_counter()))
            if on_slice is not None:
                on_slice(part, 20 * part)
        counts = np.repeat(np.minimum(pixels, 1), 16).astype(np.uint32) * np.uint32(unit.sample_count)
        sums = np.zeros((unit.slot_count, 3, 4), np.uint32)
        sums[..., 1] = counts[:, None]
        return UnitSums(sums, counts, np.full(len(pixels), unit.sample_count, np.uint32), 0, 0, 0)


def together(plan: Plan, rates: list[float]) -> tuple[float, Tally]:
    """Speed of devices that share a render, by the sum of their speeds."""
    candidates = [Candidate(f"{rate}", partial(Sleeper, plan, rate)) for rate in rates]
    begun = time.perf_counter()
    tally = run(plan, candidates, Film(plan.width, plan.height))
    assert tally.complete and tally.differences == 0
    return plan.samples / sum(rates) / (time.perf_counter() - begun), tally


def test_checks_cost_no_more_than_their_share() -> None:
    plan = Plan(400, 400, 0, 32, 64)
    _, tally = together(plan, [10e6, 3e6])
    assert 0.005 * plan.samples < tally.check_samples <= 0.01 * plan.samples


@pytest.mark.slow
@pytest.mark.parametrize("rates", [[4.4e6] * 2, [4.4e6, 1.1e6], [4.4e6, 4e5, 1e5], [2.2e6] * 4, [1.4e6] * 2], ids=str)
def test_devices_that_share_lose_little(rates: list[float]) -> None:
    """The checks and the merging of results with them, by the clock."""
    plan = Plan(800, 800, 0, 64, 64)
    assert max(together(plan, rates)[0] for _ in range(3)) >= 0.95


def test_a_liar_that_hangs_when_it_is_asked_again_is_found_all_the_same(hasty: None) -> None:
    plan, film, release = plan_for(40, 24, 12, 8), Film(40, 24), threading.Event()

    class Hanging(Liar):
        def render(self, unit: Unit, *more: Any) -> UnitSums:
            if unit.slot_count < 64:  # a piece
                release.wait()
            return super().render(unit, *more)

    with cut_as(small_units):
        tally = meet(plan, film, Hanging(plan, 1.0, True), FakeWorker(plan, "honest"))
    release.set()
    assert_whole(plan, film)
    assert tally.complete and tally.samples == 40 * 24 * 12 and tally.workers[0].state == "wrong"
    lines = failures_told(tally)
    assert len(lines) == 2 and "liar hangs: " in lines[0] and "liar computes wrong results: " in lines[1]


def test_what_a_worker_did_before_it_hung_is_still_checked() -> None:
    plan = plan_for(40, 24, 12, 8)
    work, unit = Work(Remaining(plan, 2), 2), Unit(0, 64, 0, 12, 8)
    piece = Sampler(plan).piece(0, unit, FakeWorker(plan, "hung").render(unit))
    assert piece is not None
    work.check(piece)
    work.measured(1, unit, 0.01)
    work.dismiss(0)
    task = work.take(1)
    assert task is not None and task.kind is Kind.CHECK and task.piece is piece
    work.give_back(task)
    work.cancel_checks(0)
    task = work.take(1)
    assert task is not None and task.kind is Kind.UNIT


def test_what_waits_for_a_slow_worker_to_be_checked_is_little(monkeypatch: pytest.MonkeyPatch) -> None:
    """0.3 s at first, later a fiftieth of the time so far, less what a piece takes however few its samples are."""
    now = 100.0
    monkeypatch.setattr("clrender.scheduling.work.time.monotonic", lambda: now)
    plan = plan_for(64, 64, 8)
    work, unit = Work(Remaining(plan, 2), 2), Unit(0, 4096, 0, 8, 8)
    work.measured(0, unit, 0.01)
    work.measured(1, unit, 4096 * 8 / 5000.0)
    assert work.room(0) == pytest.approx(0.3 * 5000.0)
    assert work.room(1) == pytest.approx(0.3 * 4096 * 8 / 0.01)
    work.timed(1, 500, 0.3)  # 0.1 s for these samples, and 0.2 s beside
    assert work.room(0) == pytest.approx(0.1 * 5000.0)
    now += 30.0
    assert work.room(0) == pytest.approx(0.4 * 5000.0)
    now += 1000.0
    assert work.room(0) == pytest.approx(0.8 * 5000.0)
    work.timed(1, 500, 60.0)
    assert work.room(0) == pytest.approx(0.8 * 5000.0), "something else may have delayed it"
    work.timed(1, 500, 60.0)
    assert work.room(0) == 1.0, "of its first unit, a block is checked by whomever"


@pytest.mark.parametrize(("seconds", "largest"), [(2.0, 400), (20.0, 600)])
def test_at_the_end_nobody_waits_long_for_a_slow_worker_that_checks(
    monkeypatch: pytest.MonkeyPatch, seconds: float, largest: int
) -> None:
    """A tenth of a second or a hundredth of the time; the first check of each worker is done whatever it takes."""
    now = 100.0
    monkeypatch.setattr("clrender.scheduling.work.time.monotonic", lambda: now)
    remaining = Remaining(plan_for(64, 64, 8), 2)
    work, units = Work(remaining, 2), []

    def taken(worker: int) -> Task:
        task = work.take(worker)
        assert task is not None
        return task

    while not remaining.is_empty:
        units.append(taken(0))
    unit = units[0].unit
    assert unit is not None
    work.measured(0, unit, 0.01)
    work.measured(1, Unit(0, 4096, 0, 8, 8), 4096 * 8 / 5000.0)
    now += seconds
    for samples in (4096, 600, 400):  # the slow worker takes 0.82, 0.12 and 0.08 s
        few = np.zeros(0, np.uint32)
        work.check(Piece(unit, 0, samples, few, few))
    last = units.pop()
    for each in units:
        work.settle(each)
    first = taken(1)
    work.settle(first)
    work.settle(last)
    second = taken(1)
    now += 0.15
    work.settle(second)
    assert first.kind is second.kind is Kind.CHECK and first.piece is not None and second.piece is not None
    assert (first.piece.samples, second.piece.samples) == (4096, largest)
    assert work.take(1) is None and work.ended, "nobody waits for what is left"


def test_a_worker_elsewhere_that_cannot_take_the_job_is_named_at_once() -> None:
    """It may be mended while the render runs; it is not named again at the end."""
    plan, film, told, heard = plan_for(30, 22, 6, 8), Film(30, 22), list[str](), threading.Event()

    def refuses() -> FakeWorker:
        raise RenderError("worker w1: version differs here")

    def tell(line: str) -> None:
        told.append(line)
        heard.set()

    def waits(asked: int, unit: Unit) -> None:
        heard.wait()

    good = FakeWorker(plan, "good", waits)
    candidates = [Candidate("w1", refuses, elsewhere=True), Candidate("good", lambda: good)]
    tally = run(plan, candidates, film, tell=tell)
    assert told == ["warning: worker w1: version differs here; its work is done by the others"]
    assert tally.complete and tally.workers[0].state == "failed" and failures_told(tally) == []
