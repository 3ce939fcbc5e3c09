"""Radiosity: light transport between diffuse patches, solved once and displayed by all devices."""

from __future__ import annotations

from typing import Final

from clrender.integrators.descriptor import CAUSTICS, Integrator, Pipeline

__all__ = ["INTEGRATOR"]

INTEGRATOR: Final = Integrator(
    Pipeline("radiosity/display.cl", "integrator_radiosity"),
    leaves_out=(CAUSTICS,),
    bias="discretised",
    takes={"spectral": (False,)},
    materials=("lambert",),
    environment_pictures=False,
    opacity=False,
    textures=("reflectance",),
    emission_textures=False,
    vertex_colors=False,
    curves=False,
    preparation="clrender.radiosity.preparation",
    times="",
)
