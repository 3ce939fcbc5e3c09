"""Instances of a node's mesh (EXT_mesh_gpu_instancing): all transforms of a node at once, in NumPy.

Uses the operations of `clrender.importers.gltf.matrices` in the same order, for the same bits.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.importers.gltf.accessors import Accessors
from clrender.importers.gltf.document import Document
from clrender.importers.gltf.matrices import Matrix
from clrender.importers.gltf.nodes import TRS

__all__ = ["flattening", "instance_maps", "placed"]

_Array = NDArray[np.float64]
_WIDTHS: Final = {"VEC3": 3, "VEC4": 4}


def instance_maps(document: Document, accessors: Accessors, index: int) -> _Array | None:
    """Transforms of the instances of a node's mesh, within the node.

    Returns
    -------
    maps : (n, 3, 4) float64
        None if the node has no instances.

    Raises
    ------
    SceneError
        Their counts differ, or their types are invalid.
    """
    instancing = document.extension(document.items("nodes")[index], "EXT_mesh_gpu_instancing")
    if instancing is None:
        return None
    at = f"/nodes/{index}/extensions/EXT_mesh_gpu_instancing/attributes"
    columns: dict[str, _Array] = {}
    for key, number in instancing["attributes"].items():
        path = key.lower()
        if path not in TRS:
            document.note(f"{at}/{key[:40]} was left out: instances have translation, rotation and scale only")
            continue
        kind: Any = document.items("accessors")[number].get("type")
        if _WIDTHS.get(kind) != len(TRS[path]):
            raise document.fault(f"{at}/{key}", f"is of type {kind}, which no {path} is; export it again")
        columns[path] = accessors.floats(number).astype(np.float64)
    counts = {len(column) for column in columns.values()}
    if len(counts) != 1:
        raise document.fault(at, "do not have the same number of instances; export it again")
    count = counts.pop()
    moves, turns, sizes = (
        columns[key] if key in columns else np.broadcast_to(np.array(default), (count, len(default)))
        for key, default in TRS.items()
    )
    return _composed(moves, turns, sizes)


def _composed(moves: _Array, turns: _Array, sizes: _Array) -> _Array:
    """Scale, then rotation by quaternions (x, y, z, w) of any length, then translation; (n, 3, 4)."""
    x, y, z, w = turns.T
    length = np.sqrt(x * x + y * y + z * z + w * w)
    length[length == 0.0] = 1.0
    x, y, z, w = x / length, y / length, z / length, w / length
    turn = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)),
        (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)),
        (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)),
    )
    maps = np.empty((len(moves), 3, 4))
    for i, row in enumerate(turn):
        for j, entry in enumerate(row):
            np.multiply(entry, sizes[:, j], out=maps[:, i, j])
        maps[:, i, 3] = moves[:, i]
    return maps


def placed(world: Matrix, maps: _Array) -> _Array:
    """Composition of each of the `maps`, (n, 3, 4), then `world`; (n, 3, 4)."""
    product = np.empty_like(maps)
    for i, (p, q, r, s) in enumerate(world[:3]):
        product[:, i] = p * maps[:, 0] + q * maps[:, 1] + r * maps[:, 2]
        product[:, i, 3] += s
    return product


def flattening(maps: _Array) -> NDArray[np.bool_]:
    """Which of the maps, (n, 3, 4), are singular, by the criterion of `clrender.scene.Transform`; (n,) bool."""
    a, b, c = maps[:, 0, :3].T, maps[:, 1, :3].T, maps[:, 2, :3].T
    volume = np.abs(
        a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
    lengths = [np.sqrt(row[0] * row[0] + row[1] * row[1] + row[2] * row[2]) for row in (a, b, c)]
    flat: NDArray[np.bool_] = volume <= 1e-12 * lengths[0] * lengths[1] * lengths[2]
    return flat
