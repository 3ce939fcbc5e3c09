"""Environment variables by which drivers are configured, and our defaults for them."""

from __future__ import annotations

import os
from typing import Final

__all__ = ["CACHES", "DEFAULTS", "PLACES", "driver_settings"]

# Set before any driver loads, unless the user has set them.
DEFAULTS: Final = {
    "RUSTICL_ENABLE": "llvmpipe",  # without it rusticl offers no device
    "CL_CONFIG_CPU_VECTORIZER_MODE": "1",  # Intel's vectorizer miscompiles: a path tracer was seen to lose paths
}
# Variables that change which devices a driver lists or what it computes.
_STEERING: Final = (
    "RUSTICL_",
    "POCL_",
    "POCLCC_",
    "CL_",
    "OCL_",
    "OPENCL_",
    "OCLGRIND_",
    "LIBGL_",
    "MESA_",
    "GALLIUM_",
    "GALLIVM_",
    "LP_",
    "ZINK_",
    "VK_",
    "RADV_",
    "AMD_",
    "HSA_",
    "ROC_",
    "ROCR_",
    "HIP_",
    "GPU_",
    "CUDA_",
    "NVIDIA_",
    "ZE_",
    "ONEAPI_",
    "NEO_",
    "IGC_",
    "LLVM_",
)
_STEERING_NAMES: Final = (
    "LD_PRELOAD",
    "LD_LIBRARY_PATH",
    "DRI_PRIME",
    "NEOReadDebugKeys",
    "OverrideDefaultFP64Settings",
)
# Locations of drivers: these need no fingerprint, as the list of drivers is read each time.
PLACES: Final = ("OCL_ICD_VENDORS", "OCL_ICD_FILENAMES")
# Cache folders of compilers, which do not affect their output.
CACHES: Final = ("POCL_CACHE_DIR", "MESA_SHADER_CACHE_DIR")


def driver_settings() -> list[str]:
    """Variables that configure drivers, with the user's values or our defaults; without locations."""
    own = {name: os.environ[name] for name in os.environ if name.startswith(_STEERING) or name in _STEERING_NAMES}
    told = {**DEFAULTS, **own}
    return [f"{name}={told[name]}" for name in sorted(told) if name not in (*PLACES, *CACHES)]
