"""Shapes as triangles, for programs that have fewer kinds of shapes, and PLY files with the attributes of vertices."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import IO, Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.exact.elementary import sines_cosines
from clrender.exact.matrices import determinant, length, product, times
from clrender.flatten.attributes import corner_uvs, face_axes
from clrender.flatten.polyhedra import polyhedron
from clrender.flatten.surfaces import placed_normals
from clrender.flatten.tubes import curve_mesh
from clrender.meshes.data import MeshData
from clrender.scene import Disk, Mesh, Scene, Sphere
from clrender.scene.materials import material_textures
from clrender.scene.resting import placements
from clrender.scene.shapes import AnyShape, Curves, Transform
from clrender.scene.textures import BumpMap, Checker, ImageTexture, NormalMap, Ramp
from clrender.scene.transforms import affine
from clrender.wording import place

__all__ = [
    "DISK_EDGES",
    "MIRROR",
    "SPHERE_STEPS",
    "At",
    "Piece",
    "disk_frame",
    "disk_mesh",
    "matrix_of",
    "merged",
    "mirrored",
    "mirrors",
    "pieces_of",
    "placed",
    "shapes_of_instances",
    "sphere_mesh",
    "surface_key",
    "texture_sets",
    "triangles_of",
    "world",
    "world_mesh",
    "write_plain_ply",
]

At: TypeAlias = tuple[str | int, ...]
"""A place in a scene."""
_Floats: TypeAlias = NDArray[np.float64]
DISK_EDGES: Final = 128
"""Triangles of a disk."""
SPHERE_STEPS: Final = 64
"""Steps of a sphere from pole to pole; there are twice as many around it."""
MIRROR: Final = np.diag([-1.0, -1.0, -1.0, 1.0])
"""The reflection that `mirrored` does: at the origin, which keeps the triangles of a box."""
_CHUNK: Final = 2**18


def triangles_of(scene: Scene, at: At, shape: AnyShape) -> MeshData:
    """Triangles of a shape before its transform, with the texture coordinates of flat shapes; of a sphere none."""
    if isinstance(shape, Mesh):
        return _with_averages(scene.mesh_of(at, shape))
    if isinstance(shape, Sphere):
        axes = np.concatenate([np.eye(3), -np.eye(3)])
        return MeshData(np.array(shape.center) + shape.radius * axes, np.zeros((0, 3), np.uint32))
    if isinstance(shape, Disk):
        return disk_mesh(shape)
    if isinstance(shape, Curves):
        return curve_mesh(shape, scene.strands(at, shape), place(at))
    mesh = polyhedron(shape)
    return dataclasses.replace(mesh, uvs=corner_uvs(shape, mesh))


def _with_averages(mesh: MeshData) -> MeshData:
    """A mesh with the normals that rows of zeros stand for, which other programs do not know."""
    if mesh.normals is None or bool(mesh.normals.any(axis=1).all()):
        return mesh
    normals = np.empty(mesh.normals.shape, np.float32)
    placed_normals(mesh.normals, affine(Transform()), mesh.vertices, mesh.triangles, normals, flip=False)
    return dataclasses.replace(mesh, normals=normals)


def mirrored(mesh: MeshData) -> MeshData:
    """A mesh of vertices and normals mirrored by `MIRROR`, with its front where it was."""
    turned: dict[str, Any] = {key: -each for key in ("vertices", "normals") if (each := getattr(mesh, key)) is not None}
    of_corners = (key for key in ("triangles", "uvs", "uvs_1", "colors") if getattr(mesh, key) is not None)
    back: dict[str, Any] = {key: np.ascontiguousarray(getattr(mesh, key)[:, ::-1]) for key in of_corners}
    return dataclasses.replace(mesh, tangents=None, **turned, **back)


def matrix_of(shape: AnyShape) -> _Floats:
    """A shape's transform, (4, 4)."""
    map_, made = affine(shape.transform), np.eye(4)
    made[:3, :3], made[:3, 3] = map_.linear, map_.offset
    return made


def placed(shape: AnyShape, outer: _Floats) -> AnyShape:
    """A shape of a group under the (3, 4) map of an instance."""
    whole = product(np.concatenate([outer, [[0.0, 0.0, 0.0, 1.0]]]), matrix_of(shape))
    return shape.with_checked(transform=Transform(matrix=tuple(map(tuple, whole.tolist()))))


def world(shape: AnyShape, mesh: MeshData) -> tuple[_Floats, NDArray[np.uint32]]:
    """Vertices in world space, and triangles with the shape's front in front."""
    matrix = matrix_of(shape)
    points = times(matrix[:3, :3], mesh.vertices) + matrix[:3, 3]
    turned = shape.flip_normals != (determinant(matrix[:3, :3]) < 0.0)
    return points, mesh.triangles[:, ::-1] if turned else mesh.triangles


