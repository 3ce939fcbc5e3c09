"""Buffer views compressed by meshoptimizer (EXT_meshopt_compression), decoded by the library meshopt, if installed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.extras import install_command, lacking
from clrender.importers.gltf.decoding import Encoded, decoded
from clrender.importers.gltf.document import Document
from clrender.importers.gltf.extension_schema import MESHOPT
from clrender.importers.gltf.meshopt_filters import FILTERS
from clrender.wording import counted, quoted

__all__ = ["compression", "decode_meshopt", "meshopt_is_there", "unread_fallbacks"]

_RATIO: Final = 1024
"""Upper bound of the bytes that a byte of data decodes to: two bits may stand for 256 bytes."""
_LIMIT: Final = 2**32
"""Most bytes of all compressed views of a file."""
_COPIES: Final = 4
"""Copies of a view that its process holds."""
_BYTES_IN_A_SECOND: Final = 50_000_000


@dataclass(frozen=True)
class _Compressed:
    """A compressed buffer view; the names are those of the extension's properties."""

    at: str
    data: bytes
    count: int
    stride: int
    mode: str
    filter: str

    @property
    def size(self) -> int:
        """Bytes after decoding."""
        return self.count * self.stride


def meshopt_is_there() -> bool:
    """Whether meshopt is installed."""
    return find_spec("meshopt") is not None


def compression(document: Document, view: dict[str, Any]) -> tuple[str, dict[str, Any]] | None:
    """Name and object of the extension, if a buffer view is compressed."""
    found = ((name, document.extension(view, name)) for name in MESHOPT)
    return next(((name, value) for name, value in found if value is not None), None)


def unread_fallbacks(document: Document) -> set[int]:
    """Buffers that are not read, because their views are compressed in another one.

    They may be without bytes; those with bytes are for programs that cannot decode the others.
    """
    views = document.items("bufferViews")
    found: set[int] = set()
    for index, buffer in enumerate(document.items("buffers")):
        if any((document.extension(buffer, name) or {}).get("fallback") for name in MESHOPT):
            needless = all(compression(document, view) for view in views if view["buffer"] == index)
            if "uri" not in buffer or (needless and meshopt_is_there()):
                found.add(index)
    return found


def decode_meshopt(document: Document, buffers: Sequence[memoryview | None]) -> dict[int, memoryview]:
    """Bytes of compressed buffer views, except those that the file also contains uncompressed.

    Parameters
    ----------
    document : Document
        Validated.
    buffers : sequence of memoryview or None
        Bytes of all buffers; None for those that are not read.

    Returns
    -------
    dict of int to memoryview
        By the index of the view.

    Raises
    ------
    SceneError
        meshopt is not installed, or the data are damaged or do not match the views.
    """
    views = document.items("bufferViews")
    wanted = [index for index, view in enumerate(views) if buffers[view["buffer"]] is None]
    parts = {index: part for index in wanted if (part := _part(document, index, buffers)) is not None}
    if not parts:
        return {}
    total = sum(part.size for part in parts.values())
    first = next(iter(parts.values())).at
    if total > _LIMIT:
        raise document.fault(
            first, f"and others take more than {counted(_LIMIT, 'byte')}, which is the most; export less"
        )
    if not meshopt_is_there():
        cure = f"install what reads it with `{install_command('gltf')}` (for Python 3.11 or later)"
        text = f"is compressed by meshoptimizer; {cure}, or export it without that compression"
        raise lacking("gltf", document.fault(first, text))
    return dict(zip(parts, _decoded(document, list(parts.values()), total), strict=True))


def _decoded(document: Document, parts: list[_Compressed], total: int) -> list[memoryview]:
    memory = 2 * sum(len(part.data) for part in parts) + _COPIES * max(part.size for part in parts)
    encoded = [Encoded(part.data, {"count": part.count, "size": part.stride, "mode": part.mode}) for part in parts]
    found = decoded(document.files.source, "meshopt", encoded, memory, total // _BYTES_IN_A_SECOND)
    if len(found) < len(parts):
        text = "holds data that meshoptimizer cannot decode, or that take too much memory or time; export it again"
        raise document.fault(parts[len(found)].at, text)
    return [_filtered(part, each["bytes"]).data for part, each in zip(parts, found, strict=True)]


def _filtered(part: _Compressed, numbers: NDArray[np.uint8]) -> NDArray[np.uint8]:
    if part.filter == "NONE":
        return numbers
    return FILTERS[part.filter].undone(numbers.reshape(part.count, part.stride)).reshape(-1)


def _part(document: Document, index: int, buffers: Sequence[memoryview | None]) -> _Compressed | None:
    """The compressed view of that index, checked against all that the extension demands; None if it is another one."""
    view = document.items("bufferViews")[index]
    extension = compression(document, view)
    if extension is None:
        return None
    at, packed = f"/bufferViews/{index}/extensions/{extension[0]}", extension[1]
    count, stride, mode = packed["count"], packed["byteStride"], packed["mode"]
    name = packed.get("filter", "NONE")
    if mode not in ("ATTRIBUTES", "TRIANGLES", "INDICES"):
        raise document.fault(f"{at}/mode", f"is {quoted(mode)}, but must be ATTRIBUTES, TRIANGLES or INDICES")
    if name != "NONE" and name not in FILTERS:
        raise document.fault(f"{at}/filter", f"is {quoted(name)}, but must be NONE, {' or '.join(FILTERS)}")
    strides = tuple(range(4, 257, 4)) if mode == "ATTRIBUTES" else (2, 4)
    if name != "NONE":
        strides = FILTERS[name].strides if mode == "ATTRIBUTES" else ()
    if stride not in strides:
        text = f"is {stride}, which {mode} with the filter {name} cannot have; export it again"
        raise document.fault(f"{at}/byteStride", text)
    if mode == "TRIANGLES" and count % 3:
        raise document.fault(f"{at}/count", f"is {count}, but must be a multiple of 3; export it again")
    if count * stride != view["byteLength"]:
        text = (
            f"times byteStride is {counted(count * stride, 'byte')}, but the view has {view['byteLength']}; "
            "export it again"
        )
        raise document.fault(f"{at}/count", text)
    buffer, start, size = buffers[packed["buffer"]], packed.get("byteOffset", 0), packed["byteLength"]
    if buffer is None:
        raise document.fault(f"{at}/buffer", "names a buffer without bytes, but they are needed; export it again")
    if start + size > len(buffer):
        text = f"takes it to byte {start + size} of a buffer of {counted(len(buffer), 'byte')}; export it again"
        raise document.fault(f"{at}/byteLength", text)
    if count * stride > _RATIO * size:
        raise document.fault(
            f"{at}/byteLength", f"is {size}, too few for {counted(count * stride, 'byte')}; export it again"
        )
    return _Compressed(at, bytes(buffer[start : start + size]), count, stride, mode, name)
