"""Make the tables of docs/scaling.md: simulated clusters of 10 to 100,000 workers, from the measured costs of a unit.

`python scripts/scaling_docs.py [costs.json]`: a file that `scripts/cluster_bench.py costs` printed replaces
docs/scaling.json. The simulation has no random numbers: the same costs make the same page.
"""

from __future__ import annotations

import heapq
import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from made_part import with_part

__all__ = ["Load", "current", "simulate"]

_DOCS: Final = Path(__file__).resolve().parents[1] / "docs"
_WORKERS: Final = (10, 100, 1000, 10_000, 100_000)
_UNIT_SECONDS: Final = 1.0
_NETWORK: Final = 1.25e8
"""Bandwidth of the central network, towards the client, bytes per second: 1 Gbit/s."""
_POLLS: Final = 5
"""Rate at which a thread of the client polls its call, per second."""
_SIMULATED: Final = 60.0
_PIXELS: Final = 800 * 800
_SHARD: Final = 20
"""Workers per shard in the last table."""


@dataclass(frozen=True)
class Load:
    """Load during a second of rendering.

    Attributes
    ----------
    units : float
        Completed units per second.
    busy : float
        Fraction of the workers' time spent rendering.
    uses : mapping of str to float
        Utilisation of each shared resource.
    """

    units: float
    busy: float
    uses: Mapping[str, float]


def simulate(workers: int, unit: float, stages: Mapping[str, float], apart: float, polled: float = 0.0) -> Load:
    """Simulate workers, which render and send one unit after the other; a shared resource serves one at a time.

    Parameters
    ----------
    workers : int
    unit : float
        Rendering time of a unit, seconds.
    stages : mapping of str to float
        Seconds that a unit occupies each shared resource, in order.
    apart : float
        Seconds of a unit that delay no other worker.
    polled : float
        Fraction of the CPU's time spent polling, which slows down all its other work.
    """
    slower = 1.0 / max(1.0 - polled, 1e-3)
    lasts = {name: seconds * (1.0 if name == "network" else slower) for name, seconds in stages.items()}
    free, used = dict.fromkeys(lasts, 0.0), dict.fromkeys(lasts, 0.0)
    # Workers start staggered over the first unit, as in the steady state
    events = [((number + 1) * unit / workers, number) for number in range(workers)]
    heapq.heapify(events)
    done, rendered = 0, 0.0
    while events and events[0][0] < _SIMULATED:
        now, number = heapq.heappop(events)
        for name, seconds in lasts.items():
            begin = max(now, free[name])
            now = free[name] = begin + seconds
            used[name] += max(0.0, min(now, _SIMULATED) - begin)
        if now < _SIMULATED:
            done += 1
            rendered += unit
        heapq.heappush(events, (now + apart + unit, number))
    uses = {name: seconds / _SIMULATED for name, seconds in used.items()}
    return Load(done / _SIMULATED, rendered / (_SIMULATED * workers), uses)


def _stages(costs: Mapping[str, Any], unit: float) -> tuple[dict[str, float], float]:
    """Seconds of a unit of `unit` seconds in each shared resource, and its overhead in the worker."""
    slots = costs["samples_per_second"] * unit / costs["unit_samples"]
    size = slots * costs["unit_bytes"] / costs["unit_slots"]
    shared = {
        "network": size / _NETWORK,
        "client": size * costs["receive_byte_seconds"] + slots * costs["commit_slot_seconds"],
    }
    return shared, costs["unit_seconds"] + size * costs["byte_seconds"]


def _row(costs: Mapping[str, Any], workers: int, unit: float, asset: float) -> str:
    shared, apart = _stages(costs, unit)
    polled = min(1.0, workers * _POLLS * costs["poll_seconds"])
    load = simulate(workers, unit, shared, apart, polled)
    samples = load.units * costs["samples_per_second"] * unit
    uses = {"network": load.uses["network"], "client": min(1.0, load.uses["client"] * (1.0 - polled) + polled)}
    sent = asset * workers / _NETWORK
    return (
        f"| {workers:,} | {load.busy:.1%} | {_number(samples)} | {uses['network']:.0%} | {uses['client']:.0%} "
        f"| {_duration(sent)} |"
    )


