"""Find the OpenCL drivers of this machine and of the Python environment, and load those that are wanted.

A driver is what an `.icd` file names. The loader inside the pyopencl wheel reads one folder of such files, once in the
life of a process, so a private folder with exactly the wanted ones is written before it looks.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import os
import platform
import site
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from clrender.device import cache
from clrender.errors import DeviceError

if TYPE_CHECKING:
    import pyopencl as cl

__all__ = ["Driver", "drivers", "environment", "fingerprint", "load_platforms", "settings"]

SYSTEM_FOLDER: Final = Path("/etc/OpenCL/vendors")
_LIBRARY_FOLDERS: Final = (
    "/usr/lib/x86_64-linux-gnu",
    "/usr/lib/aarch64-linux-gnu",
    "/lib/x86_64-linux-gnu",
    "/usr/lib64",
    "/usr/lib",
    "/usr/local/lib",
    "/usr/lib/wsl/lib",
)
# Intel's wheel puts these beside the driver, where the dynamic linker does not look.
_INTEL_PRELOAD: Final = ("libtbb.so.12", "libintlc.so.5", "libirng.so", "libimf.so", "libsvml.so")
# Set before any driver loads, unless the user has set them.
_DEFAULTS: Final = {
    "RUSTICL_ENABLE": "llvmpipe",  # without it rusticl is a platform with no device
    "CL_CONFIG_CPU_VECTORIZER_MODE": "1",  # Intel's vectoriser miscompiles: measured, a path tracer lost its paths
}
# Variables that change which devices there are or what they compute.
_TELLING: Final = (
    "RUSTICL_",
    "POCL_",
    "CL_CONFIG_",
    "OCL_",
    "OCLGRIND_",
    "LIBGL_",
    "MESA_",
    "GALLIUM_",
    "LP_",
    "CUDA_",
)
_TELLING_NAMES: Final = ("LD_PRELOAD", "LD_LIBRARY_PATH", "ROCR_VISIBLE_DEVICES", "ZE_AFFINITY_MASK")


@dataclass(frozen=True)
class Driver:
    """One OpenCL driver.

    Attributes
    ----------
    library : str
        Shared library, as the loader is told; empty: whatever the loader finds by itself.
    origin : str
        The `.icd` file that names it.
    path : str
        Where the library lies, or empty when it was not found.
    preload : tuple of str
        Libraries to load before it.
    fault : str
        Why it cannot be loaded, where that is plain without trying.
    """

    library: str
    origin: str
    path: str = ""
    preload: tuple[str, ...] = ()
    fault: str = ""


def drivers() -> list[Driver]:
    """Every driver that an `.icd` file names, of the system or of the Python environment, in a stable order.

    ``OCL_ICD_VENDORS``, when set, is the only place looked at. Nothing is loaded.
    """
    if "oclgrind" in os.environ.get("LD_PRELOAD", "") or platform.system() != "Linux":
        return [Driver("", "the OpenCL loader of the system")]
    own = os.environ.get("OCL_ICD_VENDORS", "")
    if own:
        place = Path(own)
        files = [place] if place.is_file() else _icd_files(place)
    else:
        files = _icd_files(SYSTEM_FOLDER) + [file for folder in _wheel_folders() for file in _icd_files(folder)]
    found: list[Driver] = []
    for driver in (driver for file in files for driver in _read(file)):
        if all((driver.path or driver.library) != (known.path or known.library) for known in found):
            found.append(driver)
    return found


def _icd_files(folder: Path) -> list[Path]:
    try:
        return sorted(path for path in folder.iterdir() if path.suffix == ".icd")
    except OSError:
        return []


def _prefixes() -> list[Path]:
    """Roots that wheels install data files below."""
    roots = [sys.prefix, os.environ.get("CONDA_PREFIX", ""), site.getuserbase()]
    return [Path(root) for root in dict.fromkeys(roots) if root]


def _wheel_folders() -> list[Path]:
    folders = [prefix / "etc" / "OpenCL" / "vendors" for prefix in _prefixes()]
    # The PoCL wheel lies inside pyopencl's own folder, later ones in their own.
    for entry in sys.path:
        if entry.endswith(("site-packages", "dist-packages")):
            folders += [Path(entry) / package / ".libs" for package in ("pyopencl", "pocl_binary_distribution")]
    return [folder for folder in folders if folder != SYSTEM_FOLDER]


def _read(icd: Path) -> Iterator[Driver]:
    """What an `.icd` file names. A wheel's may hold a placeholder or a bare name: its library lies near by then."""
    try:
        library = icd.read_text(errors="replace").strip().splitlines()[0].strip()
    except (OSError, IndexError):
        yield Driver(str(icd), str(icd), fault="the file is empty or cannot be read")
        return
    places = [Path(library)] if "/" in library else _search(library)
    name = Path(library).name
    in_wheel = icd.parent != SYSTEM_FOLDER and not os.environ.get("OCL_ICD_VENDORS")
    if in_wheel:
        places += [icd.parent / name, *(prefix / "lib" / name for prefix in _prefixes() if icd.is_relative_to(prefix))]
    path = next((str(place) for place in places if place.is_file()), "")
    if in_wheel and not path:
        return  # Intel's wheel also names an emulator it does not bring: nobody asked for it
    preload: tuple[str, ...] = ()
    if path and name.startswith("libintelocl"):
        beside = (Path(path).parent / each for each in _INTEL_PRELOAD)
        preload = tuple(str(each) for each in beside if each.is_file())
    fault = f"it names {library}, which does not exist" if "/" in library and not path else ""
    yield Driver(path if in_wheel else library, str(icd), path, preload, fault)


