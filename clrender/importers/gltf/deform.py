"""Morph targets and skins: deforms vertices for the rest pose, or a moment of an animation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.importers.gltf.accessors import Accessors
from clrender.importers.gltf.document import Document
from clrender.importers.gltf.matrices import Matrix, from_columns, product

__all__ = ["Surface", "joint_transforms", "morphed", "skinned"]

_Points = NDArray[np.float32]
_ROUNDED: Final = 1e-4
"""Largest difference of a last row from 0, 0, 0, 1 that is taken for an error of rounding."""


@dataclass(frozen=True)
class Surface:
    """The vertex attributes of a primitive that deform.

    Attributes
    ----------
    positions : (V, 3) float32
    normals : (V, 3) float32, or None
    tangents : (V, 4) float32, or None
        Direction and handedness.
    sides : (V,) float64, or None
        Of skinned vertices: -1 where their joints mirror, else 1, or 0 where they flatten.
    """

    positions: _Points
    normals: _Points | None = None
    tangents: _Points | None = None
    sides: NDArray[np.float64] | None = None


@np.errstate(over="ignore", invalid="ignore")  # mesh validation reports non-finite values
def morphed(
    accessors: Accessors, primitive: dict[str, Any], weights: list[float], key: str
) -> NDArray[np.float32] | None:
    """A vertex attribute with what its primitive's morph targets add to it; None if the primitive lacks it.

    Parameters
    ----------
    accessors : Accessors
    primitive : dict
    weights : list of float
        Weights of its targets; missing ones are 0.
    key : str
        Name of the attribute.

    Returns
    -------
    (V, n) float32, or None
    """
    if key not in primitive["attributes"]:
        return None
    values = accessors.floats(primitive["attributes"][key])
    for target, weight in zip(primitive.get("targets", []), weights, strict=False):
        if weight != 0.0 and key in target:
            more = accessors.floats(target[key])
            shared = min(values.shape[1], more.shape[1])  # a target changes no handedness, and perhaps no alpha
            moved = values[:, :shared] + np.float32(weight) * more[:, :shared]
            values = np.concatenate([moved, values[:, shared:]], axis=1)
    return values


def joint_transforms(document: Document, accessors: Accessors, index: int, joints: list[Matrix]) -> list[Matrix]:
    """Transforms of a skin's joints, from the bind pose to world space.

    Parameters
    ----------
    document, accessors
    index : int
        Index of the skin.
    joints : list of Matrix
        World transforms of its joints.

    Raises
    ------
    SceneError
        The inverse bind matrices are invalid.
    """
    skin, at = document.items("skins")[index], f"/skins/{index}/inverseBindMatrices"
    number = skin.get("inverseBindMatrices")
    if number is None:
        return joints
    accessor = document.items("accessors")[number]
    if accessor.get("type") != "MAT4" or accessor["componentType"] != 5126 or accessor["count"] < len(joints):
        raise document.fault(at, f"must name {len(joints)} matrices (MAT4) of floats; export it again")
    inverse = accessors.raw(number)[: len(joints)].astype(np.float64)
    off = float(np.abs(inverse[:, 3] - (0.0, 0.0, 0.0, 1.0)).max())
    if off > 0.0:
        text = "holds a matrix whose last row is not 0, 0, 0, 1; export it again"
        if not off <= _ROUNDED:
            raise document.fault(at, text)
        document.forgive(at, text)
        inverse[:, 3] = 0.0, 0.0, 0.0, 1.0
    columns = inverse.transpose(0, 2, 1).reshape(len(joints), 16).tolist()
    return [product(joint, from_columns(each)) for joint, each in zip(joints, columns, strict=True)]


@np.errstate(over="ignore", invalid="ignore")  # mesh validation reports non-finite values
def skinned(
    document: Document,
    accessors: Accessors,
    primitive: dict[str, Any],
    at: str,
    joints: list[Matrix],
    surface: Surface,
) -> Surface:
    """A surface skinned to world space: each vertex is transformed by the weighted sum of its joints' transforms.

    Parameters
    ----------
    document, accessors, primitive
    at : str
        JSON pointer of the primitive.
    joints : list of Matrix
        See `joint_transforms`.
    surface : Surface

    Raises
    ------
    SceneError
        Vertices refer to joints that the skin lacks.
    """
    positions, normals, tangents = surface.positions, surface.normals, surface.tangents
    table = np.array(joints)[:, :3]
    blended = np.zeros((len(positions), 3, 4))
    total = np.zeros(len(positions))
    for set_ in range(64):
        names = f"JOINTS_{set_}", f"WEIGHTS_{set_}"
        if not all(name in primitive["attributes"] for name in names):
            break
        which, weights = (primitive["attributes"][name] for name in names)
        for name, number, whole in ((names[0], which, True), (names[1], weights, False)):
            accessor = document.items("accessors")[number]
            sound = accessor["componentType"] in ((5121, 5123) if whole else (5121, 5123, 5126))
            if accessor.get("type") != "VEC4" or not sound:
                raise document.fault(
                    f"{at}/attributes/{name}", "must be VEC4 of the types that the specification names"
                )
        numbers = accessors.raw(which)
        if int(numbers.max()) >= len(joints):
            text = f"names joint {int(numbers.max())}, but the skin has {len(joints)}; export it again"
            raise document.fault(f"{at}/attributes/{names[0]}", text)
        shares = accessors.floats(weights).astype(np.float64)
        for corner in range(4):
            blended += shares[:, corner, None, None] * table[numbers[:, corner]]
            total += shares[:, corner]
    if not total.any():
        document.note(f"{at} has a skin, but no JOINTS_0 and WEIGHTS_0: it moves with the skin's first joint")
        blended[:], total[:] = table[0], 1.0
    blended /= np.where(np.abs(total) > 1e-6, total, 1.0)[:, None, None]
    linear, offset = blended[:, :, :3], blended[:, :, 3]
    placed = (linear * positions[:, None, :]).sum(axis=2) + offset
    if tangents is not None:
        carried = (linear * tangents[:, None, :3]).sum(axis=2)
        tangents = np.concatenate([carried, tangents[:, 3:]], axis=1, dtype=np.float32)
    # Cofactors transform normals like the inverse transpose; mirroring flips them
    a, b, c = linear[:, 0], linear[:, 1], linear[:, 2]
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    sides = np.sign((a * cofactors[:, 0]).sum(axis=1))
    if normals is not None:
        normals = (sides[:, None] * (cofactors * normals[:, None, :]).sum(axis=2)).astype(np.float32)
        if tangents is not None:
            tangents[:, 3] *= np.where(sides < 0.0, np.float32(-1.0), np.float32(1.0))
    return Surface(placed.astype(np.float32), normals, tangents, sides)
