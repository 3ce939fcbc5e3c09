"""Converts primitives to triangles: lists, strips and fans, with their vertex attributes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.angles import sin_cos_degrees
from clrender.exact.matrices import product
from clrender.importers.gltf.accessors import Accessors
from clrender.importers.gltf.deform import Surface, morphed, skinned
from clrender.importers.gltf.document import Document
from clrender.importers.gltf.materials import Materials, Used
from clrender.importers.gltf.matrices import Matrix
from clrender.importers.shared.meshes import without_area
from clrender.importers.shared.tangents import mikktspace
from clrender.meshes.data import COORDINATE_LIMIT, MeshData, filled
from clrender.meshes.read import UV_LIMIT
from clrender.wording import counted

__all__ = ["Meshes", "Part"]

_MODES: Final = ("points", "lines", "lines", "lines", "triangles", "a strip", "a fan")
_TYPES: Final = {"POSITION": ("VEC3",), "NORMAL": ("VEC3",), "TANGENT": ("VEC4",), "COLOR_0": ("VEC3", "VEC4")}
_TARGET_TYPES: Final = {**_TYPES, "TANGENT": ("VEC3",)}
"""Types of morph targets, which do not change a tangent's handedness."""


@dataclass(frozen=True)
class Part:
    """A primitive converted to a mesh.

    Attributes
    ----------
    mesh : str
        Its name in the draft.
    material : Used
    colored : bool
        Whether its vertices have colours.
    number : int
        Index of the primitive.
    sides : (T,) float64, or None
        Of skinned triangles: below 0 if joints mirror most of their vertices; those have their corners reversed.
    """

    mesh: str
    material: Used
    colored: bool
    number: int = 0
    sides: NDArray[np.float64] | None = None


