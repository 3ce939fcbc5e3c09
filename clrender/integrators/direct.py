"""Direct lighting only: path tracing without indirect rays."""

from __future__ import annotations

from typing import Final

from clrender.integrators.descriptor import BETWEEN_DIFFUSE, CAUSTICS, DELTA_CAUSTICS, Integrator, Pipeline

__all__ = ["INTEGRATOR"]

INTEGRATOR: Final = Integrator(
    Pipeline("integrator/path.cl", "integrator_path", packets=8, staged=True),
    leaves_out=(BETWEEN_DIFFUSE, CAUSTICS, DELTA_CAUSTICS),
    takes={"indirect_rays": (1, 0)},
    fixed={"indirect_rays": 0},
    media=True,
)
