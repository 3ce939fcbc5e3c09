"""Expand a kernel file and its includes to one text, so that drivers need not find files.

Includes are quoted and relative to the kernels folder. With `#line` directives, compiler messages refer to the original
files. Folders with spaces in their names work with every driver, and the text is a complete cache key.
"""

from __future__ import annotations

import difflib
import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

from clrender.errors import RenderError
from clrender.files.kernel_hash import kernel_files
from clrender.files.package_data import kernels_folder

__all__ = ["SMALL_CODE", "Source", "expand", "load_source"]

SMALL_CODE: Final = "SMALL_CODE"
"""Macro of programs that are compiled to small code, which takes less time; only for compilers that are Clang."""

_COLD: Final = "#pragma clang attribute push(__attribute__((cold)), apply_to = function)"
_DIRECTIVE = re.compile(r"\s*#\s*(\w+)\s*(.*?)\s*$")
_DECIDE = ("include", "if", "ifdef", "ifndef", "else", "elif", "endif")
_PLUGIN = re.compile(r'^// plugin \w+\n#line 1 "([^"]*)"', re.MULTILINE)
_LINE = re.compile(r'#line (\d+) "([^"]*)"')
_COMMENTS = re.compile(r"/\*.*?\*/|//[^\n]*|/\*.*\Z", re.DOTALL)


@dataclass(frozen=True)
class Source:
    """Expanded text of one program.

    Attributes
    ----------
    entry : str
        Name relative to the kernels folder.
    text : str
        Complete OpenCL C without includes.
    sha256 : str
        Hash of `text`.
    """

    entry: str
    text: str
    sha256: str

    @property
    def plugins(self) -> tuple[str, ...]:
        """Files of plugins, whose texts are in `text` by their own names and lines; see `clrender.plugins.program`."""
        return tuple(dict.fromkeys(_PLUGIN.findall(self.text)))

    def place(self, line: int) -> str:
        """File and line, such as ``core/exact.h:12``, of a line of `text`, counted from 1."""
        file, number = self.entry, 0
        for each in self.text.splitlines()[: line - 1]:
            found = _LINE.match(each)
            file, number = (found[2], int(found[1]) - 1) if found else (file, number + 1)
        return f"{file}:{number + 1}"


def load_source(entry: str | Path, defines: Mapping[str, int | str] | None = None, root: Path | None = None) -> Source:
    """Read a kernel file, expand it and prepend its definitions.

    Parameters
    ----------
    entry : str or Path
        Name below the kernels folder, or an absolute path.
    defines : mapping, optional
        Macros defined before the first line. A name that ends in ``.h`` is no macro, but a file whose text is given in
        the place of the folder's.
    root : Path, optional
        Folder that includes are relative to; default: the kernels folder.

    Raises
    ------
    RenderError
        When a file is missing or cannot be read, or includes form a cycle.
    """
    given = {name: str(value) for name, value in sorted((defines or {}).items()) if name.endswith(".h")}
    named = {name: value for name, value in (defines or {}).items() if name not in given}
    macros = "".join(f"#define {name} {value}\n" for name, value in sorted(named.items()))
    # Set here for the whole program: contraction would make results differ between drivers.
    text = "#pragma OPENCL FP_CONTRACT OFF\n" + macros + expand(entry, root, given)
    if SMALL_CODE in (defines or {}):
        # Clang optimizes functions for size that are seldom called, and inlines less
        text = f"{_COLD}\n{text}#pragma clang attribute pop\n"
    return Source(str(entry), text, hashlib.sha256(text.encode()).hexdigest())


def expand(entry: str | Path, root: Path | None = None, given: Mapping[str, str] | None = None) -> str:
    """Text of a kernel file with every include replaced by the file's contents.

    A header with an include guard that was already included unconditionally, or in the same branch of an `#if`, is
    replaced by a `#line` directive only. Any other is included again, as by a preprocessor.

    Parameters
    ----------
    entry : str or Path
        Name below `root`, or an absolute path.
    root : Path, optional
        Folder that includes are relative to; default: the kernels folder, whose files are expanded only once.
    given : mapping of str to str, optional
        Texts of files in the place of the folder's, by name.

    Raises
    ------
    RenderError
        When a file is missing or cannot be read, an include is not quoted, or includes form a cycle.
    """
    if root is None and not given and not Path(entry).is_absolute():
        return _expand_once(str(entry))
    return _expand(str(entry), root or kernels_folder(), given or {})


def _expand(entry: str, root: Path, given: Mapping[str, str]) -> str:
    return "".join(_Expander(root, given).file(entry, []))


@cache
def _expand_once(entry: str) -> str:
    return _expand(entry, kernels_folder(), {})


