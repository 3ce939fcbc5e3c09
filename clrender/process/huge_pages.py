"""Huge pages for memory with random access: they cause fewer TLB misses."""

from __future__ import annotations

import mmap

__all__ = ["LARGE_BYTES", "prefer_large_pages", "withdraw_preference"]

LARGE_BYTES = 4 << 20
"""Smallest block worth it: of smaller ones, too small a part consists of whole pages of two MiB."""

# Only Linux has these
_HUGE = getattr(mmap, "MADV_HUGEPAGE", None)
_NOT_HUGE = getattr(mmap, "MADV_NOHUGEPAGE", None)


def prefer_large_pages(address: int, nbytes: int) -> None:
    """Ask the system to back a block of this process's memory, not written to yet, with huge pages.

    This is only a hint: it has no effect if the system has no huge pages or denies them.

    Parameters
    ----------
    address, nbytes : int
        Start and size of the block, bytes.
    """
    _advise(address, nbytes, _HUGE)


def withdraw_preference(address: int, nbytes: int) -> None:
    """Withdraw `prefer_large_pages`, before the block is freed.

    Otherwise the preference stays with the addresses, where `malloc` puts small blocks next: each of them would then
    occupy two MiB.

    Parameters
    ----------
    address, nbytes
        As of `prefer_large_pages`.
    """
    _advise(address, nbytes, _NOT_HUGE)


def _advise(address: int, nbytes: int, advice: int | None) -> None:
    if advice is None:
        return
    import ctypes  # imported here because few processes need it, and it loads slowly

    begin = -(-address // mmap.PAGESIZE) * mmap.PAGESIZE
    end = (address + nbytes) // mmap.PAGESIZE * mmap.PAGESIZE
    ctypes.CDLL(None).madvise(ctypes.c_void_p(begin), ctypes.c_size_t(end - begin), ctypes.c_int(advice))
