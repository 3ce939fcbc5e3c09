"""Rough materials: white ones send all light back, all are reciprocal, and are sampled as their density says."""

from __future__ import annotations

import math
import runpy
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
from render_support import disk, scene, sphere
from sampling_support import random_bits
from stats_support import Evidence

import clrender
from clrender.flatten import flatten
from clrender.scene.microfacets import METALS, fresnel, ggx_albedos

if TYPE_CHECKING:
    from clrender.device import Device

Floats = npt.NDArray[np.float64]

SOURCE = Path(__file__).resolve().with_name("materials.cl")
LANES = 16
WHITE_METAL = {"eta": [1e-3] * 3, "k": [1000.0] * 3}
"""It reflects all but 4e-9 of the light."""
ANGLES = (0.0, 30.0, 60.0, 75.0, 85.0, 89.0)


def oren_nayar(roughness: float, reflectance: float = 1.0) -> dict[str, Any]:
    return {"type": "oren_nayar", "reflectance": [reflectance] * 3, "roughness": roughness}


def conductor(alpha: float, **of: Any) -> dict[str, Any]:
    return {"type": "conductor", "roughness": math.sqrt(alpha), **(of or WHITE_METAL)}


ROUGH = {
    **{f"oren_nayar {r}": oren_nayar(r) for r in (0.0, 0.1, 0.5, 1.0)},
    **{f"conductor {a}": conductor(a) for a in (0.0012, 0.01, 0.05, 0.1, 0.25, 0.5, 0.75, 1.0)},
}


def towards(degrees: float, turn: float = 0.1) -> Floats:
    """A unit vector so far from z."""
    tilt, around = math.radians(degrees), 2.0 * math.pi * turn
    return np.array([math.sin(tilt) * math.cos(around), math.sin(tilt) * math.sin(around), math.cos(tilt)])


def four(vector: Floats) -> npt.NDArray[np.float32]:
    """As a kernel's float4."""
    return np.append(vector, 0.0).astype(np.float32)


