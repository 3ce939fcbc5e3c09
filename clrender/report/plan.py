"""The report's renders: settings, runs of each, and the amount of work."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

__all__ = ["LIMIT", "ONE_CORE", "REFERENCE_SAMPLES", "SCENE", "SPECS", "Spec", "one_core_turns", "turns_of", "work_of"]

SCENE: Final = "room-report"
"""The built-in scene that the table is measured on."""

LIMIT: Final = 3
"""Largest number of scattering events in the renders with limited paths."""

REFERENCE_SAMPLES: Final = 512
"""Total samples per pixel of both halves of the reference."""


@dataclass(frozen=True)
class Spec:
    """A setting: samples per pixel, shadow rays, and the desired deepest path with 16 samples per pixel."""

    samples: int
    shadow_rays: int
    deepest: int | None = 14


SPECS: Final = {
    "base": Spec(16, 1),
    "samples-256": Spec(256, 2),
    "samples-64": Spec(64, 2),
    "samples-16": Spec(16, 2),
    "shadow-4": Spec(16, 4),
    "depth-7": Spec(16, 1, 7),
    "depth-5": Spec(16, 1, 5),
    "samples-4": Spec(4, 2),
    "samples-1": Spec(1, 2),
    "cores-4": Spec(4, 1),
    "cores-64": Spec(64, 1),
    "own-samples-256": Spec(256, 2, None),
    "own-samples-64": Spec(64, 2, None),
    "own-samples-16": Spec(16, 2, None),
    "own-samples-4": Spec(4, 2, None),
    "own-samples-1": Spec(1, 2, None),
    "own-base": Spec(16, 1, None),
    "own-shadow-4": Spec(16, 4, None),
}
"""Settings by name. Those that begin with ``own`` use clrender's roulette, by throughput, instead of the report's."""

ONE_CORE: Final = {"one-core-4": "cores-4", "one-core": "base", "one-core-64": "cores-64"}
"""Maps rows rendered on one core to the rows on all cores with the same settings and seeds."""


def turns_of(samples: int, quick: bool) -> int:
    """Number of runs of a setting with this many samples per pixel."""
    if quick:
        return 3
    return 3 if samples > 64 else 6 if samples <= 16 else 4


def one_core_turns(quick: bool) -> int:
    """Number of runs on one core."""
    return 3 if quick else 4


def work_of(quick: bool) -> int:
    """Total samples per pixel of all renders."""
    rows = sum(spec.samples * turns_of(spec.samples, quick) for spec in SPECS.values())
    one_core = sum(SPECS[twin].samples for twin in ONE_CORE.values()) * one_core_turns(quick)
    further = 3 * (64 if quick else 128) + 32 + 16 * turns_of(16, quick) + 5
    return rows + one_core + further + REFERENCE_SAMPLES
