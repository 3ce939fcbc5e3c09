"""What a film adds up, by Python's integers: quanta of 2^-64, modulo 2^128."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["fixed_point", "quanta"]


def quanta(value: float | np.float32) -> int:
    """A float32 below 2^43 in magnitude as the film counts it: times 2^64 it is exact in double precision, then cut."""
    return int(float(value) * 2.0**64)


def fixed_point(values: npt.NDArray[np.float32]) -> npt.NDArray[np.uint32]:
    """The quanta of each value as two's complement numbers, (..., 4) uint32, least significant word first."""
    numbers = [(quanta(value) % 2**128).to_bytes(16, "little") for value in values.ravel().tolist()]
    return np.frombuffer(b"".join(numbers), "<u4").astype(np.uint32).reshape(*values.shape, 4)
