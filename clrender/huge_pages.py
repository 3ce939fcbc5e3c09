"""Large pages for memory that processors jump about in: fewer of them to look up on the way to it."""

from __future__ import annotations

import mmap

__all__ = ["LARGE_BYTES", "prefer_large_pages"]

LARGE_BYTES = 4 << 20
"""Below this too little of a piece of memory is whole pages of two MiB."""

_ADVICE = getattr(mmap, "MADV_HUGEPAGE", None)  # only Linux has it


def prefer_large_pages(address: int, nbytes: int) -> None:
    """Ask the system for large pages under a piece of this process's memory that nothing was written to yet.

    It is a wish: where the system has none, or may not give them, all goes on as before.

    Parameters
    ----------
    address, nbytes : int
        Where it begins, and its size.
    """
    if _ADVICE is None:
        return
    import ctypes  # here because few processes need it, and it takes time

    begin = -(-address // mmap.PAGESIZE) * mmap.PAGESIZE
    end = (address + nbytes) // mmap.PAGESIZE * mmap.PAGESIZE
    ctypes.CDLL(None).madvise(ctypes.c_void_p(begin), ctypes.c_size_t(end - begin), ctypes.c_int(_ADVICE))
