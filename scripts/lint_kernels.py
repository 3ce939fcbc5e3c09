"""Check the rules that keep kernels exact and portable: `clrender.plugins.kernel_rules`, and those of whole files.

``python scripts/lint_kernels.py [FOLDER]`` prints the faults and exits with 1 when there is one.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from clrender.device.source import expand
from clrender.errors import RenderError
from clrender.plugins.kernel_rules import COMMENT, FAST_MATH, line_faults

__all__ = ["lint", "lint_text"]

ROOT: Final = Path(__file__).resolve().parent.parent


def lint(folder: Path) -> list[str]:
    """Faults of every kernel file below `folder`, each as ``file:line: what``.

    Parameters
    ----------
    folder : Path
        The kernels folder, to which includes are relative.
    """
    faults = []
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        name = path.relative_to(folder).as_posix()
        if path.suffix not in (".cl", ".h", ".inc"):
            faults.append(
                f"{name}:1: kernels are .cl (entry points), .h (functions) or .inc (text included several times)"
            )
            continue
        faults += lint_text(name, path.read_text(encoding="utf-8"))
        if path.suffix == ".cl":
            faults += _lint_program(name, folder)
    return faults


def lint_text(name: str, text: str) -> list[str]:
    """Faults in the text of one file.

    Parameters
    ----------
    name : str
        Path below the kernels folder.
    text : str
    """
    faults = [f"{name}:{line}: {what}" for line, what in line_faults(name, text)]
    if not text.startswith("//"):
        faults.append(f"{name}:1: the first line says, in a // comment, what the file is for")
    guard = re.sub(r"\W", "_", name).upper()
    guarded = re.search(rf"^#ifndef {guard}\n#define {guard}$", text, re.MULTILINE)
    if name.endswith(".h") and not guarded:
        faults.append(f"{name}:1: a header has the include guard {guard}")
    return faults


def _lint_program(name: str, folder: Path) -> Iterator[str]:
    try:
        text = expand(name, folder)
    except RenderError as error:
        yield str(error)
        return
    code = COMMENT.sub("", text)
    if not re.search(r"\b(?:__)?kernel\s+(?:GROUPED\s+)?void\b", code):
        yield f"{name}:1: a .cl file holds entry points and this has none"


def _lint_host() -> Iterator[str]:
    for path in sorted((ROOT / "clrender").rglob("*.py")):
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            if found := FAST_MATH.search(line):
                yield f"{path.relative_to(ROOT)}:{number}: {found.group()} lets the compiler round differently"


def main(arguments: list[str]) -> int:
    """Print the faults; returns 0 if there are none."""
    faults = lint(Path(arguments[0]) if arguments else ROOT / "kernels")
    if not arguments:
        faults += _lint_host()
    for fault in faults:
        print(fault)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
