"""Shapes as Blender's meshes and objects."""

from __future__ import annotations

import hashlib
from functools import partial
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.matrices import product
from clrender.exporters.cycles_materials import MaterialWriter
from clrender.exporters.surfaces import boundaries, tell_of_meshes, tell_of_round, texture_set
from clrender.exporters.target import Target
from clrender.exporters.triangles import At, Piece, mirrors, pieces_of, shapes_of_instances
from clrender.flatten.emission import emits
from clrender.flatten.faces import inner
from clrender.flatten.near_pairs import near_pairs
from clrender.meshes.data import MeshData
from clrender.scene import Scene
from clrender.scene.groups import Instance
from clrender.scene.materials import material_parts
from clrender.scene.resting import placements
from clrender.scene.shapes import AnyShape

__all__ = ["ShapeWriter"]

_EVEN: Final = 1e-6
"""Relative differences of squared lengths that are rounding."""
_MOST: Final = 2**20
"""Pairs of media beyond which all are taken to overlap."""


class ShapeWriter:
    """Writes shapes, groups and their instances.

    Parameters
    ----------
    target : Target
    materials : MaterialWriter
    merge : bool
        Whether flat shapes of the same surface become one mesh.

    Attributes
    ----------
    meshes : dict
        File and material of each mesh, by name.
    objects : list
        Name, mesh, place, and whether the camera sees it.
    """

    def __init__(self, target: Target, materials: MaterialWriter, merge: bool) -> None:
        self._target, self._materials, self._merge = target, materials, merge
        self._apart = boundaries(target.scene)
        self.meshes: dict[str, list[str]] = {}
        self.objects: list[Any] = []
        self._names: dict[tuple[str, str], str] = {}
        self._mapped: dict[str, bool] = {}

    def write(self) -> None:
        """All shapes of the scene."""
        scene = self._target.scene
        own = [(("shapes", i), each) for i, each in enumerate(scene.shapes) if not isinstance(each, Instance)]
        for piece in self._pieces(own + shapes_of_instances(scene, self._differs)):
            self._object(piece, np.eye(4))
        groups: dict[str, list[tuple[str, str, dict[str, bool]]]] = {}
        for index, instance in scene.instances():
            name = instance.group
            if name not in groups:
                inside = enumerate(scene.groups[name].shapes)
                groups[name] = self._pieces([(("groups", name, "shapes", i), each) for i, each in inside])
            for each in placements(scene, index):
                if not self._differs(name, each):
                    for piece in groups[name]:
                        self._object(piece, np.concatenate([each, [[0.0, 0.0, 0.0, 1.0]]]))

    def _differs(self, group: str, place: NDArray[np.float64]) -> bool:
        """Whether an instance is another thing in Blender: it has no shear, and its normal maps no uneven scale."""
        scene, axes = self._target.scene, place[:, :3]
        if mirrors(group, place):
            return True
        square = product(axes.T, axes)
        sizes = np.diag(square)
        sheared = np.abs(square - np.diag(sizes)).max() > _EVEN * sizes.max()
        if sheared or sizes.max() - sizes.min() <= _EVEN * sizes.max():
            return bool(sheared)
        if group not in self._mapped:
            names = {shape.material for shape in scene.groups[group].shapes}
            parts = [part for name in names for part in material_parts(scene.materials, name)]
            self._mapped[group] = any(getattr(part, "normal_map", None) is not None for part in parts)
        return self._mapped[group]

    def _pieces(self, shapes: list[tuple[At, AnyShape]]) -> list[tuple[str, str, dict[str, bool]]]:
        """Of shapes a name for objects, the mesh, and what the camera sees of them."""
        made = []
        pieces = pieces_of(self._target.scene, shapes, self._merge, self._apart)
        self._tell_of_insides(pieces)
        for piece in pieces:
            at, shape = piece.at, piece.shape
            tell_of_meshes(self._target, at, shape)
            tell_of_round(self._target, at, shape)
            name = shape.name or shape.material or "shape"
            seen = {"visible_camera": shape.visible_to_camera, "is_shadow_catcher": shape.shadow_catcher}
            made.append((name, self._mesh(name, piece, self._materials.of_shape(at, shape)), seen))
        return made

    def _tell_of_insides(self, pieces: list[Piece]) -> None:
        """Note media whose boxes meet, and lamps in solids with an index, which scales no radiance in Cycles."""
        scene = self._target.scene
        pieces = [each for each in pieces if len(each.mesh.vertices)]
        boxes = np.zeros((len(pieces), 6))
        for box, each in zip(boxes, pieces, strict=True):
            box[:3], box[3:] = each.mesh.vertices.min(axis=0), each.mesh.vertices.max(axis=0)
        insides = np.array([i for i, each in enumerate(pieces) if each.at in self._apart], np.intp)
        some = boxes[insides]
        met = near_pairs(some, some, _MOST)
        if scene.fog is not None or met is None:
            overlapping = insides
        else:
            apart = (some[met[0], :3] >= some[met[1], 3:]).any(axis=1) | (some[met[1], :3] >= some[met[0], 3:]).any(
                axis=1
            )
            overlapping = insides[np.unique(met[1][~apart & (met[0] < met[1])])]
        for i in overlapping.tolist():
            sentence = "that the innermost medium counts: where media overlap, Cycles adds them"
            self._target.leave_out(sentence, *pieces[i].at)
        glass = boxes[[i for i in insides.tolist() if _refracts(scene, pieces[i])]]
        for each, box in zip(pieces, boxes, strict=True):
            within = (glass[:, :3] <= box[:3]).all(axis=1) & (box[3:] <= glass[:, 3:]).all(axis=1)
            if within.any() and emits(scene, each.shape):
                sentence = "the scaling of radiance by the index of what it leaves, so that lamps in glass are brighter"
                self._target.leave_out(sentence, *each.at)

    def _mesh(self, wanted: str, piece: Piece, material: str) -> str:
        """The name of a mesh, which is a file of arrays."""
        textured = texture_set(self._target, piece.at, piece.shape)
        uvs = None if textured is None else (piece.mesh.uvs, piece.mesh.uvs_1)[textured]
        digest = hashlib.sha256(f"{piece.mesh.sha256()} {None if uvs is None else textured}".encode()).hexdigest()
        if (digest, material) not in self._names:
            write = partial(_write_arrays, mesh=piece.mesh, uvs=uvs)
            file = self._target.files.add(self._target.folder, wanted, ".npz", digest, write)
            name = self._names[digest, material] = self._target.id("mesh", wanted)
            self.meshes[name] = [file, material]
        return self._names[digest, material]

    def _object(self, piece: tuple[str, str, dict[str, bool]], matrix: NDArray[np.float64]) -> None:
        wanted, mesh, seen = piece
        self.objects.append([self._target.id("object", wanted), mesh, matrix.tolist(), seen])


