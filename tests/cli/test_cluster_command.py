"""`clrender render --cluster`: what it prints, how it ends, and that Dask says nothing."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from cli_support import call, run

import clrender
from clrender.film import Film

DEVICE = os.environ.get("CLRENDER_TEST_DEVICE", "pocl")
HOME = str(Path(clrender.__path__[0]).parent)
ROOM = ("render", "room", "-d", DEVICE, "--size", "96x64")


# The command line, whose checkpoint is saved soon
CHILD = """
import clrender.film.cadence as cadence
from clrender.__main__ import main
cadence.EVERY_SECONDS = 0.5
main()
"""


def start(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", CHILD, *ROOM, *arguments],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": HOME},
        start_new_session=True,
    )  # fmt: skip


def processes_left(since: float) -> list[str]:
    """Worker processes that were started since then."""
    psutil = pytest.importorskip("psutil")
    found = []
    for process in psutil.process_iter(["cmdline", "create_time"]):
        line = " ".join(process.info["cmdline"] or [])
        if process.info["create_time"] >= since and "dask_worker" in line and "clrender-cluster-" in line:
            found.append(line)
    return found


@pytest.mark.long
def test_an_interrupted_start_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    folder, begun = tmp_path / "temporary", time.time()
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    with start(tmp_path, "--spp", "64", "--cluster", "local:1", "-o", "a.exr") as child:
        while not list(folder.glob("clrender-cluster-*/*.log")):
            assert child.poll() is None and time.time() < begun + 100.0
            time.sleep(0.02)
        child.send_signal(signal.SIGINT)
        _, said = child.communicate(timeout=100)
    assert child.returncode == 130 and "interrupted before the first sample; nothing was written" in said
    assert not list(folder.glob("clrender-cluster-*"))
    end = time.time() + 5.0
    while processes_left(begun) and time.time() < end:
        time.sleep(0.1)
    assert not processes_left(begun)


@pytest.mark.long
def test_a_local_cluster_says_nothing_of_its_own(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    begun = time.time()
    done = run(
        *ROOM, "--spp", "64", "--cluster", "local:2", "-o", "a.exr", "--stats", "a.json", "--quiet", folder=tmp_path
    )
    assert done.returncode == 0 and done.stderr == ""
    assert done.stdout.count("\n") == 1 and done.stdout.startswith("a.exr: 96x64, 64 samples per pixel")
    here = call(*ROOM, "--spp", "64", "-o", "b.exr", "--stats", "b.json", folder=tmp_path)
    assert here.returncode == 0
    far, near = (json.loads((tmp_path / name).read_text()) for name in ("a.json", "b.json"))
    assert far["image_sha256"] == near["image_sha256"]
    assert all(each.stdout.endswith(f", image sha256 {near['image_sha256']}\n") for each in (done, here))
    assert {each["host"].split(" on ")[0] for each in far["devices"]} <= {"worker 0", "worker 1"}
    assert far["cluster"]["address"] == "local:2" and "cluster" not in near
    assert not processes_left(begun)


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_with_the_image_so_far(tmp_path: Path, number: signal.Signals) -> None:
    pytest.importorskip("distributed")
    begun = time.time()
    with start(
        tmp_path, "--spp", "100000", "--cluster", "local:2", "-o", "a.film", "--checkpoint", "c.film"
    ) as process:
        end = time.monotonic() + 120.0
        while not (tmp_path / "c.film").exists():
            assert process.poll() is None and time.monotonic() < end
            time.sleep(0.05)
        process.send_signal(number)
        out, err = process.communicate(timeout=60)
    assert process.returncode == 128 + number
    assert "stopped early with" in out and "Traceback" not in err and "distributed" not in err
    film, saved = Film.load(tmp_path / "a.film"), Film.load(tmp_path / "c.film")
    assert film.samples == saved.samples > 0
    assert not processes_left(begun)


@pytest.mark.long
def test_workers_import_nothing_from_the_working_directory(tmp_path: Path) -> None:
    (tmp_path / "random.py").write_text('raise SystemExit("of a user")\n')
    script = tmp_path / "bin" / "script.py"
    script.parent.mkdir()
    script.write_text("from clrender.__main__ import main\nmain()\n")
    process = subprocess.run(
        [sys.executable, str(script), *ROOM, "--spp", "1", "--cluster", "local:1", "-o", "a.png"],
        cwd=tmp_path, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": HOME}, check=False,
    )  # fmt: skip
    assert process.returncode == 0, process.stderr


def test_without_dask_it_says_what_to_install(tmp_path: Path) -> None:
    code = "import sys; sys.modules['distributed'] = None; from clrender.cli import main; main(sys.argv[1:])"
    command = [sys.executable, "-c", code, *ROOM, "--cluster", "local:2", "-o", "a.exr"]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": HOME}
    )
    assert done.returncode == 2
    said, _, cure = done.stderr.partition("; install it with `")
    assert said == "error: a cluster needs Dask, which is not installed"
    assert shlex.split(cure.rstrip("`\n"))[:4] == [sys.executable, "-m", "pip", "install"] and "distributed" in cure


@pytest.mark.long
@pytest.mark.parametrize(
    ("address", "code", "words"),
    [("host:8786", 2, "--cluster is 'host:8786'; it must be"), ("local:0", 2, "--cluster is 'local:0'; local:N takes"),
     ("tcp://127.0.0.1:9", 1, "tcp://127.0.0.1:9: no Dask scheduler answers there"),
     ("tls://127.0.0.1:9", 1, "tls://127.0.0.1:9: no Dask scheduler answers there")],
)  # fmt: skip
def test_a_cluster_that_cannot_be_reached(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, address: str, code: int, words: str
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setenv("CLRENDER_CLUSTER_SECONDS", "1")
    done = run(*ROOM, "--cluster", address, "--quiet", "-o", "a.exr", folder=tmp_path)
    assert done.returncode == code
    assert done.stderr.startswith(f"error: {words}") and done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())
