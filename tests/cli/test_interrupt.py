"""Ctrl-C, SIGTERM and SIGHUP with the real renderer: it ends soon, with the image so far, and says what that holds."""

from __future__ import annotations

import os
import re
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import clrender
from clrender.film import Film
from clrender.image.files import read_image, read_provenance

PROMISE = 1.0
"""Seconds to end in. What else the machine does must not count, so a process may work as long on each processor."""


@contextmanager
def endless_render(folder: Path, *outputs: str) -> Iterator[subprocess.Popen[str]]:
    """`clrender render room` with more samples than anyone waits for."""
    arguments = [sys.executable, "-m", "clrender", "render", "room", "--size", "160x120", "--spp", "1048576"]
    arguments += ["-d", os.environ.get("CLRENDER_TEST_DEVICE", "pocl"), *(f"-o{name}" for name in outputs)]
    environment = {**os.environ, "PYTHONPATH": str(Path(clrender.__path__[0]).parent)}
    with subprocess.Popen(
        arguments, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as child:
        try:
            yield child
        finally:
            child.kill()


def _number(text: str) -> int:
    return int(text.replace(",", ""))


def processor_seconds(child: subprocess.Popen[str]) -> float:
    """Of a process that runs, and of its own children that have ended."""
    fields = Path(f"/proc/{child.pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


def end(child: subprocess.Popen[str], number: signal.Signals) -> tuple[str, str]:
    """Send a signal; make sure that the process ends as soon as promised. Its output."""
    earlier = resource.getrusage(resource.RUSAGE_CHILDREN)
    before = processor_seconds(child)
    child.send_signal(number)
    out, err = child.communicate(timeout=120)
    now = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = now.ru_utime + now.ru_stime - earlier.ru_utime - earlier.ru_stime
    assert used - before < PROMISE * (os.cpu_count() or 1)
    return out, err


def wait_for_handlers(child: subprocess.Popen[str]) -> None:
    """Until the program, and not only Python, answers signals: on a busy machine its start takes a while."""
    caught = 1 << (signal.SIGTERM - 1)
    while child.poll() is None:
        status = Path(f"/proc/{child.pid}/status").read_text()
        if int(status.partition("SigCgt:")[2].split()[0], 16) & caught:
            return
        time.sleep(0.01)


def wait_for_samples(child: subprocess.Popen[str]) -> None:
    """Read progress until there is some."""
    assert child.stderr is not None
    lines = []
    for line in child.stderr:
        lines.append(line)
        if "samples/s" in line:
            return
    pytest.fail(f"no progress before the end: {''.join(lines)}")


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_in_mid_render_keeps_the_image_so_far(tmp_path: Path, number: signal.Signals) -> None:
    with endless_render(tmp_path, "a.exr", "a.png", "a.film") as child:
        wait_for_samples(child)
        out, err = end(child, number)
    assert child.returncode == 128 + number
    assert "Traceback" not in err
    held = re.search(r"stopped early with ([\d,]+) of ([\d,]+) samples", out)
    assert held is not None and 0 < _number(held[1]) < _number(held[2]) == 160 * 120 * 1048576
    film = Film.load(tmp_path / "a.film")
    assert film.samples == _number(held[1])
    image = read_image(tmp_path / "a.exr")
    np.testing.assert_array_equal(image, film.mean())
    assert image.shape == (120, 160, 3) and image.mean() > 0
    told = read_provenance(tmp_path / "a.png") or {}
    assert told["samples"] - told["nonfinite_samples"] == _number(held[1])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.exr", "a.film", "a.png"]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("delay", "number"),
    [
        (0.3, signal.SIGINT),
        (1.0, signal.SIGTERM),
        pytest.param(0.6, signal.SIGINT, marks=pytest.mark.slow),
        pytest.param(1.0, signal.SIGINT, marks=pytest.mark.slow),
    ],
)
def test_a_signal_while_it_starts_ends_it_without_a_trace(tmp_path: Path, delay: float, number: signal.Signals) -> None:
    with endless_render(tmp_path, "a.exr") as child:
        wait_for_handlers(child)
        time.sleep(delay)
        out, err = end(child, number)
    assert child.returncode == 128 + number, err
    assert "Traceback" not in err
    # A quick machine is rendering by then: then there is an image, else nothing at all.
    assert [path.name for path in tmp_path.iterdir()] == (["a.exr"] if "stopped early" in out else [])


SIGNAL = "import os, signal; os.kill(os.getpid(), signal.{name})"
"""A signal to itself; Python handles it before the next line."""
PLACES = {
    "module": SIGNAL,
    "text": "exec('{signal}')",
    "class": """
class Name:
    def __set_name__(self, owner, name):
        {signal}
class Owner:
    name = Name()
""",
    "finalizer": """
class Object:
    def __del__(self):
        {signal}
Object()
""",
    "callback": """
import weakref
def call(reference):
    {signal}
class Object: pass
kept = Object()
reference = weakref.ref(kept, call)
del kept
""",
}
CAUGHT = """
try:
    {signal}
except BaseException:
    pass
"""
"""Where a signal arrives. Python has ends of its own for some exceptions there, and drops others."""


def signalled(text: str, name: str) -> str:
    return text.replace("{signal}", SIGNAL).replace("{name}", name)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(
    ("module", "name"), [("click", "SIGINT"), ("numpy", "SIGINT"), ("numpy", "SIGTERM"), ("numpy", "SIGHUP")]
)
def test_a_signal_while_modules_load(tmp_path: Path, module: str, name: str, place: str) -> None:
    text = signalled(PLACES[place], name)
    (tmp_path / f"{module}.py").write_text(f"{text}\nimport time; time.sleep(60)\n")
    paths = {"PYTHONPATH": f"{tmp_path}{os.pathsep}{Path(clrender.__path__[0]).parent}"}
    command = [sys.executable, "-m", "clrender", "render", "room", "-oa.png"]
    with subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, **paths}
    ) as child:
        out, err = child.communicate(timeout=50)
    assert child.returncode == 128 + signal.Signals[name], err
    assert out == "" and "Traceback" not in err


