"""Materials: white ones send all light back, all are reciprocal, and are sampled as their density says."""

from __future__ import annotations

import math
import runpy
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from cases import for_each
from material_support import (
    SOURCE,
    WHITE,
    Floats,
    chances,
    conductor,
    counted,
    covers_leave,
    dielectric,
    directions,
    evaluated,
    oren_nayar,
    principled,
    run,
    sampled,
    towards,
)
from render_support import disk, scene, sphere
from sampling_support import random_bits
from stats_support import Evidence

import clrender
from clrender import layout
from clrender.flatten.microfacets import albedo_tables, fresnel
from clrender.scene.metals import METALS

if TYPE_CHECKING:
    from clrender.device import Device

ANGLES = (0.0, 30.0, 60.0, 75.0, 85.0, 89.0)
ALPHAS = (0.0012, 0.01, 0.05, 0.1, 0.25, 0.5, 0.75, 1.0)

BECKMANN: dict[str, Any] = {"microfacets": "beckmann"}
WHOLE: dict[str, dict[str, Any]] = {
    **{f"oren_nayar {r}": oren_nayar(r) for r in (0.0, 0.1, 0.5, 1.0)},
    **{f"conductor {a}": conductor(a) for a in ALPHAS},
    **{f"f0 {a}": conductor(a, f0=WHITE) for a in (0.05, 0.5)},
    **{f"glass {a}": dielectric(a) for a in (0.0012, 0.1, 0.5, 1.0)},
    **{f"thin {a}": dielectric(a, thin=True) for a in (0.1, 1.0)},
    **{f"plastic {a}": principled(a) for a in (0.01, 0.25, 1.0)},
    "plastic, ior 2.5": principled(0.1, ior=2.5),
    "rough plastic": principled(0.05, diffuse_roughness=1.0),
    "rough plastic, ior 2.5": principled(0.3, diffuse_roughness=1.0, ior=2.5),
    **{
        f"cloth {r}": principled(0.3, sheen_color=WHITE, sheen_roughness=r, specular=0.0, diffuse_roughness=d)
        for r, d in ((0.1, 0.0), (0.4, 0.5), (1.0, 1.0))
    },
    "half metal": principled(0.1, metallic=0.5, diffuse_roughness=0.5),
    **{f"coat {r} on metal": principled(0.1, metallic=1.0, coat=1.0, coat_roughness=r) for r in (0.0, 0.1, 0.6)},
    "sheen on metal": principled(0.3, metallic=1.0, sheen_color=WHITE, sheen_roughness=0.5),
    **{f"beckmann {a}": conductor(a, **BECKMANN) for a in (0.01, 0.05, 0.25, 0.5, 1.0)},
    **{f"beckmann glass {a}": dielectric(a, **BECKMANN) for a in (0.01, 0.1, 0.5, 1.0)},
    **{f"beckmann glass 0.3, {ior}": dielectric(0.3, ior, **BECKMANN) for ior in (1.05, 2.5)},
    **{f"thin beckmann {a}": dielectric(a, thin=True, **BECKMANN) for a in (0.1, 1.0)},
    **{f"beckmann plastic {a}": principled(a, **BECKMANN) for a in (0.01, 0.1, 0.5, 1.0)},
    "rough beckmann plastic": principled(0.05, diffuse_roughness=1.0, ior=2.5, **BECKMANN),
    "half beckmann metal": principled(0.25, metallic=0.5, diffuse_roughness=0.5, **BECKMANN),
    "beckmann sheet": principled(0.3, diffuse_transmission=0.6, **BECKMANN),
    "sheet 0.6": principled(0.3, diffuse_transmission=0.6),
    "rough sheet": principled(0.05, diffuse_transmission=1.0, diffuse_roughness=1.0, ior=2.5),
    "cloth sheet": principled(
        0.3, diffuse_transmission=0.5, sheen_color=WHITE, sheen_roughness=0.4, specular=0.0, diffuse_roughness=0.5
    ),
}
"""White materials that lose nothing, within 1e-3."""
BOUNDED = {
    "coat": principled(0.5, coat=1.0, coat_roughness=0.3),
    "coat on half metal": principled(0.1, metallic=0.5, coat=0.5, diffuse_roughness=0.5),
    **{f"sheen {r}": principled(0.3, sheen_color=WHITE, sheen_roughness=r) for r in (0.1, 0.4, 1.0)},
    "sheen alone": principled(0.3, sheen_color=WHITE, sheen_roughness=0.2, base_color=(0.0, 0.0, 0.0), specular=0.0),
    "sheen and coat": principled(
        0.3, sheen_color=WHITE, sheen_roughness=0.6, coat=1.0, coat_roughness=0.6, diffuse_roughness=1.0
    ),
    "blend": principled(0.4, metallic=0.3, transmission=0.4, coat=0.7, coat_roughness=0.5, sheen_color=WHITE),
    "blend, thin": principled(0.4, metallic=0.3, transmission=0.4, coat=0.7, coat_roughness=0.5, thin=True),
}
"""White materials of which gloss that is no metal, or glass, lies below a coat or sheen, and loses some light."""
ANISOTROPIC = {
    **{
        f"{s}, {a}": conductor(a, f0=WHITE, anisotropy=s)
        for s in (0.2, 0.5, 0.8, 1.0)
        for a in (0.0012, 0.01, 0.05, 0.3)
    },
    **{f"beckmann {s}, 0.05": conductor(0.05, f0=WHITE, anisotropy=s, **BECKMANN) for s in (0.3, 0.7, 1.0)},
}
"""White metals that lose nothing, within 1e-3, towards any side."""
RECIPROCAL = {**WHOLE, **BOUNDED, **ANISOTROPIC, "clear": principled(0.3, transmission=1.0, base_color=(0.9, 0.6, 0.3))}


