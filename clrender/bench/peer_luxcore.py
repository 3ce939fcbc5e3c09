"""Renders a benchmark scene with LuxCore's CPU path tracer; run by a Python that has pyluxcore. See peer_scene.py.

The scene is one that `clrender.exporters.write_luxcore` has written, with the settings of the comparison.
"""

from __future__ import annotations

import os
import time
from typing import Any

import numpy as np
import pyluxcore
from peer_scene import Job, answer, job

__all__: list[str] = []


def session_of(one: Job) -> Any:
    os.chdir(one.scene.parent)
    described = pyluxcore.Properties(one.scene.name)
    more = {
        "renderengine.type": one.variant,
        "native.threads.count": len(os.sched_getaffinity(0)),
        "renderengine.seed": one.seed + 1,
    }
    if one.variant.startswith("BIDIR"):
        more |= {"path.maxdepth": one.segments, "light.maxdepth": one.segments}
    for name, value in more.items():
        described.Set(pyluxcore.Property(name, [value]))
    scene = pyluxcore.Scene()
    scene.Parse(described)
    return pyluxcore.RenderSession(pyluxcore.RenderConfig(described, scene))


def main() -> None:
    begin = time.perf_counter()
    one = job()
    pyluxcore.Init(lambda _: None)
    session = session_of(one)
    session.Start()
    setup = time.perf_counter() - begin
    wall, cpu = time.perf_counter(), time.process_time()
    while not session.HasDone():
        time.sleep(0.02)
        session.UpdateStats()
        if session.GetStats().Get("stats.renderengine.pass").GetInt() >= one.spp:
            break
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    session.UpdateStats()
    taken = session.GetStats().Get("stats.renderengine.total.samplecount").GetFloat() / (one.width * one.height)
    session.Stop()
    film = np.zeros(one.width * one.height * 3, np.float32)
    session.GetFilm().GetOutputFloat(pyluxcore.FilmOutputType.RGB, film, 0)
    image = film.reshape(one.height, one.width, 3)[::-1]
    answer(one, image, wall, cpu, pyluxcore.Version(), setup, spp_taken=round(taken, 3))
    # LuxCore fails when Python ends
    os._exit(0)


if __name__ == "__main__":
    main()
