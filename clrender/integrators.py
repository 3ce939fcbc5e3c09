"""The ways to follow light: the kernel of each, and how its work may be cut."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

__all__ = ["INTEGRATORS", "Integrator"]


@dataclass(frozen=True)
class Integrator:
    """A way to follow light.

    Attributes
    ----------
    entry, kernel : str
        File below the kernels folder, and the kernel in it that makes samples of pixels.
    whole_blocks : bool
        A work-item takes a block of 16 pixels whole, however many lanes it has, because their samples share light.
    sample_by_sample : bool
        A launch makes one sample of each pixel, because something is computed first for that sample of all of them;
        then as much of the image as possible is one unit.
    """

    entry: str
    kernel: str
    whole_blocks: bool = False
    sample_by_sample: bool = False


INTEGRATORS: Final[Mapping[str, Integrator]] = {
    "path": Integrator("integrator/path.cl", "integrator_path"),
    "direct": Integrator("integrator/path.cl", "integrator_path"),
    "whitted": Integrator("integrator/whitted.cl", "integrator_whitted"),
    "radiosity": Integrator("radiosity/display.cl", "integrator_radiosity"),
}
