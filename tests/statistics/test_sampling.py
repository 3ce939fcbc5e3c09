"""Every sampled distribution against its density, and the sequence behind it: chi-squared over cells, nets counted out.

Cells are chosen in coordinates in which the distribution is even, by float64 formulas of this file's own, so a cell's
probability is exact. The density is compared with its formula sample by sample.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
from exact import fresnel, refracted_cosine
from render_support import disk, quad, scene, sphere, triangle
from sampling_support import COUNT, LightTable, launch, random_bits
from stats_support import Evidence

from clrender import layout

if TYPE_CHECKING:
    from clrender.device import Device

Floats = npt.NDArray[np.float64]
Uints = npt.NDArray[np.uint32]

CELLS = 24


def even(evidence: Evidence, name: str, a: Floats, b: Floats, cells: int = CELLS) -> None:
    """Pairs from the unit square are evenly distributed; those on its rim by a rounding count as inside."""
    assert a.min() > -1e-5 and a.max() < 1 + 1e-5 and b.min() > -1e-5 and b.max() < 1 + 1e-5, name
    x = np.clip((a * cells).astype(np.int64), 0, cells - 1)
    y = np.clip((b * cells).astype(np.int64), 0, cells - 1)
    counts = np.bincount(x * cells + y, minlength=cells * cells).reshape(cells, cells)
    evidence.histogram(name, counts, np.full((cells, cells), 1.0 / cells**2))


def turns(x: Floats, y: Floats) -> Floats:
    """Angle around z, in turns from 0 to 1."""
    return np.mod(np.arctan2(y, x) / (2.0 * math.pi), 1.0)


def warp(device: Device, which: int, setting: float = 0.0) -> tuple[Floats, Floats, Floats, Floats]:
    """Sample, (x, y, z), and density."""
    out = launch(device, "sampling_warp", random_bits(which), [np.uint32(which), np.float32(setting)], 4)
    x, y, z, pdf = out.astype(np.float64)
    return x, y, z, pdf


def test_disk(evidence: Evidence, device: Device) -> None:
    x, y, _, _ = warp(device, 0)
    even(evidence, "disk", x * x + y * y, turns(x, y))


def test_cosine_hemisphere(evidence: Evidence, device: Device) -> None:
    x, y, z, pdf = warp(device, 1)
    np.testing.assert_allclose(x * x + y * y + z * z, 1.0, atol=1e-6)
    np.testing.assert_allclose(pdf, z / math.pi, rtol=1e-6)
    assert z.min() >= 0.0
    even(evidence, "hemisphere", x * x + y * y, turns(x, y))


def test_whole_sphere(evidence: Evidence, device: Device) -> None:
    x, y, z, pdf = warp(device, 2)
    np.testing.assert_allclose(x * x + y * y + z * z, 1.0, atol=1e-6)
    np.testing.assert_allclose(pdf, 1.0 / (4.0 * math.pi), rtol=1e-6)
    even(evidence, "sphere", (1.0 - z) / 2.0, turns(x, y))


@pytest.mark.parametrize("spread", [1e-12, 1e-6, 0.1, 1.0, 2.0])
def test_cone(evidence: Evidence, device: Device, spread: float) -> None:
    # From the sine, because a narrow cone's cosine has no digits left.
    x, y, z, pdf = warp(device, 3, spread)
    np.testing.assert_allclose(x * x + y * y + z * z, 1.0, atol=1e-6)
    np.testing.assert_allclose(pdf, 1.0 / (2.0 * math.pi * spread), rtol=1e-6)
    sine2 = x * x + y * y
    drop = np.where(z > 0.0, sine2 / (1.0 + np.sqrt(np.maximum(1.0 - sine2, 0.0))), 1.0 - z)
    even(evidence, "cone", drop / spread, turns(x, y))


def test_triangle(evidence: Evidence, device: Device) -> None:
    # Barycentric weights (b, c): 1 - a with density 2 (1 - a), and c / (1 - a) even.
    b, c, _, _ = warp(device, 4)
    assert b.min() >= 0.0 and c.min() >= 0.0 and (b + c).max() <= 1.0
    both = b + c
    even(evidence, "triangle", both**2, c / np.where(both > 0.0, both, 1.0))


@pytest.mark.parametrize("g", [-0.99, -0.5, -1e-3, 0.0, 9e-4, 2e-3, 0.3, 0.9, 0.99])
def test_phase_function(evidence: Evidence, device: Device, g: float) -> None:
    """Henyey and Greenstein's: its distribution in closed form, and its density."""
    x, y, z, pdf = warp(device, 5, g)
    np.testing.assert_allclose(x * x + y * y + z * z, 1.0, atol=2e-6)
    spread = 1.0 + g * g - 2.0 * g * z
    # Cosines are known to 2^-24, and the density's argument to g times that
    exact = (1.0 - g * g) / (4.0 * math.pi * spread**1.5)
    assert (np.abs(pdf / exact - 1.0) < 1e-5 + 3.0 * abs(g) * 2.0**-23 / spread).all()
    below = (1.0 + z) / 2.0 if g == 0.0 else (1.0 - g * g) / (2.0 * g) * (1.0 / np.sqrt(spread) - 1.0 / (1.0 + g))
    even(evidence, "phase function", below, turns(x, y))


