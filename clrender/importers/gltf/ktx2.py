"""Pictures in KTX2 (KHR_texture_basisu): Basis Universal, decoded by the library opengl-basisu, and uncompressed ones.

Nothing is decoded before the header is checked (Khronos Group, "KTX File Format Specification", version 2.0).
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Final

import numpy as np

from clrender.errors import SceneError
from clrender.extras import install_command, lacking
from clrender.image.display import check_size
from clrender.image.pictures import PICTURE_LIMIT
from clrender.importers.gltf.decoding import Encoded, decoded
from clrender.importers.gltf.document import Document

__all__ = ["KTX2_MAGIC", "basis_is_there", "ktx2_as_png"]

KTX2_MAGIC: Final = b"\xabKTX 20\xbb\r\n\x1a\n"
_HEADER: Final = struct.Struct("<12s10I")
_LEVEL: Final = struct.Struct("<2Q")
_LEVELS_AT: Final = 80
_MODEL_AT: Final = 12
"""Place of the colour model in the data format descriptor."""
_ETC1S, _UASTC = 163, 166
_NONE, _BASIS_LZ, _ZSTD, _ZLIB = range(4)
_PLAIN: Final = {23: 3, 29: 3, 37: 4, 43: 4}
"""Channels by Vulkan's number of the format: RGB and RGBA of 8 bits, linear and sRGB."""
_ZSTD_RATIO: Final = 1 << 15
"""Upper bound of the compression ratio: a run of 128 KiB takes four bytes."""
_BASIS_RATIO: Final = 1 << 17
"""Upper bound of the pixels per byte of a file: with its tables, one of a single colour takes some hundred bytes."""
_CURE: Final = "export it as PNG, JPEG or WebP"
_MEMORY_OF_A_PIXEL: Final = 16
_PIXELS_IN_A_SECOND: Final = 2_000_000


@dataclass(frozen=True)
class _Header:
    """A picture as its file describes it; format and supercompression are numbers of the specification."""

    width: int
    height: int
    format: int
    model: int
    supercompression: int
    level: bytes
    """The data of the largest level."""


def basis_is_there() -> bool:
    """Whether opengl-basisu is installed."""
    return find_spec("opengl_basisu") is not None


def ktx2_as_png(document: Document, pictures: Mapping[str, bytes]) -> dict[str, bytes | SceneError]:
    """Pictures in KTX2, without their smaller levels, as PNG.

    Parameters
    ----------
    document : Document
    pictures : mapping of str to bytes
        The files, by the JSON pointers of their images.

    Returns
    -------
    dict of str to (bytes or SceneError)
        An error for what is damaged, too large or of a kind that is not read, and where opengl-basisu is not installed.

    Raises
    ------
    SceneError
        The process cannot be started.
    """
    found: dict[str, bytes | SceneError] = {}
    basis: dict[str, int] = {}
    for at, data in pictures.items():
        try:
            header = _header(data)
            if header.format in _PLAIN:
                found[at] = _plain_as_png(header)
                continue
            _check_basis(header, len(data))
        except (ValueError, struct.error, zlib.error) as error:
            known = {struct.error: "it is truncated", zlib.error: "its data are damaged"}
            reason = known.get(type(error), str(error))
            found[at] = document.fault(at, f"is a KTX2 that cannot be read, because {reason}; {_CURE}")
            continue
        if basis_is_there():
            basis[at] = header.width * header.height
        else:
            install = f"install what reads it with `{install_command('gltf')}` (for Linux on x86-64)"
            text = f"is a KTX2 (Basis Universal); {install}, or {_CURE}"
            found[at] = lacking("gltf", document.fault(at, text))
    return found | _decoded(document, {at: pictures[at] for at in basis}, basis)


def _decoded(document: Document, pictures: dict[str, bytes], pixels: dict[str, int]) -> dict[str, bytes | SceneError]:
    """Pictures in Basis Universal. One that fails ends the process, and the others need a new one."""
    found: dict[str, bytes | SceneError] = {}
    while waiting := [at for at in pictures if at not in found]:
        parts = [Encoded(pictures[at]) for at in waiting]
        memory = _MEMORY_OF_A_PIXEL * max(pixels[at] for at in waiting) + 4 * sum(len(part.data) for part in parts)
        seconds = sum(pixels[at] for at in waiting) // _PIXELS_IN_A_SECOND
        answers = decoded(document.files.source, "basis", parts, memory, seconds)
        found |= {at: each["png"].tobytes() for at, each in zip(waiting, answers, strict=False)}
        for at in waiting[len(answers) :][:1]:
            text = "is a KTX2 that Basis Universal cannot decode, or that takes too much memory or time"
            found[at] = document.fault(at, f"{text}; {_CURE}")
    return found


def _header(data: bytes) -> _Header:
    numbers = _HEADER.unpack_from(data)
    _, format_, _, width, height, depth, layers, faces, _, supercompression, descriptor = numbers
    if depth or layers > 1 or faces != 1:
        raise ValueError("it is a volume, an array or a cube map")
    check_size(width, height, PICTURE_LIMIT)
    start, size = _LEVEL.unpack_from(data, _LEVELS_AT)
    level = data[start : start + size]
    if len(level) < size:
        raise ValueError("it is truncated")
    model = struct.unpack_from("<B", data, descriptor + _MODEL_AT)[0]
    return _Header(width, height, format_, model, supercompression, level)


def _check_basis(header: _Header, size: int) -> None:
    """Check that it is of a kind that glTF allows, and that the file can contain as many pixels as it says."""
    kind = header.model, header.supercompression
    if header.format or kind not in ((_ETC1S, _BASIS_LZ), (_UASTC, _NONE), (_UASTC, _ZSTD)):
        told = f"format {header.format}, colour model {header.model}, supercompression {header.supercompression}"
        raise ValueError(f"it is neither ETC1S nor UASTC nor RGB or RGBA of 8 bits ({told})")
    needed = 16 * -(-header.width // 4) * -(-header.height // 4)  # of UASTC: blocks of 4 x 4 pixels
    ratio = {_NONE: needed <= len(header.level), _ZSTD: needed <= _ZSTD_RATIO * len(header.level)}
    if not ratio.get(header.supercompression, header.width * header.height <= _BASIS_RATIO * size):
        raise ValueError("it is too small for the size its header gives")


def _plain_as_png(header: _Header) -> bytes:
    from PIL import Image

    shape = header.height, header.width, _PLAIN[header.format]
    size, data = shape[0] * shape[1] * shape[2], header.level
    if header.supercompression == _ZLIB:
        data = zlib.decompressobj().decompress(data, size)
    elif header.supercompression != _NONE:
        raise ValueError(f"its supercompression {header.supercompression} is not read without Basis Universal")
    if len(data) < size:
        raise ValueError("it is too small for the size its header gives")
    png = io.BytesIO()
    Image.fromarray(np.frombuffer(data, np.uint8, size).reshape(shape)).save(png, "PNG", compress_level=1)
    return png.getvalue()
