"""Builds from an emptied folder: files that were deleted since an earlier build do not stay in the package."""

from __future__ import annotations

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build import build

__all__: list[str] = []


class _Build(build):
    def run(self) -> None:
        """Remove what an earlier build left, which setuptools would pack again."""
        shutil.rmtree(Path(self.build_lib) / "clrender", ignore_errors=True)
        super().run()


setup(cmdclass={"build": _Build})
