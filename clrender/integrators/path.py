"""Path tracing: unbiased global illumination."""

from __future__ import annotations

from typing import Final

from clrender.integrators.descriptor import Integrator, Pipeline

__all__ = ["INTEGRATOR"]

INTEGRATOR: Final = Integrator(
    Pipeline("integrator/path.cl", "integrator_path", packets=8, staged=True),
    media=True,
    guiding="clrender.guiding.preparation",
    specular_chains=True,
)
