"""Radiosity of a scene that changes: an update ends where a fresh start ends, and traces few rays for it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy.stats import t as student

import clrender
from clrender.device.launch import LaunchConfig
from clrender.radiosity.animate import picture
from clrender.radiosity.dynamic import DynamicRadiosity
from clrender.radiosity.sides import carried_radiance, covered_rays, sealed_sides
from clrender.radiosity.solution import RadiositySettings
from clrender.radiosity.tracer import Tracer
from clrender.settings import RenderSettings

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from clrender.device import Device
    from clrender.scene import Scene

TOLERANCE = 1e-4
SOUGHT = RadiositySettings(1500, 64, 16, TOLERANCE, refine=False)
BOX, TETRAHEDRON, SMALL_SPHERE, LAMP = 8, 9, 12, 6


def room(**more: Any) -> Scene:
    return clrender.load("room-diffuse").model_copy(update=more)


def distance(a: DynamicRadiosity, before: Any) -> float:
    """Largest difference of a side's radiance, against the mean radiance."""
    areas = np.repeat(a.patches.areas, 2)[:, None]
    now = a.reflected[:-1]
    return float(np.abs(now - before[:-1]).max() / ((now * areas).sum() / areas[now.any(axis=1)].sum() / 3.0))


def follow(dynamic: DynamicRadiosity, change: Callable[[], Any]) -> tuple[Any, float]:
    """Make a change, and how far the solution then is from a fresh start."""
    update = change()
    dynamic.settle()
    updated, hits, light = dynamic.reflected, dynamic.rows.met.copy(), dynamic.rows.irradiance.copy()
    dynamic.start_again()
    if hits.shape == dynamic.rows.met.shape:
        # The tree is another one now, and a hit within roundings of its leaf's box may go either way
        assert (hits != dynamic.rows.met).mean() < 1e-4
        assert (np.abs(light - dynamic.rows.irradiance).max(axis=1) > 0).mean() < 1e-3
    return update, distance(dynamic, updated)


MOVES = {
    "a sphere": [(SMALL_SPHERE, (0.1, 0.0, 0.0))],
    "a box, there and further": [(BOX, (0.05, 0.3, 0.1)), (BOX, (0.3, 0.0, 0.6))],
    "a box across another shape": [(TETRAHEDRON, (0.1, 0.2, -1.0))],
    "a lamp": [(LAMP, (0.2, -0.5, 0.3))],
}


@pytest.mark.long
@pytest.mark.parametrize("name", MOVES)
def test_an_update_ends_where_a_fresh_start_does(device: Device, name: str) -> None:
    dynamic = DynamicRadiosity(room(), device, SOUGHT)
    first = dynamic.reflected
    for shape, by in MOVES[name][:-1]:
        dynamic.move(shape, by)
    shape, by = MOVES[name][-1]
    update, off = follow(dynamic, lambda: dynamic.move(shape, by))
    # What is below the tolerance on either side is passed on by reflectances up to 0.75
    assert off < 2.0 * TOLERANCE / (1.0 - 0.75)
    assert update.rays < 0.4 * update.all_rays
    if first.shape == dynamic.reflected.shape:
        assert distance(dynamic, first) > 20.0 * TOLERANCE  # there was something to follow
    dynamic.release()


@pytest.mark.long
def test_there_and_back_again(device: Device) -> None:
    dynamic = DynamicRadiosity(room(), device, SOUGHT)
    count = len(room().shapes)
    with pytest.raises(clrender.UsageError, match=f"there is no shape {count}; the scene has {count}"):
        dynamic.move(count, (0.0, 0.0, 1.0))
    before = dynamic.reflected
    dynamic.move(SMALL_SPHERE, (0.25, 0.5, 0.0))
    dynamic.move(SMALL_SPHERE, (-0.25, -0.5, 0.0))
    dynamic.settle()
    size = min(len(before), len(dynamic.reflected))
    assert distance(dynamic, before[:size]) < 2.0 * TOLERANCE / (1.0 - 0.75)
    dynamic.release()


@pytest.mark.long
def test_what_is_kept_up_to_date_is_what_would_be_found_anew(device: Device) -> None:
    """What arrives at each side and how much of it is covered, after steps that only say what they changed."""
    dynamic = DynamicRadiosity(room(), device, SOUGHT)
    steps = [(SMALL_SPHERE, (0.1, 0.0, 0.0)), (SMALL_SPHERE, (0.1, 0.0, 0.0)), (LAMP, (0.1, -0.2, 0.0))]
    # At last far enough that something stands between where they were and where they are
    for shape, by in [*steps, (BOX, (0.1, 0.1, 0.2)), (SMALL_SPHERE, (1.7, 0.1, 0.2)), (BOX, (3.0, 0.1, 0.0))]:
        dynamic.move(shape, by)
        rows = dynamic.rows
        assert np.array_equal(rows._covered, covered_rays(rows.met, sealed_sides(dynamic.patches)))
        assert rows._arriving is not None
        anew = rows._gathered(carried_radiance(dynamic.patches) + dynamic.reflected)
        assert np.abs(rows._arriving - anew).max() < 1e-5 * anew.mean()
        tracer = Tracer(device, dynamic.flat, SOUGHT.rays, SOUGHT.seed)
        assert (tracer.hits(rows.sides) != rows.met).mean() < 1e-4
        light, seen = tracer.direct(rows.sides, SOUGHT.direct_samples)
        assert (seen != rows.seen).mean() < 1e-3 and (light != rows.irradiance).any(axis=1).mean() < 1e-3
        tracer.release()
    dynamic.release()


