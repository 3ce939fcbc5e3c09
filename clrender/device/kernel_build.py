"""How the kernels of a render are compiled: their macros, and how many paths a work-item and a group take."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from clrender import layout
from clrender.device.bvh import STACK
from clrender.flatten.features import Features

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from clrender.device.device import Device
    from clrender.device.launch import LaunchConfig
    from clrender.device.scene_arrays import SceneArrays
    from clrender.integrators.descriptor import Pipeline

__all__ = ["KernelBuild", "kernel_build", "lanes_of", "most_lanes"]

_CPU_LANES: Final = 16
_NARROW_CPU_LANES: Final = 8
"""Paths per work-item of a CPU with vectors of sixteen floats, and of one with shorter vectors."""
_CPU_WORK_GROUP: Final = 4
_LONE_WORK_GROUP: Final = 16
_SMALL_TREE: Final = 8
"""Number of BVH nodes up to which packets are not split, as splitting costs more than traversing the BVH."""
_NEAR_BYTES: Final = 3 << 19
"""Size of a BVH up to which it fits into the processor's cache; larger ones are prefetched."""
_NO_PREFETCH: Final = ("oclgrind",)
"""Platforms of CPUs without a prefetch instruction: an interpreter."""


@dataclass(frozen=True)
class KernelBuild:
    """How the kernels of a render are compiled, and launched accordingly. None of it changes a bit of the image.

    Attributes
    ----------
    macros : dict
    lanes : int
        Paths of a packet.
    packets : int
        Packets of a work-item of the tracing kernel.
    group : int
        Work-items of a group.
    """

    macros: dict[str, int | str]
    lanes: int
    packets: int
    group: int

    @property
    def tracing(self) -> dict[str, int | str]:
        """Macros of the program that traces the samples of pixels."""
        return {**self.macros, "PACKETS": self.packets}


def kernel_build(
    device: Device,
    arrays: SceneArrays,
    features: Features,
    settings: npt.NDArray[np.void],
    pipeline: Pipeline,
    launch: LaunchConfig,
    *,
    chains: bool = False,
    universal: bool = False,
) -> KernelBuild:
    """How kernels are compiled for a scene, or so that one program renders any scene.

    Parameters
    ----------
    device : Device
    arrays : SceneArrays
        The scene on the device.
    features : Features
        What kernels are to handle of it.
    settings : (1,) `Settings`
    pipeline : Pipeline
    launch : LaunchConfig
    chains : bool
        Whether light over specular chains is sampled.
    universal : bool
        Compile for any scene that is rendered with these settings: with all features, whether this one has them or
        not, and for large BVHs. Such a program takes about twice as long, and none has to be compiled for the next
        scene.
    """
    lanes = 1 if launch.staged and pipeline.staged else launch.lanes or lanes_of(device)
    defines: dict[str, int | str] = {"LANES": lanes}
    if universal:
        features = Features.all(features.plugins)
        defines["UNIVERSAL"] = 1
    elif arrays.masked_tree is None:  # a given BVH holds all primitives
        features = replace(features, opacity=False, holes=False)
    parts = lanes >= 4 and (universal or arrays.node_count > _SMALL_TREE)
    # A single packet has no others to alternate with where rays diverge, or to sort paths by material with.
    several = (parts or (lanes >= 4 and features.materials)) and not chains
    packets = _packets(pipeline, lanes) if several else 1
    group = launch.work_group or _work_group(device, lanes, packets)
    group = group if launch.work_group else min(group, device.max_work_group)
    if device.fixes_groups:
        defines["WORK_GROUP"] = group
    if launch.traversal == "single":
        defines["TRAVERSAL_SINGLE"] = 1
    if lanes >= 4 and not parts:
        defines["PACKET_PARTS"] = 0  # not for single lanes: their program is the same, and compiled only once
    defines |= features.macros
    if features.textures and arrays.page_bits is not None:
        defines["TEXEL_PAGE_BITS"] = arrays.page_bits
    if settings["filter_weight"][0] > 0.0:
        defines["PIXEL_FILTER"] = 1
        if settings["filter_negative"][0] < layout.FILTER_LINES:
            defines["PIXEL_FILTER_NEGATIVE"] = 1
    if settings["shadow_rays"][0] > 1:
        defines["SEVERAL_SHADOW_RAYS"] = 1
    if settings["indirect_rays"][0] > 1:
        defines["PATH_SPLITS"] = 1
    if chains:
        defines["SPECULAR_CHAINS"] = 1
    if settings["spectral"][0]:
        defines["SPECTRAL"] = 1
    else:
        defines.pop("DISPERSION", None)
    platform = device.info.platform.lower()
    if parts and device.is_cpu and not any(name in platform for name in _NO_PREFETCH):
        defines["PREFETCH"] = 1
        if arrays.tree_bytes > _NEAR_BYTES and not universal:
            defines["BVH_PREFETCH"] = 1
    stack = STACK
    while stack < arrays.stack_entries:
        stack *= 2
    if stack > STACK:
        defines["BVH_STACK"] = stack
    return KernelBuild(defines, lanes, packets, group)


def most_lanes(device: Device) -> int:
    """Largest number of paths per work-item on a device.

    With more than one, rusticl's compiler does not finish within minutes, and with sixteen it takes more than 20 GB.
    Its llvmpipe maps neighbouring work-items to vector lanes by itself, like a GPU.
    """
    return 1 if "rusticl" in device.info.platform.lower() else _CPU_LANES


def lanes_of(device: Device) -> int:
    """Default number of paths per work-item: sixteen where the processor computes as many at once, or eight."""
    if not device.is_cpu:
        return 1
    return min(most_lanes(device), _CPU_LANES if device.vector_width >= _CPU_LANES else _NARROW_CPU_LANES)


def _packets(pipeline: Pipeline, lanes: int) -> int:
    """Packets of a work-item: with fewer lanes more, so that it has as many paths to choose from."""
    return pipeline.packets if pipeline.packets == 1 else pipeline.packets * _CPU_LANES // lanes


def _work_group(device: Device, lanes: int, packets: int) -> int:
    """Default number of work-items in a group."""
    if not device.is_cpu:
        return device.group
    # llvmpipe maps work-items to its own lanes: with sixteen it is six times faster than with one. Packets count like
    # work-items: a core takes one group at a time, and at the end of a launch the others wait for it.
    return max(1, _CPU_WORK_GROUP // packets) if lanes > 1 else _LONE_WORK_GROUP