FEW = ("coat", "blend", "sheen 0.4")


def passes_light(material: dict[str, Any]) -> bool:
    return material["type"] == "dielectric" or any(
        material.get(key) for key in ("transmission", "diffuse_transmission")
    )


def furnace(device: Device, material: dict[str, Any], seed: int, count: int = 2**18) -> list[tuple[str, float, float]]:
    """How much light comes back for one that arrives, and its standard error, from several angles and both sides."""
    sides = (True, False) if passes_light(material) else (True,)
    results = []
    for i, (front, angle) in enumerate((f, a) for f in sides for a in ANGLES):
        _, weight, _ = sampled(device, material, towards(angle), 1000 * seed + i, count, front=front)
        mean, error = weight[:, 0].mean(), weight[:, 0].std() / math.sqrt(len(weight))
        results.append((f"{angle} degrees{'' if front else ', from behind'}", float(mean), float(error)))
        print(f"{results[-1][0]}: {mean:.5f} +- {error:.5f}")
    return results


FAST = (
    *("oren_nayar 1.0", "conductor 0.1", "glass 0.5", "cloth 0.4", "coat 0.1 on metal"),
    *("beckmann 0.5", "thin beckmann 1.0", "sheet 0.6", "beckmann plastic 0.5"),
)


@pytest.mark.thorough
@pytest.mark.parametrize("name", [n if n in FAST else pytest.param(n, marks=pytest.mark.slow) for n in WHOLE])
def test_white_surfaces_send_all_light_back(device: Device, name: str) -> None:
    """Within 1e-3, which the tables of albedos cost, and four standard errors."""
    for where, mean, error in furnace(device, WHOLE[name], 500 + list(WHOLE).index(name)):
        assert abs(mean - 1.0) <= 1e-3 + 4.0 * error, where


