"""Shapes as Mitsuba's: spheres, rectangles, cubes, disks, and triangles in PLY files."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import IO, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.exact.matrices import determinant, length, product, times
from clrender.exporters.mitsuba_materials import MaterialWriter
from clrender.exporters.mitsuba_media import MediumWriter
from clrender.exporters.mitsuba_textures import TextureWriter
from clrender.exporters.mitsuba_xml import Element, element, transform, value
from clrender.exporters.surfaces import (
    is_brushed,
    maps_normals,
    passes,
    radiance_of,
    tell_of_curves,
    tell_of_meshes,
    texture_set,
    turns_green,
)
from clrender.exporters.target import Target
from clrender.exporters.triangles import (
    DISK_EDGES,
    MIRROR,
    At,
    disk_frame,
    matrix_of,
    merged,
    mirrored,
    mirrors,
    placed,
    surface_key,
    triangles_of,
    world,
    world_mesh,
    write_plain_ply,
)
from clrender.flatten.curves import strand_radii
from clrender.flatten.emission import emits
from clrender.meshes.data import MeshData
from clrender.scene import Curves, Disk, Mesh, Sphere
from clrender.scene.groups import Instance
from clrender.scene.materials import Hair, material_parts
from clrender.scene.resting import placements
from clrender.scene.shapes import AnyShape, Box, Quad
from clrender.scene.textures import Texture
from clrender.scene.transforms import affine
from clrender.wording import place

__all__ = ["ShapeWriter"]

_Floats: TypeAlias = NDArray[np.float64]
_POLES: Final = np.array([[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""From Mitsuba's sphere to ours: there u runs from 0 at +x, and v from 0 at +z, downwards, so that this mirrors."""

