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
