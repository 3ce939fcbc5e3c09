"""The shapes of a scene as arrays in world space: vertices, triangles, analytic_shapes, and a row for each shape."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.errors import SceneError
from clrender.flatten.attributes import (
    COLORS,
    TANGENTS,
    add_corner_rows,
    curve_attributes,
    has_tangents,
    is_textured,
    round_attributes,
    triangle_attributes,
    triangle_colors,
    triangle_tangents,
)
from clrender.flatten.curves import FlatCurves, flat_curves
from clrender.flatten.material_rows import material_numbers
from clrender.flatten.media import Solid, scene_media, solid_of
from clrender.flatten.moved import moved
from clrender.flatten.polyhedra import polyhedron
from clrender.flatten.surface_arrays import FlatSurfaces
from clrender.flatten.touching import KnownMoves, moves, undecided
from clrender.meshes.data import COORDINATE_LIMIT, TRIANGLE_LIMIT, MeshData
from clrender.scene.description import Scene
from clrender.scene.shapes import Curves, Disk, Mesh, Shape, Sphere
from clrender.scene.transforms import Affine, affine
from clrender.scene.values import Vector
from clrender.wording import counted, grouped
from clrender.wording import place as place_in_file

if TYPE_CHECKING:
    from clrender.flatten.assembly import Assembly
    from clrender.scene.posed import Deformation

__all__ = ["SMALLEST", "flat_surfaces", "placed_normals", "triangle_areas", "turned_away", "with_area"]

_Rows: TypeAlias = NDArray[np.void]
_CHUNK: Final = 2**18
_MOST_CURVES: Final = 1_600_000
"""Up to so many, curves are cut for speed: each takes 230 bytes on a device."""
SMALLEST: Final = 1e-18
"""Lower bound of radii and of cross products of edges: their squares are then normal float32 numbers."""


def flat_surfaces(
    scene: Scene,
    origin: Vector = (0.0, 0.0, 0.0),
    own_shapes: int | None = None,
    assembly: Assembly | None = None,
    *,
    all_attributes: bool = False,
    known: KnownMoves | None = None,
) -> FlatSurfaces:
    """Arrays of all shapes of a scene, triangles first.

    Non-emissive shapes whose dielectric is no boundary (`clrender.flatten.media`) have no primitives, so that every
    kind of ray passes them. What coincides is moved apart by a few roundings (`clrender.flatten.touching`).

    Parameters
    ----------
    scene : Scene
    origin : (3,) float
        World space, metres: all coordinates are relative to it, subtracted before they are rounded.
    own_shapes : int, optional
        Number of first shapes that are in world space; default: all. The others are in group space, without the origin.
    assembly : Assembly, optional
        Groups of those others, and where they are placed.
    all_attributes : bool
        Whether to give attributes to all shapes, as if they were textured.
    known : KnownMoves, optional
        What touched in the scene before.

    Raises
    ------
    SceneError
        If a shape is degenerate, out of range, or there are too many triangles.
    """
    meshes: dict[int, MeshData] = {}
    own = len(scene.plain_shapes) if own_shapes is None else own_shapes
    no_boundary = scene_media(scene).no_boundary
    for index, shape in enumerate(scene.plain_shapes):
        if _is_left_out(shape, no_boundary):
            continue
        if isinstance(shape, Mesh):
            meshes[index] = scene.mesh(index)
        elif not isinstance(shape, Sphere | Disk | Curves):
            meshes[index] = polyhedron(shape)
    vertex_total = sum(len(mesh.vertices) for mesh in meshes.values())
    triangle_total = sum(len(mesh.triangles) for mesh in meshes.values())
    for total, what in ((vertex_total, "vertices"), (triangle_total, "triangles")):
        if total > TRIANGLE_LIMIT:
            raise SceneError(f"{scene.source}: shapes hold {total} {what}, but a scene may hold {TRIANGLE_LIMIT}")
    vertices = np.empty((vertex_total, 3), dtype="<f4")
    triangles = np.empty((triangle_total, 3), dtype="<u4")
    smooth = any(mesh.normals is not None for mesh in meshes.values())
    normals = np.zeros((vertex_total if smooth else 1, 3), dtype="<f4")
    numbers = material_numbers(scene)
    shapes = np.zeros(len(scene.plain_shapes), dtype=layout.dtype("Shape"))
    shapes["first_light"] = layout.NONE
    shapes["material"] = [numbers[solid_of(shape)] for shape in scene.plain_shapes]
    first = np.zeros(len(shapes), dtype=np.int64)
    count = np.zeros(len(shapes), dtype=np.int64)
    first_vertex = np.zeros(len(shapes), dtype=np.int64)
    forms = {} if assembly is None else assembly.forms
    warnings: list[str] = []
    textured = [all_attributes or is_textured(scene, index) for index in range(len(scene.plain_shapes))]
    attributes = np.zeros((triangle_total if any(textured) else 0, 16), np.float32)
    colors: dict[int, NDArray[np.float32]] = {}
    tangents: dict[int, NDArray[np.float32]] = {}
    shapes["flags"][textured] = layout.SHAPE_TEXTURED
    masked = [shape.material is not None and scene.materials[shape.material].masked for shape in scene.plain_shapes]
    shapes["flags"][masked] |= np.uint32(layout.SHAPE_MASKED)
    hidden = [not shape.visible_to_camera for shape in scene.plain_shapes]
    shapes["flags"][hidden] |= np.uint32(layout.SHAPE_MASKED | layout.SHAPE_HIDDEN)
    held_out = [shape.shadow_catcher for shape in scene.plain_shapes]
    shapes["flags"][held_out] |= np.uint32(layout.SHAPE_MASKED | layout.SHAPE_HELD_OUT)
    v = t = 0
    for index, mesh in meshes.items():
        place, shape = f"{scene.source}: {place_in_file(scene.place_of(index))}", scene.plain_shapes[index]
        if mesh.warning:
            warnings.append(f"{place}: {mesh.warning}")
        here = vertices[v : v + len(mesh.vertices)]
        there = triangles[t : t + len(mesh.triangles)]
        transform = _relative(affine(shape.transform), origin if index < own else (0.0, 0.0, 0.0))
        _place_mesh(mesh, transform, shape.flip_normals, here, there, place=place)
        later = _later_forms(forms[index], transform) if index in forms else ()
        sound = _sound(here, there, later, place=place, warnings=warnings if isinstance(shape, Mesh) else None)
        kept = len(there) if sound is None else int(np.count_nonzero(sound))
        flipped = shape.flip_normals != (transform.determinant < 0.0)
        turned: NDArray[np.bool_] | None = None
        if textured[index]:
            attributes[t : t + kept] = triangle_attributes(scene, index, mesh, sound, flipped)
            if (colored := triangle_colors(mesh, sound, flipped)) is not None:
                colors[t] = colored
        moves_terminator = isinstance(shape, Mesh) and shape.shadow_terminator_offset
        if mesh.normals is None and moves_terminator:
            warnings.append(f"{place}: shadow_terminator_offset changes nothing: the mesh has no vertex normals")
        if mesh.normals is not None:
            shapes["flags"][index] |= layout.SHAPE_SMOOTH
            if moves_terminator:
                shapes["flags"][index] |= np.uint32(layout.SHAPE_TERMINATOR_OFFSET)
            some = normals[v : v + len(here)]
            placed_normals(mesh.normals, transform, here, there[:kept], some, flip=shape.flip_normals)
            turned = turned_away(here, there[:kept], some)
            if count_turned := int(np.count_nonzero(turned)):
                text = (
                    f"{place}: the normals of {grouped(count_turned)} of {counted(kept, 'triangle')} point to "
                    "their backs and were"
                )
                warnings.append(
                    f"{text} turned round: seen from its front, the vertices of a triangle run anticlockwise"
                )
        if mesh.tangents is not None and has_tangents(scene, index):
            tangents[t] = triangle_tangents(mesh.tangents, transform, sound, flipped, turned)
        there[:kept] += np.uint32(v)
        first[index], count[index], first_vertex[index] = t, kept, v
        v, t = v + len(here), t + kept
    analytic_shapes, curve_rows, of_round = _analytic_rows(
        scene, origin, own, first, count, t, no_boundary, all_attributes
    )
    shapes["first_primitive"] = first
    order = np.argsort(first, kind="stable")
    if any(textured):
        attributes = add_corner_rows(np.concatenate([attributes[:t], of_round]), COLORS, colors)
        attributes = add_corner_rows(attributes, TANGENTS, tangents)
    flat = FlatSurfaces(
        vertices=vertices,
        normals=normals,
        triangles=triangles[:t],
        analytic_shapes=analytic_shapes,
        curve_rows=curve_rows,
        primitive_shape=np.repeat(order.astype("<u4"), count[order]),
        shapes=shapes,
        first=first,
        count=count,
        warnings=tuple(warnings),
        origin=origin,
        attributes=attributes,
        first_vertex=first_vertex,
    )
    return _apart(scene, flat, own, assembly, known)


def _apart(
    scene: Scene, flat: FlatSurfaces, own: int, assembly: Assembly | None, known: KnownMoves | None
) -> FlatSurfaces:
    """The surfaces without any that coincide, as far as rules decide; warnings name those where none does."""
    found = (moves if known is None else known.of)(scene, flat, own, assembly)
    warnings = [f"{scene.source}: {text}" for text in undecided(scene, found)]
    return replace(moved(flat, found), warnings=(*flat.warnings, *warnings), camera_free=found.camera_free)


def _is_left_out(shape: Shape, no_boundary: frozenset[Solid]) -> bool:
    """Whether a shape is omitted because it neither affects light nor emits it."""
    return solid_of(shape) in no_boundary and not shape.shines


def _relative(transform: Affine, origin: Vector) -> Affine:
    """The transform with coordinates relative to `origin`."""
    x, y, z = (o - p for o, p in zip(transform.offset, origin, strict=True))
    return Affine(transform.linear, (x, y, z))


def triangle_areas(vertices: NDArray[np.float32], triangles: NDArray[np.uint32]) -> NDArray[np.float64]:
    """Areas in square metres.

    Parameters
    ----------
    vertices : (V, 3) float32
    triangles : (T, 3) uint32

    Returns
    -------
    (T,) float64
    """
    areas = np.empty(len(triangles))
    for start in range(0, len(triangles), _CHUNK):
        x, y, z = _normals_of(vertices, triangles[start : start + _CHUNK], np.float64)
        areas[start : start + _CHUNK] = np.sqrt(x * x + y * y + z * z) / 2.0
    return areas


def _normals_of(
    vertices: NDArray[np.float32], triangles: NDArray[np.uint32], kind: type[np.floating]
) -> tuple[NDArray[np.floating], NDArray[np.floating], NDArray[np.floating]]:
    """Components of unnormalised normals (v1 - v0) x (v2 - v0), (T,) each, in the given precision."""
    edges = []
    for column in vertices.T:  # by component: arrays of rows of three are slow
        a, b, c = (column[corner].astype(kind, copy=False) for corner in triangles.T)
        edges.append((b - a, c - a))
    (ux, vx), (uy, vy), (uz, vz) = edges
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


def _place_mesh(
    mesh: MeshData,
    transform: Affine,
    flip: bool,
    vertices: NDArray[np.float32],
    triangles: NDArray[np.uint32],
    *,
    place: str,
) -> None:
    """Write vertices in world space, and triangles with the right orientation."""
    transform.points_into(mesh.vertices, vertices)
    if len(vertices):
        largest = max(float(vertices.max()), -float(vertices.min()))
        _in_range(largest, place)
    # Mirroring reverses the orientation of triangles; the front must stay where it was.
    if flip != (transform.determinant < 0.0):
        triangles[:] = mesh.triangles[:, ::-1]
    else:
        triangles[:] = mesh.triangles


def _in_range(largest: float, place: str) -> None:
    if not largest <= COORDINATE_LIMIT:
        text = f"reaches {largest:.9g} metres from the origin, but {COORDINATE_LIMIT:g} is the most"
        raise SceneError(f"{place} {text}; make it or its transform smaller")


def _later_forms(deformation: Deformation, transform: Affine) -> Iterator[NDArray[np.float32]]:
    """The placed vertices of a mesh at its poses after the first, and midway before each.

    The normal of a triangle is quadratic in time between two poses: where it is zero at three times, it always is.
    """
    for one, other in pairwise(deformation.meshes):
        for points in (other.vertices, (one.vertices.astype(np.float64) + other.vertices) / 2.0):
            placed = np.empty(points.shape, np.float32)
            transform.points_into(points, placed)
            yield placed


def _sound(
    vertices: NDArray[np.float32],
    triangles: NDArray[np.uint32],
    later: Iterable[NDArray[np.float32]] = (),
    *,
    place: str,
    warnings: list[str] | None,
) -> NDArray[np.bool_] | None:
    """Move triangles with an area, with these vertices or with later ones, to the front.

    Returns which ones have an area, or None for all. Without a list of warnings, all must have one.
    """
    sound = with_area(vertices, triangles)
    for points in later:
        if sound.all():
            break
        sound |= with_area(points, triangles)
    kept = int(np.count_nonzero(sound))
    if kept == len(triangles):
        return None
    if warnings is None or kept == 0:
        which = "a triangle of it" if warnings is None else "every triangle"
        raise SceneError(f"{place} is degenerate: {which} has no area in single precision; move its vertices apart")
    lost = len(triangles) - kept
    noun = "triangles" if lost > 1 else "triangle"
    # Far from the origin, single precision tells fewer vertices apart.
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    reach = float(np.maximum(np.abs(low), np.abs(high)).max())
    far = reach > 1000.0 * float((high - low).max())
    cure = f"; it reaches {reach:.3g} metres from the origin: move it closer" if far else ""
    warnings.append(f"{place}: {lost} of {len(triangles)} {noun} left out, without area in single precision{cure}")
    triangles[:kept] = triangles[sound]
    return sound


def with_area(vertices: NDArray[np.float32], triangles: NDArray[np.uint32]) -> NDArray[np.bool_]:
    """Which triangles have an area in single precision, (T,) bool."""
    found = np.empty(len(triangles), dtype=bool)
    for start in range(0, len(triangles), _CHUNK):
        x, y, z = (np.abs(part) for part in _normals_of(vertices, triangles[start : start + _CHUNK], np.float32))
        found[start : start + _CHUNK] = np.maximum(np.maximum(x, y), z) >= SMALLEST
    return found


def placed_normals(
    source: NDArray[np.floating],
    transform: Affine,
    vertices: NDArray[np.float32],
    triangles: NDArray[np.uint32],
    normals: NDArray[np.float32],
    *,
    flip: bool,
) -> None:
    """Write unit normals in world space; a zero normal is replaced by the mean of the vertex's triangles."""
    transform.normals_into(source, normals)
    if flip:
        np.negative(normals, out=normals)
    blank: NDArray[np.bool_] = np.asarray(~normals.any(axis=1))
    if not blank.any():
        return
    around = triangles[blank[triangles].any(axis=1)]
    faces = np.stack(_normals_of(vertices, around, np.float64), axis=1)
    total = np.zeros((len(vertices), 3))
    for corner in range(3):
        np.add.at(total, around[:, corner], faces)
    x, y, z = total.T
    size: NDArray[np.float64] = np.sqrt(x * x + y * y + z * z)
    # The triangles cancel out, or no triangle uses the vertex: any unit vector will do.
    nothing = np.asarray(size == 0.0)
    total[nothing], size[nothing] = (0.0, 0.0, 1.0), 1.0
    normals[blank] = (total / size[:, None])[blank]


