"""Path tracing: unbiased global illumination."""

from __future__ import annotations

from typing import Final

from clrender.integrators.descriptor import DELTA_CAUSTICS, Integrator, Pipeline

__all__ = ["INTEGRATOR"]

INTEGRATOR: Final = Integrator(
    Pipeline("integrator/path.cl", "integrator_path", packets=8, staged=True),
    leaves_out=(DELTA_CAUSTICS,),
    media=True,
    guiding="clrender.guiding.preparation",
    specular_chains=True,
)
