"""Check the rules by which arithmetic of the host has the same bits on every processor.

``python scripts/lint_host.py [FOLDER]`` prints the faults and exits with 1 when there is one.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

__all__ = ["lint", "lint_text"]

ROOT: Final = Path(__file__).resolve().parent.parent
_ROOMS: Final = (
    "exact/matrices.py",
    "exact/counters.py",
    "exact/elementary.py",
    "datasets/",
    "exporters/",
    "flatten/",
    "importers/",
    "meshes/",
    "photon/",
    "radiosity/",
    "scene/",
    "sensor/",
    *(
        f"image/{name}.py"
        for name in (
            *("colorimetry", "display", "exr", "files", "pictures", "radiance_hdr", "texel_tiles", "exact_display"),
        )
    ),
)
"""What of the package ends in the bits of scenes and images; `exact` is where other functions are corrected."""
_ORDER: Final = (
    *("matmul", "dot", "vdot", "inner", "outer", "tensordot", "einsum", "kron", "trace", "interp"),
    *("convolve", "correlate", "polyfit", "cov", "corrcoef", "linalg", "fft", "matvec", "vecdot", "vecmat"),
)
_ROUNDING: Final = (
    *("sin", "cos", "tan", "sinc", "arcsin", "arccos", "arctan", "arctan2", "asin", "acos", "atan", "atan2"),
    *("sinh", "cosh", "tanh", "arcsinh", "arccosh", "arctanh", "asinh", "acosh", "atanh"),
    *("exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "logaddexp", "power", "float_power", "pow"),
    *("cbrt", "hypot", "dist", "erf", "erfc", "gamma", "lgamma", "geomspace", "logspace", "i0", "sumprod"),
)
_CURES: Final = {
    **dict.fromkeys(_ORDER, "adds in an order that depends on the processor; use clrender.exact.matrices"),
    **dict.fromkeys(_ROUNDING, "is rounded by the kind of processor; use clrender.exact"),
}
_LIBRARIES: Final = ("np", "numpy", "math", "cmath")


def lint(folder: Path) -> list[str]:
    """Faults of the files of a package that end in bits, each as ``file:line: what``.

    Parameters
    ----------
    folder : Path
        The package's folder.
    """
    faults = []
    for path in sorted(folder.rglob("*.py")):
        name = path.relative_to(folder).as_posix()
        if name.startswith(_ROOMS):
            faults += lint_text(name, path.read_text(encoding="utf-8"))
    return faults


def lint_text(name: str, text: str) -> list[str]:
    """Faults in the text of one file.

    Parameters
    ----------
    name : str
    text : str
    """
    return [f"{name}:{line}: {what}" for line, what in sorted(set(_faults(ast.parse(text))))]


def _faults(tree: ast.AST) -> Iterator[tuple[int, str]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.BinOp | ast.AugAssign):
            yield from _of_operator(node)
        elif isinstance(node, ast.Attribute):
            library = isinstance(node.value, ast.Name) and node.value.id in _LIBRARIES
            if node.attr in _CURES and (library or node.attr == "dot"):
                yield node.lineno, f"{node.attr} {_CURES[node.attr]}"
        elif isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in _LIBRARIES:
            for alias in node.names:
                if alias.name in _CURES:
                    yield node.lineno, f"{alias.name} {_CURES[alias.name]}"


def _of_operator(node: ast.BinOp | ast.AugAssign) -> Iterator[tuple[int, str]]:
    if isinstance(node.op, ast.MatMult):
        yield node.lineno, "@ adds in an order that depends on the processor; use clrender.exact.matrices"
    if isinstance(node.op, ast.Pow):
        base = node.left if isinstance(node, ast.BinOp) else node.target
        if not (isinstance(base, ast.Constant) and (isinstance(base.value, int) or base.value == 2.0)):
            yield node.lineno, "** is rounded by the kind of processor; write products, or use clrender.exact"


def main() -> int:
    """Lint the package, or the folder given; returns the number of faults, at most 1."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "clrender"
    faults = lint(folder)
    for fault in faults:
        print(f"{folder.name}/{fault}")
    return min(len(faults), 1)


if __name__ == "__main__":
    sys.exit(main())
