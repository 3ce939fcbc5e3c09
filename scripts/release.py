"""Check that this tree is ready to be the release of its version, and build the files of the release.

The steps are: the tree is clean; the version has no tag yet and is later than those released before; CHANGELOG.md has
a dated section of it below an empty `Unreleased`; CITATION.cff, docs/versions.json and the generated pages are of it;
then the site, sdist and wheel are built, and the package is checked. Files go to dist/. Nothing is uploaded, and no tag
is set.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import runpy
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from clrender.files.kernel_hash import kernels_sha256
from clrender.version import __version__

__all__ = ["changelog_faults", "citation_faults", "faults", "table_faults"]

ROOT: Final = Path(__file__).resolve().parents[1]
_GENERATED: Final = {
    "man_page": "man/clrender.1",
    "scene_docs": "docs/scene-file.md",
    "setting_docs": "docs/settings.md",
    "rooms": "docs/architecture.md",
}
"""Pages by the script that makes them."""
_LONG: Final = {
    "the documentation site": ["scripts/docs"],
    "sdist, wheel and package": ["scripts/package_check", "--keep", "dist"],
}


def changelog_faults(changes: str, version: str) -> Iterator[str]:
    """What keeps a changelog from being that of a release.

    Parameters
    ----------
    changes : str
        Text of CHANGELOG.md.
    version : str
    """
    sections = re.split(r"^## (.*)$", changes, flags=re.MULTILINE)[1:]
    titles, texts = sections[::2], sections[1::2]
    if titles[:1] != ["Unreleased"] or texts[0].strip():
        yield "CHANGELOG.md must begin with an empty section `## Unreleased`"
    dated = [re.fullmatch(r"(\d+\.\d+\.\d+) – (\d{4}-\d{2}-\d{2})", title) for title in titles[1:]]
    if wrong := [title for title, match in zip(titles[1:], dated, strict=True) if match is None]:
        yield f"CHANGELOG.md: `## {wrong[0]}` must be `## VERSION – YYYY-MM-DD`"
    versions = [match[1] for match in dated if match]
    if versions[:1] != [version]:
        yield f"CHANGELOG.md: the section below `## Unreleased` must be that of {version}"
    numbers = [tuple(map(int, each.split("."))) for each in versions]
    if sorted(set(numbers), reverse=True) != numbers:
        yield "CHANGELOG.md: versions must descend; bump the version in clrender/version.py"


def citation_faults(citation: str, changes: str, version: str) -> Iterator[str]:
    """What of the citation is not of the release.

    Parameters
    ----------
    citation : str
        Text of CITATION.cff.
    changes : str
        Text of CHANGELOG.md.
    version : str
    """
    told = dict(re.findall(r"^([\w-]+): *(.*?) *$", citation, re.MULTILINE))
    if told.get("version") != version or f"## {version} – {told.get('date-released')}" not in changes.splitlines():
        yield f"CITATION.cff: `version` and `date-released` must be those of {version} in CHANGELOG.md"


def table_faults(table: str, version: str, kernels: str) -> Iterator[str]:
    """What of the table of known images is not of the release.

    Parameters
    ----------
    table : str
        Text of docs/versions.json.
    version : str
    kernels : str
        Hash of the kernels.
    """
    entry = json.loads(table).get(version, {})
    if entry.get("kernel_sha256") != kernels:
        yield "docs/versions.json is not of these kernels; run `python scripts/version_docs.py --record`"


def _git(*words: str) -> str:
    done = subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"FAILED  git {' '.join(words)}: {done.stderr.strip()}")
    return done.stdout.rstrip()


def _tree_faults() -> Iterator[str]:
    if changed := _git("status", "--porcelain"):
        yield f"the tree has changes that are not committed: {', '.join(line[3:] for line in changed.splitlines()[:5])}"
    if _git("tag", "--list", f"v{__version__}"):
        yield f"there is a tag v{__version__} already; bump the version in clrender/version.py"


def _generated_faults() -> Iterator[str]:
    for script, name in _GENERATED.items():
        page = (ROOT / name).read_text()
        if runpy.run_path(str(ROOT / "scripts" / f"{script}.py"))["current"](page) != page:
            yield f"{name} is stale; run `python scripts/{script}.py`"


def faults() -> Iterator[tuple[str, list[str]]]:
    """Each of the quick checks, with what is wrong."""
    changes = (ROOT / "CHANGELOG.md").read_text()
    citation = (ROOT / "CITATION.cff").read_text()
    table = (ROOT / "docs" / "versions.json").read_text()
    checks: dict[str, Callable[[], Iterator[str]]] = {
        "tree and tag": _tree_faults,
        "changelog": lambda: changelog_faults(changes, __version__),
        "citation": lambda: citation_faults(citation, changes, __version__),
        "kernels and known images": lambda: table_faults(table, __version__, kernels_sha256()),
        "generated pages": _generated_faults,
    }
    for name, check in checks.items():
        yield name, list(check())


def main() -> int:
    """Check, build and say what is left to do; returns 1 after a fault."""
    parser = argparse.ArgumentParser(prog="scripts/release", description=__doc__)
    parser.add_argument("--dry-run", action="store_true", help="only the quick checks; builds nothing")
    options = parser.parse_args()
    failed = False
    for name, found in faults():
        failed |= bool(found)
        print("\n".join(f"FAILED  {name}: {fault}" for fault in found) or f"ok      {name}", flush=True)
    for name, command in _LONG.items():
        if options.dry_run or failed:
            print(f"not run {name}: {' '.join(command)}")
            continue
        failed |= subprocess.run([str(ROOT / command[0]), *command[1:]], cwd=ROOT, check=False).returncode != 0
        print(f"{'FAILED ' if failed else 'ok     '} {name}", flush=True)
    if failed:
        print("release: FAILED")
        return 1
    if options.dry_run:
        print(f"release: {__version__} is ready to be built")
        return 0
    for path in sorted((ROOT / "dist").glob(f"clrender-{__version__}*")):
        print(f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.relative_to(ROOT)}")
    print(f"release: {__version__} is built. Left to do: the tag v{__version__}; publish dist/ and build/site")
    return 0


if __name__ == "__main__":
    sys.exit(main())
