"""The end of a process in which a thread still calls a driver."""

from __future__ import annotations

import subprocess
import sys
import time
import weakref

import pytest

from clrender.process import driver_threads
from clrender.process.driver_threads import driver_thread, wait_for_driver_threads

BUSY = """
import atexit, time
from clrender.device.device import leave_busy_drivers
from clrender.process.driver_threads import driver_thread
atexit.register(print, "finalized")
"""


def run(script: str) -> tuple[int, str]:
    command = [sys.executable, "-c", BUSY + script]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.stderr == ""
    return done.returncode, done.stdout


def test_a_command_ends_without_finalization_beside_a_thread_in_a_driver() -> None:
    assert run("driver_thread(time.sleep, 3600).start(); print('told'); leave_busy_drivers(143)") == (143, "told\n")


def test_a_command_whose_threads_end_in_time_ends_as_any_other() -> None:
    script = "driver_thread(time.sleep, 0.02).start(); leave_busy_drivers(143); print('told')"
    assert run(script) == (0, "told\nfinalized\n")


def test_another_process_waits_for_the_thread_before_it_finalizes() -> None:
    script = "driver_thread(lambda: (time.sleep(0.5), print('returned'))).start()"
    assert run(script) == (0, "finalized\nreturned\n")


def test_the_wait_ends_with_the_last_thread_or_with_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    # Without those of other tests in this process: a view that was closed may still be probing devices
    monkeypatch.setattr(driver_threads, "_threads", weakref.WeakSet())
    first, second = driver_thread(time.sleep, 0.3), driver_thread(time.sleep, 0.6)
    begin = time.monotonic()
    first.start()
    second.start()
    assert not wait_for_driver_threads(0.05)
    assert wait_for_driver_threads(60.0)
    assert 0.6 <= time.monotonic() - begin < 50.0
