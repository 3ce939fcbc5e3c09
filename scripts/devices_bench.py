#!/usr/bin/env python3
"""How near several devices come to the sum of their speeds: `python scripts/devices_bench.py`, on a quiet machine.

For each set of devices: each alone; all at once, each with an image of its own, which shows what they take from each
other; and all on one image. Prints a line of JSON for each round. Sets are made of what is here: parts of the CPU's
cores, other drivers, and parts that are slowed down by sleeping.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

from faulty_device import FaultyDevice

import clrender
from clrender.bench.scenes import SCENES, write_scene
from clrender.device import Device
from clrender.device.device import Argument, Program
from clrender.drivers import select
from clrender.rendering.rendered_image import RenderedImage

_SPEED_SPP: Final = 16
"""Samples per pixel for measuring speeds; fewer of a slowed device."""


class SlowDevice(FaultyDevice):
    """A device whose launches take `times` as long.

    Parameters
    ----------
    device : Device
    times : float
    """

    def __init__(self, device: Device, times: float) -> None:
        super().__init__(device, name=f"{device.info.name}, {times:g} times as slow")
        self.times = times

    def launch(
        self, program: Program, kernel: str, global_size: int, local_size: int, args: Sequence[Argument]
    ) -> None:
        """Launch, wait, and sleep in proportion; nothing runs meanwhile."""
        first = (kernel, local_size) not in program.launched
        begin = time.perf_counter()
        super().launch(program, kernel, global_size, local_size, args)
        super().finish()
        if not first:  # a launch that waits for the compiler is not representative
            time.sleep((self.times - 1.0) * (time.perf_counter() - begin))


def parts(device: Device, count: int) -> list[Device]:
    """`count` devices, each with some of the cores of one; empty if its driver cannot partition it."""
    import pyopencl as cl

    cores = device.info.compute_units // count
    if cores < 1:
        return []
    try:
        equally: list[Any] = [cl.device_partition_property.EQUALLY, cores]
        handles = device._handle.create_sub_devices(equally)[:count]
    except cl.Error:
        return []
    return [Device(device.info, handle) for handle in handles]


def device_sets() -> dict[str, Callable[[], list[Device]]]:
    """Sets of devices that are available here, by name."""
    every = sorted(select("all"), key=lambda each: "pocl" not in each.info.version.lower())
    first = every[0]
    sets: dict[str, Callable[[], list[Device]]] = {
        f"{count} parts of {first.info.name}": lambda count=count: parts(first, count)  # type: ignore[misc]
        for count in (2, 3, 4)
    }
    for times in (4.0, 100.0):

        def slowed(times: float = times) -> list[Device]:
            halves = parts(first, 2)
            return [halves[0], SlowDevice(halves[1], times)] if halves else []

        sets[f"a half and one {times:g} times as slow"] = slowed
    if len(every) > 1:
        sets["every driver"] = lambda: every
    return sets


def rates(devices: Sequence[Device], scene: Any, size: tuple[int, int]) -> list[float]:
    """Samples per second of each, running concurrently, each with its own whole image, as its parts differ in cost."""

    def one(device: Device) -> float:
        with clrender.Session(device) as session:
            session.render(scene, spp=1, size=(64, 64), code="fast")
            times = device.times if isinstance(device, SlowDevice) else 1.0
            image = session.render(scene, spp=max(1, round(_SPEED_SPP / times)), size=size, code="fast")
        return float(image.stats["samples"] / image.stats["render_seconds"])

    with ThreadPoolExecutor(len(devices)) as pool:
        return list(pool.map(one, devices))


def together(devices: Sequence[Device], scene: Any, spp: int, size: tuple[int, int]) -> RenderedImage:
    """Render one image on all devices."""
    with clrender.Session(list(devices)) as session:
        session.render(scene, spp=1, size=(256, 256), code="fast")  # compile programs, build BVHs
        return session.render(scene, spp=spp, size=size, code="fast")


def main() -> None:
    """Measure according to the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help="of `clrender bench` (S1 S3-1M)")
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--side", type=int, default=800, help="of the image, pixels (800)")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--set", help="measure only sets whose names hold this")
    options = parser.parse_args()
    names = options.scenes or ["S1", "S3-1M"]
    if unknown := sorted({*names} - {*SCENES}):
        parser.error(f"no scene is called {', '.join(unknown)}; there are {', '.join(SCENES)}")
    size, hashes = (options.side, options.side), set()
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            scene = clrender.load(write_scene(name, Path(folder)))
            for title, make in device_sets().items():
                devices = make() if (options.set or "") in title else []
                for _ in range(options.rounds if devices else 0):
                    alone = [rates([each], scene, size)[0] for each in devices]
                    beside = rates(devices, scene, size)
                    image = together(devices, scene, options.spp, size)
                    rate = image.stats["samples"] / image.stats["render_seconds"]
                    hashes.add((name, image.stats["image_sha256"]))
                    line = {"scene": name, "devices": title, "seconds": round(image.stats["render_seconds"], 2)}
                    line |= {"mpaths_alone": [round(each / 1e6, 3) for each in alone]}
                    line |= {"mpaths_beside": [round(each / 1e6, 3) for each in beside]}
                    line |= {"mpaths_together": round(rate / 1e6, 3)}
                    line |= {"of_sum_alone": round(rate / sum(alone), 3), "of_sum": round(rate / sum(beside), 3)}
                    print(json.dumps(line), flush=True)
    if len(hashes) != len(names):
        raise SystemExit(f"the images differ: {hashes}")


if __name__ == "__main__":
    main()
