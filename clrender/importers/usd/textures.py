"""Pictures of UsdUVTexture: files, colour spaces, wrapping, transforms of coordinates, scale and bias."""

from __future__ import annotations

import io
import os
import zipfile
from pathlib import Path
from typing import Any, Final

import numpy as np

from clrender.errors import OutOfMemory, SceneError
from clrender.files.named import allowed_file
from clrender.image.exr_write import ExrFormat, write_exr
from clrender.image.pictures import open_picture
from clrender.image.texel_values import texel_colors, texel_numbers
from clrender.importers.asset_files import AssetFiles
from clrender.importers.draft import Draft
from clrender.wording import quoted

__all__ = ["Node", "Nodes", "Textures", "packaged_file", "scene_name"]

Node = dict[str, Any]
Nodes = dict[str, Node]
"""Nodes of shading networks by key, see `clrender.importers.usd.networks`."""
_WRAPS: Final = {"repeat": "repeat", "mirror": "mirror", "clamp": "clamp", "black": "clamp", "useMetadata": "repeat"}
_LINEAR: Final = ("raw", "data", "lin_rec709", "lin_rec709_scene", "linear")
_FLOATS: Final = (".exr", ".hdr", ".pfm")
_NORMAL_SCALE: Final = ([2.0, 2.0, 2.0], [-1.0, -1.0, -1.0])
_UNSCALED: Final = ([1.0, 1.0, 1.0], [0.0, 0.0, 0.0])
_LIMIT: Final = 2**32
"""Largest picture in a package, bytes."""


def scene_name(files: AssetFiles, path: str) -> str:
    """The name of a file by which a scene would have it: relative to its folder, if it is below."""
    folder = Path(os.path.abspath(files.folder))  # noqa: PTH100  # links in it stay, as USD leaves them
    found = Path(os.path.normpath(path))
    return str(found.relative_to(folder)) if found.is_relative_to(folder) else str(found)


def packaged_file(files: AssetFiles, path: str, place: str) -> bytes:
    """A file in a ``.usdz`` package, by ``PACKAGE[NAME]``.

    Raises
    ------
    SceneError
        It is not there, or compressed, or in a folder that is not allowed.
    """
    outer, _, inner = path.partition("[")
    label = f"{files.source}: {place}"
    file, _ = files.open(scene_name(files, outer), place)
    try:
        with file, zipfile.ZipFile(file) as package:
            info = package.getinfo(inner.removesuffix("]"))
            if info.compress_type != zipfile.ZIP_STORED or info.file_size > _LIMIT:
                raise SceneError(f"{label}: {quoted(inner[:-1])} is compressed in the package, or too large")
            return package.read(info)
    except (KeyError, zipfile.BadZipFile, OSError, NotImplementedError, RuntimeError):
        raise SceneError(f"{label}: {quoted(inner[:-1])} cannot be read from the package; pack it again") from None