def _refracts(scene: Scene, piece: Piece) -> bool:
    """Whether a piece's material has an index."""
    material = None if piece.shape.material is None else scene.materials[piece.shape.material]
    return (getattr(material, "ior", None) or 1.0) != 1.0


def _corner_normals(mesh: MeshData) -> NDArray[np.float32] | None:
    """Normals of each corner, (T, 3, 3), on the front of its triangle, as Blender wants them."""
    if mesh.normals is None:
        return None
    a, b, c = (mesh.vertices[mesh.triangles[:, i]].astype(np.float64) for i in range(3))
    front, normals = np.cross(b - a, c - a), mesh.normals[mesh.triangles]
    against = inner(normals.astype(np.float64), front[:, None]) < 0.0
    return np.where(against[..., None], -normals, normals)


def _write_arrays(file: IO[bytes], mesh: MeshData, uvs: NDArray[np.float32] | None) -> None:
    """Write a mesh, with texture coordinates for each corner."""
    arrays: dict[str, Any] = {"normals": _corner_normals(mesh), "uvs": uvs}
    given = {name: np.ascontiguousarray(each) for name, each in arrays.items() if each is not None}
    kept: Any = {"points": mesh.vertices.astype(np.float32), "triangles": mesh.triangles.astype(np.int32), **given}
    np.savez(file, **kept)