def _alone(costs: Mapping[str, Any]) -> str:
    header = (
        "| workers | time spent rendering | samples/s | network utilisation | client CPU utilisation "
        "| 100 MB to all workers |\n|---|---|---|---|---|---|"
    )
    rows = [_row(costs, workers, _UNIT_SECONDS, 1e8) for workers in _WORKERS]
    return "\n".join([header, *rows])


def _sharded(costs: Mapping[str, Any]) -> str:
    header = (
        "| workers | shards | time spent rendering | samples/s | merging all films "
        "| samples per pixel rendered in the merge time |\n|---|---|---|---|---|---|"
    )
    lines = [header]
    shared, apart = _stages(costs, _UNIT_SECONDS)
    load = simulate(_SHARD, _UNIT_SECONDS, shared, apart, _SHARD * _POLLS * costs["poll_seconds"])
    for workers in _WORKERS[1:]:
        shards = workers // _SHARD
        samples = shards * load.units * costs["samples_per_second"] * _UNIT_SECONDS
        merge = shards * _PIXELS * (costs["merge_pixel_seconds"] + 52 / _NETWORK)
        lines.append(
            f"| {workers:,} | {shards:,} | {load.busy:.1%} | {_number(samples)} | {_duration(merge)} "
            f"| {_number(samples * merge / _PIXELS)} |"
        )
    return "\n".join(lines)


def _costs(costs: Mapping[str, Any]) -> str:
    slots = costs["unit_slots"]
    seconds = slots * costs["unit_samples"] / costs["samples_per_second"]
    rows = (
        ("a worker of one thread", f"{_number(costs['samples_per_second'])} samples/s"),
        ("round trip of a call", _duration(costs["round_trip_seconds"])),
        (
            f"a unit of {slots:,} pixels x {costs['unit_samples']} samples",
            f"{_duration(seconds)} of rendering, {costs['unit_bytes'] / 1e6:.2f} MB of sums",
        ),
        ("overhead of a small unit", _duration(costs["unit_seconds"])),
        ("transfer of sums, within one machine", f"{1e-9 / costs['byte_seconds']:.2f} GB/s"),
        ("reading sums from the message", f"{1e-9 / costs['receive_byte_seconds']:.2f} GB/s"),
        (
            "adding a unit to the film",
            f"{_duration(slots * costs['commit_slot_seconds'])}, "
            f"{_number(costs['unit_samples'] / costs['commit_slot_seconds'])} samples/s",
        ),
        ("merging two films of 800 x 800 pixels", _duration(_PIXELS * costs["merge_pixel_seconds"])),
        ("setting up a worker, with kernels already compiled", _duration(costs["prepare_seconds"])),
        ("transfer of scene files to one worker on this machine", f"{1e-9 / costs['asset_byte_seconds']:.2f} GB/s"),
        ("polling a pending call once", _duration(costs["poll_seconds"])),
    )
    return "\n".join(["| what | cost |\n|---|---|", *(f"| {what} | {cost} |" for what, cost in rows)])


def _number(value: float) -> str:
    for factor, word in ((1e12, " T"), (1e9, " G"), (1e6, " M"), (1e3, " k")):
        if value >= factor:
            return f"{value / factor:.3g}{word}"
    return f"{value:.3g}"


def _duration(seconds: float) -> str:
    for factor, word, limit in ((1e-6, "µs", 1e-3), (1e-3, "ms", 1.0), (1.0, "s", 120.0), (60.0, "min", 7200.0)):
        if seconds < limit:
            return f"{seconds / factor:.3g} {word}"
    return f"{seconds / 3600.0:.3g} h"


def current(page: str, costs: Mapping[str, Any]) -> str:
    """The page with updated tables."""
    for name, table in (("costs", _costs), ("alone", _alone), ("sharded", _sharded)):
        page = with_part(page, f"scaling_docs.py: {name}", f"{table(costs)}\n")
    return page


def main() -> int:
    """Store new costs, if given, and rewrite the page."""
    data = _DOCS / "scaling.json"
    if len(sys.argv) > 1:
        data.write_text(Path(sys.argv[1]).read_text())
    page = _DOCS / "scaling.md"
    page.write_text(current(page.read_text(), json.loads(data.read_text())))
    return 0


if __name__ == "__main__":
    sys.exit(main())
