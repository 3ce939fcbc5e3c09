"""Optional packages: which of them an operation lacks, and the command that installs them into this environment."""

from __future__ import annotations

import platform
import re
import shlex
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import TypeVar

from clrender.errors import ClrenderError, UsageError

__all__ = ["install_command", "lacking", "missing_extra", "packages"]

_Error = TypeVar("_Error", bound=ClrenderError)

_COMPARISON = re.compile(r'(python_version|sys_platform|platform_machine) *(==|!=|>=|<=|>|<) *"([^"]*)"')


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

    It names the packages of the extra and not clrender, which may have come from a clone, a wheel or a repository:
    those that are for this Python and machine, so that no conditions are left to read.
    """
    parts = [requirement.partition(";") for requirement in packages(extra)]
    needed = [name.strip() for name, _, environment in parts if _holds(environment)]
    if not needed:
        # A clone that was not installed: the folder of `setup.cfg` is known, and pip reads the extra from there.
        needed = [f"{Path(__file__).resolve().parents[1]}[{extra}]"]
    has_pip = find_spec("pip") is not None
    pip = [sys.executable, "-m", "pip", "install"] if has_pip else ["uv", "pip", "install", "--python", sys.executable]
    return shlex.join([*pip, *needed])


def _holds(environment: str) -> bool:
    """Whether this is the environment that a requirement is for: comparisons joined by `and`, these by `or`."""

    def compared(found: re.Match[str]) -> str:
        name, relation, value = found.groups()
        if name == "python_version":
            here, there = sys.version_info[:2], tuple(int(each) for each in value.split("."))
            truth = {"==": here == there, "!=": here != there, ">=": here >= there, "<=": here <= there}
            return str({**truth, ">": here > there, "<": here < there}[relation])
        given = {"sys_platform": sys.platform, "platform_machine": platform.machine()}[name]
        return str((given == value) == (relation == "=="))

    known = _COMPARISON.sub(compared, environment).replace("(", "").replace(")", "")
    if not known.strip():
        return True
    return any(all(word.strip() == "True" for word in each.split(" and ")) for each in known.split(" or "))


def lacking(extra: str, error: _Error) -> _Error:
    """Mark an error as one that installing an extra cures; `scripts/clrender` then installs it."""
    error.extra = extra
    return error


def missing_extra(extra: str, problem: str) -> UsageError:
    """The error of an operation that lacks an extra; `problem` says which operation needs what."""
    return lacking(extra, UsageError(f"{problem}; install it with `{install_command(extra)}`"))
