"""Find the drivers of GPUs by the names of their libraries, where no `.icd` file names them.

Containers of rented machines get the driver's libraries from the host, often in a folder of their own and without the
`.icd` file that OpenCL loaders look for. Nothing is loaded here.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

__all__ = ["LIBRARIES", "companions", "find", "linker_looks_in", "search"]

LIBRARIES: Final = ("libnvidia-opencl.so.1", "libamdocl64.so", "libigdrcl.so")
"""What the drivers of NVIDIA, AMD and Intel are called, wherever they lie."""

_FOLDERS: Final = (
    "/usr/lib/x86_64-linux-gnu",
    "/usr/lib/aarch64-linux-gnu",
    "/lib/x86_64-linux-gnu",
    "/usr/lib64",
    "/usr/lib",
    "/usr/local/lib",
    "/usr/lib/wsl/lib",
)
# The dynamic linker does not look there, unless its own settings say so.
_VENDOR_FOLDERS: Final = (
    "/usr/local/nvidia/lib64",
    "/usr/local/nvidia/lib",
    "/usr/lib/x86_64-linux-gnu/nvidia/current",
    "/usr/lib/x86_64-linux-gnu/intel-opencl",
    "/opt/rocm/lib",
    "/opt/rocm/opencl/lib",
)
_LINKER_CACHE: Final = Path("/etc/ld.so.cache")

# What a driver asks the dynamic linker for, which does not look beside it: in the order in which they need each other.
_COMPANIONS: Final = (
    ("libintelocl", ("libtbb.so.12", "libintlc.so.5", "libirng.so", "libimf.so", "libsvml.so")),
    (
        "libnvidia-opencl",
        ("libcuda.so.1", "libnvidia-nvvm.so.4", "libnvidia-gpucomp.so.*", "libnvidia-ptxjitcompiler.so.1"),
    ),
)


def search(library: str) -> list[Path]:
    """Where a library named without a folder may lie; not all of the places exist.

    LD_LIBRARY_PATH, the dynamic linker's cache, its usual folders, and those that drivers of GPUs are put into.

    Parameters
    ----------
    library : str
        File name.
    """
    folders = [folder for folder in os.environ.get("LD_LIBRARY_PATH", "").split(":") if folder]
    places = [Path(folder) / library for folder in folders] + _cached(library)
    return places + [Path(folder) / library for folder in (*_FOLDERS, *_VENDOR_FOLDERS)]


def linker_looks_in(path: Path) -> bool:
    """Whether the dynamic linker finds this library by its name alone."""
    folders = [*os.environ.get("LD_LIBRARY_PATH", "").split(":"), *_FOLDERS]
    return str(path.parent) in folders or path in _cached(path.name)


def find(known: Sequence[str]) -> Iterator[Path]:
    """Libraries of `LIBRARIES` that exist, each in the first place that has it, but for those that are known already.

    Parameters
    ----------
    known : sequence of str
        Paths or names of the drivers that `.icd` files name.
    """
    names = {Path(each).name for each in known}
    files = {os.path.realpath(each) for each in known}
    for library in LIBRARIES:
        path = next((place for place in search(library) if place.is_file()), None)
        if path and library not in names and os.path.realpath(path) not in files:
            yield path


def _cached(library: str) -> list[Path]:
    """Where the dynamic linker's cache says that a library is: paths in it end with a zero each."""
    try:
        cache = _LINKER_CACHE.read_bytes()
    except OSError:
        return []
    return [
        Path(os.fsdecode(path))
        for path in re.findall(rb"/[^\0]*/" + re.escape(os.fsencode(library)) + rb"(?=\0)", cache)
    ]


def companions(path: str) -> tuple[str, ...]:
    """Libraries beside a driver's that have to be loaded before it.

    Parameters
    ----------
    path : str
        Of the driver's library.
    """
    folder, name = Path(path).parent, Path(path).name
    patterns = next((patterns for start, patterns in _COMPANIONS if name.startswith(start)), ())
    return tuple(str(file) for pattern in patterns for file in sorted(folder.glob(pattern))[:1])
