"""Between surfaces that absorb nothing paths end all the same, and without bias."""

from __future__ import annotations

from typing import Any

import pytest
from render_support import Studio, lambert, scene, sphere
from stats_support import Evidence

import clrender
from clrender.device import Device

WITHIN = {"position": [0.0, 0.0, 0.0], "target": [0.3, 0.2, 1.0], "vertical_fov": 40.0}
MIRRORS = {"type": "box", "size": [2.0, 3.0, 2.5], "flip_normals": True, "material": "all"}
ROULETTES: list[dict[str, Any]] = [{"roulette": "none"}, {"roulette": "absorption"}]


@pytest.mark.parametrize("roulette", ROULETTES, ids=str)
@pytest.mark.parametrize("material", ["mirror", "lambert"])
@pytest.mark.parametrize("integrator", ["path", "direct", "whitted", "reuse"])
def test_a_closed_room_that_absorbs_nothing_ends(
    device: Device, integrator: str, material: str, roulette: dict[str, Any]
) -> None:
    what = scene([MIRRORS], (), WITHIN, all={"type": material, "reflectance": [1.0, 1.0, 1.0]})
    made = clrender.render(what, device=device.info.index, size=(8, 8), spp=1, integrator=integrator, **roulette)
    assert made.linear.max() == 0.0 and made.stats["nonfinite_samples"] == 0
    followed = material == "mirror" or integrator in ("path", "reuse")
    assert 1024 <= made.stats["max_depth"] < 16384 if followed else made.stats["max_depth"] <= 1


def test_long_paths_are_not_cut(evidence: Evidence, studio: Studio) -> None:
    """In a sphere that shines and reflects 0.998, radiance is E / (1 - 0.998); an eighth comes after 1024 events."""
    shell = sphere((0.0, 0.0, 0.0), 1.0, emission=0.01, flip_normals=True, material="wall")
    what = scene([shell], (), WITHIN, wall=lambert(0.998))
    pixels = studio.pixels(what, 16, spp=16, roulette="none", sampling="bsdf")
    evidence.mean_is("radiance", pixels, 0.01 / (1.0 - 0.998), rounding=1e-3)