DIRECTIONS = {
    "straight": (0.0, 0.0, -1.0),
    "aslant": (0.6, -0.3, -0.8),
    "grazing": (1.0, 0.2, -0.02),
}


def bsdf(
    device: Device, kind: int, toward: tuple[float, ...], ior: float = 1.0, front: bool = True, shading: Any = (0, 0, 1)
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Directions (n, 3), weights (n, 3), densities, and f |cos| (n, 3) and density as evaluated."""

    def four(vector: Any) -> npt.NDArray[np.float32]:
        unit = np.asarray(vector, np.float64) / np.linalg.norm(vector)
        return np.array([*unit, 0.0], np.float32)

    arguments = [np.uint32(kind), np.float32(ior), np.uint32(front), four(shading), four(toward)]
    out = launch(device, "sampling_bsdf", random_bits(50 + kind), arguments, 11).astype(np.float64)
    return out[:3].T, out[3:6].T, out[6], out[7:10].T, out[10]


@pytest.mark.parametrize("shading", [(0, 0, 1), (0.3, 0.1, 1)], ids=["flat", "smooth"])
@pytest.mark.parametrize("toward", DIRECTIONS)
def test_lambert(evidence: Evidence, device: Device, toward: str, shading: tuple[float, ...]) -> None:
    wi, weight, pdf, f, evaluated = bsdf(device, layout.MATERIAL_LAMBERT, DIRECTIONS[toward], shading=shading)
    normal = np.asarray(shading, np.float64) / np.linalg.norm(shading)
    cosine = wi @ normal
    np.testing.assert_allclose((wi**2).sum(1), 1.0, atol=1e-6)
    np.testing.assert_allclose(pdf, cosine / math.pi, rtol=1e-5, atol=1e-6)
    # Around the shading normal, by a frame of this test's own.
    side = np.cross(normal, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    even(evidence, "directions", 1.0 - cosine**2, turns(wi @ side, wi @ np.cross(normal, side)))
    # What is below the geometry carries nothing; elsewhere the weight is f |cos| / pdf, and the density what is said.
    above = wi[:, 2] > 0.0
    assert not weight[~above].any() and not f[~above].any() and not evaluated[~above].any()
    np.testing.assert_allclose(weight[above], np.broadcast_to([0.5, 0.25, 1.0], weight[above].shape), rtol=1e-6)
    # The direction went through a frame and back, so near the horizon the cosine is known to a few roundings of 1.
    np.testing.assert_allclose(evaluated[above], pdf[above], rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(f[above], weight[above] * pdf[above, None], rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("toward", DIRECTIONS)
def test_mirror(device: Device, toward: str) -> None:
    wi, weight, pdf, f, evaluated = bsdf(device, layout.MATERIAL_MIRROR, DIRECTIONS[toward])
    direction = np.asarray(DIRECTIONS[toward]) / np.linalg.norm(DIRECTIONS[toward])
    np.testing.assert_allclose(wi, np.broadcast_to(direction * [1, 1, -1], wi.shape), atol=3e-7)
    assert (weight == [0.5, 0.25, 1.0]).all()
    assert not pdf.any() and not f.any() and not evaluated.any()


@pytest.mark.thorough
@pytest.mark.parametrize("front", [True, False])
@pytest.mark.parametrize("ior", [1.5, 2.4, 0.75])
@pytest.mark.parametrize("degrees", [0.0, 30.0, 41.0, 56.3, 80.0, 89.5])
def test_dielectric(evidence: Evidence, device: Device, degrees: float, ior: float, front: bool) -> None:
    """How often light is reflected, where the rest goes, and that radiance is squeezed by the square of the index."""
    turn = math.radians(degrees)
    side = 1.0 if front else -1.0
    toward = (math.sin(turn) * 0.6, math.sin(turn) * 0.8, -math.cos(turn) * side)
    wi, weight, pdf, f, _ = bsdf(device, layout.MATERIAL_DIELECTRIC, toward, ior, front)
    assert not pdf.any() and not f.any()
    eta = ior if front else 1.0 / ior
    share = float(fresnel(math.cos(turn), eta))
    reflected = wi[:, 2] * side > 0.0
    evidence.share("reflected", int(reflected.sum()), len(reflected), share)
    np.testing.assert_allclose(wi[reflected], np.broadcast_to([toward[0], toward[1], -toward[2]], wi.shape)[reflected],
                               atol=5e-7)  # fmt: skip
    assert (weight[reflected] == [0.5, 0.25, 1.0]).all()
    through = ~reflected
    if share < 1.0:
        cosine = float(refracted_cosine(math.cos(turn), eta))
        # The sine is right to some roundings, so a small cosine is right to their square root.
        np.testing.assert_allclose(wi[through][:, :2], np.broadcast_to(np.array(toward[:2]) / eta, (through.sum(), 2)),
                                   atol=5e-7)  # fmt: skip
        np.testing.assert_allclose(wi[through][:, 2], -cosine * side, atol=5e-7 / max(cosine, 1e-3))
        expected = np.array([0.5, 0.25, 1.0]) / eta**2
        np.testing.assert_allclose(weight[through], np.broadcast_to(expected, weight[through].shape), rtol=1e-6)
    else:
        assert not through.any()


ORIGINS = [(0.0, 0.0, 0.0), (0.4, 0.1, -0.3), (3.0, 0.2, 1.0), (-40.0, 5.0, 20.0)]
TRIANGLE = np.array([[-0.4, 1.0, 0.5], [0.6, 1.2, 0.4], [0.1, 0.9, -0.7]])


def agree(first: Floats, second: Floats, usable: npt.NDArray[np.bool_]) -> None:
    """The density of a sample is the one that a ray which finds it by chance is told."""
    assert usable.mean() > 0.99
    np.testing.assert_allclose(first[usable], second[usable], rtol=2e-4)


@pytest.mark.long
@pytest.mark.parametrize("origin", ORIGINS, ids=str)
def test_triangle_light(evidence: Evidence, device: Device, origin: tuple[float, ...]) -> None:
    a, b, c = TRIANGLE
    away = np.cross(b - a, c - a) @ (a - np.array(origin)) > 0.0
    table = LightTable(device, scene([triangle(TRIANGLE.tolist(), emission=1.0, flip_normals=bool(away))]))
    wi, pdf, on, met, found, off = table.sample(origin)
    assert (on == 0).all() and (met == 0).mean() > 0.999, "rays hit what was sampled, but for its very edge"
    normal = np.cross(b - a, c - a)
    area, normal = np.linalg.norm(normal) / 2.0, normal / np.linalg.norm(normal)
    distance = (a - np.array(origin)) @ normal / (wi @ normal)
    np.testing.assert_allclose(pdf, distance**2 / np.abs(wi @ normal) / area, rtol=1e-4)
    agree(pdf, found, met == 0)
    assert off[met == 0].max() < 1e-4
    point = np.array(origin) + wi * distance[:, None]
    weights = np.linalg.lstsq(np.stack([b - a, c - a], 1), (point - a).T, rcond=None)[0]
    both = weights.sum(0)
    even(evidence, "points", both**2, weights[1] / np.where(both > 0.0, both, 1.0))


@pytest.mark.long
@pytest.mark.parametrize("origin", ORIGINS, ids=str)
def test_disk_light(evidence: Evidence, device: Device, origin: tuple[float, ...]) -> None:
    center, normal, radius = np.array([0.2, 1.5, 0.1]), np.array([0.3, -1.0, 0.2]), 0.7
    normal /= np.linalg.norm(normal)
    facing = normal @ (np.array(origin) - center) > 0.0
    shape = disk(center.tolist(), (normal if facing else -normal).tolist(), radius, emission=1.0)
    wi, pdf, on, met, found, off = LightTable(device, scene([shape])).sample(origin)
    assert (on == 0).all() and (met == 0).mean() > 0.999
    distance = (center - np.array(origin)) @ normal / (wi @ normal)
    np.testing.assert_allclose(pdf, distance**2 / np.abs(wi @ normal) / (math.pi * radius**2), rtol=1e-4)
    agree(pdf, found, met == 0)
    assert off[met == 0].max() < 1e-4
    from_center = np.array(origin) + wi * distance[:, None] - center
    side = np.cross(normal, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    share = (from_center**2).sum(1) / radius**2
    even(evidence, "points", share, turns(from_center @ side, from_center @ np.cross(normal, side)))


@pytest.mark.parametrize("origin", [*ORIGINS, (0.2, 0.8, 0.1)], ids=str)
def test_sphere_light(evidence: Evidence, device: Device, origin: tuple[float, ...]) -> None:
    center, radius = np.array([0.2, 1.5, 0.1]), 0.6999
    wi, pdf, on, met, found, _ = LightTable(device, scene([sphere(center.tolist(), radius, emission=1.0)])).sample(
        origin
    )
    assert (on == 0).all() and (met == 0).mean() > 0.99, "but for the rim"
    axis = center - np.array(origin)
    distance = np.linalg.norm(axis)
    axis /= distance
    sine2 = np.float64(np.float32(radius)) ** 2 / distance**2
    spread = sine2 / (1.0 + math.sqrt(1.0 - sine2))
    np.testing.assert_allclose(pdf, 1.0 / (2.0 * math.pi * spread), rtol=5e-3 if sine2 > 0.999 else 1e-4)
    agree(pdf, found, met == 0)
    side = np.cross(axis, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    x, y = wi @ side, wi @ np.cross(axis, side)
    sines = x * x + y * y
    drop = np.where(wi @ axis > 0.0, sines / (1.0 + np.sqrt(np.maximum(1.0 - sines, 0.0))), 1.0 - wi @ axis)
    # Seen from ten thousandths of a radius away the cone's width has lost digits, so cells are coarser there.
    tight = sine2 > 0.999
    even(
        evidence,
        "directions",
        np.minimum(drop / spread, 1.0) if tight else drop / spread,
        turns(x, y),
        8 if tight else CELLS,
    )


@pytest.mark.parametrize("origin", [(0.2, 1.5, 0.1), (0.4, 1.2, 0.3)], ids=str)
def test_sphere_light_from_inside(evidence: Evidence, device: Device, origin: tuple[float, ...]) -> None:
    center, radius = np.array([0.2, 1.5, 0.1]), 0.7
    shape = sphere(center.tolist(), radius, emission=1.0, flip_normals=True)
    wi, pdf, on, met, found, off = LightTable(device, scene([shape])).sample(origin)
    assert (on == 0).all() and (met == 0).all()
    assert off.max() < 1e-4
    agree(pdf, found, met == 0)
    # The point where the direction leaves the sphere is even by area.
    to = np.array(origin) - center
    along = -(wi @ to) + np.sqrt((wi @ to) ** 2 + radius**2 - to @ to)
    outward = (to + wi * along[:, None]) / radius
    np.testing.assert_allclose(pdf, along**2 / (wi * outward).sum(1) / (4.0 * math.pi * radius**2), rtol=1e-4)
    even(evidence, "points", (1.0 - outward[:, 2]) / 2.0, turns(outward[:, 0], outward[:, 1]))


def test_environment_light(evidence: Evidence, device: Device) -> None:
    table = LightTable(
        device, scene([quad([9, 9, 9], [1, 0, 0], [0, 1, 0])], [{"type": "environment", "radiance": [1.0, 1.0, 1.0]}])
    )
    wi, pdf, on, met, found, _ = table.sample((0.0, 0.0, 0.0))
    assert (on == layout.NONE).all()
    np.testing.assert_allclose(pdf, 1.0 / (4.0 * math.pi), rtol=1e-6)
    agree(pdf, found, met == layout.NONE)
    even(evidence, "directions", (1.0 - wi[:, 2]) / 2.0, turns(wi[:, 0], wi[:, 1]))


@pytest.mark.parametrize("count", [2, 7, 1000])
def test_lights_are_chosen_by_their_share(evidence: Evidence, device: Device, count: int) -> None:
    """Of very different power, each as often as its density says; the number is as good as new for the point on it."""
    rng = np.random.default_rng(count)
    emission = 10.0 ** rng.uniform(-2.0, 2.0, count)
    places = np.stack([np.cos(np.arange(count)), np.sin(np.arange(count)), np.arange(count) / count], 1) * 5.0
    shapes = [sphere(p.tolist(), 1e-3, emission=e) for p, e in zip(places, emission.tolist(), strict=True)]
    wi, _, on, _, _, _ = LightTable(device, scene(shapes), "power").sample((0.0, 0.0, 0.0))
    shares = emission / emission.sum()
    assert on.max() < count
    order = np.argsort(-shares)
    seen = np.bincount(on, minlength=count)
    evidence.histogram("lights", seen[order], shares[order])
    brightest = int(order[0])
    here = wi[on == brightest]
    axis = places[brightest] / np.linalg.norm(places[brightest])
    side = np.cross(axis, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    # Directions are kept in single precision: across so small a light not enough digits for the angle, so parts.
    around = turns(here @ side, here @ np.cross(axis, side))
    evidence.histogram("parts", np.bincount((around * 8).astype(int) % 8, minlength=8), np.full(8, 1.0 / 8.0))


def sequence(
    device: Device, pixels: npt.ArrayLike, samples: npt.ArrayLike, set_: int, stratified: bool = True
) -> Uints:
    """(2, n) bits."""
    numbers = np.stack(np.broadcast_arrays(np.asarray(pixels, np.uint32), np.asarray(samples, np.uint32)))
    arguments = [np.uint32(3), np.uint32(set_), np.uint32(stratified)]
    return launch(device, "sampling_sequence", numbers, arguments, 2).view(np.uint32)


@pytest.mark.parametrize("set_", [0, 1, 2, 3, 11])
def test_samples_are_nets(device: Device, set_: int) -> None:
    """Any aligned block of 2^m samples of a pixel is a (0, m, 2)-net: one in every elementary interval."""
    for m in (1, 4, 8, 10):
        blocks = 4096 >> m
        for pixel in (0, 1, 640_000):
            a, b = sequence(device, pixel, np.arange(4096), set_)
            for k in range(m + 1):
                across = (a >> np.uint32(32 - k) if k else np.zeros_like(a)).astype(np.int64)
                down = (b >> np.uint32(32 - (m - k)) if m > k else np.zeros_like(b)).astype(np.int64)
                block = np.arange(4096) >> m
                cell = (block << m) + (across << (m - k)) + down
                assert (np.bincount(cell, minlength=blocks << m) == 1).all(), f"2^{m} samples, 2^{k} columns"


@pytest.mark.parametrize("stratified", [True, False], ids=["sequence", "hash"])
def test_first_samples_of_pixels_are_even(evidence: Evidence, device: Device, stratified: bool) -> None:
    """Scrambled independently: over pixels, one sample of each fills the square by chance, and so do two dimensions."""
    for sample in (0, 1, 77):
        bits = sequence(device, np.arange(COUNT), sample, 2, stratified)
        a, b = bits.astype(np.float64) / 2.0**32
        even(evidence, f"sample {sample}", a, b, 48)
        low = (bits & np.uint32(0xFFFF)).astype(np.float64) / 65536.0
        even(evidence, f"sample {sample}, low bits", low[0], low[1], 48)


@pytest.mark.parametrize("stratified", [True, False], ids=["sequence", "hash"])
def test_sets_and_pixels_have_nothing_in_common(evidence: Evidence, device: Device, stratified: bool) -> None:
    pixels = np.arange(COUNT)
    first = sequence(device, pixels, 5, 2, stratified) / 2.0**32
    for name, other in {
        **{f"set {other}": sequence(device, pixels, 5, other, stratified) for other in (0, 3, 4, 5, 8, 18, 34)},
        "next pixel": sequence(device, pixels + 1, 5, 2, stratified),
        "next row": sequence(device, pixels + 800, 5, 2, stratified),
    }.items():
        for k in range(2):
            even(evidence, f"{name}, {k}", first[0], other[k] / 2.0**32, 32)
            even(evidence, f"{name}, {k}'", first[1], other[k] / 2.0**32, 32)


def test_hashed_samples_of_one_pixel_are_even(evidence: Evidence, device: Device) -> None:
    bits = sequence(device, 1234, np.arange(COUNT), 40, stratified=False) / 2.0**32
    even(evidence, "both numbers", bits[0], bits[1], 48)
    even(evidence, "one after the other", bits[0][::2], bits[0][1::2], 48)