class Meshes:
    """Converts meshes when a node uses them, each once.

    Parameters
    ----------
    document : Document
    accessors : Accessors
    materials : Materials
    """

    def __init__(self, document: Document, accessors: Accessors, materials: Materials) -> None:
        self._document, self._accessors, self._materials = document, accessors, materials
        self._made: dict[tuple[Any, ...], Part | None] = {}

    def parts(
        self, index: int, weights: list[float], joints: list[Matrix] | None, node: int, *, deforms: bool = False
    ) -> list[Part]:
        """The meshes of a mesh's primitives.

        Parameters
        ----------
        index : int
            Index of the mesh.
        weights : list of float
            Weights of its morph targets.
        joints : list of Matrix, optional
            Joint transforms of the node's skin; the meshes are then in world space.
        node : int
            Index of the node that has the mesh.
        deforms : bool
            Whether it has other forms, so that it may be without area in this one.

        Raises
        ------
        SceneError
            A primitive is invalid.
        """
        found: list[Part] = []
        for number, primitive in enumerate(self._document.items("meshes")[index]["primitives"]):
            own: tuple[Any, ...] = (node,) if joints else tuple(weights) if any(weights) else ()
            key = (index, number, deforms, *own)
            if key not in self._made:
                name = at = f"/meshes/{index}/primitives/{number}"
                if own:
                    name += f" of /nodes/{node}"
                self._made[key] = self._part(primitive, at, name, number, weights, joints, deforms)
            part = self._made[key]
            if part is not None:
                found.append(part)
        return found

    def posed(
        self, index: int, parts: list[Part], weights: list[float], joints: list[Matrix] | None, name: str
    ) -> list[str] | None:
        """The names of these parts' meshes with other weights and joints.

        Parameters
        ----------
        index, weights, joints
            See `parts`.
        parts : list of Part
            Made of the same mesh.
        name : str
            What their names end with.

        Returns
        -------
        list of str, or None
            None if joints mirror what they did not mirror before, or the other way round: triangles would turn over.
        """
        made: dict[str, MeshData] = {}
        for part in parts:
            at = f"/meshes/{index}/primitives/{part.number}"
            primitive = self._document.items("meshes")[index]["primitives"][part.number]
            surface = self._surface(primitive, at, weights, joints)
            positions, _ = self._positions(surface, at)
            triangles = self._document.draft.meshes[part.mesh].triangles
            sides = _sides(surface, triangles)
            if sides is not None and part.sides is not None and (sides * part.sides < 0.0).any():
                return None
            tangents = self._corner_tangents(primitive, part.material, surface, triangles, weights)
            made[f"{at}{name}"] = MeshData(positions, triangles, surface.normals, tangents=tangents)
        self._document.draft.meshes |= made
        return list(made)

    def _part(
        self,
        primitive: dict[str, Any],
        at: str,
        name: str,
        number: int,
        weights: list[float],
        joints: list[Matrix] | None,
        deforms: bool,
    ) -> Part | None:
        mode = primitive.get("mode", 4)
        if mode < 4:
            self._document.note(f"{at} was left out: it consists of {_MODES[mode]}, and only triangles are drawn")
            return None
        if "POSITION" not in primitive["attributes"]:
            self._document.note(f"{at} was left out: it has no POSITION")
            return None
        self._check(primitive, at)
        self._note_handedness(primitive, at)
        surface = self._surface(primitive, at, weights, joints)
        positions, gaps = self._positions(surface, at)
        triangles = self._triangles(primitive, mode, len(positions), at)
        if triangles is not None and gaps is not None:
            text = f"has a number in element {int(np.argmax(gaps))} that is not finite; export it again"
            self._document.leave_out(f"{at}/attributes/POSITION", text)
            triangles = triangles[~gaps[triangles].any(axis=1)]
        if triangles is None or not len(triangles) or (without_area(positions, triangles) and not deforms):
            self._document.note(f"{at} was left out: it has no triangle with an area")
            return None
        sides = _sides(surface, triangles)
        if sides is not None and (sides < 0.0).any():
            # Fronts stay fronts where joints mirror
            triangles = np.where((sides < 0.0)[:, None], triangles[:, ::-1], triangles)
        material = self._materials.of(primitive)
        colors = self._colors(primitive, material, triangles, at, weights)
        first, second = (self._uvs(primitive, each, material, triangles, at, weights) for each in (0, 1))
        mesh = MeshData(positions, triangles, surface.normals, "", first, second, colors)
        tangents = self._corner_tangents(primitive, material, surface, triangles, weights)
        if tangents is None and "anisotropy" in self._document.draft.description["materials"][material.name]:
            text = "has no normals or no texture coordinates, from which tangents would follow"
            self._document.note(f"{at} {text}: its anisotropy lies along the direction around the y axis")
        self._document.draft.meshes[name] = replace(mesh, tangents=tangents)
        return Part(name, material, colors is not None, number, sides)

    def _surface(
        self, primitive: dict[str, Any], at: str, weights: list[float], joints: list[Matrix] | None
    ) -> Surface:
        """Positions, normals, and the tangents that are used together with normals."""
        positions, normals, tangents = (
            morphed(self._accessors, primitive, weights, key) for key in ("POSITION", "NORMAL", "TANGENT")
        )
        assert positions is not None
        surface = Surface(positions, normals, None if normals is None else tangents)
        if joints is None:
            return surface
        return skinned(self._document, self._accessors, primitive, at, joints, surface)

    def _positions(self, surface: Surface, at: str) -> tuple[NDArray[np.float32], NDArray[np.bool_] | None]:
        """Positions with zeros where they are not finite, and which are not."""
        positions, gaps = filled(surface.positions)
        if not np.abs(positions).max() <= COORDINATE_LIMIT:
            raise self._document.fault(
                f"{at}/attributes/POSITION", f"goes beyond {COORDINATE_LIMIT:g}; make it smaller"
            )
        return positions, gaps

    def _note_handedness(self, primitive: dict[str, Any], at: str) -> None:
        attributes = primitive["attributes"]
        if "TANGENT" in attributes and "NORMAL" in attributes:
            tangents = self._accessors.floats(attributes["TANGENT"])
            if (np.abs(tangents[:, 3]) != 1.0).any():
                self._document.note(f"{at}/attributes/TANGENT has a w that is neither 1 nor -1; its sign counts")

    def _corner_tangents(
        self,
        primitive: dict[str, Any],
        material: Used,
        surface: Surface,
        triangles: NDArray[np.uint32],
        weights: list[float],
    ) -> NDArray[np.float32] | None:
        """Tangents of corners, if the material needs them: the file's, or else those of MikkTSpace.

        Without normals, triangles are flat and derive their tangents from texture coordinates.
        """
        if material.tangent_uv_set is None or surface.normals is None:
            return None
        if surface.tangents is not None:
            return surface.tangents[triangles]
        uvs = morphed(self._accessors, primitive, weights, f"TEXCOORD_{material.tangent_uv_set}")
        if uvs is None:
            return None
        upward = np.stack([uvs[:, 0], np.float32(1.0) - uvs[:, 1]], axis=1)
        transform = material.tangent_transform
        if transform.rotate_degrees or min(transform.scale) < 0.0:
            sine, cosine = sin_cos_degrees(transform.rotate_degrees)
            turn = np.array([[cosine, -sine], [sine, cosine]]) * transform.scale
            upward = product(upward, turn.T).astype(np.float32)
        return mikktspace(surface.positions, surface.normals, upward, triangles)

    def _check(self, primitive: dict[str, Any], at: str) -> None:
        """Check that attributes have the right types and as many elements as there are vertices."""
        accessors = self._document.items("accessors")
        count = accessors[primitive["attributes"]["POSITION"]]["count"]
        groups = [(primitive["attributes"], f"{at}/attributes", _TYPES)]
        groups += [(each, f"{at}/targets/{i}", _TARGET_TYPES) for i, each in enumerate(primitive.get("targets", []))]
        for attributes, place, types in groups:
            for key, number in attributes.items():
                kind = accessors[number].get("type")
                wanted = types.get(key) or (("VEC2",) if key.startswith("TEXCOORD_") else None)
                if wanted and kind not in wanted:
                    raise self._document.fault(
                        f"{place}/{key}", f"is of type {kind}, but must be {' or '.join(wanted)}"
                    )
                if accessors[number]["count"] != count:
                    text = (
                        f"has {counted(accessors[number]['count'], 'element')}, but the mesh has "
                        f"{counted(count, 'vertex', 'vertices')}; export it again"
                    )
                    raise self._document.fault(f"{place}/{key}", text)

    def _triangles(self, primitive: dict[str, Any], mode: int, count: int, at: str) -> NDArray[np.uint32] | None:
        """Corners of the triangles; None if there are none."""
        if "indices" in primitive:
            accessor = self._document.items("accessors")[primitive["indices"]]
            if accessor.get("type") != "SCALAR" or accessor["componentType"] not in (5121, 5123, 5125):
                raise self._document.fault(f"{at}/indices", "must name whole numbers without sign; export it again")
            order = self._accessors.raw(primitive["indices"]).astype(np.uint32, copy=False)
            if int(order.max()) >= count:
                text = (
                    f"hold {int(order.max())}, but the mesh has only {counted(count, 'vertex', 'vertices')}; "
                    "export it again"
                )
                if mode != 4:
                    raise self._document.fault(f"{at}/indices", text)
                self._document.leave_out(f"{at}/indices", text)
                whole = order[: len(order) - len(order) % 3].reshape(-1, 3)
                order = whole[(whole < count).all(axis=1)].reshape(-1)
        else:
            order = np.arange(count, dtype=np.uint32)
        if mode == 4:
            if rest := len(order) % 3:
                self._document.note(
                    f"{at}: the last {rest} of {len(order)} corners were left out: they make no triangle"
                )
            order = order[: len(order) - rest]
            return order.reshape(-1, 3) if len(order) else None
        if len(order) < 3:
            return None
        if mode == 6:
            first = np.full(len(order) - 2, order[0])
            return np.stack([order[1:-1], order[2:], first], axis=1)
        strip = np.stack([order[:-2], order[1:-1], order[2:]], axis=1)
        strip[1::2, 1:] = strip[1::2, :0:-1]
        return strip

    def _uvs(
        self,
        primitive: dict[str, Any],
        number: int,
        material: Used,
        triangles: NDArray[np.uint32],
        at: str,
        weights: list[float],
    ) -> NDArray[np.float32] | None:
        """Texture coordinates of corners, with (0, 0) in the lower left, if the material needs them."""
        if number not in material.uv_sets:
            return None
        key = f"TEXCOORD_{number}"
        uvs = morphed(self._accessors, primitive, weights, key)
        if uvs is None:
            self._document.note(f"{at} has no {key}, which {material.place} needs: its textures show one place there")
            return np.zeros((len(triangles), 3, 2), np.float32)
        if not np.abs(uvs).max() <= UV_LIMIT:
            raise self._document.fault(f"{at}/attributes/{key}", f"goes beyond {UV_LIMIT:g}; make it smaller")
        corners: NDArray[np.float32] = uvs[triangles]
        np.subtract(np.float32(1.0), corners[..., 1], out=corners[..., 1])
        return corners

    def _colors(
        self,
        primitive: dict[str, Any],
        material: Used,
        triangles: NDArray[np.uint32],
        at: str,
        weights: list[float],
    ) -> NDArray[np.float32] | None:
        colors = morphed(self._accessors, primitive, weights, "COLOR_0")
        if colors is None:
            return None
        if not material.colored:
            self._document.note(f"{at}/attributes/COLOR_0 was left out: {material.place} is unlit")
            return None
        if material.transparent and colors.shape[1] == 4 and float(colors[:, 3].min()) < 1.0:
            self._document.note(f"{at}/attributes/COLOR_0: its alpha was left out")
        linear = colors[:, :3]
        if float(linear.min()) < 0.0 or float(linear.max()) > 1.0:
            self._document.note(f"{at}/attributes/COLOR_0 goes beyond 0 to 1, where it was cut off")
            linear = np.clip(linear, 0.0, 1.0)
        corners: NDArray[np.float32] = np.ascontiguousarray(linear)[triangles]
        return corners


def _sides(surface: Surface, triangles: NDArray[np.uint32]) -> NDArray[np.float64] | None:
    """Sums of the sides of triangles' vertices, (T,); None of what has no skin."""
    return None if surface.sides is None else np.asarray(surface.sides[triangles].sum(axis=1))
