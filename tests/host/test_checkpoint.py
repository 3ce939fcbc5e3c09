"""A checkpoint is whole at every moment, is never shared, and what it lacks is all that a resumed render does."""

from __future__ import annotations

import errno
import fcntl
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_scheduling import FakeWorker, assert_whole, plan_for

import clrender
from clrender.errors import RenderError, UsageError
from clrender.film import Film
from clrender.film.cadence import EVERY_SECONDS, SHARE, Cadence
from clrender.film.checkpoint import Checkpoint
from clrender.film.ledger import Ledger
from clrender.film.lock import FileLock
from clrender.film.request import differences
from clrender.film.unit import Unit, UnitSums, blocks_across, tile_side
from clrender.scheduling.policy import Plan, Remaining
from clrender.scheduling.run import run
from clrender.scheduling.worker import Candidate

REQUEST = {"width": 23, "height": 14, "seed": 7, "scene_sha256": "a", "kernel_sha256": "b", "version": "1"}


# --- what a film lacks -----------------------------------------------------------------------------------------------

Held = dict[tuple[int, int], set[int]]
RANGE = st.tuples(st.integers(0, 20), st.integers(1, 9))


def ledger_of(width: int, height: int, parts: list[tuple[int, tuple[int, int]]]) -> tuple[Ledger, list[set[int]]]:
    """A ledger with some ranges in some blocks, and the same as sets."""
    ledger, sets = Ledger(width, height), [set[int]() for _ in range(blocks_across(width) * blocks_across(height))]
    for block, (start, count) in parts:
        block %= len(sets)
        if not sets[block] & set(range(start, start + count)):
            sets[block] |= set(range(start, start + count))
            ledger.add(np.array([block]), start, np.array([count]))
    return ledger, sets


def held(ledger: Ledger, block: int) -> set[int]:
    (sets, numbers) = ledger.sets_of(np.array([block]))
    return {sample for start, stop in sets[int(numbers[0])] for sample in range(start, stop)}


@settings(deadline=None)
@given(st.lists(st.tuples(st.integers(0, 50), RANGE), max_size=12), st.integers(0, 10), st.integers(0, 25))
def test_what_a_ledger_lacks(parts: list[tuple[int, tuple[int, int]]], start: int, count: int) -> None:
    ledger, sets = ledger_of(18, 11, parts)
    lacking = ledger.lacking(start, start + count)
    for block, taken in enumerate(sets):
        assert held(lacking, block) == set(range(start, start + count)) - taken
        assert held(ledger, block) == taken, "the ledger itself stays"
    some = np.arange(len(sets)) % 3 == 1
    part = ledger.restricted(some)
    assert [held(part, block) for block in range(len(sets))] == [s if b else set() for s, b in zip(sets, some)]  # noqa: B905
    copy = ledger.copy()
    assert copy == ledger
    copy.add(np.array([0]), 40, np.array([1]))
    assert copy != ledger and held(ledger, 0) == sets[0]


