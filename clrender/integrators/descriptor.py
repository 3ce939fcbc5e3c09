"""Descriptions of integrators as plain data, from which help and schema can be generated quickly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

__all__ = [
    "BETWEEN_DIFFUSE",
    "CAUSTICS",
    "DELTA_CAUSTICS",
    "ENVIRONMENT_ON_DIFFUSE",
    "SOFT_SHADOWS",
    "Integrator",
    "Pipeline",
]

BETWEEN_DIFFUSE: Final = "light between diffuse surfaces"
CAUSTICS: Final = "caustics"
DELTA_CAUSTICS: Final = "caustics of lights without extent"
SOFT_SHADOWS: Final = "soft shadows"
ENVIRONMENT_ON_DIFFUSE: Final = "the environment on diffuse surfaces"


@dataclass(frozen=True)
class Pipeline:
    """Kernels that are launched one after another to compute samples of pixels.

    Attributes
    ----------
    entry, kernel : str
        File below the kernels folder, and its kernel that computes samples of pixels.
    then : tuple of str
        Kernels of the same file that are launched after it, in order, with the same arguments.
    record_bytes : int
        Memory shared by these kernels, bytes per sample of a launch.
    packets : int
        Number of packets of paths between which its kernel alternates where rays diverge (kernels/core/lane.h), with
        sixteen paths in each; with fewer, there are more packets. 1: it does not alternate.
    sample_by_sample : bool
        Whether a launch computes one sample of each pixel, because something is precomputed for that sample of all
        pixels. Units are then as large as possible.
    squares : bool
        Whether the squares of replicates are summed, if there are replicates.
    splats : bool
        Whether paths from the lights add to pixels; they are then prepared for each unit (`SplattingPreparation`).
    staged : bool
        Whether the same samples can be traced in stages (kernels/staged/stage.h).
    apart : bool
        Whether samples are wanted one by one, and not their sums.
    reads_records : bool
        Whether the host reads the records; they are then of one pixel, `record_bytes` for each of its samples.
    """

    entry: str
    kernel: str
    then: tuple[str, ...] = ()
    record_bytes: int = 0
    packets: int = 1
    sample_by_sample: bool = False
    squares: bool = True
    splats: bool = False
    staged: bool = False
    apart: bool = False
    reads_records: bool = False


@dataclass(frozen=True)
class Integrator:
    """Description of a light transport algorithm.

    Attributes
    ----------
    pipeline : Pipeline
        Its kernels.
    leaves_out : tuple of str
        Light that it does not find, however many samples are taken.
    bias : str
        Bias of the light that it finds: ``unbiased``, ``consistent`` (the error of the mean vanishes as samples are
        added) or ``discretised`` (it vanishes with the size of patches).
    takes : mapping of str to tuple
        Allowed values of settings that it restricts; the first is the default.
    fixed : mapping of str to int
        Members of the kernels' `Settings` that override the user's settings.
    materials : tuple of str
        Supported types of material; empty: all.
    environment_pictures : bool
        Whether it supports environments that are not constant.
    volumes : bool
        Whether its paths track the dielectrics that they are inside: priorities and absorption.
    media : bool
        Whether it supports scattering media, including fog.
    glowing_media : bool
        Whether it supports media that shine, if it supports media.
    opacity : bool
        Whether it supports surfaces with opacity, which rays may pass through.
    textures : tuple of str or None
        Keys of materials for which it supports textures; None: all.
    emission_textures : bool
        Whether it supports shapes with textured emission.
    vertex_colors : bool
        Whether it supports meshes with vertex colours.
    curves : bool
        Whether it supports curves.
    auto_light_sampler : str
        The light sampler that ``auto`` stands for.
    shares : str
        Which pixels share light, so that their errors are correlated: those of a ``block`` of 4 x 4, of the whole
        ``image``, or none (empty).
    preparation : str
        Module whose ``prepare`` computes the data that it needs before the first sample
        (`clrender.device.preparation`); empty: it needs only the scene.
    guiding : str
        The same if its paths are guided; empty: they cannot be.
    specular_chains : bool
        Whether its paths can sample light over specular chains.
    times : str
        What has a time of its own while the shutter is open: each sample of a ``pixel``, each sample of the whole
        ``image``, or nothing (empty), as it does not support motion.
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
    glowing_media: bool = True
    opacity: bool = True
    textures: tuple[str, ...] | None = None
    emission_textures: bool = True
    vertex_colors: bool = True
    curves: bool = True
    auto_light_sampler: str = "auto"
    shares: str = ""
    preparation: str = ""
    guiding: str = ""
    specular_chains: bool = False
    times: str = "pixel"

    @property
    def has_errors(self) -> bool:
        """Whether the error of the mean can be estimated from the variance of independent samples."""
        return self.bias == "unbiased"
