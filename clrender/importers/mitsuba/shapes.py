"""Converts Mitsuba's shapes to ours, with their transforms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from clrender.curves import CurveData
from clrender.errors import SceneError
from clrender.exact.matrices import length, product
from clrender.importers.mitsuba.materials import MaterialReader
from clrender.importers.mitsuba.media import MediumReader
from clrender.importers.mitsuba.plugins import Keys, Plugin
from clrender.importers.mitsuba.textures import TextureReader
from clrender.importers.shared.matrices import (
    Matrix,
    frame_along,
    handedness,
    identity,
    inverse,
    is_affine,
    is_similarity,
    scaling,
    translation,
)
from clrender.importers.shared.meshes import (
    cube_mesh,
    cylinder_mesh,
    disk_part_mesh,
    faced_by_normals,
    flipped_v,
    smoothed,
    with_uvs,
    without_normals,
)
from clrender.importers.shared.motions import fault_of_motion, motion_keys
from clrender.importers.shared.staging import Staging
from clrender.importers.shared.strands import has_inside, placed_rows
from clrender.meshes.data import MeshData
from clrender.meshes.read import read_mesh, read_serialized_mesh
from clrender.scene.values import NAME_LIMIT, SHAPE_LIMIT
from clrender.wording import counted, quoted

__all__ = ["ShapeReader"]

_POLES: Final = np.array([[0.0, 0.0, -1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""From our sphere to Mitsuba's: u runs from 0 at +x, v from 0 at +z. It mirrors, as v runs the other way there."""
_CORNERS: Final = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
"""Texture coordinates of triangles that have none."""
_GROUP_DEPTH: Final = 4


@dataclass(frozen=True)
class _Place:
    """Where a shape is, and how it moves.

    Attributes
    ----------
    matrix : (4, 4) float64
        What acts first.
    keys : tuple of (float, (4, 4) float64)
        What acts then, at times; none of what is at rest.
    moves_inside : bool
        Whether something moves within what moves, which is not followed.
    """

    matrix: Matrix = field(default_factory=identity)
    keys: Keys = ()
    moves_inside: bool = False

    def of(self, plugin: Plugin) -> _Place:
        """The place of an object whose parent is here."""
        keys = plugin.keys()
        if keys and not self.keys:
            return _Place(keys=tuple((time, product(self.matrix, matrix)) for time, matrix in keys))
        return _Place(product(self.matrix, plugin.matrix()), self.keys, self.moves_inside or bool(keys))


