"""Measure what a cluster costs: `cluster_bench.py ratio`, or `cluster_bench.py costs > costs.json` for docs/scaling.md.

`ratio`: two workers of one thread each against one process of two threads, S1 at 800 x 800 pixels, 256 samples, one
after the other in turns; the median of the ratios of their times, and of their processors' times, which other work on
the machine disturbs less. Wants a machine with two free cores.

`costs`: what a unit costs beside its samples, and a worker beside its units; the least of many tries, since other work
can only add. `python scripts/scaling_docs.py costs.json` then rewrites the page.
"""

from __future__ import annotations

import argparse
import json
import os
import pickle
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import psutil

import clrender
from clrender.bench.scenes import write_scene
from clrender.cluster import DaskCluster, open_cluster
from clrender.cluster.connection import Connection
from clrender.film import Film
from clrender.film.unit import Unit, UnitSums, slot_count
from clrender.rendering.job import RenderJob

SIZE: Final = (800, 800)
_TILE: Final = 64
_DEEP: Final = 64


def main() -> int:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("ratio", "costs"))
    parser.add_argument("--device", default="pocl")
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--runs", type=int, default=5)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        scene = clrender.load(write_scene("S1", Path(folder)))
        if asked.what == "ratio":
            return ratio(scene, asked.device, asked.spp, asked.runs)
        print(json.dumps(costs(scene, asked.device), indent=2))
    return 0


def ratio(scene: clrender.Scene, device: str, spp: int, runs: int) -> int:
    """Print a line for each pair of renders, and the medians."""
    walls, processors = [], []
    with clrender.Session(device) as session, open_cluster("local:2", device=device) as cluster:
        of_workers = list(cluster.client.run(os.getpid).values())
        for warm in (None, cluster):
            session.render(scene, spp=16, size=SIZE, cluster=warm)
        for _ in range(runs):
            marks = [_processor_seconds(of_workers)]
            pair = []
            for on in (None, cluster):
                pair.append(session.render(scene, spp=spp, size=SIZE, cluster=on).stats)
                marks.append(_processor_seconds(of_workers))
            assert pair[0]["image_sha256"] == pair[1]["image_sha256"]
            walls.append(pair[0]["render_seconds"] / pair[1]["render_seconds"])
            processors.append((marks[1] - marks[0]) / (marks[2] - marks[1]))
            print(
                f"one process {pair[0]['render_seconds']:.2f} s, processor {marks[1] - marks[0]:.2f} s; two workers "
                f"{pair[1]['render_seconds']:.2f} s, processor {marks[2] - marks[1]:.2f} s; ratios {walls[-1]:.3f} "
                f"{processors[-1]:.3f}; {pair[1]['cluster']['received_bytes'] / 1e6:.0f} MB received",
                flush=True,
            )
    print(f"median of the times' ratios {statistics.median(walls):.3f}, of the processors' {_median(processors)}")
    return 0


