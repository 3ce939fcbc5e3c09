"""Dask clusters for tests: a scheduler and workers as a user starts them, and what can happen to their machines."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil

import clrender

__all__ = ["Machines", "machines", "namespaces"]

DEVICE = os.environ.get("CLRENDER_TEST_DEVICE", "pocl")
_HOME = str(Path(clrender.__path__[0]).parent)
_SCHEDULER = "10.83.0.1"


class Machines:
    """A scheduler and workers, each worker in a network namespace of its own or all on the loopback interface.

    Parameters
    ----------
    folder : Path
        For their files and logs.
    spaces : bool
        Whether there are namespaces.
    tls : tuple of str
        Options of both programs that name certificates.
    """

    def __init__(self, folder: Path, spaces: bool = False, tls: tuple[str, ...] = ()) -> None:
        self._folder, self._spaces, self._tls = folder, spaces, tls
        self._environment = {
            **os.environ, "PYTHONPATH": _HOME, "POCL_MAX_PTHREAD_COUNT": "1", "CLRENDER_DEVICE": DEVICE,
        }  # fmt: skip
        self.workers: list[subprocess.Popen[bytes]] = []
        host = _SCHEDULER if spaces else "127.0.0.1"
        told = folder / "scheduler.json"
        protocol = ("--protocol", "tls") if tls else ()
        where = ("--host", host, "--port", "0", "--no-dashboard", "--scheduler-file", str(told), *protocol)
        self.scheduler = self._start("scheduler", "distributed.cli.dask_scheduler", *where, *tls)
        end = time.monotonic() + 60.0
        while not told.exists() or not told.read_text().endswith("}"):
            assert time.monotonic() < end and self.scheduler.poll() is None
            time.sleep(0.05)
        self.address: str = json.loads(told.read_text())["address"]

    def add(self, *options: str, wait: bool = True) -> int:
        """Start a worker; gives its number."""
        number = len(self.workers)
        where = ("--host", "127.0.0.1")
        prefix: tuple[str, ...] = ()
        if self._spaces:
            where, prefix = ("--host", f"10.83.{number + 1}.2"), ("ip", "netns", "exec", f"clrender{number}")
        own = ("--name", f"w{number}", "--nthreads", "1", "--no-dashboard", "--local-directory", str(self._folder))
        more = ("--death-timeout", "60", "--memory-limit", "0")
        module = "distributed.cli.dask_worker"
        self.workers.append(
            self._start(f"w{number}", module, self.address, *where, *own, *more, *self._tls, *options, prefix=prefix)
        )
        while wait and self.process(number) is None:
            assert self.workers[number].poll() is None
            time.sleep(0.05)
        return number

    def process(self, number: int) -> psutil.Process | None:
        """A worker's process, which its nanny started."""
        with suppress(psutil.Error):
            for child in psutil.Process(self.workers[number].pid).children():
                if "spawn_main" in " ".join(child.cmdline()):
                    return child
        return None

    def signal(self, number: int, name: signal.Signals) -> bool:
        """Send a worker's process a signal; gives whether there is one."""
        process = self.process(number)
        with suppress(psutil.Error):
            if process is not None:
                process.send_signal(name)
                return True
        return False

    def cut(self, number: int) -> None:
        """Cut a worker's machine off."""
        _ip("link", "set", f"clrender{number}", "down")

    def mend(self, number: int) -> None:
        """Connect it again, and let it run."""
        self.signal(number, signal.SIGCONT)
        if self._spaces:
            _ip("link", "set", f"clrender{number}", "up")

    def end(self, number: int) -> None:
        """A worker and its nanny are gone for good."""
        _kill(self.workers[number])

    def end_scheduler(self) -> None:
        """The scheduler is gone."""
        _kill(self.scheduler)

    def close(self) -> None:
        """End all."""
        for process in (*self.workers, self.scheduler):
            _kill(process)

    def _start(self, name: str, module: str, *arguments: str, prefix: tuple[str, ...] = ()) -> subprocess.Popen[bytes]:
        with (self._folder / f"{name}.log").open("wb") as log:
            return subprocess.Popen(
                [*prefix, sys.executable, "-m", module, *arguments],
                stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True, env=self._environment,
            )  # fmt: skip


@contextmanager
def machines(folder: Path, count: int = 2, spaces: bool = False, tls: tuple[str, ...] = ()) -> Iterator[Machines]:
    """A cluster of so many workers."""
    running = Machines(folder, spaces, tls)
    try:
        for _ in range(count):
            running.add()
        yield running
    finally:
        running.close()


@contextmanager
def namespaces(count: int) -> Iterator[bool]:
    """So many network namespaces, each connected with this one alone; gives whether they can be made here."""
    try:
        made = _make(count)
        yield made
    finally:
        for number in range(count):
            _ip("netns", "delete", f"clrender{number}")
        _ip("address", "delete", f"{_SCHEDULER}/32", "dev", "lo")


def _make(count: int) -> bool:
    if os.geteuid() != 0 or not _ip("address", "add", f"{_SCHEDULER}/32", "dev", "lo"):
        return False
    for number in range(count):
        name, ours, theirs = f"clrender{number}", f"10.83.{number + 1}.1", f"10.83.{number + 1}.2"
        inside = ("netns", "exec", name, "ip")
        commands = [
            ("netns", "add", name),
            ("link", "add", name, "type", "veth", "peer", "name", "eth0", "netns", name),
            ("address", "add", f"{ours}/24", "dev", name),
            ("link", "set", name, "up"),
            (*inside, "address", "add", f"{theirs}/24", "dev", "eth0"),
            (*inside, "link", "set", "lo", "up"),
            (*inside, "link", "set", "eth0", "up"),
            (*inside, "route", "add", "default", "via", ours),
        ]
        if not all(_ip(*command) for command in commands):
            return False
    return True


def _ip(*arguments: str) -> bool:
    try:
        return subprocess.run(["ip", *arguments], capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        return False


def _kill(process: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
