"""Progressive photon mapping: a photon map for each sample of the pixels."""

from __future__ import annotations

from typing import Final

from clrender.integrators.descriptor import Integrator, Pipeline

__all__ = ["INTEGRATOR"]

INTEGRATOR: Final = Integrator(
    Pipeline("integrator/photon.cl", "integrator_photon", sample_by_sample=True),
    bias="consistent",
    # Photons start at lights, and a light BVH only samples lights for a given shading point.
    takes={"indirect_rays": (1,), "light_sampler": ("auto", "power", "uniform")},
    fixed={"indirect_rays": 0},
    media=True,
    glowing_media=False,
    auto_light_sampler="power",
    preparation="clrender.photon.maps",
    times="image",
)
