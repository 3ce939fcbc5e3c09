"""Has the kernels of renders compiled with further macros."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from clrender.device import worker
from clrender.device.kernel_build import KernelBuild, kernel_build

__all__ = ["compile_with"]


def compile_with(monkeypatch: pytest.MonkeyPatch, **macros: int | str) -> None:
    """Define macros in the programs of all workers that are made from now on; programs that are there stay."""

    def more(*args: Any, **settings: Any) -> KernelBuild:
        made = kernel_build(*args, **settings)
        return replace(made, macros={**made.macros, **macros})

    monkeypatch.setattr(worker, "kernel_build", more)
