"""Light paths of random scenes of everything add up to pixels of renders, bit for bit."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from mixed_files import written
from mixed_moves import compiled_for_volumes, with_all_features
from mixed_scenes import KINDS, Mixed, mixed_scene
from paths_support import same_as_render

import clrender

if TYPE_CHECKING:
    from clrender.device import Device

SIZE = (24, 20)
WAYS: tuple[dict[str, Any], ...] = (
    {},
    {"max_depth": 4},
    {"sampling": "bsdf"},
    {"sampling": "light", "light_sampler": "bvh"},
    {"roulette": "constant"},
    {"seed": 11},
)
"""They need no program of their own."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("mixed"))


@pytest.fixture(scope="module")
def session(device: Device) -> Iterator[clrender.Session]:
    with clrender.Session(device.info.index) as opened:
        yield opened


def add_up(
    session: clrender.Session, folder: Path, numbers: range, pixels: int, *, all_features: bool, **settings: Any
) -> int:
    """Check some pixels of some mixed scenes; returns how many additions there were."""
    additions = 0
    for number in numbers:
        mixed, rng = mixed_scene(KINDS[number % len(KINDS)], number // len(KINDS)), random.Random(number)
        scene = (Mixed(mixed.name, with_all_features(mixed.content)) if all_features else mixed).scene(folder)
        chosen = [(rng.randrange(SIZE[0]), rng.randrange(SIZE[1])) for _ in range(pixels)]
        way = {**WAYS[number % len(WAYS)], **settings}
        for found in same_as_render(session, scene, chosen, size=SIZE, spp=4, **way):
            additions += sum(len(each.additions) for sample in found.samples for each in sample.vertices)
    return additions


@pytest.mark.long
def test_paths_of_a_few_mixed_scenes_add_up(session: clrender.Session, folder: Path) -> None:
    assert add_up(session, folder, range(len(KINDS)), 3, all_features=False) > 50


MANY: tuple[dict[str, Any], ...] = (
    {},
    {"spectral": True},
    {"filter": "mitchell", "shadow_rays": 2},
    {"integrator": "bdpt", "sampling": "mis", "light_sampler": "power"},
)


@pytest.mark.slow
@pytest.mark.parametrize("settings", MANY, ids=str)
def test_paths_of_many_mixed_scenes_add_up(session: clrender.Session, folder: Path, settings: dict[str, Any]) -> None:
    """A thousand pixels each, by one program for all scenes."""
    with compiled_for_volumes():
        assert add_up(session, folder, range(200), 5, all_features=True, **settings) > 5000
