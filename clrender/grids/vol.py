"""Mitsuba's files of grids, ``.vol``: a head of 48 bytes, and numbers of which x runs fastest, then y, then z."""

from __future__ import annotations

import os
import struct
from collections.abc import Mapping
from typing import Any, BinaryIO, Final

import numpy as np

from clrender.errors import SceneError
from clrender.grids.data import SIDE_LIMIT, VALUE_LIMIT, GridData
from clrender.wording import counted

__all__ = ["read_vol"]

_HEAD: Final = struct.Struct("<3sBi3ii6f")
_KINDS: Final[Mapping[int, np.dtype[Any]]] = {1: np.dtype("<f4"), 2: np.dtype("<f2"), 3: np.dtype("u1")}
"""Types of numbers; those of one byte stand for 0 to 1."""


def read_vol(file: BinaryIO, label: str) -> GridData:
    """Read a grid of one channel, or of three, which are a colour.

    Parameters
    ----------
    file : binary file
    label : str
        Beginning of error messages.

    Raises
    ------
    SceneError
        It has another number of channels, or numbers that are not allowed.
    ValueError
        It is no such file.
    """
    data = file.read(_HEAD.size)
    if len(data) < _HEAD.size or data[:3] != b"VOL":
        raise ValueError("it does not begin with VOL and a whole head")
    _, version, kind, nx, ny, nz, channels, *box = _HEAD.unpack(data)
    if version != 3 or kind not in _KINDS:
        raise ValueError(f"its version is {version} and its type of numbers {kind}; known are 3, and 1 to 3")
    if not all(1 <= side <= SIDE_LIMIT for side in (nx, ny, nz)) or nx * ny * nz > VALUE_LIMIT:
        raise ValueError(f"it says that it has {nx} x {ny} x {nz} numbers")
    if channels not in (1, 3):
        raise SceneError(
            f"{label} has {counted(channels, 'channel')}, but a number has one and a colour three; convert it"
        )
    size = nx * ny * nz * channels * _KINDS[kind].itemsize
    held = os.fstat(file.fileno()).st_size - _HEAD.size
    if held != size:
        raise ValueError(f"it has {counted(max(held, 0), 'byte')} of numbers, but its head promises {size}")
    numbers = np.frombuffer(file.read(size), _KINDS[kind]).reshape((nz, ny, nx) if channels == 1 else (nz, ny, nx, 3))
    values = numbers.astype(np.float32)
    if kind == 3:
        values /= np.float32(255.0)
    low, high = np.array(box[:3], np.float64), np.array(box[3:], np.float64)
    placement = np.eye(4)[:3]
    if np.isfinite(box).all() and (high > low).all():
        placement = np.concatenate([np.diag(high - low), low[:, None]], axis=1)
    return GridData.checked(values, label, placement)
