"""Reads NumPy's file format (NEP 1, "A simple file format for NumPy arrays") without evaluating headers; writes it.

NumPy's own reader tokenizes headers, warns about them, and trusts the sizes in them.
"""

from __future__ import annotations

import ast
import math
import os
from dataclasses import dataclass
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.wording import counted

__all__ = ["NpyHeader", "read_npy_header", "read_npy_items", "write_npy"]

_HEADER_LIMIT: Final = 4096


@dataclass(frozen=True)
class NpyHeader:
    """Header of a file: type and shape of its array.

    Attributes
    ----------
    kind : numpy.dtype
    shape : tuple of int
    fortran : bool
        Whether the first index varies fastest.
    """

    kind: np.dtype[Any]
    shape: tuple[int, ...]
    fortran: bool

    def __str__(self) -> str:
        return f"{str(self.kind)[:20]} {str(self.shape)[:60]}"


def write_npy(file: IO[bytes], array: NDArray[Any]) -> None:
    """Write an array, little-endian and in C order. NumPy's own writer does not report why a disk refused.

    Parameters
    ----------
    file : binary file
    array : ndarray
        Of numbers.

    Raises
    ------
    OSError
        With its `errno`.
    """
    plain = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
    header = {"descr": plain.dtype.str, "fortran_order": False, "shape": plain.shape}
    np.lib.format.write_array_header_1_0(file, header)
    file.write(plain.reshape(-1).view(np.uint8).data)


def read_npy_header(file: IO[bytes]) -> NpyHeader:
    """Read the header, up to the start of the data.

    Raises
    ------
    ValueError
        When the header is invalid.
    """
    start = file.read(8)
    if len(start) < 8 or start[:6] != b"\x93NUMPY" or start[6] not in (1, 2, 3):
        raise ValueError("it does not begin as NumPy's files do")
    length = int.from_bytes(file.read(2 if start[6] == 1 else 4), "little")
    if length > _HEADER_LIMIT:
        raise ValueError(f"its header is longer than {counted(_HEADER_LIMIT, 'byte')}")
    try:
        header = ast.literal_eval(file.read(length).decode("latin-1").strip())
        kind, shape, fortran = np.dtype(str(header["descr"])), tuple(header["shape"]), bool(header["fortran_order"])
    except Exception:
        raise ValueError("its header cannot be read") from None
    if kind.hasobject or not all(type(size) is int and size >= 0 for size in shape):
        raise ValueError(f"it holds {str(kind)[:20]} {str(shape)[:60]}")
    return NpyHeader(kind, shape, fortran)


def read_npy_items(file: IO[bytes], header: NpyHeader) -> NDArray[Any]:
    """Read the array that the header describes.

    Parameters
    ----------
    file : binary file
        A real file, positioned after its header.
    header : NpyHeader

    Raises
    ------
    ValueError
        When the file holds fewer or more bytes.
    """
    size = math.prod(header.shape) * header.kind.itemsize
    held = os.fstat(file.fileno()).st_size - file.tell()
    if held != size:
        raise ValueError(f"it has {counted(max(held, 0), 'byte')} of numbers, but its header promises {size}")
    order = "F" if header.fortran else "C"
    return np.frombuffer(file.read(size), header.kind).reshape(header.shape, order=order)  # type: ignore[call-overload,no-any-return]
