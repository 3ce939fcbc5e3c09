"""Direct light alone: path tracing without indirect rays."""

from __future__ import annotations

from typing import Final

from clrender.device.pipeline import PATH
from clrender.integrators.descriptor import BETWEEN_DIFFUSE, CAUSTICS, Integrator

__all__ = ["INTEGRATOR"]

INTEGRATOR: Final = Integrator(PATH, leaves_out=(BETWEEN_DIFFUSE, CAUSTICS), fixed={"indirect_rays": 0})
