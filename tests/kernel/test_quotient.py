"""Corrected divisions and square roots are those of IEEE 754, whatever a device gives within what OpenCL allows it.

NumPy's, on a processor that rounds right, are the reference. A device that does not round is simulated: what PoCL gives
is moved by up to `ERROR` units in the last place, reciprocals inside the correction as well, before it is corrected.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pytest
from kernel_support import FOLDER

if TYPE_CHECKING:
    from clrender.device import Device

ERROR = 3
"""OpenCL C 1.2, 7.4: 2.5 units in the last place for a division, 3 for a square root."""
COUNT = 1 << 20

Floats = npt.NDArray[np.float32]
Uints = npt.NDArray[np.uint32]


def bits(words: npt.ArrayLike) -> Floats:
    return np.asarray(words, np.uint32).view(np.float32)


def everything(rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Any bits: numbers of all sizes and signs, some infinite, no numbers, or below the smallest normal."""
    words = rng.integers(0, 1 << 32, (2, COUNT), dtype=np.uint32)
    return bits(words[0]), bits(words[1])


def like_sizes(rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Mantissas at random, exponents within a few of each other."""
    mantissas = rng.integers(0, 1 << 23, (2, COUNT), dtype=np.uint32)
    exponents = rng.integers(120, 134, (2, COUNT), dtype=np.uint32)
    return bits(mantissas[0] | exponents[0] << 23), bits(mantissas[1] | exponents[1] << 23)


def almost_in_the_middle(rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Quotients as near to the middle between two numbers as there are any.

    With odd b and small k, (2 q + 1) b + k is a multiple a of 2^25 for one 2 q + 1 modulo 2^25: a / b, scaled, is
    k / b beside the middle between q and q + 1.
    """
    b = rng.integers(1 << 22, 1 << 23, COUNT) * 2 + 1
    k = rng.integers(-40, 41, COUNT) * 2 + 1
    inverse = b.copy()  # modulo 2^25: each of Hensel's steps doubles the digits that are right, three at first
    for _ in range(4):
        inverse = inverse * (2 - b * inverse % (1 << 25)) % (1 << 25)
    middle = -k * inverse % (1 << 25)
    a = (middle * b + k) >> 25
    assert (a << 25 == middle * b + k).all()
    scale = np.float32(2.0) ** rng.integers(-20, 20, COUNT).astype(np.float32)
    some = (middle >> 24 == 1) & (a > 0)  # with all the digits
    assert some.mean() > 0.4
    return np.resize(a[some].astype(np.float32) * scale[some], COUNT), np.resize(b[some].astype(np.float32), COUNT)


def roots_almost_in_the_middle(rng: np.random.Generator) -> tuple[Floats, Floats]:
    """The same for roots: r² = c modulo 2^25 or 2^26 for small c, of which r² - c is then a number, r the middle."""
    found = []
    for power in (25, 26):
        c = rng.integers(-20_000, 20_001, COUNT) * 8 + 1
        r = np.ones(COUNT, np.int64)
        for digit in range(3, power + 1):  # one digit more each time
            r = np.where((r * r - c) >> digit & 1, r + (1 << (digit - 1)), r)
        r %= 1 << power
        for root in (r, (1 << power) - r, r ^ (1 << (power - 1)), ((1 << power) - r) ^ (1 << (power - 1))):
            x = root * root - c
            some = (root >> 24 == 1) & (x % (1 << power) == 0) & (x >> power >= 1 << 23) & (x >> power < 1 << 24)
            exponent = 2 * rng.integers(-30, 30, COUNT) + (1 if power == 26 else 0) - 23
            found.append(np.ldexp((x[some] >> power).astype(np.float32), exponent[some]))
    all_found = np.concatenate(found).astype(np.float32)
    assert len(all_found) > 100_000
    numbers: Floats = np.resize(all_found, COUNT)
    return numbers, np.roll(numbers, 1)


def at_the_ends(rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Quotients about the largest number and the smallest ones, also in the middle between two of these."""
    b = like_sizes(rng)[1]
    half = COUNT // 2
    large = np.ldexp(like_sizes(rng)[0][:half], rng.integers(110, 121, half))
    tiny_middles = np.ldexp((2.0 * rng.integers(0, 1 << 22, COUNT - half) + 1.0), -150).astype(np.float64)
    b[:half] = np.ldexp(b[:half], rng.integers(-10, 1, half))
    # A number times b, so that the quotient is about a middle; where it is one exactly, b is a power of two
    b[half::2] = np.ldexp(np.float32(1.0), rng.integers(0, 20, len(b[half::2])))
    b[half:] = np.ldexp(b[half:], 20)
    small = (tiny_middles * b[half:]).astype(np.float32)
    small = bits(small.view(np.uint32) + rng.integers(-1, 2, len(small)).astype(np.uint32))
    return np.concatenate([large, small]).astype(np.float32), b


def special(rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Zeros, ones, all ones, infinities, what is no number, ends of the range, in all pairs."""
    words = [0, 1, 2, 0x7FFFFF, 0x800000, 0x800001, 0xFFFFFF, 0x1000000, 0x3F7FFFFF, 0x3F800000, 0x3F800001, 0x3FFFFFFF]
    words += [0x40000000, 0x407FFFFF, 0x7EFFFFFF, 0x7F000000, 0x7F7FFFFF, 0x7F800000, 0x7FC00000]
    signed = np.array([word | sign for word in words for sign in (0, 1 << 31)], np.uint32)
    pairs = np.stack(np.meshgrid(signed, signed), -1).reshape(-1, 2)
    return bits(np.resize(pairs[:, 0], COUNT).copy()), bits(np.resize(pairs[:, 1], COUNT).copy())


INPUTS = {
    make.__name__: make
    for make in (everything, like_sizes, almost_in_the_middle, roots_almost_in_the_middle, at_the_ends, special)
}


def words(numbers: Floats) -> Uints:
    """Bits; every NaN the same."""
    return np.where(np.isnan(numbers), np.uint32(0x7FC00000), numbers.view(np.uint32))


def found_by(device: Device, a: Floats, b: Floats, lanes: int, error: int) -> list[tuple[str, Floats]]:
    """Results of each function, with the name of its operation."""
    defines: dict[str, int | str] = {"LANES": lanes, "CORRECT_DIVIDE": 1, "QUOTIENT_ERROR": f"{error}u"}
    program = device.program(FOLDER / "quotient.cl", defines)
    inputs, outputs = [device.upload(a), device.upload(b)], [device.empty(a.nbytes), device.empty(a.nbytes)]
    found = []
    for kernel, items, names in (
        ("quotients", COUNT // lanes, ("/", "sqrt")),
        ("quotients_one", COUNT, ("/",)),
        ("quotients_pack", COUNT // 8, ("/", "sqrt")),
    ):
        device.launch(program, kernel, items, 64, [*inputs, *outputs[: len(names)]])
        for name, output in zip(names, outputs, strict=False):
            result = np.empty_like(a)
            device.read(output, result)
            found.append((name, result))
    for buffer in (*inputs, *outputs):
        device.release(buffer)
    return found


@pytest.mark.thorough
@pytest.mark.parametrize("lanes", [1, 16])
@pytest.mark.parametrize("name", INPUTS)
def test_corrected_results_are_those_of_the_standard(device: Device, name: str, lanes: int) -> None:
    """A million of each kind, what the device gives being off by up to 3 units in the last place, and exact."""
    a, b = INPUTS[name](np.random.default_rng(80))
    with np.errstate(all="ignore"):
        wanted = {"/": words(a / b), "sqrt": words(np.sqrt(a))}
    for error in (ERROR, 0):
        for operation, result in found_by(device, a, b, lanes, error):
            wrong = np.flatnonzero(words(result) != wanted[operation])
            first = [f"{one[wrong[:1]]}" for one in (a, b, result)]
            assert not wrong.size, f"{operation}, off by {error}: {wrong.size} wrong, of {first}"


def test_the_simulated_device_is_wrong(device: Device, tmp_path: Path) -> None:
    """Or the correction would have nothing to do: most of what it gives is off, by up to three units, never by more."""
    a, b = like_sizes(np.random.default_rng(81))
    source = (FOLDER / "quotient.cl").read_text()
    spoilt = source.replace(
        "quotient_one(a[at], b[at])", "quotient_spoilt_lanes(a[at] / b[at], as_uint(a[at] + b[at]))"
    )
    assert spoilt != source
    (tmp_path / "spoilt.cl").write_text(spoilt)
    program = device.program(tmp_path / "spoilt.cl", {"LANES": 1, "CORRECT_DIVIDE": 1, "QUOTIENT_ERROR": f"{ERROR}u"})
    buffers = [device.upload(a), device.upload(b), device.empty(a.nbytes)]
    device.launch(program, "quotients_one", COUNT, 64, buffers)
    result = np.empty_like(a)
    device.read(buffers[2], result)
    for buffer in buffers:
        device.release(buffer)
    off = np.abs(result.view(np.int32).astype(np.int64) - (a / b).view(np.int32))
    assert off.max() == ERROR
    assert (off > 0).mean() > 0.8
