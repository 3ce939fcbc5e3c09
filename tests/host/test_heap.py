"""Large blocks are returned to the system, by the command and by workers of clusters."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from typing import Final

import pytest

pytestmark = pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another malloc")

_MAPPED: Final = """
import ctypes, sys
import numpy as np

class Info(ctypes.Structure):
    _fields_ = [(name, ctypes.c_int) for name in
                "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost".split()]

libc = ctypes.CDLL(None)
libc.mallinfo.restype = Info
{begin}
for _ in range(4):
    np.ones(1 << 21)  # 16 MiB: when it is freed, glibc raises its threshold
before = libc.mallinfo().hblks
block = np.ones(1 << 18)  # 2 MiB
print(libc.mallinfo().hblks - before)
"""


def mapped_blocks(begin: str, **environment: str) -> int:
    """How many blocks are mapped for an array of 2 MiB, in a process that has freed larger ones."""
    text = _MAPPED.replace("{begin}", begin)
    done = subprocess.run(
        [sys.executable, "-c", text], capture_output=True, text=True, check=True, env=os.environ | environment
    )
    return int(done.stdout.split()[-1])


@pytest.mark.parametrize(
    "begin",
    [
        "from clrender.process.heap import return_large_blocks\nreturn_large_blocks()",
        "import clrender.__main__ as program\nsys.argv = ['clrender', '--version']\n"
        "try:\n    program.main()\nexcept SystemExit:\n    pass",
        "from clrender.cluster.remote import RemoteRenderer\nkept = RemoteRenderer()",
    ],
    ids=["function", "command", "worker"],
)
def test_a_large_block_is_mapped_on_its_own(begin: str) -> None:
    assert mapped_blocks("") == 0, "glibc does so itself, and the setting has no use"
    assert mapped_blocks(begin) == 1


def test_the_environment_goes_first() -> None:
    setting = "from clrender.process.heap import return_large_blocks\nreturn_large_blocks()"
    assert mapped_blocks(setting, MALLOC_MMAP_THRESHOLD_=str(1 << 24)) == 0


_FREED: Final = """
import ctypes
from clrender.process.heap import return_free_pages

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096 >> 20

libc = ctypes.CDLL(None)
libc.malloc.restype, libc.malloc.argtypes, libc.free.argtypes = ctypes.c_void_p, [ctypes.c_size_t], [ctypes.c_void_p]
blocks = [libc.malloc(60000) for _ in range(4000)]  # 229 MiB
for block in blocks:
    ctypes.memset(block, 1, 60000)
full = resident()
for block in blocks[:-1]:  # the last one keeps the pages before it
    libc.free(block)
freed = resident()
return_free_pages()
print(full - freed, freed - resident())
"""


def test_pages_that_hold_no_block_are_returned() -> None:
    done = subprocess.run([sys.executable, "-c", _FREED], capture_output=True, text=True, check=True)
    by_itself, returned = map(int, done.stdout.split())
    assert by_itself < 20, "glibc does so itself, and the function has no use"
    assert returned > 200
