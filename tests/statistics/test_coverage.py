"""Confidence intervals hold the truth as often as they say, at the end that the renders chose themselves."""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import clrender
from clrender.device import Device

ROOT = Path(__file__).resolve().parents[2]
SEEDS = int(os.environ.get("CLRENDER_COVERAGE_SEEDS", "40"))
SIDE = 12


def _script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("coverage_of_intervals", ROOT / "scripts" / "coverage.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


COVERAGE: Any = _script()


def check(device: Device, name: str, seeds: int, **more: Any) -> None:
    """Bounds are five standard deviations of what an interval of exactly 95 % gives: one false alarm in 3 million.

    Pixels of one image are independent of each other, so those of all seeds are taken together; each alone is held
    against a bound of its own.
    """
    with clrender.Session(device) as session:
        found = COVERAGE.coverage(session, name, seeds, SIDE, COVERAGE.SCENES[name], **more)
    print(f"{name}: {found.planned.mean():.4f}, {found.planned.min():.3f}, {found.mean:.3f}, {found.bias:+.3f}")

    def least(count: int) -> float:
        return 0.95 - 5.0 * float(np.sqrt(0.95 * 0.05 / count))

    assert found.planned.mean() >= least(seeds * SIDE * SIDE)
    assert found.planned.min() >= least(seeds)
    assert found.mean >= least(seeds)
    assert abs(found.bias) < 0.1 + 5.0 / np.sqrt(seeds * SIDE * SIDE)


@pytest.mark.long
def test_intervals_hold_what_they_say(device: Device) -> None:
    check(device, "textures", 12)


@pytest.mark.slow
@pytest.mark.parametrize("name", COVERAGE.SCENES)
def test_intervals_hold_what_they_say_in_every_kind_of_scene(device: Device, name: str) -> None:
    check(device, name, SEEDS)


@pytest.mark.slow
def test_intervals_of_bidirectional_paths(device: Device) -> None:
    """Pixels of an image share light paths: the interval of its mean allows for any correlation."""
    check(device, "lens", SEEDS, integrator="bdpt")


@pytest.mark.slow
def test_intervals_of_guided_paths(device: Device) -> None:
    """A field is trained by paths of its own, so samples are as independent as without."""
    check(device, "lens", SEEDS, guiding="on", guiding_paths=1 << 15)


@pytest.mark.slow
def test_intervals_of_specular_chains(device: Device) -> None:
    """Trials of walks are of a geometric distribution: of what they bring few samples are much."""
    check(device, "lens", SEEDS, specular_chains="on")
