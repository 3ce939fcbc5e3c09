"""Rough metals and glass that lose what meets a second facet, as other renderers have them: how much they return."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from material_support import Floats, chances, conductor, counted, dielectric, sampled, towards
from stats_support import Evidence

if TYPE_CHECKING:
    from clrender.device import Device

COUNT = 2**20
IOR = 1.5


def facet_normals(microfacets: str, alpha: float) -> Floats:
    """Normals (n, 3) as dense as D times their cosine, evenly spread (a rank-1 lattice)."""
    number = np.arange(COUNT)
    u, v = (number + 0.5) / COUNT, np.mod(number * 0.6180339887498949, 1.0)
    slope2 = -np.log(u) if microfacets == "beckmann" else (1.0 - u) / u
    z = 1.0 / np.sqrt(1.0 + alpha**2 * slope2)
    across, turn = np.sqrt(1.0 - z**2), 2.0 * math.pi * v
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)


def hidden(microfacets: str, alpha: float, cosine: Floats) -> Floats:
    """Smith's Λ."""
    a = np.abs(cosine) / (alpha * np.sqrt(np.maximum(1.0 - cosine**2, 1e-12)))
    if microfacets == "ggx":
        ggx: Floats = (np.sqrt(1.0 + 1.0 / a**2) - 1.0) / 2.0
        return ggx
    fit: Floats = np.where(a < 1.6, (1.0 - 1.259 * a + 0.396 * a**2) / (3.535 * a + 2.181 * a**2), 0.0)
    return fit


def fresnel(cosine: Floats, eta: float) -> Floats:
    beyond = np.sqrt(np.maximum(1.0 - (1.0 - cosine**2) / eta**2, 0.0))
    s, p = (cosine - eta * beyond) / (cosine + eta * beyond), (eta * cosine - beyond) / (eta * cosine + beyond)
    whole: Floats = (s**2 + p**2) / 2.0
    return whole


def returned(microfacets: str, alpha: float, wo: Floats, eta: float | None) -> float:
    """Share of the light along `wo` that mirrors as facets reflect once; or that those of glass let pass, too."""
    m = facet_normals(microfacets, alpha)
    facing = np.maximum(m @ wo, 0.0)
    there = facing > 1e-9
    m, facing = m[there], facing[there]
    weight = facing / (wo[2] * m[:, 2])
    out = 1.0 + hidden(microfacets, alpha, np.array(wo[2]))
    reflected = 2.0 * facing * m[:, 2] - wo[2]
    seen = np.where(reflected > 0.0, 1.0 / (out + hidden(microfacets, alpha, reflected)), 0.0)
    if eta is None:
        return float((weight * seen).sum()) / COUNT
    share, beyond2 = fresnel(facing, eta), 1.0 - (1.0 - facing**2) / eta**2
    passed = (facing / eta - np.sqrt(np.maximum(beyond2, 0.0))) * m[:, 2] - wo[2] / eta
    through = np.where(passed < 0.0, 1.0 / (out + hidden(microfacets, alpha, passed)), 0.0)
    share = np.where(beyond2 > 0.0, share, 1.0)
    return float((weight * (share * seen + (1.0 - share) * through)).sum()) / COUNT


FAST = {("ggx", 0.3), ("beckmann", 0.3)}
CASES = [
    pytest.param(kind, alpha, marks=() if (kind, alpha) in FAST else pytest.mark.slow)
    for kind in ("ggx", "beckmann")
    for alpha in (0.01, 0.1, 0.3, 0.7)
]


@pytest.mark.long
@pytest.mark.parametrize(("microfacets", "alpha"), CASES)
def test_what_facets_return_at_first(device: Device, microfacets: str, alpha: float) -> None:
    once = {"microfacets": microfacets, "multiple_scattering": False}
    cases: list[tuple[dict[str, Any], float | None, bool]] = [(conductor(alpha, **once), None, True)]
    cases += [(dielectric(alpha, IOR, **once), eta, front) for eta, front in ((IOR, True), (1.0 / IOR, False))]
    for number, (material, eta, front) in enumerate(cases):
        for angle in (0.0, 40.0, 70.0, 85.0):
            wo = towards(angle)
            _, weight, _ = sampled(device, material, wo, 700 + number, 2**18, front=front)
            mean, error = float(weight[:, 0].mean()), float(weight[:, 0].std()) / math.sqrt(len(weight))
            expected = returned(microfacets, alpha, wo, eta)
            print(f"{material['type']} {angle} {front}: {mean:.5f} +- {error:.5f}, expected {expected:.5f}")
            assert abs(mean - expected) <= 4.0 * error + 1e-4, (material["type"], angle, front)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["conductor", "dielectric"])
def test_directions_are_as_dense_as_the_density_says(evidence: Evidence, device: Device, kind: str) -> None:
    make = conductor if kind == "conductor" else dielectric
    material, cells = make(0.3, multiple_scattering=False), (80, 160)
    for angle in (10.0, 75.0):
        wo = towards(angle)
        wi, weight, _ = sampled(device, material, wo, 710, 2**20)
        expected = chances(device, material, wo, cells, 16)
        counts, lost = counted(wi, weight, cells)
        both = np.append(expected.ravel(), max(1.0 - expected.sum(), 0.0))
        evidence.histogram(f"{kind}, {angle}", np.append(counts, lost), both / both.sum())


def test_beckmann_weighs_no_sample_much(device: Device) -> None:
    """Facets are chosen by GGX: its tails are longer, so the weights stay below 2.5."""
    for alpha in (0.01, 0.3, 1.0):
        for angle in (0.0, 60.0, 85.0):
            material = conductor(alpha, microfacets="beckmann", multiple_scattering=False)
            _, weight, _ = sampled(device, material, towards(angle), 720, 2**16)
            assert weight.max() < 2.5, (alpha, angle)
