"""Checks that the light paths of a pixel are those of a render: bits of the pixel, and sums of what was recorded."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from exact_sums import quanta

import clrender
from clrender.inspection import LightPath, PixelPaths
from clrender.inspection.tracing import paths_in

__all__ = ["bits", "check_sample", "check_sums", "paths_of", "same_as_render"]


def bits(values: Any) -> list[int]:
    """The bits of float32 numbers."""
    return np.ascontiguousarray(values, np.float32).view(np.uint32).ravel().tolist()


def paths_of(
    session: clrender.Session,
    scene: clrender.Scene,
    pixel: tuple[int, int],
    *,
    samples: int | None = None,
    **settings: Any,
) -> PixelPaths:
    """The paths of a pixel of a render with these settings."""
    return paths_in(session, clrender.RenderJob.of(scene, **settings), pixel, samples)


def same_as_render(
    session: clrender.Session, scene: clrender.Scene, pixels: Iterable[tuple[int, int]], **settings: Any
) -> list[PixelPaths]:
    """Check that paths add up to some pixels of a render, and return them."""
    image = session.render(scene, **settings).linear
    made = []
    for x, y in pixels:
        found = paths_of(session, scene, (x, y), **settings)
        assert bits(found.radiance) == bits(image[y, x]), (x, y)
        check_sums(found)
        made.append(found)
    return made


def check_sums(found: PixelPaths) -> None:
    """Check that the values of the samples add up to the pixel, and additions to each sample, bit for bit."""
    taken = [value for value in found.values if np.isfinite(value).all() and (np.abs(value) < 2.0**43).all()]
    assert len(found.values) - len(taken) == found.nonfinite_samples
    sums = [sum(quanta(value[channel]) for value in taken) for channel in range(3)]
    means = [total / 2**64 / max(len(taken), 1) for total in sums]
    assert bits(found.radiance) == bits(np.array(means, np.float64).astype(np.float32))
    for sample in found.samples:
        assert bits(sample.value) == bits(found.values[sample.index])
        check_sample(sample)


def check_sample(sample: LightPath) -> None:
    """Check that what was added to a path is its radiance, in single precision and in the order of the additions."""
    every = [addition for vertex in sample.vertices for addition in vertex.additions]
    made = sorted((each for each in every if each.order), key=lambda each: each.order)
    if sample.rows_left_out:
        return
    assert [each.order for each in made] == list(range(1, len(made) + 1))
    total = np.zeros(3, np.float32)
    with np.errstate(all="ignore"):
        for each in made:
            total = total + each.added
    assert bits(total) == bits(sample.radiance)
    if sample.wavelengths is None:
        assert bits(sample.radiance * np.float32(sample.filter_weight)) == bits(sample.value)
    else:
        colors = sum((each.contribution.astype(np.float64) for each in made), np.zeros(3))
        slack = 1e-5 + 1e-4 * float(np.abs(sample.value).max())
        np.testing.assert_allclose(colors, sample.value, rtol=1e-4, atol=slack)
    for each in every:
        assert (each.order > 0) == each.arrives
        if each.light is not None and (each.light_pdf >= 1e-30 or each.in_full):
            assert abs(each.light_weight + each.bsdf_weight - 1.0) < 1e-5, each  # the balance heuristic
        if each.arrives and each.strategy == "light sample":
            assert each.shadow_ray and each.light_pdf > 0.0 and 0.0 <= each.light_weight <= 1.0
        elif not each.arrives:
            assert not each.added.any() and not each.contribution.any()