@pytest.mark.long
def test_the_same_bits_however_cut(device: Device) -> None:
    """Steps of a shape beside others and inside of one, and of a lamp."""
    sought = RadiositySettings(700, 48, 8, 1e-3, refine=False)
    steps = [(SMALL_SPHERE, (0.1, 0.0, 0.0)), (LAMP, (0.2, -0.3, 0.0)), (BOX, (0.1, 0.0, 0.3)), (BOX, (0.1, 0.0, 0.1))]

    def found(cut: LaunchConfig | None) -> list[bytes]:
        dynamic = DynamicRadiosity(room(), device, sought, cut=cut)
        result = []
        for shape, by in steps:
            rays = dynamic.move(shape, by).rays
            result += [dynamic.reflected.tobytes(), dynamic.rows.met.tobytes(), str(rays).encode()]
        dynamic.release()
        return result

    assert found(LaunchConfig(1, 16, traversal="single")) == found(None)


@pytest.mark.long
def test_a_gathered_frame_shows_what_path_tracing_shows(device: Device) -> None:
    """After a move: direct light of the scene as it is now, and indirect light of the patches brought up to date.

    The largest of 48 tiles' and channels' differences, at a false-alarm rate of 1e-4 (Bonferroni; errors from 8 seeds
    each), and 0.3 % of the tile for what 3000 patches are too coarse for, two surfaces on.
    """
    dynamic = DynamicRadiosity(room(), device, RadiositySettings(3000, 64, tolerance=1e-3, refine=False))
    by = (0.3, 0.2, 0.3)
    dynamic.move(BOX, by)
    shapes = list(room().shapes)
    transform = shapes[BOX].transform
    assert transform.matrix is None
    place = tuple(a + b for a, b in zip(transform.translate, by, strict=True))
    shapes[BOX] = shapes[BOX].model_copy(update={"transform": transform.model_copy(update={"translate": place})})
    moved = room(shapes=tuple(shapes))

    def tiles(pixels: NDArray[np.float32]) -> NDArray[np.float64]:
        means: NDArray[np.float64] = pixels.reshape(4, 8, 4, 8, 3).astype(np.float64).mean(axis=(1, 3))
        return means

    def gathered(seed: int) -> NDArray[np.float64]:
        settings = RenderSettings(width=32, height=32, seed=seed).struct(16)
        return tiles(picture(dynamic, device, settings, 64, "gather", None))

    frames = np.array([gathered(seed) for seed in range(8)])
    paths = np.array([tiles(clrender.render(moved, size=(32, 32), spp=64, seed=100 + s).linear) for s in range(8)])
    error = np.sqrt((frames.var(axis=0, ddof=1) + paths.var(axis=0, ddof=1)) / 8.0)
    difference = np.abs(frames.mean(axis=0) - paths.mean(axis=0))
    assert (error < 0.02 * paths.mean(axis=0)).all()
    assert (difference < student.isf(1e-4 / 96, 14) * error + 0.003 * paths.mean(axis=0)).all()
    dynamic.release()


@pytest.mark.long
def test_near_the_observer_first(device: Device) -> None:
    """A frame leaves more undone far away than near, and no more than it may: the rest is done by `settle`."""
    dynamic = DynamicRadiosity(room(), device, RadiositySettings(1500, 64, 16, 3e-3, refine=False))
    dynamic.move(BOX, (0.3, 0.2, 0.3))
    quick = dynamic.reflected
    assert dynamic.settle() > 1
    error = np.abs(dynamic.reflected - quick)[:-1].max(axis=1)
    weight = dynamic._weights
    used = dynamic.used[:-1]
    near, far = used & (weight > 0.9), used & (weight < 0.3)
    assert near.sum() > 50 and far.sum() > 50
    assert error[near].mean() < error[far].mean()
    dynamic.release()


@pytest.mark.slow
def test_a_frame_takes_little_of_a_solution(device: Device) -> None:
    """Counted and not timed: the rays traced again, and the sweeps."""
    dynamic = DynamicRadiosity(room(), device, RadiositySettings(20000, 256, tolerance=1e-3, refine=False))
    updates = [dynamic.move(SMALL_SPHERE, (0.05, 0.0, 0.0)) for _ in range(4)]
    whole = dynamic.start_again()
    for update in updates:
        assert update.rays < 0.1 * update.all_rays and update.sweeps < whole.sweeps
    dynamic.release()
