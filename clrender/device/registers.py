"""Compiler options by which GPUs give work-items as many registers as a program can use."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

from clrender.device.info import DeviceInfo

__all__ = ["register_options"]

_NVIDIA_LIMIT: Final = "-cl-nv-maxrregcount=128"
"""At 128 registers a multiprocessor runs a third more work-items than at 136, which the compiler takes by itself."""
_NVIDIA_STAGES: Final = {f"staged/{stage}.cl": "-cl-nv-maxrregcount=192" for stage in ("light", "scatter")}
"""By itself the compiler takes up to 196. With this limit it still writes none to memory."""
_INTEL_LARGE: Final = "-cl-intel-256-GRF-per-thread"
"""Twice as many registers for half as many threads; with 128 the kernels that trace paths write registers to memory."""
_LARGE: Final = ("integrator/", "staged/", "photon/photons.cl", "bidirectional/", "guiding/", "radiosity/gather.cl")
"""Kernels that trace paths."""


def register_options(info: DeviceInfo, entry: str, macros: Collection[str]) -> str:
    """Options for a program on a device; ``scripts/gpu_static`` measures what they do.

    Parameters
    ----------
    info : DeviceInfo
    entry : str
        File of the program, below the kernels folder.
    macros : collection of str
        Names of the macros that it is compiled with.

    Returns
    -------
    str
        Empty where the compiler's own choice is as good.
    """
    if info.type != "gpu":
        return ""
    platform = info.platform.lower()
    small = "MATERIALS" not in macros and "SPECULAR_CHAINS" not in macros
    if "nvidia" in platform:
        return _NVIDIA_LIMIT if entry == "integrator/path.cl" and small else _NVIDIA_STAGES.get(entry, "")
    return _INTEL_LARGE if "intel" in platform and entry.startswith(_LARGE) else ""
