"""Check a device's arithmetic operations against exact results, to explain wrong images.

Bit-identical images require that ``+ - * / sqrt fma floor`` and conversions conform to IEEE 754, on scalars and
vectors.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from clrender.device.device import Device

__all__ = ["OPERATIONS", "check", "inputs", "reference"]

_Floats = npt.NDArray[np.float32]
_Words = npt.NDArray[np.uint32]

OPERATIONS: Final = ("+", "-", "*", "/", "sqrt", "fma", "floor", "int to float", "uint to float", "float to int")
COUNT: Final = 512
_NAN: Final = 0x7FC00000
# Zeros, denormals, neighbours of one, halves, limits of the integers and of the range.
_SPECIAL: Final = (
    0x00000000, 0x80000000, 0x00000001, 0x807FFFFF, 0x00400000, 0x00800000, 0x3F800000, 0xBF800000, 0x3F7FFFFF,
    0x3F800001, 0x3F000000, 0xBF000000, 0x3FC00000, 0x40490FDB, 0x4B000000, 0x4B7FFFFF, 0xCB000001, 0x4EFFFFFF,
    0xCEFFFFFF, 0x7F7FFFFF, 0xFF7FFFFF, 0x7F800000, 0xFF800000, 0x0DA24260, 0x60AD78EC, 0x3EAAAAAB,
)  # fmt: skip


def inputs() -> _Words:
    """Bit patterns of the operands a, b, c.

    Returns
    -------
    (COUNT, 3) uint32
        First pairs of special values, then random values of all magnitudes; no NaN.
    """
    words = np.empty(COUNT * 3, np.uint64)
    state = 1
    for index in range(words.size):
        state = (state * 6364136223846793005 + 1442695040888963407) % 2**64
        words[index] = state >> 32
    table = words.astype(np.uint32).reshape(COUNT, 3)
    # Half of the rows have magnitudes near one, where rounding differs most often.
    near = table[COUNT // 2 :]
    near[...] = (near & np.uint32(0x81FFFFFF)) | np.uint32(0x3E000000)
    table[: len(_SPECIAL), 0] = _SPECIAL
    table[: len(_SPECIAL), 1] = np.roll(_SPECIAL, 3)
    table[len(_SPECIAL) : 2 * len(_SPECIAL), 0] = _SPECIAL
    table[len(_SPECIAL) : 2 * len(_SPECIAL), 1] = np.roll(_SPECIAL, 7)
    nan = (table & np.uint32(0x7FFFFFFF)) > 0x7F800000
    table[nan] &= np.uint32(0xBF7FFFFF)
    return table


def reference(table: _Words) -> _Words:
    """Exact results, one column for each of `OPERATIONS`; every NaN as 0x7fc00000.

    Parameters
    ----------
    table : (n, 3) uint32
        Bit patterns of a, b, c.

    Returns
    -------
    (n, 10) uint32
    """
    a, b, c = (np.ascontiguousarray(table[:, k]).view(np.float32) for k in range(3))
    with np.errstate(all="ignore"):
        columns: list[_Floats] = [
            a + b,
            a - b,
            a * b,
            a / b,
            np.sqrt(np.abs(a)),
            np.array([_fma(*row) for row in zip(a, b, c, strict=True)], np.float32),
            np.floor(a),
            table[:, 0].view(np.int32).astype(np.float32),
            table[:, 0].astype(np.float32),
        ]
    words = np.stack([column.view(np.uint32) for column in columns], axis=1)
    words[np.isnan(words.view(np.float32))] = _NAN
    integers = np.trunc(np.clip(a.astype(np.float64), -2147483520.0, 2147483520.0)).astype(np.int32)
    return np.concatenate([words, integers.view(np.uint32)[:, None]], axis=1)


def _fma(a: np.float32, b: np.float32, c: np.float32) -> np.float32:
    """a * b + c, rounded once."""
    if not (np.isfinite(a) and np.isfinite(b) and np.isfinite(c)):
        return np.float32(float(a * b + c))
    exact = Fraction(float(a)) * Fraction(float(b)) + Fraction(float(c))
    if exact == 0:
        return np.float32(float(a * b + c)) if a * b == 0 else np.float32(0.0)
    # Round to odd in double precision, then to nearest: exact, as double has more than twice the precision.
    try:
        double = float(exact)
    except OverflowError:
        return np.float32(np.inf if exact > 0 else -np.inf)
    if Fraction(double) != exact and not int(np.float64(double).view(np.uint64)) & 1:
        double = float(np.nextafter(double, np.inf if exact > Fraction(double) else -np.inf))
    return np.float32(double)


def check(device: Device) -> list[str]:
    """Descriptions, with an example, of the operations of `device` that are not exact; empty if all are exact.

    Raises
    ------
    DeviceError
        When the device cannot build the kernel.
    RenderError
        When the launch fails.
    """
    table = inputs()
    program = device.program("probe/arithmetic.cl", {"LANES": 1})
    source = device.upload(table)
    target = device.empty(COUNT * len(OPERATIONS) * 4)
    wanted = reference(table)
    found: list[str] = []
    for kernel, per_item in (("arithmetic_scalar", 1), ("arithmetic_vector", 8)):
        result: npt.NDArray[Any] = np.zeros((COUNT, len(OPERATIONS)), np.uint32)
        device.write(target, result)
        device.launch(program, kernel, COUNT // per_item, 16, [source, target])
        device.read(target, result)
        found += _differences(table, wanted, result, "" if per_item == 1 else f" of float{per_item}")
    device.release(source)
    device.release(target)
    return found


def _differences(table: _Words, wanted: _Words, result: _Words, suffix: str) -> list[str]:
    found = []
    for column, name in enumerate(OPERATIONS):
        wrong = np.flatnonzero(wanted[:, column] != result[:, column])
        if wrong.size:
            row = int(wrong[0])
            operands = ", ".join(f"{value:#010x}" for value in table[row])
            found.append(
                f"{name}{suffix} differs on {wrong.size} of {len(table)} inputs, "
                f"first ({operands}): {result[row, column]:#010x} instead of {wanted[row, column]:#010x}"
            )
    return found
