"""Version, commit and kernel hash: what `clrender --version` prints, from git's own files or a build's stamp."""

from __future__ import annotations

import configparser
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from cases import for_each

import clrender
from clrender.files.kernel_hash import kernels_sha256
from clrender.version import _commit, info

ROOT = Path(__file__).resolve().parents[2]
A, B = "0123456789" * 4, "abcdef0123" * 4


def package(folder: Path, files: dict[str, str], kernels: bool = True) -> Path:
    """The package of a clone that holds nothing else than its folders and these files."""
    for name in ("clrender", *(["kernels"] if kernels else [])):
        (folder / name).mkdir(parents=True)
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder / "clrender"


CLONES: dict[str, tuple[dict[str, str], str | None]] = {
    "a branch": ({".git/HEAD": "ref: refs/heads/main\n", ".git/refs/heads/main": f"{A}\n"}, A),
    "no branch": ({".git/HEAD": f"{B}\n"}, B),
    "a packed branch": (
        {
            ".git/HEAD": "ref: refs/heads/main\n",
            ".git/packed-refs": f"# pack-refs with: peeled\n{B} refs/heads/main2\n{A} refs/heads/main\n^{B}\n",
        },
        A,
    ),
    "a branch that is packed and newer": (
        {
            ".git/HEAD": "ref: refs/heads/a/b\n",
            ".git/refs/heads/a/b": f"{A}\n",
            ".git/packed-refs": f"{B} refs/heads/a/b\n",
        },
        A,
    ),
    "a worktree": (
        {
            ".git": "gitdir: main/.git/worktrees/w\n",
            "main/.git/worktrees/w/HEAD": "ref: refs/heads/w\n",
            "main/.git/worktrees/w/commondir": "../..\n",
            "main/.git/refs/heads/w": f"{A}\n",
            "main/.git/HEAD": f"{B}\n",
        },
        A,
    ),
    "a worktree with a packed branch": (
        {
            ".git": "gitdir: main/.git/worktrees/w\n",
            "main/.git/worktrees/w/HEAD": "ref: refs/heads/w\n",
            "main/.git/worktrees/w/commondir": "../..\n",
            "main/.git/packed-refs": f"{A} refs/heads/w\n",
        },
        A,
    ),
    "a stamp": ({"clrender/commit.txt": f"{A}-dirty\n", ".git/HEAD": f"{B}\n"}, f"{A}-dirty"),
    "no commit yet": ({".git/HEAD": "ref: refs/heads/main\n"}, None),
    "no git": ({}, None),
    "a file of other text": ({".git": "nothing", "clrender/commit.txt": "nothing"}, None),
}
"""Files of a clone, and the commit."""


@for_each("case", CLONES)
def test_the_commit_is_read_without_git(tmp_path: Path, case: str) -> None:
    files, commit = CLONES[case]
    assert _commit(package(tmp_path, files)) == commit


def test_the_repository_around_an_installed_package_is_not_its_own(tmp_path: Path) -> None:
    files, commit = CLONES["a branch"]
    assert commit and _commit(package(tmp_path, files, kernels=False)) is None


def test_git_says_the_same() -> None:
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("no clone")
    done = subprocess.run(["git", "-C", str(ROOT), "rev-parse", "HEAD"], capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(done.stderr)
    assert info().commit == done.stdout.strip()


def test_python_tells_what_the_command_prints() -> None:
    told = clrender.version.info()
    assert (told.version, told.kernel_sha256) == (clrender.__version__, kernels_sha256())
    command = [sys.executable, "-X", "importtime", "-m", "clrender", "--version"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    commit = [f"commit {told.commit}"] if told.commit else []
    assert done.stdout.splitlines() == [f"clrender {told.version}", *commit, f"kernels {told.kernel_sha256}"]
    assert not [line for line in done.stderr.splitlines() if line.endswith(("numpy", "pyopencl", "pydantic"))]


def test_the_citation_is_of_the_last_release() -> None:
    yaml = pytest.importorskip("yaml")
    told = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    setup = configparser.ConfigParser()
    setup.read(ROOT / "setup.cfg")
    assert {"cff-version", "message", "title", "authors"} <= set(told)
    assert (told["cff-version"], told["title"], told["type"]) == ("1.2.0", "clrender", "software")
    assert told["version"] == clrender.__version__ or "dev" in clrender.__version__
    assert told["license"] == setup["metadata"]["license"]
    assert told["authors"] == [{"name": "The clrender developers"}]
    assert f"  version = {{{told['version']}}},\n" in (ROOT / "docs" / "cite.md").read_text()
    headings = [line for line in (ROOT / "CHANGELOG.md").read_text().splitlines() if line.startswith("## ")]
    assert headings[:2] == ["## Unreleased", f"## {told['version']} – {told['date-released']}"]
