"""A real device: buffers, launches, errors that name what was asked for, and exact single operations."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from clrender.device import kernel_build
from clrender.drivers import select
from clrender.drivers.arithmetic import OPERATIONS, check, inputs, reference
from clrender.errors import DeviceError, RenderError
from clrender.integrators.path import INTEGRATOR as PATH

if TYPE_CHECKING:
    from clrender.device import Device

SCALE = """// For a test.
#pragma OPENCL FP_CONTRACT OFF
#include "types.h"
__kernel void scale(__global float* values, float factor, Material material) {
    values[get_global_id(0)] *= factor * material.ior;
}
"""


@pytest.fixture
def entry(tmp_path: Path) -> Path:
    path = tmp_path / "a folder" / "scale.cl"
    path.parent.mkdir()
    path.write_text(SCALE)
    return path


def test_upload_launch_read(device: Device, entry: Path) -> None:
    from clrender import layout

    material = np.zeros(1, layout.dtype("Material"))
    material["ior"] = 3.0
    program = device.program(entry)
    launches, builds = device.launches, device.builds
    assert device.program(entry) is program
    assert device.builds == builds
    values = np.arange(64, dtype=np.float32)
    buffer = device.upload(values)
    device.launch(program, "scale", 64, 16, [buffer, np.float32(2), material])
    result = np.empty_like(values)
    device.read(buffer, result)
    assert np.array_equal(result, values * 6)
    device.write(buffer, values)
    device.read(buffer, result)
    assert np.array_equal(result, values)
    device.finish()
    device.release(buffer)
    assert device.launches == launches + 1
    assert device.compile_seconds > 0


def test_peak_memory_is_counted(device: Device) -> None:
    before = device.allocated_bytes
    buffer = device.empty(before + 2**20)
    device.release(buffer)
    assert device.allocated_bytes >= before + 2**20


@pytest.mark.thorough
@pytest.mark.skipif(not Path("/sys/kernel/mm/transparent_hugepage").exists(), reason="this system has no large pages")
def test_large_buffers_ask_for_large_pages(device: Device) -> None:
    """The system marks memory of which that was asked. A new process has none that was marked for somebody else."""
    command = [sys.executable, __file__, str(device.info.index)]
    marked, left = map(int, subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout.split())
    assert 0.9 * 2**26 < marked <= 2**26, "the large one did, and no other"
    assert left == 0, "what is allocated in their place later is not marked"


def marked_for_buffers(device: Device) -> tuple[int, int]:
    """Bytes that are marked for a small and a large buffer, which hold what is written, and after their release."""

    def asked() -> int:
        words = Path("/proc/self/smaps").read_text().split("\n")
        sizes = [int(line.split()[1]) for line in words if line.startswith("Size:")]
        marked = ["hg" in line.split() for line in words if line.startswith("VmFlags:")]
        return sum(size for size, mark in zip(sizes, marked, strict=True) if mark) << 10

    before = asked()
    buffers = [device.empty(2**18), device.empty(2**26)]
    after = asked()
    values = np.arange(2**24, dtype=np.uint32)
    device.write(buffers[1], values)
    result = np.empty_like(values)
    device.read(buffers[1], result)
    assert np.array_equal(result, values)
    for _ in range(8):  # memory that is freed stays with the process for blocks of this size
        buffers.append(device.empty(2**23))
    for buffer in buffers:
        device.release(buffer)
    device.finish()
    del values, result  # NumPy asks, too
    return after - before, asked() - before


def test_a_buffer_beyond_the_limit_is_refused_with_its_size(device: Device) -> None:
    with pytest.raises(RenderError, match=r"allows .* in one buffer, .* are needed"):
        device.empty(device.max_allocation_bytes + 1)


@pytest.mark.parametrize(
    ("kernel", "local_size", "message"),
    [("scale", 7, "kernel scale of .* with 64 work-items in groups of 7"), ("no_such", 16, "kernel no_such of")],
)
def test_refused_launches_name_what_was_asked(
    device: Device, entry: Path, kernel: str, local_size: int, message: str
) -> None:
    buffer = device.empty(256)
    with pytest.raises(RenderError, match=message):
        device.launch(device.program(entry), kernel, 64, local_size, [buffer, np.float32(2), np.zeros(3, np.float32)])
    device.release(buffer)


def test_a_build_error_names_file_and_line(device: Device, tmp_path: Path) -> None:
    path = tmp_path / "wrong.cl"
    path.write_text('#include "types.h"\n\n__kernel void f(__global float* a) { a[0] = missing_name; }\n')
    with pytest.raises(DeviceError, match=r"cannot build .*wrong\.cl:3:\d+.*missing_name"):
        device.program(path)


def test_single_operations_are_exact_on_the_device_under_test(device: Device) -> None:
    assert check(device) == []


def test_the_reference_agrees_with_arithmetic_done_by_hand() -> None:
    one, three, tiny = (np.float32(x).view(np.uint32) for x in (1.0, 3.0, 2.0**-24))
    # 3 * 3 + 2^-24 rounds to 9; 1 / 3 rounds to 0x3eaaaaab; (1 + 2^-23)^2 - 1 keeps its last bit only when fused.
    table = np.array([[three, three, tiny], [one, three, one], [one + 1, one + 1, np.float32(-1).view(np.uint32)]])
    result = reference(table.astype(np.uint32))
    column = {name: index for index, name in enumerate(OPERATIONS)}
    assert result[0, column["fma"]] == np.float32(9).view(np.uint32)
    assert result[1, column["/"]] == 0x3EAAAAAB
    assert result[2, column["fma"]] == np.float32(2.0**-22 + 2.0**-46).view(np.uint32)
    assert result[0, column["float to int"]] == 3


def test_the_inputs_never_change() -> None:
    table = inputs()
    assert not np.isnan(table.view(np.float32)).any()
    assert table[100].tolist() == inputs()[100].tolist()
    assert (np.abs(table.view(np.float32)) < 1e-38).sum() > 5, "denormals are among them"


def test_options_that_a_driver_does_not_know_are_left_out(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("clrender.device.device.register_options", lambda *_: "-cl-no-such-option")
    opened = select(str(device.info.index))[0]
    program = opened.program("film/accumulate.cl", {"LANES": 1})
    assert program.options == opened.options
    assert opened.builds == 1
    opened.close()


if __name__ == "__main__":
    print(*marked_for_buffers(select(int(sys.argv[1]))[0]))


@pytest.mark.parametrize(
    ("platform", "is_cpu", "width", "lanes"),
    [
        ("Portable Computing Language", True, 4, 8),
        ("Portable Computing Language", True, 8, 8),
        ("Intel(R) OpenCL", True, 16, 16),
        ("Oclgrind", True, 1, 8),
        ("made up", True, 12, 8),
        ("made up", True, 32, 16),
        ("rusticl", True, 8, 1),
        ("NVIDIA CUDA", False, 1, 1),
    ],
)
def test_lanes_are_those_of_the_processor(
    device: Device, monkeypatch: pytest.MonkeyPatch, platform: str, is_cpu: bool, width: int, lanes: int
) -> None:
    """Whatever a driver says, it is a number that kernels can be compiled for; a work-item has as many paths."""
    monkeypatch.setattr(device, "info", replace(device.info, platform=platform))
    monkeypatch.setattr(device, "is_cpu", is_cpu)
    monkeypatch.setattr(device, "vector_width", width)
    assert kernel_build.lanes_of(device) == lanes
    path, single = PATH.pipeline, replace(PATH.pipeline, packets=1)
    assert kernel_build._packets(path, lanes) * lanes == 16 * path.packets
    assert kernel_build._packets(single, lanes) == 1