def what_layers_lose(device: Device, material: dict[str, Any], wo: Floats, seed: int, front: bool) -> Floats:
    """Estimates (n,) of what coat and sheen absorb: of gloss and glass passes the lesser of what they leave either way.

    By samples of the base alone, and of sheen below a coat. Of a diffuse base and of metal
    that light is returned, and what passes into solid glass passes a cover once. Seen from within, light that passes
    meets it beyond the surface; what it reflects there does not come back.
    """
    bare = {key: value for key, value in material.items() if not key.startswith(("coat", "sheen"))}
    black = {**bare, "base_color": (0.0, 0.0, 0.0), "metallic": 0.0}
    solid = bool(material.get("transmission")) and not material.get("thin")

    def lost(of: dict[str, Any], up: bool, below: dict[str, Any] = material) -> Floats:
        wi, weight, _ = sampled(device, of, wo, seed, front=front)
        here, there = covers_leave(below, wo[2:]), covers_leave(below, np.abs(wi[:, 2]))
        counts = (wi[:, 2] > 0.0) == up
        absorbed: Floats = (
            counts * weight[:, 0] * (1.0 - there if solid and not front else np.maximum(here - there, 0.0))
        )
        return absorbed

    if solid and not front:
        return lost(bare, up=False)
    share = 1.0 - material.get("metallic", 0.0)
    together: Floats = share * lost(black, up=True) + (lost(bare, up=False) if material.get("thin") else 0.0)
    if "sheen_color" in material and "coat" in material:
        sheen = {key: value for key, value in material.items() if key.startswith("sheen")}
        coat = {key: value for key, value in material.items() if key.startswith("coat")}
        alone = {**principled(0.3, base_color=(0.0, 0.0, 0.0), specular=0.0), **sheen}
        together = together + lost(alone, up=True, below=coat)
    return together


@pytest.mark.long
@pytest.mark.parametrize("name", [n if n in FEW else pytest.param(n, marks=pytest.mark.slow) for n in BOUNDED])
def test_layers_lose_what_the_lesser_of_both_ways_does_not_pass(device: Device, name: str) -> None:
    """No more, and no less, within 1e-3 and four standard errors: the loss is that of the model alone."""
    material, seed, count = BOUNDED[name], 560 + list(BOUNDED).index(name), 2**18 if name in FEW else 2**20
    sides = (True, False) if material.get("transmission") else (True,)
    for i, (front, angle) in enumerate((f, a) for f in sides for a in ANGLES):
        wo = towards(angle)
        lost = what_layers_lose(device, material, wo, 1000 * seed + 500 + i, front)
        _, weight, _ = sampled(device, material, wo, 1000 * seed + i, count, front=front)
        expected = 1.0 - lost.mean() if name != "sheen alone" else 1.0 - covers_leave(material, wo[2:])[0]
        error = math.hypot(weight[:, 0].std() / math.sqrt(count), lost.std() / math.sqrt(len(lost)))
        off = weight[:, 0].mean() - expected
        print(f"{angle} degrees, front {front}: {expected:.5f}, off {off:+.5f} +- {error:.5f}")
        assert abs(off) <= 1e-3 + 4.0 * error, (angle, front)


DIFFUSE = {
    **{name: WHOLE[name] for name in ("cloth 1.0", "rough plastic", "rough plastic, ior 2.5")},
    "narrow sheen": principled(sheen_color=WHITE, sheen_roughness=0.1, specular=0.0, diffuse_roughness=1.0),
    "coat": principled(0.09, diffuse_roughness=1.0, coat=1.0, coat_roughness=0.6),
    "sheen and coat": BOUNDED["sheen and coat"],
    "Lambert below three": principled(0.3, sheen_color=WHITE, sheen_roughness=0.6, coat=1.0, coat_roughness=0.6),
    "most": principled(
        0.05, ior=2.5, sheen_color=WHITE, sheen_roughness=0.3, coat=1.0, coat_roughness=0.1, diffuse_roughness=1.0
    ),
}


@pytest.mark.long
@pytest.mark.parametrize("name", DIFFUSE)
def test_a_diffuse_base_returns_what_layers_leave(device: Device, name: str) -> None:
    """Lambert's all of it, and EON, of which two orders count, all but 1e-3: by a grid, without noise.

    The diffuse lobe is what white has more than black.
    """
    steps, material = 192, DIFFUSE[name]
    grid = (np.arange(steps) + 0.5) / steps
    z, around = (part.ravel() for part in np.meshgrid(grid * grid, math.pi * grid, indexing="ij"))
    sine = np.sqrt(1.0 - z**2)
    wi = np.stack([-sine * np.cos(around), sine * np.sin(around), z], axis=1)
    black = {**material, "base_color": (0.0, 0.0, 0.0)}
    for angle in (0.0, 30.0, 60.0, 70.0, 80.0, 85.0, 89.0):
        wo = np.broadcast_to(towards(angle, 0.0), wi.shape)
        f = evaluated(device, material, wo, wi)[0][:, 0] - evaluated(device, black, wo, wi)[0][:, 0]
        energy = 4.0 * math.pi * float((f.reshape(steps, steps) * grid[:, None]).mean())
        left = float(covers_leave(material, wo[0, 2:], gloss=True)[0])
        print(f"{angle} degrees: {left:.5f}, off {energy - left:+.5f}")
        assert abs(energy - left) <= (1e-3 if material.get("diffuse_roughness") else 1e-4), angle