_CURVES: Final = {"bspline": "bsplinecurve", "linear": "linearcurve"}


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

    def shapes(self) -> list[Element]:
        """All shapes of the scene."""
        scene = self._target.scene
        own: list[tuple[At, AnyShape]] = [
            (("shapes", i), shape) for i, shape in enumerate(scene.shapes) if not isinstance(shape, Instance)
        ]
        # Mitsuba has no lights in groups
        for index, instance in scene.instances():
            for at, shape in self._shining(instance.group):
                own += [(at, placed(shape, each)) for each in placements(scene, index)]
        for at, shape in own:
            if passes(scene, shape) and not isinstance(shape, Disk):
                self._media.add(shape, *world(shape, triangles_of(scene, at, shape)))
        written: list[Element] = []
        alike: dict[str, list[tuple[At, AnyShape]]] = {}
        for at, shape in own:
            if self._merge and not isinstance(shape, Sphere | Disk | Mesh | Curves) and not passes(scene, shape):
                alike.setdefault(surface_key(shape), []).append((at, shape))
            else:
                written.append(self._shape(at, shape))
        written += [self._merged(shapes) for shapes in alike.values()]
        return written + self._instances()

    def _shining(self, group: str) -> list[tuple[At, AnyShape]]:
        shapes = enumerate(self._target.scene.groups[group].shapes)
        return [(("groups", group, "shapes", i), shape) for i, shape in shapes if emits(self._target.scene, shape)]

    def _instances(self) -> list[Element]:
        scene, written = self._target.scene, []
        ids: dict[tuple[str, bool], str] = {}
        for index, instance in scene.instances():
            name = instance.group
            mapped = any(maps_normals(scene, shape) for shape in scene.groups[name].shapes)
            for each in placements(scene, index):
                key = name, mapped and mirrors(name, each)  # green of normal maps is another there
                if key not in ids:
                    shapes = enumerate(scene.groups[name].shapes)
                    inside = [
                        self._shape(("groups", name, "shapes", i), shape, of_group=key[1])
                        for i, shape in shapes
                        if not emits(scene, shape)
                    ]
                    ids[key] = self._target.id("group", name) if inside else ""
                    if inside:
                        written.append(element("shape", *inside, type="shapegroup", id=ids[key]))
                if ids[key]:
                    placed = transform(np.concatenate([each, [[0.0, 0.0, 0.0, 1.0]]]))
                    written.append(element("shape", element("ref", id=ids[key]), placed, type="instance"))
        return written

    # --- surfaces

    def _surface(self, at: At, shape: AnyShape, turned: bool, grouped: bool = False) -> list[Element]:
        """Material, emission and media; for `turned` see `turns_green`."""
        scene = self._target.scene
        made: list[Element] = []
        through = passes(scene, shape)
        around, index = (self._media.fog, 1.0)
        if through and not grouped:

            def told() -> None:
                self._target.leave_out("the order of media that overlap", *at)

            points = world(shape, triangles_of(scene, at, shape))[0]
            around, index = self._media.around(points, shape, told)
        if shape.material is None and shape.interior is not None:
            made.append(element("bsdf", type="null"))
        else:
            material = None if shape.material is None else scene.materials[shape.material]
            ranked = getattr(material, "priority", None) is not None
            made.append(self._materials.reference(shape.material, index if ranked else None, turned))
        if emits(scene, shape):
            color, where, factor = radiance_of(scene, at, shape)
            factor *= self._shining_share(at, shape)
            made.append(element("emitter", self._textures.color("radiance", color, where, factor), type="area"))
        if through:
            inside = self._media.inside(shape)
            made += [] if inside is None else [element("ref", name="interior", id=inside)]
            made += [] if around is None else [element("ref", name="exterior", id=around)]
        self._tell(at, shape, grouped)
        return made

    def _shining_share(self, at: At, shape: AnyShape) -> float:
        """The share of its light that a lamp's opacity leaves here; Mitsuba's lamps shine in full."""
        material = None if shape.material is None else self._target.scene.materials[shape.material]
        if material is None or not material.masked:
            return 1.0
        if isinstance(material.opacity, Texture):
            self._target.leave_out("the opacity of lamps where it is a texture: their holes shine, too", *at)
            return 1.0
        return material.opacity if material.opacity_cutoff is None else 0.0

    def _tell(self, at: At, shape: AnyShape, grouped: bool) -> None:
        """Note what Mitsuba's shapes lack."""
        tell_of_meshes(self._target, at, shape)
        parts = material_parts(self._target.scene.materials, shape.material)
        if not any(is_brushed(each) for each in parts):
            return
        if not isinstance(shape, Sphere):
            self._target.leave_out("the direction of anisotropy on shapes other than spheres", *at)
        elif any(_turns_poles(product(each, matrix_of(shape))) for each in self._outer(at, grouped)):
            self._target.leave_out("the direction of anisotropy on spheres whose y axis is turned", *at)

    def _outer(self, at: At, grouped: bool) -> Sequence[_Floats]:
        """Maps of a shape after its transform: (3, 4) those of its group's instances, or the identity."""
        if not grouped:
            return [np.eye(4)]
        own = (index for index, each in self._target.scene.instances() if each.group == at[1])
        return [each for index in own for each in placements(self._target.scene, index)]

    # --- kinds

    def _shape(self, at: At, shape: AnyShape, of_group: bool | None = None) -> Element:
        """A shape, in a group if `of_group` is not None: whether its instances mirror it."""
        named = {} if shape.name is None else {"id": self._target.id("shape", shape.name)}
        matrix = matrix_of(shape)
        textured = texture_set(self._target, at, shape)
        flip = shape.flip_normals
        # The order of corners in space decides there about the front, or of meshes with normals about media
        reflected = determinant(matrix[:3, :3]) < 0.0
        if isinstance(shape, Sphere):
            local = np.diag([shape.radius, shape.radius, shape.radius, 1.0])
            local[:3, 3] = shape.center
            whole = product(matrix, product(local, _POLES))
            flip = flip != (determinant(whole[:3, :3]) < 0.0)  # mirroring turns Mitsuba's spheres inside out
            kind, inside = "sphere", [transform(whole)]
        elif isinstance(shape, Curves) and self._round(shape, textured is not None):
            kind, inside = _CURVES[shape.basis], self._strands(at, shape, matrix)
        elif isinstance(shape, Disk) and textured is None:
            kind, inside = "disk", [transform(product(matrix, disk_frame(shape)))]
        elif isinstance(shape, Quad) and not (reflected and textured is not None):  # with bump maps those are black
            kind, inside = "rectangle", [transform(product(matrix, _quad_frame(shape)))]
        elif isinstance(shape, Box) and textured is None:
            local = np.diag([*(np.array(shape.size) / 2.0), 1.0])
            local[:3, 3] = shape.center
            kind, inside = "cube", [transform(product(product(matrix, local), MIRROR if reflected else np.eye(4)))]
        else:
            if isinstance(shape, Curves):
                tell_of_curves(self._target, shape, at)
            if isinstance(shape, Disk):
                self._target.leave_out(f"the roundness of disks with textures, which have {DISK_EDGES} edges", *at)
            mesh = triangles_of(self._target.scene, at, shape)
            if reflected:
                mesh, matrix = mirrored(mesh), product(matrix, MIRROR)
            kind, inside = "ply", self._file(shape.type, mesh, textured)
            if not (matrix == np.eye(4)).all():
                inside.append(transform(matrix))
        if flip:
            inside.append(value("boolean", "flip_normals", True))
        turned = False
        if maps_normals(self._target.scene, shape):
            turned = turns_green(self._target, at, shape, world_mesh(self._target.scene, at, shape)) != bool(of_group)
        surface = self._surface(at, shape, turned, grouped=of_group is not None)
        return element("shape", *inside, *surface, type=kind, **named)

    def _merged(self, shapes: Sequence[tuple[At, AnyShape]]) -> Element:
        """Flat shapes of one surface as one mesh in world space."""
        at, first = shapes[0]
        whole = merged(self._target.scene, shapes)
        turned = maps_normals(self._target.scene, first) and turns_green(self._target, at, first, whole)
        inside = self._file(first.material or "flat", whole, texture_set(self._target, at, first))
        return element("shape", *inside, *self._surface(at, first, turned), type="ply")

    def _round(self, shape: Curves, textured: bool) -> bool:
        """Whether curves are Mitsuba's. Textures of those run along all strands of a file, as if they were one."""
        if textured and not isinstance(self._target.scene.materials.get(shape.material or ""), Hair):
            return False
        return shape.profile == "round" and shape.basis in _CURVES

    def _strands(self, at: At, shape: Curves, matrix: _Floats) -> list[Element]:
        """A file of curves after their transform, which in Mitsuba would not scale radii."""
        strands = self._target.scene.strands(at, shape)
        points = times(matrix[:3, :3], strands.points) + matrix[:3, 3]
        rows = np.column_stack([points, strand_radii(shape, strands, place(at)) * affine(shape.transform).scale])
        digest = hashlib.sha256(rows.tobytes() + strands.counts.tobytes()).hexdigest()
        write = partial(_write_strands, rows=rows, counts=strands.counts)
        stem = "curves" if shape.file is None else Path(shape.file).stem
        return [value("string", "filename", self._target.files.add(self._target.folder, stem, ".txt", digest, write))]

    def _file(self, stem: str, mesh: MeshData, textured: int | None) -> list[Element]:
        """A PLY file of a mesh, with texture coordinates if it has textures."""
        uvs = None if textured is None else (mesh.uvs, mesh.uvs_1)[textured]
        key = f"{mesh.sha256()} {textured if uvs is not None else None}"
        digest = hashlib.sha256(key.encode()).hexdigest()
        write = partial(write_plain_ply, mesh=mesh, uvs=uvs)
        name = self._target.files.add(self._target.folder, stem, ".ply", digest, write)
        flat = [value("boolean", "face_normals", True)] if mesh.normals is None else []
        return [value("string", "filename", name), *flat]


def _write_strands(file: IO[bytes], rows: _Floats, counts: NDArray[np.int64]) -> None:
    """Lines of x, y, z and radius, with an empty one between strands."""
    ends = set(np.cumsum(counts).tolist())
    for number, row in enumerate(rows.tolist(), start=1):
        file.write((" ".join(map(repr, row)) + ("\n\n" if number in ends else "\n")).encode())


def _turns_poles(matrix: _Floats) -> bool:
    """Whether a map has the y axis point elsewhere than along itself: around that, anisotropy lies here."""
    axis = matrix[:3, 1]
    return bool(np.abs(axis[[0, 2]]).max() > 1e-6 * abs(axis[1]))


def _quad_frame(shape: Quad) -> _Floats:
    """From the square from -1 to 1 to a parallelogram."""
    origin, u, v = (np.array(each) for each in (shape.origin, shape.edge_u, shape.edge_v))
    normal, made = np.cross(u, v), np.eye(4)
    made[:3, :3] = np.stack([u / 2.0, v / 2.0, normal / length(normal)], axis=1)
    made[:3, 3] = origin + (u + v) / 2.0
    return made
