"""Nearest and any hit of random and delicate rays: against double precision, the definition, and each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
import reference
from cases import for_each
from kernel_support import (
    FAR,
    Hits,
    Rays,
    analytic_rows,
    flat_scene,
    trace,
    trace_by_reference,
    trace_every_leaf,
    tree_on,
)

from clrender import layout

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.flatten.flat_scene import FlatScene

COUNT = 12800  # rays a scene, more than 1e5 in all

Points = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """A scene and rays through it."""

    corners: npt.NDArray[np.float32]
    spheres: npt.NDArray[np.void]
    disks: npt.NDArray[np.void]
    rays: Rays

    def flat(self) -> FlatScene:
        count = len(self.corners)
        order = np.arange(3 * count).reshape(-1, 3)
        return flat_scene(self.corners.reshape(-1, 3), order, np.concatenate([self.spheres, self.disks]))


def soup(rng: np.random.Generator, count: int = 120) -> Points:
    """Triangles of all sizes and thicknesses around the origin, some of them without any area."""
    middle = rng.uniform(-1, 1, (count, 1, 3))
    corners = middle + rng.normal(size=(count, 3, 3)) * 10.0 ** rng.uniform(-2.5, -0.3, (count, 1, 1))
    k = count // 6
    # Slivers, whose third corner is almost on the line of the others; triangles across an axis; corners that meet.
    t = rng.uniform(-0.2, 1.2, (k, 1))
    corners[:k, 2] = corners[:k, 0] * (1 - t) + corners[:k, 1] * t
    corners[:k, 2] += rng.normal(size=(k, 3)) * 10.0 ** rng.uniform(-7, -3, (k, 1))
    for i in range(k, 2 * k):
        corners[i, :, i % 3] = corners[i, 0, i % 3]
    corners[2 * k : 2 * k + 3, 2] = corners[2 * k : 2 * k + 3, 1]
    corners[2 * k + 3] = corners[2 * k + 3, 0]
    # Parallelograms, A B C and A C D, but for the rounding of their corners.
    first = corners[-2 * k :: 2]
    corners[-2 * k + 1 :: 2] = np.stack([first[:, 0], first[:, 2], first[:, 0] + first[:, 2] - first[:, 1]], 1)
    # Half of them rectangles square to an axis, wound either way, from either corner.
    for i in range(-2 * k, -k + k % 2, 2):
        a, c = corners[i, 0], corners[i, 2].copy()
        axis, other = i // 2 % 3, (i // 2 + 1 + i // 6 % 2) % 3
        c[axis] = a[axis]
        b, d = a.copy(), c.copy()
        b[other], d[other] = c[other], a[other]
        corners[i], corners[i + 1] = (a, b, c), (a, c, d)
    return corners


def aim(
    rng: np.random.Generator,
    corners: Points,
    balls: Points,
    radii: Points,
    plates: Points,
    normals: Points,
    sizes: Points,
) -> tuple[Points, Points]:
    """Origins and directions.

    A tenth each: at random, through corners, along edges, near edges, grazing, along an axis, out of spheres,
    tangent to them, disks edge-on, and at the rims of disks.
    """
    n = COUNT // 10
    pick = rng.integers(len(corners), size=n)
    origin = rng.uniform(-2, 2, (10, n, 3))
    target = rng.uniform(-1, 1, (10, n, 3))
    a, b = corners[pick, 0], corners[pick, 1]
    t = rng.uniform(size=(n, 1))
    target[1] = a
    target[2] = b
    origin[2] = a + (a - b) * rng.uniform(0, 3, (n, 1)) + rng.normal(size=(n, 3)) * 10.0 ** rng.uniform(-9, -2, (n, 1))
    target[3] = a * (1 - t) + b * t + rng.normal(size=(n, 3)) * 10.0 ** rng.uniform(-9, -4, (n, 1))
    inside = rng.dirichlet((1, 1, 1), n)
    target[4] = (corners[pick] * inside[..., None]).sum(1)
    across = np.cross(b - a, corners[pick, 2] - a)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30)
    away = rng.normal(size=(n, 3))
    away -= (away * across).sum(1, keepdims=True) * across
    origin[4] = target[4] + away + across * 10.0 ** rng.uniform(-8, -2, (n, 1))
    axes = np.eye(3)[rng.integers(3, size=n)] * rng.choice([-1.0, 1.0], (n, 1))
    origin[5] = (
        np.where(rng.uniform(size=(n, 1)) < 0.5, corners[pick, 2], (corners[pick] * inside[..., None]).sum(1)) - axes
    )
    target[5] = origin[5] + axes
    some = rng.integers(len(balls), size=n)
    out = rng.normal(size=(n, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    origin[6] = balls[some] + out * radii[some, None] * rng.uniform(0, 1, (n, 1)) ** 0.3
    side = np.cross(out, rng.normal(size=(n, 3)))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    beside = 1 + rng.choice([-1, 1], (n, 1)) * 10.0 ** rng.uniform(-8, -1, (n, 1))
    target[7] = balls[some] + out * radii[some, None] * beside
    origin[7] = target[7] - side * rng.uniform(0, 3, (n, 1))
    some = rng.integers(len(plates), size=n)
    plane = np.cross(normals[some], rng.normal(size=(n, 3)))
    plane /= np.linalg.norm(plane, axis=1, keepdims=True)
    target[8] = plates[some] + plane * sizes[some, None] * rng.uniform(-1, 1, (n, 1))
    again = np.cross(normals[some], plane)
    tilt = normals[some] * 10.0 ** rng.uniform(-9, -1, (n, 1)) * rng.choice([-1.0, 0.0, 1.0], (n, 1))
    origin[8] = target[8] + again + plane * rng.uniform(-1, 1, (n, 1)) + tilt
    target[9] = plates[some] + plane * sizes[some, None] * (
        1 + rng.normal(size=(n, 1)) * 10.0 ** rng.uniform(-9, -2, (n, 1))
    )
    direction = (target - origin) * 10.0 ** rng.uniform(-2, 2, (10, n, 1))
    return origin.reshape(-1, 3), direction.reshape(-1, 3)


def make(scale: float = 1.0, shift: float = 0.0, far: float = 0.0, seed: int = 11) -> Case:
    """The scene scaled, then moved by `shift` times its size; with `far`, the rays come from that many sizes away."""
    rng = np.random.default_rng(seed)
    corners = soup(rng)
    balls, radii = rng.uniform(-1, 1, (12, 3)), rng.uniform(0.02, 0.4, 12)
    plates, sizes = rng.uniform(-1, 1, (18, 3)), rng.uniform(0.05, 0.5, 18)
    normals = rng.normal(size=(18, 3))
    normals[:6] = np.vstack([np.eye(3), -np.eye(3)])
    # One component is 1 in single precision and the others are not 0.
    normals[6:9] = np.eye(3) + rng.normal(size=(3, 3)) * 1e-4
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    origins, directions = aim(rng, corners, balls, radii, plates, normals, sizes)
    if far:
        back = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        origins = origins - back * far * 10.0 ** rng.uniform(-3, 0, (len(back), 1))
        directions = back
    move = np.array([1.0, -0.7, 0.4]) * shift
    single = ((corners + move) * scale).astype(np.float32)
    ball_rows = analytic_rows((balls + move) * scale, radii * scale)
    plate_rows = analytic_rows((plates + move) * scale, sizes * scale, normals)
    return Case(single, ball_rows, plate_rows, Rays.of((origins + move) * scale, directions * scale))


CASES: dict[str, dict[str, Any]] = {
    "plain": {},
    "another": {"seed": 12},
    "huge": {"scale": 1e6, "seed": 13},
    "tiny": {"scale": 1e-6, "seed": 14},
    "moved": {"shift": 30.0, "seed": 15},
    "moved far": {"shift": 1e4, "seed": 16},
    "from afar": {"far": 1e3, "seed": 17},
    "from very far": {"far": 1e6, "seed": 18},
    # The largest coordinates that a scene may have, and where the smallest triangles that it may have come in sight.
    "largest": {"scale": 2.5e11, "seed": 19},
    "smallest": {"scale": 1e-8, "seed": 20},
}


def judge(case: Case, hits: Hits) -> str:
    """Compare with double precision; gives a line of numbers."""
    missed = wrong = 0
    sure_rays = loose_hits = 0
    worst = 0.0
    triangle_count = len(case.corners)
    ball_count = len(case.spheres)
    for start in range(0, len(case.rays), 1600):
        part = slice(start, start + 1600)
        rays = Rays.of(case.rays.origins[part], case.rays.directions[part])
        kinds = (
            reference.triangles(rays, case.corners),
            reference.spheres(rays, case.spheres),
            reference.disks(rays, case.disks),
        )
        sure, possible, distance, tolerance, low, high, loose = (
            np.concatenate([getattr(kind, name) for kind in kinds], axis=1)
            for name in ("sure", "possible", "distance", "tolerance", "low", "high", "loose")
        )
        found, at = hits.primitives[part], hits.distances[part].astype(np.float64)
        with np.errstate(invalid="ignore"):
            latest = np.where(sure, np.minimum(distance + tolerance, high), np.inf).min(1)
        hit = found != layout.NONE
        sure_rays += int(np.isfinite(latest).sum())
        missed += int((np.where(hit, at, np.inf) > latest * (1 + EPS_ONCE)).sum())
        row = np.flatnonzero(hit)
        column = found[hit].astype(np.int64)
        assert column.max(initial=0) < triangle_count + ball_count + len(case.disks)
        got = at[hit]
        share = np.abs(got - distance[row, column]) / tolerance[row, column]
        close = (share <= 1 + EPS_ONCE) | loose[row, column]
        between = (got >= low[row, column]) & (got <= high[row, column])
        right = possible[row, column] & close & between & (got > 0)
        wrong += int((~right).sum())
        counted = share[right & ~loose[row, column]]
        loose_hits += int(loose[row, column].sum())
        worst = max(worst, float(counted.max(initial=0.0)))
    line = f"{sure_rays} rays must hit, {loose_hits} hits at rims, worst error {worst:.2f} of the bound"
    assert (missed, wrong) == (0, 0), f"{missed} hits missed, {wrong} wrong; {line}"
    assert sure_rays > len(case.rays) // 4
    return line


EPS_ONCE = 2 * reference.EPS


@pytest.mark.thorough
@pytest.mark.parametrize("name", CASES)
def test_hits_agree_with_double_precision(device: Device, name: str) -> None:
    """The bounds are derived in reference.py."""
    case = make(**CASES[name])
    with tree_on(device, case.flat()) as tree:
        hits = trace(tree, case.rays)
        every = trace_every_leaf(tree, case.rays)
    print(name, judge(case, hits))
    assert np.array_equal(every.primitives, hits.primitives)
    assert np.array_equal(every.distances, hits.distances)
    assert np.array_equal(hits.occluded, hits.primitives != layout.NONE)
    assert (hits.distances[hits.primitives == layout.NONE] == FAR).all()


@pytest.fixture(scope="module")
def mixed() -> Case:
    """One scene, and rays of all kinds from near and far."""
    near, far = make(seed=22), make(far=100.0, seed=22)
    halves = [(getattr(near.rays, name), getattr(far.rays, name)) for name in ("origins", "directions")]
    order = np.random.default_rng(23).permutation(2 * COUNT)
    return Case(near.corners, near.spheres, near.disks, Rays.of(*(np.concatenate(pair)[order] for pair in halves)))


def same(hits: Hits, others: Hits) -> bool:
    """To the bit; which primitive is in the way is nobody's business."""
    return (
        hits.distances.tobytes() == others.distances.tobytes()
        and np.array_equal(hits.primitives, others.primitives)
        and np.array_equal(hits.occluded, others.occluded)
    )


