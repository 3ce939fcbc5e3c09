"""Which GPUs are told how many registers a program may use."""

from __future__ import annotations

from clrender.device.info import DeviceInfo
from clrender.device.registers import register_options


def options(platform: str, entry: str = "integrator/path.cl", kind: str = "gpu", macros: tuple[str, ...] = ()) -> str:
    return register_options(DeviceInfo(0, "device", platform, "1.0", kind, 1, 1), entry, macros)


def test_only_gpus_of_these_vendors_are_told() -> None:
    assert options("NVIDIA CUDA") == "-cl-nv-maxrregcount=128"
    assert options("Intel(R) OpenCL Graphics") == "-cl-intel-256-GRF-per-thread"
    assert not options("AMD Accelerated Parallel Processing")
    assert not options("rusticl")
    assert not options("Intel(R) OpenCL", kind="cpu")
    assert not options("Portable Computing Language", kind="cpu")


def test_only_programs_that_gain_are_limited() -> None:
    assert not options("NVIDIA CUDA", macros=("LANES", "MATERIALS"))
    assert not options("NVIDIA CUDA", "integrator/whitted.cl")
    assert not options("Intel(R) OpenCL Graphics", "geometry/build_merge.cl")
    assert options("Intel(R) OpenCL Graphics", "integrator/reuse.cl", macros=("MATERIALS",))
