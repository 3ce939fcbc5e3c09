"""Whitted's ray tracing: mirrors and glass, and each light as a point light at its centre."""

from __future__ import annotations

from typing import Final

from clrender.integrators.descriptor import (
    BETWEEN_DIFFUSE,
    CAUSTICS,
    DELTA_CAUSTICS,
    ENVIRONMENT_ON_DIFFUSE,
    SOFT_SHADOWS,
    Integrator,
    Pipeline,
)

__all__ = ["INTEGRATOR"]

INTEGRATOR: Final = Integrator(
    Pipeline("integrator/whitted.cl", "integrator_whitted"),
    leaves_out=(BETWEEN_DIFFUSE, CAUSTICS, DELTA_CAUSTICS, SOFT_SHADOWS, ENVIRONMENT_ON_DIFFUSE),
)