@pytest.mark.parametrize(
    "name", [n if n in ("0.8, 0.05", "1.0, 0.01") else pytest.param(n, marks=pytest.mark.slow) for n in ANISOTROPIC]
)
def test_anisotropic_metals_send_all_light_back(device: Device, name: str) -> None:
    """Also towards the smooth side, where they lose most of what they lose at first, and near it."""
    for i, (turn, angle) in enumerate((t, a) for t in (0.0, 0.1, 0.23, 0.248, 0.25) for a in (20.0, 60.0, 85.0, 89.5)):
        wo = towards(angle, turn)
        _, weight, _ = sampled(device, ANISOTROPIC[name], wo, 580_000 + 100 * list(ANISOTROPIC).index(name) + i)
        mean, error = weight[:, 0].mean(), weight[:, 0].std() / math.sqrt(len(weight))
        print(f"{turn}, {angle} degrees: {mean:.5f} +- {error:.5f}")
        assert abs(mean - 1.0) <= 1e-3 + 4.0 * error, (turn, angle)


NEAR_CRITICAL = (
    *((0.0652, 1.051, 0.3058), (0.0657, 2.193, 1.0), (0.1272, 1.828, 1.0), (0.05, 1.5, 0.7431), (0.05, 1.5, 0.749)),
    *((0.0749, 1.053, 0.2771), (0.3587, 1.082, 0.1361), (0.8966, 1.066, 0.9385), (0.0281, 1.051, 0.306)),
)
"""Alpha, index and cosine of light within rough glass where tables that are coarse there err most, by up to 0.5 %."""


@pytest.mark.long
def test_rough_glass_keeps_its_light_near_total_reflection(device: Device) -> None:
    for i, (alpha, ior, cosine) in enumerate(NEAR_CRITICAL[:5]):
        check_glass(device, alpha, ior, cosine, 585_000 + i)


@pytest.mark.slow
def test_rough_glass_keeps_its_light_everywhere(device: Device) -> None:
    """From both sides, of any roughness, for indices from 1.05 to 2.5; most of them where E bends."""
    for i, (alpha, ior, cosine) in enumerate(NEAR_CRITICAL[5:]):
        check_glass(device, alpha, ior, cosine, 586_000 + i)
    rng = np.random.default_rng(587)
    for i in range(200):
        alpha, ior = 10.0 ** rng.uniform(-2.95, 0.0), rng.uniform(1.05, 2.5)
        critical = math.sqrt(1.0 - 1.0 / ior**2)
        places = (rng.random(), alpha * 10.0 ** rng.uniform(-0.5, 1.0), critical + alpha * rng.normal())
        check_glass(device, alpha, ior, min(max(places[i % 3], 0.002), 1.0), 587_000 + i, front=i % 7 < 2)


def check_glass(device: Device, alpha: float, ior: float, cosine: float, seed: int, front: bool = False) -> None:
    """Within 1e-3 and four standard errors, as other white surfaces."""
    wo = towards(math.degrees(math.acos(cosine)))
    _, weight, _ = sampled(device, dielectric(alpha, ior), wo, seed, 2**20, front=front)
    mean, error = weight[:, 0].mean(), weight[:, 0].std() / 1024.0
    print(f"alpha {alpha:.4f}, index {ior:.3f}, cosine {cosine:.4f}, front {front}: {mean:.5f} +- {error:.5f}")
    assert abs(mean - 1.0) <= 1e-3 + 4.0 * error


