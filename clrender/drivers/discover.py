"""Find the OpenCL drivers of this machine and of the Python environment, and load selected ones.

A driver is a library named by an `.icd` file, or a GPU vendor's library under its usual name. The OpenCL loader would
load all of them, once per process. Here each is loaded separately at its first use, by the extension that loaders use
(cl_khr_icd). So a driver that crashes affects only processes that use it, and further drivers can be loaded later.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import os
import platform
import site
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from clrender.device import cache, program_cache
from clrender.device.driver_settings import CACHES, DEFAULTS, PLACES, driver_settings
from clrender.device.forked import driver_loads, refuse_forked
from clrender.drivers import vendor_libraries
from clrender.errors import DeviceError

__all__ = ["Driver", "driver_variables", "drivers", "fingerprint", "load_platforms"]

SYSTEM_FOLDER: Final = Path("/etc/OpenCL/vendors")
# Variables that keep any OpenCL loader from loading drivers by itself.
_NO_DRIVERS: Final = {"OCL_ICD_VENDORS": os.devnull, "OCL_ICD_FILENAMES": ""}


@dataclass(frozen=True)
class Driver:
    """One OpenCL driver.

    Attributes
    ----------
    library : str
        Shared library, as passed to the loader; empty: any that the loader finds by itself.
    origin : str
        The `.icd` file that names it, or another description of its origin.
    path : str
        Path of the library; empty if it was not found.
    preload : tuple of str
        Libraries to load before it.
    fault : str
        Reason why it cannot be loaded, if known without trying.
    """

    library: str
    origin: str
    path: str = ""
    preload: tuple[str, ...] = ()
    fault: str = ""


def drivers() -> list[Driver]:
    """All drivers named by an `.icd` file, of the system or of the Python environment, in a stable order.

    They are followed by GPU drivers without such a file, found by their libraries' names. If ``OCL_ICD_VENDORS`` is
    set, only that place is searched. Nothing is loaded.
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
    if not own:
        for path in vendor_libraries.find([driver.path or driver.library for driver in found]):
            origin = f"found by its name in {path.parent}; no .icd file names it"
            found.append(Driver(str(path), origin, str(path), vendor_libraries.companions(str(path))))
    return found


def _icd_files(folder: Path) -> list[Path]:
    try:
        return sorted(path for path in folder.iterdir() if path.suffix == ".icd")
    except OSError:
        return []


def _prefixes() -> list[Path]:
    """Prefixes below which wheels install data files."""
    roots = [sys.prefix, os.environ.get("CONDA_PREFIX", ""), site.getuserbase()]
    return [Path(root) for root in dict.fromkeys(roots) if root]


def _wheel_folders() -> list[Path]:
    folders = [prefix / "etc" / "OpenCL" / "vendors" for prefix in _prefixes()]
    # Older PoCL wheels install into pyopencl's folder, later ones into their own.
    for entry in sys.path:
        if entry.endswith(("site-packages", "dist-packages")):
            folders += [Path(entry) / package / ".libs" for package in ("pyopencl", "pocl_binary_distribution")]
    return [folder for folder in folders if folder != SYSTEM_FOLDER]


def _read(icd: Path) -> Iterator[Driver]:
    """Drivers named by an `.icd` file. A wheel's file may hold a placeholder or a bare name of a library nearby."""
    try:
        library = icd.read_text(errors="replace").strip().splitlines()[0].strip()
    except (OSError, IndexError):
        yield Driver(str(icd), str(icd), fault="the file is empty or cannot be read")
        return
    places = [Path(library)] if "/" in library else vendor_libraries.search(library)
    name = Path(library).name
    in_wheel = icd.parent != SYSTEM_FOLDER and not os.environ.get("OCL_ICD_VENDORS")
    if in_wheel:
        places += [icd.parent / name, *(prefix / "lib" / name for prefix in _prefixes() if icd.is_relative_to(prefix))]
    path = next((str(place) for place in places if place.is_file()), "")
    if in_wheel and not path:
        return  # Intel's wheel also names an emulator that it does not contain
    preload = vendor_libraries.companions(path) if path else ()
    fault = f"it names {library}, which does not exist" if "/" in library and not path else ""
    found_by_name = bool(path) and "/" not in library and not vendor_libraries.linker_looks_in(Path(path))
    yield Driver(path if in_wheel or found_by_name else library, str(icd), path, preload, fault)


def driver_variables() -> dict[str, str]:
    """Environment variables that drivers need and the user has not set, with their values."""
    wanted = dict(DEFAULTS)
    folder = _pocl_folder()
    if folder is not None:
        # PoCL's cache inside ours, so that entries that crash processes are found and removed like others.
        wanted["POCL_CACHE_DIR"] = str(folder)
    return {name: value for name, value in wanted.items() if name not in os.environ}


def _pocl_folder() -> Path | None:
    folder = program_cache.compiler_folder()
    if folder is None:
        return None
    try:
        (folder / "pocl").mkdir(mode=0o700, exist_ok=True)
    except OSError:
        return None
    return folder / "pocl"


_loading = threading.Lock()
_loaded: Final[dict[str, list[Any]]] = {}
"""A driver's library -> its platforms, for the life of the process, as drivers cannot be unloaded."""