class ShapeReader:
    """Converts shapes.

    Parameters
    ----------
    staging : Staging
    textures : TextureReader
    materials : MaterialReader
    media : MediumReader
    old : bool
        Whether the file is one of 0.6.
    """

    def __init__(
        self,
        staging: Staging,
        textures: TextureReader,
        materials: MaterialReader,
        media: MediumReader,
        old: bool,
    ) -> None:
        self._staging, self._textures, self._materials, self._media = staging, textures, materials, media
        self._old = old
        self._count = 0
        self.moves = False
        """Whether anything moves that was read."""
        self.unfilled: list[dict[str, Any]] = []
        """Shapes of the draft that are glass which names no media."""

    def read(self, plugin: Plugin, place: _Place | None = None, depth: int = 0) -> None:
        """Add a shape, or all shapes of a group.

        Parameters
        ----------
        plugin : Plugin
        place : optional
            That of the instance that it is part of.
        depth : int
            Nesting depth of instances around it.

        Raises
        ------
        SceneError
            It cannot be read, or is nested too deep.
        """
        self._count += 1
        if self._count > SHAPE_LIMIT:
            raise plugin.fault(
                f"more than {counted(SHAPE_LIMIT, 'shape')} are written out, which is the most; use fewer instances"
            )
        place = _Place() if place is None else place
        if plugin.type == "instance":
            self._instance(plugin, place, depth)
        elif plugin.type == "merge":
            if depth >= _GROUP_DEPTH:
                raise plugin.fault(f"shapes are nested more than {_GROUP_DEPTH} deep, or contain themselves")
            for child in plugin.children_of("shape"):
                self.read(child, place, depth + 1)
        elif plugin.type == "shapegroup":
            pass  # only its instances are visible
        else:
            self._one(plugin, place)

    def _instance(self, plugin: Plugin, place: _Place, depth: int) -> None:
        if depth >= _GROUP_DEPTH:
            raise plugin.fault(f"instances are nested more than {_GROUP_DEPTH} deep, or contain themselves")
        groups = plugin.children_of("shape")
        inside = place.of(plugin)
        for group in groups:
            for child in group.children_of("shape"):
                self.read(child, inside, depth + 1)
        self._tell_unused(plugin)

    def _one(self, plugin: Plugin, place: _Place) -> None:
        known: dict[str, Callable[[Plugin, dict[str, Any], Matrix, bool], None]] = {
            "sphere": self._sphere,
            "rectangle": self._rectangle,
            "cube": self._cube,
            "disk": self._disk,
            "cylinder": self._cylinder,
            "obj": self._file,
            "ply": self._file,
            "serialized": self._file,
            "bsplinecurve": self._curves,
            "linearcurve": self._curves,
            "hair": self._curves,
        }
        if plugin.type not in known:
            self._staging.note(f"{plugin.label} is not known and left out")
            return
        placed = self._followed(plugin, place.of(plugin))
        plugin.ignore("to_world")
        flip = plugin.flag("flip_normals", False)
        exchanged = flip and self._is_reversed_boundary(plugin)
        described = self._surface(plugin, exchanged)
        if described is None:
            return
        if plugin.type != "ply" and described.get("material") in self._materials.colored:
            self._staging.note(f"{plugin.label} has no colours of vertices: white in their place")
        if plugin.id:
            described["name"] = plugin.id[:NAME_LIMIT]
        if placed.keys:
            described["motion"] = motion_keys(placed.keys)
            self.moves = True
        shapes = self._staging.draft.description["shapes"]
        before = len(shapes)
        known[plugin.type](plugin, described, placed.matrix, flip and not exchanged)
        material = described.get("material")
        if not plugin.has("interior", "exterior") and material is not None and self._staging.is_solid(material):
            self.unfilled += shapes[before:]
        self._tell_unused(plugin)

    def _followed(self, plugin: Plugin, place: _Place) -> _Place:
        """The place, at rest if the shape cannot follow its motion."""
        if place.moves_inside:
            self._staging.note("what moves within an instance that moves is read as it is at its first moment")
        cause = fault_of_motion(plugin.type, [matrix for _, matrix in place.keys])
        if not cause:
            return place
        self._staging.note(f"{cause}: what moves like that stands where it is at first")
        return _Place(product(place.keys[0][1], place.matrix))

    def _tell_unused(self, plugin: Plugin) -> None:
        for name in plugin.unused():
            self._staging.note(f"{quoted(name)} of {plugin.label} is not understood and does nothing")

    def _is_reversed_boundary(self, plugin: Plugin) -> bool:
        """Whether a shape with `flip_normals` is but the boundary of media, with its exterior inside."""
        bsdfs = plugin.children_of("bsdf")
        if not bsdfs or plugin.children_of("emitter") or plugin.child("exterior") is None:
            return False
        # A reflecting transform turns round spheres and meshes a second time
        outward = plugin.type in ("rectangle", "cube", "disk", "cylinder") or handedness(plugin.matrix()) > 0.0
        return outward and self._materials.name(bsdfs[0]) is None

    def _surface(self, plugin: Plugin, exchanged: bool) -> dict[str, Any] | None:
        """Material, emission and interior; None if it is invisible.

        Parameters
        ----------
        plugin : Plugin
        exchanged : bool
            Whether its exterior is its interior here.
        """
        described: dict[str, Any] = {}
        bsdfs, emitters = plugin.children_of("bsdf"), plugin.children_of("emitter")
        seen = True
        if bsdfs:
            name = self._materials.name(bsdfs[0])
            seen = name is not None
            if name is not None:
                described["material"] = name
        else:
            described["material"] = self._default(0.0 if emitters else 0.5)
        if emitters:
            if emitters[0].type not in ("area", "directionalarea"):
                self._staging.note(f"{emitters[0].label} on a shape is not known and left out")
            else:
                if emitters[0].type == "directionalarea":
                    self._staging.note('"directionalarea" emitters are read as ones that shine to all sides')
                described["emission"] = self._textures.emission(emitters[0])
                emitters[0].ignore("sampling_weight")
                self._tell_unused(emitters[0])
        interior, exterior = plugin.child("interior"), plugin.child("exterior")
        if exchanged:
            interior, exterior = exterior, interior
        medium = self._inside(described.get("material"), interior, exterior)
        if medium is not None:
            described["interior"] = medium
        if not seen and "interior" not in described and "emission" not in described:
            return None
        return described

    def _inside(self, material: str | None, interior: Plugin | None, exterior: Plugin | None) -> str | None:
        """Name of the medium inside of a shape; that outside follows from the shapes here, and from the fog."""
        medium = None
        if interior is not None and self._may_be_filled(material):
            medium = self._media.name(interior)
            if medium is not None and (exterior is None or self._media.name(exterior) != medium):
                self._media.bounded.add(medium)
        if medium is None and material is None and exterior is not None and self._media.name(exterior) is not None:
            return self._staging.vacuum()
        return medium

    def _default(self, grey: float) -> str:
        """Name of the diffuse material of shapes without a BSDF: black if they shine."""
        return self._staging.material("default", {"type": "lambert", "reflectance": [grey] * 3, "two_sided": False})

    def _may_be_filled(self, material: str | None) -> bool:
        solid = self._staging.is_solid(material)
        if not solid:
            self._staging.note("a medium inside of what lets no light in is left out")
        return solid

    # --- kinds

    def _sphere(self, plugin: Plugin, described: dict[str, Any], matrix: Matrix, flip: bool) -> None:
        x, y, z = plugin.vector("center", (0.0, 0.0, 0.0))
        matrix = product(matrix, translation(x, y, z))
        # Mirroring turns Mitsuba's sphere inside out, but that by an instance does not
        inside_out = flip != (handedness(plugin.matrix()) < 0.0)
        described = {**described, "flip_normals": True} if inside_out else described
        self._staging.sphere(described, plugin.number("radius", 1.0), product(matrix, _POLES), plugin.line)

    def _rectangle(self, plugin: Plugin, described: dict[str, Any], matrix: Matrix, flip: bool) -> None:
        quad = {"type": "quad", "origin": [-1.0, -1.0, 0.0], "edge_u": [2.0, 0.0, 0.0], "edge_v": [0.0, 2.0, 0.0]}
        self._staging.shape({**quad, **described, **_flipped(flip)}, matrix, plugin.line)

    def _disk(self, plugin: Plugin, described: dict[str, Any], matrix: Matrix, flip: bool) -> None:
        if self._staging.is_textured(described):
            self._staging.mesh({**described, **_flipped(flip)}, "disk", _polar_disk, matrix, plugin.line)
            return
        self._staging.disk({**described, **_flipped(flip)}, 1.0, 0.0, matrix, plugin.line)

    def _cube(self, plugin: Plugin, described: dict[str, Any], matrix: Matrix, flip: bool) -> None:
        if self._staging.is_textured(described):
            self._staging.mesh({**described, **_flipped(flip)}, "cube", cube_mesh, matrix, plugin.line)
            return
        self._staging.shape(
            {"type": "box", "size": [2.0, 2.0, 2.0], **described, **_flipped(flip)}, matrix, plugin.line
        )

    def _cylinder(self, plugin: Plugin, described: dict[str, Any], matrix: Matrix, flip: bool) -> None:
        start = plugin.vector("p0", (0.0, 0.0, 0.0))
        end = plugin.vector("p1", (0.0, 0.0, 1.0))
        radius = plugin.number("radius", 1.0)
        size = length(end - start)
        if not (radius > 0.0 and size > 0.0):
            raise plugin.fault("the cylinder has no radius or no length; give it both")
        matrix = product(product(matrix, frame_along(start, end - start)), scaling(radius, radius, size))
        # Unlike spheres, mirrored cylinders keep their front outside
        described = {**described, **_flipped(flip)}
        self._staging.mesh(described, "cylinder", lambda: cylinder_mesh(1.0, 0.0, 1.0), matrix, plugin.line)

    def _curves(self, plugin: Plugin, described: dict[str, Any], matrix: Matrix, flip: bool) -> None:
        """Strands of a file. Their own transform does not scale their radii, but that of an instance does.

        Mitsuba 0.6's `hair` has one radius, which its transform scales.
        """
        file = plugin.text("filename")
        if not file:
            raise plugin.fault(f'{plugin.label} has no "filename"; give it')
        if "emission" in described:
            self._staging.note("curves do not shine here: their light is left out")
            described.pop("emission")
        if described.pop("interior", None) is not None or has_inside(self._staging.draft, described.get("material")):
            self._staging.note("curves of what has an inside are left out: they have none here")
            return
        own = plugin.matrix()
        if not is_affine(own):
            raise plugin.fault("the shape's transform is no affine one that can be inverted; give it another")
        hair = plugin.type == "hair"
        data = self._staging.curves_of_file(file, plugin.line, hair=hair)
        if data is None:
            return
        radii = np.full(len(data.points), self._hair_radius(plugin)) if hair else data.radii
        if radii is None:
            raise plugin.fault(f"{quoted(file)} has no radii; give them as the fourth number of each line")
        draft = self._staging.draft
        rows = placed_rows(draft, np.column_stack([data.points, radii]), own, scaled=hair)
        outer = product(matrix, inverse(own))
        if not is_similarity(outer):
            rows, outer = placed_rows(draft, rows, outer), np.eye(4)
        made = CurveData.checked(rows, data.counts, quoted(file))
        name = f"{file} {len(draft.curves) + 1}"
        same = (each for each, held in draft.curves.items() if held.sha256() == made.sha256())
        name = next(same, name)
        draft.curves[name] = made
        basis = "bspline" if plugin.type == "bsplinecurve" else "linear"
        shape = {"type": "curves", "file": name, "basis": basis, **described}
        self._staging.shape(shape, outer, plugin.line)

    def _hair_radius(self, plugin: Plugin) -> float:
        radius = plugin.number("radius", 0.025)
        if not radius >= 0.0:
            raise plugin.fault(f'the "radius" of {plugin.label} is {radius:g}; give a number that is not below 0')
        if plugin.number("reduction", 0.0) != 0.0:
            self._staging.note('"reduction" of hair is left out: all strands are there, with their own radius')
        plugin.ignore("angle_threshold")
        return radius

    def _file(self, plugin: Plugin, described: dict[str, Any], matrix: Matrix, flip: bool) -> None:
        file = plugin.text("filename")
        if not file:
            raise plugin.fault(f'{plugin.label} has no "filename"; give it')
        flat = plugin.flag("face_normals", False)
        turned = plugin.flag("flip_tex_coords", plugin.type == "obj")
        if plugin.has("max_smooth_angle"):
            self._staging.note('"max_smooth_angle" is left out: such meshes are smooth as others are')
            plugin.ignore("max_smooth_angle")
        index = plugin.whole("shape_index", 0) if plugin.type == "serialized" else 0
        plugin.ignore("collapse", "shape_index")
        faceted = False

        def serialized(name: str, folder: Path, allow_paths: Sequence[Path], place: str) -> MeshData:
            nonlocal faceted
            mesh, wanted = read_serialized_mesh(name, folder, allow_paths, place, index)
            faceted = wanted and self._old  # Mitsuba 3 ignores it
            return without_normals(mesh) if faceted else mesh

        def coloured(name: str, folder: Path, allow_paths: Sequence[Path], place: str) -> MeshData:
            try:
                return read_mesh(name, folder, allow_paths, place, "auto")
            except SceneError:  # it may have no colours
                return read_mesh(name, folder, allow_paths, place)

        def adapted(mesh: MeshData, mapped: Callable[[MeshData], MeshData] = lambda mesh: mesh) -> MeshData:
            if turned != self._old:  # in 0.6 images are upright with the file's own numbers
                mesh = flipped_v(mesh)
            if flat or faceted:
                return mapped(without_normals(mesh))
            return faced_by_normals(mapped(mesh)) if mesh.normals is not None else mapped(smoothed(mesh))

        kind = f"{plugin.type}{f' {index}' if index else ''}{', flat' if flat else ''}{', turned' if turned else ''}"
        read = serialized if plugin.type == "serialized" else read_mesh
        if plugin.type == "ply" and described.get("material") in self._materials.colored:
            kind, read = f"{kind}, coloured", coloured
        found = self._staging.mesh_of_file(file, kind, plugin.line, adapted, read)
        if found is not None and self._staging.lacks_uvs(found[0], described):
            found = self._staging.mesh_of_file(
                file,
                f"{kind}, mapped",
                plugin.line,
                lambda mesh: adapted(mesh, lambda own: with_uvs(own, _CORNERS)),
                read,
            )
        if found is None:
            return
        name, had_normals = found
        if read is coloured and self._staging.draft.meshes[name].colors is None:
            self._staging.note(f"{plugin.label} has no colours of vertices: white in their place")
        elif read is coloured:
            described = {**described, "vertex_colors": "linear"}
        # Without normals in the file, the winding decides, and mirroring reverses it
        by_winding = flat or not had_normals
        inside_out = flip != (by_winding and handedness(plugin.matrix()) < 0.0)
        self._staging.shape({"type": "mesh", "file": name, **described, **_flipped(inside_out)}, matrix, plugin.line)


def _polar_disk() -> MeshData:
    """Mitsuba's disk: u runs from the middle to the rim, v around."""
    mesh = disk_part_mesh(1.0, 0.0, 0.0, 1.0)
    assert mesh.uvs is not None
    return replace(mesh, uvs=np.stack([np.float32(1.0) - mesh.uvs[..., 1], mesh.uvs[..., 0]], axis=-1))


def _flipped(flip: bool) -> dict[str, Any]:
    return {"flip_normals": True} if flip else {}
