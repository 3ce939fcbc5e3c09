"""Between surfaces that absorb nothing paths end all the same, and without bias."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from render_support import Studio, lambert, scene, sphere
from sampling_support import launch
from stats_support import Evidence

import clrender
from clrender import layout
from clrender.device import Device

WITHIN = {"position": [0.0, 0.0, 0.0], "target": [0.3, 0.2, 1.0], "vertical_fov": 40.0}
MIRRORS = {"type": "box", "size": [2.0, 3.0, 2.5], "flip_normals": True, "material": "all"}
ROULETTES: list[dict[str, Any]] = [{"roulette": "none"}, {"roulette": "constant"}]

LONG = 8192


@pytest.mark.parametrize("roulette", ["none", "constant", "throughput"])
def test_every_long_path_may_end(device: Device, roulette: str) -> None:
    """Whichever roulette is asked for: of 2^15 paths that get there, one reaches six million events."""
    depth = np.arange(2**23, dtype=np.uint32)
    kind = np.uint32(getattr(layout, f"ROULETTE_{roulette.upper()}"))
    survival, played = launch(device, "sampling_roulette", np.stack([depth, depth]), [kind], 2)
    late = depth >= LONG
    assert (played[late] == 1.0).all() and (survival[late] < 1.0).all()
    assert (survival[~late] == 1.0).all(), "what ends paths sooner is not asked for, or finds nothing absorbed"
    reached = np.exp(np.cumsum(np.log(survival.astype(np.float64))))
    assert reached[2 * LONG] == pytest.approx(0.5, rel=1e-3) and reached[6_000_000] < 1e-6
    assert reached.sum() < 6.1 * LONG, "the mean length, where nothing is absorbed"


@pytest.mark.thorough
@pytest.mark.parametrize("roulette", ROULETTES, ids=str)
@pytest.mark.parametrize("material", ["mirror", "lambert"])
@pytest.mark.parametrize("integrator", ["path", "direct", "whitted", "reuse"])
def test_a_closed_room_that_absorbs_nothing_ends(
    device: Device, integrator: str, material: str, roulette: dict[str, Any]
) -> None:
    what = scene([MIRRORS], (), WITHIN, all={"type": material, "reflectance": [1.0, 1.0, 1.0]})
    made = clrender.render(what, device=device.info.index, size=(4, 4), spp=1, integrator=integrator, **roulette)
    assert made.linear.max() == 0.0 and made.stats["nonfinite_samples"] == 0
    followed = material == "mirror" or integrator in ("path", "reuse")
    assert LONG <= made.stats["max_depth"] < 2**23 if followed else made.stats["max_depth"] <= 1


def test_long_paths_are_not_cut(evidence: Evidence, studio: Studio) -> None:
    """In a sphere that shines and reflects 0.998, radiance is E / (1 - 0.998)."""
    shell = sphere((0.0, 0.0, 0.0), 1.0, emission=0.01, flip_normals=True, material="wall")
    what = scene([shell], (), WITHIN, wall=lambert(0.998))
    pixels = studio.pixels(what, 4, spp=4, roulette="none", sampling="bsdf")
    evidence.mean_is("radiance", pixels, 0.01 / (1.0 - 0.998), rounding=1e-3)