def test_the_reference_finds_what_the_traversals_find(device: Device, mixed: Case) -> None:
    with tree_on(device, mixed.flat()) as tree:
        assert same(trace_by_reference(tree, mixed.rays), trace(tree, mixed.rays, 16))


@pytest.mark.long
@pytest.mark.parametrize(
    "lanes", [1, pytest.param(4, marks=pytest.mark.slow), pytest.param(8, marks=pytest.mark.slow), 16]
)
def test_every_way_through_the_tree_gives_the_same_bits(device: Device, mixed: Case, lanes: int) -> None:
    """In packets that never part, part early, or as the kernels have it; and each ray alone."""
    with tree_on(device, mixed.flat()) as tree:
        first = trace(tree, mixed.rays, 1)
        for parts in (None, 0, lanes - 1):
            assert same(trace(tree, mixed.rays, lanes, parts=parts), first), f"parts {parts}"
        assert same(trace(tree, mixed.rays, lanes, single=True), first), "alone"


@pytest.mark.slow
def test_every_driver_gives_the_same_bits(all_devices: list[Device], mixed: Case) -> None:
    """Slow because rusticl takes most of a minute to compile what PoCL takes a second for."""
    hits = []
    for device in all_devices:
        with tree_on(device, mixed.flat()) as tree:
            hits += [trace(tree, mixed.rays, 1, single) for single in (False, True)]
    assert all(same(each, hits[0]) for each in hits)


