"""Renders a benchmark scene with Mitsuba 3; run by a Python that has Mitsuba, not clrender. See peer_scene.py.

The scene is one that `clrender.exporters.write_mitsuba` has written, with the settings of the comparison.
"""

from __future__ import annotations

import re
import time
from typing import Any, Final

import drjit
import mitsuba
from peer_scene import Job, answer, job, timed

__all__: list[str] = []

NO_ROULETTE: Final = 100_000
_AROUND: Final = re.compile(r'type="(?:constant|envmap|sunsky)"')


def load(one: Job) -> Any:
    # Version 3.9.1 omits merged meshes from the scene's bounding box, and shadow rays to a sky then end too early
    sky = _AROUND.search(one.scene.read_text(encoding="utf-8")) is not None
    return mitsuba.load_file(str(one.scene), optimize=not sky)


def integrator(one: Job, scene: Any) -> Any:
    """That of the scene, or the one that the variant asks for."""
    kind = one.variant.partition(":")[2]
    if not kind:
        return scene.integrator()
    return mitsuba.load_dict({"type": kind, "max_depth": one.segments, "rr_depth": NO_ROULETTE})


def main() -> None:
    begin = time.perf_counter()
    one = job()
    mitsuba.set_variant(one.variant.partition(":")[0])
    scene = load(one)
    if not one.variant.startswith("scalar"):
        drjit.eval()
        drjit.sync_thread()
    by = integrator(one, scene)
    mitsuba.render(scene, integrator=by, spp=1, seed=one.seed + 1).numpy()  # compile, and build the BVH
    setup = time.perf_counter() - begin
    image, wall, cpu = timed(lambda: mitsuba.render(scene, integrator=by, spp=one.spp, seed=one.seed).numpy())
    answer(one, image, wall, cpu, mitsuba.__version__, setup)


if __name__ == "__main__":
    main()
