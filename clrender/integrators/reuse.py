"""Path reuse: pixels share the indirect light at their first diffuse surface."""

from __future__ import annotations

from typing import Final

from clrender.integrators.descriptor import DELTA_CAUSTICS, Integrator, Pipeline

__all__ = ["INTEGRATOR"]

INTEGRATOR: Final = Integrator(
    Pipeline("integrator/reuse.cl", "integrator_reuse", ("reuse_weigh", "reuse_gather"), record_bytes=128),
    leaves_out=(DELTA_CAUSTICS,),
    takes={"indirect_rays": (1,)},
    volumes=False,
    shares="block",
    times="image",
)
