"""What rays find on curves, against the definition in double precision: the spheres around all points of a strand."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from kernel_support import Hits, Rays, finds_what_leaves_hold, trace, tree_on

import clrender
from clrender.device import Device
from clrender.flatten.curves import bezier_segments
from clrender.flatten.flat_scene import FlatScene, flatten

RNG = np.random.default_rng(0)
Floats = npt.NDArray[np.float64]
STEPS = 400
"""Spheres of a segment of a strand by which the definition is approximated."""


@pytest.fixture(autouse=True)
def _same_numbers_in_any_order() -> None:
    RNG.bit_generator.state = np.random.default_rng(0).bit_generator.state


def strands(count: int, points: int, radius: float, bend: float = 0.5) -> Floats:
    """Strands that bend at random and get thinner, (count, points, 4), in a cube of about 2 metres."""
    place, rows = RNG.uniform(-0.7, 0.7, (count, 3)), np.zeros((count, points, 4))
    way = RNG.normal(size=(count, 3))
    for number in range(points):
        rows[:, number, :3], rows[:, number, 3] = place, radius * (1.0 - 0.7 * number / points)
        way = way / np.linalg.norm(way, axis=1)[:, None] + bend * RNG.normal(size=(count, 3))
        place = place + 0.2 * way / np.linalg.norm(way, axis=1)[:, None]
    return rows


def flat_strands(rows: Floats, basis: str = "bspline") -> FlatScene:
    shape = {"type": "curves", "file": "strands", "basis": basis}
    camera = {"position": (0.0, 0.0, 5.0), "target": (0.0, 0.0, 0.0)}
    scene = clrender.Scene.model_validate({"camera": camera, "shapes": [shape]})
    return flatten(scene.with_arrays(curves={"strands": rows}), 8, 8)


def spheres(rows: Floats, basis: str = "bspline") -> Floats:
    """Spheres along all strands, (n, 4)."""
    counts = np.full(len(rows), rows.shape[1])
    controls, _ = bezier_segments(rows.reshape(-1, 4), counts, basis, "strands")
    u = np.linspace(0.0, 1.0, STEPS + 1)[None, :, None]
    a, b, c, d = (controls[:, None, k] for k in range(4))
    v = 1.0 - u
    return np.asarray(v**3 * a + 3 * v * v * u * b + 3 * v * u * u * c + u**3 * d).reshape(-1, 4)


def rays_at(rows: Floats, count: int, basis: str = "bspline", aside: float = 1.5) -> Rays:
    """Rays to points next to the strands: most of them hit."""
    some = spheres(rows, basis)
    target = some[RNG.integers(0, len(some), count)]
    way = RNG.normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    off = RNG.normal(size=(count, 3))
    off *= (RNG.uniform(0.0, aside, count) * target[:, 3] / np.linalg.norm(off, axis=1))[:, None]
    lengths = 10.0 ** RNG.uniform(-1.0, 1.0, (count, 1))
    return Rays.of(target[:, :3] + off - RNG.uniform(0.5, 4.0, (count, 1)) * way, way * lengths)


def expected(rows: Floats, rays: Rays, basis: str = "bspline") -> tuple[Floats, Floats]:
    """Distances of the first entry into any sphere, metres, and how deep the rays get into one, by its radius."""
    some, found, depth = spheres(rows, basis), np.full(len(rays), np.inf), np.full(len(rays), -np.inf)
    for number, (o, d) in enumerate(
        zip(rays.origins.astype(np.float64), rays.directions.astype(np.float64), strict=True)
    ):
        d = d / np.linalg.norm(d)
        to = some[:, :3] - o
        middle = to @ d
        chord2 = some[:, 3] ** 2 - ((to * to).sum(axis=1) - middle * middle)
        near = np.where(chord2 > 0.0, middle - np.sqrt(np.maximum(chord2, 0.0)), np.inf)
        found[number] = near.min()
        depth[number] = (chord2 / np.maximum(some[:, 3] ** 2, 1e-12)).max()
    return found, depth


def found_on(device: Device, flat: FlatScene, rays: Rays, **how: Any) -> Hits:
    with tree_on(device, flat) as tree:
        return trace(tree, rays, **how)


@pytest.mark.parametrize(
    ("basis", "points", "radius"),
    [
        ("bspline", 6, 0.002),
        ("bspline", 6, 0.03),
        ("bezier", 7, 0.01),
        ("catmull-rom", 5, 0.01),
        ("linear", 5, 0.02),
    ],
)
def test_rays_enter_the_spheres_along_strands(device: Device, basis: str, points: int, radius: float) -> None:
    rows = strands(12, points, radius)
    rays = rays_at(rows, 1500, basis)
    hits = found_on(device, flat_strands(rows, basis), rays)
    lengths = np.linalg.norm(rays.directions.astype(np.float64), axis=1)
    found = hits.distances * lengths
    distance, depth = expected(rows, rays, basis)
    met = hits.primitives != 0xFFFFFFFF
    assert 0.3 < met.mean() < 0.98
    # Next to the rim both are right
    sure = np.abs(depth) > 0.02
    assert (met == (depth > 0.0))[sure].mean() > 0.998
    off = np.abs(found - distance)[met & (depth > 0.02)] / radius
    # Few enter between two of the spheres, or where a strand that bends is met twice
    assert np.median(off) < 0.02 and (off < 0.2).mean() > 0.995, (np.median(off), (off < 0.2).mean())


@pytest.mark.parametrize(("lanes", "single"), [(1, True), (1, False), (4, False), (8, False), (8, True)])
def test_all_traversals_find_the_same(device: Device, lanes: int, single: bool) -> None:
    rows = np.concatenate([strands(40, 6, 0.02), strands(40, 6, 0.004)])
    flat, rays = flat_strands(rows), rays_at(rows, 3000)
    hits, every = found_on(device, flat, rays), found_on(device, flat, rays, lanes=lanes, single=single)
    assert np.array_equal(hits.distances, every.distances) and np.array_equal(hits.primitives, every.primitives)
    assert np.array_equal(hits.occluded, every.occluded)
    with tree_on(device, flat) as tree:
        assert finds_what_leaves_hold(tree, rays)


def test_strands_have_no_gaps_where_segments_meet(device: Device) -> None:
    """Rays straight at the axis of a strand, at and next to its joints, all hit."""
    rows = strands(10, 9, 0.003, bend=0.3)
    controls, strand = bezier_segments(rows.reshape(-1, 4), np.full(10, 9), "bspline", "strands")
    inner = np.flatnonzero(strand[1:] == strand[:-1]) + 1
    joints, along = controls[inner, 0, :3], controls[inner, 1, :3] - controls[inner, 0, :3]
    along /= np.linalg.norm(along, axis=1)[:, None]
    joints, along = np.repeat(joints, 400, axis=0), np.repeat(along, 400, axis=0)
    places = joints + along * RNG.normal(size=(len(joints), 1)) * 1e-5
    way = RNG.normal(size=places.shape)
    across = np.abs((way * along).sum(axis=1)) < 0.9 * np.linalg.norm(way, axis=1)
    rays = Rays.of((places - 2.0 * way)[across], way[across])
    hits = found_on(device, flat_strands(rows), rays)
    assert (hits.primitives != 0xFFFFFFFF).all()


def test_rays_that_begin_inside_meet_no_surface_of_their_strand(device: Device) -> None:
    """Also across joints, along the strand: tubes are hit from outside alone."""
    rows = strands(1, 12, 0.02, bend=0.1)
    some = spheres(rows)
    places = some[RNG.integers(STEPS // 2, len(some) - STEPS // 2, 4000)]
    way = RNG.normal(size=(4000, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    off = RNG.normal(size=(4000, 3))
    off *= (RNG.uniform(0.0, 0.9, 4000) * places[:, 3] / np.linalg.norm(off, axis=1))[:, None]
    hits = found_on(device, flat_strands(rows), Rays.of(places[:, :3] + off, way))
    assert (hits.primitives == 0xFFFFFFFF).mean() > 0.999


def odd_strand(kind: str) -> tuple[Floats, str]:
    """One strand, (1, n, 4), whose spheres grow, swell or stop, and its basis."""
    rows = np.zeros((6, 4))
    rows[:, 2] = np.linspace(0.5, -0.5, 6)
    rows[:, 3] = 0.05
    if kind == "widens":
        rows[:, 3] = np.linspace(0.01, 0.3, 6)
    elif kind == "widens fast":
        rows[:, 2], rows[:, 3] = np.linspace(0.05, -0.05, 6), np.linspace(0.01, 0.3, 6)
    elif kind == "tip":
        rows[:, 3] = np.linspace(0.2, 0.0, 6)
    elif kind == "swells":
        rows[:, 3] = (0.05, 0.05, 0.3, 0.3, 0.05, 0.05)
    elif kind == "peaks":
        # At inner sides of bends both neighbours are narrower than the sphere where they meet
        rows[:, 0], rows[:, 3] = (0.0, 0.0, 0.15, 0.0, 0.0, 0.0), (0.02, 0.02, 0.2, 0.02, 0.1, 0.02)
    elif kind == "doubled":
        return rows[[0, 0, 5, 5]][None], "bezier"
    return rows[None], "bspline" if kind == "swells" else "linear"


@pytest.mark.parametrize("kind", ["widens", "widens fast", "tip", "swells", "peaks", "doubled"])
@pytest.mark.parametrize("way", [(0.0, 0.0, -1.0), (0.0, 0.0, 1.0), (0.3, 0.1, -1.0), (0.1, 0.3, 1.0), (1.0, 0.2, 0.1)])
def test_strands_that_swell_or_stop_from_all_sides(device: Device, kind: str, way: tuple[float, ...]) -> None:
    """Also along the axis, where the nearest sphere may be an end or none of one that is thin."""
    rows, basis = odd_strand(kind)
    direction = np.array(way) / np.linalg.norm(way)
    first = np.cross(direction, (0.37, 0.61, 0.7))
    first /= np.linalg.norm(first)
    second = np.cross(direction, first)
    place = RNG.uniform(-0.7, 0.7, (1500, 2))
    origins = place[:, :1] * first + place[:, 1:] * second - 3.0 * direction
    rays = Rays.of(origins, np.broadcast_to(direction, origins.shape).copy())
    flat = flat_strands(rows, basis)
    hits = found_on(device, flat, rays)
    distance, depth = expected(rows, rays, basis)
    met, sure = hits.primitives != 0xFFFFFFFF, np.abs(depth) > 0.05
    assert (met == (depth > 0.0))[sure].all()
    off = np.abs(hits.distances - distance)[met & (depth > 0.05)]
    assert off.max() < 0.02, off.max()
    for how in ({"lanes": 1}, {"lanes": 8}, {"lanes": 8, "single": True}):
        every = found_on(device, flat, rays, **how)
        assert np.array_equal(hits.distances, every.distances) and np.array_equal(hits.primitives, every.primitives)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_strands_of_any_size(device: Device, scale: float) -> None:
    rows = strands(12, 6, 0.01)
    rays = rays_at(rows, 1000)
    hits = found_on(device, flat_strands(rows), rays)
    sized = Rays.of(rays.origins * np.float32(scale), rays.directions * np.float32(scale))
    same = found_on(device, flat_strands(rows * scale), sized)
    assert (hits.primitives == same.primitives).mean() > 0.995
    both = (hits.primitives == same.primitives) & (hits.primitives != 0xFFFFFFFF)
    assert np.abs(hits.distances - same.distances)[both].max() < 2e-3


def test_curves_in_boxes_that_hold_them() -> None:
    rows = strands(30, 7, 0.02)
    flat = flat_strands(rows)
    shapes, coefficients = (
        flat.arrays["analytic_shapes"],
        flat.arrays["curve_rows"].reshape(-1, 4, 4).astype(np.float64),
    )
    u = np.linspace(0.0, 1.0, 101)[None, :, None]
    a, b, c, d = (coefficients.reshape(-1, 1, 4, 4)[:, :, k] for k in range(4))
    places = a + u * (b + u * (c + u * d))
    center, half = (shapes[name][:, None, :3].astype(np.float64) for name in ("center_radius", "normal"))
    assert (np.abs(places[..., :3] - center) + places[..., 3:] <= half).all()
    assert ((half - (np.abs(places[..., :3] - center) + places[..., 3:])).min(axis=1) < 0.1).all()
    joints = (shapes["normal"][:, 3] - 2.0).astype(int)
    assert (joints >= 0).all() and (joints[0] & 1) == 0 and (joints[-1] & 2) == 0
    assert ((joints[1:] & 1 != 0) == (joints[:-1] & 2 != 0)).all()