@pytest.mark.long
def test_lanes_that_are_not_traced_stay_as_they_are(device: Device, mixed: Case) -> None:
    rays = mixed.rays
    off = np.random.default_rng(24).uniform(size=len(rays)) < 0.4
    off[:64] = True
    limits = np.where(off, np.float32(-1), rays.limits)
    with tree_on(device, mixed.flat()) as tree:
        whole = trace(tree, rays)
        for lanes, single in ((16, False), (16, True), (1, False)):
            some = trace(tree, Rays(rays.origins, rays.directions, limits, rays.starts, rays.ends), lanes, single)
            assert (some.primitives[off] == layout.NONE).all()
            assert not some.occluded[off].any()
            assert np.array_equal(some.primitives[~off], whole.primitives[~off])
            assert np.array_equal(some.distances[~off], whole.distances[~off])
            assert np.array_equal(some.occluded[~off], whole.occluded[~off])


@pytest.mark.parametrize(("lanes", "single"), [(16, False), (16, True), (1, False)])
def test_limits_starts_and_ends(device: Device, mixed: Case, lanes: int, single: bool) -> None:
    """A hit counts up to the limit; what a ray starts on is not there; what it is aimed at is not in its way."""
    rays = mixed.rays
    with tree_on(device, mixed.flat()) as tree:
        open_ended = trace(tree, rays)
        hit = open_ended.primitives != layout.NONE
        at = np.where(hit, open_ended.distances, np.float32(1))
        below = np.nextafter(at, np.float32(0))

        def limited(limits: npt.NDArray[np.float32], **ends: npt.NDArray[np.uint32]) -> Hits:
            wanted = {"starts": rays.starts, "ends": rays.ends, **ends}
            given = Rays(rays.origins, rays.directions, limits, wanted["starts"], wanted["ends"])
            hits = trace(tree, given, lanes, single)
            # What a shadow ray is aimed at is as good as not there, and the definition knows one way to leave it out.
            if "ends" in ends:
                given = Rays(rays.origins, rays.directions, limits, wanted["ends"], rays.ends)
            every = trace_every_leaf(tree, given)
            if "ends" not in ends:
                assert np.array_equal(hits.primitives, every.primitives)
                assert np.array_equal(hits.distances, every.distances)
            assert np.array_equal(hits.occluded, every.primitives != layout.NONE)
            return hits

        exactly = limited(at)
        assert np.array_equal(exactly.primitives[hit], open_ended.primitives[hit])
        nearer = limited(below)
        assert (nearer.primitives[hit] == layout.NONE).all()
        limited(at * np.random.default_rng(25).uniform(0, 3, len(at)).astype(np.float32))
        beyond = limited(rays.limits, starts=open_ended.primitives)
        assert (beyond.primitives[hit] != open_ended.primitives[hit]).all()
        assert (beyond.distances[hit] >= at[hit]).all()
        limited(rays.limits, ends=open_ended.primitives)
        limited(at, ends=open_ended.primitives)


