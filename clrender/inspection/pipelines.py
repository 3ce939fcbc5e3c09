"""Kernels that record paths, by the kernels of the integrators that they stand for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from clrender import layout
from clrender.errors import UsageError
from clrender.integrators.descriptor import Pipeline

__all__ = ["INTEGRATORS", "PIPELINES", "check_integrator"]

INTEGRATORS: Final = ("path", "direct", "whitted", "bdpt")
"""Integrators whose paths can be recorded."""


def _pipeline(name: str, kernel: str, *, splats: bool = False) -> Pipeline:
    sample_bytes, entry = 4 * layout.INSPECT_ROWS * layout.INSPECT_WORDS, f"integrator/{name}.cl"
    return Pipeline(
        entry, kernel, record_bytes=sample_bytes, sample_by_sample=splats, splats=splats, reads_records=True
    )


PIPELINES: Final[Mapping[str, Pipeline]] = {
    "integrator_path": _pipeline("inspect_path", "inspect_path"),
    "integrator_guided": _pipeline("inspect_guided", "inspect_guided_path"),
    "integrator_whitted": _pipeline("inspect_whitted", "inspect_whitted_path"),
    "integrator_bdpt": _pipeline("inspect_bdpt", "inspect_bdpt", splats=True),
}

_WHY: Final = {
    "photon": "gathers photons, which belong to no sample of a pixel",
    "radiosity": "solves for the light of patches, and has no light paths",
    "reuse": "shares paths between the pixels of a block",
}


def check_integrator(name: str) -> None:
    """Check that the paths of an integrator can be recorded.

    Raises
    ------
    UsageError
    """
    if name not in INTEGRATORS:
        why = _WHY.get(name, "has kernels of its own")
        raise UsageError(f"integrator {name} {why}; light paths are shown of {', '.join(INTEGRATORS)}")
