"""Replicates in film/accumulate.cl against Python's integers: squares of their sums, whatever the launches."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
from exact_sums import quanta
from test_accumulate import HEIGHT, SLOTS, TILE, WIDTH, all_of_float, as_integers, expected, inside

from clrender import layout
from clrender.device.launch import Scratch
from clrender.device.replicates import ReplicateSums
from clrender.errors import RenderError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from clrender.device import Device

Floats = npt.NDArray[np.float32]
Words = npt.NDArray[np.uint32]


def signed(value: int) -> int:
    return value - (value >> 127 << 128)


def summed(
    device: Device,
    samples: Floats,
    size: int,
    cuts: Sequence[int],
    first: int = 0,
    *,
    on_device: bool = False,
    whole: int = 0,
) -> list[Words]:
    """Sums, counts, squares and samples done of a unit whose launches end at `cuts`, with replicates of some size.

    Parts of replicates are removed from the sums as they are read, or before on the device; not from those of the first
    `whole` blocks, which are said to have ended with a replicate.
    """
    settings = np.zeros(1, layout.dtype("Settings"))
    settings["width"], settings["height"], settings["tile"] = WIDTH, HEIGHT, TILE
    settings["replicate_spp"] = size
    scratch = Scratch(device)
    replicates = ReplicateSums(device, scratch, size)
    program = device.program("film/accumulate.cl", {"LANES": 1})
    given, sums, counts = device.upload(settings), scratch.buffer("sums", 48 * SLOTS), scratch.buffer("n", 4 * SLOTS)
    padded = -(-SLOTS // 16) * 16
    device.launch(program, "film_clear", padded, 16, [sums, counts, np.uint32(SLOTS)])
    device.launch(program, "film_clear_replicates", padded, 16, replicates.begin(SLOTS, first))
    for begin, end in itertools.pairwise(cuts):
        buffer = device.upload(np.ascontiguousarray(samples[begin:end]))
        numbers = [np.uint32(n) for n in (0, SLOTS, first + begin, end - begin, 0)]
        arguments: list[Any] = [given, buffer, *numbers, sums, counts, *replicates.buffers]
        device.launch(program, "film_accumulate_replicates", padded, 16, arguments)
        device.finish()
        device.release(buffer)
    done = np.full(SLOTS // 16, cuts[-1], np.uint32)
    done[:whole] -= done[:whole] % np.uint32(size)
    if on_device:
        replicates.cut(sums, counts, done)
    words, counted = np.empty((SLOTS, 3, 4), np.uint32), np.empty(SLOTS, np.uint32)
    device.read(sums, words)
    device.read(counts, counted)
    squares = replicates.read(words, counted, done)
    device.release(given)
    scratch.release()
    return [words, counted, squares, done]


def squares_of(samples: Floats, size: int) -> list[list[int]]:
    """Sum of the squares of the sums of whole replicates, modulo 2^256: (slot, channel)."""
    found = [[0] * 3 for _ in range(SLOTS)]
    for begin in range(0, len(samples) - size + 1, size):
        sums, _ = expected(samples[begin : begin + size])
        for slot, channel in itertools.product(range(SLOTS), range(3)):
            found[slot][channel] = (found[slot][channel] + signed(sums[slot][channel]) ** 2) % 2**256
    return found


@pytest.mark.parametrize("size", [1, 4, 16])
def test_squares_are_exact_over_the_whole_range_of_floats(all_devices: list[Device], size: int) -> None:
    samples = all_of_float(np.random.default_rng(21 + size), 32)
    sums, counts = expected(samples)
    squares = squares_of(samples, size)
    for device in all_devices:
        words, counted, found, _ = summed(device, samples, size, [0, 32])
        assert counted.tolist() == counts, device.info.title
        assert as_integers(words) == sums, device.info.title
        assert as_integers(found) == squares, device.info.title


def test_launches_change_nothing(device: Device) -> None:
    samples = all_of_float(np.random.default_rng(31), 32)
    whole = summed(device, samples, 8, [0, 32], 64)
    for cuts in (range(33), [0, 3, 8, 9, 31, 32], [0, 16, 32]):
        for a, b in zip(summed(device, samples, 8, list(cuts), 64), whole, strict=True):
            assert np.array_equal(a, b)


@pytest.mark.parametrize("on_device", [False, True])
@pytest.mark.parametrize("taken", [0, 5, 8, 17, 23])
def test_what_was_begun_of_a_replicate_is_taken_back(device: Device, taken: int, on_device: bool) -> None:
    samples = all_of_float(np.random.default_rng(41), 24)
    kept = taken // 8 * 8
    for cuts in ([0, taken], list(range(taken + 1))):
        stopped = summed(device, samples, 8, cuts, on_device=on_device)
        for a, b in zip(stopped, summed(device, samples, 8, [0, kept]), strict=True):
            assert np.array_equal(a, b)
        assert (stopped[3] == kept).all()


def test_blocks_that_ended_with_a_replicate_keep_it(device: Device) -> None:
    samples = all_of_float(np.random.default_rng(43), 24)
    read, cut = (summed(device, samples, 8, [0, 21], on_device=on_device, whole=3) for on_device in (False, True))
    for a, b in zip(read, cut, strict=True):
        assert np.array_equal(a, b)
    taken_back = summed(device, samples, 8, [0, 21])
    assert not np.array_equal(read[0][:48], taken_back[0][:48]) and np.array_equal(read[0][48:], taken_back[0][48:])


def test_squares_of_the_largest_replicates_fit(device: Device) -> None:
    """A replicate of 4096 samples just below 2^43, of either sign, twice: 2^239 quanta."""
    most = np.nextafter(np.float32(2.0**43), np.float32(0))
    samples = np.full((8192, 3, SLOTS), most, np.float32)
    samples[:, 1] = -most
    squares = as_integers(summed(device, samples, 4096, [0, 8192])[2])
    wanted = 2 * (4096 * quanta(most)) ** 2
    for slot in np.flatnonzero(inside()):
        assert squares[slot] == [wanted] * 3


def test_a_unit_begins_with_a_replicate(device: Device) -> None:
    with pytest.raises(RenderError, match="within a replicate of 8"):
        ReplicateSums(device, Scratch(device), 8).begin(SLOTS, 12)
