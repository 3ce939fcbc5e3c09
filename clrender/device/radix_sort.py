"""Stable integer sorting and prefix sums on a device; every device gives the same order."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from clrender.device.device import Argument, Buffer, Device, Program

__all__ = ["CHUNK", "launch_each", "scan", "sort"]

CHUNK: Final = 1024
"""Elements per work-item: ``BUILD_CHUNK`` of ``kernels/geometry/build.h``; a test compares them."""
_FEW: Final = 1024
"""Most values that the host sorts."""


def launch_each(device: Device, program: Program, kernel: str, count: int, arguments: Sequence[Argument]) -> None:
    """Launch a kernel over at least `count` work-items."""
    device.launch_each(program, kernel, count, arguments)


def scan(device: Device, numbers: Buffer, count: int) -> int:
    """Exclusive prefix sums in place.

    Parameters
    ----------
    device : Device
    numbers : Buffer
        (count,) uint32.
    count : int
        At least 1.

    Returns
    -------
    int
        Sum of all elements.
    """
    if count == 1:
        only = np.empty(1, np.uint32)
        device.read(numbers, only)
        if only[0]:
            device.write(numbers, np.zeros(1, np.uint32))
        return int(only[0])
    program, chunks = device.common_program(), -(-count // CHUNK)
    sums = device.empty(4 * chunks)
    launch_each(device, program, "build_scan", chunks, [numbers, np.uint32(count), sums])
    if chunks == 1:
        only = np.empty(1, np.uint32)
        device.read(sums, only)
        total = int(only[0])
    else:
        total = scan(device, sums, chunks)
        launch_each(device, program, "build_scan_add", count, [numbers, np.uint32(count), sums])
    device.release(sums)
    return total


def sort(device: Device, keys: Buffer, values: Buffer, count: int, bits: int) -> tuple[Buffer, Buffer]:
    """Stable radix sort of values by their keys, eight bits per pass. The given buffers are consumed.

    Parameters
    ----------
    device : Device
    keys : Buffer
        (count,) uint64, below 2**bits.
    values : Buffer
        (count,) uint32.
    count : int
        At least 1.
    bits : int

    Returns
    -------
    keys, values : Buffer
    """
    if count <= _FEW:
        return _sorted_by_host(device, keys, values, count)
    program, chunks = device.common_program(), -(-count // CHUNK)
    other_keys, other_values = device.empty(8 * count), device.empty(4 * count)
    counts = device.empty(4 * 256 * chunks)
    for shift in range(0, bits, 8):
        head: list[Argument] = [np.uint32(count), np.uint32(shift), np.uint32(chunks), counts]
        launch_each(device, program, "build_sort_count", chunks, [keys, *head])
        scan(device, counts, 256 * chunks)
        launch_each(device, program, "build_sort_scatter", chunks, [keys, values, *head, other_keys, other_values])
        keys, other_keys, values, other_values = other_keys, keys, other_values, values
    for buffer in (other_keys, other_values, counts):
        device.release(buffer)
    return keys, values


def _sorted_by_host(device: Device, keys: Buffer, values: Buffer, count: int) -> tuple[Buffer, Buffer]:
    """The same for few: sixteen launches, and eight numbers to wait for, take longer than both ways to the host."""
    given, found = np.empty(count, np.uint64), np.empty(count, np.uint32)
    device.read(keys, given)
    device.read(values, found)
    order = np.argsort(given, kind="stable")
    device.write(keys, given[order])
    device.write(values, found[order])
    return keys, values
