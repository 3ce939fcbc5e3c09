"""A scene on its way to another process: JSON, and the meshes it read from files, each named by its hash."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from clrender.errors import SceneError
from clrender.scene.description import Scene
from clrender.scene.mesh_data import MeshData
from clrender.scene.shapes import Mesh
from clrender.scene.validation_errors import scene_error

__all__ = ["scene_from_portable", "scene_to_portable"]

_PREFIX: Final = "sha256:"


def scene_to_portable(scene: Scene) -> tuple[dict[str, Any], dict[str, bytes]]:
    """A scene as JSON-able data, and its assets.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    description : dict
        As a scene file says it; a mesh file stands there as ``sha256:`` and the hash of its content.
    assets : dict of str to bytes
        The meshes by hash, in NumPy's ``.npz`` format.

    Raises
    ------
    SceneError
        A mesh file cannot be read.
    """
    description = scene.model_dump(mode="json", exclude_none=True, exclude_unset=True)
    assets: dict[str, bytes] = {}
    for index, shape in enumerate(scene.shapes):
        if isinstance(shape, Mesh) and shape.file is not None:
            mesh = scene.mesh(index)
            description["shapes"][index]["file"] = _PREFIX + mesh.sha256()
            if mesh.sha256() not in assets:
                assets[mesh.sha256()] = _packed(mesh)
    return description, assets


def scene_from_portable(description: Mapping[str, Any], assets: Mapping[str, bytes], source: str = "scene") -> Scene:
    """The scene that `scene_to_portable` described.

    Raises
    ------
    SceneError
        It is no valid scene, an asset is missing, or one is not what its hash says.
    """
    try:
        scene = Scene.model_validate(description)
    except ValidationError as error:
        raise scene_error(error, Scene, source) from None
    meshes: dict[str, MeshData] = {}
    for index, shape in enumerate(scene.shapes):
        if isinstance(shape, Mesh) and shape.file is not None and shape.file not in meshes:
            place = f"{source}: shapes[{index}].file"
            if not shape.file.startswith(_PREFIX):
                raise SceneError(f"{place}: names the file {shape.file!r}; here assets are named by their hash")
            meshes[shape.file] = _unpacked(shape.file.removeprefix(_PREFIX), assets, place)
    return scene.with_meshes(meshes)


def _packed(mesh: MeshData) -> bytes:
    arrays = {"vertices": mesh.vertices, "triangles": mesh.triangles}
    if mesh.normals is not None:
        arrays["normals"] = mesh.normals
    data = io.BytesIO()
    np.savez(data, **arrays)  # type: ignore[arg-type]  # the stub takes the names for options
    return data.getvalue()


def _unpacked(sha256: str, assets: Mapping[str, bytes], place: str) -> MeshData:
    if sha256 not in assets:
        raise SceneError(f"{place}: the asset {sha256} is missing; send it along")
    try:
        with np.load(io.BytesIO(assets[sha256]), allow_pickle=False) as archive:
            mesh = MeshData(archive["vertices"], archive["triangles"], archive.get("normals"))
            same = mesh.sha256() == sha256
    except Exception as error:  # damaged archives fail in too many ways to list
        raise SceneError(f"{place}: the asset {sha256} cannot be read ({error}); send it again") from None
    if not same:
        raise SceneError(f"{place}: the asset {sha256} has another content than its hash says; send it again")
    return mesh
