"""Files of named arrays that begin with ``tensor_file``, as the RGL database has them (Dupuy and Jakob 2018)."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.wording import quoted

__all__ = ["TENSOR_MAGIC", "read_tensors"]

TENSOR_MAGIC: Final = b"tensor_file\0"
_HEAD: Final = struct.Struct("<12sBBI")
_NAME_LENGTH: Final = struct.Struct("<H")
_FIELD: Final = struct.Struct("<HBQ")
_KINDS: Final = ("u1", "i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f2", "<f4", "<f8")
"""Types of numbers, from code 1 on."""
_MOST_FIELDS: Final = 64
_MOST_NAME: Final = 256
_MOST_AXES: Final = 8


def read_tensors(content: NDArray[np.uint8]) -> Mapping[str, NDArray[Any]]:
    """The arrays of a file, which are views of its content.

    Parameters
    ----------
    content : (N,) uint8

    Raises
    ------
    ValueError
        It is no such file, or a damaged one.
    """
    head = content[: _HEAD.size].tobytes()
    if len(head) < _HEAD.size or not head.startswith(TENSOR_MAGIC):
        raise ValueError("it does not begin with tensor_file and a whole head")
    _, major, minor, count = _HEAD.unpack(head)
    if (major, minor) != (1, 0):
        raise ValueError(f"its version is {major}.{minor}, but 1.0 is known")
    if count > _MOST_FIELDS:
        raise ValueError(f"it says that it has {count} fields")
    fields: dict[str, NDArray[Any]] = {}
    at = _HEAD.size
    for _ in range(count):
        length = _NAME_LENGTH.unpack(_bytes(content, at, _NAME_LENGTH.size))[0]
        if not 0 < length <= _MOST_NAME:
            raise ValueError("the name of a field has an impossible length")
        name = _bytes(content, at + _NAME_LENGTH.size, length).decode("utf-8", "replace")
        at += _NAME_LENGTH.size + length
        axes, kind, offset = _FIELD.unpack(_bytes(content, at, _FIELD.size))
        at += _FIELD.size
        if axes > _MOST_AXES or not 1 <= kind <= len(_KINDS):
            raise ValueError(f"the field {quoted(name[:40])} has an unknown type or too many axes")
        shape = struct.unpack(f"<{axes}Q", _bytes(content, at, 8 * axes))
        at += 8 * axes
        fields[name] = _array(content, offset, np.dtype(_KINDS[kind - 1]), shape, name)
    return fields


def _bytes(content: NDArray[np.uint8], at: int, count: int) -> bytes:
    if at + count > len(content):
        raise ValueError("it ends within its list of fields")
    return content[at : at + count].tobytes()


def _array(
    content: NDArray[np.uint8], offset: int, kind: np.dtype[Any], shape: tuple[int, ...], name: str
) -> NDArray[Any]:
    size = math.prod(shape) * kind.itemsize
    if offset + size > len(content) or any(side > len(content) for side in shape):
        raise ValueError(f"the field {quoted(name[:40])} reaches beyond its end")
    return content[offset : offset + size].view(kind).reshape(shape)
