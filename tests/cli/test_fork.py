"""A process forked from one that uses OpenCL says what to do instead; it would hang."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from clrender.device import Device

CHILD = """
import sys, warnings
import clrender
warnings.simplefilter("ignore")
scene, how = clrender.load("room"), {"spp": 1, "size": (8, 8)}
def attempts(session):
    yield lambda: clrender.render(scene, **how)
    yield lambda: session.render(scene, **how)
    yield session.close
    yield lambda: session_device.upload(array)
    yield lambda: clrender.Session().devices
def child(session):
    for number, attempt in enumerate(attempts(session)):
        try:
            attempt()
        except clrender.ClrenderError as error:
            assert 'multiprocessing.get_context("spawn")' in str(error), error
        else:
            print("attempt", number, "was not refused", flush=True)
    print("child done", flush=True)
import numpy
array = numpy.zeros(4)
if __name__ == "__main__":
    import multiprocessing, os
    session = clrender.Session()
    session.render(scene, **how)
    session_device = session.devices[0]
    if sys.argv[1] == "multiprocessing":
        process = multiprocessing.get_context("fork").Process(target=child, args=(session,))
        process.start()
        process.join()
    else:
        pid = os.fork()
        if not pid:
            child(session)
            sys.exit()
        os.waitpid(pid, 0)
    session.render(scene, **how)
    session.close()
    print("parent done", flush=True)
"""


@pytest.mark.long
@pytest.mark.parametrize("way", ["multiprocessing", "os.fork"])
def test_a_fork_after_a_render_is_refused_with_the_cure(device: Device, way: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", CHILD, way],
        capture_output=True, text=True, check=False, timeout=120,
        env={**os.environ, "CLRENDER_DEVICE": os.environ.get("CLRENDER_TEST_DEVICE", "pocl")},
    )  # fmt: skip
    assert done.stdout.splitlines() == ["child done", "parent done"], done.stderr


@pytest.mark.long
def test_a_fork_before_the_first_render_may_render(device: Device) -> None:
    code = (
        "import os, clrender\nscene = clrender.load('room')\nif not os.fork():\n"
        "    print(clrender.render(scene, spp=1, size=(8, 8)).linear.shape, flush=True)\n    os._exit(0)\nos.wait()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=120)
    assert done.stdout == "(8, 8, 3)\n", done.stderr
