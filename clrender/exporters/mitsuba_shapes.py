"""Shapes as Mitsuba's: spheres, rectangles, cubes, disks, and triangles in PLY files."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from collections.abc import Sequence
from functools import partial
from typing import IO, Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.exact.elementary import sines_cosines
from clrender.exact.matrices import determinant, length, product, times
from clrender.exporters.mitsuba_materials import MaterialWriter, is_boundary
from clrender.exporters.mitsuba_media import MediumWriter
from clrender.exporters.mitsuba_textures import TextureWriter
from clrender.exporters.mitsuba_xml import Element, Target, element, transform, value
from clrender.flatten.attributes import corner_uvs, face_axes
from clrender.flatten.emission import emits
from clrender.flatten.polyhedra import polyhedron
from clrender.meshes.data import MeshData
from clrender.scene import Disk, Mesh, Sphere
from clrender.scene.groups import Instance
from clrender.scene.materials import Conductor, Mix, Principled, material_textures
from clrender.scene.shapes import AnyShape, Box, Quad, Transform
from clrender.scene.textures import BumpMap, Checker, ImageTexture, NormalMap, Ramp
from clrender.scene.transforms import affine

__all__ = ["ShapeWriter"]

_At: TypeAlias = tuple[str | int, ...]
_Floats: TypeAlias = NDArray[np.float64]
_POLES: Final = np.array([[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""From Mitsuba's sphere to ours: there u runs from 0 at +x, and v from 0 at +z, downwards, so that this mirrors."""
_AROUND: Final = 128
"""Triangles of a disk with textures."""
_CHUNK: Final = 2**18


