"""Bidirectional path tracing: paths from the camera and from the lights, joined in all ways."""

from __future__ import annotations

from typing import Final

from clrender.integrators.descriptor import Integrator, Pipeline

__all__ = ["INTEGRATOR"]

INTEGRATOR: Final = Integrator(
    Pipeline("integrator/bdpt.cl", "integrator_bdpt", packets=8, sample_by_sample=True, splats=True),
    # Paths start at lights, and a light BVH only samples lights for a given shading point.
    takes={
        "shadow_rays": (1,),
        "indirect_rays": (1,),
        "sampling": ("mis",),
        "light_sampler": ("auto", "power", "uniform"),
    },
    # The environment is sampled in full, as paths from there need it.
    fixed={"bsdf_samples": 0},
    media=True,
    auto_light_sampler="power",
    shares="image",
    preparation="clrender.bidirectional.light_paths",
    specular_chains=True,
    times="image",
)
