"""Threads that stay for a moment after their work, and take the next."""

from __future__ import annotations

import contextvars
import os
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Iterator

import pytest

from clrender.process import pooled_threads, shield
from clrender.process.pooled_threads import PooledThread

PLACE = contextvars.ContextVar("PLACE", default="nowhere")


@pytest.fixture(autouse=True)
def an_empty_pool(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Threads that other tests have left take no part."""
    monkeypatch.setattr(pooled_threads, "_pool", pooled_threads._Pool())
    yield


def done_in() -> int:
    """Identifier of the thread that does some work, which is waited for."""
    found: list[int] = []
    thread = PooledThread(lambda: found.append(threading.get_ident()))
    assert not thread.is_alive()
    thread.start()
    thread.join(20.0)
    assert not thread.is_alive(), "nobody does it"
    return found[0]


def test_one_thread_does_what_comes_one_after_the_other() -> None:
    assert len({done_in() for _ in range(50)}) == 1


def test_work_never_waits_behind_other_work() -> None:
    go, began = threading.Event(), threading.Barrier(5)
    threads = [PooledThread(lambda: (began.wait(10.0), go.wait(10.0))) for _ in range(4)]
    for thread in threads:
        thread.start()
    began.wait(10.0)  # all four at once
    assert all(thread.is_alive() for thread in threads)
    threads[0].join(0.01)
    assert threads[0].is_alive(), "a wait that ended early"
    go.set()
    for thread in threads:
        thread.join()


def test_threads_without_work_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pooled_threads, "_LINGER", 0.01)
    before = set(threading.enumerate())
    done_in()
    for thread in set(threading.enumerate()) - before:
        thread.join(10.0)
        assert not thread.is_alive()
    assert done_in()  # in another one


def test_threads_that_have_died_get_no_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Such as one whose end nobody foresaw: its work would never begin, and who waits for it would wait for ever."""
    monkeypatch.setattr(pooled_threads, "_LINGER", 0.01)
    first = pooled_threads._pool
    done_in()
    (thread,) = first._idle
    # Another pool is none of its business
    monkeypatch.setattr(pooled_threads, "_pool", pooled_threads._Pool())
    thread.join(10.0)
    assert not thread.is_alive()
    assert not first._idle
    first._idle.append(thread)
    monkeypatch.setattr(pooled_threads, "_pool", first)
    assert done_in()


def test_work_that_comes_while_a_thread_is_about_to_end_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pooled_threads, "_LINGER", 0.0005)
    for number in range(300):
        done_in()
        time.sleep(0.0001 * (number % 10))


def test_a_thread_that_was_given_work_may_not_end() -> None:
    """However late it looks: as when it is given at the moment in which the thread has waited long enough."""
    pool = pooled_threads._pool
    thread = pooled_threads._Thread(pool)
    pool.take_back(thread)
    thread.tasks.put(PooledThread(lambda: None))
    assert not pool.may_end(thread)
    thread.tasks.get()
    assert pool.may_end(thread)
    assert not pool._idle


def test_a_thread_has_the_name_and_the_context_of_its_work() -> None:
    seen: list[tuple[str, str]] = []

    def look(place: str) -> None:
        seen.append((threading.current_thread().name, PLACE.get()))
        PLACE.set(place)

    PLACE.set("here")
    for name, context in (("first", None), ("second", contextvars.copy_context()), ("third", None)):
        thread = PooledThread(look, "elsewhere", name=name, context=context)
        thread.start()
        thread.join()
    assert seen == [("first", "nowhere"), ("second", "here"), ("third", "nowhere")]
    assert PLACE.get() == "here"


@pytest.mark.skipif(not hasattr(os, "setpriority"), reason="a system without niceness")
def test_work_has_the_priority_of_whoever_starts_it() -> None:
    """A thread of the live view, which lowers its priority, is none for a render that does not."""

    def niceness() -> int:
        return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    def lower() -> None:
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), niceness() + 1)
        thread = PooledThread(lambda: found.append(niceness()))
        thread.start()
        thread.join()

    here, found = niceness(), list[int]()
    for work in (lower, lambda: found.append(niceness()), lower):
        thread = PooledThread(work)
        thread.start()
        thread.join()
    assert found == [here + 1, here, here + 1]


def test_an_error_is_told_as_that_of_any_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[object] = []
    monkeypatch.setattr(threading, "excepthook", lambda details: told.append(details.exc_type))

    def fail() -> None:
        raise ZeroDivisionError

    thread = PooledThread(fail)
    thread.start()
    thread.join()
    assert told == [ZeroDivisionError]
    assert done_in()


def test_what_no_thread_could_take_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    def none_left(_thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", none_left)
    thread = PooledThread(lambda: None)
    with pytest.raises(RuntimeError, match="can't start"):
        thread.start()
    assert not thread.is_alive()
    thread.join()  # returns at once


def test_work_is_begun_once_and_not_kept() -> None:
    class Held:
        pass

    held = Held()
    thread = PooledThread(lambda each: None, held)
    thread.start()
    with pytest.raises(RuntimeError, match="once"):
        thread.start()
    thread.join()
    gone = weakref.ref(held)
    del held
    assert gone() is None


@pytest.mark.skipif(not hasattr(os, "fork"), reason="a system without fork")
def test_a_process_that_was_forked_has_threads_of_its_own() -> None:
    script = """
import os, sys
from clrender.process import pooled_threads, shield
from clrender.process.pooled_threads import PooledThread

def work():
    thread = PooledThread(lambda: None)
    thread.start()
    thread.join(20.0)
    return thread.is_alive()

assert not work()
pooled_threads._pool._lock.acquire()  # as another thread may have at that moment
child = os.fork()
if child == 0:
    os._exit(work())
sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
    assert subprocess.run([sys.executable, "-W", "ignore", "-c", script], timeout=60, check=False).returncode == 0


def test_an_interrupted_call_is_patient_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """All its waits for work that does not end take `PATIENCE` together, whatever interrupts them."""
    clock, waits = [100.0], []
    go = threading.Event()

    def join(thread: PooledThread, timeout: float | None = None) -> None:
        assert timeout is not None
        waits.append(timeout)
        clock[0] += min(timeout, 0.5) if len(waits) == 1 else timeout
        if len(waits) == 1:
            raise KeyboardInterrupt

    def stop() -> None:
        raise KeyboardInterrupt

    call = shield.Call()
    ask = call.callback(stop, None)
    with monkeypatch.context() as patched:
        patched.setattr(shield, "monotonic", lambda: clock[0])
        patched.setattr(PooledThread, "join", join)
        with pytest.raises(KeyboardInterrupt):
            call.run(lambda: (ask(), go.wait(60.0)))
    go.set()
    assert waits == pytest.approx([shield.PATIENCE, shield.PATIENCE - 0.5])


def test_a_process_waits_for_work_that_a_call_has_left() -> None:
    script = """
import time
from clrender.process import shield
shield.PATIENCE = 0.01
def work():
    call.callback(stop, None)()
    time.sleep(0.5)
    print("saved")
def stop():
    raise KeyboardInterrupt
call = shield.Call()
try:
    call.run(work)
except KeyboardInterrupt:
    print("left")
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "left\nsaved\n", "")