def _search(library: str) -> list[Path]:
    folders = [*os.environ.get("LD_LIBRARY_PATH", "").split(":"), *_LIBRARY_FOLDERS]
    return [Path(folder) / library for folder in folders if folder]


def environment() -> None:
    """Set the variables drivers need before they load, where the user has not set them."""
    for name, value in _DEFAULTS.items():
        os.environ.setdefault(name, value)
    # PoCL's kernels among ours: then a cache that kills whoever loads it is found and renewed with the rest.
    os.environ.setdefault("POCL_CACHE_DIR", str(_pocl_folder()))


def _pocl_folder() -> Path:
    folder = cache.compiler_folder() / "pocl"
    folder.mkdir(exist_ok=True)
    return folder


def load_platforms(wanted: Sequence[Driver]) -> list[cl.Platform]:
    """Load drivers and give their platforms; a later call in the same process gives the same platforms again.

    Parameters
    ----------
    wanted : sequence of Driver
        Only these are loaded, should none be loaded yet.

    Raises
    ------
    DeviceError
        When pyopencl is not installed or none of the drivers could be loaded.
    """
    environment()
    try:
        import pyopencl as cl
    except ImportError as error:
        raise DeviceError(f"pyopencl cannot be imported ({error}); install it with `pip install pyopencl`") from error
    for library in (library for driver in wanted for library in driver.preload):
        with contextlib.suppress(OSError):
            ctypes.CDLL(library, ctypes.RTLD_GLOBAL)
    with _private_vendors(wanted):
        try:
            return list(cl.get_platforms())
        except cl.Error as error:
            names = ", ".join(driver.library or driver.origin for driver in wanted) or "none is installed"
            raise DeviceError(f"no OpenCL driver could be loaded ({names}): {error}; see `clrender doctor`") from error


@contextlib.contextmanager
def _private_vendors(wanted: Sequence[Driver]) -> Iterator[None]:
    """Point the loader to a folder with exactly the wanted drivers while it looks."""
    libraries = [driver.library for driver in wanted]
    if "" in libraries:
        yield
        return
    name = hashlib.sha256("\n".join(libraries).encode()).hexdigest()[:16]
    folder = cache.cache_folder() / "vendors" / name
    for number, library in enumerate(libraries):
        file = folder / f"{number:02}.icd"
        if not file.is_file() or file.read_text() != library + "\n":
            cache.write_atomically(file, (library + "\n").encode())
    folder.mkdir(parents=True, exist_ok=True)
    before = os.environ.get("OCL_ICD_VENDORS")
    os.environ["OCL_ICD_VENDORS"] = str(folder)
    try:
        yield
    finally:
        # Processes started later shall see what the user set, not our folder.
        if before is None:
            del os.environ["OCL_ICD_VENDORS"]
        else:
            os.environ["OCL_ICD_VENDORS"] = before


def fingerprint(driver: Driver) -> str:
    """Hash that changes when a driver, the machine, or a variable that steers drivers changes."""
    facts = [driver.library, driver.path, platform.node(), platform.machine(), sys.prefix, str(os.cpu_count())]
    if driver.path:
        status = Path(driver.path).stat()
        facts += [os.path.realpath(driver.path), str(status.st_mtime_ns), str(status.st_size)]
    facts += settings()
    for folder, pattern in (("/dev/dri", "*"), ("/dev", "nvidia*"), ("/dev", "kfd")):
        facts += sorted(str(path) for path in Path(folder).glob(pattern))
    return hashlib.sha256("\n".join(facts).encode()).hexdigest()


def settings() -> list[str]:
    """Variables that steer drivers, with their values, as they are once `environment` was called."""
    told = {name: value for name, value in os.environ.items() if name.startswith(_TELLING) or name in _TELLING_NAMES}
    told = {**_DEFAULTS, **told}
    return [f"{name}={told[name]}" for name in sorted(told) if name not in ("POCL_CACHE_DIR", "OCL_ICD_VENDORS")]
