#!/usr/bin/env python3
"""How many paths a second the host takes in when devices cost nothing: `python scripts/merge_bench.py`.

Workers are faked: each returns sums that are ready at once, so what is measured is the host alone, from handing out
units to their place in the film, spot checks and progress included. Prints a line of JSON for each run.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np

from clrender.film import Film
from clrender.film.held import FilmCopy, HeldUnit
from clrender.film.unit import BLOCK_SLOTS, Unit, UnitSums
from clrender.scheduling.policy import Plan
from clrender.scheduling.run import run
from clrender.scheduling.worker import Candidate

SIZES: Final = {"1080p": (1920, 1080), "8K": (7680, 4320)}
_MOST_SLOTS: Final = 1 << 23


class ReadyWorker:
    """A worker that returns the same sums for every slot, without computing anything.

    Parameters
    ----------
    copies : bool
        Whether sums are copied to new memory, like those read from a device.
    """

    def __init__(self, copies: bool) -> None:
        self._copies = copies
        self._sums = np.full((_MOST_SLOTS, 3, 4), 0x9E3779B9, np.uint32)
        self._sums[..., 2:] = 0  # the upper half of the 128 bits is zero for typical radiances
        self._counts = np.zeros(_MOST_SLOTS, np.uint32)

    def render(
        self,
        unit: Unit,
        on_slice: Callable[[int, int], None] | None = None,
        should_stop: Callable[[], bool] | None = None,
    ) -> UnitSums:
        """Return all of a unit at once."""
        sums, counts = self._sums[: unit.slot_count], self._counts[: unit.slot_count]
        if self._copies:
            sums, counts = sums.copy(), counts.copy()
        done = np.full(unit.slot_count // BLOCK_SLOTS, unit.sample_count, np.uint32)
        if on_slice is not None:
            on_slice(unit.slot_count * unit.sample_count, unit.slot_count)
        return UnitSums(sums, counts, done, unit.slot_count, 0, 1)


class HoldingWorker:
    """A worker that holds the sums of its units, at a given speed.

    Parameters
    ----------
    width, height, spp : int
    rate : float
        Paths a second.
    fresh : bool
        Whether the image is delivered in memory that was never used before, as a driver's copy would be.
    """

    def __init__(self, width: int, height: int, spp: int, rate: float, fresh: bool) -> None:
        self._rate, self._fresh = rate, fresh
        self._counts = np.full((height, width), spp, np.uint32)
        self._image = np.ones((height, width, 3), np.float32)
        self.busy, self.base = 0.0, object()

    def hold(self, film: Film) -> bool:
        """Begin with nothing."""
        return True

    def render(self, *_: object) -> UnitSums:
        """Not called, as it holds its sums."""
        raise AssertionError("its sums are held")

    def render_held(self, unit: Unit, *_: object) -> HeldUnit:
        """Take as long as the paths of a unit do."""
        begin = time.perf_counter()
        end = begin + unit.slot_count * unit.sample_count / self._rate
        while (left := end - time.perf_counter()) > 0.0:
            time.sleep(max(left - 1e-4, 0.0))
        self.busy += time.perf_counter() - begin
        return HeldUnit(np.full(unit.slot_count // BLOCK_SLOTS, unit.sample_count, np.uint32), 0, 0, 1)

    def copy_held(self, *, sums: bool, image: bool, last: bool) -> FilmCopy:
        """Deliver the image."""
        assert image and last and not sums, "there is time for one copy only"
        counts, means = (self._counts.copy(), self._image.copy()) if self._fresh else (self._counts, self._image)
        return FilmCopy(counts, None, [], means, self.base)


def held(size: str, spp: int, rate: float, fresh: bool) -> dict[str, object]:
    """Measure one run of a worker that holds its sums, from the start of the run to the image."""
    width, height = SIZES[size]
    plan, film = Plan(width, height, 0, spp, 64), Film(width, height)
    worker = HoldingWorker(width, height, spp, rate, fresh)
    worker.base = film.version
    begin, cpu = time.perf_counter(), time.process_time()
    tally = run(plan, [Candidate("holding", lambda: worker)], film, holds=True, sums=False)
    image = film.develop()
    seconds, cpu = time.perf_counter() - begin, time.process_time() - cpu
    assert tally.complete and film.ledger.holds(0, spp) and image.all()
    return {
        "size": size,
        "spp": spp,
        "rate": rate,
        "fresh": fresh,
        "device_seconds": round(worker.busy, 4),
        "seconds": round(seconds, 4),
        "gpaths_per_second": round(tally.samples / seconds / 1e9, 3),
    }


def measured(size: str, workers: int, spp: int, copies: bool) -> dict[str, object]:
    """Measure one run."""
    width, height = SIZES[size]
    plan, film = Plan(width, height, 0, spp, 64), Film(width, height)
    ready = [ReadyWorker(copies) for _ in range(workers)]
    candidates = [Candidate(f"ready {number}", partial(lambda each: each, each)) for number, each in enumerate(ready)]
    begin, cpu = time.perf_counter(), time.process_time()
    tally = run(plan, candidates, film, lambda samples, rays: None)
    seconds, cpu = time.perf_counter() - begin, time.process_time() - cpu
    assert tally.complete and film.ledger.holds(0, spp) and not tally.differences
    return {
        "size": size,
        "workers": workers,
        "spp": spp,
        "copies": copies,
        "units": sum(each.units for each in tally.workers),
        "checks": tally.checks,
        "seconds": round(seconds, 3),
        "cpu_seconds": round(cpu, 3),
        "gpaths_per_second": round(tally.samples / seconds / 1e9, 3),
        "gpaths_per_cpu_second": round(tally.samples / cpu / 1e9, 3),
    }


def main() -> None:
    """Measure according to the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", action="append", choices=SIZES, help="repeatable; default: all")
    parser.add_argument("--workers", action="append", type=int, help="repeatable; default: 1, 2, 4")
    parser.add_argument("--spp", action="append", type=int, help="samples per pixel, repeatable; default: 64, 1024")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--held", type=float, metavar="RATE", help="one worker that holds its sums, paths a second")
    options = parser.parse_args()
    if options.held:
        for size in options.size or SIZES:
            for spp in options.spp or (1, 16):
                for fresh in (False, True):
                    for _ in range(options.repeats):
                        print(json.dumps(held(size, spp, options.held, fresh)), flush=True)
        return
    for size in options.size or SIZES:
        for spp in options.spp or (64, 1024):
            for workers in options.workers or (1, 2, 4):
                for copies in (False, True):
                    for _ in range(options.repeats):
                        print(json.dumps(measured(size, workers, spp, copies)), flush=True)


if __name__ == "__main__":
    main()
