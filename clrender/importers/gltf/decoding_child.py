"""Decodes compressed data in a process of its own: `decoding_child.py DECODER MEMORY SECONDS`, the last two its limits.

Run as a file, so that nothing of clrender is loaded. Stdin: for each part the sizes of its settings and of its data (8
bytes each, little-endian), the settings as JSON, and the data, until the end. Stdout, for each part as soon as it is
decoded: the size (8 bytes) and the bytes of an ``.npz``. Ends at the first part that fails, with a message on stderr.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import resource
import struct
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__: list[str] = []


def draco() -> Callable[[bytes, dict[str, Any]], dict[str, NDArray[Any]]]:
    """A decoder of meshes: ``faces``, and the attributes by unique id."""
    import DracoPy
    import numpy as np

    def decode(data: bytes, settings: dict[str, Any]) -> dict[str, NDArray[Any]]:
        mesh = DracoPy.decode(data)
        arrays = {str(each["unique_id"]): np.asarray(each["data"]) for each in mesh.attributes}
        return {"faces": np.asarray(mesh.faces, np.uint32), **arrays}

    return decode


def meshopt() -> Callable[[bytes, dict[str, Any]], dict[str, NDArray[Any]]]:
    """A decoder of buffer views, with settings ``mode``, ``count`` (elements) and ``size`` (of each): ``bytes``."""
    import meshopt
    import numpy as np

    def decode(data: bytes, settings: dict[str, Any]) -> dict[str, NDArray[Any]]:
        found = meshopt.decode_gltf_buffer(data, settings["count"], settings["size"], settings["mode"])
        return {"bytes": np.ascontiguousarray(found).view(np.uint8).reshape(-1)}

    return decode


def basis() -> Callable[[bytes, dict[str, Any]], dict[str, NDArray[Any]]]:
    """A decoder of KTX2 files in Basis Universal: the largest level as ``png``, in RGBA."""
    import numpy as np
    import opengl_basisu
    from PIL import Image

    def decode(data: bytes, settings: dict[str, Any]) -> dict[str, NDArray[Any]]:
        pixels = opengl_basisu.open(data).transcode(opengl_basisu.Target.RGBA8).data
        png = io.BytesIO()
        Image.fromarray(pixels).save(png, "PNG", compress_level=1)
        return {"png": np.frombuffer(png.getbuffer(), np.uint8)}

    return decode


DECODERS: Final = {"basis": basis, "draco": draco, "meshopt": meshopt}


def main(decoder: str, memory: int, seconds: int) -> None:
    """Decode all parts from stdin within limits of memory (bytes) and processor time (seconds)."""
    del sys.path[0]  # this folder, whose modules have names of libraries
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    data = sys.stdin.buffer.read()
    for kind, limit in ((resource.RLIMIT_DATA, memory), (resource.RLIMIT_CPU, seconds), (resource.RLIMIT_CORE, 0)):
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(kind, (limit, limit))
    import numpy as np

    decode = DECODERS[decoder]()
    at = 0
    while at < len(data):
        words, size = struct.unpack_from("<QQ", data, at)
        middle = at + 16 + words
        arrays = decode(data[middle : middle + size], json.loads(data[at + 16 : middle]))
        packed = io.BytesIO()
        np.savez(packed, **arrays)  # type: ignore[arg-type]
        sys.stdout.buffer.write(struct.pack("<Q", packed.getbuffer().nbytes))
        sys.stdout.buffer.write(packed.getbuffer())
        sys.stdout.buffer.flush()
        at = middle + size


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
