"""Materials in scenes: mixtures, thin walls, sides, and what layers say of them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from material_support import WHITE, conductor, dielectric, evaluated, principled, sampled, towards
from render_support import disk, scene

import clrender

if TYPE_CHECKING:
    from clrender.device import Device

AROUND = [{"type": "environment", "radiance": [1.0, 1.0, 1.0]}]
CAMERA = {"position": [0.0, 0.0, 4.0], "target": [0.0, 0.0, 0.0], "vertical_fov": 10.0}


def grey(reflectance: float, **of: Any) -> dict[str, Any]:
    return {"type": "lambert", "reflectance": [reflectance] * 3, **of}


def seen(device: Device, **materials: Any) -> tuple[float, float]:
    """Mean and standard error of light from a disk of the material `m` in white light; each pixel is a batch."""
    what = scene([disk([0, 0, 0], [0, 0, 1], 2.0, material="m")], lights=AROUND, camera=CAMERA, **materials)
    image = clrender.render(what, size=(32, 32), spp=64, device=device, integrator="direct").linear[..., 0]
    return float(image.mean()), float(image.std()) / 32.0


def test_mixtures_are_met_as_often_as_they_weigh(device: Device) -> None:
    """Also of mixtures, and of materials that are deltas; six standard errors are passed once in 5e8."""
    parts: dict[str, Any] = {
        "a": grey(0.2),
        "b": grey(0.8),
        "c": conductor(0.1, f0=[0.5] * 3),
        "mirror": {"type": "mirror"},
    }
    for weight, first, second, exact in ((0.3, "a", "b", 0.38), (1.0, "a", "b", 0.8), (0.25, "a", "mirror", 0.4)):
        mean, error = seen(device, m={"type": "mix", "materials": [first, second], "weight": weight}, **parts)
        assert abs(mean - exact) <= 6.0 * error + 1e-6, (first, second)
    nested = {"type": "mix", "materials": ["both", "a"], "weight": 0.5}
    mean, error = seen(device, m=nested, both={"type": "mix", "materials": ["b", "mirror"], "weight": 0.5}, **parts)
    assert abs(mean - 0.55) <= 6.0 * error


@pytest.mark.parametrize("material", [grey(0.5), {"type": "mirror"}, principled(0.2), conductor(0.0, metal="Ag")])
def test_one_sided_materials_are_black_from_behind(device: Device, material: dict[str, Any]) -> None:
    shown, _ = seen(device, m={**material, "two_sided": False})
    assert shown == pytest.approx(seen(device, m=material)[0], abs=0.01) and shown > 0.3
    what = scene(
        [disk([0, 0, 0], [0, 0, -1], 2.0, material="m")],
        lights=AROUND,
        camera=CAMERA,
        m={**material, "two_sided": False},
    )
    assert clrender.render(what, size=(8, 8), spp=4, device=device).linear.max() == 0.0


def test_a_thin_wall_reflects_to_and_fro_and_bends_nothing(device: Device) -> None:
    for angle in (0.0, 50.0, 80.0):
        wo = towards(angle)
        wi, weight, pdf = sampled(device, dielectric(0.0, thin=True), wo, 600, 2**16)
        sine = math.sin(math.radians(angle)) / 1.5
        a, b = math.cos(math.radians(angle)), math.sqrt(1.0 - sine * sine)
        boundary = (((1.5 * a - b) / (1.5 * a + b)) ** 2 + ((a - 1.5 * b) / (a + 1.5 * b)) ** 2) / 2.0
        share = 2.0 * boundary / (1.0 + boundary)
        back = wi[:, 2] > 0.0
        assert (pdf == 0.0).all() and (weight == 1.0).all()
        assert abs(back.mean() - share) <= 5.0 * math.sqrt(share * (1.0 - share) / len(wi))
        np.testing.assert_allclose(wi[~back], np.broadcast_to(-wo, wi[~back].shape), atol=1e-6)


@pytest.mark.parametrize(
    "material",
    [
        conductor(0.3, metal="Cu"),
        conductor(0.05, f0=[0.9, 0.5, 0.2], anisotropy=0.5),
        principled(0.25, base_color=(0.6, 0.3, 0.1)),
        principled(0.1, base_color=(0.6, 0.3, 0.1), metallic=0.5, diffuse_roughness=0.5),
        principled(0.3, base_color=(0.6, 0.3, 0.1), coat=1.0, coat_roughness=0.3, sheen_color=(0.2, 0.4, 0.6)),
        dielectric(0.2),
        principled(0.2, transmission=1.0, thin=True, base_color=WHITE),
    ],
)
def test_albedos_of_layers(device: Device, material: dict[str, Any]) -> None:
    """What `--aov albedo` shows is the share of light that is scattered, within 0.04; it guides a denoiser."""
    for angle in (0.0, 45.0, 75.0):
        wo = towards(angle)
        _, weight, _ = sampled(device, material, wo, 610, 2**16)
        _, _, albedo = evaluated(device, material, np.tile(wo, (256, 1)), np.tile(wo, (256, 1)))
        np.testing.assert_allclose(albedo[0], weight.mean(axis=0), atol=0.04)