class _Expander:
    """State of one expansion: the guarded headers that are certainly included at the current line."""

    def __init__(self, root: Path, given: Mapping[str, str]) -> None:
        self.root, self.given = root, given
        # One set per open conditional branch, outermost first. A header in any of them is included here.
        self.branches: list[set[str]] = [set()]

    def file(self, name: str, chain: list[str]) -> list[str]:
        """Expand one file, in pieces; `chain` holds "file:line" of the enclosing includes."""
        guarded, pieces = _parsed(self._read(name, chain))
        if guarded:
            self.branches[-1].add(name)
        out = [f'#line 1 "{name}"\n']
        depth = 0
        for piece in pieces:
            out.append(piece.text)
            if piece.word == "include":
                out += self._include(piece.operand, [*chain, f"{name}:{piece.number}"])
                out.append(f'#line {piece.number + 1} "{name}"\n')
            else:
                depth = self._follow(piece.word, depth, guarded)
        return out

    def _follow(self, word: str, depth: int, guarded: bool) -> int:
        """Update the branches for `#if … #endif`; an include guard's own condition is true at its first inclusion."""
        outermost = 1 if guarded else 0
        if word in ("if", "ifdef", "ifndef"):
            if depth >= outermost:
                self.branches.append(set())
            return depth + 1
        if word in ("else", "elif") and depth > outermost:
            self.branches[-1] = set()
        elif word == "endif" and depth > 0:
            if depth > outermost:
                self.branches.pop()
            return depth - 1
        return depth

    def _include(self, operand: str, chain: list[str]) -> list[str]:
        place = chain[-1]
        if len(operand) < 3 or operand[0] != '"' or operand[-1] != '"':
            raise RenderError(
                f"{place}: includes are quoted and relative to the kernels folder, but this says {operand}"
            )
        name = operand[1:-1]
        open_files = [step.rpartition(":")[0] for step in chain]
        if name in open_files:
            cycle = " -> ".join([*chain[open_files.index(name) :], name])
            raise RenderError(f"{place}: includes form a cycle ({cycle}); move what both need into a header of its own")
        return [] if any(name in branch for branch in self.branches) else self.file(name, chain)

    def _read(self, name: str, chain: list[str]) -> str:
        if name in self.given:
            return self.given[name]
        path = Path(name) if not chain and Path(name).is_absolute() else self.root / name
        place = f"{chain[-1]}: " if chain else ""
        if chain and (".." in Path(name).parts or Path(name).is_absolute()):
            raise RenderError(f'{place}"{name}" leaves the kernels folder; includes are relative to it')
        try:
            return path.read_text(encoding="utf-8")
        except FileNotFoundError:
            raise RenderError(f'{place}kernel file "{name}" is not in {self.root}{self._nearest(name)}') from None
        except (OSError, UnicodeDecodeError) as error:
            raise RenderError(f'{place}kernel file "{name}" cannot be read: {error}') from None

    def _nearest(self, name: str) -> str:
        known = [path.relative_to(self.root).as_posix() for path in kernel_files(self.root)]
        near = difflib.get_close_matches(name, known, n=1)
        return f'; did you mean "{near[0]}"?' if near else ""


def _blank(match: re.Match[str]) -> str:
    return "\n" * match.group().count("\n") or " "


class _Piece(NamedTuple):
    """Text up to a conditional or include directive; the line of an include is left out."""

    text: str
    number: int
    word: str
    operand: str


# Cached because headers are in several programs, and parsing is slower than reading.
@cache
def _parsed(text: str) -> tuple[bool, tuple[_Piece, ...]]:
    """Whether an include guard encloses the whole file, and the file in pieces."""
    # No kernel has a string literal with a comment mark in it, so a pattern can remove comments.
    bare = _COMMENTS.sub(_blank, text).splitlines()
    found: list[tuple[str, str]] = []
    pieces: list[_Piece] = []
    lines: list[str] = []
    for number, line in enumerate(text.splitlines(), 1):
        directive = _DIRECTIVE.match(bare[number - 1]) if "#" in line and number <= len(bare) else None
        word, operand = directive.groups() if directive else ("", "")
        if directive:
            found.append((word, operand))
        if word != "include":
            lines.append(line + "\n")
        if word in _DECIDE:
            pieces.append(_Piece("".join(lines), number, word, operand))
            lines = []
    pieces.append(_Piece("".join(lines), 0, "", ""))
    around = [word for word, _ in (*found[:2], *found[-1:])] if len(found) > 2 else []
    guarded = around == ["ifndef", "define", "endif"] and found[1][1].split()[:1] == [found[0][1]]
    return guarded, tuple(pieces)
