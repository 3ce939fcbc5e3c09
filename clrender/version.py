"""Which clrender this is: version, commit and kernels. Cheap to import."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final, NamedTuple

__all__ = ["VersionInfo", "__version__", "info"]

__version__ = "0.1.0"

_PACKAGE: Final = Path(__file__).resolve().parent
_STAMP: Final = "commit.txt"
"""File in the package that names its commit; builds of sdists and wheels write it, where git knows the commit."""
_COMMIT: Final = re.compile(r"[0-9a-f]{40}([0-9a-f]{24})?(-dirty)?")


class VersionInfo(NamedTuple):
    """What identifies this program.

    Attributes
    ----------
    version : str
    commit : str or None
        Hash of the git commit: of an installed package the one it was built from, followed by ``-dirty`` if files had
        been changed; of a clone the one that is checked out. None if neither is known.
    kernel_sha256 : str
        Hash of the kernels, as in the statistics of a render.
    """

    version: str
    commit: str | None
    kernel_sha256: str


def info() -> VersionInfo:
    """Version, commit and kernel hash of the program that is running.

    Raises
    ------
    RenderError
        When the installation lacks its kernels.
    """
    from clrender.files.kernel_hash import kernels_sha256

    return VersionInfo(__version__, _commit(_PACKAGE), kernels_sha256())


def _commit(package: Path) -> str | None:
    """The commit of a package: its stamp's, else that of the clone around it."""
    stamp = _text(package / _STAMP)
    clone = package.parent
    found = stamp if stamp is not None else _head(clone) if (clone / "kernels").is_dir() else None
    return found if found is not None and _COMMIT.fullmatch(found) else None


def _head(clone: Path) -> str | None:
    """What `git rev-parse HEAD` prints, without git: its files are simpler than starting a process is quick."""
    folder = clone / ".git"
    link = _text(folder)
    if link is not None and link.startswith("gitdir: "):  # a worktree, or a submodule
        folder = clone / link[len("gitdir: ") :]
    shared = _text(folder / "commondir")
    common = folder if shared is None else folder / shared
    head = _text(folder / "HEAD") or ""
    if not head.startswith("ref: "):
        return head
    name = head[len("ref: ") :]
    for place in (folder, common):
        if (commit := _text(place / name)) is not None:
            return commit
    packed = (line.partition(" ") for line in (_text(common / "packed-refs") or "").splitlines())
    return next((commit for commit, _, ref in packed if ref == name), None)


def _text(path: Path) -> str | None:
    """The text of a file without blanks around it; None if it is no readable file."""
    try:
        return path.read_text(encoding="utf-8").strip()
    except (OSError, ValueError):
        return None