@pytest.mark.long
@pytest.mark.parametrize("alpha", [0.0011, 0.0015, 0.003, 0.012])
def test_smooth_metals_send_all_light_back_at_grazing_angles(device: Device, alpha: float) -> None:
    """Where the cosine is about as large as alpha, they lose a tenth at first, and return it to other such cosines.

    Too few samples go there: by a grid that is dense at both ends of the column of the tables, and around the mirror's
    direction on either side. Rounded directions say of facets no more than a part of alpha there; without regard to
    that, energies were up to 1 % off, either way, by how the direction is rounded. 1e-4: quadrature and sixteen bits.
    """
    steps, narrow = 384, 1e-6
    grid = (np.arange(steps) + 0.5) / steps
    column = grid * (2.0 - grid)
    cosine = alpha * column**2 / (1.0 + alpha - column**2)
    height = 2.0 * column * alpha * (1.0 + alpha) / (1.0 + alpha - column**2) ** 2 * (2.0 - 2.0 * grid)
    span = math.asinh(math.pi / narrow)
    turn, width = narrow * np.sinh(span * grid), narrow * span * np.cosh(span * grid)
    z, around = (part.ravel() for part in np.meshgrid(cosine, np.append(-turn, turn), indexing="ij"))
    sine = np.sqrt(1.0 - z**2)
    for ratio, way in ((0.1, 0.23), (0.3, 0.1), (0.3, 0.61), (1.0, 0.0), (3.0, 0.1)):
        at = around + 2.0 * math.pi * way
        wi = np.stack([-sine * np.cos(at), -sine * np.sin(at), z], axis=1)
        wo = towards(math.degrees(math.acos(ratio * alpha)), way)
        f, _, _ = evaluated(device, conductor(alpha), np.broadcast_to(wo, wi.shape), wi)
        both = f[:, 0].reshape(steps, 2, steps) * height[:, None, None] * width
        energy = float(both.sum()) / steps**2
        print(f"cosine {ratio} alpha, turn {way}: {energy:.5f}")
        assert 1.0 - 1e-3 <= energy <= 1.0 + 1e-4, (ratio, way)


@pytest.mark.long
@for_each("name", RECIPROCAL)
def test_reciprocity(device: Device, name: str) -> None:
    """Also through glass, where f is over the square of the index on the side of the light."""
    material, wo, wi = RECIPROCAL[name], directions(510, 4096), directions(511, 4096)
    forth, _, _ = evaluated(device, material, wo, wi)
    back, _, _ = evaluated(device, material, wi, wo)
    np.testing.assert_allclose(forth / wi[:, 2:], back / wo[:, 2:], rtol=1e-4)
    if passes_light(material):
        bends = not (material.get("thin") or material.get("diffuse_transmission"))
        turned, squared = np.array([1.0, 1.0, -1.0]), material.get("ior", 1.5) ** 2 if bends else 1.0
        forth, _, _ = evaluated(device, material, wo, wi * turned)
        # Seen from behind, z points to there
        back, _, _ = evaluated(device, material, wi, wo * turned, front=False)
        assert (forth > 0.0).any()
        np.testing.assert_allclose(forth * squared / wi[:, 2:], back / wo[:, 2:], rtol=1e-4, atol=1e-6)


@pytest.mark.thorough
@pytest.mark.parametrize("angle", [0.0, 40.0, 75.0])
@pytest.mark.parametrize(
    "name",
    [
        "oren_nayar 1.0",
        "conductor 0.25",
        "conductor 1.0",
        "sheet 0.6",
        *(
            pytest.param(n, marks=pytest.mark.slow)
            for n in (
                "glass 0.5",
                "glass 1.0",
                "beckmann glass 0.5",
                "beckmann plastic 0.5",
                "thin 1.0",
                "coat",
                "sheen and coat",
                "blend",
                "blend, thin",
                "0.8, 0.3",
            )
        ),
    ],
)
def test_directions_follow_the_density(evidence: Evidence, device: Device, name: str, angle: float) -> None:
    material, wo, cells = RECIPROCAL[name], towards(angle), (32, 16)
    for front in (True, False) if material["type"] == "dielectric" else (True,):
        wi, weight, _ = sampled(device, material, wo, 520, front=front)
        expected = chances(device, material, wo, cells, 32, front=front)
        counts, lost = counted(wi, weight, cells)
        assert expected.sum() < 1.0 + 1e-3
        both = np.append(expected.ravel(), max(1.0 - expected.sum(), 0.0))
        evidence.histogram(f"{name} at {angle}, {front}", np.append(counts, lost), both / both.sum())


