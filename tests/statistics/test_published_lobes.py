"""Lobes against what other renderers test theirs with; the numbers are restated here.

Sources: the tables of Mitsuba 3 (src/render/tests/test_microfacet.py), and the configurations of the χ² tests of
pbrt-v4 (bxdfs_test.cpp) and of Mitsuba 3 (src/bsdfs/tests), as far as they are of GGX.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from material_support import (
    LANES,
    SOURCE,
    Floats,
    chances,
    conductor,
    counted,
    dielectric,
    oren_nayar,
    principled,
    sampled,
)
from stats_support import Evidence

if TYPE_CHECKING:
    from clrender.device import Device

# alpha is 0.1 along x and 0.3 along y, or 0.1 along both
G1_ANGLES = np.linspace(math.pi / 3.0, math.pi / 2.0, 20)
"""From the normal, towards y."""
G1_TURNED = """0.94031686 0.93310797 0.92485082 0.91534841 0.90435863 0.89158219 0.8766489 0.85909742
0.83835226 0.8136934 0.78421932 0.74880326 0.70604056 0.65419233 0.59112519 0.51425743
0.42051861 0.30633566 0.16765384 1.0861372e-06"""
G1_EVEN = """0.99261039 0.99160647 0.99042398 0.98901933 0.98733366 0.98528832 0.98277503 0.97964239
0.97567332 0.97054905 0.9637875 0.95463598 0.94187391 0.92344058 0.8956942 0.85189372
0.77902949 0.65144652 0.41989169 3.2584082e-06"""
TURNS = np.linspace(0.0, 2.0 * math.pi, 20)
"""Around the normal, 1.53938 from it."""
G1_TURNS = """0.46130955 0.36801264 0.26822716 0.21645154 0.19341162 0.18922243 0.20219423 0.23769052
0.31108665 0.43013984 0.43013984 0.31108665 0.23769052 0.20219423 0.18922243 0.19341162
0.21645154 0.26822716 0.36801264 0.46130955"""
NORMALS = [
    *([0.0, 0.0, 1.0], [0.044676583, 0.0, 0.9990015], [0.070534222, 0.0, 0.99750936]),
    *([0.099504232, 0.0, 0.99503714], [0.14002767, 0.0, 0.99014759], [0.21821797, 0.0, 0.97590005]),
    *([0.022205815, 0.11538482, 0.99307263], [0.034752376, 0.18057868, 0.9829464]),
    *(
        [0.048336815, 0.25116551, 0.9667365],
        [0.066226624, 0.34412369, 0.93658578],
        [0.096225053, 0.50000012, 0.86066288],
    ),
]
D_TIMES_COSINE = """10.610329 7.390399 4.751113 2.6924708 1.214469 0.3171101
7.5235577 4.965429 2.9359221 1.4349725 0.46230313"""


def numbers(text: str) -> Floats:
    return np.array([float(word) for word in text.split()])


def facets(device: Device, along: Floats, alpha: tuple[float, float], beckmann: bool = False) -> tuple[Floats, Floats]:
    """D and G1 of directions (n, 3)."""
    count = -(-len(along) // 256) * 256
    padded = np.concatenate([along, np.tile([[0.0, 0.0, 1.0]], (count - len(along), 1))]).T.astype(np.float32)
    buffers = [device.upload(np.ascontiguousarray(padded)), device.empty(8 * count)]
    given: list[Any] = [
        buffers[0],
        np.array([*alpha, 0.0, 0.0], np.float32),
        np.uint32(beckmann),
        np.uint32(count),
        buffers[1],
    ]
    device.launch(device.program(SOURCE, {"LANES": LANES}), "material_facets", count // LANES, 16, given)
    out = np.empty((2, count), np.float32)
    device.read(buffers[1], out)
    for buffer in buffers:
        device.release(buffer)
    return out[0, : len(along)].astype(np.float64), out[1, : len(along)].astype(np.float64)


def test_mitsuba_microfacets(device: Device) -> None:
    towards_y = np.stack([0.0 * G1_ANGLES, np.sin(G1_ANGLES), np.cos(G1_ANGLES)], axis=1)
    np.testing.assert_allclose(facets(device, towards_y, (0.1, 0.3))[1], numbers(G1_TURNED), atol=1e-5)
    np.testing.assert_allclose(facets(device, towards_y, (0.1, 0.1))[1], numbers(G1_EVEN), atol=1e-5)
    tilt = 1.5393804002589986
    around = np.stack([np.sin(tilt) * np.cos(TURNS), np.sin(tilt) * np.sin(TURNS), np.full(20, np.cos(tilt))], axis=1)
    np.testing.assert_allclose(facets(device, around, (0.1, 0.3))[1], numbers(G1_TURNS), atol=1e-5)
    np.testing.assert_allclose(facets(device, around, (0.1, 0.1))[1], 0.46130955, atol=1e-5)
    m = np.array(NORMALS)
    density = 1.0 / (0.03 * math.pi * ((m[:, 0] / 0.1) ** 2 + (m[:, 1] / 0.3) ** 2 + m[:, 2] ** 2) ** 2)
    np.testing.assert_allclose(facets(device, m, (0.1, 0.3))[0], density, rtol=1e-6)
    # Of the table itself single precision has left the exact density by 1.05e-5 in one place
    np.testing.assert_allclose(density * m[:, 2], numbers(D_TIMES_COSINE), rtol=1.1e-5)


def test_beckmanns_facets(device: Device) -> None:
    """Against the formulas of Walter et al. (EGSR 2007, eq. 25, and its Λ before it was fitted)."""
    tilts = np.linspace(0.0, 1.57, 200)
    across = np.sin(tilts)
    m = np.stack([across * math.cos(0.4), across * math.sin(0.4), np.cos(tilts)], axis=1)
    m = m.astype(np.float32).astype(np.float64)
    x, y, z = m.T
    for alpha in ((0.1, 0.1), (0.05, 0.3), (1.0, 1.0)):
        density, seen = facets(device, m, alpha, beckmann=True)
        slope2 = ((x / alpha[0]) ** 2 + (y / alpha[1]) ** 2) / z**2
        expected = np.exp(-slope2) / (math.pi * alpha[0] * alpha[1] * z**4)
        there = slope2 < 40.0
        # The exponent's rounding errors are as large as it is
        np.testing.assert_allclose(density[there], expected[there], rtol=2e-5)
        assert (density[slope2 > 90.0] == 0.0).all()
        a = z[1:] / np.hypot(alpha[0] * x, alpha[1] * y)[1:]
        hidden = np.array([(math.erf(b) - 1.0) / 2.0 + math.exp(-b * b) / (2.0 * b * math.sqrt(math.pi)) for b in a])
        np.testing.assert_allclose(seen[1:], 1.0 / (1.0 + hidden), rtol=4e-3, atol=1e-6)


def turned(x: float, y: float) -> dict[str, Any]:
    """The parameters that make alpha x along x and y along y, x the larger."""
    return {"alpha": y, "anisotropy": math.sqrt((x - y) / (1.0 - y))}


def glass(alpha: float, **of: Any) -> dict[str, Any]:
    return principled(alpha, ior=1.5, transmission=1.0, **of)


GGX5, X3, Y15 = math.sqrt(0.5), math.sqrt(0.3), math.sqrt(0.15)
SOME: dict[str, Any] = {"eta": [2.0] * 3, "k": [4.0] * 3}
PBRT: dict[str, tuple[dict[str, Any], bool]] = {
    "Lambertian": (oren_nayar(0.0), True),
    "conductor, rough 0.5": (conductor(GGX5, **SOME), True),
    "conductor, rough 0.3 and 0.15": (conductor(**turned(X3, Y15), **SOME), True),
    "dielectric 1.5, rough 0.5": (dielectric(GGX5), True),
    "dielectric 1.5, rough 0.3 and 0.15": (glass(**turned(X3, Y15)), True),
    "dielectric 1/1.5, rough 0.5": (dielectric(GGX5), False),
    "dielectric 1/1.5, rough 0.3 and 0.15": (glass(**turned(X3, Y15)), False),
}
MITSUBA: dict[str, tuple[dict[str, Any], bool, tuple[float, float, float]]] = {
    "conductor 0.05": (conductor(0.05, **SOME), True, (1.0, 1.0, 1.0)),
    "conductor 0.2 and 0.05": (conductor(**turned(0.2, 0.05), **SOME), True, (1.0, 1.0, 1.0)),
    "dielectric 0.5, grazing": (dielectric(0.5), True, (0.8, 0.3, 0.05)),
    "dielectric 0.5, at 45": (dielectric(0.5), True, (0.5, 0.0, 0.5)),
    "dielectric 0.5, horizontal": (dielectric(0.5), True, (0.5, 0.5, 0.001)),
    "dielectric 0.5, from inside": (dielectric(0.5), False, (0.2, -0.6, 0.5)),
    "dielectric 0.5, total reflection": (dielectric(0.5), False, (0.8, 0.3, 0.05)),
    **{
        f"conductor {alpha} at {angle}": (
            conductor(alpha, **SOME),
            True,
            (math.sin(math.radians(angle)), 0.0, math.cos(math.radians(angle))),
        )
        for alpha in (0.125, 0.5)
        for angle in (15, 30, 80)
    },
}


def judge(evidence: Evidence, device: Device, name: str, material: dict[str, Any], front: bool, wo: Floats) -> None:
    """χ² over pbrt's cells: 80 over the cosine, 160 around; a million samples.

    Of a horizontal direction the density is steep at the horizon, and is integrated over more points.
    """
    cells = (80, 160)
    wi, weight, _ = sampled(device, material, wo, 900, 2**20, front=front)
    expected = chances(device, material, wo, cells, 16 if wo[2] > 0.01 else 48, front=front)
    counts, lost = counted(wi, weight, cells)
    both = np.append(expected.ravel(), max(1.0 - expected.sum(), 0.0))
    evidence.histogram(name, np.append(counts, lost), both / both.sum())


@pytest.mark.slow
@pytest.mark.parametrize("name", PBRT)
def test_pbrt_chi_square(evidence: Evidence, device: Device, name: str) -> None:
    """Five random directions each."""
    material, front = PBRT[name]
    rng = np.random.default_rng(list(PBRT).index(name))
    for number in range(5):
        wo = rng.normal(size=3)
        wo[2] = abs(wo[2])
        judge(evidence, device, f"{name}, {number}", material, front, wo / np.linalg.norm(wo))


@pytest.mark.slow
@pytest.mark.parametrize("name", MITSUBA)
def test_mitsuba_chi_square(evidence: Evidence, device: Device, name: str) -> None:
    material, front, wo = MITSUBA[name]
    judge(evidence, device, name, material, front, np.array(wo) / np.linalg.norm(wo))
