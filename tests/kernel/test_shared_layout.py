"""What host and kernels both know is the same on both sides: structs on every driver, and the numbers of the tree."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from cases import for_each

from clrender import layout
from clrender.device import bvh, radix_sort
from clrender.files.package_data import kernels_folder
from clrender.photon import maps as photon_maps

if TYPE_CHECKING:
    from clrender.device import Device


def layout_kernel() -> str:
    """A kernel that writes the size of every struct and the place of each of its members."""
    lines = ['#include "types.h"', "", "__kernel void layout(__global uint* numbers) {", "    uint n = 0;"]
    for struct, members in layout.STRUCTS.items():
        lines += ["    {", f"        {struct} s;", "        numbers[n++] = (uint)sizeof(s);"]
        lines += [f"        numbers[n++] = (uint)((char*)&s.{name} - (char*)&s);" for name, _, _ in members]
        lines += [f"        numbers[n++] = (uint)sizeof(s.{name});" for name, _, _ in members]
        lines += ["    }"]
    return "\n".join([*lines, "}", ""])


def expected_numbers() -> list[int]:
    """The same by NumPy's dtypes."""
    numbers: list[int] = []
    for struct in layout.STRUCTS:
        dtype = layout.dtype(struct)
        assert dtype.names is not None and dtype.fields is not None
        fields = [dtype.fields[name] for name in dtype.names]
        numbers += [dtype.itemsize, *(field[1] for field in fields), *(field[0].itemsize for field in fields)]
    return numbers


def test_structs_lie_in_memory_as_on_the_host(all_devices: list[Device], tmp_path: Path) -> None:
    entry = tmp_path / "layout.cl"
    entry.write_text(layout_kernel())
    expected = expected_numbers()
    for device in all_devices:
        buffer = device.empty(4 * len(expected))
        device.launch(device.program(entry), "layout", 1, 1, [buffer])
        got = np.empty(len(expected), np.uint32)
        device.read(buffer, got)
        device.release(buffer)
        assert got.tolist() == expected, device.info.title


def test_an_array_of_structs_is_read_member_by_member(all_devices: list[Device], tmp_path: Path) -> None:
    """Size and places could be right and the stride of an array wrong: the third element is read back."""
    entry = tmp_path / "third.cl"
    entry.write_text(
        '#include "types.h"\n__kernel void third(__global const Light* lights, __global float* out) {\n'
        "    const Light l = lights[2];\n"
        "    out[0] = l.radiance.z, out[1] = as_float(l.primitive), out[2] = l.alias_threshold;\n}\n"
    )
    lights = np.zeros(3, layout.dtype("Light"))
    lights["radiance"], lights["primitive"] = np.arange(12).reshape(3, 4), (5, 6, 7)
    lights["alias_threshold"] = (0.25, 0.5, 0.75)
    for device in all_devices:
        buffers = [device.upload(lights), device.empty(16)]
        device.launch(device.program(entry), "third", 1, 1, buffers)
        got = np.empty(3, np.float32)
        device.read(buffers[1], got)
        for buffer in buffers:
            device.release(buffer)
        assert (got[0], got[1].view(np.uint32), got[2]) == (10.0, 7, 0.75), device.info.title


@for_each(
    ("file", "name", "value"),
    [
        ("geometry/bvh.h", "BVH_NODE_WORDS", bvh.NODE_WORDS),
        ("geometry/bvh.h", "TRIANGLE_BLOCK_WORDS", bvh.TRIANGLE_BLOCK_WORDS),
        ("geometry/bvh.h", "ANALYTIC_BLOCK_WORDS", bvh.ANALYTIC_BLOCK_WORDS),
        ("geometry/bvh.h", "BVH_STACK", bvh.STACK),
        ("geometry/build.h", "BUILD_CHUNK", radix_sort.CHUNK),
        ("geometry/build_merge.cl", "MERGE_CHUNK", bvh.MERGE_CHUNK),
        ("geometry/build_cost.h", "COST_ROOTS", bvh.COST_ROOTS),
        ("geometry/build.h", "BINARY_WORDS", bvh.BINARY_WORDS),
        ("photon/deposit.h", "PHOTON_DEPOSITS", photon_maps.DEPOSITS),
        ("photon/deposit.h", "DEPOSIT_WORDS", photon_maps.DEPOSIT_WORDS),
    ],
)
def test_numbers_of_the_kernels(file: str, name: str, value: int) -> None:
    text = (kernels_folder() / file).read_text(encoding="utf-8")
    found = re.search(rf"^#define {name} (\d+)u?$", text, re.MULTILINE)
    assert found is not None and int(found.group(1)) == value


def test_types_header_is_the_one_that_layout_makes() -> None:
    assert (kernels_folder() / "types.h").read_text(encoding="utf-8") == layout.types_header()
