"""Find GPU drivers without an `.icd` file by the names of their libraries.

Containers in the cloud get the driver's libraries from the host, often in a separate folder and without the `.icd` file
that OpenCL loaders look for. Nothing is loaded here.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

__all__ = ["LIBRARIES", "companions", "find", "linker_looks_in", "search"]

LIBRARIES: Final = ("libnvidia-opencl.so.1", "libamdocl64.so", "libigdrcl.so")
"""File names of the drivers of NVIDIA, AMD and Intel."""

_FOLDERS: Final = (
    "/usr/lib/x86_64-linux-gnu",
    "/usr/lib/aarch64-linux-gnu",
    "/lib/x86_64-linux-gnu",
    "/usr/lib64",
    "/usr/lib",
    "/usr/local/lib",
    "/usr/lib/wsl/lib",
)
# The dynamic linker does not search these by default.
_VENDOR_FOLDERS: Final = (
    "/usr/local/nvidia/lib64",
    "/usr/local/nvidia/lib",
    "/usr/lib/x86_64-linux-gnu/nvidia/current",
    "/usr/lib/x86_64-linux-gnu/intel-opencl",
    "/opt/rocm/lib",
    "/opt/rocm/opencl/lib",
)
_LINKER_CACHE: Final = Path("/etc/ld.so.cache")

# Dependencies of a driver that the dynamic linker does not find beside it, in the order of loading.
_COMPANIONS: Final = (
    ("libintelocl", ("libtbb.so.12", "libintlc.so.5", "libirng.so", "libimf.so", "libsvml.so")),
    (
        "libnvidia-opencl",
        ("libcuda.so.1", "libnvidia-nvvm.so.4", "libnvidia-gpucomp.so.*", "libnvidia-ptxjitcompiler.so.1"),
    ),
)


def search(library: str) -> list[Path]:
    """Possible paths of a library given by its file name; not all of them exist.

    These are from LD_LIBRARY_PATH, the dynamic linker's cache, its default folders, and the usual folders of GPU
    drivers.

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
    """Existing libraries of `LIBRARIES`, each in the first place that has it, except those already known.

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
    """Paths of a library in the dynamic linker's cache, where paths are null-terminated."""
    try:
        cache = _LINKER_CACHE.read_bytes()
    except OSError:
        return []
    return [
        Path(os.fsdecode(path))
        for path in re.findall(rb"/[^\0]*/" + re.escape(os.fsencode(library)) + rb"(?=\0)", cache)
    ]


def companions(path: str) -> tuple[str, ...]:
    """Libraries beside a driver's library that must be loaded before it.

    Parameters
    ----------
    path : str
        Path of the driver's library.
    """
    folder, name = Path(path).parent, Path(path).name
    patterns = next((patterns for start, patterns in _COMPANIONS if name.startswith(start)), ())
    return tuple(str(file) for pattern in patterns for file in sorted(folder.glob(pattern))[:1])