def turned_away(
    vertices: NDArray[np.float32], triangles: NDArray[np.uint32], normals: NDArray[np.float32]
) -> NDArray[np.bool_]:
    """Which triangles have vertex normals that point to their back; kernels/geometry/rows.cl flips these."""
    turned = np.empty(len(triangles), bool)
    for start in range(0, len(triangles), _CHUNK):
        some = triangles[start : start + _CHUNK]
        sums = (a[some[:, 0]] + a[some[:, 1]] + a[some[:, 2]] for a in normals.T)
        x, y, z = (n * s for n, s in zip(_normals_of(vertices, some, np.float32), sums, strict=True))
        turned[start : start + _CHUNK] = x + y + z < 0.0
    return turned


def _analytic_rows(
    scene: Scene,
    origin: Vector,
    own: int,
    first: NDArray[np.int64],
    count: NDArray[np.int64],
    offset: int,
    no_boundary: frozenset[Solid],
    all_attributes: bool,
) -> tuple[_Rows, NDArray[np.float32], NDArray[np.float32]]:
    """Rows of spheres, disks and curves, of the curves' coefficients, and of their attributes.

    Writes their primitive numbers, which start at `offset`.
    """
    kinds = Sphere | Disk | Curves
    round_ = [i for i, shape in enumerate(scene.plain_shapes) if isinstance(shape, kinds)]
    indices = [i for i in round_ if not _is_left_out(scene.plain_shapes[i], no_boundary)]
    curved = [i for i in indices if isinstance(scene.plain_shapes[i], Curves)]
    strands = {i: _curves_of(scene, i, origin, own, len(curved)) for i in curved}
    total = len(indices) + sum(len(each.rows) - 1 for each in strands.values())
    rows = np.zeros(total, dtype=layout.dtype("AnalyticShape"))
    coefficients = np.zeros((total if strands else 1, 16), np.float32)
    attributes = np.zeros((total, 16), np.float32)
    number = 0
    for index in indices:
        shape, place = scene.plain_shapes[index], f"{scene.source}: {place_in_file(scene.place_of(index))}"
        first[index], count[index] = offset + number, 1
        transform = _relative(affine(shape.transform), origin if index < own else (0.0, 0.0, 0.0))
        if isinstance(shape, Curves):
            curves = strands[index]
            some = slice(number, number + len(curves.rows))
            rows[some], coefficients[some] = curves.shapes, curves.rows
            _in_range(
                float((np.abs(curves.shapes["center_radius"][:, :3]) + curves.shapes["normal"][:, :3]).max()), place
            )
            if all_attributes or is_textured(scene, index):
                attributes[some] = curve_attributes(scene, shape, curves.along)
            count[index] = len(curves.rows)
            number += len(curves.rows)
            continue
        assert isinstance(shape, Sphere | Disk)
        center, radius = transform.point(shape.center), shape.radius * transform.scale
        _in_range(max(abs(x) for x in center) + radius, place)
        if radius < SMALLEST:
            raise SceneError(f"{place}.radius is {radius:g} metres in the world, too small for single precision")
        sign = -1.0 if shape.flip_normals else 1.0
        rows[number]["center_radius"] = (*center, radius)
        if isinstance(shape, Disk):
            rows[number]["normal"][:3] = [sign * x for x in transform.normal(shape.normal)]
        else:
            rows[number]["normal"][3] = sign
        if all_attributes or is_textured(scene, index):
            attributes[number] = round_attributes(scene, shape, transform)
        number += 1
    return rows, coefficients, attributes


def _curves_of(scene: Scene, index: int, origin: Vector, own: int, shapes: int) -> FlatCurves:
    shape, at = scene.plain_shapes[index], scene.place_of(index)
    assert isinstance(shape, Curves)
    transform = _relative(affine(shape.transform), origin if index < own else (0.0, 0.0, 0.0))
    label = f"{scene.source}: {place_in_file(at)}"
    return flat_curves(shape, scene.strands(at, shape), transform, label, _MOST_CURVES // shapes)