@pytest.mark.parametrize(
    "name", ["oren_nayar 1.0", "conductor 0.01", "conductor 0.5", "glass 0.1", "blend", "sheen 0.4"]
)
def test_a_sample_says_what_its_direction_does(device: Device, name: str) -> None:
    """Weight and density of a sample are those of its direction, which has come back rounded to the world."""
    wo, material = towards(50.0), RECIPROCAL[name]
    wi, weight, pdf = sampled(device, material, wo, 530, 2**17)
    seen = (np.abs(wi[:, 2]) > 1e-3) & (weight[:, 0] > 0.0)
    assert seen.sum() > 0.5 * len(wi)
    keep = np.flatnonzero(seen)[: 2**16]
    f, again, _ = evaluated(device, material, np.broadcast_to(wo, wi.shape)[keep], wi[keep])
    # A narrow lobe turns a rounding of the direction, 2^-22, into so many times its width
    alpha = material["roughness"] ** 2
    tolerance = 1e-4 + 2.0**-19 / alpha if material["type"] != "oren_nayar" else 1e-4
    print(f"{name}: worst {np.abs(again / pdf[keep] - 1.0).max():.2g}")
    np.testing.assert_allclose(again, pdf[keep], rtol=tolerance)
    squeezed = np.where((wi[keep, 2] < 0.0) & (not material.get("thin")), material.get("ior", 1.5) ** -2, 1.0)
    np.testing.assert_allclose(f[:, 0] / again / squeezed, weight[keep, 0], rtol=tolerance)


def test_the_tables_of_albedos() -> None:
    """Straight on, GGX reflects 1 - ln 2 at alpha = 1, and everything where it is smooth."""
    made = runpy.run_path(str(SOURCE.parents[2] / "scripts" / "albedo_tables.py"))
    rows, columns = layout.GGX_ROWS, layout.GGX_COLUMNS
    words = albedo_tables()[: rows * (columns - 1)].view(np.uint32).reshape(rows, columns - 1)
    table = np.concatenate([words & 0xFFFF, words[:, -1:] >> 16], axis=1) / 65535.0
    assert table[-1, -1] == pytest.approx(1.0 - math.log(2.0), abs=1e-5)
    assert table[0, -1] > 1.0 - 2e-5 and table.max() <= 1.0 and table.min() > 0.0
    for row, column in ((5, 40), (20, 10), (33, 30), (47, 3)):
        alpha, y2 = (row / 47) ** 2, (column / 47) ** 2
        direction = made["seen_at"](alpha * y2 / (1.0 + alpha - y2))
        assert table[row, column] == pytest.approx(made["albedo"](direction, made["alike"](alpha))[0], abs=1e-5)


@pytest.mark.thorough
@pytest.mark.parametrize("beckmann", [False, True])
def test_the_tables_of_rough_glass(beckmann: bool) -> None:
    """As kernels interpolate them, against integrals over other facets: within 1e-3 for indices from 1.05 to 2.5."""
    made = runpy.run_path(str(SOURCE.parents[2] / "scripts" / "albedo_tables.py"))
    with np.load(made["FILE"]) as file:
        table = file["beckmann_glass" if beckmann else "glass"]
    rng, worst = np.random.default_rng(545), 0.0
    for i in range(300):
        alpha, ior, denser = 10.0 ** rng.uniform(-3.0, 0.0), rng.uniform(1.05, 2.5), i % 3 > 0
        critical = math.sqrt(1.0 - 1.0 / ior**2) if denser else 0.0
        places = (rng.random(), alpha * 10.0 ** rng.uniform(-1.0, 1.0), critical + 0.5 * alpha * rng.normal())
        cosine = np.clip(places[i % 5 % 3], 1e-4, 1.0) * np.ones(1)
        at = made["glass_layer"](ior)
        layer = int(at)
        column = made["glass_column"](alpha, cosine, ior, denser)
        low, high = (made["interpolated"](table[int(denser), k], math.sqrt(alpha), column) for k in (layer, layer + 1))
        exact = made["glass_albedo"](cosine, alpha, 1.0 / ior if denser else ior, 21, beckmann)
        worst = max(worst, abs(float((low + (at - layer) * (high - low) - exact)[0])))
    print(f"worst {worst:.5f}")
    assert worst <= 1e-3


