"""Loop subdivision: points and normals of the limit surface, boundaries, and sizes."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each

from clrender.errors import SceneError
from clrender.importers import load
from clrender.importers.shared.loop_subdivision import MOST_TRIANGLES, subdivided

OCTAHEDRON = (
    np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float),
    np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]),
)

TETRAHEDRON = (
    np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], float),
    np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]),
)


def torus(around: int, across: int) -> tuple[Any, Any]:
    """A closed mesh whose vertices all have six neighbours."""
    u, v = (each.ravel() for each in np.meshgrid(np.arange(around), np.arange(across), indexing="ij"))
    phi, theta = 2.0 * np.pi * u / around, 2.0 * np.pi * v / across
    points = np.stack([(2.0 + np.cos(theta)) * np.cos(phi), (2.0 + np.cos(theta)) * np.sin(phi), np.sin(theta)], axis=1)

    def at(i: Any, j: Any) -> Any:
        return (u + i) % around * across + (v + j) % across

    corners = [np.stack([at(0, 0), at(1, 0), at(1, 1)], axis=1), np.stack([at(0, 0), at(1, 1), at(0, 1)], axis=1)]
    return points, np.concatenate(corners)


def sheet(side: int) -> tuple[Any, Any]:
    """A flat square of triangles."""
    x, y = (each.ravel() for each in np.meshgrid(np.arange(side + 1.0), np.arange(side + 1.0), indexing="ij"))
    i, j = (each.ravel() for each in np.meshgrid(np.arange(side), np.arange(side), indexing="ij"))
    at = i * (side + 1) + j
    first, second = [at, at + side + 1, at + side + 2], [at, at + side + 2, at + 1]
    corners = np.concatenate([np.stack(first, axis=1), np.stack(second, axis=1)])
    return np.stack([x, y, np.zeros_like(x)], axis=1), corners


def edges(triangles: Any) -> tuple[Any, Any]:
    """Distinct edges, and in how many triangles each is."""
    both = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    return np.unique(both, axis=0, return_counts=True)


def test_the_limit_is_the_same_from_every_level() -> None:
    """Limit points of a mesh are those of the mesh that it becomes: subdivision does not move the surface."""
    for points, triangles in (TETRAHEDRON, OCTAHEDRON, torus(7, 5)):
        coarse = subdivided(points, triangles, 0)[0]
        for levels in (1, 3):
            np.testing.assert_allclose(subdivided(points, triangles, levels)[0][: len(points)], coarse, atol=1e-12)


def test_vertices_of_three_neighbours() -> None:
    """Beta is 3/16 and gamma 1/5; the neighbours in a tetrahedron add up to minus the vertex."""
    np.testing.assert_allclose(subdivided(*TETRAHEDRON, 0)[0], TETRAHEDRON[0] / 5.0, atol=1e-12)


def test_regular_vertices_are_those_of_a_box_spline() -> None:
    """With six neighbours the limit is half the vertex and a twelfth of each neighbour (Loop 1987)."""
    points, triangles = torus(8, 6)
    pairs, counts = edges(triangles)
    assert (counts == 2).all()
    sums = np.zeros_like(points)
    np.add.at(sums, pairs[:, 0], points[pairs[:, 1]])
    np.add.at(sums, pairs[:, 1], points[pairs[:, 0]])
    np.testing.assert_allclose(subdivided(points, triangles, 0)[0], points / 2.0 + sums / 12.0, atol=1e-12)


@for_each(("mesh", "euler"), [(OCTAHEDRON, 2), (torus(7, 5), 0), (sheet(2), 1)])
def test_the_topology_stays(mesh: tuple[Any, Any], euler: int) -> None:
    for levels in range(4):
        points, triangles, _, regular = subdivided(*mesh, levels)
        pairs, counts = edges(triangles)
        assert regular and len(points) - len(pairs) + len(triangles) == euler
        assert len(triangles) == len(mesh[1]) * 4**levels and set(counts.tolist()) <= {1, 2}


def test_an_octahedron_keeps_its_symmetry_and_grows_round() -> None:
    points, triangles, normals, _ = subdivided(*OCTAHEDRON, 3)
    # Of 4 neighbours, which cancel out: beta is 3/32, gamma 1/8, and 1 - 4 gamma of the vertex is left
    np.testing.assert_allclose(points[:6], OCTAHEDRON[0] / 2.0, atol=1e-12)
    found = {tuple(np.round(point, 9).tolist()) for point in points + 0.0}
    for turned in (points[:, [1, 2, 0]], points * [-1, 1, 1], points[:, [1, 0, 2]]):
        assert {tuple(np.round(point, 9).tolist()) for point in turned + 0.0} == found
    unit = normals / np.linalg.norm(normals, axis=1)[:, None]
    np.testing.assert_allclose(unit[:6], OCTAHEDRON[0], atol=1e-12)
    radial = (points / np.linalg.norm(points, axis=1)[:, None] * unit).sum(axis=1)
    assert radial.min() > 0.95
    corners = points[triangles]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    faces /= np.linalg.norm(faces, axis=1)[:, None]
    assert (faces * unit[triangles[:, 0]]).sum(axis=1).min() > 0.9


def test_a_flat_boundary_is_a_spline_and_its_normals_are_straight() -> None:
    points, triangles = sheet(4)
    made, finer, normals, _ = subdivided(points, triangles, 2)
    np.testing.assert_allclose(made[:, 2], 0.0, atol=1e-12)
    assert (normals[:, 2] > 0.0).all() and np.abs(normals[:, :2]).max() < 1e-12
    # An edge stays a straight line
    assert made[1].tolist() == pytest.approx([0.0, 1.0, 0.0])
    # The corner is at 1/8 and 5/32, and its neighbours at (1/2, 0) and (5/16, 1/16); of these 3/5 and 1/5
    assert made[0].tolist() == pytest.approx([3 / 5 * 5 / 32 + (5 / 16 + 1 / 16) / 5] * 2 + [0.0])
    _, counts = edges(finer)
    assert (counts == 1).sum() == 4 * 4 * 4


@for_each("valence", [2, 3, 4, 5, 7])
def test_normals_at_boundaries(valence: int) -> None:
    """The formulas of PBR 3ed, 3.8.3, of the points of a fan on the limit surface; seen from below there."""
    points = np.random.default_rng(valence).random((valence + 1, 3))
    fan = np.stack([np.zeros(valence - 1, int), np.arange(1, valence), np.arange(2, valence + 1)], axis=1)
    limit, _, normals, _ = subdivided(points, fan, 0)
    own, ring = limit[0], limit[1:]
    theta = np.pi / (valence - 1)
    inward = {2: [1, 1], 3: [0, 1, 0], 4: [-1, 2, 2, -1]}.get(
        valence,
        [-np.sin(theta), *((2 - 2 * np.cos(theta)) * np.sin(np.arange(1, valence - 1) * theta)), -np.sin(theta)],
    )
    across = np.array(inward) @ ring + {2: -2, 3: -1, 4: -2}.get(valence, 0) * own
    np.testing.assert_allclose(normals[0], -np.cross(ring[-1] - ring[0], across), atol=1e-12)


@for_each("valence", [3, 4, 6, 9])
def test_normals_inside(valence: int) -> None:
    points = np.random.default_rng(valence).random((valence + 1, 3))
    around = np.arange(valence)
    fan = np.stack([np.zeros(valence, int), 1 + around, 1 + (around + 1) % valence], axis=1)
    limit, _, normals, _ = subdivided(points, fan, 0)
    angles = 2.0 * np.pi * around / valence
    along, across = np.cos(angles) @ limit[1:], np.sin(angles) @ limit[1:]
    np.testing.assert_allclose(normals[0], np.cross(along, across), atol=1e-12)


def test_meshes_that_are_no_surfaces() -> None:
    """Three triangles at an edge, one that passes it the same way, one without area, and a vertex of none."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0], [9, 9, 9]], float)
    three = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4], [2, 2, 3]])
    made, triangles, _, regular = subdivided(points, three, 2)
    assert not regular and len(triangles) == 48 and np.isfinite(made).all()
    np.testing.assert_array_equal(made[5], points[5])
    assert not subdivided(points, np.array([[0, 1, 2], [0, 1, 3]]), 1)[3]
    assert len(subdivided(points, np.zeros((0, 3), int), 2)[1]) == 0


