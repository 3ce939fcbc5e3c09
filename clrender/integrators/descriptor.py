"""What the rest of the host knows of an integrator: data, so that help and schema can be made from it at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

__all__ = [
    "BETWEEN_DIFFUSE",
    "CAUSTICS",
    "ENVIRONMENT_ON_DIFFUSE",
    "SOFT_SHADOWS",
    "Integrator",
    "Pipeline",
]

BETWEEN_DIFFUSE: Final = "light between diffuse surfaces"
CAUSTICS: Final = "caustics"
SOFT_SHADOWS: Final = "soft shadows"
ENVIRONMENT_ON_DIFFUSE: Final = "the environment on diffuse surfaces"


@dataclass(frozen=True)
class Pipeline:
    """Kernels that are launched one after the other to make samples of pixels.

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
    squares : bool
        Whether the squares of replicates are summed up, where samples come in such.
    """

    entry: str
    kernel: str
    then: tuple[str, ...] = ()
    record_bytes: int = 0
    packets: int = 1
    sample_by_sample: bool = False
    squares: bool = True


@dataclass(frozen=True)
class Integrator:
    """A way to compute light transport.

    Attributes
    ----------
    pipeline : Pipeline
        Its kernels.
    leaves_out : tuple of str
        Light that it does not find, however many samples it takes.
    bias : str
        Of the light it does find: ``unbiased``, ``consistent`` (the error of the mean falls as samples are added) or
        ``discretised`` (it falls with the size of patches).
    takes : mapping of str to tuple
        Settings of which it takes these values only, the first where nothing is asked for.
    fixed : mapping of str to int
        Members of the kernels' `Settings` that it gives itself, whatever the settings say.
    materials : tuple of str
        Types of material that it takes; empty: all.
    environment_pictures : bool
        Whether it takes an environment that is not the same everywhere.
    volumes : bool
        Whether its paths keep account of the dielectrics that they are inside of: priorities and absorption.
    media : bool
        Whether it takes media that scatter, and the fog.
    opacity : bool
        Whether it takes surfaces that rays may pass by.
    textures : tuple of str or None
        Keys of materials at which it takes textures; None: all.
    emission_textures : bool
        Whether it takes shapes that shine as a texture.
    vertex_colors : bool
        Whether it takes meshes whose vertices have colours.
    auto_light_sampler : str
        What the light sampler ``auto`` stands for.
    blocks_share : bool
        Whether the pixels of a block of 4 x 4 share light, so that their errors depend on each other.
    preparation : str
        The module whose ``prepare`` computes what it needs before the first sample (`clrender.device.preparation`);
        empty: that is the scene alone.
    """

    pipeline: Pipeline
    leaves_out: tuple[str, ...] = ()
    bias: str = "unbiased"
    takes: Mapping[str, tuple[object, ...]] = field(default_factory=dict)
    fixed: Mapping[str, int] = field(default_factory=dict)
    materials: tuple[str, ...] = ()
    environment_pictures: bool = True
    volumes: bool = True
    media: bool = False
    opacity: bool = True
    textures: tuple[str, ...] | None = None
    emission_textures: bool = True
    vertex_colors: bool = True
    auto_light_sampler: str = "auto"
    blocks_share: bool = False
    preparation: str = ""

    @property
    def has_errors(self) -> bool:
        """Whether the spread of independent samples says how far their mean may be from what it estimates."""
        return self.bias == "unbiased"
