"""No sample of a material weighs much: densities follow what materials scatter, also where they scatter little."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from material_support import WHITE, Floats, conductor, dielectric, evaluated, oren_nayar, principled, sampled, towards
from render_support import scene, sphere

import clrender

if TYPE_CHECKING:
    from clrender.device import Device

ANGLES = (0.0, 30.0, 60.0, 75.0, 85.0, 89.0, 89.9)
ALPHAS = (0.0011, 0.003, 0.0081, 0.09, 0.5, 1.0)
BOUND = 15.0
"""Of f |cosθ| over the density. Of glass that hardly bends light, where facets seldom pass it on, 12; of others 10."""


def rough(alpha: float) -> dict[str, dict[str, Any]]:
    """Materials of which a part has this roughness."""
    metal, gloss = {"metallic": 1.0}, math.sqrt(alpha)
    return {
        "metal": conductor(alpha),
        "red": conductor(alpha, f0=(1.0, 0.1, 0.1)),
        "beckmann": conductor(alpha, microfacets="beckmann"),
        "brushed": conductor(alpha, f0=WHITE, anisotropy=0.8),
        **{f"glass {ior}": dielectric(alpha, ior) for ior in (1.01, 1.1, 1.5, 2.5)},
        "beckmann glass": dielectric(alpha, microfacets="beckmann"),
        "thin": dielectric(alpha, thin=True),
        "brushed glass": principled(alpha, transmission=1.0, anisotropy=0.8),
        "plastic": principled(alpha, base_color=(0.8, 0.02, 0.02)),
        "half metal": principled(alpha, metallic=0.5, base_color=(1.0, 0.1, 0.1)),
        "coat": principled(0.3, coat=1.0, coat_roughness=gloss),
        "coat on metal": principled(0.1, **metal, coat=1.0, coat_roughness=gloss),
        "metal below coat": principled(alpha, **metal, coat=1.0, coat_roughness=0.3),
        "metal below sheen": principled(alpha, **metal, sheen_color=WHITE),
        "sheen": principled(0.3, sheen_color=WHITE, sheen_roughness=gloss, base_color=(0.0, 0.0, 0.0), specular=0.0),
        "blend": principled(alpha, metallic=0.3, transmission=0.4, coat=0.7, coat_roughness=0.5, sheen_color=WHITE),
    }


def grid() -> Floats:
    """Directions (n, 3) of the whole sphere, dense near the horizon."""
    even, around = (np.arange(48) + 0.5) / 48, 2.0 * math.pi * (np.arange(24) + 0.5) / 24
    z, turn = (part.ravel() for part in np.meshgrid([*even**3, *-(even**3)], around, indexing="ij"))
    sine = np.sqrt(1.0 - z * z)
    return np.stack([sine * np.cos(turn), sine * np.sin(turn), z], axis=1)


def heaviest(device: Device, material: dict[str, Any]) -> float:
    """The largest weight, of flux, in directions of a grid and of samples."""
    clear, ior = material["type"] == "dielectric" or "transmission" in material, material.get("ior", 1.5)
    all_of = grid()
    wi = np.tile(all_of, (len(ANGLES), 1))
    wo = np.repeat([towards(angle) for angle in ANGLES], len(all_of), axis=0)
    found = []
    for front in (True, False) if clear else (True,):
        squeezed = (ior if front else 1.0 / ior) ** 2 if clear and not material.get("thin") else 1.0
        f, pdf, _ = evaluated(device, material, wo, wi, front=front)
        flux = f.max(axis=1) * np.where(wi[:, 2] < 0.0, squeezed, 1.0)
        assert not (flux[pdf <= 0.0] > 0.0).any()
        found.append(float((flux[pdf > 0.0] / pdf[pdf > 0.0]).max()))
        found += [float(sampled(device, material, w, 5, 2**12, front=front)[1].max()) for w in map(towards, ANGLES)]
    return max(found)


@pytest.mark.long
@pytest.mark.parametrize("alpha", [a if a in (0.003, 0.5) else pytest.param(a, marks=pytest.mark.slow) for a in ALPHAS])
def test_no_sample_of_rough_facets_weighs_much(device: Device, alpha: float) -> None:
    """What meets more than one facet does so near the horizon; chosen by the cosine, such samples weighed 24,000."""
    most = {name: heaviest(device, material) for name, material in rough(alpha).items()}
    print(", ".join(f"{name} {weight:.1f}" for name, weight in most.items()))
    assert all(weight <= BOUND for weight in most.values()), most


def test_no_sample_of_rough_diffuse_surfaces_weighs_much(device: Device) -> None:
    """At grazing angles they scatter half of the light towards the horizon; chosen by the cosine, it weighed 445."""
    for roughness in (0.3, 1.0):
        bare, below = oren_nayar(roughness), principled(0.05, diffuse_roughness=roughness)
        most = heaviest(device, bare), heaviest(device, below)
        print(f"roughness {roughness}: {most[0]:.1f}, below gloss {most[1]:.1f}")
        assert max(most) <= 6.0


def test_no_sample_through_rough_glass_is_bright(device: Device) -> None:
    """In white light all of it has the radiance 1; several weights multiply."""
    glass = {"type": "dielectric", "ior": 1.5, "roughness": 0.3}
    light = {"type": "environment", "radiance": [1.0, 1.0, 1.0]}
    camera = {"position": [0, 0, -4], "target": [0, 0, 0], "vertical_fov": 24.0}
    what = scene([sphere([0, 0, 0], 0.7, material="glass")], lights=[light], camera=camera, glass=glass)
    image = clrender.render(what, size=(512, 512), spp=1, device=device, roulette="none")
    print(f"brightest {image.linear.max():.1f}")
    assert image.linear.max() <= 10.0