def run(
    device: Device, kernel: str, material: dict[str, Any], numbers: npt.NDArray[Any], outputs: int, *more: Any
) -> Floats:
    """(outputs, count) results of a kernel of materials.cl."""
    flat = flatten(scene([sphere([0, 0, 0], 1, material="m")], m=material), 8, 8)
    row, count = flat.arrays["materials"][0], numbers.shape[1]
    buffers = [
        device.upload(np.ascontiguousarray(array))
        for array in (numbers, flat.arrays["material_rows"], flat.arrays["ggx_albedo"])
    ]
    results = device.empty(4 * outputs * count)
    given = [*buffers, np.uint32(row["kind"]), row["color"].astype(np.float32), *more, np.uint32(count), results]
    device.launch(device.program(SOURCE, {"LANES": LANES}), kernel, count // LANES, 16, given)
    out = np.empty((outputs, count), np.float32)
    device.read(results, out)
    for buffer in (*buffers, results):
        device.release(buffer)
    return out.astype(np.float64)


def sampled(device: Device, material: dict[str, Any], wo: Floats, seed: int) -> tuple[Floats, Floats, Floats]:
    """Directions (n, 3), weights of the first colour, and densities."""
    out = run(device, "material_sample", material, random_bits(seed), 7, four(wo))
    return out[:3].T, out[3], out[6]


def evaluated(device: Device, material: dict[str, Any], wo: Floats, wi: Floats) -> tuple[Floats, Floats]:
    """f |cosθ| (n, 3), and densities; `wo` and `wi` are (n, 3)."""
    out = run(device, "material_eval", material, np.concatenate([wo.T, wi.T]).astype(np.float32), 4)
    return out[:3].T, out[3]


def test_white_surfaces_send_all_light_back(device: Device) -> None:
    """Within 1e-3, which the fits of both albedos cost, and three standard errors."""
    for seed, (name, material) in enumerate(ROUGH.items()):
        for angle in ANGLES:
            _, weight, _ = sampled(device, material, towards(angle), 500 + seed)
            error = weight.std() / math.sqrt(len(weight))
            print(f"{name} at {angle}: {weight.mean():.5f} +- {error:.5f}")
            assert abs(weight.mean() - 1.0) <= 1e-3 + 3.0 * error, (name, angle)


@pytest.mark.parametrize("name", ROUGH)
def test_reciprocity(device: Device, name: str) -> None:
    rng = np.random.default_rng(510)
    both = rng.normal(size=(2, 4096, 3))
    both[:, :, 2] = np.abs(both[:, :, 2]) + 1e-3
    wo, wi = (both / np.linalg.norm(both, axis=2, keepdims=True)).astype(np.float32).astype(np.float64)
    forth, _ = evaluated(device, ROUGH[name], wo, wi)
    back, _ = evaluated(device, ROUGH[name], wi, wo)
    np.testing.assert_allclose(forth / wi[:, 2:], back / wo[:, 2:], rtol=1e-4)


def chances(device: Device, material: dict[str, Any], wo: Floats, cells: int, fine: int) -> Floats:
    """Integral of the density over cells that are even in cos² and in the angle around z."""
    steps = cells * fine
    at = (np.arange(steps) + 0.5) / steps
    cos2, turn = np.meshgrid(at, at, indexing="ij")
    cosine, sine = np.sqrt(cos2).ravel(), np.sqrt(1.0 - cos2).ravel()
    around = 2.0 * math.pi * turn.ravel()
    wi = np.stack([sine * np.cos(around), sine * np.sin(around), cosine], axis=1)
    _, pdf = evaluated(device, material, np.broadcast_to(wo, wi.shape), wi)
    # Solid angle: d(cos²) dφ = 2 cosθ dω
    parts = pdf / (2.0 * cosine) * (2.0 * math.pi) / steps**2
    sums: Floats = parts.reshape(cells, fine, cells, fine).sum(axis=(1, 3))
    return sums


@pytest.mark.parametrize("angle", [0.0, 40.0, 75.0])
@pytest.mark.parametrize("name", ["oren_nayar 1.0", "conductor 0.25", "conductor 0.5", "conductor 1.0"])
def test_directions_follow_the_density(evidence: Evidence, device: Device, name: str, angle: float) -> None:
    wo, cells = towards(angle), 16
    wi, _, _ = sampled(device, ROUGH[name], wo, 520)
    above = wi[:, 2] > 0.0
    expected = chances(device, ROUGH[name], wo, cells, 128)
    x = np.minimum((wi[above, 2] ** 2 * cells).astype(int), cells - 1)
    y = np.minimum((np.mod(np.arctan2(wi[above, 1], wi[above, 0]) / (2 * math.pi), 1.0) * cells).astype(int), cells - 1)
    counts = np.bincount(x * cells + y, minlength=cells * cells)
    below = np.array([np.count_nonzero(~above)])
    assert expected.sum() < 1.0 + 1e-4
    rest = max(1.0 - expected.sum(), 0.0)
    both = np.append(expected.ravel(), rest)
    evidence.histogram(f"{name} at {angle}", np.append(counts, below), both / both.sum())


@pytest.mark.parametrize("name", ROUGH)
def test_a_sample_says_what_its_direction_does(device: Device, name: str) -> None:
    """Weight and density of a sample are those of its direction, which has come back rounded to the world."""
    wo = towards(50.0)
    wi, weight, pdf = sampled(device, ROUGH[name], wo, 530)
    seen = (wi[:, 2] > 1e-3) & (weight > 0.0)
    assert seen.sum() > 0.5 * len(wi)
    f, again = evaluated(device, ROUGH[name], np.broadcast_to(wo, wi.shape)[seen][: 2**17], wi[seen][: 2**17])
    # A narrow lobe turns a rounding of the direction, 2^-22, into so many times its width
    alpha = ROUGH[name]["roughness"] ** 2
    tolerance = 1e-4 + 2.0**-20 / alpha if name.startswith("conductor") else 1e-4
    print(f"{name}: worst {np.abs(again / pdf[seen][: 2**17] - 1.0).max():.2g}")
    np.testing.assert_allclose(again, pdf[seen][: 2**17], rtol=tolerance)
    np.testing.assert_allclose(f[:, 0] / again, weight[seen][: 2**17], rtol=tolerance)


def test_the_table_of_albedos() -> None:
    """Straight on, GGX reflects 1 - ln 2 at alpha = 1, and everything where it is smooth."""
    table = ggx_albedos()
    assert table[-1, -1] == pytest.approx(1.0 - math.log(2.0), abs=2e-6)
    assert table[0, -1] > 1.0 - 1e-5 and table.max() <= 1.0 and table.min() > 0.0
    albedo = runpy.run_path(str(SOURCE.parents[2] / "scripts" / "ggx_albedo.py"))["albedo"]
    for row, column in ((5, 40), (20, 10), (33, 30), (47, 3)):
        alpha, y2 = (row / 47) ** 2, (column / 47) ** 2
        assert table[row, column] == pytest.approx(albedo(alpha * y2 / (1.0 + alpha - y2), alpha), abs=1e-6)


def test_rough_diffuse_light_against_its_formula(device: Device) -> None:
    """EON in double precision, with the exact albedo in the place of the fit (Portsmouth, Kutz and Hill 2025)."""
    rng = np.random.default_rng(540)
    both = rng.normal(size=(2, 4096, 3))
    both[:, :, 2] = np.abs(both[:, :, 2]) + 0.02
    wo, wi = (both / np.linalg.norm(both, axis=2, keepdims=True)).astype(np.float32).astype(np.float64)
    for r, color in ((0.2, 0.3), (0.6, 0.8), (1.0, 1.0)):
        f, _ = evaluated(device, oren_nayar(r, color), wo, wi)
        c1, c2 = 0.5 - 2.0 / (3.0 * math.pi), 2.0 / 3.0 - 28.0 / (15.0 * math.pi)
        a = 1.0 / (1.0 + c1 * r)
        s = (wo * wi)[:, :2].sum(axis=1)
        t = np.where(s > 0.0, np.maximum(wo[:, 2], wi[:, 2]), 1.0)

        def albedo(cosine: Floats, a: float = a, r: float = r) -> Floats:
            sine = np.sqrt(1.0 - cosine**2)
            tail = 2.0 / 3.0 * (sine / cosine * (1.0 - sine**3) - sine)
            return a + a * r / math.pi * (sine * (np.arccos(cosine) - sine * cosine) + tail)

        average = a * (1.0 + c2 * r)
        multiple = color**2 * average / (1.0 - color * (1.0 - average))
        lost = (1.0 - albedo(wo[:, 2])) * (1.0 - albedo(wi[:, 2])) / (1.0 - average)
        exact = (color * a * (1.0 + r * s / t) + multiple * lost) / math.pi
        # The fit misses either albedo by 5e-4 at most, and the product of both losses is over the mean loss and π
        allowed = 2.0 * 5e-4 * c1 / (c1 - c2) / math.pi
        np.testing.assert_allclose(f[:, 0] / wi[:, 2], exact, rtol=1e-5, atol=allowed)


@pytest.mark.parametrize("metal", METALS)
def test_metals_reflect_by_fresnel(device: Device, metal: str) -> None:
    """Complex arithmetic against the kernel's and the host's real one, at smooth metals."""
    for angle in (0.0, 45.0, 80.0, 89.0):
        wo = towards(angle)
        smooth, bits = conductor(0.0, metal=metal), random_bits(550, 256)
        out = run(device, "material_sample", smooth, bits, 7, four(wo))
        for channel, (eta, k) in enumerate(zip(*METALS[metal], strict=True)):
            cosine, index = wo[2], complex(eta, k)
            beyond = np.sqrt(1.0 - (1.0 - cosine**2) / index**2)
            parallel = abs((index * cosine - beyond) / (index * cosine + beyond)) ** 2
            perpendicular = abs((cosine - index * beyond) / (cosine + index * beyond)) ** 2
            exact = (parallel + perpendicular) / 2.0
            assert fresnel(cosine, eta, k) == pytest.approx(exact, rel=1e-9)
            np.testing.assert_allclose(out[3 + channel], exact, rtol=2e-5)
        np.testing.assert_allclose(out[:3], (wo * [-1, -1, 1])[:, None] + np.zeros((3, 256)), atol=1e-6)


@pytest.mark.parametrize("name", ["oren_nayar 1.0", "conductor 0.05", "conductor 0.5", "conductor 1.0"])
def test_a_white_sphere_in_white_light_is_invisible(device: Device, name: str) -> None:
    """Every way of sampling sees the environment through it; 1e-3 as above."""
    what = scene(
        [sphere([0, 0, 0], 1, material="m")],
        lights=[{"type": "environment", "radiance": [1.0, 1.0, 1.0]}],
        camera={"position": [0, 0, 4], "target": [0, 0, 0], "vertical_fov": 24.0},
        m=ROUGH[name],
    )
    for sampling in ("mis", "light", "bsdf"):
        image = clrender.render(what, size=(64, 64), spp=256, device=device, sampling=sampling, roulette="none")
        mean = float(image.linear.mean())
        error = float(image.linear.std()) / 64.0
        print(f"{name}, {sampling}: {mean:.5f} +- {error:.5f}")
        assert abs(mean - 1.0) <= 1e-3 + 4.0 * error


@pytest.mark.parametrize("integrator", ["path", "direct", "whitted"])
@pytest.mark.parametrize("name", ["oren_nayar 0.5", "conductor 0.1", "conductor 1.0"])
def test_a_point_light_over_a_plane(device: Device, name: str, integrator: str) -> None:
    """Each sample is f cosθ I / d²; a pixel so small that both directions are the same over all of it."""
    eye, light, intensity = towards(35.0, 0.3) * 3.0, towards(50.0, 0.7) * 2.0, 10.0
    what = scene(
        [disk([0, 0, 0], [0, 0, 1], 0.5, material="m")],
        lights=[{"type": "point", "position": light.tolist(), "intensity": [intensity] * 3}],
        camera={"position": eye.tolist(), "target": [0, 0, 0], "vertical_fov": 0.01},
        m=ROUGH[name],
    )
    image = clrender.render(what, size=(1, 1), spp=4, device=device, integrator=integrator)
    f, _ = evaluated(
        device, ROUGH[name], towards(35.0, 0.3)[None].repeat(256, 0), towards(50.0, 0.7)[None].repeat(256, 0)
    )
    assert image.linear[0, 0] == pytest.approx(f[0] * intensity / 4.0, rel=2e-3)
