"""Optional packages: which of them an operation lacks, and the command that installs them into this environment."""

from __future__ import annotations

import shlex
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import TypeVar

from clrender.errors import ClrenderError, UsageError

__all__ = ["install_command", "lacking", "missing_extra", "packages"]

_Error = TypeVar("_Error", bound=ClrenderError)


def packages(extra: str) -> list[str]:
    """Requirements of an extra, as declared by the installed package.

    Parameters
    ----------
    extra : str
        Such as ``view``; one that names no other extras.

    Returns
    -------
    list of str
        Requirements for pip, each with the environment that it is for, if not for all. Empty if clrender is used
        without having been installed.
    """
    from importlib.metadata import PackageNotFoundError, requires

    try:
        declared = requires("clrender") or []
    except PackageNotFoundError:
        return []
    found = []
    for line in declared:
        name, _, marker = line.partition(";")
        environment, belongs, _ = marker.strip().replace("'", '"').rpartition(f'extra == "{extra}"')
        if belongs:
            environment = environment.removesuffix(" and ").strip()
            found.append(f"{name.strip()}; {environment}" if environment else name.strip())
    return found


def install_command(extra: str) -> str:
    """The shell command that installs an extra for this Python.

    It names the packages of the extra and not clrender, which may have come from a clone, a wheel or a repository.
    """
    needed = packages(extra)
    if not needed:
        # A clone that was not installed: the folder of `setup.cfg` is known, and pip reads the extra from there.
        needed = [f"{Path(__file__).resolve().parents[1]}[{extra}]"]
    has_pip = find_spec("pip") is not None
    pip = [sys.executable, "-m", "pip", "install"] if has_pip else ["uv", "pip", "install", "--python", sys.executable]
    return shlex.join([*pip, *needed])


def lacking(extra: str, error: _Error) -> _Error:
    """Mark an error as one that installing an extra cures; `scripts/clrender` then installs it."""
    error.extra = extra
    return error


def missing_extra(extra: str, problem: str) -> UsageError:
    """The error of an operation that lacks an extra; `problem` says which operation needs what."""
    return lacking(extra, UsageError(f"{problem}; install it with `{install_command(extra)}`"))
