"""Texture coordinates, colours and tangents of the primitives of textured shapes.

Those of meshes come from their files; other shapes have their own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.errors import SceneError
from clrender.exact.matrices import product
from clrender.flatten.measured import is_anisotropic
from clrender.flatten.plugin_rows import needs_uvs
from clrender.meshes.data import MeshData
from clrender.scene.description import Scene
from clrender.scene.materials import Material, Measured, PluginMaterial, material_parts, material_textures
from clrender.scene.shapes import Box, Curves, Disk, Mesh, Quad, Shape, Sphere
from clrender.scene.textures import Checker, ImageTexture, MaterialTexture, NormalMap, Ramp
from clrender.scene.transforms import Affine
from clrender.scene.values import Vector, cross, length
from clrender.wording import place, quoted

__all__ = [
    "COLORS",
    "TANGENTS",
    "add_corner_rows",
    "corner_uvs",
    "curve_attributes",
    "has_tangents",
    "is_textured",
    "round_attributes",
    "triangle_attributes",
    "triangle_colors",
    "triangle_tangents",
]

_COLUMNS: Final = {name: first for name, first, _, _ in layout.ROWS["ATTRIBUTE"]}
COLORS: Final = _COLUMNS["COLORS"]
TANGENTS: Final = _COLUMNS["TANGENTS"]
_SLOTS: Final = _COLUMNS["SLOTS"]
_BOX_NORMALS: tuple[Vector, ...] = ((-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1))
"""Normals of a box's faces, in the order of `geometry.polyhedron`; two triangles per face."""


def is_textured(scene: Scene, index: int) -> bool:
    """Whether a shape has textured emission, a textured material, or vertex colours or tangents that are used."""
    shape = scene.plain_shapes[index]
    if any(True for _ in _textures(scene, shape)):
        return True
    return isinstance(shape, Mesh) and (bool(shape.color_key) or has_tangents(scene, index))


def has_tangents(scene: Scene, index: int) -> bool:
    """Whether a shape's vertex tangents are used: by a normal map or an anisotropic material."""
    shape = scene.shapes[index]
    if not isinstance(shape, Mesh) or shape.material is None:
        return False
    asked = any(_is_turned(scene, part) for part in material_parts(scene.materials, shape.material))
    asked = asked or any(isinstance(texture, NormalMap) for _, texture in _textures(scene, shape))
    return asked and scene.mesh(index).tangents is not None


def _is_turned(scene: Scene, material: Material) -> bool:
    """Whether a material is not the same in all directions around the normal."""
    if isinstance(material, PluginMaterial):
        return any(each.name == material.plugin and "tangents" in each.header.needs for each in scene.plugins)
    if isinstance(material, Measured):
        return is_anisotropic(scene, material)
    return bool(getattr(material, "anisotropy", 0.0) != 0.0)


def _textures(scene: Scene, shape: Shape) -> Iterator[tuple[str, MaterialTexture]]:
    """Textures of a shape, each with a description of what uses it."""
    if isinstance(shape.emission, ImageTexture | Checker | Ramp):
        yield "its emission", shape.emission
    if shape.material is not None:
        for key, texture in material_textures(scene.materials, shape.material):
            yield f"{key} of the material {quoted(shape.material)}", texture


def triangle_attributes(
    scene: Scene, index: int, mesh: MeshData, kept: NDArray[np.bool_] | None, flipped: bool
) -> NDArray[np.float32]:
    """Attributes (ATTRIBUTE_ROW_* of kernels/types.h) of the triangles of a textured shape.

    Parameters
    ----------
    scene : Scene
    index : int
        Index of the shape.
    mesh : MeshData
        Its triangles.
    kept : (T,) bool, optional
        Which triangles the scene keeps; default: all.
    flipped : bool
        Whether the scene reverses the order of their corners.

    Returns
    -------
    (kept triangles, 16) float32

    Raises
    ------
    SceneError
        A texture needs texture coordinates that the mesh lacks.
    """
    shape = scene.plain_shapes[index]
    sets = (corner_uvs(shape, mesh), mesh.uvs_1)
    for user, texture in _textures(scene, shape):
        if sets[texture.uv_set] is None and needs_uvs(scene, texture):
            which = "texture coordinates" if texture.uv_set == 0 else "second set of texture coordinates (uvs_1)"
            text = f"has no {which}, which {user} needs"
            raise SceneError(f"{scene.source}: {place(scene.place_of(index))} {text}; export the mesh with them")
    rows = np.zeros((len(mesh.triangles), 16), np.float32)
    for first, uvs in ((0, sets[0]), (6, sets[1])):
        if uvs is not None:
            rows[:, first : first + 6] = (uvs[:, ::-1] if flipped else uvs).reshape(-1, 6)
    rows[:, _SLOTS] = _slots(scene, shape)
    return rows if kept is None else rows[kept]


def triangle_colors(mesh: MeshData, kept: NDArray[np.bool_] | None, flipped: bool) -> NDArray[np.float32] | None:
    """Vertex colours of the same triangles, (kept triangles, 16) float32; None if the mesh has none."""
    if mesh.colors is None:
        return None
    rows = np.zeros((len(mesh.triangles), 16), np.float32)
    rows[:, :9] = (mesh.colors[:, ::-1] if flipped else mesh.colors).reshape(-1, 9)
    return rows if kept is None else rows[kept]


