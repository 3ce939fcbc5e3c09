"""Builds from an emptied folder, so that deleted files do not stay in the package, and names the commit.

`clrender --version` reads the commit from `clrender/commit.txt`, which exists in sdists and wheels only.
"""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

from setuptools import setup
from setuptools.command.build import build
from setuptools.command.sdist import sdist

__all__: list[str] = []

ROOT = Path(__file__).resolve().parent


class _Build(build):
    def run(self) -> None:
        """Remove what an earlier build left, which setuptools would pack again."""
        shutil.rmtree(Path(self.build_lib) / "clrender", ignore_errors=True)
        super().run()
        _stamp(Path(self.build_lib))


class _Sdist(sdist):
    def make_release_tree(self, base_dir: str, files: list[str]) -> None:
        """Name the commit in the sdist, too, as what is built from it has no git."""
        super().make_release_tree(base_dir, files)
        _stamp(Path(base_dir))


def _stamp(folder: Path) -> None:
    """Write the commit into the package in a folder, if this is a clone and git is there."""
    if (commit := _commit()) is not None and (folder / "clrender").is_dir():
        (folder / "clrender" / "commit.txt").write_text(f"{commit}\n")


def _commit() -> str | None:
    if not (ROOT / ".git").exists():
        return None
    try:
        head, changes = (
            subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=True).stdout.strip()
            for words in (["rev-parse", "HEAD"], ["status", "--porcelain", "--untracked-files=no"])
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return f"{head}-dirty" if changes else head


setup(cmdclass={"build": _Build, "sdist": _Sdist})