class Textures:
    """Converts nodes of pictures to textures.

    Parameters
    ----------
    draft : Draft
    files : AssetFiles
    nodes : Nodes
    """

    def __init__(self, draft: Draft, files: AssetFiles, nodes: Nodes) -> None:
        self._draft, self._files, self._nodes = draft, files, nodes
        self._coded: dict[str, bool] = {}
        self._lost: set[str] = set()

    def made(
        self, key: str, output: str, place: str, sets: list[str], *, number: bool, normal: bool = False
    ) -> dict[str, Any] | list[float] | None:
        """A texture as in a scene file, or the colour in its place; None if there is none that can be read.

        Parameters
        ----------
        key : str
            Of the node, a UsdUVTexture.
        output : str
            ``r``, ``g``, ``b``, ``a`` or ``rgb``.
        place : str
            Of the input, for messages.
        sets : list of str
            Names of the primvars that are texture coordinates; gets one more if this picture needs it.
        number, normal : bool
            Whether it is a number, or a map of normals.
        """
        node = self._nodes[key]
        given = node["in"]
        name = self._picture(given.get("file", {}).get("file"), place)
        if name is None:
            return None if name in self._lost or given.get("file", {}).get("file") else _fallback(node, output, number)
        coordinates = self._coordinates(node, place, sets)
        if coordinates is None:
            return None
        wraps = [self._wrap(value(node, each, "useMetadata")) for each in ("wrapS", "wrapT")]
        made: dict[str, Any] = {"texture": name, **coordinates, "wrap": wraps}
        scale, bias = value(node, "scale", [1.0] * 4), value(node, "bias", [0.0] * 4)
        if normal:
            if (scale[:3], bias[:3]) not in (_NORMAL_SCALE, _UNSCALED):
                made["texture"] = self._rescaled(made, scale[:3], bias[:3], place, normal=True)
            elif scale[0] == 1.0:
                self._draft.note(
                    f"{place}: its scale and bias are not those of a map of normals: taken as if they were"
                )
            return made
        channel = output if output in ("r", "g", "b", "a") else "r" if number else None
        linear = channel == "a" or self._is_linear(node, name)
        made["color_space"] = "linear" if linear else "srgb"
        if channel is not None:
            made["channel"] = channel
        at = "rgba".index(channel) if channel is not None else 0
        scale, bias = ([scale[at]] * 3, [bias[at]] * 3) if channel is not None else (scale[:3], bias[:3])
        if any(bias) or min(scale) < 0.0:
            made["texture"] = self._rescaled(made, scale, bias, place)
            made = {**made, "color_space": "linear", **({"channel": "r"} if channel is not None else {})}
        elif scale != [1.0, 1.0, 1.0]:
            made["scale"] = scale
        return made

    def _picture(self, asset: list[str] | None, place: str) -> str | None:
        """Name of a picture in the scene; None without one, or if it cannot be read."""
        if not asset or not asset[0]:
            return None
        authored, path = asset
        if "<UDIM>" in path or "<UDIM>" in authored:
            self._draft.note(f"{place}: {quoted(authored)} was left out: pictures in tiles (UDIM) are not read")
            return None
        if not path.endswith("]"):
            name = scene_name(self._files, path)
            allowed_file(name, self._files.folder, self._files.allow_paths, f"{self._files.source}: {place}")
            return name
        name = scene_name(self._files, path)
        if name in self._draft.pictures or name in self._lost:
            return name if name in self._draft.pictures else None
        try:
            data = packaged_file(self._files, path, place)
        except SceneError as fault:
            self._draft.leave_out(fault, self._files.source, self._files.strict)
            self._lost.add(name)
            return None
        self._draft.pictures[name] = data, Path(path[:-1]).suffix.lower()
        return name

    def _coordinates(self, node: Node, place: str, sets: list[str]) -> dict[str, Any] | None:
        """Keys of the set and the transform of its coordinates; None if they are of a kind that is not known."""
        made: dict[str, Any] = {}
        given = node["in"].get("st", {})
        source = self._nodes.get(given.get("n") or "")
        if source is not None and source["id"] in ("UsdTransform2d",):
            made["transform"] = {
                "scale": value(source, "scale", [1.0, 1.0]),
                "rotate_degrees": value(source, "rotation", 0.0),
                "offset": value(source, "translation", [0.0, 0.0]),
            }
            given = source["in"].get("in", {})
            source = self._nodes.get(given.get("n") or "")
        if source is None:
            self._draft.note(f"{place}: its picture names no texture coordinates: those of the primvar st are taken")
            name = "st"
        elif source["id"].startswith("UsdPrimvarReader"):
            name = value(source, "varname", "st")
        else:
            self._draft.note(f"{place} was left out: its texture coordinates are those of a {quoted(source['id'])}")
            return None
        if name not in sets:
            if len(sets) == 2:
                self._draft.note(f"{place} was left out: it asks for the coordinates {quoted(name)}, the third ones")
                return None
            sets.append(name)
        return {**made, "uv_set": 1} if sets.index(name) else made

    def _wrap(self, asked: str) -> str:
        if asked == "black":
            self._draft.note("pictures that are black beyond their edges have the colours of their edges there")
        return _WRAPS.get(asked, "repeat")

    def _is_linear(self, node: Node, name: str) -> bool:
        """Whether the numbers of a picture are taken as they are."""
        space = str(value(node, "sourceColorSpace", "auto"))
        if space.lower() in _LINEAR:
            return True
        if space.lower().startswith("srgb"):
            return False
        if name not in self._coded:
            self._coded[name] = self._has_coded_colors(name)
        return not self._coded[name]

    def _has_coded_colors(self, name: str) -> bool:
        """Whether the colour space `auto` of a picture is sRGB: of 8 bits, with three channels or four."""
        ending = self._draft.pictures[name][1] if name in self._draft.pictures else Path(name).suffix.lower()
        if ending in _FLOATS:
            return False
        try:
            picture = self._opened(name, "a picture")
        except Exception:  # whatever a library stumbles over: the reader of the picture itself reports it
            return True
        return bool(picture.coding == "unorm8" and picture.channels > 1)

    def _opened(self, name: str, place: str) -> Any:
        if name in self._draft.pictures:
            data, ending = self._draft.pictures[name]
        else:
            file, size = self._files.open(name, place)
            with file:
                data, ending = file.read(size), Path(name).suffix.lower()
        return open_picture(io.BytesIO(data), ending)

    def _rescaled(
        self, texture: dict[str, Any], scale: list[float], bias: list[float], place: str, *, normal: bool = False
    ) -> str:
        """The name of a picture of a texture's values times the scale plus the bias, 0 to 1.

        A map of normals becomes one of 0 for -1 and 1 for 1.
        """
        space, channel = texture.get("color_space", "linear"), texture.get("channel")
        told = f"times {scale!r} plus {bias!r}, {channel or 'rgb'}, {space}{', normals' if normal else ''}"
        name = f"{texture['texture']} ({told})"
        if name in self._draft.pictures:
            return name
        try:
            picture = self._opened(texture["texture"], place)
            made = np.empty((picture.height, picture.width, 3), np.float16)
            row = 0
            for band in picture.bands():
                if channel is None:
                    values = texel_colors(picture, band, space == "srgb").astype(np.float64)
                else:
                    values = texel_numbers(picture, band, space == "srgb", channel).astype(np.float64)
                    values = values.reshape(*values.shape[:2], 1)
                changed = values * np.array(scale) + np.array(bias)
                made[row : row + len(band)] = np.clip((changed + 1.0) / 2.0 if normal else changed, 0.0, 1.0)
                row += len(band)
        except MemoryError:
            raise OutOfMemory(f"{self._files.source}: {place}: the picture is too large for this machine") from None
        except Exception:  # whatever a library stumbles over: the reader of the picture itself reports it
            return str(texture["texture"])
        data = io.BytesIO()
        write_exr(data, made, {}, {}, ExrFormat(type="half", compression="none"))
        self._draft.pictures[name] = data.getvalue(), ".exr"
        return name


def value(node: Node, name: str, default: Any) -> Any:
    """A value of a node's input that is connected to nothing."""
    found = node["in"].get(name, {}).get("v")
    if isinstance(default, list):
        return found if isinstance(found, list) and len(found) >= len(default) else default
    if isinstance(default, float):
        return float(found) if isinstance(found, int | float) else default
    return default if found is None else found


def _fallback(node: Node, output: str, number: bool) -> list[float]:
    """The value of a node without a file."""
    found = value(node, "fallback", [0.0, 0.0, 0.0, 1.0])
    if output in ("r", "g", "b", "a"):
        return [found["rgba".index(output)]] * 3
    return [found[0]] * 3 if number else list(found[:3])