def test_of_equally_near_hits_the_first_primitive_counts(device: Device) -> None:
    """Coincident triangles in different leaves."""
    rng = np.random.default_rng(26)
    corners = np.array([[-1, -1, 0], [3, -1, 0], [-1, 3, 0]], np.float64)
    count = 300
    points = np.tile(corners, (count, 1))
    order = np.arange(3 * count).reshape(-1, 3)
    origins = np.c_[rng.uniform(-0.5, 0.5, (1000, 2)), np.ones(1000)]
    with tree_on(device, flat_scene(points, order)) as tree:
        for lanes, single in ((16, False), (1, True)):
            hits = trace(tree, Rays.of(origins, (0.0, 0.0, -1.0)), lanes, single)
            assert (hits.primitives == 0).all()


def reach_of(device: Device, corners: Points, faces: list[list[int]], rng: np.random.Generator) -> tuple[float, float]:
    """Of a slender shape of length 2, from 4 away: how far beyond its ends rays hit it, and the area hit by its own."""
    world = corners.astype(np.float32)
    exact = world.astype(np.float64)
    sides = np.roll(exact, -1, axis=0) - exact
    along = max(sides, key=lambda side: float(side @ side))
    along /= np.linalg.norm(along)
    normal = np.cross(sides[0], sides[1]) / np.linalg.norm(np.cross(sides[0], sides[1]))
    aside = np.cross(normal, along)
    middle = (exact.min(0) + exact.max(0)) / 2
    (low, left), (high, right) = ((f((exact - middle) @ along), f((exact - middle) @ aside)) for f in (np.min, np.max))
    u, v = rng.uniform(low - 0.2, high + 0.2, 200_000), rng.uniform(left, right, 200_000)
    eye = np.broadcast_to(middle + 4.0 * normal, (len(u), 3))
    # Far corners of the pack's box, so that this does not end what the triangles do not.
    others = middle + np.array(
        [[6.0, 6, 6], [6.01, 6, 6], [6, 6.01, 6], [-6, -6, -6], [-6.01, -6, -6], [-6, -6.01, -6]]
    )
    count = len(world)
    flat = flat_scene(
        np.concatenate([world, others]), [*faces, [count, count + 1, count + 2], [count + 3, count + 4, count + 5]]
    )
    with tree_on(device, flat) as tree:
        target = middle + u[:, None] * along + v[:, None] * aside
        found = trace(tree, Rays.of(eye, target - eye)).primitives != layout.NONE
    beyond = max(float((np.where(found, u, 0.0) - high).max()), float((low - np.where(found, u, 0.0)).max()))
    area = sum(np.linalg.norm(np.cross(exact[b] - exact[a], exact[c] - exact[a])) for a, b, c in faces) / 2
    return beyond, float(found.mean() * (high - low + 0.4) * (right - left) / area)