@pytest.mark.long
def test_a_million_triangles_take_seconds() -> None:
    points, triangles = torus(40, 20)
    start = time.process_time()
    assert len(subdivided(points, triangles, 5)[1]) == 1_638_400
    assert time.process_time() - start < 60.0
    with pytest.raises(ValueError, match=f"more than {MOST_TRIANGLES}"):
        subdivided(points, triangles, 60)


def test_pbrts_subdivision_surfaces(tmp_path: Path) -> None:
    """Three levels unless they are given; normals are those of a clockwise order, which pbrt's are."""
    points = " ".join(str(x) for x in OCTAHEDRON[0].ravel().tolist())
    corners = " ".join(str(x) for x in OCTAHEDRON[1].ravel().tolist())

    def scene(more: str) -> Any:
        shape = f'Shape "loopsubdiv" "point3 P" [{points}] "integer indices" [{corners}] {more}'
        (tmp_path / "a.pbrt").write_text(f'Camera "perspective"\nWorldBegin\n{shape}\n')
        return load(tmp_path / "a.pbrt")

    for more, levels in (("", 3), ('"integer levels" 1', 1)):
        found = scene(more)
        ((at, shape),) = found.all_shapes()
        mesh = found.mesh_of(at, shape)
        wanted = subdivided(*OCTAHEDRON, levels)
        np.testing.assert_array_equal(mesh.vertices, wanted[0])
        assert mesh.normals is not None and (np.asarray(mesh.vertices) * mesh.normals).sum(axis=1).max() < 0.0
        a, b, c = (np.asarray(mesh.vertices)[mesh.triangles[:, i]] for i in range(3))
        assert (np.cross(b - a, c - a) * a).sum(axis=1).max() < 0.0
        assert not any("loopsubdiv" in note for note in found.notes)
    with pytest.raises(SceneError, match=r'line 3: .* in 30 levels of subdivision, .*use fewer "levels"'):
        scene('"integer levels" 30')
