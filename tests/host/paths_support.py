"""Checks that the light paths of a pixel are those of a render: bits of the pixel, and sums of what was recorded."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from exact_sums import quanta

import clrender
from clrender.inspection import Addition, LightPath, LightSubpath, PixelPaths, Splats
from clrender.inspection.tracing import paths_in

__all__ = [
    "bits",
    "check_light_path",
    "check_listed",
    "check_sample",
    "check_splats",
    "check_strategy",
    "check_sums",
    "paths_of",
    "same_as_render",
]


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
    image = session.render(scene, **settings)
    made = []
    for x, y in pixels:
        found = paths_of(session, scene, (x, y), **settings)
        assert bits(found.radiance) == bits(image.linear[y, x]), (x, y)
        check_sums(found)
        if found.splats is not None:
            assert image.film is not None
            band, row = divmod(y, image.film.band_rows)
            check_splats(found, image.film.bands()[band][row, x])
        made.append(found)
    return made


def check_splats(found: PixelPaths, sums: Any) -> None:
    """Check that paths from the camera and splats are the sums of a render's pixel, (3, 2) uint64, bit for bit."""
    assert found.splats is not None
    taken = [value for value in found.values if _counts(value)]
    total = [int(high) << 64 | int(low) for low, high in sums.tolist()]
    total = [each - (1 << 128) if each >> 127 else each for each in total]
    rest = [each - sum(quanta(value[channel]) for value in taken) for channel, each in enumerate(total)]
    assert bits(found.splats.splatted) == bits(_mean(rest, len(taken)))
    np.testing.assert_allclose(found.splats.values.sum(axis=0, dtype=np.float64), [each / 2**64 for each in rest], 1e-6)
    for value, brought in zip(found.values, found.splats.values, strict=True):
        assert _counts(value) or not brought.any()
    check_listed(found.splats, rest)


def check_listed(splats: Splats, total: list[int]) -> None:
    """Check that the splats add up to all that was splatted, in quanta, and that each has its light path."""
    by_sample = [[0, 0, 0] for _ in splats.values]
    for each in splats.paths:
        for channel in range(3):
            by_sample[each.sample][channel] += quanta(each.value[channel])
        assert each.value.any() and 0.0 < each.weight <= 1.0 and each.light_vertices >= 2
        if each.light_path is not None:
            assert each.light_path.number == each.path and each.light_path.stands_for == 1.0
            check_light_path(each.light_path, each.light_vertices)
    bright = [abs(float(np.dot(each.value.astype(np.float64), (0.2126, 0.7152, 0.0722)))) for each in splats.paths]
    assert bright == sorted(bright, reverse=True) and len(
        {(each.sample, each.path, each.light_vertices) for each in splats.paths}
    ) == len(bright)
    assert len(splats.paths) <= splats.count
    if len(splats.paths) == splats.count:
        assert [sum(channel) for channel in zip(*by_sample, strict=True)] == total
        for brought, parts in zip(splats.values, by_sample, strict=True):
            assert bits(brought) == bits(_mean(parts, 1))


def _counts(value: Any) -> bool:
    return bool(np.isfinite(value).all() and (np.abs(value) < 2.0**43).all())


def _mean(sums: Iterable[int], count: int) -> Any:
    """The mean of exact sums, as a film rounds it."""
    return np.array([total / 2**64 / max(count, 1) for total in sums], np.float64).astype(np.float32)


def check_sums(found: PixelPaths) -> None:
    """Check that the values of the samples add up to the pixel, and additions to each sample, bit for bit."""
    taken = [value for value in found.values if _counts(value)]
    assert len(found.values) - len(taken) == found.nonfinite_samples
    sums = [sum(quanta(value[channel]) for value in taken) for channel in range(3)]
    splats = found.splats
    assert (splats is not None) == (found.about["integrator"] == "bdpt")
    assert bits(found.radiance if splats is None else splats.camera) == bits(_mean(sums, len(taken)))
    for sample in found.samples:
        assert bits(sample.value) == bits(found.values[sample.index])
        assert (sample.splat is None) == (splats is None)
        assert splats is None or bits(sample.splat) == bits(splats.values[sample.index])
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
    for vertex in sample.vertices:
        for each in vertex.additions:
            check_strategy(each, vertex.depth)
    for each in every:
        assert (each.order > 0) == each.arrives
        if each.light_weight is None or each.bsdf_weight is None:
            assert sample.splat is not None  # of more strategies than two
        elif not (each.arrives or each.light_weight or each.bsdf_weight):
            assert each.light is None or each.bsdf_pdf == 0.0 or each.light_pdf < 1e-30  # no strategy finds it
        elif each.light is not None and (each.light_pdf >= 1e-30 or each.in_full):
            assert abs(each.light_weight + each.bsdf_weight - 1.0) < 1e-5, each  # the balance heuristic
        if each.arrives and each.strategy == "light sample":
            assert each.weight is not None and each.shadow_ray and each.light_pdf > 0.0 and 0.0 <= each.weight <= 1.0
        elif not each.arrives:
            assert not each.added.any() and not each.contribution.any()


def check_strategy(each: Addition, depth: int) -> None:
    """Check the numbers of vertices, the weight, and the light path of what was added after so many events."""
    if each.strategy in ("specular chain", "light centre"):
        assert each.camera_vertices is None and each.light_vertices is None
    else:
        assert each.camera_vertices == depth + 2 and each.weight is not None and 0.0 <= each.weight <= 1.0
        fixed = {"emission": 0, "medium emission": 0, "light sample": 1}
        assert each.light_vertices is not None and each.light_vertices == fixed.get(each.strategy, each.light_vertices)
        assert (each.light_vertices > 1) == (each.strategy == "connection")
    path = each.light_path
    assert (path is not None) == (each.strategy == "connection" and each.shadow_ray)
    if path is None:
        return
    assert (path.light, path.light_kind, path.object) == (each.light, each.light_kind, each.object)
    assert path.stands_for >= 1.0 and each.light_vertices is not None
    check_light_path(path, each.light_vertices)
    # It was traced again: it arrives where the first one did, with the same flux
    last = path.vertices[-1]
    assert last.position is not None and each.position is not None
    assert bits(last.throughput_in) == bits(each.emitted) and last.position.tolist() == each.position.tolist()


def check_light_path(path: LightSubpath, light_vertices: int) -> None:
    """Check that a path from a light has so many vertices, and that one leads to the next."""
    events = [vertex for vertex in path.vertices if vertex.event != "straight"]
    assert len(events) + 1 == light_vertices
    assert path.vertices[-1].event == "connection" and path.vertices[-1].position is not None
    assert [vertex.depth for vertex in events] == list(range(len(events)))
    for before, after in zip(path.vertices, path.vertices[1:], strict=False):
        assert before.roulette is None or before.roulette.survived
        assert before.ended is None and before.position is not None and after.position is not None
        to, way = after.position - before.position, float(np.linalg.norm(after.position - before.position))
        assert float(to @ after.direction_in) >= way * (1.0 - 1e-4) - 1e-3
        assert (
            before.direction is None or before.event == "straight" or bits(before.direction) == bits(after.direction_in)
        )
