"""Small glTF files for tests, and where those of the Khronos Group lie."""

from __future__ import annotations

import base64
import copy
import importlib
import io
import json
import struct
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

__all__ = ["Model", "meshopt_compressed", "picture_uri"]

_COMPONENTS: Final = {"int8": 5120, "uint8": 5121, "int16": 5122, "uint16": 5123, "uint32": 5125, "float32": 5126}
_TYPES: Final = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
QUAD: Final = ((-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0))


def picture_uri(pixels: Any, kind: str = "PNG") -> str:
    """A data URI of a picture of 8 bits, (h, w, 3 or 4)."""
    data = io.BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8)).save(data, kind, **({"lossless": True} if kind == "WEBP" else {}))
    return f"data:image/{kind.lower()};base64,{base64.b64encode(data.getvalue()).decode()}"


class Model:
    """A glTF file on its way out: `root` is its JSON."""

    def __init__(self) -> None:
        self.root: dict[str, Any] = {"asset": {"version": "2.0"}, "scenes": [{"nodes": []}], "nodes": []}
        self.data = bytearray()
        self.more_buffers: list[dict[str, Any]] = []

    def add(self, collection: str, value: dict[str, Any]) -> int:
        """Append an object to one of the root's arrays; its index."""
        there: list[Any] = self.root.setdefault(collection, [])
        there.append(value)
        return len(there) - 1

    def view(self, data: bytes, **more: Any) -> int:
        """A buffer view of these bytes."""
        self.data += bytes(-len(self.data) % 4)
        start = len(self.data)
        self.data += data
        return self.add("bufferViews", {"buffer": 0, "byteOffset": start, "byteLength": len(data), **more})

    def accessor(self, numbers: Any, kind: str = "float32", **more: Any) -> int:
        """An accessor of numbers, (n,) or (n, components)."""
        array: NDArray[Any] = np.asarray(numbers, np.dtype(kind).newbyteorder("<"))
        shape = _TYPES[1 if array.ndim == 1 else array.shape[1]]
        entry = {"bufferView": self.view(array.tobytes()), "componentType": _COMPONENTS[kind], "type": shape}
        return self.add("accessors", {**entry, "count": len(array), **more})

    def times(self, seconds: list[float]) -> int:
        """An accessor of key frames' times."""
        return self.accessor(seconds, min=[min(seconds)], max=[max(seconds)])

    def quad(self, material: int | None = None, **attributes: Any) -> int:
        """A mesh from (-1, -1) to (1, 1) whose front faces +z, with its picture upright."""
        given = {"POSITION": QUAD, "TEXCOORD_0": ((0, 1), (1, 1), (1, 0), (0, 0)), **attributes}
        primitive: dict[str, Any] = {
            "attributes": {name: self.accessor(numbers) for name, numbers in given.items()},
            "indices": self.accessor([0, 1, 2, 0, 2, 3], "uint16"),
        }
        if material is not None:
            primitive["material"] = material
        return self.add("meshes", {"primitives": [primitive]})

    def node(self, **values: Any) -> int:
        """A node that the scene shows."""
        index = self.add("nodes", values)
        self.root["scenes"][0]["nodes"].append(index)
        return index

    def texture(self, pixels: Any, sampler: dict[str, Any] | None = None) -> int:
        """A texture of 8 bits."""
        texture = {"source": self.add("images", {"uri": picture_uri(pixels)})}
        if sampler is not None:
            texture["sampler"] = self.add("samplers", sampler)
        return self.add("textures", texture)

    def extend(self, *names: str, required: bool = False) -> None:
        """Declare extensions."""
        for key in ("extensionsUsed", "extensionsRequired")[: 2 if required else 1]:
            self.root.setdefault(key, []).extend(names)

    def glb(self) -> bytes:
        """The file as a GLB."""
        buffers = [{"byteLength": max(len(self.data), 1)}, *self.more_buffers]
        root = {**self.root, "buffers": buffers} if self.data else self.root
        text = json.dumps(root).encode()
        text += b" " * (-len(text) % 4)
        body = struct.pack("<II", len(text), 0x4E4F534A) + text
        if self.data:
            data = bytes(self.data) + bytes(-len(self.data) % 4)
            body += struct.pack("<II", len(data), 0x004E4942) + data
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body

    def gltf(self) -> bytes:
        """The file as JSON with its bytes in a data URI."""
        uri = "data:application/octet-stream;base64," + base64.b64encode(bytes(self.data)).decode()
        one = {"byteLength": len(self.data), "uri": uri}
        buffers = {"buffers": [one, *self.more_buffers]} if self.data else {}
        return json.dumps({**self.root, **buffers}).encode()

    def write(self, path: Path) -> Path:
        """Write the file; its ending says as which kind."""
        path.write_bytes(self.glb() if path.suffix == ".glb" else self.gltf())
        return path


def meshopt_compressed(model: Model, name: str = "EXT_meshopt_compression", version: int = 0) -> Model:
    """The model with the views of all accessors compressed by meshoptimizer, and a fallback buffer without bytes.

    Its indices are kept in their order.
    """
    library: Any = importlib.import_module("meshopt")
    made, room = copy.deepcopy(model), 0
    made.extend(name, required=True)
    made.data.clear()
    views = made.root["bufferViews"]
    accessors = {each["bufferView"]: each for each in made.root["accessors"] if "bufferView" in each}
    for index in range(len(views)):
        view = views[index]
        data = bytes(model.data[view["byteOffset"] :][: view["byteLength"]])
        accessor = accessors.get(index)
        if accessor is None:
            view.update(views.pop(made.view(data)))
            continue
        rows = np.frombuffer(data, np.uint8).reshape(accessor["count"], -1)
        stride = rows.shape[1]
        whole = accessor["type"] == "SCALAR" and accessor["componentType"] in (5123, 5125)
        mode = "INDICES" if whole else "ATTRIBUTES"
        encoded = library.encode_gltf_buffer(rows.view(f"<u{stride}").reshape(-1) if whole else rows, mode, version)
        packed = {"count": len(rows), "byteStride": stride, "mode": mode, **views.pop(made.view(encoded))}
        view.update({"buffer": 1, "byteOffset": room, "extensions": {name: packed}})
        room += len(data) + -len(data) % 4
    made.more_buffers.append({"byteLength": max(room, 1), "extensions": {name: {"fallback": True}}})
    return made
