"""Serialises a scene for another process: JSON, and the contents of its files, named by their hashes."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from clrender.curves import CurveData
from clrender.curves.read import COLUMNS
from clrender.errors import SceneError
from clrender.grids import GridData
from clrender.image.texel_tiles import TILE_BYTES, StoredPicture, picture_sha256, tile_shape
from clrender.measured import MeasuredFile
from clrender.meshes.data import CORNER_ARRAYS, MeshData
from clrender.meshes.vertex_colors import VertexColors
from clrender.scene.content_hash import put_at
from clrender.scene.description import Scene
from clrender.scene.environment import EnvironmentPicture
from clrender.scene.frozen import frozen
from clrender.scene.groups import TransformArray
from clrender.scene.ies import IesProfile
from clrender.scene.validation_errors import scene_error
from clrender.wording import place as place_in_file

__all__ = ["scene_from_portable", "scene_to_portable"]

_PREFIX: Final = "sha256:"
_Asset = TypeVar(
    "_Asset",
    CurveData,
    GridData,
    MeasuredFile,
    MeshData,
    EnvironmentPicture,
    IesProfile,
    TransformArray,
    "_TexturePicture",
)


def scene_to_portable(scene: Scene) -> tuple[dict[str, Any], dict[str, bytes]]:
    """A scene as JSON-able data, and its assets.

    Returns
    -------
    description : dict
        Like a scene file, with file names replaced by ``sha256:`` and the hash of the content.
    assets : dict of str to bytes
        Meshes, images and IES profiles by hash, in NumPy's ``.npz`` format.

    Raises
    ------
    SceneError
        A file cannot be read.
    """
    description = scene.model_dump(mode="json", exclude_none=True, exclude_unset=True)
    assets: dict[str, bytes] = {}
    for at, shape in scene.mesh_files():
        mesh = scene.mesh_of(at, shape)
        put_at(description, (*at, "file"), _PREFIX + mesh.sha256())
        if mesh.sha256() not in assets:
            assets[mesh.sha256()] = _packed(mesh)
    for index, instance in scene.instances():
        if instance.file is not None:
            array = scene.transforms(index)
            description["shapes"][index]["transforms"] = _PREFIX + array.sha256()
            assets[array.sha256()] = _zipped(maps=array.maps)
    store = scene.textures()
    for at, texture in scene.texture_files():
        stored = store.picture(texture)
        put_at(description, at, _PREFIX + stored.sha256)
        if stored.sha256 not in assets:
            assets[stored.sha256] = _packed_texture(stored, store.tiles_of(stored))
    for index, _ in scene.pictured_lights():
        picture = scene.light_picture(index)
        description["lights"][index]["file"] = _PREFIX + picture.sha256()
        assets[picture.sha256()] = _zipped(pixels=picture.pixels)
    for index, _ in scene.ies_lights():
        profile = scene.ies_profile(index)
        description["lights"][index]["file"] = _PREFIX + profile.sha256()
        names = ("vertical", "horizontal", "candela", "tilt")
        assets[profile.sha256()] = _zipped(**{name: getattr(profile, name) for name in names})
    for (_, name, key), grid in scene.grids():
        data = scene.grid(name, key, grid)
        description["media"][name][key].pop("name", None)
        put_at(description, ("media", name, key, "file"), _PREFIX + data.sha256())
        if data.sha256() not in assets:
            assets[data.sha256()] = _zipped(values=data.values, placement=data.placement)
    for at, curves in scene.curve_files():
        strands = scene.strands(at, curves)
        put_at(description, (*at, "file"), _PREFIX + strands.sha256())
        if strands.sha256() not in assets:
            assets[strands.sha256()] = _packed_curves(strands)
    for name, material in scene.measured_materials():
        measured = scene.measured(name, material)
        put_at(description, ("materials", name, "file"), _PREFIX + measured.sha256())
        if measured.sha256() not in assets:
            assets[measured.sha256()] = _zipped(content=measured.content)
    return description, assets


def scene_from_portable(description: Mapping[str, Any], assets: Mapping[str, bytes], source: str = "scene") -> Scene:
    """The scene that `scene_to_portable` serialised.

    Raises
    ------
    SceneError
        It is not a valid scene, an asset is missing, or one does not match its hash.
    """
    try:
        scene = Scene.model_validate(description)
    except ValidationError as error:
        raise scene_error(error, Scene, source) from None
    meshes: dict[tuple[str, VertexColors | None], MeshData] = {}
    for at, shape in scene.mesh_files():
        if shape.asset not in meshes:
            assert shape.file is not None
            place = f"{source}: {place_in_file((*at, 'file'))}"
            meshes[shape.asset] = _unpacked(_hash_in(shape.file, place), assets, place)
    textures: dict[str, tuple[StoredPicture, NDArray[np.uint8]]] = {}
    for at, texture in scene.texture_files():
        if texture.texture not in textures:
            place = f"{source}: {place_in_file(at)}"
            unpacked = _unpacked_texture(_hash_in(texture.texture, place), assets, place)
            textures[texture.texture] = unpacked.picture, unpacked.tiles
    transforms: dict[str, TransformArray] = {}
    for index, instance in scene.instances():
        if instance.file is not None:
            place = f"{source}: shapes[{index}].transforms"
            transforms[instance.file] = _unpacked_transforms(_hash_in(instance.file, place), assets, place)
    profiles: dict[str, IesProfile] = {}
    for index, lamp in scene.ies_lights():
        place = f"{source}: lights[{index}].file"
        profiles[lamp.file] = _unpacked_profile(_hash_in(lamp.file, place), assets, place)
    pictures: dict[str, EnvironmentPicture] = {}
    for index, light in scene.pictured_lights():
        assert light.file is not None
        place = f"{source}: lights[{index}].file"
        pictures[light.file] = _unpacked_picture(_hash_in(light.file, place), assets, place)
    grids: dict[str, GridData] = {}
    for at, grid in scene.grids():
        if grid.asset not in grids:
            place = f"{source}: {place_in_file((*at, 'file'))}"
            grids[grid.asset] = _unpacked_grid(_hash_in(grid.file, place), assets, place)
    curves: dict[str, CurveData] = {}
    for at, strands in scene.curve_files():
        if strands.file is not None and strands.file not in curves:
            place = f"{source}: {place_in_file((*at, 'file'))}"
            curves[strands.file] = _unpacked_curves(_hash_in(strands.file, place), assets, place)
    measured: dict[str, MeasuredFile] = {}
    for name, material in scene.measured_materials():
        if material.file not in measured:
            place = f"{source}: {place_in_file(('materials', name, 'file'))}"
            measured[material.file] = _unpacked_measured(_hash_in(material.file, place), assets, place)
    return scene.with_files(
        curves=curves,
        measured=measured,
        grids=grids,
        textures=textures,
        profiles=profiles,
        transforms=transforms,
        meshes=meshes,
        environments=pictures,
    )


def _packed(mesh: MeshData) -> bytes:
    arrays = {"vertices": mesh.vertices, "triangles": mesh.triangles}
    if mesh.normals is not None:
        arrays["normals"] = mesh.normals
    for name in CORNER_ARRAYS:
        if getattr(mesh, name) is not None:
            arrays[name] = getattr(mesh, name)
    return _zipped(**arrays)


def _zipped(**arrays: NDArray[Any]) -> bytes:
    data = io.BytesIO()
    np.savez(data, **arrays)  # type: ignore[arg-type]  # the stub takes the names for options
    return data.getvalue()


def _hash_in(name: str, place: str) -> str:
    if not name.startswith(_PREFIX):
        raise SceneError(f"{place}: names the file {name!r}; here assets are named by their hash")
    return name.removeprefix(_PREFIX)


def _unpacked(sha256: str, assets: Mapping[str, bytes], place: str) -> MeshData:
    def mesh(archive: Any) -> MeshData:
        more = (archive.get(name) for name in CORNER_ARRAYS)
        return MeshData(archive["vertices"], archive["triangles"], archive.get("normals"), "", *more)

    return _asset(sha256, assets, place, mesh)


@dataclass(frozen=True)
class _TexturePicture:
    picture: StoredPicture
    tiles: NDArray[np.uint8]

    def sha256(self) -> str:
        return picture_sha256(self.picture, self.tiles)


def _packed_texture(picture: StoredPicture, tiles: NDArray[np.uint8]) -> bytes:
    size = np.array([picture.width, picture.height, picture.channels])
    return _zipped(size=size, coding=np.array(picture.coding), tiles=tiles)


def _unpacked_texture(sha256: str, assets: Mapping[str, bytes], place: str) -> _TexturePicture:
    def texture(archive: Any) -> _TexturePicture:
        width, height, channels = (int(each) for each in archive["size"])
        tiles = np.ascontiguousarray(archive["tiles"], np.uint8)
        picture = StoredPicture(width, height, channels, str(archive["coding"]), 0, len(tiles), sha256)
        across, down = tile_shape(picture.texel_bits)
        if tiles.shape != (-(-width // across) * -(-height // down), TILE_BYTES):
            raise ValueError("it is not as large as it says")
        return _TexturePicture(picture, tiles)

    return _asset(sha256, assets, place, texture)


def _unpacked_transforms(sha256: str, assets: Mapping[str, bytes], place: str) -> TransformArray:
    def transforms(archive: Any) -> TransformArray:
        return TransformArray.checked(archive["maps"], f"the asset {sha256}")

    return _asset(sha256, assets, place, transforms)


def _unpacked_picture(sha256: str, assets: Mapping[str, bytes], place: str) -> EnvironmentPicture:
    def picture(archive: Any) -> EnvironmentPicture:
        return EnvironmentPicture.checked(archive["pixels"], f"the asset {sha256}")

    return _asset(sha256, assets, place, picture)


def _unpacked_profile(sha256: str, assets: Mapping[str, bytes], place: str) -> IesProfile:
    def profile(archive: Any) -> IesProfile:
        return IesProfile.checked(*(archive[name] for name in ("vertical", "horizontal", "candela", "tilt")))

    return _asset(sha256, assets, place, profile)


def _unpacked_grid(sha256: str, assets: Mapping[str, bytes], place: str) -> GridData:
    def grid(archive: Any) -> GridData:
        placement = np.array(archive["placement"], np.float64).reshape(3, 4)
        return GridData.checked(archive["values"], f"the asset {sha256}", placement)

    return _asset(sha256, assets, place, grid)


def _unpacked_measured(sha256: str, assets: Mapping[str, bytes], place: str) -> MeasuredFile:
    def measured(archive: Any) -> MeasuredFile:
        return MeasuredFile.checked(np.array(archive["content"]), f"the asset {sha256}")

    return _asset(sha256, assets, place, measured)


def _asset(sha256: str, assets: Mapping[str, bytes], place: str, made: Callable[[Any], _Asset]) -> _Asset:
    if sha256 not in assets:
        raise SceneError(f"{place}: the asset {sha256} is missing; send it along")
    try:
        with np.load(io.BytesIO(assets[sha256]), allow_pickle=False) as archive:
            asset = made(archive)
            same = asset.sha256() == sha256
    except Exception as error:  # damaged archives fail in too many ways to list
        raise SceneError(f"{place}: the asset {sha256} cannot be read ({error}); send it again") from None
    if not same:
        raise SceneError(f"{place}: the asset {sha256} has another content than its hash says; send it again")
    return frozen(asset)  # type: ignore[no-any-return]


def _packed_curves(curves: CurveData) -> bytes:
    return _zipped(rows=curves.rows, counts=curves.counts)


def _unpacked_curves(sha256: str, assets: Mapping[str, bytes], place: str) -> CurveData:
    def curves(archive: Any) -> CurveData:
        rows, counts = np.array(archive["rows"], np.float64), np.array(archive["counts"], np.int64)
        if rows.ndim != 2 or rows.shape[1] not in COLUMNS or counts.ndim != 1:
            raise ValueError("it has no list of points or of lengths")
        if not ((counts > 0) & (counts <= len(rows))).all() or counts.sum() != len(rows):
            raise ValueError("its strands are not as long as it says")
        return CurveData.checked(rows, counts, f"the asset {sha256}")

    return _asset(sha256, assets, place, curves)
