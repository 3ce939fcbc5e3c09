"""Meshes and pictures from arrays: NumPy's, and whatever else can be turned into those without a copy."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from clrender.curves import CurveData
from clrender.curves.read import curves_of_array
from clrender.errors import SceneError
from clrender.grids import GridData
from clrender.image.pictures import Picture
from clrender.image.texel_tiles import TILE_BYTES, StoredPicture, fill_tiles, picture_sha256, tile_count
from clrender.meshes.data import COORDINATE_LIMIT, CORNER_ARRAYS, TRIANGLE_LIMIT, MeshData
from clrender.scene.environment import EnvironmentPicture
from clrender.wording import counted, grouped, quoted, shown, suggestion

__all__ = ["environment_of_array", "grid_of_array", "mesh_of_arrays", "picture_of_array", "strands_of_array"]

_Array = npt.NDArray[Any]

_OF_CORNERS: Final = {"uvs": 2, "uvs_1": 2, "colors": 3, "tangents": 4}
_KEYS: Final = ("vertices", "faces", "normals", *CORNER_ARRAYS)
_CODINGS: Final = {"u1": "unorm8", "u2": "unorm16", "f2": "half", "f4": "float", "f8": "float"}
_SIDE_LIMIT: Final = 65536


def _numbers(value: Any, where: str) -> _Array:
    """An array of numbers, of anything that NumPy takes or that has ``__dlpack__``."""
    try:
        array = value if isinstance(value, np.ndarray) else _converted(value)
        if array.dtype.kind not in "fiub":
            raise TypeError
    except (TypeError, ValueError, RuntimeError, BufferError) as error:
        why = f" ({str(error).splitlines()[0][:100]})" if str(error) else ""
        kind = f"an array of {value.dtype}" if isinstance(value, np.ndarray) else f"of the type {type(value).__name__}"
        text = f"is {kind}, but must be an array of real numbers in the memory of the host{why}"
        raise SceneError(f"{where} {text}") from None
    if isinstance(array, np.ma.MaskedArray) and np.ma.getmaskarray(array).any():
        raise SceneError(f"{where} has numbers that are masked; say what they are, by filled()")
    return array


def _converted(value: Any) -> _Array:
    if hasattr(value, "__dlpack__") and not hasattr(value, "__array__"):
        return np.asarray(np.from_dlpack(value))
    return np.asarray(value)


def environment_of_array(name: str, value: Any) -> EnvironmentPicture:
    """An environment map.

    Parameters
    ----------
    name : str
        Its name in the scene.
    value : (H, W, 3) array_like
        Radiance, W/(sr m2), in latitude-longitude format.

    Raises
    ------
    SceneError
        It is no such array.
    """
    where = f"environments: {quoted(name)}"
    array = _numbers(value, where)
    if array.ndim != 3 or array.shape[2] != 3 or 0 in array.shape or array.dtype.kind != "f":
        text = f"has the shape {array.shape} of {array.dtype}, but must have (height, width, 3) of floats"
        raise SceneError(f"{where} {text}")
    with np.errstate(over="ignore"):  # infinite, which is refused
        return EnvironmentPicture.checked(array.astype(np.float32), where)


def grid_of_array(name: str, value: Any) -> GridData:
    """A grid of densities in the unit cube, unless the medium says another box.

    Parameters
    ----------
    name : str
        Its name in the scene.
    value : (nz, ny, nx) array_like
        Not below 0.

    Raises
    ------
    SceneError
        It is no such array.
    """
    where = f"grids: {quoted(name)}"
    return GridData.checked(_numbers(value, where), where)


def strands_of_array(name: str, value: Any) -> CurveData:
    """Strands of hair or other curves.

    Parameters
    ----------
    name : str
        Its name in the scene.
    value : (strands, points, 3 or 4) or (points, 3 or 4) array_like
        See `clrender.curves.read.curves_of_array`.

    Raises
    ------
    SceneError
        It is no such array.
    """
    where = f"curves: {quoted(name)}"
    return curves_of_array(_numbers(value, where), where)


def mesh_of_arrays(name: str, given: Mapping[str, Any], former: MeshData | None) -> MeshData:
    """A mesh.

    Parameters
    ----------
    name : str
        Its name in the scene.
    given : mapping of str to array_like
        ``vertices`` (V, 3), metres, ``faces`` (T, 3) of indices, and if wanted ``normals`` (V, 3), ``uvs`` and
        ``uvs_1`` (V or T, 3 corners, 2), ``colors`` (…, 3), linear, 0 to 1, ``tangents`` (…, 4); the latter for each
        vertex, (V, n), or for each corner of the faces, (T, 3, n).
    former : MeshData or None
        The mesh of this name so far, whose arrays stand for those that are not given.

    Raises
    ------
    SceneError
        An array is missing, or of another shape, or has indices or numbers that are not allowed.
    """
    place = f"meshes: {quoted(name)}"
    if not isinstance(given, Mapping):
        raise SceneError(f"{place} is {shown(given)}, but must be a table of arrays: {', '.join(_KEYS)}")
    for key in given:
        if key not in _KEYS:
            raise SceneError(f"{place}: {quoted(str(key))} is an unknown array{suggestion(str(key), _KEYS)}")
    for key in ("vertices", "faces"):
        if key not in given and former is None:
            raise SceneError(f"{place}: {key} are missing; add them")
    moves = "vertices" in given
    vertices = _rows(given["vertices"], f"{place}: vertices", 3) if moves else former.vertices  # type: ignore[union-attr]
    if not (np.isfinite(vertices).all() and (np.abs(vertices) <= COORDINATE_LIMIT).all()):
        raise SceneError(f"{place}: vertices have numbers that are not finite, or beyond {COORDINATE_LIMIT:g} metres")
    faces = _faces(given["faces"], f"{place}: faces") if "faces" in given else former.triangles  # type: ignore[union-attr]
    if len(faces) and int(faces.max()) >= len(vertices):
        text = (
            f"faces have the index {int(faces.max())}, but the mesh has {counted(len(vertices), 'vertex', 'vertices')}"
        )
        raise SceneError(f"{place}: {text}; indices count from 0")
    if max(len(vertices), len(faces)) > TRIANGLE_LIMIT:
        raise SceneError(
            f"{place}: has more than {grouped(TRIANGLE_LIMIT)} vertices or faces, which is the most; divide it"
        )
    if moves and former is not None and former.normals is not None and "normals" not in given:
        raise SceneError(f"{place}: has normals, which do not follow its vertices; give new ones, or None for none")
    arrays: dict[str, Any] = {"vertices": vertices, "triangles": faces}
    arrays["normals"] = _normals(given, former, len(vertices), place)
    for key, size in _OF_CORNERS.items():
        arrays[key] = _corners(given, former, key, size, vertices, faces, place)
    if former is not None:
        return dataclasses.replace(former, **arrays)
    return MeshData(**arrays)


def _rows(value: Any, where: str, size: int) -> _Array:
    array = _numbers(value, where)
    if array.ndim != 2 or array.shape[1] != size or not len(array):
        raise SceneError(f"{where} have the shape {array.shape}, but must have (n, {size})")
    return array if array.dtype in (np.float32, np.float64) else array.astype(np.float64)


def _faces(value: Any, where: str) -> npt.NDArray[np.uint32]:
    array = _numbers(value, where)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "iu" or not len(array):
        kind = f"{array.shape} of {array.dtype}"
        raise SceneError(f"{where} have the shape {kind}, but must have (n, 3) of whole numbers: triangles")
    if int(array.min()) < 0:
        raise SceneError(f"{where} have the index {int(array.min())}; indices count from 0")
    return array.astype(np.uint32) if int(array.max()) < 2**32 else array  # which is refused next


def _normals(given: Mapping[str, Any], former: MeshData | None, count: int, place: str) -> _Array | None:
    if "normals" not in given:
        return None if former is None else former.normals
    if given["normals"] is None:
        return None
    array = _rows(given["normals"], f"{place}: normals", 3)
    if len(array) != count:
        raise SceneError(f"{place}: it has {counted(len(array), 'normal')}, but {counted(count, 'vertex', 'vertices')}")
    if not np.isfinite(array).all():
        raise SceneError(f"{place}: normals have numbers that are not finite")
    return array


def _corners(
    given: Mapping[str, Any], former: MeshData | None, key: str, size: int, vertices: _Array, faces: _Array, place: str
) -> npt.NDArray[np.float32] | None:
    """Data for the corners of faces, from those or from vertices."""
    if key not in given:
        kept: npt.NDArray[np.float32] | None = None if former is None else getattr(former, key)
        if kept is not None and len(kept) != len(faces):
            raise SceneError(
                f"{place}: has {key} of {counted(len(kept), 'face')}, but there are {len(faces)}; give {key} as well"
            )
        return kept
    if given[key] is None:
        return None
    array = _numbers(given[key], f"{place}: {key}")
    if array.dtype.kind != "f":
        raise SceneError(f"{place}: {key} are of {array.dtype}, but must be floats")
    of_vertices, of_corners = (len(vertices), size), (len(faces), 3, size)
    if array.shape not in (of_vertices, of_corners):
        text = f"have the shape {array.shape}, but must have {of_vertices}, for vertices, or {of_corners}, for corners"
        raise SceneError(f"{place}: {key} {text}")
    with np.errstate(over="ignore"):  # infinite, which is refused
        array = array.astype(np.float32)
    if not np.isfinite(array).all():
        raise SceneError(f"{place}: {key} have numbers that are not finite in single precision")
    if key == "colors" and not ((array >= 0.0) & (array <= 1.0)).all():
        raise SceneError(f"{place}: colors have numbers that are not between 0 and 1")
    return array[faces] if array.ndim == 2 else array


def picture_of_array(name: str, value: Any) -> tuple[StoredPicture, npt.NDArray[np.uint8]]:
    """A picture of a texture, as `clrender.scene.scene_files.SceneFiles` holds it.

    Parameters
    ----------
    name : str
        Its name in the scene.
    value : (H, W), (H, W, 1), (H, W, 3) or (H, W, 4) array_like
        First row on top. Whole numbers of 8 or 16 bits are 0 to 1; floats are what they are.

    Raises
    ------
    SceneError
        It is no such array.
    """
    where = f"textures: {quoted(name)}"
    array = _numbers(value, where)
    coding = _CODINGS.get(f"{array.dtype.kind}{array.dtype.itemsize}")
    array = array[..., None] if array.ndim == 2 else array
    if array.ndim != 3 or array.shape[2] not in (1, 3, 4) or 0 in array.shape or coding is None:
        kind = f"{array.shape} of {array.dtype}"
        text = "(height, width) with 1, 3 or 4 channels, of uint8, uint16, float16 or float32"
        raise SceneError(f"{where} has the shape {kind}, but must have {text}")
    height, width, channels = array.shape
    if max(height, width) > _SIDE_LIMIT:
        raise SceneError(
            f"{where} has {width} x {height} pixels, but at most {grouped(_SIDE_LIMIT)} a side are possible"
        )
    if coding == "float":
        with np.errstate(over="ignore"):  # infinite, which is refused
            array = array.astype(np.float32)
    if coding in ("half", "float") and not np.isfinite(array).all():
        raise SceneError(f"{where} has numbers that are not finite in single precision")
    if coding == "half":
        array = array.view(np.uint16)
    if channels == 3:
        opaque = {"unorm8": 255, "unorm16": 65535, "half": np.float16(1.0).view(np.uint16), "float": 1.0}[coding]
        array = np.concatenate([array, np.full((height, width, 1), opaque, array.dtype)], axis=2)
    picture = Picture(width, height, array.shape[2], coding, lambda: iter((array,)))
    tiles = np.zeros((tile_count(picture), TILE_BYTES), np.uint8)
    fill_tiles(tiles, picture)
    stored = StoredPicture(
        width, height, array.shape[2], coding, 0, len(tiles), picture_sha256(picture, tiles)
    )  # fmt: skip
    return stored, tiles
