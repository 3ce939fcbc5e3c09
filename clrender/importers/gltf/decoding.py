"""Decodes compressed data by libraries, in a separate process: damaged data may crash them or exhaust memory."""

from __future__ import annotations

import io
import json
import struct
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError

__all__ = ["Encoded", "decoded"]

_CHILD: Final = Path(__file__).with_name("decoding_child.py")
_MEMORY: Final = 768 << 20
"""Memory of the process before it decodes anything, bytes: of NumPy, mostly address space."""
_CPU_SECONDS: Final = 4
"""Processor time for its start."""
_SECONDS: Final = 20.0
"""Time allowed for its start on a busy machine, in addition to its computation."""
_SHARE: Final = 5
"""The computation may take this many times its processor time."""


@dataclass(frozen=True)
class Encoded:
    """Compressed data.

    Attributes
    ----------
    data : bytes
    settings : mapping of str to int or str
        What a decoder needs to know besides; see ``decoding_child.py``.
    """

    data: bytes
    settings: Mapping[str, int | str] = field(default_factory=dict)


def decoded(
    source: str, decoder: str, parts: Sequence[Encoded], memory: int, seconds: int
) -> list[dict[str, NDArray[Any]]]:
    """Decode the parts, one after another, up to the first one that fails or exceeds the limits.

    Parameters
    ----------
    source : str
        Name of the file, with which the message begins.
    decoder : str
        ``draco``, ``meshopt`` or ``basis``.
    parts : sequence of Encoded
    memory : int
        Limit of the memory that decoding takes, bytes.
    seconds : int
        Limit of its processor time.

    Returns
    -------
    list of dict of str to numpy.ndarray
        Arrays by name, of fewer parts than were given if one of them failed.

    Raises
    ------
    SceneError
        The process cannot be started.
    """
    limits = memory + _MEMORY, seconds + _CPU_SECONDS
    try:
        answer = subprocess.run(
            [sys.executable, str(_CHILD), decoder, *map(str, limits)],
            input=b"".join(_framed(part) for part in parts),
            capture_output=True,
            timeout=_SECONDS + _SHARE * seconds,
            check=False,
        ).stdout
    except subprocess.TimeoutExpired as error:
        answer = error.stdout or b""
    except OSError as error:
        why = f"the process that decodes {decoder} data cannot be started: {error.strerror}"
        raise SceneError(f"{source}: {why}") from None
    return list(_answers(answer))


def _framed(part: Encoded) -> bytes:
    settings = json.dumps(dict(part.settings)).encode()
    return b"".join((struct.pack("<QQ", len(settings), len(part.data)), settings, part.data))


def _answers(answer: bytes) -> Iterator[dict[str, NDArray[Any]]]:
    """All complete answers."""
    view, at = memoryview(answer), 0
    while len(answer) >= at + 8:
        (size,) = struct.unpack_from("<Q", answer, at)
        packed = view[at + 8 : at + 8 + size]
        if len(packed) < size:
            return
        with np.load(io.BytesIO(packed), allow_pickle=False) as archive:
            yield dict(archive)
        at += 8 + size
