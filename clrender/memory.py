"""How much memory a render takes on the host: told, and refused where it is too much, before it is taken."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from contextlib import suppress
from math import isqrt
from pathlib import Path
from typing import Final

from clrender.errors import MemoryRefused, UsageError

__all__ = [
    "ERROR_BYTES",
    "IMAGE_BYTES",
    "check_host",
    "check_image",
    "film_bytes",
    "largest_tile",
    "process_bytes",
    "shown",
    "unit_slots",
]

_SUM_BYTES: Final = 52
"""Of a pixel's exact sums and its count, on the host and on a device."""
_SQUARE_BYTES: Final = 96
"""Of the squares of its replicates."""
IMAGE_BYTES: Final = 12
"""Of a pixel of the image."""
ERROR_BYTES: Final = 144
"""Of a pixel while the errors of all pixels are judged (`clrender.film.convergence.judge`)."""

_UNIT_SHARE: Final = 64
"""Of the memory that is allowed, one unit takes so small a part: some ten of them may wait on the host."""


def shown(nbytes: float) -> str:
    """An amount of memory in words."""
    for unit, size in (("GiB", 2**30), ("MiB", 2**20), ("KiB", 2**10)):
        if nbytes >= size:
            return f"{nbytes / size:.1f} {unit}"
    return f"{int(nbytes)} bytes"


def film_bytes(replicates: bool) -> int:
    """Memory of a pixel of a film, or of a unit."""
    return _SUM_BYTES + _SQUARE_BYTES * replicates


def unit_slots(limit: int | None, replicates: bool = False) -> int | None:
    """Slots of a unit at most, where that many bytes are allowed; None: no limit."""
    return None if limit is None else max(16, limit // (_UNIT_SHARE * film_bytes(replicates)))


def largest_tile(limit: int | None, tile: int, replicates: bool = False) -> int:
    """Side of a tile, for which a unit has to have room."""
    slots = unit_slots(limit, replicates)
    return tile if slots is None else max(4, min(tile, isqrt(slots) // 4 * 4))


def check_image(width: int, height: int, limit: int | None, pixel_bytes: int = _SUM_BYTES) -> None:
    """Refuse an image that takes more memory than there is, or than is allowed, before anything is read.

    Parameters
    ----------
    width, height : int
    limit : int or None
        Bytes that are allowed.
    pixel_bytes : int
        As of `film_bytes`.

    Raises
    ------
    UsageError
    """
    wanted = width * height * (pixel_bytes + IMAGE_BYTES)
    cure = "ask for a smaller one"
    if limit is not None and wanted > limit:
        raise UsageError(
            f"an image of {width} x {height} pixels takes {shown(wanted)} of memory, {pixel_bytes} bytes a pixel for "
            f"exact sums and {IMAGE_BYTES} for the image, and --max-memory (max_memory) allows {shown(limit)}; {cure}, "
            "or allow more"
        )
    machine = _machine_bytes()
    if machine is not None and wanted > machine:
        raise UsageError(
            f"an image of {width} x {height} pixels takes {shown(wanted)} of memory and this machine has "
            f"{shown(machine)}; {cure}"
        )


def check_host(limit: int | None, needs: Mapping[str, int]) -> int:
    """Refuse a render that takes more than is allowed, before its film is made.

    Parameters
    ----------
    limit : int or None
        Bytes; None: as many as there are.
    needs : mapping of str to int
        What is needed at one time, for what.

    Returns
    -------
    int
        Bytes needed in all.

    Raises
    ------
    MemoryRefused
    """
    total = sum(needs.values())
    if limit is not None and total > limit:
        parts = ", ".join(f"{shown(nbytes)} for {what}" for what, nbytes in needs.items() if nbytes)
        raise MemoryRefused(
            f"the render takes {shown(total)} of the host's memory ({parts}), and --max-memory (max_memory) allows "
            f"{shown(limit)}; allow more, ask for a smaller image, or take a smaller scene"
        )
    return total


def process_bytes() -> int:
    """Memory that this program holds now; 0 where the system does not tell."""
    with suppress(OSError):
        if match := re.search(r"VmRSS:\s+(\d+) kB", Path("/proc/self/status").read_text(errors="replace")):
            return int(match[1]) * 1024
    return 0


def _machine_bytes() -> int | None:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):  # a system that does not tell
        return None
