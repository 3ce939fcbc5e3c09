"""Reads a USD stage in a process of its own: `stage_child.py MEMORY SECONDS`, its limits; damaged files may crash USD.

Stdin: the request as JSON, see `clrender.importers.usd.process.read_stage`. Stdout: the size of the answer's JSON (8
bytes, little-endian), the JSON, and an ``.npz`` of the arrays that it names by number.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import resource
import struct
import sys
from pathlib import Path
from typing import Any

__all__: list[str] = []


def main(memory: int, seconds: int) -> None:
    """Answer the request from stdin within limits of memory (bytes) and processor time (seconds)."""
    sys.path[0] = str(Path(__file__).resolve().parents[3])
    # Threads of a library that is used for one file: their start costs more than they gain
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "PXR_WORK_THREAD_LIMIT": "1"}
    request: dict[str, Any] = json.loads(sys.stdin.buffer.read())
    import numpy as np

    from clrender.errors import SceneError
    from clrender.importers.usd.extraction import extracted

    for kind, limit in ((resource.RLIMIT_DATA, memory), (resource.RLIMIT_CPU, seconds), (resource.RLIMIT_CORE, 0)):
        with contextlib.suppress(OSError, ValueError):
            # Above the lower limit of time a signal says what happened
            resource.setrlimit(kind, (limit, limit + 5 if kind == resource.RLIMIT_CPU else limit))
    arrays: list[Any] = []
    try:
        answer = extracted(request, arrays)
    except SceneError as error:
        answer, arrays = {"error": str(error)}, []
    text = json.dumps(answer).encode()
    packed = io.BytesIO()
    np.savez(packed, **{str(number): array for number, array in enumerate(arrays)})
    sys.stdout.buffer.write(struct.pack("<Q", len(text)))
    sys.stdout.buffer.write(text)
    sys.stdout.buffer.write(packed.getbuffer())
    sys.stdout.buffer.flush()
    # Without the destructors of a library that may have been damaged by what it read
    os._exit(0)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
