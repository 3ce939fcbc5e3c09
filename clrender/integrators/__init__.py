"""The ways to follow light: the kernel of each, and how its work may be cut."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

__all__ = [
    "BETWEEN_DIFFUSE",
    "CAUSTICS",
    "ENVIRONMENT_ON_DIFFUSE",
    "INTEGRATORS",
    "RADIOSITY_DISPLAYS",
    "SOFT_SHADOWS",
    "Integrator",
]

BETWEEN_DIFFUSE: Final = "light between diffuse surfaces"
CAUSTICS: Final = "caustics"
SOFT_SHADOWS: Final = "soft shadows"
ENVIRONMENT_ON_DIFFUSE: Final = "the environment on diffuse surfaces"


@dataclass(frozen=True)
class Integrator:
    """A way to follow light.

    Attributes
    ----------
    entry, kernel : str
        File below the kernels folder, and the kernel in it that makes samples of pixels.
    then : tuple of str
        Kernels of the same file that are launched after it, in order, with the same arguments.
    record_bytes : int
        Memory that these share, for each sample of a launch.
    packets : int
        Packets of paths that its kernel takes turns with where rays part (kernels/core/lane.h).
    sample_by_sample : bool
        A launch makes one sample of each pixel, because something is computed first for that sample of all of them;
        then as much of the image as possible is one unit.
    leaves_out : tuple of str
        Light that it does not find, however many samples it takes.
    bias : str
        Of the light it does find: ``unbiased``, ``consistent`` (the error of the mean falls as samples are added) or
        ``discretised`` (it falls with the size of patches).
    takes : mapping of str to tuple
        Settings of which it takes these values only, the first where nothing is asked for.
    """

    entry: str
    kernel: str
    then: tuple[str, ...] = ()
    record_bytes: int = 0
    packets: int = 1
    sample_by_sample: bool = False
    leaves_out: tuple[str, ...] = ()
    bias: str = "unbiased"
    takes: Mapping[str, tuple[object, ...]] = field(default_factory=dict)


RADIOSITY_DISPLAYS: Final = ("constant", "smooth", "gather")
"""Each patch evenly bright; interpolated between corners; looked up by paths, some bounces later."""

INTEGRATORS: Final[Mapping[str, Integrator]] = {
    "path": Integrator("integrator/path.cl", "integrator_path", packets=8),
    "direct": Integrator(
        "integrator/path.cl",
        "integrator_path",
        packets=8,
        leaves_out=(BETWEEN_DIFFUSE, CAUSTICS),
        takes={"indirect_rays": (1, 0)},
    ),
    "whitted": Integrator(
        "integrator/whitted.cl",
        "integrator_whitted",
        leaves_out=(BETWEEN_DIFFUSE, CAUSTICS, SOFT_SHADOWS, ENVIRONMENT_ON_DIFFUSE),
    ),
    "reuse": Integrator(
        "integrator/reuse.cl",
        "integrator_reuse",
        ("reuse_weigh", "reuse_gather"),
        record_bytes=128,
        takes={"indirect_rays": (1,)},
    ),
    "photon": Integrator(
        "integrator/photon.cl",
        "integrator_photon",
        sample_by_sample=True,
        bias="consistent",
        # Photons start at lights and not at points, for which a tree of lights has no answer.
        takes={"indirect_rays": (1,), "light_sampler": ("auto", "power", "uniform")},
    ),
    "radiosity": Integrator("radiosity/display.cl", "integrator_radiosity", leaves_out=(CAUSTICS,), bias="discretised"),
}
