"""Meshes compressed by Draco (KHR_draco_mesh_compression), decoded by the library DracoPy, if installed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.extras import install_command, lacking
from clrender.importers.gltf.accessors import Accessors
from clrender.importers.gltf.decoding import Encoded, decoded
from clrender.importers.gltf.document import Document
from clrender.importers.gltf.schema import COMPONENTS

__all__ = ["DRACO", "decode_draco", "draco_is_there"]

DRACO: Final = "KHR_draco_mesh_compression"
_MEMORY_OF_A_BYTE: Final = 256
"""Memory that decoding takes for each byte of data."""
_BYTES_IN_A_SECOND: Final = 500_000


@dataclass(frozen=True)
class _Part:
    """A primitive that has only Draco-compressed vertices."""

    at: str
    primitive: dict[str, Any]
    data: bytes
    attributes: dict[str, int]


def draco_is_there() -> bool:
    """Whether DracoPy is installed."""
    return find_spec("DracoPy") is not None


def decode_draco(document: Document, accessors: Accessors) -> None:
    """Fill the accessors of compressed primitives, except those that the file also contains uncompressed.

    Parameters
    ----------
    document : Document
        Validated.
    accessors : Accessors

    Raises
    ------
    SceneError
        DracoPy is not installed, or the data are damaged or do not match the accessors.
    """
    parts = list(_parts(document, accessors))
    if not parts:
        return
    if not draco_is_there():
        cure = f"install what reads it with `{install_command('gltf')}`, or export it without Draco compression"
        raise lacking("gltf", document.fault(parts[0].at, f"is compressed by Draco; {cure}"))
    different = {part.data: number for number, part in reversed(list(enumerate(parts)))}
    meshes = dict(zip(different, _decoded(document, [parts[i] for i in different.values()]), strict=True))
    for part in parts:
        _fill(document, accessors, part, meshes[part.data])


def _parts(document: Document, accessors: Accessors) -> Iterator[_Part]:
    for number, mesh in enumerate(document.items("meshes")):
        for index, primitive in enumerate(mesh["primitives"]):
            draco, at = document.extension(primitive, DRACO), f"/meshes/{number}/primitives/{index}"
            position = primitive["attributes"].get("POSITION")
            if draco is None or position is None or "bufferView" in document.items("accessors")[position]:
                continue
            data = bytes(accessors.view(draco["bufferView"]))
            yield _Part(f"{at}/extensions/{DRACO}", primitive, data, draco["attributes"])


def _decoded(document: Document, parts: list[_Part]) -> list[dict[str, NDArray[Any]]]:
    """Decode the data; the first mesh without an answer is at fault."""
    total = sum(len(part.data) for part in parts)
    encoded = [Encoded(part.data) for part in parts]
    memory, seconds = _MEMORY_OF_A_BYTE * total, total // _BYTES_IN_A_SECOND
    found = decoded(document.files.source, "draco", encoded, memory, seconds)
    if len(found) < len(parts):
        text = "holds data that Draco cannot decode, or that take too much memory or time; export it again"
        raise document.fault(f"{parts[len(found)].at}/bufferView", text)
    return found


def _fill(document: Document, accessors: Accessors, part: _Part, mesh: dict[str, NDArray[Any]]) -> None:
    faces = mesh["faces"].reshape(-1, 3)
    if "indices" in part.primitive:
        accessors.provide(part.primitive["indices"], faces.reshape(-1))
    elif len(faces):
        raise document.fault(part.at, "belongs to a primitive without indices, which Draco needs; export it again")
    part.primitive["mode"] = 4  # Draco stores triangles, whatever the mode was
    for name, unique in part.attributes.items():
        at = f"{part.at}/attributes/{name}"
        number = part.primitive["attributes"].get(name)
        if number is None:
            raise document.fault(at, "is no attribute of the primitive; export it again")
        accessor = document.items("accessors")[number]
        array = mesh.get(str(unique))
        if array is None:
            raise document.fault(at, f"is {unique}, but the data hold no attribute of that number; export it again")
        columns, rows = COMPONENTS.get(accessor.get("type", ""), (1, 0))
        if columns > 1 or array.shape != (accessor["count"], rows):
            shape, wanted = " x ".join(map(str, array.shape)), f"{accessor['count']} x {rows}"
            raise document.fault(at, f"holds {shape} numbers, but the accessor says {wanted}; export it again")
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise document.fault(at, "holds a number that is not finite; export it again")
        accessors.provide(number, array[:, 0] if rows == 1 else array)
