"""The integrators: one module of the same name each, whose `INTEGRATOR` describes it to the rest of the host.

To add an integrator, add its module and its kernels.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping
from typing import Final

from clrender.files.package_data import integrator_names
from clrender.integrators.descriptor import (
    BETWEEN_DIFFUSE,
    CAUSTICS,
    DELTA_CAUSTICS,
    ENVIRONMENT_ON_DIFFUSE,
    SOFT_SHADOWS,
    Integrator,
    Pipeline,
)

__all__ = [
    "BETWEEN_DIFFUSE",
    "CAUSTICS",
    "DELTA_CAUSTICS",
    "ENVIRONMENT_ON_DIFFUSE",
    "INTEGRATORS",
    "SOFT_SHADOWS",
    "Integrator",
    "Pipeline",
]


class _Integrators(Mapping[str, Integrator]):
    """Integrators by name, `path` first; a module is imported at the first access."""

    def __getitem__(self, name: str) -> Integrator:
        if name not in integrator_names():
            raise KeyError(name)
        return _load(name)

    def __iter__(self) -> Iterator[str]:
        return iter(integrator_names())

    def __len__(self) -> int:
        return len(integrator_names())


def _load(name: str) -> Integrator:
    integrator: Integrator = importlib.import_module(f"clrender.integrators.{name}").INTEGRATOR
    return integrator


INTEGRATORS: Final[Mapping[str, Integrator]] = _Integrators()
