"""A render that is killed again and again gives, resumed each time, the image that it would have given at once."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from cli_support import call

import clrender
from clrender.film import Film

DEVICE = os.environ.get("CLRENDER_TEST_DEVICE", "pocl")

# The command line, saved as often as is said, and telling a file how many samples it has done and when.
CHILD = """
import json, os, sys, time
import clrender.film.cadence as cadence
from clrender.cli.progress import ProgressDisplay
every, log = float(sys.argv[1]), os.open(sys.argv[2], os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
cadence.EVERY_SECONDS = every
ProgressDisplay.__call__ = lambda self, p: os.write(log, json.dumps([time.time(), p.samples_done]).encode() + b"\\n")
from clrender.cli import main
main(sys.argv[3:])
"""


@contextmanager
def child(folder: Path, every: float, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """`clrender render room ARGUMENTS --checkpoint a.film --resume`, saved every so many seconds."""
    command = [sys.executable, "-c", CHILD, str(every), "log", "render", "room", "-d", DEVICE, *arguments]
    environment = {**os.environ, "PYTHONPATH": str(Path(clrender.__path__[0]).parent)}
    with subprocess.Popen(
        [*command, "--checkpoint", "a.film", "--resume"],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment,
    ) as process:  # fmt: skip
        try:
            yield process
        finally:
            process.kill()


def progress(folder: Path) -> list[tuple[float, int]]:
    """When the last process had done how many samples."""
    lines = (folder / "log").read_text().splitlines() if (folder / "log").exists() else []
    return [tuple(json.loads(line)) for line in lines if line.endswith("]")]


def seconds_lost(folder: Path, killed: float) -> float:
    """Work of the last process that is not in the checkpoint: since the first sample that is missing there."""
    path = folder / "a.film"
    held = Film.load(path).ledger.samples if path.exists() else 0
    beyond = [moment for moment, done in progress(folder) if done > held]
    return killed - min(beyond, default=killed)


def survive(folder: Path, kills: int, spp: int, size: str, longest: float) -> float:
    """Kill a render many times at random moments, then let it end; compare hashes with one that nobody disturbs.

    Gives the most seconds of work that were lost.
    """
    how = ("--size", size, "--spp", str(spp))
    assert call("render", "room", "-d", DEVICE, "-o", "once.film", *how, folder=folder).returncode == 0
    moments, held, worst = random.Random(20), 0, 0.0
    for _ in range(kills):
        (folder / "log").unlink(missing_ok=True)
        with child(folder, 0.05, "-o", "a.exr", *how) as process:
            started, wait = time.monotonic(), moments.uniform(0.0, longest)
            # From when it renders, or, of some, from when it starts
            while wait > 0.1 and not progress(folder) and process.poll() is None:
                time.sleep(0.005)
                assert time.monotonic() < started + 120.0
            time.sleep(wait)
            process.send_signal(signal.SIGKILL)
            killed = time.time()
            process.communicate()
        assert process.returncode == -signal.SIGKILL, "it ended too early; ask for more samples"
        worst = max(worst, seconds_lost(folder, killed))
        now = Film.load(folder / "a.film").ledger.samples if (folder / "a.film").exists() else 0
        assert now >= held
        held = now
    assert held > 0
    assert not (folder / "a.exr").exists()
    with child(folder, 0.05, "-o", "a.exr", "-o", "end.film", "--stats", "s.json", *how) as process:
        out, err = process.communicate(timeout=600)
    assert process.returncode == 0, err
    assert "from the checkpoint" in out
    stats, once = json.loads((folder / "s.json").read_text()), Film.load(folder / "once.film").provenance
    for name in ("image_sha256", "samples", "rays", "shadow_rays", "max_depth", "nonfinite_samples"):
        assert stats[name] == once[name], name
    assert stats["resumed_samples"] == held
    names = {"a.film", "a.exr", "end.film", "once.film", "s.json", "log"}
    assert {path.name for path in folder.iterdir()} == names, "no part, no lock"
    print(f"{kills} kills: at most {worst:.2f} s lost, {held / once['samples']:.0%} resumed")
    return worst


@pytest.mark.thorough
def test_a_few_kills(tmp_path: Path) -> None:
    survive(tmp_path, 2, 6_000, "33x26", 0.2)


@pytest.mark.slow
def test_two_hundred_kills(tmp_path: Path) -> None:
    assert survive(tmp_path, 200, 600_000, "33x26", 0.4) <= 10.0


@pytest.mark.slow
def test_ten_seconds_are_lost_at_most(tmp_path: Path) -> None:
    """By the rule as it is, in a large image: killed at moments about which saves lie."""
    worst = 0.0
    for wait in (4.0, 6.5, 9.5, 13.0, 14.8):
        (tmp_path / "a.film").unlink(missing_ok=True)
        (tmp_path / "log").unlink(missing_ok=True)
        with child(tmp_path, 5.0, "-o", "a.exr", "--size", "1024x768", "--spp", "100000") as process:
            while not progress(tmp_path):
                time.sleep(0.01)
            time.sleep(wait)
            process.send_signal(signal.SIGKILL)
            killed = time.time()
            process.communicate()
        worst = max(worst, seconds_lost(tmp_path, killed))
    print(f"at most {worst:.2f} s lost")
    assert worst <= 10.0


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_leaves_a_checkpoint_of_every_sample(tmp_path: Path, number: signal.Signals) -> None:
    with child(tmp_path, 1000.0, "-o", "a.film.exr", "-o", "b.film", "--size", "64x48", "--spp", "1000000") as process:
        while not progress(tmp_path):
            time.sleep(0.01)
        process.send_signal(number)
        out, err = process.communicate(timeout=60)
    assert process.returncode == 128 + number, err
    assert "stopped early" in out and "Traceback" not in err
    checkpoint, output = Film.load(tmp_path / "a.film"), Film.load(tmp_path / "b.film")
    assert checkpoint.ledger == output.ledger and checkpoint.samples > 0
    assert checkpoint.mean().tobytes() == output.mean().tobytes()


@pytest.mark.thorough
def test_a_second_process_on_the_same_checkpoint_is_refused(tmp_path: Path) -> None:
    with child(tmp_path, 0.1, "-o", "a.exr", "--size", "64x48", "--spp", "1000000") as process:
        while not (tmp_path / "a.film").exists():
            time.sleep(0.01)
        for resume in ((), ("--resume",)):
            done = call("render", "room", "-o", "b.exr", "--checkpoint", "a.film", *resume, folder=tmp_path)
            assert done.returncode == 2 and done.stderr.startswith("error: a.film: "), done.stderr
            words = f"another render saves itself there; wait for it, or name another file (process {process.pid})"
            assert (words if resume else "exists already and would be overwritten") in done.stderr
        assert process.poll() is None and not (tmp_path / "b.exr").exists()


@pytest.mark.thorough
def test_what_does_not_go_together_is_refused(tmp_path: Path) -> None:
    how = ("-d", DEVICE, "--size", "16x12", "--spp", "4", "--quiet")
    assert call("render", "room", "-o", "a.exr", "--checkpoint", "a.film", *how, folder=tmp_path).returncode == 0
    before = sorted(tmp_path.iterdir())
    for arguments, words in (
        (("room", "-o", "b.exr", "--resume"), "name it with --checkpoint FILE"),
        (("room", "-o", "b.film", "--checkpoint", "b.film"), "is named twice as an output"),
        (("room", "-o", "b.exr", "--checkpoint", "a.exr", "--resume"), "give it a name that ends in .film"),
        (("room", "-o", "b.exr", "--checkpoint", "a.film", "--resume", "--seed", "1"), "give --seed 0"),
        (("room", "-o", "b.film", "--checkpoint", "a.film", "--resume", "--shard", "2/2"), "not among those from 2"),
    ):
        done = call("render", *arguments, *how, folder=tmp_path)
        assert done.returncode == 2 and done.stderr.count("\n") == 1 and words in done.stderr, done.stderr
    assert sorted(tmp_path.iterdir()) == before