def load_platforms(wanted: Sequence[Driver]) -> list[Any]:
    """Load drivers and return their platforms; those of drivers already loaded are returned again.

    Parameters
    ----------
    wanted : sequence of Driver

    Returns
    -------
    list of pyopencl.Platform

    Raises
    ------
    DeviceError
        When pyopencl is not installed, none of the drivers could be loaded, or this process was forked from one that
        had loaded some.
    """
    refuse_forked()
    driver_loads()
    cl = _pyopencl()
    found: list[Any] = []
    faults: list[str] = []
    with _loading:
        for driver in wanted:
            try:
                if driver.library not in _loaded:
                    _loaded[driver.library] = _load(cl, driver)
                found += _loaded[driver.library]
            except DeviceError as error:
                faults.append(str(error))
    if not found:
        raise DeviceError("; ".join(faults) or "no OpenCL driver is installed; see `clrender doctor`")
    return found


def _pyopencl() -> Any:
    """The pyopencl module with its own cache disabled, which would store programs twice and fail if it cannot write."""
    with _variables({"PYOPENCL_NO_CACHE": "1"}):
        try:
            import pyopencl
            import pyopencl.invoker
        except ImportError as error:
            raise DeviceError(
                f"pyopencl cannot be imported ({error}); install it with `pip install pyopencl`"
            ) from error
        except OSError as error:
            # Happens only if the program imported it before, with its cache enabled.
            raise DeviceError(
                f"pyopencl cannot write its own cache ({error}); set PYOPENCL_NO_CACHE=1 before it is imported"
            ) from error
    return pyopencl


def _load(cl: Any, driver: Driver) -> list[Any]:
    """Load a driver and return its platforms. Devices are queried too, so that it reads its variables now."""
    variables = driver_variables()
    if "pocl" in driver.library.lower() and not {"POCL_CACHE_DIR"} & (variables.keys() | os.environ.keys()):
        raise DeviceError(
            f"{driver.library} needs a folder for what it compiles, and {cache.ROOM_BYTES >> 20} MiB are free in none; "
            "make room in the home folder or in /tmp, or set TMPDIR to a folder that has it"
        )
    if "intelocl" in driver.library:
        # It is unknown when the driver reads these for the last time, and without them results are wrong.
        os.environ.update({name: value for name, value in variables.items() if name.startswith("CL_CONFIG_")})
    try:
        if not driver.library:
            with _variables(variables):
                platforms = list(cl.get_platforms())
                _device_counts(cl, platforms)
            return platforms
        with _variables({**variables, **_NO_DRIVERS}):
            for library in driver.preload:
                with contextlib.suppress(OSError):
                    ctypes.CDLL(library, ctypes.RTLD_GLOBAL)
            platforms = [cl.Platform.from_int_ptr(pointer) for pointer in _platform_pointers(driver.library)]
            _device_counts(cl, platforms)
        return platforms
    except OSError as error:
        raise DeviceError(f"its library cannot be loaded: {error}") from error
    except cl.Error as error:
        raise DeviceError(f"{driver.library or driver.origin} offers no platform: {error}") from error


def _device_counts(cl: Any, platforms: Sequence[Any]) -> None:
    for platform_ in platforms:
        with contextlib.suppress(cl.Error):  # a platform without a device is no error
            platform_.get_devices()


def _platform_pointers(library: str) -> list[int]:
    """The ``cl_platform_id`` pointers that a driver gives to OpenCL loaders (extension cl_khr_icd), as integers.

    Raises
    ------
    OSError
        When the library cannot be loaded.
    DeviceError
        When it is not an OpenCL driver or offers no platform.
    """
    loaded = ctypes.CDLL(library)
    try:
        find = loaded.clGetExtensionFunctionAddress
    except AttributeError as error:
        raise DeviceError(f"{library} is no OpenCL driver: it lacks clGetExtensionFunctionAddress") from error
    find.restype, find.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
    address = find(b"clIcdGetPlatformIDsKHR")
    if not address:
        raise DeviceError(f"{library} is no driver for OpenCL loaders: it lacks clIcdGetPlatformIDsKHR")
    kind = ctypes.CFUNCTYPE(
        ctypes.c_int32, ctypes.c_uint32, ctypes.POINTER(ctypes.c_void_p), ctypes.POINTER(ctypes.c_uint32)
    )
    give, count = kind(address), ctypes.c_uint32(0)
    code = give(0, None, ctypes.byref(count))
    if code != 0 or count.value == 0:
        raise DeviceError(f"{library} offers no platform (its code is {code})")
    pointers = (ctypes.c_void_p * count.value)()
    code = give(count.value, pointers, None)
    if code != 0:
        raise DeviceError(f"{library} does not give its platforms (its code is {code})")
    return [int(pointer) for pointer in pointers if pointer]


@contextlib.contextmanager
def _variables(changes: Mapping[str, str]) -> Iterator[None]:
    """Set environment variables while a driver or the loader reads them; the user's values are restored afterwards."""
    before = {name: os.environ.get(name) for name in changes}
    os.environ.update(changes)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def fingerprint(driver: Driver) -> str:
    """Hash that changes with the driver, the machine, and the variables that configure drivers."""
    facts = [driver.library, driver.path, platform.node(), platform.machine(), sys.prefix, str(os.cpu_count())]
    if driver.path:
        facts.append(os.path.realpath(driver.path))
        with contextlib.suppress(OSError):  # it may be removed at any moment
            status = Path(driver.path).stat()
            facts += [str(status.st_mtime_ns), str(status.st_size)]
    facts += driver_settings() + _set(CACHES) + (_set(PLACES) if not driver.library else [])
    for folder, pattern in (("/dev/dri", "*"), ("/dev", "nvidia*"), ("/dev", "kfd")):
        facts += sorted(str(path) for path in Path(folder).glob(pattern))
    return hashlib.sha256("\n".join(facts).encode("utf-8", "surrogateescape")).hexdigest()


def _set(names: Sequence[str]) -> list[str]:
    return [f"{name}={os.environ[name]}" for name in names if name in os.environ]