def disk_frame(shape: Disk) -> _Floats:
    """From the unit disk across +z."""
    normal = tuple(each / length(shape.normal) for each in shape.normal)
    across, along = face_axes(normal)  # type: ignore[arg-type]
    made = np.eye(4)
    made[:3, :3] = np.stack([shape.radius * np.array(across), shape.radius * np.array(along), normal], axis=1)
    made[:3, 3] = shape.center
    return made


def disk_mesh(shape: Disk) -> MeshData:
    """A disk as a fan of triangles, whose texture coordinates lie flat on it."""
    sines, cosines = sines_cosines(2.0 * math.pi * np.arange(DISK_EDGES) / DISK_EDGES)
    rim = np.stack([cosines, sines, np.zeros(DISK_EDGES)], axis=1)
    points = np.concatenate([np.zeros((1, 3)), rim])
    first = np.arange(DISK_EDGES)
    triangles = np.stack([np.zeros(DISK_EDGES, np.int64), 1 + first, 1 + (first + 1) % DISK_EDGES], axis=1).astype(
        np.uint32
    )
    uvs = ((points[:, :2] + 1.0) / 2.0).astype(np.float32)[triangles]
    frame = disk_frame(shape)
    return MeshData(times(frame[:3, :3], points) + frame[:3, 3], triangles, uvs=uvs)


def sphere_mesh(shape: Sphere) -> MeshData:
    """A sphere as quads between circles of latitude, halved, with its normals and texture coordinates."""
    across, along = 2 * SPHERE_STEPS, SPHERE_STEPS
    sin_turn, cos_turn = sines_cosines(2.0 * math.pi * (np.arange(across + 1) % across) / across)
    sin_polar, cos_polar = sines_cosines(math.pi * np.arange(along + 1) / along)
    sin_polar[-1] = 0.0
    level = sin_polar[:, None]
    height = np.broadcast_to(-cos_polar[:, None], (along + 1, across + 1))
    normals = np.stack([-level * sin_turn, height, -level * cos_turn], axis=2).reshape(-1, 3)
    row, column = (each.ravel() for each in np.meshgrid(np.arange(along), np.arange(across), indexing="ij"))
    first = row * (across + 1) + column
    lower = np.stack([first, first + 1, first + across + 2], axis=1)
    upper = np.stack([first, first + across + 2, first + across + 1], axis=1)
    triangles = np.concatenate([lower[row > 0], upper[row < along - 1]]).astype(np.uint32)
    v, u = np.meshgrid(np.arange(along + 1) / along, np.arange(across + 1) / across, indexing="ij")
    uvs = np.stack([u, v], axis=2).reshape(-1, 2).astype(np.float32)[triangles]
    return MeshData(np.array(shape.center) + shape.radius * normals, triangles, normals.astype(np.float32), uvs=uvs)


def world_mesh(scene: Scene, at: At, shape: AnyShape) -> MeshData:
    """Triangles of any shape after its transform, counter-clockwise seen from the front, with normals there."""
    mesh = sphere_mesh(shape) if isinstance(shape, Sphere) else triangles_of(scene, at, shape)
    to_world = affine(shape.transform)
    points, triangles = world(shape, mesh)
    normals = None
    if mesh.normals is not None:
        normals = np.empty(mesh.normals.shape, np.float32)
        to_world.normals_into(mesh.normals, normals)
        normals = -normals if shape.flip_normals else normals
    uvs, uvs_1 = mesh.uvs, mesh.uvs_1
    if triangles is not mesh.triangles:
        triangles = np.ascontiguousarray(triangles)
        uvs, uvs_1 = (None if each is None else each[:, ::-1] for each in (uvs, uvs_1))
    return MeshData(points.astype(np.float32), triangles, normals, uvs=uvs, uvs_1=uvs_1)


@dataclass(frozen=True)
class Piece:
    """Shapes of one surface as one mesh, after their transforms.

    Attributes
    ----------
    at : tuple of str or int
        Place of the first of them in the scene.
    shape : AnyShape
        The first of them.
    mesh : MeshData
    """

    at: At
    shape: AnyShape
    mesh: MeshData


def pieces_of(scene: Scene, shapes: Iterable[tuple[At, AnyShape]], merge: bool, apart: Collection[At]) -> list[Piece]:
    """Shapes as meshes.

    Parameters
    ----------
    scene : Scene
    shapes : iterable of place and shape
    merge : bool
        Whether quads, triangles, boxes and tetrahedra of the same surface become one.
    apart : collection of places
        Shapes that do not.
    """
    made: list[Piece] = []
    alike: dict[str, list[tuple[At, AnyShape]]] = {}
    for at, shape in shapes:
        if merge and at not in apart and not isinstance(shape, Sphere | Disk | Mesh | Curves):
            alike.setdefault(surface_key(shape), []).append((at, shape))
        else:
            made.append(Piece(at, shape, world_mesh(scene, at, shape)))
    return made + [Piece(*first, merged(scene, [first, *others])) for first, *others in alike.values()]