def test_rough_diffuse_light_against_its_formula(device: Device) -> None:
    """EON in double precision, with the exact albedo in the place of the fit (Portsmouth, Kutz and Hill 2025)."""
    wo, wi = directions(540, 4096, 0.02), directions(541, 4096, 0.02)
    for r, color in ((0.2, 0.3), (0.6, 0.8), (1.0, 1.0)):
        f, _, _ = evaluated(device, oren_nayar(r, color), wo, wi)
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


@for_each("metal", METALS)
def test_metals_reflect_by_fresnel(device: Device, metal: str) -> None:
    """Complex arithmetic against the kernel's and the host's real one, at smooth metals."""
    for angle in (0.0, 45.0, 80.0, 89.0):
        wo = towards(angle)
        smooth, bits = conductor(0.0, metal=metal), random_bits(550, 256)
        out = run(device, "material_sample", smooth, bits, 8, np.append(wo, 0.0).astype(np.float32))
        for channel, (eta, k) in enumerate(zip(*METALS[metal], strict=True)):
            cosine, index = wo[2], complex(eta, k)
            beyond = np.sqrt(1.0 - (1.0 - cosine**2) / index**2)
            parallel = abs((index * cosine - beyond) / (index * cosine + beyond)) ** 2
            perpendicular = abs((cosine - index * beyond) / (cosine + index * beyond)) ** 2
            exact = (parallel + perpendicular) / 2.0
            assert fresnel(cosine, eta, k) == pytest.approx(exact, rel=1e-9)
            np.testing.assert_allclose(out[3 + channel], exact, rtol=2e-5)
        np.testing.assert_allclose(out[:3], (wo * [-1, -1, 1])[:, None] + np.zeros((3, 256)), atol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("name", ["oren_nayar 1.0", "conductor 0.5", "glass 0.5", "plastic 0.25"])
def test_a_white_sphere_in_white_light_is_invisible(device: Device, name: str) -> None:
    """Every way of sampling sees the environment through it; 1e-3 as above."""
    what = scene(
        [sphere([0, 0, 0], 1, material="m")],
        lights=[{"type": "environment", "radiance": [1.0, 1.0, 1.0]}],
        camera={"position": [0, 0, 4], "target": [0, 0, 0], "vertical_fov": 24.0},
        m=WHOLE[name],
    )
    for sampling in ("mis", "light", "bsdf"):
        image = clrender.render(what, size=(64, 64), spp=256, device=device, sampling=sampling, roulette="none")
        mean = float(image.linear.mean())
        error = float(image.linear.std()) / 64.0
        print(f"{name}, {sampling}: {mean:.5f} +- {error:.5f}")
        assert abs(mean - 1.0) <= 1e-3 + 4.0 * error


@pytest.mark.long
@for_each("integrator", ["path", "direct", "whitted"])
@for_each("name", ["oren_nayar 0.5", "conductor 0.1", "plastic 0.25"])
def test_a_point_light_over_a_plane(device: Device, name: str, integrator: str) -> None:
    """Each sample is f cosθ I / d²; a pixel so small that both directions are the same over all of it."""
    eye, light, intensity = towards(35.0, 0.3) * 3.0, towards(50.0, 0.7) * 2.0, 10.0
    what = scene(
        [disk([0, 0, 0], [0, 0, 1], 0.5, material="m")],
        lights=[{"type": "point", "position": light.tolist(), "intensity": [intensity] * 3}],
        camera={"position": eye.tolist(), "target": [0, 0, 0], "vertical_fov": 0.01},
        m=WHOLE[name],
    )
    image = clrender.render(what, size=(1, 1), spp=4, device=device, integrator=integrator)
    f, _, _ = evaluated(
        device, WHOLE[name], towards(35.0, 0.3)[None].repeat(256, 0), towards(50.0, 0.7)[None].repeat(256, 0)
    )
    assert image.linear[0, 0] == pytest.approx(f[0] * intensity / 4.0, rel=2e-3)