def triangle_tangents(
    tangents: NDArray[np.float32],
    transform: Affine,
    kept: NDArray[np.bool_] | None,
    flipped: bool,
    turned: NDArray[np.bool_] | None,
) -> NDArray[np.float32]:
    """Tangents (TANGENT_ROW_* of kernels/types.h) of the same triangles.

    Parameters
    ----------
    tangents : (T, 3, 4) float32
        Tangents of the mesh.
    kept, flipped
        See `triangle_attributes`.
    transform : Affine
        Transform from the mesh's space to world space.
    turned : (kept triangles,) bool, optional
        Triangles whose normals the kernels flip.

    Returns
    -------
    (kept triangles, 16) float32
    """
    given = tangents if kept is None else tangents[kept]
    given = given[:, ::-1] if flipped else given
    rows = np.zeros((len(given), 16), np.float32)
    placed = np.empty((3 * len(given), 3), np.float32)
    transform.directions_into(given[:, :, :3].reshape(-1, 3), placed)
    rows[:, :9] = placed.reshape(-1, 9)
    w = given[:, :, 3].astype(np.float64)
    against = ((w[:, 0] + w[:, 1]) + w[:, 2] < 0.0) != flipped
    rows[:, 9] = np.where(against if turned is None else against != turned, -1.0, 1.0)
    return rows


def add_corner_rows(
    attributes: NDArray[np.float32], column: int, rows_of: Mapping[int, NDArray[np.float32]]
) -> NDArray[np.float32]:
    """Append rows to the attributes of all primitives, and write their indices into those of the triangles.

    Parameters
    ----------
    attributes : (P, 16) float32
    column : int
        Column of the attributes that holds the index of a triangle's appended row: `COLORS` or `TANGENTS`.
    rows_of : mapping of int to (n, 16) float32
        Rows to append, by the index of their first triangle.
    """
    end = len(attributes)
    for first, rows in rows_of.items():
        numbers = np.arange(end, end + len(rows), dtype=np.uint32)
        attributes[first : first + len(rows), column] = numbers.view(np.float32)
        end += len(rows)
    return np.concatenate([attributes, *rows_of.values()]) if rows_of else attributes


def round_attributes(scene: Scene, shape: Sphere | Disk, transform: Affine) -> NDArray[np.float32]:
    """Attributes of a sphere or disk, (16,) float32: its axes in world space, of unit length.

    The longitude of a sphere grows from the half circle towards -z to the right, seen from outside; the latitude grows
    from -y to y. A disk is inscribed in the unit square of texture coordinates; v grows along y.
    """
    x, y, z = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    if isinstance(shape, Disk):
        z = tuple(n / length(shape.normal) for n in shape.normal)  # type: ignore[assignment]
        x, y = face_axes(z)
    row = np.zeros(16, np.float32)
    for first, axis in ((0, x), (3, y), (6, z)):
        image = [sum(a * b for a, b in zip(line, axis, strict=True)) for line in transform.linear]
        row[first : first + 3] = np.array(image) / transform.scale
    row[_SLOTS] = _slots(scene, shape)
    return row


def curve_attributes(scene: Scene, shape: Curves, along: NDArray[np.float32]) -> NDArray[np.float32]:
    """Attributes of curves, (R, 16) float32: u is 0 at the root of a strand and 1 at its tip, v is 1/2.

    They are those of a triangle, whose weight of B is where a point is along its curve, and whose weight of C is 1/2.

    Parameters
    ----------
    scene : Scene
    shape : Curves
    along : (R, 2) float32
        See `clrender.flatten.curves.FlatCurves`.
    """
    rows = np.zeros((len(along), 16), np.float32)
    for first in (0, 6):
        rows[:, first], rows[:, first + 2], rows[:, first + 4], rows[:, first + 5] = *along.T, along[:, 0], 1.0
    rows[:, _SLOTS] = _slots(scene, shape)
    return rows


def face_axes(normal: Vector) -> tuple[Vector, Vector]:
    """Directions of u and v on a face with a unit normal, seen from outside: v along y, and on top along -z."""
    upward: Vector = (0.0, 1.0, 0.0)
    if abs(normal[1]) > 0.999:
        upward = (0.0, 0.0, -1.0 if normal[1] > 0.0 else 1.0)
    u = cross(upward, normal)
    u = tuple(a / length(u) for a in u)  # type: ignore[assignment]
    return u, cross(normal, u)


def corner_uvs(shape: Shape, mesh: MeshData) -> NDArray[np.float32] | None:
    """Texture coordinates of the corners of a shape's triangles, (T, 3, 2) float32; None where a mesh has none."""
    if isinstance(shape, Mesh):
        return mesh.uvs
    if isinstance(shape, Quad):
        return np.array([[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]], np.float32)
    if isinstance(shape, Box):
        places = (mesh.vertices[mesh.triangles] - np.array(shape.center)) / np.array(shape.size)
        axes = np.repeat(np.array([face_axes(normal) for normal in _BOX_NORMALS]), 2, axis=0)
        return np.asarray(0.5 + product(places, axes.transpose(0, 2, 1)), np.float32)
    return np.tile(np.array([(0, 0), (1, 0), (0, 1)], np.float32), (len(mesh.triangles), 1, 1))


def _slots(scene: Scene, shape: Shape) -> np.float32:
    """Index of the material, as the bits of a float; without a material, one past the last."""
    numbers: Mapping[str | None, int] = {name: number for number, name in enumerate([*scene.materials, None])}
    return np.float32(np.uint32(numbers[shape.material]).view(np.float32))
