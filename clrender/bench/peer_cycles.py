"""Renders a benchmark scene with Cycles; run by a Python that has bpy. See peer_scene.py.

The scene is one that `clrender.exporters.write_cycles` has written, with the settings of the comparison.
"""

from __future__ import annotations

import os
import re
import runpy
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np
from peer_scene import Job, answer, job, timed

__all__: list[str] = []


def set_up(one: Job) -> None:
    runpy.run_path(str(one.scene), run_name="scene")
    scene = bpy.context.scene
    render, cycles = scene.render, scene.cycles
    render.threads_mode, render.threads = "FIXED", len(os.sched_getaffinity(0))
    render.use_compositing = render.use_sequencer = False
    render.dither_intensity, render.use_stamp_render_time = 0, True
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    render.image_settings.color_mode, render.image_settings.exr_codec = "RGB", "NONE"
    scene.view_settings.view_transform = "Raw"
    cycles.device, cycles.samples, cycles.seed = "CPU", one.spp, one.seed
    cycles.use_auto_tile = False
    cycles.use_light_tree = one.variant == "tree"
    cycles.use_guiding = one.variant == "guided"


def seconds_in(path: Path) -> float | None:
    """Render time without set-up as Cycles reports it, in the header of the image file."""
    header = path.read_bytes()[:65536]
    found = re.search(rb"cycles\.[^\0]*?\.render_time\0string\0(.{4})([0-9:.]+)", header, re.S)
    if found is None:
        return None
    parts = found[2][: int.from_bytes(found[1], "little")].decode().split(":")
    return sum(float(part) * 60.0**power for power, part in enumerate(reversed(parts)))


def main() -> None:
    begin = time.perf_counter()
    one = job()
    set_up(one)
    setup = time.perf_counter() - begin
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "image.exr"
        bpy.context.scene.render.filepath = str(path)
        _, wall, cpu = timed(lambda: bpy.ops.render.render(write_still=True))
        inside = seconds_in(path)
        loaded = bpy.data.images.load(str(path))
        loaded.colorspace_settings.name = "Non-Color"
        pixels = np.empty(one.width * one.height * 4, np.float32)
        loaded.pixels.foreach_get(pixels)
    image = pixels.reshape(one.height, one.width, 4)[::-1, :, :3]
    share = 1.0 if inside is None else min(inside / wall, 1.0)
    answer(one, image, wall * share, cpu * share, bpy.app.version_string, setup + wall * (1.0 - share))


if __name__ == "__main__":
    main()