class ShapeWriter:
    """Writes shapes, groups and their instances.

    Parameters
    ----------
    target : Target
    textures : TextureWriter
    materials : MaterialWriter
    media : MediumWriter
    merge : bool
        Whether flat shapes of the same surface become one mesh.
    """

    def __init__(
        self, target: Target, textures: TextureWriter, materials: MaterialWriter, media: MediumWriter, merge: bool
    ) -> None:
        self._target, self._textures, self._materials, self._media = target, textures, materials, media
        self._merge = merge
        self._meshes: dict[str, str] = {}

    def shapes(self) -> list[Element]:
        """All shapes of the scene."""
        scene = self._target.scene
        own: list[tuple[_At, AnyShape]] = [
            (("shapes", i), shape) for i, shape in enumerate(scene.shapes) if not isinstance(shape, Instance)
        ]
        # Mitsuba has no lights in groups
        for index, instance in scene.instances():
            for at, shape in self._shining(instance.group):
                own += [(at, _placed(shape, each)) for each in scene.transforms(index).maps]
        for at, shape in own:
            if self._passes(shape) and not isinstance(shape, Disk):
                self._media.add(shape, *_world(shape, self._triangles(at, shape)))
        written: list[Element] = []
        alike: dict[str, list[tuple[_At, AnyShape]]] = {}
        for at, shape in own:
            if self._merge and not isinstance(shape, Sphere | Disk | Mesh) and not self._passes(shape):
                alike.setdefault(_surface_key(shape), []).append((at, shape))
            else:
                written.append(self._shape(at, shape))
        written += [self._merged(shapes) for shapes in alike.values()]
        return written + self._instances()

    def _shining(self, group: str) -> list[tuple[_At, AnyShape]]:
        shapes = enumerate(self._target.scene.groups[group].shapes)
        return [(("groups", group, "shapes", i), shape) for i, shape in shapes if emits(self._target.scene, shape)]

    def _passes(self, shape: AnyShape) -> bool:
        """Whether light passes it into a medium, or nothing but a medium is there."""
        if shape.material is None:
            return shape.interior is not None
        return is_boundary(self._target.scene.materials[shape.material])

    def _instances(self) -> list[Element]:
        scene, written = self._target.scene, []
        ids: dict[str, str] = {}
        for index, instance in scene.instances():
            name = instance.group
            if name not in ids:
                shapes = enumerate(scene.groups[name].shapes)
                inside = [
                    self._shape(("groups", name, "shapes", i), shape, grouped=True)
                    for i, shape in shapes
                    if not emits(scene, shape)
                ]
                ids[name] = self._target.id("group", name) if inside else ""
                if inside:
                    written.append(element("shape", *inside, type="shapegroup", id=ids[name]))
            if not ids[name]:
                continue
            for each in scene.transforms(index).maps:
                placed = transform(np.concatenate([each, [[0.0, 0.0, 0.0, 1.0]]]))
                written.append(element("shape", element("ref", id=ids[name]), placed, type="instance"))
        return written

    # --- surfaces

    def _surface(self, at: _At, shape: AnyShape, points: _Floats, grouped: bool) -> list[Element]:
        """Material, emission and media."""
        scene = self._target.scene
        made: list[Element] = []
        passes = self._passes(shape)
        around, index = (self._media.fog, 1.0)
        if passes and not grouped:

            def told() -> None:
                self._target.leave_out("the order of media that overlap", *at)

            around, index = self._media.around(points, shape, told)
        if shape.material is None and shape.interior is not None:
            made.append(element("bsdf", type="null"))
        else:
            material = None if shape.material is None else scene.materials[shape.material]
            ranked = getattr(material, "priority", None) is not None
            made.append(self._materials.reference(shape.material, index if ranked else None))
        if emits(scene, shape):
            made.append(element("emitter", self._radiance(at, shape), type="area"))
        if passes:
            inside = self._media.inside(shape)
            made += [] if inside is None else [element("ref", name="interior", id=inside)]
            made += [] if around is None else [element("ref", name="exterior", id=around)]
        self._tell(at, shape)
        return made

    def _radiance(self, at: _At, shape: AnyShape) -> Element:
        if shape.emission is not None:
            return self._textures.color("radiance", shape.emission, (*at, "emission"))
        assert shape.material is not None
        material = self._target.scene.materials[shape.material]
        assert isinstance(material, Principled)
        where = ("materials", shape.material, "emission")
        return self._textures.color("radiance", material.emission, where, material.emission_strength)

    def _tell(self, at: _At, shape: AnyShape) -> None:
        """Note what Mitsuba's shapes lack."""
        if isinstance(shape, Mesh):
            if shape.color_key is not None:
                self._target.leave_out("colours of vertices", *at, shape.color_key)
            if shape.shadow_terminator_offset:
                self._target.leave_out("the shadow terminator offset", *at)
        if not isinstance(shape, Sphere) and any(_is_brushed(each) for each in self._parts(shape.material)):
            self._target.leave_out("the direction of anisotropy on shapes other than spheres", *at)

    def _parts(self, name: str | None) -> list[Any]:
        """A material, and those that it mixes."""
        if name is None:
            return []
        material = self._target.scene.materials[name]
        if not isinstance(material, Mix):
            return [material]
        return [each for part in material.materials for each in self._parts(part)]

    def _set(self, at: _At, shape: AnyShape) -> int | None:
        """The set of texture coordinates that a shape's textures use; None if it has no textures."""
        sets = set()
        if shape.material is not None:
            sets = {each.uv_set for _, each in material_textures(self._target.scene.materials, shape.material)}
        if isinstance(shape.emission, ImageTexture | Checker | Ramp | NormalMap | BumpMap):
            sets.add(shape.emission.uv_set)
        if len(sets) > 1:
            self._target.leave_out("the second set of texture coordinates, where both are used", *at)
        return min(sets) if sets else None

    # --- kinds

    def _shape(self, at: _At, shape: AnyShape, grouped: bool = False) -> Element:
        named = {} if shape.name is None else {"id": self._target.id("shape", shape.name)}
        matrix = _matrix(shape)
        textured = self._set(at, shape)
        flip = shape.flip_normals
        if isinstance(shape, Sphere):
            local = np.diag([shape.radius, shape.radius, shape.radius, 1.0])
            local[:3, 3] = shape.center
            whole = product(matrix, product(local, _POLES))
            flip = flip != (determinant(whole[:3, :3]) < 0.0)  # mirroring turns Mitsuba's spheres inside out
            kind, inside = "sphere", [transform(whole)]
        elif isinstance(shape, Disk) and textured is None:
            kind, inside = "disk", [transform(product(matrix, _disk_frame(shape)))]
        elif isinstance(shape, Quad):
            kind, inside = "rectangle", [transform(product(matrix, _quad_frame(shape)))]
        elif isinstance(shape, Box) and textured is None:
            local = np.diag([*(np.array(shape.size) / 2.0), 1.0])
            local[:3, 3] = shape.center
            kind, inside = "cube", [transform(product(matrix, local))]
        else:
            if isinstance(shape, Disk):
                self._target.leave_out(f"the roundness of disks with textures, which have {_AROUND} edges", *at)
            mesh = self._triangles(at, shape)
            kind, inside = "ply", self._file(shape.type, mesh, textured)
            if not (matrix == np.eye(4)).all():
                inside.append(transform(matrix))
            # The order of corners decides there about the front, which mirroring reverses
            flip = flip != (mesh.normals is None and determinant(matrix[:3, :3]) < 0.0)
        if flip:
            inside.append(value("boolean", "flip_normals", True))
        points = _world(shape, self._triangles(at, shape))[0] if self._passes(shape) else np.zeros((0, 3))
        return element("shape", *inside, *self._surface(at, shape, points, grouped), type=kind, **named)

    def _merged(self, shapes: Sequence[tuple[_At, AnyShape]]) -> Element:
        """Flat shapes of one surface as one mesh in world space."""
        at, first = shapes[0]
        vertices, triangles, uvs, count = [], [], [], 0
        textured = self._set(at, first)
        for where, shape in shapes:
            mesh = self._triangles(where, shape)
            points, corners = _world(shape, mesh)
            vertices.append(points)
            triangles.append(corners + count)
            uvs.append(mesh.uvs)
            count += len(points)
        whole = MeshData(
            np.concatenate(vertices).astype(np.float32),
            np.concatenate(triangles).astype(np.uint32),
            uvs=np.concatenate(uvs),  # type: ignore[arg-type]
        )
        inside = self._file(first.material or "flat", whole, textured)
        points = np.concatenate(vertices)
        return element("shape", *inside, *self._surface(at, first, points, False), type="ply")

    def _triangles(self, at: _At, shape: AnyShape) -> MeshData:
        """Triangles of a shape before its transform, with the texture coordinates of flat shapes."""
        if isinstance(shape, Mesh):
            return self._target.scene.mesh_of(at, shape)
        if isinstance(shape, Sphere):
            axes = np.concatenate([np.eye(3), -np.eye(3)])
            return MeshData(np.array(shape.center) + shape.radius * axes, np.zeros((0, 3), np.uint32))
        if isinstance(shape, Disk):
            return _disk_mesh(shape)
        mesh = polyhedron(shape)
        return dataclasses.replace(mesh, uvs=corner_uvs(shape, mesh))

    def _file(self, stem: str, mesh: MeshData, textured: int | None) -> list[Element]:
        """A PLY file of a mesh, with texture coordinates if it has textures."""
        uvs = None if textured is None else (mesh.uvs, mesh.uvs_1)[textured]
        key = f"{mesh.sha256()} {textured if uvs is not None else None}"
        digest = hashlib.sha256(key.encode()).hexdigest()
        write = partial(write_plain_ply, mesh=mesh, uvs=uvs)
        name = self._target.files.add(self._target.folder, stem, ".ply", digest, write)
        flat = [value("boolean", "face_normals", True)] if mesh.normals is None else []
        return [value("string", "filename", name), *flat]


