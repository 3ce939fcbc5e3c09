"""Textures of materials: images, samplers and transforms of texture coordinates."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Any, Final

from clrender.errors import SceneError
from clrender.exact.angles import sin_cos
from clrender.image.raster import raster_ending
from clrender.importers.gltf.accessors import Accessors
from clrender.importers.gltf.document import Document
from clrender.importers.gltf.ktx2 import KTX2_MAGIC, ktx2_as_png

__all__ = ["Textures"]

_WRAPS: Final = {33071: "clamp", 33648: "mirror", 10497: "repeat"}
_NEAREST: Final = 9728
_BASISU: Final = "KHR_texture_basisu"
_MAGIC: Final = ((b"\x89PNG\r\n\x1a\n", ".png"), (b"\xff\xd8\xff", ".jpg"))


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
        self._pngs: dict[str, bytes | SceneError] = {}

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
        sources = self._sources(texture)
        if not sources:
            self._document.note(f"{place} was left out: it names no picture that could be read")
        picture = next((name for source in sources if (name := self._picture(source)) is not None), None)
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
        sources = self._sources(texture)
        return bool(sources) and self._missing.issuperset(sources)

    def _sources(self, texture: dict[str, Any]) -> list[int]:
        """Images of a texture, the best one first: KTX2 has lost more than what it was made from."""
        first, last = (self._document.extension(texture, name) or {} for name in ("EXT_texture_webp", _BASISU))
        return [each["source"] for each in (first, texture, last) if "source" in each]

    def _picture(self, index: int) -> str | None:
        """Name of an image in the draft: its JSON pointer, which messages then show; None if it cannot be read."""
        name = f"/images/{index}"
        if name in self._document.draft.pictures or index in self._missing:
            return None if index in self._missing else name
        try:
            self._document.draft.pictures[name] = self._known(self._data(index), index)
        except SceneError as fault:
            self._document.draft.leave_out(fault, self._document.files.source, self._document.files.strict)
            self._missing.add(index)
            return None
        return name

    def _data(self, index: int) -> bytes:
        image = self._document.items("images")[index]
        if "uri" in image:
            return self._document.files.read(image["uri"], f"/images/{index}/uri")
        return bytes(self._accessors.view(image["bufferView"]))

    def _known(self, data: bytes, index: int) -> tuple[bytes, str]:
        """A picture of a format that is read as a texture, and the extension of that format."""
        image, at = self._document.items("images")[index], f"/images/{index}"
        for magic, ending in _MAGIC:
            if data.startswith(magic):
                return data, ending
        if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
            return data, ".webp"
        if data.startswith(KTX2_MAGIC):
            if _BASISU not in self._document.items("extensionsUsed"):
                self._document.forgive(at, f"is a KTX2, which only {_BASISU} allows; export it again")
            return self._png(data, at), ".png"
        raster = raster_ending(data[:32])
        told = f"{image.get('uri', '')[:40]} {image.get('uri', '')[-4:]} {image.get('mimeType', '')}".lower()
        if raster is None or (raster == ".tga" and "tga" not in told and "targa" not in told):
            raise self._document.fault(at, "is no PNG, JPEG or WebP, which pictures must be; export it again")
        self._document.forgive(at, f"is a picture in {raster[1:].upper()}, not in PNG, JPEG or WebP; export it again")
        return data, raster

    def _png(self, data: bytes, at: str) -> bytes:
        """The picture of a KTX2. All that have no other form are decoded together, as each process takes time."""
        if at not in self._pngs:
            wanted = {at: data}
            for texture in self._document.items("textures"):
                sources = self._sources(texture)
                if len(sources) == 1 and self._document.extension(texture, _BASISU):
                    with suppress(SceneError):
                        wanted[f"/images/{sources[0]}"] = self._data(sources[0])
            unknown = {at: data for at, data in wanted.items() if at not in self._pngs and data.startswith(KTX2_MAGIC)}
            self._pngs |= ktx2_as_png(self._document, unknown)
        found = self._pngs[at]
        if isinstance(found, SceneError):
            raise found
        return found


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
