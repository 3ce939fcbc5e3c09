"""Parts of OpenVDB's and NanoVDB's files that are compressed, by zip or by blosc."""

from __future__ import annotations

import struct
import zlib
from importlib.util import find_spec
from typing import Final

from clrender.errors import SceneError
from clrender.extras import install_command, lacking

__all__ = ["require_blosc", "unblosced", "unzipped"]

_BLOSC_HEAD: Final = 16


def require_blosc(label: str) -> None:
    """Refuse a file that is compressed by blosc where its library is not installed.

    Parameters
    ----------
    label : str
        Beginning of the error message.

    Raises
    ------
    SceneError
        The extra `vdb` is missing.
    """
    if find_spec("numcodecs") is None:
        text = f"{label} is compressed by blosc, which needs numcodecs"
        cure = f"install it with `{install_command('vdb')}`, or write the file with zip"
        raise lacking("vdb", SceneError(f"{text}; {cure}"))


def unzipped(data: bytes, size: int) -> bytes:
    """What zip has compressed.

    Parameters
    ----------
    data : bytes
    size : int
        Of the result, bytes.

    Raises
    ------
    ValueError
        The data are damaged, or of another size.
    """
    inflater = zlib.decompressobj()
    try:
        raw = inflater.decompress(data, size + 1)  # one more than is right, as 0 would be no limit
    except zlib.error as error:
        raise ValueError(f"a part of it cannot be decompressed: {error}") from None
    if len(raw) != size or not inflater.eof:
        raise ValueError("a decompressed part has another size than it should have")
    return raw


def unblosced(data: bytes, size: int) -> bytes:
    """What blosc has compressed. See `unzipped`."""
    from numcodecs.blosc import decompress

    if len(data) < _BLOSC_HEAD or struct.unpack("<2I", data[4:8] + data[12:16]) != (size, len(data)):
        raise ValueError("a compressed part has another size than it should have")
    try:
        return bytes(decompress(data))
    except RuntimeError as error:
        raise ValueError(f"a part of it cannot be decompressed: {error}") from None