@settings(max_examples=60, deadline=None)
@given(
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    parts=st.lists(st.tuples(st.integers(0, 99), RANGE), max_size=12),
    tile=st.sampled_from([4, 8, 16, 64]),
    samples=st.tuples(st.integers(0, 4), st.integers(1, 40)),
    rates=st.sampled_from([[1e3], [1e6], [1e4, 1e3], [1e7, 1e3, 1e2]]),
    one_by_one=st.booleans(),
    short=st.booleans(),
)
def test_units_are_what_is_wanted_and_nothing_else(
    size: tuple[int, int],
    parts: list[tuple[int, tuple[int, int]]],
    tile: int,
    samples: tuple[int, int],
    rates: list[float],
    one_by_one: bool,
    short: bool,
) -> None:
    first, count = samples
    wanted = ledger_of(*size, parts)[0].lacking(first, first + count)
    plan = Plan(*size, first, count, tile_side(tile, *size), one_by_one, wanted=wanted, short_units=short)
    remaining, done, turn = Remaining(plan, len(rates)), Ledger(*size), 0
    last = -1
    while (unit := remaining.take(turn := (turn + 1) % len(rates))) is not None:
        done.add(unit.blocks(*size), unit.first_sample, np.full(unit.slot_count // 16, unit.sample_count))
        remaining.measured(turn, unit, unit.slot_count * unit.sample_count / rates[turn])
        area = plan.tile * plan.tile
        whole = unit.first_slot % area == 0 and unit.slot_count % area == 0
        assert whole or unit.first_slot // area == (unit.first_slot + unit.slot_count - 1) // area
        assert not one_by_one or (unit.sample_count == 1 and unit.first_sample >= last), "samples one after the other"
        last = unit.first_sample
    assert done == wanted
    assert plan.samples == wanted.samples


@pytest.mark.parametrize("one_by_one", [False, True])
def test_units_are_short_where_they_may_be_lost(one_by_one: bool) -> None:
    plan = Plan(2048, 2048, 0, 32, 64, one_by_one, short_units=True)
    remaining, rate, longest = Remaining(plan, 1), 2e5, 0.0
    first = remaining.take(0)
    assert first is not None
    remaining.measured(0, first, first.slot_count * first.sample_count / rate)
    while (unit := remaining.take(0)) is not None:
        seconds = unit.slot_count * unit.sample_count / rate
        remaining.measured(0, unit, seconds)
        longest = max(longest, seconds)
    assert longest <= (3.0 if one_by_one else 1.0)
    assert Remaining(Plan(2048, 2048, 0, 32, 64, one_by_one), 1).take(0) != first, "and only there"


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([4, 8, 64]), st.booleans(), st.integers(1, 3))
def test_a_film_that_was_stopped_anywhere_becomes_whole(stop: int, tile: int, one_by_one: bool, workers: int) -> None:
    """Stopped in the midst of units, of blocks even, and gone on with in other tiles."""
    plan = plan_for(23, 14, 9)
    film, rng = Film(23, 14), np.random.default_rng(stop)
    for sample in range(0, 9, 3):
        for block in rng.choice(24, int(rng.integers(0, 20)), replace=False).tolist():
            # A block of 4 x 4 pixels as a tile of its own
            unit = Unit(block * 16, 16, sample, int(rng.integers(1, 4)), 4)
            film.commit(unit, FakeWorker(Plan(23, 14, 0, 9, 4)).render(unit))
    rest = Plan(23, 14, 0, 9, tile_side(tile, 23, 14), one_by_one, wanted=film.ledger.lacking(0, 9), short_units=True)
    candidates = [Candidate(str(n), partial(lambda each: each, FakeWorker(rest))) for n in range(workers)]
    missing = rest.samples
    tally = run(rest, candidates, film)
    assert tally.complete and tally.samples == missing
    assert_whole(plan, film)


# --- how often -------------------------------------------------------------------------------------------------------


def lost_at_most(seconds_to_save: float, cost: float, end: float = 400.0) -> tuple[float, float]:
    """Of a render in units of a second: what a kill at the worst moment loses, and the share that saving costs."""
    cadence, now, began = Cadence(0.0), 0.0, None
    safe = pending = worst = spent = 0.0
    while now < end:
        worst = max(worst, now - safe)
        now += 1.0  # a unit comes in
        if began is not None and now >= began + seconds_to_save:
            cadence.saved(began, cost)
            safe, began = pending, None
            spent += cost
        if began is None and cadence.due(now):
            began, pending = now, now
    return worst, spent / end


def test_less_than_ten_seconds_are_lost_where_saving_is_quick() -> None:
    worst, share = lost_at_most(0.1, 0.05)
    assert worst <= 10.0 and share <= SHARE
    assert lost_at_most(1.5, 0.09)[0] <= 10.0


@pytest.mark.parametrize("cost", [0.2, 1.0, 2.0])
def test_no_more_than_a_fiftieth_of_the_time_where_it_is_slow(cost: float) -> None:
    worst, share = lost_at_most(cost, cost)
    assert share <= SHARE + cost / 400, "of the first save nobody knows what it will cost"
    assert worst <= 2.0 + 1.1 * cost / SHARE, "and not much less often than that"


def test_the_rule_is_the_one_that_is_documented() -> None:
    assert (EVERY_SECONDS, SHARE) == (5.0, 0.02)


# --- saving ----------------------------------------------------------------------------------------------------------


class Clock:
    """Seconds that pass when told to."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def units(samples: range) -> Iterator[Unit]:
    return (Unit(0, 1024, sample, 1, 32) for sample in samples)


def sums(unit: Unit) -> UnitSums:
    return FakeWorker(Plan(23, 14, 0, 99, 32)).render(unit)


def whole(samples: int) -> Film:
    film = Film(23, 14, REQUEST)
    for unit in units(range(samples)):
        film.commit(unit, sums(unit))
    return film


def same(film: Film, other: Film) -> bool:
    equal = np.array_equal(np.concatenate(film.bands()), np.concatenate(other.bands()))
    return equal and np.array_equal(film.counts, other.counts) and film.ledger == other.ledger


def film_of(checkpoint: Checkpoint) -> Film:
    assert checkpoint._film is not None
    return checkpoint._film


def settle(checkpoint: Checkpoint) -> None:
    """Wait for the save that is on its way."""
    while checkpoint._saving is not None:
        checkpoint.tick()
        time.sleep(0.001)


@contextmanager
def opened(path: Path, told: list[str], clock: Clock) -> Iterator[Checkpoint]:
    """A new one, of a render of eight samples."""
    with Checkpoint(path, False, told.append, clock) as checkpoint:
        checkpoint.begin(REQUEST, range(8), {"scene": {"name": "none"}})
        yield checkpoint


def test_it_is_saved_every_five_seconds_and_at_the_end(tmp_path: Path) -> None:
    path, clock, told = tmp_path / "a.film", Clock(), list[str]()
    work = units(range(8))
    with pytest.raises(KeyboardInterrupt), opened(path, told, clock) as checkpoint:
        for second in range(1, 5):
            clock.now = 100.0 + second
            film_of(checkpoint).commit(unit := next(work), sums(unit))
            checkpoint.tick()
        assert not path.exists()
        clock.now = 105.0
        checkpoint.tick()
        settle(checkpoint)
        assert same(Film.load(path), whole(4))
        clock.now = 109.9
        film_of(checkpoint).commit(unit := next(work), sums(unit))
        checkpoint.tick()
        settle(checkpoint)
        assert Film.load(path).ledger.holds(0, 4)
        raise KeyboardInterrupt
    loaded = Film.load(path)
    assert same(loaded, whole(5)) and loaded.request == REQUEST
    assert loaded.provenance["samples"] == 5 * 23 * 14 and loaded.provenance["scene"] == {"name": "none"}
    assert loaded.provenance["rays"] == 3 * loaded.provenance["samples"]
    assert checkpoint.stats()["checkpoint_writes"] == 2 and not told
    assert [each.name for each in tmp_path.iterdir()] == ["a.film"], "neither the lock nor a part is left"


def test_nothing_is_written_where_nothing_came_in(tmp_path: Path) -> None:
    path, clock, told = tmp_path / "a.film", Clock(), list[str]()
    with opened(path, told, clock) as checkpoint:
        film_of(checkpoint).commit(unit := next(units(range(1))), sums(unit))
    before = path.stat()
    with Checkpoint(path, True, told.append, clock) as checkpoint:
        checkpoint.begin(REQUEST, range(8), {})
        clock.now += 60
        checkpoint.tick()
        assert checkpoint._saving is None
    assert path.stat().st_mtime_ns == before.st_mtime_ns and not told


def test_a_save_is_of_one_moment_though_others_commit_meanwhile(tmp_path: Path) -> None:
    clock, told = Clock(), list[str]()
    with opened(tmp_path / "a.film", told, clock) as checkpoint:
        for count, unit in enumerate(units(range(8)), 1):
            film_of(checkpoint).commit(unit, sums(unit))
            clock.now += 60.0
            checkpoint.tick()  # begins to save
            if count % 3 == 0:
                settle(checkpoint)
                assert same(Film.load(tmp_path / "a.film"), whole(count))


FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
READ_ONLY = OSError(errno.EROFS, os.strerror(errno.EROFS))


def fail(error: BaseException) -> Callable[..., Any]:
    def failing(*_: Any, **__: Any) -> Any:
        raise error

    return failing


@pytest.mark.thorough
@pytest.mark.parametrize("error", [FULL, READ_ONLY], ids=["full", "read-only"])
@pytest.mark.parametrize(
    "where", ["clrender.files.access.os.open", "clrender.film.file._write_member", "os.fsync", "rename"]
)
def test_a_disk_that_fails_for_a_while(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str, error: OSError
) -> None:
    path, clock, told = tmp_path / "a.film", Clock(), list[str]()
    work = units(range(8))

    def go_on(count: int = 1) -> None:
        for _ in range(count):
            film_of(checkpoint).commit(unit := next(work), sums(unit))
        clock.now += 10.0
        checkpoint.tick()
        settle(checkpoint)

    with opened(path, told, clock) as checkpoint:
        go_on(2)
        with monkeypatch.context() as patch:
            patch.setattr("pathlib.Path.replace" if where == "rename" else where, fail(error))
            go_on()
            go_on()
            go_on()
        warning = "no room is left" if error is FULL else "cannot be written"
        assert len(told) == 1 and warning in told[0] and str(path) in told[0] and "the render goes on" in told[0]
        assert same(Film.load(path), whole(2)), "the last whole one stays"
        assert sorted(each.name for each in tmp_path.iterdir()) == ["a.film", "a.film.lock"], "no room is kept either"
        go_on()
        assert len(told) == 2 and told[1] == f"{path}: is being written again"
        assert same(Film.load(path), whole(6))
        go_on(2)
    assert same(Film.load(path), whole(8)) and len(told) == 2
    assert checkpoint.stats()["checkpoint_failures"] == 3


def test_a_disk_that_is_full_to_the_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, clock, told = tmp_path / "a.film", Clock(), list[str]()
    with opened(path, told, clock) as checkpoint:
        film_of(checkpoint).commit(unit := next(units(range(1))), sums(unit))
        monkeypatch.setattr("os.fsync", fail(FULL))
    assert len(told) == 1 and "no room is left" in told[0] and "there is no checkpoint" in told[0]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("ticks", [False, True])
def test_a_film_that_broke_is_not_saved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ticks: bool) -> None:
    """An interrupt, or an error, in the midst of a commit leaves the file as it was."""
    path, clock, told = tmp_path / "a.film", Clock(), list[str]()
    (first, second, third), expected = units(range(3)), whole(1)
    with opened(path, told, clock) as checkpoint:
        film_of(checkpoint).commit(first, sums(first))
        clock.now += 10.0
        checkpoint.tick()
        settle(checkpoint)
        film_of(checkpoint).commit(second, sums(second))
        result = sums(third)
        monkeypatch.setattr(Film, "_add", fail(KeyboardInterrupt()))
        with pytest.raises(KeyboardInterrupt):
            film_of(checkpoint).commit(third, result)
        if ticks:
            clock.now += 10.0
            checkpoint.tick()
            settle(checkpoint)
            assert checkpoint.stats()["checkpoint_writes"] == 1
    assert same(Film.load(path), expected) and not told


def test_samples_that_are_there_already_break_nothing(tmp_path: Path) -> None:
    """They are refused, and the film is whole all the same."""
    path, unit = tmp_path / "a.film", next(units(range(1)))
    with opened(path, [], Clock()) as checkpoint:
        film_of(checkpoint).commit(unit, sums(unit))
        with pytest.raises(UsageError, match="held already"):
            film_of(checkpoint).commit(unit, sums(unit))
    assert same(Film.load(path), whole(1))


def test_what_a_kill_left_is_replaced_and_not_followed(tmp_path: Path) -> None:
    (tmp_path / "other").write_text("precious")
    (tmp_path / ".a.film.part").symlink_to(tmp_path / "other")
    (tmp_path / "a.film.lock").write_text("1\n")
    with opened(tmp_path / "a.film", [], Clock()) as checkpoint:
        film_of(checkpoint).commit(unit := next(units(range(1))), sums(unit))
    assert sorted(each.name for each in tmp_path.iterdir()) == ["a.film", "other"]
    assert (tmp_path / "other").read_text() == "precious" and same(Film.load(tmp_path / "a.film"), whole(1))


def test_what_a_kill_left_goes_when_the_next_render_begins(tmp_path: Path) -> None:
    """Also where that render finds that nothing is left to do."""
    with opened(tmp_path / "a.film", [], Clock()) as checkpoint:
        film_of(checkpoint).commit(unit := next(units(range(1))), sums(unit))
    (tmp_path / ".a.film.part").write_text("half a film")
    with Checkpoint(tmp_path / "a.film", True, print):
        assert [each.name for each in tmp_path.iterdir() if each.suffix != ".lock"] == ["a.film"]


@pytest.mark.parametrize("name", ["a.png", "a.EXR", "a.npy"])
def test_the_name_of_an_image_is_refused(name: str) -> None:
    with pytest.raises(UsageError, match=rf"{name}: a checkpoint is a film; give it a name that ends in .film"):
        Checkpoint(name, False, print)


@pytest.mark.parametrize("name", ["a", "a.ckpt", "a.film"])
def test_any_other_name_is_taken(tmp_path: Path, name: str) -> None:
    with opened(tmp_path / name, [], Clock()) as checkpoint:
        film_of(checkpoint).commit(unit := next(units(range(1))), sums(unit))
    assert Film.load(tmp_path / name).ledger.samples


def test_a_checkpoint_that_is_gone_is_not_said_to_stay(tmp_path: Path) -> None:
    said: list[str] = []
    (tmp_path / "in").mkdir()
    with opened(tmp_path / "in" / "a.film", said, Clock()) as checkpoint:
        film_of(checkpoint).commit(unit := next(units(range(1))), sums(unit))
        shutil.rmtree(tmp_path / "in")
    assert len(said) == 1 and "create it first; there is no checkpoint; the image has all samples" in said[0], said


# --- resuming --------------------------------------------------------------------------------------------------------


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    """A checkpoint of four samples of eight."""
    with opened(tmp_path / "a.film", [], Clock()) as checkpoint:
        for unit in units(range(4)):
            film_of(checkpoint).commit(unit, sums(unit))
    return tmp_path / "a.film"


def test_what_was_there_counts(saved: Path) -> None:
    with Checkpoint(saved, True, fail(FULL)) as checkpoint:
        film = checkpoint.begin(REQUEST, range(6), {})
        assert checkpoint.resumed["samples"] == 4 * 23 * 14 and same(film, whole(4))
        for unit in units(range(4, 6)):
            film_of(checkpoint).commit(unit, sums(unit))
    loaded = Film.load(saved)
    assert same(loaded, whole(6)) and loaded.provenance["rays"] == 3 * 6 * 23 * 14


def test_a_file_that_is_there_is_not_overwritten(saved: Path) -> None:
    with pytest.raises(UsageError, match=r"a\.film: exists already.*add --resume"):
        Checkpoint(saved, False, fail(FULL)).__enter__()
    assert same(Film.load(saved), whole(4)) and not saved.with_name("a.film.lock").exists()


def test_a_file_that_is_not_there_yet(tmp_path: Path) -> None:
    told: list[str] = []
    with Checkpoint(tmp_path / "b.film", True, told.append) as checkpoint:
        assert checkpoint.begin(REQUEST, range(4), {}).samples == 0
    assert told == [f"{tmp_path / 'b.film'}: is not there yet, so the render starts from its beginning"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"seed": 3}, ["seed is 7 there and 3 here", "give --seed 7"]),
        ({"width": 24}, ["width is 23 there and 24 here", "--size 23x14"]),
        ({"scene_sha256": "x"}, ["the scene is another one"]),
        ({"kernel_sha256": "x", "sampler_sha256": "y"}, ["the kernels are others"]),
        ({"version": "2"}, ["version is 1 there and 2 here"]),
        ({"arrays_sha256": "z"}, ["arrays made of the scene"]),
    ],
)
def test_another_image_is_refused_by_what_differs(saved: Path, change: dict[str, Any], words: list[str]) -> None:
    with Checkpoint(saved, True, fail(FULL)) as checkpoint, pytest.raises(UsageError) as error:
        checkpoint.begin({**REQUEST, **change}, range(8), {})
    assert all(word in str(error.value) for word in [*words, "a.film", "or name another file"])
    assert same(Film.load(saved), whole(4))


def test_requests_of_one_image_do_not_differ() -> None:
    assert not differences(REQUEST, {**REQUEST, "width": np.int64(23).item()})
    assert differences({"a": (1, 2)}, {"a": [1, 2]}) == {}


@pytest.mark.parametrize("samples", [range(3), range(2, 8), range(4, 8)])
def test_samples_that_nobody_asked_for_are_refused(saved: Path, samples: range) -> None:
    with Checkpoint(saved, True, fail(FULL)) as checkpoint, pytest.raises(UsageError, match="holds samples, up to 4"):
        checkpoint.begin(REQUEST, samples, {})


def test_a_file_that_is_no_film(tmp_path: Path) -> None:
    (tmp_path / "a.film").write_bytes(b"PK nothing")
    with pytest.raises(UsageError, match="not a whole clrender film"):
        Checkpoint(tmp_path / "a.film", True, fail(FULL)).__enter__()
    assert [each.name for each in tmp_path.iterdir()] == ["a.film"]


# --- one at a time ---------------------------------------------------------------------------------------------------

CHILD = """
import sys, time
from pathlib import Path
from clrender.film.checkpoint import Checkpoint
with Checkpoint(Path(sys.argv[1]), True, lambda line: None):
    print("locked", flush=True)
    time.sleep(60)
"""


def test_a_second_process_is_refused_until_the_first_is_gone(tmp_path: Path) -> None:
    path = tmp_path / "a.film"
    environment = {**os.environ, "PYTHONPATH": str(Path(clrender.__path__[0]).parent)}
    command = [sys.executable, "-c", CHILD, str(path)]
    (tmp_path / "link.film").symlink_to(path)
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as child:
        assert child.stdout is not None and child.stdout.readline() == "locked\n"
        for name in ("a.film", "link.film"):
            with pytest.raises(UsageError, match=rf"another render saves itself there.*process {child.pid}"):
                Checkpoint(tmp_path / name, True, print).__enter__()
        child.send_signal(signal.SIGKILL)
    assert path.with_name("a.film.lock").exists(), "a kill leaves it behind"
    with Checkpoint(path, True, lambda line: None):
        pass
    assert not path.with_name("a.film.lock").exists()


def test_a_lock_file_that_is_removed_between_opening_and_locking(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As by one who ends: the lock on what has no name any more would keep nobody out."""
    path, flock, calls = tmp_path / "a.film.lock", fcntl.flock, list[int]()

    def late(descriptor: int, how: int) -> None:
        calls.append(descriptor)
        if len(calls) == 1:
            path.unlink()
        flock(descriptor, how)

    monkeypatch.setattr("clrender.film.lock.fcntl.flock", late)
    first, second = (FileLock(tmp_path / "a.film", "taken") for _ in range(2))
    first.take()
    assert len(calls) == 2 and path.exists()
    with pytest.raises(UsageError, match="taken"):
        second.take()
    first.release()
    assert not path.exists()


def test_folders_without_locks_are_told_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    monkeypatch.setattr("clrender.film.lock.fcntl.flock", fail(OSError(errno.ENOLCK, "no locks")))
    with opened(tmp_path / "a.film", told, Clock()) as checkpoint:
        film_of(checkpoint).commit(unit := next(units(range(1))), sums(unit))
    assert len(told) == 1 and "cannot be locked" in told[0] and same(Film.load(tmp_path / "a.film"), whole(1))


def test_many_threads_race_for_it(tmp_path: Path) -> None:
    """Never two at a time, whatever is created and removed in between."""
    path, inside, most, won = tmp_path / "a.film", [0], [0], [0]
    mutex = threading.Lock()

    def race() -> None:
        for _ in range(150):
            try:
                with Checkpoint(path, True, lambda line: None):
                    with mutex:
                        inside[0] += 1
                        most[0] = max(most[0], inside[0])
                        won[0] += 1
                    with mutex:
                        inside[0] -= 1
            except UsageError:
                pass

    threads = [threading.Thread(target=race) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most[0] == 1 and won[0] > 10


def test_places_that_take_no_checkpoint(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    for name in ("folder", "no/a.film", "x" * 254):
        with pytest.raises((UsageError, RenderError)) as error:
            Checkpoint(tmp_path / name, True, print).__enter__()
        assert name in str(error.value)
    assert [each.name for each in tmp_path.iterdir()] == ["folder"]
