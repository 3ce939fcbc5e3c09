"""Glass slabs: how much goes through and how much comes back, and where the light comes out."""

from __future__ import annotations

import math
from typing import Any

import pytest
from exact import fresnel, refracted_cosine
from render_support import Studio, quad, scene
from stats_support import Evidence

import clrender

THICK = 0.1


def slab(degrees: float, shapes: list[dict[str, Any]], ior: float = 1.5, exterior: float = 1.0) -> Any:
    """A slab, z from 0 to -0.1, seen from above it under that angle to its normal; the view meets it at (0, 0, 0)."""
    turn = math.radians(degrees)
    camera = {"position": [-math.sin(turn), 0.0, math.cos(turn)], "target": [0.0, 0.0, 0.0], "vertical_fov": 0.01}
    glass = {"type": "box", "center": [0.0, 0.0, -THICK / 2.0], "size": [90.0, 90.0, THICK], "material": "glass"}
    return scene([glass, *shapes], camera=camera, glass={"type": "dielectric", "ior": ior, "exterior_ior": exterior})


def below(x: float, width: float) -> dict[str, Any]:
    """A strip of light just below the slab, facing up, in the middle at x."""
    return quad([x - width / 2.0, -50.0, -THICK - 1e-3], [width, 0.0, 0.0], [0.0, 100.0, 0.0], emission=1.0)


ABOVE = quad([-100.0, -100.0, 10.0], [0.0, 200.0, 0.0], [200.0, 0.0, 0.0], emission=1.0)
ANGLES = (0.0, 30.0, 56.3, 75.0)


@pytest.mark.parametrize("roulette", ["throughput", "none"])
@pytest.mark.parametrize("degrees", ANGLES)
def test_slab_transmits(evidence: Evidence, studio: Studio, degrees: float, roulette: str) -> None:
    # All reflections inside added up: (1 - R)^2 / (1 - R^2) = (1 - R) / (1 + R), R at either face.
    share = float(fresnel(math.cos(math.radians(degrees)), 1.5))
    pixels = studio.pixels(slab(degrees, [below(0.0, 80.0)]), spp=64, roulette=roulette, max_depth=100)
    evidence.mean_is("transmitted", pixels, (1.0 - share) / (1.0 + share))


@pytest.mark.parametrize("degrees", ANGLES)
def test_slab_reflects(evidence: Evidence, studio: Studio, degrees: float) -> None:
    share = float(fresnel(math.cos(math.radians(degrees)), 1.5))
    pixels = studio.pixels(slab(degrees, [ABOVE]), spp=64, roulette="none", max_depth=100)
    evidence.mean_is("reflected", pixels, 2.0 * share / (1.0 + share))


def test_only_the_ratio_of_the_indices_counts(evidence: Evidence, studio: Studio) -> None:
    share = float(fresnel(math.cos(math.radians(50.0)), 1.33 / 1.7))
    pixels = studio.pixels(slab(50.0, [below(0.0, 80.0)], 1.33, 1.7), spp=64, roulette="none", max_depth=100)
    evidence.mean_is("transmitted", pixels, (1.0 - share) / (1.0 + share))


def test_total_reflection(evidence: Evidence, studio: Studio) -> None:
    # Beyond asin(1.33 / 1.7) = 51.5 degrees nothing enters, and all comes back.
    what = slab(55.0, [below(0.0, 80.0)], 1.33, 1.7)
    assert not studio.pixels(what, 16, spp=16).any()
    evidence.mean_is("reflected", studio.pixels(slab(55.0, [ABOVE], 1.33, 1.7), 16, spp=16), 1.0)


@pytest.mark.parametrize("degrees", [30.0, 75.0])
def test_light_leaves_where_snell_says(evidence: Evidence, studio: Studio, degrees: float) -> None:
    # It comes out THICK tan(refracted) beside where it entered; what was reflected inside 2 THICK tan further on.
    mu = math.cos(math.radians(degrees))
    inside, share = float(refracted_cosine(mu, 1.5)), float(fresnel(mu, 1.5))
    shift = THICK * math.sqrt(1.0 - inside * inside) / inside + 1e-3 * math.tan(math.radians(degrees))
    straight = (THICK + 1e-3) * math.tan(math.radians(degrees))
    width = 0.1 * abs(straight - shift)
    for name, place, exact in (
        ("at once", shift, (1.0 - share) ** 2),
        ("after two reflections", 3.0 * shift - 2e-3 * math.tan(math.radians(degrees)), (1.0 - share) ** 2 * share**2),
        ("straight on", straight, 0.0),
    ):
        what = slab(degrees, [below(place, width)])
        pixels = studio.pixels(what, spp=64, roulette="none", max_depth=100)
        evidence.mean_is(name, pixels, exact)


def test_built_in_slab(evidence: Evidence, studio: Studio) -> None:
    evidence.mean_is("image", studio.pixels(clrender.load("slab"), 64, spp=64), 12.0 / 13.0)