@pytest.mark.thorough
@for_each("width, most_beyond, most_area", [(1e-3, 5e-3, 0.02), (1e-4, 0.05, 0.05)])
def test_slender_triangles_end_where_they_end(
    device: Device, width: float, most_beyond: float, most_area: float
) -> None:
    """Whichever corner is first, and in a strip. With one error for all sides the ends were 2 and 20 cm off."""
    rng = np.random.default_rng(27)
    strip = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, width, 0.0], [0.0, width, 0.0]])
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    shapes = [(np.roll(strip[:3], k, axis=0), [[0, 1, 2]]) for k in range(3)]
    shapes.append((strip, [[0, 1, 2], [0, 2, 3]]))
    for corners, faces in shapes:
        for placed in (corners, corners @ turn.T + 0.3):
            beyond, area = reach_of(device, placed, faces, rng)
            assert beyond <= most_beyond
            assert abs(area - 1.0) <= most_area


def test_infinite_and_empty_things(device: Device) -> None:
    """No primitives, rays of no use, and rays across the axes that lie in the faces of boxes."""
    with tree_on(device, flat_scene()) as tree:
        hits = trace(tree, Rays.of(np.zeros((20, 3)), np.ones((20, 3))))
        assert (hits.primitives == layout.NONE).all()
        assert not hits.occluded.any()
    quad = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float64)
    with tree_on(device, flat_scene(quad, [[0, 1, 2], [0, 2, 3]])) as tree:
        grid = np.linspace(-1, 1, 9)
        places = np.array([(x, y, 5.0) for x in grid for y in grid])
        for zero in (0.0, -0.0):
            hits = trace(tree, Rays.of(places, (zero, zero, -1.0)))
            assert (hits.primitives != layout.NONE).all(), "edges and corners belong to the square"
            assert (hits.distances == 5).all()
            in_plane = trace(tree, Rays.of(places * [1, 1, 0] - [3, 0, 0], (1.0, zero, zero)))
            assert (in_plane.primitives == layout.NONE).all(), "seen edge-on there is nothing"
        still = trace(tree, Rays.of(places, (0.0, 0.0, 0.0)))
        assert (still.primitives == layout.NONE).all(), "a ray that goes nowhere hits nothing"
