"""Renders that are far slower than those of the integrator path say so; all others do not."""

from __future__ import annotations

from typing import Any

import pytest

import clrender
from clrender.integrators import INTEGRATORS
from clrender.rendering.effort import effort_told


def told(scene: str, **settings: Any) -> str | None:
    return effort_told(clrender.RenderJob.of(clrender.load(scene), **settings))


def test_many_more_photons_than_pixels_are_told() -> None:
    line = told("room", integrator="photon", size=(64, 64), spp=16)
    assert (
        line is not None and "131,072 photons for each sample, 32 times as many paths" in line and "--photons" in line
    )
    assert "for this image" in line
    assert told("room", integrator="photon", size=(64, 64), spp=1) == line
    assert told("room", integrator="photon", size=(800, 800)) is None
    assert told("room", integrator="photon", size=(64, 64), photons=8192) is None


def test_light_paths_of_a_whole_image_for_a_small_crop_are_told() -> None:
    line = told("room", integrator="bdpt", size=(64, 64), crop=(0, 0, 8, 8), spp=1)
    assert line is not None and "traces 4096 light paths for each sample, 64 times" in line
    assert "for this part of the image" in line
    assert told("room", integrator="bdpt", size=(64, 64), spp=1) is None


def test_a_solution_of_many_more_rays_than_the_image_has_is_told() -> None:
    line = told("cornell", integrator="radiosity", size=(64, 64), spp=16)
    assert line is not None and "256 rays from each of about 8000 patches, 31 times as many paths" in line
    assert told("cornell", integrator="radiosity", size=(64, 64), spp=1024) is None
    assert told("cornell", integrator="radiosity", size=(64, 64), spp=16, patches=500) is None


@pytest.mark.parametrize("name", sorted(set(INTEGRATORS) - {"photon", "radiosity"}))
def test_integrators_that_follow_paths_from_the_camera_say_nothing(name: str) -> None:
    assert told("cornell", integrator=name, size=(8, 8), spp=16) is None
