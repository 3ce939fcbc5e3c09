"""Estimates of a render's host memory, and checks against the limit before it is allocated."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from contextlib import suppress
from math import isqrt
from pathlib import Path
from typing import Final

from clrender.errors import MemoryRefused, UsageError
from clrender.wording import counted

__all__ = [
    "ERROR_BYTES",
    "IMAGE_BYTES",
    "check_host",
    "check_image",
    "film_bytes",
    "largest_tile",
    "process_bytes",
    "room",
    "shown",
    "unit_slots",
]

_SUM_BYTES: Final = 52
"""Bytes of a pixel's exact sums and its count, on the host and on a device."""
_SQUARE_BYTES: Final = 96
"""Bytes of a pixel's sums of squared replicates."""
IMAGE_BYTES: Final = 12
"""Bytes per pixel of the image."""
ERROR_BYTES: Final = 144
"""Bytes per pixel while the errors of all pixels are evaluated (`clrender.film.convergence.judge`)."""

_UNIT_SHARE: Final = 64
"""A unit may take at most one part in this many of the allowed memory: about ten units may wait on the host."""


def shown(nbytes: float) -> str:
    """Format an amount of memory."""
    for unit, size in (("GiB", 2**30), ("MiB", 2**20), ("KiB", 2**10)):
        if nbytes >= size:
            return f"{nbytes / size:.1f} {unit}"
    return counted(int(nbytes), "byte")


def film_bytes(replicates: bool) -> int:
    """Bytes per pixel of a film, or of a unit."""
    return _SUM_BYTES + _SQUARE_BYTES * replicates


def unit_slots(limit: int | None, replicates: bool = False) -> int | None:
    """Most slots of a unit if `limit` bytes are allowed; None: no limit."""
    return None if limit is None else max(16, limit // (_UNIT_SHARE * film_bytes(replicates)))


def largest_tile(limit: int | None, tile: int, replicates: bool = False) -> int:
    """Side of a tile, pixels, reduced if needed so that a unit can hold a tile within the limit."""
    slots = unit_slots(limit, replicates)
    return tile if slots is None else max(4, min(tile, isqrt(slots) // 4 * 4))


def check_image(width: int, height: int, limit: int | None, pixel_bytes: int = _SUM_BYTES) -> None:
    """Refuse an image that takes more memory than exists or is allowed, before anything is read.

    Parameters
    ----------
    width, height : int
    limit : int or None
        Allowed bytes.
    pixel_bytes : int
        See `film_bytes`.

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
    """Refuse a render that takes more memory than is allowed, before its film is allocated.

    Parameters
    ----------
    limit : int or None
        Allowed bytes; None: all of the machine's.
    needs : mapping of str to int
        Bytes needed at one time, by purpose.

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


def room(limit: int | None) -> float:
    """Bytes that a render may take where it could do with less: half of what is allowed, or of the machine's."""
    return (limit or _machine_bytes() or math.inf) / 2


def process_bytes() -> int:
    """Bytes that this process holds now; 0 if the system does not report it."""
    with suppress(OSError):
        if match := re.search(r"VmRSS:\s+(\d+) kB", Path("/proc/self/status").read_text(errors="replace")):
            return int(match[1]) * 1024
    return 0


def _machine_bytes() -> int | None:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):  # the system does not report it
        return None
