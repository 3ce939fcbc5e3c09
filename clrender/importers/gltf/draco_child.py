"""Decodes Draco meshes in a separate process: damaged data may crash it or exhaust memory.

Run as a file, so that nothing of clrender is loaded. Stdin: for each mesh its size (8 bytes, little-endian) and its
bytes, until the end. Stdout, for each mesh as soon as it is decoded: the size and bytes of an ``.npz`` with ``faces``
and the attributes by unique id.
"""

from __future__ import annotations

import contextlib
import io
import os
import resource
import struct
import sys

__all__: list[str] = []

_MEMORY = 768 << 20
_MEMORY_OF_A_BYTE = 256
_BYTES_IN_A_SECOND = 500_000


def main() -> None:
    """Decode meshes from stdin; stops at the first one that fails, with a message on stderr."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    data = sys.stdin.buffer.read()
    memory, seconds = _MEMORY + _MEMORY_OF_A_BYTE * len(data), 4 + len(data) // _BYTES_IN_A_SECOND
    for kind, limit in ((resource.RLIMIT_DATA, memory), (resource.RLIMIT_CPU, seconds), (resource.RLIMIT_CORE, 0)):
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(kind, (limit, limit))
    import DracoPy
    import numpy as np

    at = 0
    while at < len(data):
        (size,) = struct.unpack_from("<Q", data, at)
        mesh = DracoPy.decode(data[at + 8 : at + 8 + size])
        arrays = {str(each["unique_id"]): np.asarray(each["data"]) for each in mesh.attributes}
        packed = io.BytesIO()
        np.savez(packed, faces=np.asarray(mesh.faces, np.uint32), **arrays)  # type: ignore[arg-type]
        sys.stdout.buffer.write(struct.pack("<Q", packed.getbuffer().nbytes) + packed.getvalue())
        sys.stdout.buffer.flush()
        at += 8 + size


if __name__ == "__main__":
    main()
