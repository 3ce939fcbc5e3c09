"""Shapes as LuxCore's, which are all meshes."""

from __future__ import annotations

import hashlib
from functools import partial
from typing import Any

import numpy as np

from clrender.exact.matrices import determinant
from clrender.exporters.luxcore_materials import MaterialWriter
from clrender.exporters.luxcore_text import Properties
from clrender.exporters.surfaces import (
    boundaries,
    maps_normals,
    tell_of_meshes,
    tell_of_round,
    texture_set,
    turns_green,
)
from clrender.exporters.target import Target
from clrender.exporters.triangles import At, Piece, pieces_of, shapes_of_instances, write_plain_ply
from clrender.scene.groups import Instance
from clrender.scene.resting import placements
from clrender.scene.shapes import AnyShape

__all__ = ["ShapeWriter"]


class ShapeWriter:
    """Writes shapes, groups and their instances.

    Parameters
    ----------
    target : Target
    properties : dict
        Where they are written.
    materials : MaterialWriter
    merge : bool
        Whether flat shapes of the same surface become one mesh.
    """

    def __init__(self, target: Target, properties: Properties, materials: MaterialWriter, merge: bool) -> None:
        self._target, self._properties, self._materials, self._merge = target, properties, materials, merge
        self._apart = boundaries(target.scene)
        self._meshes: dict[str, str] = {}

    def write(self) -> None:
        """All shapes of the scene."""
        scene = self._target.scene
        shapes = enumerate(scene.shapes)
        own = [(("shapes", i), each) for i, each in shapes if not isinstance(each, Instance)]
        for piece in self._pieces(own + shapes_of_instances(scene)):
            self._object(*piece)
        groups: dict[str, list[tuple[str, str, str]]] = {}
        for index, instance in scene.instances():
            name = instance.group
            if name not in groups:
                inside = enumerate(scene.groups[name].shapes)
                groups[name] = self._pieces([(("groups", name, "shapes", i), each) for i, each in inside])
            for each in placements(scene, index):
                if determinant(each[:, :3]) < 0.0:
                    continue
                # Column by column
                whole = np.concatenate([each, [[0.0, 0.0, 0.0, 1.0]]]).T
                for piece in groups[name]:
                    self._object(*piece, transformation=whole)

    def _pieces(self, shapes: list[tuple[At, AnyShape]]) -> list[tuple[str, str, str]]:
        """Names of shapes and materials, each with a name to be given to objects of them."""
        made = []
        for piece in pieces_of(self._target.scene, shapes, self._merge, self._apart):
            at, shape = piece.at, piece.shape
            tell_of_meshes(self._target, at, shape)
            tell_of_round(self._target, at, shape)
            name = shape.name or shape.material or "shape"
            turned = maps_normals(self._target.scene, shape) and turns_green(self._target, at, shape, piece.mesh)
            made.append((self._mesh(name, piece), self._materials.of_shape(at, shape, turned), name))
        return made

    def _mesh(self, wanted: str, piece: Piece) -> str:
        """The name of a mesh, which is a PLY file."""
        textured = texture_set(self._target, piece.at, piece.shape)
        uvs = None if textured is None else (piece.mesh.uvs, piece.mesh.uvs_1)[textured]
        digest = hashlib.sha256(f"{piece.mesh.sha256()} {None if uvs is None else textured}".encode()).hexdigest()
        if digest not in self._meshes:
            write = partial(write_plain_ply, mesh=piece.mesh, uvs=uvs)
            file = self._target.files.add(self._target.folder, wanted, ".ply", digest, write)
            name = self._target.id("mesh", f"mesh-{wanted}")
            self._properties |= {f"scene.shapes.{name}.type": "mesh", f"scene.shapes.{name}.ply": file}
            self._meshes[digest] = name
        return self._meshes[digest]

    def _object(self, mesh: str, material: str, wanted: str, **more: Any) -> None:
        name = self._target.id("object", wanted)
        values = {"shape": mesh, "material": material, **more}
        self._properties.update({f"scene.objects.{name}.{key}": each for key, each in values.items()})