def write_plain_ply(file: IO[bytes], mesh: MeshData, uvs: NDArray[np.float32] | None) -> None:
    """Write a mesh as Mitsuba reads it: with one pair of texture coordinates for each vertex.

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
    columns = [(("x", "y", "z"), points), (("nx", "ny", "nz"), normals), (("u", "v"), pairs)]
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


def _surface_key(shape: AnyShape) -> str:
    """What shapes of one surface share."""
    return json.dumps(shape.model_dump(mode="json", include={"material", "emission", "name"}), sort_keys=True)


def _matrix(shape: AnyShape) -> _Floats:
    """A shape's transform, (4, 4)."""
    place, made = affine(shape.transform), np.eye(4)
    made[:3, :3], made[:3, 3] = place.linear, place.offset
    return made


def _placed(shape: AnyShape, outer: _Floats) -> AnyShape:
    """A shape of a group under the (3, 4) map of an instance."""
    whole = product(np.concatenate([outer, [[0.0, 0.0, 0.0, 1.0]]]), _matrix(shape))
    return shape.with_checked(transform=Transform(matrix=tuple(map(tuple, whole.tolist()))))


def _world(shape: AnyShape, mesh: MeshData) -> tuple[_Floats, NDArray[np.uint32]]:
    """Vertices in world space, and triangles with the shape's front in front."""
    matrix = _matrix(shape)
    points = times(matrix[:3, :3], mesh.vertices) + matrix[:3, 3]
    turned = shape.flip_normals != (determinant(matrix[:3, :3]) < 0.0)
    return points, mesh.triangles[:, ::-1] if turned else mesh.triangles


def _quad_frame(shape: Quad) -> _Floats:
    """From the square from -1 to 1 to a parallelogram."""
    origin, u, v = (np.array(each) for each in (shape.origin, shape.edge_u, shape.edge_v))
    normal, made = np.cross(u, v), np.eye(4)
    made[:3, :3] = np.stack([u / 2.0, v / 2.0, normal / length(normal)], axis=1)
    made[:3, 3] = origin + (u + v) / 2.0
    return made


def _disk_frame(shape: Disk) -> _Floats:
    """From the unit disk across +z."""
    normal = tuple(each / length(shape.normal) for each in shape.normal)
    across, along = face_axes(normal)  # type: ignore[arg-type]
    made = np.eye(4)
    made[:3, :3] = np.stack([shape.radius * np.array(across), shape.radius * np.array(along), normal], axis=1)
    made[:3, 3] = shape.center
    return made


def _disk_mesh(shape: Disk) -> MeshData:
    """A disk as a fan of triangles, whose texture coordinates lie flat on it."""
    sines, cosines = sines_cosines(2.0 * math.pi * np.arange(_AROUND) / _AROUND)
    rim = np.stack([cosines, sines, np.zeros(_AROUND)], axis=1)
    points = np.concatenate([np.zeros((1, 3)), rim])
    first = np.arange(_AROUND)
    triangles = np.stack([np.zeros(_AROUND, np.int64), 1 + first, 1 + (first + 1) % _AROUND], axis=1).astype(np.uint32)
    uvs = ((points[:, :2] + 1.0) / 2.0).astype(np.float32)[triangles]
    frame = _disk_frame(shape)
    return MeshData(times(frame[:3, :3], points) + frame[:3, 3], triangles, uvs=uvs)


def _is_brushed(material: Any) -> bool:
    return isinstance(material, Conductor | Principled) and material.anisotropy != 0.0
