"""Textures of materials: images, samplers and transforms of texture coordinates."""

from __future__ import annotations

import math
from typing import Any, Final

from clrender.errors import SceneError
from clrender.exact.angles import sin_cos
from clrender.image.raster import raster_ending
from clrender.importers.gltf.accessors import Accessors
from clrender.importers.gltf.document import Document

__all__ = ["Textures"]

_WRAPS: Final = {33071: "clamp", 33648: "mirror", 10497: "repeat"}
_NEAREST: Final = 9728
_MAGIC: Final = ((b"\x89PNG\r\n\x1a\n", ".png"), (b"\xff\xd8\xff", ".jpg"))
_KTX2: Final = b"\xabKTX 20\xbb\r\n\x1a\n"


class Textures:
    """Converts texture references to our textures; reads each image once, when it is needed.

    Parameters
    ----------
    document : Document
    accessors : Accessors
    """

    def __init__(self, document: Document, accessors: Accessors) -> None:
        self._document, self._accessors = document, accessors
        self._missing: set[int] = set()

    def made(self, info: dict[str, Any] | None, at: str) -> dict[str, Any] | None:
        """A texture as in a scene file, without channel and colour space; None if there is none that can be read.

        Parameters
        ----------
        info : dict, optional
            The reference.
        at : str
            Its JSON pointer.

        Raises
        ------
        SceneError
            Its image cannot be read, and the file is to be refused for that.
        """
        if info is None:
            return None
        texture, place = self._document.items("textures")[info["index"]], f"/textures/{info['index']}"
        transform = self._document.extension(info, "KHR_texture_transform") or {}
        uv_set = transform.get("texCoord", info.get("texCoord", 0))
        if uv_set > 1:
            self._document.note(f"{at} was left out: it asks for TEXCOORD_{uv_set}, but two sets are known")
            return None
        source = self._source(texture, place)
        picture = None if source is None else self._picture(source)
        if picture is None:
            return None
        made: dict[str, Any] = {"texture": picture}
        if uv_set:
            made["uv_set"] = uv_set
        if transform:
            made["transform"] = _transform(transform)
        sampler = self._document.items("samplers")[texture["sampler"]] if "sampler" in texture else {}
        made["wrap"] = [_WRAPS[sampler.get(key, 10497)] for key in ("wrapS", "wrapT")]
        if sampler.get("magFilter") == _NEAREST:
            made["filter"] = "nearest"
        return made

    def lost(self, info: dict[str, Any] | None) -> bool:
        """Whether a texture was left out because its image is missing."""
        if info is None:
            return False
        texture = self._document.items("textures")[info["index"]]
        webp = self._document.extension(texture, "EXT_texture_webp") or {}
        return webp.get("source", texture.get("source")) in self._missing

    def _source(self, texture: dict[str, Any], at: str) -> int | None:
        webp = self._document.extension(texture, "EXT_texture_webp") or {}
        source: int | None = webp.get("source", texture.get("source"))
        if source is None:
            if self._document.extension(texture, "KHR_texture_basisu"):
                text = "has a picture in KTX2 (Basis Universal) only, which is not read; export it as PNG, JPEG or WebP"
                raise self._document.fault(at, text)
            self._document.note(f"{at} was left out: it names no picture that could be read")
        return source

    def _picture(self, index: int) -> str | None:
        """Name of an image in the draft: its JSON pointer, which messages then show; None if it cannot be read."""
        name = f"/images/{index}"
        if name in self._document.draft.pictures or index in self._missing:
            return None if index in self._missing else name
        image = self._document.items("images")[index]
        try:
            if "uri" in image:
                data = self._document.files.read(image["uri"], f"{name}/uri")
            else:
                data = bytes(self._accessors.view(image["bufferView"]))
            self._document.draft.pictures[name] = data, self._ending(data, image, name)
        except SceneError as fault:
            self._document.draft.leave_out(fault, self._document.files.source, self._document.files.strict)
            self._missing.add(index)
            return None
        return name

    def _ending(self, data: bytes, image: dict[str, Any], at: str) -> str:
        for magic, ending in _MAGIC:
            if data.startswith(magic):
                return ending
        if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
            return ".webp"
        if data.startswith(_KTX2):
            text = "is a KTX2 (Basis Universal), which is not read; export it as PNG, JPEG or WebP"
            raise self._document.fault(at, text)
        raster = raster_ending(data[:32])
        told = f"{image.get('uri', '')[:40]} {image.get('uri', '')[-4:]} {image.get('mimeType', '')}".lower()
        if raster is None or (raster == ".tga" and "tga" not in told and "targa" not in told):
            raise self._document.fault(at, "is no PNG, JPEG or WebP, which pictures must be; export it again")
        self._document.forgive(at, f"is a picture in {raster[1:].upper()}, not in PNG, JPEG or WebP; export it again")
        return raster


def _transform(transform: dict[str, Any]) -> dict[str, Any]:
    """Convert a transform of coordinates whose v goes down from the top edge to ours, whose v goes up from the bottom.

    With F the flip of v, ours are w = F uv + (0, 1). glTF maps uv to R S uv + t; R rotates counter-clockwise as seen on
    the image, like our own rotation R' by the same angle. So F R S F = R' S, and the flip changes the offset.
    """
    angle = transform.get("rotation", 0.0)
    (x, y), (u, v) = transform.get("offset", (0.0, 0.0)), transform.get("scale", (1.0, 1.0))
    sine, cosine = sin_cos(angle)
    offset = [x + sine * v, 1.0 - y - cosine * v]
    return {"offset": offset, "rotate_degrees": math.degrees(angle), "scale": [u, v]}