def costs(scene: clrender.Scene, device: str) -> dict[str, Any]:
    """The numbers of the cost model."""
    job = RenderJob.of(scene, size=SIZE, spp=_DEEP)
    tiles = 20
    unit = Unit(0, tiles * _TILE * _TILE, 0, _DEEP, _TILE)
    with clrender.Session(device) as session, open_cluster("local:1", device=device) as cluster:
        connection = Connection(cluster.client, cluster.spec, lambda: cluster.peers, lambda: None)
        connection.connect(next(iter(cluster.peers.values())))
        text, _ = job.to_json()
        begun = time.perf_counter()
        team, sha256 = session.team(job)
        with team:
            connection.call("prepare", text, [], sha256)
        prepared = time.perf_counter() - begun
        rate = _rate(connection, unit)
        shallow = [Unit(unit.first_slot, unit.slot_count, sample, 1, _TILE) for sample in range(20)]
        large = min(_beside(connection, each) for each in shallow)
        small = min(_beside(connection, Unit(0, _TILE * _TILE, sample, 1, _TILE)) for sample in range(50))
        result: UnitSums = connection.call("render", unit)
        return {
            "samples_per_second": rate,
            "round_trip_seconds": _least(lambda: connection.call("state"), 200),
            "unit_slots": unit.slot_count,
            "unit_samples": _DEEP,
            "unit_bytes": sum(each.nbytes for each in (result.sums, result.counts, result.done)),
            "unit_seconds": small,
            "byte_seconds": (large - small) / (52.25 * (unit.slot_count - _TILE * _TILE)),
            "receive_byte_seconds": _least(lambda: pickle.loads(pickle.dumps(result, 5)), 20)
            / (52.25 * unit.slot_count),
            "commit_slot_seconds": _commit(unit, result),
            "prepare_seconds": prepared,
            "asset_byte_seconds": _asset(connection),
            "merge_pixel_seconds": _merge(),
            "job_bytes": len(text),
            "poll_seconds": _poll(cluster),
        }


def _processor_seconds(others: list[int]) -> float:
    return sum(sum(psutil.Process(each).cpu_times()[:2]) for each in (os.getpid(), *others))


def _median(values: list[float]) -> str:
    return f"{statistics.median(values):.3f}"


def _least(do: Callable[[], object], times: int) -> float:
    found = []
    for _ in range(times):
        begun = time.perf_counter()
        do()
        found.append(time.perf_counter() - begun)
    return min(found)


def _rate(connection: Connection, unit: Unit) -> float:
    """Samples per second of a worker, at best."""
    connection.call("render", unit)
    before = connection.state.busy_seconds
    connection.call("render", unit)
    return unit.slot_count * unit.sample_count / (connection.state.busy_seconds - before)


def _beside(connection: Connection, unit: Unit) -> float:
    """Overhead of a unit besides its launches, seconds."""
    before, begun = connection.state.busy_seconds, time.perf_counter()
    connection.call("render", unit)
    return time.perf_counter() - begun - (connection.state.busy_seconds - before)


def _commit(unit: Unit, result: UnitSums) -> float:
    """Seconds per slot in the film, on an otherwise idle core."""
    film = Film(*SIZE)
    for first in range(0, 20 * _DEEP, _DEEP):
        film.commit(Unit(unit.first_slot, unit.slot_count, first, _DEEP, _TILE), result)
    film, found = Film(*SIZE), []
    for first in range(0, 20 * _DEEP, _DEEP):
        begun = time.thread_time()
        film.commit(Unit(unit.first_slot, unit.slot_count, first, _DEEP, _TILE), result)
        found.append(time.thread_time() - begun)
    return min(found) / unit.slot_count


def _asset(connection: Connection) -> float:
    """Seconds per byte of an asset, to a worker on this machine."""
    data = os.urandom(1 << 26)
    return _least(lambda: connection.call("take", {"test": data}), 5) / len(data)


def _merge() -> float:
    """Seconds per pixel of merging one film into another."""
    found = []
    for _ in range(5):
        films = [Film(*SIZE) for _ in range(2)]
        for number, film in enumerate(films):
            slots = slot_count(*SIZE, _TILE)
            film.commit(unit := Unit(0, slots, number, 1, _TILE), UnitSums.nothing(unit))
        begun = time.thread_time()
        films[0].merge(films[1])
        found.append(time.thread_time() - begun)
    return min(found) / (SIZE[0] * SIZE[1])


def _poll(cluster: DaskCluster) -> float:
    """CPU seconds of polling an outstanding call once."""
    import concurrent.futures

    waiting: concurrent.futures.Future[None] = concurrent.futures.Future()
    begun = time.thread_time()
    for _ in range(1000):
        concurrent.futures.wait([waiting], 1e-4)
    return (time.thread_time() - begun) / 1000


if __name__ == "__main__":
    sys.exit(main())