@pytest.mark.parametrize(
    ("text", "seconds", "expected"),
    [
        (CAUGHT, 0.2, "error: interrupted."),
        ("import sys; sys.stderr = None\n" + PLACES["finalizer"], 60.0, ""),  # no message can be written
        ("try:\n    {signal}\nfinally:\n    time.sleep(0.2); print('cleaned', file=sys.stderr)", 60.0, "cleaned"),
    ],
    ids=["caught", "without stderr", "clean-up"],
)
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_ends_a_command(name: str, text: str, seconds: float, expected: str) -> None:
    """Also if a library catches it; but code that cleans up is waited for."""
    code = f"""
import sys, time
from clrender.cli import interrupt
interrupt._CLEAN_UP = {seconds}
try:
    with interrupt.raising_signals():
        exec({signalled(text, name)!r})
        time.sleep(60)
except KeyboardInterrupt as error:
    sys.exit(interrupt.exit_code_of(error))
"""
    paths = {"PYTHONPATH": str(Path(clrender.__path__[0]).parent)}
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=50,
        env={**os.environ, **paths},
        check=False,
    )
    assert done.returncode == 128 + signal.Signals[name], done.stderr
    assert done.stderr.strip() == expected


@pytest.mark.long
def test_a_second_signal_ends_it_at_once(tmp_path: Path) -> None:
    with endless_render(tmp_path, "a.exr") as child:
        wait_for_samples(child)
        child.send_signal(signal.SIGINT)
        child.send_signal(signal.SIGTERM)
        _, err = child.communicate(timeout=120)
    # Which of two signals at once is the first, the system decides.
    assert child.returncode in (130, 143) and "interrupted twice" in err and "Traceback" not in err
    assert not [path for path in tmp_path.iterdir() if path.name.endswith(".part")]


@pytest.mark.long
def test_a_closed_terminal_hangs_up_twice_and_the_image_is_kept(tmp_path: Path) -> None:
    """Both the shell and the system send SIGHUP then."""
    with endless_render(tmp_path, "a.exr") as child:
        wait_for_samples(child)
        child.send_signal(signal.SIGHUP)
        time.sleep(0.01)
        child.send_signal(signal.SIGHUP)
        out, err = child.communicate(timeout=120)
    assert child.returncode == 129 and "stopped early" in out and "interrupted twice" not in err
    assert [path.name for path in tmp_path.iterdir()] == ["a.exr"]


def test_no_file_is_begun_once_the_end_has_come(tmp_path: Path) -> None:
    """The main thread goes on while another one cleans up and leaves."""
    code = """
import os, threading
from clrender.files.access import atomic_write, remove_temporaries
def write():
    with atomic_write("a.exr") as file:
        file.write(b"picture")
remove_temporaries()
writer = threading.Thread(target=write, daemon=True)
writer.start()
writer.join(0.5)
print(os.listdir("."), flush=True)
os._exit(0)
"""
    paths = {"PYTHONPATH": str(Path(clrender.__path__[0]).parent)}
    command = [sys.executable, "-c", code]
    with subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, text=True, env={**os.environ, **paths}
    ) as child:
        assert child.communicate(timeout=60)[0] == "[]\n"
