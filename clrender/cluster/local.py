"""`local:N`: a cluster of processes on this machine, reachable only from this machine."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

from clrender.errors import RenderError
from clrender.process.elapsed import Elapsed, processor_seconds_of

__all__ = ["leave", "local_cluster"]

LOOPBACK: Final = "127.0.0.1"
_THREADS: Final = ("POCL_MAX_PTHREAD_COUNT", "POCL_CPU_MAX_CU_COUNT")
"""Variables for PoCL's number of threads, in older and newer versions."""
_DASK: Final = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.tick.cycle": "10s",
    "distributed.admin.system-monitor.interval": "10s",
}
"""Settings that reduce Dask's monitoring, which is not used and takes three per cent of a core per process."""
_START: Final = "import sys\nsys.path[:] = filter(None, sys.path)\nfrom distributed.cli.dask_worker import main\nmain()"
"""A worker, which imports nothing from the working directory: a ``random.py`` there would take a module's place."""
_START_SECONDS: Final = 60.0
_END_SECONDS: Final = 0.1
_started: Final[list[tuple[Path, list[subprocess.Popen[bytes]]]]] = []
"""Folders and workers of the clusters of this process."""


@contextmanager
def local_cluster(count: int) -> Iterator[str]:
    """Start a scheduler in this process and `count` workers, each with its share of the processor's cores.

    Workers end by themselves when the scheduler is gone, however this process ends.

    Yields
    ------
    str
        The scheduler's address.

    Raises
    ------
    RenderError
        When the workers do not start.
    """
    import dask
    from distributed import LocalCluster

    local: Any = LocalCluster
    processes: list[subprocess.Popen[bytes]] = []
    with tempfile.TemporaryDirectory(prefix="clrender-cluster-", ignore_cleanup_errors=True) as folder:
        _started.append((Path(folder), processes))
        with dask.config.set(_DASK):
            # Dask processes serve dashboards, by default to the whole network
            pages = {"dashboard": False, "dashboard_address": f"{LOOPBACK}:0"}
            scheduler = local(n_workers=0, protocol="tcp", host=LOOPBACK, scheduler_kwargs=pages)
        try:
            address = str(scheduler.scheduler_address)
            for number in range(count):
                processes.append(_worker(address, number, count, Path(folder)))
            _await_workers(scheduler, processes, Path(folder))
            yield address
        finally:
            scheduler.close()
            _end(processes)
            _started.remove((Path(folder), processes))


def leave() -> None:
    """Clean up for an interrupted process that ends at once, without its exit handlers."""
    for folder, processes in list(_started):
        for process in list(processes):
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
        for process in list(processes):
            with suppress(subprocess.TimeoutExpired):
                process.wait(_END_SECONDS)
        shutil.rmtree(folder, ignore_errors=True)


def _worker(address: str, number: int, count: int, folder: Path) -> subprocess.Popen[bytes]:
    """Start a worker with its nanny, which restarts it when it dies. They do not receive Ctrl-C from the terminal."""
    home = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join(filter(None, [home, os.environ.get("PYTHONPATH", "")]))
    threads = str(max(1, (os.cpu_count() or 1) // count))
    environment = {
        **dict.fromkeys(_THREADS, threads),
        **_variables(),
        **os.environ,
        "PYTHONPATH": path,
        "PYTHONSAFEPATH": "1",
    }
    command = [sys.executable, "-c", _START, address, "--name", str(number), "--nthreads", "1"]
    command += ["--host", LOOPBACK, "--no-dashboard", "--dashboard-address", f"{LOOPBACK}:0"]
    command += ["--memory-limit", "0", "--local-directory", str(folder)]
    with (folder / f"{number}.log").open("wb") as log:
        return subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True, env=environment
        )


def _variables() -> dict[str, str]:
    """Environment variables with these settings, for Dask's processes."""
    names = {name: f"DASK_{name}".upper().replace(".", "__").replace("-", "_") for name in _DASK}
    return {names[name]: str(value) for name, value in _DASK.items()}


def _await_workers(scheduler: Any, processes: list[subprocess.Popen[bytes]], folder: Path) -> None:
    """Wait until all workers are connected."""
    elapsed = Elapsed(lambda: sum(processor_seconds_of(each.pid) for each in processes))
    before = time.monotonic()
    while len(scheduler.scheduler_info["workers"]) < len(processes):
        ended = next((number for number, each in enumerate(processes) if each.poll() is not None), None)
        if ended is not None:
            lines = (folder / f"{ended}.log").read_text(errors="replace").split("\n")
            last = next((line.strip() for line in reversed(lines) if line.strip()), "it says nothing")
            raise RenderError(f"worker {ended} of the local cluster ended when it was to start: {last}")
        now = time.monotonic()
        elapsed.add(now - before)
        before = now
        if elapsed.seconds > _START_SECONDS:
            raise RenderError(f"the workers of the local cluster did not start within {_START_SECONDS:g} s")
        time.sleep(0.05)


def _end(processes: list[subprocess.Popen[bytes]]) -> None:
    """Wait briefly for the processes, which end some seconds after the scheduler is gone, then kill the rest."""
    end = time.monotonic() + _END_SECONDS
    for process in processes:
        with suppress(subprocess.TimeoutExpired):
            process.wait(max(0.0, end - time.monotonic()))
        if process.poll() is None:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
