"""Path tracing: all light, without bias."""

from __future__ import annotations

from typing import Final

from clrender.device.pipeline import PATH
from clrender.integrators.descriptor import Integrator

__all__ = ["INTEGRATOR"]

INTEGRATOR: Final = Integrator(PATH)
