"""Huge pages for memory with random access: they cause fewer TLB misses."""

from __future__ import annotations

import mmap

__all__ = ["LARGE_BYTES", "prefer_large_pages"]

LARGE_BYTES = 4 << 20
"""Smallest block worth it: of smaller ones, too small a part consists of whole pages of two MiB."""

_ADVICE = getattr(mmap, "MADV_HUGEPAGE", None)  # only Linux has it


def prefer_large_pages(address: int, nbytes: int) -> None:
    """Ask the system to back a block of this process's memory, not written to yet, with huge pages.

    This is only a hint: it has no effect if the system has no huge pages or denies them.

    Parameters
    ----------
    address, nbytes : int
        Start and size of the block, bytes.
    """
    if _ADVICE is None:
        return
    import ctypes  # imported here because few processes need it, and it loads slowly

    begin = -(-address // mmap.PAGESIZE) * mmap.PAGESIZE
    end = (address + nbytes) // mmap.PAGESIZE * mmap.PAGESIZE
    ctypes.CDLL(None).madvise(ctypes.c_void_p(begin), ctypes.c_size_t(end - begin), ctypes.c_int(_ADVICE))
