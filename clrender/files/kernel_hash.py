"""Hash of the kernels: which light transport an image was rendered with. Cheap to import, as `--version` prints it."""

from __future__ import annotations

import hashlib
import re
from functools import cache
from pathlib import Path
from typing import Final

from clrender.files.package_data import kernels_folder

__all__ = ["kernel_files", "kernels_sha256"]

_INCLUDES: Final = re.compile(rb'#[ \t]*include[ \t]*"([^"\n]+)"')


def kernels_sha256(root: Path | None = None) -> str:
    """Hash of the kernel files of all programs, including their names; the cache key of verdicts about drivers.

    These are the entry points, `*.cl`, and what they include. Other files in the folder do not matter.

    Parameters
    ----------
    root : Path, optional
        Folder of the kernels; default: the installed ones, which are read only once.
    """
    return _hash_of(root) if root else _hash_once(kernels_folder())


def kernel_files(folder: Path) -> list[Path]:
    """All files of a folder that are kernels or may be included by them, sorted.

    Parameters
    ----------
    folder : Path
    """
    return sorted(path for path in folder.rglob("*") if path.suffix in (".cl", ".h", ".inc"))


def _hash_of(folder: Path) -> str:
    known = {path.relative_to(folder).as_posix().encode(): path for path in kernel_files(folder)}
    reached = {name for name in known if name.endswith(b".cl")}
    contents: dict[bytes, bytes] = {}
    while left := reached - contents.keys():
        contents |= {name: known[name].read_bytes() for name in left}
        reached |= {other for name in left for other in _INCLUDES.findall(contents[name])} & known.keys()
    digest = hashlib.sha256()
    for name in known:
        if name in contents:
            digest.update(b"%b\0%d\0" % (name, len(contents[name])) + contents[name])
    return digest.hexdigest()


_hash_once = cache(_hash_of)
