"""core/: lanes, exact arithmetic and frames against NumPy and exact fractions, with the same bits for every LANES."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
from kernel_support import FOLDER

if TYPE_CHECKING:
    from clrender.device import Device

EPS = 2.0**-24
LANES = (1, 4, 8, 16)

Floats = npt.NDArray[np.float32]


def launch(
    device: Device, kernel: str, values: Floats, outputs: int, lanes: int, table: Floats | None = None
) -> npt.NDArray[np.uint32]:
    """Bits of the results, (outputs, count); `values` is (…, count) with count a multiple of 16."""
    count = values.shape[-1]
    assert count % 16 == 0
    buffers = [device.upload(np.ascontiguousarray(values)), device.empty(4 * outputs * count)]
    extra: list[Any] = []
    if table is not None:
        extra = [device.upload(table), np.uint32(len(table))]
    size = -(-count // lanes // 16) * 16
    arguments: list[Any] = [buffers[0], *extra, np.uint32(count), buffers[1]]
    device.launch(device.program(FOLDER / "core.cl", {"LANES": lanes}), kernel, size, 16, arguments)
    results = np.empty((outputs, count), np.uint32)
    device.read(buffers[1], results)
    for buffer in (*buffers, *extra[:1]):
        device.release(buffer)
    return results


def settled(results: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint32]:
    """Bits with what drivers do not agree about made equal: rusticl has -0 for fma(0, -1/4, 0), and no denormals."""
    return np.where((results & 0x7FFFFFFF) < 0x00800000, np.uint32(0), results)


def on_all(devices: list[Device], kernel: str, values: Floats, outputs: int, compared: slice = slice(None)) -> Floats:
    """The results of the first device with one lane, once all LANES there and the other devices have given the same.

    `compared` picks outputs whose intermediate results are numbers that all drivers know.
    """
    first = launch(devices[0], kernel, values, outputs, 1)
    for lanes in LANES[1:]:
        same = launch(devices[0], kernel, values, outputs, lanes) == first
        assert same.all(), f"{kernel} with {lanes} lanes: output {np.argwhere(~same)[0]}"
    for device in devices[1:]:
        same = (settled(launch(device, kernel, values, outputs, 1)) == settled(first))[compared]
        assert same.all(), f"{kernel} on {device.info.title}: output {np.argwhere(~same)[0]}"
    return first.view(np.float32)


@pytest.mark.parametrize("lanes", LANES)
def test_lanes_do_as_numpy_does(all_devices: list[Device], lanes: int) -> None:
    rng = np.random.default_rng(2)
    x = rng.uniform(-1, 1, 4096).astype(np.float32)
    # Work-items where no lane, every lane, or exactly one lane fulfils the condition.
    x[:256] = -0.5
    x[256:512] = 0.5
    x[512 : 512 + 17 * 16 : 17] = 0.9
    table = rng.uniform(-1, 1, (97, 16)).astype(np.float32)
    item = x.reshape(-1, lanes)
    row = (np.abs(x) * np.float32(1000)).astype(np.int64) % len(table)
    high, low = x > 0.25, x < -0.25

    def of_items(values: npt.ArrayLike) -> npt.NDArray[np.uint32]:
        return np.repeat(np.asarray(values).astype(np.uint32), lanes)

    def bits(values: npt.ArrayLike) -> npt.NDArray[np.uint32]:
        return np.asarray(values, np.float32).view(np.uint32)

    high_item, low_item = high.reshape(-1, lanes), low.reshape(-1, lanes)
    expected = {
        "any": of_items(high_item.any(1)),
        "count": of_items(high_item.sum(1)),
        "least": np.repeat(bits(item.min(1)), lanes),
        "rank": (np.cumsum(high_item, 1) - high_item).ravel(),
        "index": np.tile(np.arange(lanes), len(item)),
        "largest_uint": of_items(row.reshape(-1, lanes).max(1)),
        "gather": bits(table[row, 5]),
        "or": high | low,
        "not and": ~high & ~low,
        "any not or": of_items((~(high_item | low_item)).any(1)),
        "count not": of_items((~high_item).sum(1)),
        "unequal": high != low,
        "lesser": bits(np.minimum(x, np.float32(0.5))),
        "greater": bits(np.maximum(x, np.float32(0.5))),
        "any of nothing": np.zeros(len(x)),
        **{f"column {k}": bits(table[row, k]) for k in (0, 1, 6, 7, 9, 15)},
    }
    for device in all_devices:
        results = launch(device, "core_lanes", x, 24, lanes, table)
        for got, (name, wanted) in zip(results, expected.items(), strict=False):
            assert np.array_equal(got, np.asarray(wanted).astype(np.uint32)), f"{name}, {device.info.title}"
        # All sixteen columns at once: powers of two keep them apart in a sum whose terms are of one size.
        weighted = table[row].astype(np.float64) @ 2.0 ** np.arange(16)
        assert np.abs(results[21].view(np.float32) - weighted).max() < 16 * EPS * 2**16
        assert np.array_equal(results[22], bits(x))
        assert np.array_equal(results[23], (np.abs(x) * np.float32(100)).astype(np.uint32))


def near_zero_products(rng: np.random.Generator, n: int) -> Floats:
    """a, b, c, d with a b − c d zero, or as near to it as four floats get, over forty orders of magnitude."""
    a, b = (rng.uniform(1, 2, n).astype(np.float32) for _ in range(2))
    c = rng.uniform(1, 2, n).astype(np.float32)
    d = (a.astype(np.float64) * b / c).astype(np.float32)
    steps = rng.integers(-2, 3, n)
    d = (d.view(np.int32) + steps.astype(np.int32)).view(np.float32)
    # The same two factors, and products that are equal without their factors being so: 3 · 5k and 15 · k.
    k = n // 8
    c[:k], d[:k] = b[:k], a[:k]
    whole = rng.integers(1, 2**18, k).astype(np.float32)
    a[k : 2 * k], b[k : 2 * k], c[k : 2 * k], d[k : 2 * k] = 3, 5 * whole, 15, whole
    power = rng.integers(-30, 31, (2, n))
    signs = rng.choice([-1, 1], (2, n))
    values = np.stack([a * signs[0], b * signs[1], c * signs[0], d * signs[1]])
    scaled: Floats = np.ldexp(values, np.stack([power[0], power[1], power[0], power[1]])).astype(np.float32)
    return scaled


@pytest.mark.long
def test_inner_and_difference_of_products(all_devices: list[Device]) -> None:
    """Against exact fractions.

    `inner` rounds three times: first |a.z b.z|, and each sum once more, so its error is at most 3 EPS Σ|aᵢ bᵢ| and a
    little of second order. `difference_of_products` is within two roundings of the exact value (Jeannerod et al. 2013),
    so its sign is right and zero is zero.
    """
    rng = np.random.default_rng(3)
    n = 16384
    values = rng.normal(size=(6, n)).astype(np.float32)
    values[:4] = near_zero_products(rng, n)
    results = on_all(all_devices, "core_exact", values, 25).astype(np.float64)
    exactly = [[Fraction(float(x)) for x in column] for column in values]
    worst = 0.0
    signs = 0
    for i in range(n):
        a, b = [column[i] for column in exactly[:3]], [column[i] for column in exactly[3:]]
        terms = [p * q for p, q in zip(a, b, strict=True)]
        assert abs(Fraction(results[0, i]) - sum(terms)) <= Fraction(3.01 * EPS) * sum(map(abs, terms))
        true = a[0] * a[1] - a[2] * b[0]
        got = Fraction(results[1, i])
        assert (got > 0) == (true > 0) and (got < 0) == (true < 0)
        signs += true == 0
        if true:
            worst = max(worst, float(abs(got - true) / abs(true)))
    assert signs > n // 8, "zeros are among the inputs"
    print(f"difference_of_products: worst relative error {worst / EPS:.2f} EPS")
    assert worst <= 2.0 * EPS
    wanted = np.cross(values[:3].T.astype(np.float64), values[3:].T.astype(np.float64)).T
    size = np.abs(values[:3]).max(0).astype(np.float64) * np.abs(values[3:]).max(0)
    assert (np.abs(results[2:5] - wanted) <= 2.01 * EPS * np.abs(wanted) + 2.0**-50 * size).all()


def test_unit_vectors_at_every_scale(all_devices: list[Device]) -> None:
    """`unit` from 1e-30 to 1e30.

    The vector is scaled by a power of two, exactly. Its inner product with itself is off by 3 EPS; the root of that by
    half as much and one rounding, the inverse by one more, the result by one more: 1.5 + 1 + 1 + 1 = 4.5 EPS of each
    component.
    """
    rng = np.random.default_rng(4)
    n = 65536
    vectors = rng.normal(size=(3, n)) * 10.0 ** rng.uniform(-12, 0, (3, n)) ** rng.integers(0, 2, (3, n))
    vectors /= np.abs(vectors).max(0)
    vectors *= 10.0 ** rng.uniform(-30, 30, n)
    vectors[:, :3] = np.eye(3) * 1e-30
    vectors[:, 3:6] = np.eye(3) * -1e30
    vectors[:, 6] = 0.0
    values = np.zeros((6, n), np.float32)
    values[:3] = vectors
    got = on_all(all_devices, "core_exact", values, 25, slice(5, 8))[5:8].astype(np.float64)
    exact = values[:3].astype(np.float64)
    length = np.sqrt((exact**2).sum(0))
    assert np.array_equal(got[:, 6], np.zeros(3))
    exact, length, got = (np.delete(x, 6, axis=-1) for x in (exact, length, got))
    wanted = exact / length
    # Components 1e38 times smaller than the largest are lost below the smallest float.
    error = np.abs(got - wanted)
    seen = np.abs(wanted) > 1e-30
    print(f"unit: worst relative error of a component {(error[seen] / np.abs(wanted[seen])).max() / EPS:.2f} EPS")
    assert (error <= 4.51 * EPS * np.abs(wanted) + 1e-37).all()


def test_simple_operations(all_devices: list[Device]) -> None:
    rng = np.random.default_rng(5)
    values = rng.normal(size=(6, 4096)).astype(np.float32)
    values[0, :6] = 0.0, -0.0, -1.0, 1e15, 1e-15, -1e-15
    values[1, ::3] = -0.0
    f = np.float32
    a, b = values[:3], values[3:]
    got = on_all(all_devices, "core_exact", values, 25)
    assert np.array_equal(got[14], np.sqrt(np.maximum(a[0], f(0))))
    signed = np.where(a[1] < 0, -np.abs(a[0]), np.abs(a[0]))  # zero counts as positive, whichever zero
    assert np.array_equal(got[15].view(np.uint32), signed.view(np.uint32))
    assert np.array_equal(got[16].view(np.uint32), np.abs(a[0]).view(np.uint32))
    assert np.array_equal(got[17], np.clip(a[0], f(-0.5), f(0.75)))
    assert np.array_equal(got[19], a.max(0))
    assert np.array_equal(got[20:23], np.where(a[0] < a[1], a, b))
    # Without contraction every operation rounds once, as NumPy's do.
    other = (a + b) * (a * b[0]) - (-b)
    assert np.array_equal(got[23:25], other[[0, 2]])
    length = np.sqrt((a.astype(np.float64) ** 2).sum(0))
    sound = (length > 1e-15) & (length < 1e15)
    assert (np.abs(got[18] - length)[sound] <= 2.51 * EPS * length[sound]).all()
    directed, wanted = got[8:11][:, sound], (a / length)[:, sound]
    assert (np.abs(directed - wanted) <= 4.51 * EPS * np.abs(wanted)).all()
    exact = a.astype(np.float64) + b.astype(np.float64) * a[0]
    size = np.abs(a) + np.abs(b.astype(np.float64) * a[0])
    assert (np.abs(got[11:14] - exact) <= (1 + 1e-6) * EPS * np.abs(exact) + 1e-14 * size).all()


@pytest.mark.long
def test_cos_and_sin_of_every_number_that_sampling_gives(device: Device) -> None:
    """Every multiple of 2^-24 in [0, 1) and 2^20 smaller numbers: off by less than the header's 1.2e-7."""
    worst = 0.0
    grid = np.arange(2**24, dtype=np.float64) * 2.0**-24
    small = np.geomspace(1e-38, 2.0**-20, 2**20)
    eighths = np.concatenate(
        [np.nextafter(np.float32(k / 8), np.float32(s)) for k in range(9) for s in (0, 1)], axis=None
    )
    eighths = np.concatenate([eighths, [0.0, 1.0 - 2.0**-24], np.zeros(16)])[: 16 * (len(eighths) // 16 + 1)]
    for part in (grid[: 2**23], grid[2**23 :], small, eighths):
        turns = part.astype(np.float32)
        inside = turns < 1.0
        got = launch(device, "core_cos_sin", turns, 2, 16).view(np.float32)
        angle = 2 * np.pi * turns.astype(np.float64)
        for values, function in zip(got, (np.cos, np.sin), strict=True):
            worst = max(worst, float(np.abs(values - function(angle))[inside].max()))
        if part is small:
            assert (np.abs(got[1] / angle - 1) < 4 * EPS).all(), "the sine of a small angle keeps its digits"
    print(f"cos_sin_turn: worst error {worst:.3e}")
    assert worst < 1.2e-7


def test_cos_and_sin_have_the_same_bits_everywhere(all_devices: list[Device]) -> None:
    rng = np.random.default_rng(6)
    turns = rng.uniform(0, 1, 2**16).astype(np.float32)
    turns[:9] = np.arange(9) / 8
    turns[turns >= 1.0] = 0.0
    on_all(all_devices, "core_cos_sin", turns, 2)


def test_exponential(all_devices: list[Device]) -> None:
    """Two units in the last place from NumPy's in double precision; nothing from 87 on, and exactly 1 at 0."""
    rng = np.random.default_rng(9)
    values = np.concatenate(
        [rng.uniform(0.0, 87.0, 2**20), np.geomspace(1e-38, 87.0, 2**18), np.arange(2**16) * (np.log(2.0) / 2.0 / 2**9)]
    ).astype(np.float32)
    values[:16] = 0.0, 1.0, 87.0, 88.0, 1e3, 1e30, 3e38, *np.nextafter(np.full(9, 87.0, np.float32), np.float32(0.0))
    got = on_all(all_devices, "core_exp", values, 1)[0]
    exact = np.exp(-values.astype(np.float64))
    below = values < 87.0
    ulp = np.abs(got - exact)[below] / np.spacing(exact[below].astype(np.float32)).astype(np.float64)
    print(f"exp_minus: worst error {ulp.max():.3f} ulp")
    assert ulp.max() < 2.0
    assert (got[~below] == 0.0).all() and (got[values == 0.0] == 1.0).all()


def test_logarithm_of_random_bits(all_devices: list[Device]) -> None:
    """Of numbers near 0 as of those near 1, where the result has as few units as the number's distance from 1."""
    rng = np.random.default_rng(10)
    bits = rng.integers(0, 2**32, 2**20, dtype=np.uint32)
    bits[:96] = [b for k in range(32) for b in (2**k - 1, 2**k, 2**32 - 2**k)]
    bits[96:1120] = np.uint32(2**32 * math.sqrt(0.5)) + np.arange(1024, dtype=np.uint32)
    got = on_all(all_devices, "core_minus_log", bits.view(np.float32), 1)[0].astype(np.float64)
    exact = -np.log((bits.astype(np.float64) + 1.0) / 2.0**32)
    # The number itself is rounded to a unit of single precision before its logarithm is taken
    error = np.abs(got - exact) / (
        np.spacing(np.maximum(exact, 1e-30).astype(np.float32)).astype(np.float64) + 2.0**-25
    )
    print(f"minus_log_of_bits: worst error {error.max():.3f} units")
    assert error.max() < 3.0
    assert (got >= 0.0).all() and got[bits == 2**32 - 1].max() == 0.0 and got.max() < 22.2


def test_frames_are_orthonormal(all_devices: list[Device]) -> None:
    """Around every normal, those with z = ±1 and -0 included.

    With |sign + n.z| between 1 and 2, `a` is off by 2 EPS and the largest of a vector's terms (n.x² a, n.y² a, both
    below 1, and n.x n.y a below 1/2) by 4 EPS, their sum with 1 by one more; so a component is off by at most 5
    EPS, and a product of two such vectors by √3 (5 + 5) EPS < 18 EPS. That n itself is a unit vector only to 2 EPS
    adds 2 more.
    """
    rng = np.random.default_rng(7)
    n = 65536
    normals = rng.normal(size=(n, 3))
    near = rng.normal(size=(n // 4, 3)) * 10.0 ** rng.uniform(-9, -1, (n // 4, 1))
    near[:, 2] = rng.choice([-1.0, 1.0], n // 4)
    normals[: n // 4] = near
    normals[n // 4 : n // 2, 2] *= 10.0 ** rng.uniform(-40, 0, n // 4)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[:6] = np.vstack([np.eye(3), -np.eye(3)])
    normals[6:8] = (1.0, 0.0, -0.0), (0.6, 0.8, -0.0)
    values = np.zeros((6, n), np.float32)
    values[:3], values[3:] = normals.T, rng.normal(size=(3, n))
    got = on_all(all_devices, "core_frame", values, 12).astype(np.float64)
    normal, tangent, bitangent = values[:3].astype(np.float64), got[:3], got[3:6]
    frame = np.stack([tangent, bitangent, normal])
    gram = np.einsum("ikn,jkn->ijn", frame, frame) - np.eye(3)[:, :, None]
    print(f"frame: worst product {np.abs(gram).max() / EPS:.2f} EPS")
    assert np.abs(gram).max() <= 20 * EPS
    assert (np.einsum("kn,kn->n", np.cross(tangent.T, bitangent.T).T, normal) > 0.99).all(), "right-handed"
    local = np.einsum("ikn,kn->in", frame, values[3:].astype(np.float64))
    size = np.abs(values[3:]).sum(0)
    assert (np.abs(got[6:9] - local) <= 3.01 * EPS * size).all()
    # There and back: the error of the products, three times over, and the roundings of both ways.
    assert (np.abs(got[9:12] - values[3:]) <= (3 * 20 + 6) * EPS * size).all()


def test_no_direction_leaves_the_hemisphere(all_devices: list[Device]) -> None:
    """Not even from the rim of the disk below, where 1 - x² - y² may be zero."""
    rng = np.random.default_rng(8)
    n = 65536
    values = np.empty((5, n), np.float32)
    normals = rng.normal(size=(3, n))
    values[:3] = normals / np.linalg.norm(normals, axis=0)
    last = np.float32(1.0 - EPS)
    values[3], values[4] = np.where(rng.random(n) < 0.5, 0.0, last), rng.random(n) * last
    values[3:, ::2] = values[:2:-1, ::2]
    assert on_all(all_devices, "core_hemisphere", values, 1).min() > 0.0


def without_denormals(device: Device) -> Device:
    """The same device, allowed to take numbers below the smallest normal one for zero, as many GPUs do; PoCL does."""
    from clrender.drivers import select

    other = select(str(device.info.index))[0]
    other.options += " -cl-denorms-are-zero"
    return other


def test_reciprocals_have_the_same_bits_everywhere(all_devices: list[Device]) -> None:
    """Also below the smallest normal number, about which drivers differ, and of the largest, whose own is below it."""
    ends = [2.0**-126, 2.0**-127, 1e-40, 1e-45, 0.0, -0.0, -1e-40, -1.0, 2.0**126, 2.0**127, 3.4e38, 1.0, 3.0]
    values = np.zeros((4, 16384), np.float32)
    values[0] = 10.0 ** np.random.default_rng(8).uniform(-45, 38.5, values.shape[1])
    values[0, : len(ends)] = ends
    first = launch(all_devices[0], "core_weights", values, 2, 16)[0]
    for device in (*all_devices, without_denormals(all_devices[0])):
        for lanes in LANES if device is all_devices[0] else (1,):
            assert np.array_equal(launch(device, "core_weights", values, 2, lanes)[0], first), device.info.title
    got, usable = first.view(np.float32), values[0] >= np.float32(2.0**-126)
    assert (got[~usable] == 1.0).all(), "what is not above zero, or might be taken for zero, has no reciprocal"
    with np.errstate(divide="ignore", over="ignore"):
        exact = np.maximum(np.float32(1.0) / values[0], np.float32(2.0**-126))
    assert np.array_equal(got[usable], exact[usable])
    assert (got >= np.float32(2.0**-126)).all()


def test_weights_are_the_balance_heuristic(all_devices: list[Device]) -> None:
    rng = np.random.default_rng(9)
    values = np.zeros((4, 4096), np.float32)
    values[[0, 2]] = rng.integers(0, 5, (2, 4096))
    values[[1, 3]] = 10.0 ** rng.uniform(-9, 9, (2, 4096))
    values[1, :64] = 0.0
    values[1, 64:96] = 1e-44  # a density that underflowed is no delta
    values[3, 96:128] = 0.0
    got = on_all(all_devices, "core_weights", values, 2, slice(1, 2))[1].astype(np.float64)
    n_a, p_a, n_b, p_b = values.astype(np.float64)
    first, second = n_a * p_a, n_b * p_b
    counts = first > 1e-37
    exact = np.divide(first, first + second, out=np.zeros_like(first), where=counts)
    np.testing.assert_allclose(got, exact, rtol=1e-6)
    assert (got[:96] == 0.0).all()
    assert (got[counts & (second == 0.0)] == 1.0).all()


def test_samples_split_into_different_ones(device: Device) -> None:
    """So many that their numbers together have more than 32 bits; those of the third part of 2^32 pass it half-way."""
    index = np.array([0, 1, 2**20, 2**20 + 1, 2**32 // 3, 2**31 - 1, 2**32 - 1], np.uint32)
    for parts in (1, 3, 4096):
        number = np.resize(np.arange(parts, dtype=np.uint32), (len(index), parts)).ravel()
        whole = np.repeat(index, parts)
        padded = np.zeros((3, -(-len(whole) // 16) * 16), np.uint32)
        padded[0, : len(whole)], padded[1], padded[2, : len(whole)] = whole, parts, number
        seed, low = launch(device, "core_split", padded.view(np.float32), 2, 16)[:, : len(whole)]
        exact = whole.astype(np.uint64) * parts + number
        assert np.array_equal(low, exact.astype(np.uint32))
        assert len(set(zip(seed.tolist(), low.tolist(), strict=True))) == len(whole)
        assert (seed[exact < 2**32] == 77).all()