def merged(scene: Scene, shapes: Sequence[tuple[At, AnyShape]]) -> MeshData:
    """Flat shapes as one mesh, after their transforms."""
    vertices, triangles, uvs, count = [], [], [], 0
    for at, shape in shapes:
        mesh = world_mesh(scene, at, shape)
        vertices.append(mesh.vertices)
        triangles.append(mesh.triangles + count)
        uvs.append(mesh.uvs)
        count += len(mesh.vertices)
    return MeshData(
        np.concatenate(vertices),
        np.concatenate(triangles).astype(np.uint32),
        uvs=np.concatenate(uvs),  # type: ignore[arg-type]
    )


def mirrors(_: str, place: _Floats) -> bool:
    """Whether the map of an instance, (3, 4), mirrors: most programs turn the front of those to the back."""
    return determinant(place[:, :3]) < 0.0


def shapes_of_instances(scene: Scene, chosen: Callable[[str, _Floats], bool] = mirrors) -> list[tuple[At, AnyShape]]:
    """Shapes of some instances, written out.

    Parameters
    ----------
    scene : Scene
    chosen : callable
        Whether an instance of a group, by the group's name and its (3, 4) map, is one of them.
    """
    return [
        (("groups", instance.group, "shapes", i), placed(shape, each))
        for index, instance in scene.instances()
        for each in placements(scene, index)
        if chosen(instance.group, each)
        for i, shape in enumerate(scene.groups[instance.group].shapes)
    ]


def texture_sets(scene: Scene, shape: AnyShape) -> list[int]:
    """The sets of texture coordinates that a shape's textures use, the lowest first."""
    sets = set()
    if shape.material is not None:
        sets = {each.uv_set for _, each in material_textures(scene.materials, shape.material)}
    if isinstance(shape.emission, ImageTexture | Checker | Ramp | NormalMap | BumpMap):
        sets.add(shape.emission.uv_set)
    return sorted(sets)


def surface_key(shape: AnyShape) -> str:
    """What shapes of one surface share."""
    return json.dumps(
        shape.model_dump(mode="json", include={"material", "emission", "name", "visible_to_camera", "shadow_catcher"}),
        sort_keys=True,
    )


def write_plain_ply(file: IO[bytes], mesh: MeshData, uvs: NDArray[np.float32] | None) -> None:
    """Write a mesh with one pair of texture coordinates for each vertex, as Mitsuba and LuxCore read it.

    Parameters
    ----------
    file : binary file
    mesh : MeshData
    uvs : (T, 3, 2) float32 or None
    """
    points, normals, triangles = mesh.vertices, mesh.normals, mesh.triangles
    pairs: Any = None
    if uvs is not None:
        origin, triangles, pairs = _split(len(points), triangles, uvs)
        points, normals = points[origin], None if normals is None else normals[origin]
    columns = [(("x", "y", "z"), points), (("nx", "ny", "nz"), normals), (("s", "t"), pairs)]
    kept = [(names, array) for names, array in columns if array is not None]
    kinds = ["float" if array.dtype.itemsize == 4 else "double" for _, array in kept]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    header += [f"property {kind} {name}" for kind, (names, _) in zip(kinds, kept, strict=True) for name in names]
    header += [f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header", ""]
    file.write("\n".join(header).encode("ascii"))
    sizes = {"float": "<f4", "double": "<f8"}
    row = np.dtype([(names[0], sizes[kind], len(names)) for kind, (names, _) in zip(kinds, kept, strict=True)])
    for start in range(0, len(points), _CHUNK):
        rows = np.zeros(len(points[start : start + _CHUNK]), row)
        for names, array in kept:
            rows[names[0]] = array[start : start + _CHUNK]
        file.write(rows.tobytes())
    face = np.dtype([("count", "u1"), ("corners", "<i4", 3)])
    for start in range(0, len(triangles), _CHUNK):
        faces = np.zeros(len(triangles[start : start + _CHUNK]), face)
        faces["count"], faces["corners"] = 3, triangles[start : start + _CHUNK]
        file.write(faces.tobytes())


def _split(
    count: int, triangles: NDArray[np.uint32], uvs: NDArray[np.float32]
) -> tuple[NDArray[np.intp], NDArray[np.uint32], NDArray[np.float32]]:
    """Split vertices whose corners have different texture coordinates.

    Returns
    -------
    origin : (n,) intp
        The vertex that each new one was.
    triangles : (T, 3) uint32
    pairs : (n, 2) float32
    """
    corners, pairs = triangles.ravel(), uvs.reshape(-1, 2) + np.float32(0.0)  # one zero only
    alone = np.zeros((count, 2), np.float32)
    alone[corners] = pairs
    if (alone[corners] == pairs).all():
        return np.arange(count), triangles, alone
    rows = np.empty(len(corners), np.dtype([("vertex", "<u4"), ("pair", "<u8")]))
    rows["vertex"], rows["pair"] = corners, np.ascontiguousarray(pairs).view("<u8")[:, 0]
    _, first, of_corner = np.unique(rows, return_index=True, return_inverse=True)
    return corners[first].astype(np.intp), of_corner.reshape(-1, 3).astype(np.uint32), pairs[first]
