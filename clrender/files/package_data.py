"""Location of the kernels and the built-in scenes: inside the installed package, or beside it in a checkout."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from clrender.errors import RenderError

__all__ = ["integrator_names", "kernels_folder", "scenes_folder"]

_PACKAGE = Path(__file__).resolve().parent.parent


@cache
def _folder(name: str) -> Path:
    installed = _PACKAGE / name
    checkout = _PACKAGE.parent / name
    for folder in (installed, checkout):
        if folder.is_dir():
            return folder
    raise RenderError(
        f"the folder {name}/ is neither at {installed} nor at {checkout}: the installation is incomplete; "
        "install clrender again with `pip install --force-reinstall`"
    )


def kernels_folder() -> Path:
    """Folder of the OpenCL sources; their includes are relative to it.

    Raises
    ------
    RenderError
        When the installation lacks it.
    """
    return _folder("kernels")


def scenes_folder() -> Path:
    """Folder of the built-in scenes.

    Raises
    ------
    RenderError
        When the installation lacks it.
    """
    return _folder("scenes")


@cache
def integrator_names() -> tuple[str, ...]:
    """Names of the integrators, ``path`` first: the modules of `clrender.integrators`, without importing them."""
    names = {path.stem for path in (_PACKAGE / "integrators").glob("*.py")} - {"__init__", "descriptor"}
    return ("path", *sorted(names - {"path"}))
