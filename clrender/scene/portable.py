"""A scene on its way to another process: JSON, and the meshes and pictures of its files, each named by its hash."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from clrender.errors import SceneError
from clrender.scene.description import Scene
from clrender.scene.mesh_data import MeshData
from clrender.scene.shapes import Mesh
from clrender.scene.texels import TILE_BYTES, StoredPicture, tile_shape
from clrender.scene.textures import BumpMap, ImageTexture, NormalMap, textures_of
from clrender.scene.validation_errors import scene_error
from clrender.scene.wording import place

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
        As a scene file says it; a file stands there as ``sha256:`` and the hash of its content.
    assets : dict of str to bytes
        Meshes and pictures by hash, in NumPy's ``.npz`` format.

    Raises
    ------
    SceneError
        A file cannot be read.
    """
    description = scene.model_dump(mode="json", exclude_none=True, exclude_unset=True)
    assets: dict[str, bytes] = {}
    for index, shape in enumerate(scene.shapes):
        if isinstance(shape, Mesh) and shape.file is not None:
            mesh = scene.mesh(index)
            description["shapes"][index]["file"] = _PREFIX + mesh.sha256()
            if mesh.sha256() not in assets:
                assets[mesh.sha256()] = _packed(mesh)
    store = scene.textures()
    for name, material in scene.materials.items():
        for key, texture in textures_of(material):
            if isinstance(texture, ImageTexture | NormalMap | BumpMap):
                picture = store.picture(texture)
                description["materials"][name][key]["texture"] = _PREFIX + picture.sha256
                if picture.sha256 not in assets:
                    assets[picture.sha256] = _packed_picture(picture, store.tiles_of(picture))
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
            where = f"{source}: shapes[{index}].file"
            if not shape.file.startswith(_PREFIX):
                raise SceneError(f"{where}: names the file {shape.file!r}; here assets are named by their hash")
            meshes[shape.file] = _unpacked(shape.file.removeprefix(_PREFIX), assets, where)
    pictures: dict[str, tuple[StoredPicture, NDArray[np.uint8]]] = {}
    for name, material in scene.materials.items():
        for key, texture in textures_of(material):
            if isinstance(texture, ImageTexture | NormalMap | BumpMap) and texture.texture not in pictures:
                where = f"{source}: {place(('materials', name, key, 'texture'))}"
                if not texture.texture.startswith(_PREFIX):
                    raise SceneError(
                        f"{where}: names the file {texture.texture!r}; here assets are named by their hash"
                    )
                sha256 = texture.texture.removeprefix(_PREFIX)
                pictures[texture.texture] = _unpacked_picture(sha256, assets, where)
    scene = scene.with_meshes(meshes).with_pictures(pictures)
    for picture in pictures:
        if _PREFIX + scene.textures().pictures[picture].sha256 != picture:
            text = f"the asset {picture.removeprefix(_PREFIX)} has another content than its hash says; send it again"
            raise SceneError(f"{source}: {text}")
    return scene


def _packed(mesh: MeshData) -> bytes:
    arrays = {"vertices": mesh.vertices, "triangles": mesh.triangles}
    if mesh.normals is not None:
        arrays["normals"] = mesh.normals
    if mesh.uvs is not None:
        arrays["uvs"] = mesh.uvs
    if mesh.uvs_1 is not None:
        arrays["uvs_1"] = mesh.uvs_1
    data = io.BytesIO()
    np.savez(data, **arrays)  # type: ignore[arg-type]  # the stub takes the names for options
    return data.getvalue()


def _packed_picture(picture: StoredPicture, tiles: NDArray[np.uint8]) -> bytes:
    data = io.BytesIO()
    size = np.array([picture.width, picture.height, picture.channels])
    np.savez(data, size=size, coding=np.array(picture.coding), tiles=tiles)
    return data.getvalue()


def _unpacked_picture(sha256: str, assets: Mapping[str, bytes], place: str) -> tuple[StoredPicture, NDArray[np.uint8]]:
    if sha256 not in assets:
        raise SceneError(f"{place}: the asset {sha256} is missing; send it along")
    try:
        with np.load(io.BytesIO(assets[sha256]), allow_pickle=False) as archive:
            width, height, channels = (int(each) for each in archive["size"])
            tiles = np.ascontiguousarray(archive["tiles"], np.uint8)
            picture = StoredPicture(width, height, channels, str(archive["coding"]), 0, len(tiles), sha256)
            across, down = tile_shape(picture.texel_bits)
            sound = tiles.shape == (-(-width // across) * -(-height // down), TILE_BYTES)
    except Exception as error:  # damaged archives fail in too many ways to list
        raise SceneError(f"{place}: the asset {sha256} cannot be read ({error}); send it again") from None
    if not sound:
        raise SceneError(f"{place}: the asset {sha256} is not as large as it says; send it again")
    return picture, tiles


def _unpacked(sha256: str, assets: Mapping[str, bytes], place: str) -> MeshData:
    if sha256 not in assets:
        raise SceneError(f"{place}: the asset {sha256} is missing; send it along")
    try:
        with np.load(io.BytesIO(assets[sha256]), allow_pickle=False) as archive:
            uvs, uvs_1 = archive.get("uvs"), archive.get("uvs_1")
            mesh = MeshData(archive["vertices"], archive["triangles"], archive.get("normals"), "", uvs, uvs_1)
            same = mesh.sha256() == sha256
    except Exception as error:  # damaged archives fail in too many ways to list
        raise SceneError(f"{place}: the asset {sha256} cannot be read ({error}); send it again") from None
    if not same:
        raise SceneError(f"{place}: the asset {sha256} has another content than its hash says; send it again")
    return mesh
