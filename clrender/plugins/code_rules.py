"""The rules of a plugin's code: those of kernels, and what it may name, so that it cannot reach beyond itself."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from clrender.errors import UsageError
from clrender.plugins.header import Header
from clrender.plugins.kernel_rules import COMMENT, line_faults
from clrender.plugins.loops import loop_faults
from clrender.plugins.vocabulary import INCLUDES, Vocabulary, taken_prefix, vocabulary
from clrender.wording import counted, suggestion

__all__ = ["OPTIONAL", "TOGETHER", "check_code", "signatures"]

OPTIONAL: Final = ("albedo",)
"""Functions that a plugin need not have."""
TOGETHER: Final = ("sample", "pdf")
"""Functions of which a light has both or neither."""
_BUILT_IN: Final = frozenset({"fma", "floor"})
"""Built-ins with the same result on every driver."""
_TYPES: Final = frozenset(["vfloat", "vint", "vuint", "vmask", "vec3", "float", "int", "uint", "void"])
_KEYWORDS: Final = frozenset(["const", "static", "if", "else", "for", "return", "break", "continue"])
_REFUSED: Final = frozenset(
    (
        *("while", "do", "goto", "switch", "case", "default", "struct", "union", "enum", "typedef"),
        *("extern", "register", "volatile", "inline", "restrict", "sizeof", "asm", "auto", "char"),
        *("short", "long", "double", "half", "signed", "unsigned", "bool", "size_t", "ptrdiff_t"),
        *("intptr_t", "uintptr_t", "uchar", "ushort", "ulong", "event", "pipe", "image2d_t", "sampler_t"),
        *("global", "local", "constant", "private", "kernel"),
    )
)
_CURES: Final[Mapping[str, str]] = {
    **dict.fromkeys(("sin", "cos", "tan", "sincos"), "cos_sin_turn(turns, &c, &s), whose angle is in turns"),
    **dict.fromkeys(("asin", "acos", "atan", "atan2"), "turn_of(x, y), which gives the angle in turns"),
    **dict.fromkeys(("pow", "powr", "pown"), "power(x, y), for x from 0 to 1"),
    **dict.fromkeys(("exp", "exp2"), "exp2_of(x), a power of two, or exp_minus(x)"),
    **dict.fromkeys(("log", "log2"), "log2_of(x)"),
    **dict.fromkeys(("sqrt", "rsqrt", "native_sqrt"), "root(x)"),
    "dot": "inner(a, b)",
    "cross": "outer(a, b)",
    "normalize": "unit(a)",
    "length": "magnitude(a)",
    "mix": "fma(share, b - a, a)",
    "fabs": "absolute(x)",
    "abs": "absolute(x)",
    **dict.fromkeys(("min", "fmin"), "lesser(a, b)"),
    **dict.fromkeys(("max", "fmax"), "greater(a, b)"),
    "clamp": "bounded(x, low, high)",
    "select": "condition ? a : b",
    "any": "lane_any(mask)",
    "mad": "fma(a, b, c)",
}
_DEFINE: Final = re.compile(r"#define +([A-Za-z_]\w*)( +([\w .+*/()-]+))? *\Z")
_INCLUDE: Final = re.compile(r'#include +"([^"]*)" *\Z')
_HEAD: Final = re.compile(r"static\s+(\w+)\s+(\w+)\s*\(([^(){};]*)\)\s*\{")
_IDENTIFIER: Final = re.compile(r"(?<![\w.])(?<!->)[A-Za-z_]\w*")
_DIVISION: Final = re.compile(r"/=?")
_CONSTANT: Final = r"(?:\d[\d.]*(?:e[+-]?\d+)?f?|[A-Z]\w*)"
_VECTOR: Final = re.compile(r"(?:u?(?:char|short|int|long)|float|double|half)\d+\Z")
_Faults = Iterator[tuple[int, str]]


@dataclass(frozen=True)
class _Function:
    type: str
    name: str
    parameters: str
    body: str
    line: int  # of its head
    body_line: int  # of the body's first character


def signatures(header: Header) -> dict[str, tuple[str, tuple[str, ...]]]:
    """Functions that a plugin has: type and types of parameters, by the last part of the name.

    Parameters
    ----------
    header : Header
    """
    p = f"const {header.struct}*"
    if header.kind == "texture":
        return {"value": ("vec3", (p, "vfloat", "vfloat", "vec3"))}
    if header.kind == "light":
        return {
            "intensity": ("vec3", (p, "vec3")),
            "sample": ("vec3", (p, "vfloat", "vfloat")),
            "pdf": ("vfloat", (p, "vec3")),
        }
    return {
        "eval": ("vec3", (p, "vec3", "vec3")),
        "pdf": ("vfloat", (p, "vec3", "vec3")),
        "sample": ("vec3", (p, "vec3", "vfloat", "vfloat", "vfloat")),
        "albedo": ("vec3", (p, "vec3")),
    }


def check_code(header: Header, text: str, source: str) -> None:
    """Check the code of a plugin.

    Parameters
    ----------
    header : Header
    text : str
        The whole file.
    source : str
        Name of its file in messages.

    Raises
    ------
    UsageError
        The first fault: file and line, what is wrong, what would be right; and how many there are besides.
    """
    if taken_prefix(header.name):
        raise UsageError(
            f"{source}: the plugin is called {header.name}, and clrender has functions of its own whose names begin "
            f"so; give it another name, such as my_{header.name}"
        )
    faults: dict[int, str] = {}
    for line, what in _all_faults(header, text):
        faults.setdefault(line, what)
    if faults:
        line = min(faults)
        more = f" (and {counted(len(faults) - 1, 'more line', 'more lines')} with faults)" if len(faults) > 1 else ""
        raise UsageError(f"{source}:{line}: {faults[line]}{more}")


def _all_faults(header: Header, text: str) -> _Faults:
    code = COMMENT.sub(lambda match: "\n" * match.group().count("\n") or " ", text)
    lines = code.split("\n")
    macros: dict[str, str] = {}
    at: dict[str, int] = {}
    includes: list[str] = []
    for number, line in enumerate(lines, 1):
        if line.lstrip().startswith("#"):
            yield from ((number, what) for what in _directive(header, line.strip(), macros, includes))
            at |= {name: number for name in macros if name not in at}
            lines[number - 1] = ""
        else:
            yield from ((number, what) for what in _characters(line))
    known = vocabulary(*includes)
    for macro, value in macros.items():
        for name in _IDENTIFIER.findall(re.sub(r"\b\d[\d.]*(?:e[+-]?\d+)?[fu]?", "", value)):
            if name not in macros and name not in known.constants:
                yield at[macro], f"{name} is no constant; a #define is a number, or arithmetic of numbers"
    functions, faults = _functions("\n".join(lines))
    yield from faults
    yield from _names(header, functions)
    own: set[str] = set()
    for function in functions:
        yield from _body(header, function, own, set(macros), known)
        yield from loop_faults(function.body, function.body_line, macros)
        own.add(function.name)
    yield from line_faults("plugin", text)


def _directive(header: Header, line: str, macros: dict[str, str], includes: list[str]) -> Iterator[str]:
    """Faults of a preprocessor directive; it is noted if it has none."""
    prefix = f"{header.name.upper()}_"
    if line.startswith("#include"):
        found = _INCLUDE.match(line)
        if not found or found[1] not in INCLUDES:
            yield f"{line[:60]} is not possible: a plugin may include {', '.join(INCLUDES)}; leave out any other"
        else:
            includes.append(found[1])
        return
    if not line.startswith("#define"):
        word = line.split(maxsplit=1)[0]
        yield f"{word} is not possible: a plugin has no directives but #include and #define; leave it out"
        return
    found = _DEFINE.match(line)
    if not found:
        yield "a #define of a plugin is a name and arithmetic of numbers; write a static function instead"
    elif not found[1].startswith(prefix):
        yield f"#define {found[1]} has to begin with {prefix}, so that it changes nothing outside of the plugin"
    elif found[1] in macros:
        yield f"#define {found[1]} is there already; give it another name"
    elif not found[3]:
        yield f"#define {found[1]} needs a value; give it a number"
    else:
        macros[found[1]] = found[3].strip()


def _characters(line: str) -> Iterator[str]:
    """Faults of single characters."""
    if not line.isascii():
        other = next(each for each in line if not each.isascii())
        yield f"the character {other!a} is possible only in comments; leave it out"
    for mark in ("\\", '"', "'", "#", "@", "$", "`", "??", "<:", ":>", "<%", "%>", "%:"):
        if mark in line:
            yield f"{mark} is not possible in a plugin; leave it out"
    if "~" in line:
        yield "~ of a mask is not the same with one lane; write !mask, or for bits x ^ 0xffffffffu"
    for found in re.finditer(r"%\s*=?\s*(\w*)", line):
        if not re.fullmatch(r"[1-9]\d*u?", found[1]):
            yield "% needs a whole number after it; write that"
    for found in _DIVISION.finditer(line):
        before, after = line[: found.start()].rstrip(), line[found.end() :].lstrip()
        constant = re.search(rf"(?<![\w.)\]]){_CONSTANT}\Z", before) and re.match(rf"{_CONSTANT}(?![\w.(\[])", after)
        if found.group() == "/=" or not constant:
            yield "/ is not rounded right on every device; write quotient(a, b), or for a constant 1.0f / 3.0f"
    if re.search(r"(?<![\w.])\d+[uU]?[lL]", line):
        yield "whole numbers have 32 bits; leave the l out"
    if re.search(r"\b0[xX][\da-fA-F.]*[pP][+-]?\d+(?![\dfF])", line):
        yield "a hexadecimal floating-point number without f is a double; write it with f"


def _functions(code: str) -> tuple[list[_Function], list[tuple[int, str]]]:
    """Functions, and faults of what else is at the top level."""
    found: list[_Function] = []
    at = 0
    rule = "outside of functions a plugin has nothing but #include and #define"
    while at < len(code):
        if code[at].isspace():
            at += 1
            continue
        line = code.count("\n", 0, at) + 1
        head = _HEAD.match(code, at)
        if not head:
            like_one = "(" in code[at:].split("\n", maxsplit=1)[0]
            cure = "write `static TYPE NAME(PARAMETERS) {`" if like_one else f"{rule}; move it into one"
            return found, [(line, f"this is no function: {cure}")]
        depth, end = 1, head.end()
        while end < len(code) and depth:
            depth += {"{": 1, "}": -1}.get(code[end], 0)
            end += 1
        if depth:
            return found, [(line, f"the function {head[2]} has no end: a }} is missing")]
        body_line = code.count("\n", 0, head.end()) + 1
        found.append(_Function(head[1], head[2], head[3], code[head.end() : end - 1], line, body_line))
        at = end
    return found, []


def _names(header: Header, functions: list[_Function]) -> _Faults:
    """Faults of the names and types of functions."""
    prefix, wanted, there = f"{header.name}_", signatures(header), dict[str, _Function]()
    for function in functions:
        if not function.name.startswith(prefix) or function.name == prefix:
            yield (
                function.line,
                f"the function {function.name} has to be called {prefix}…, as all functions of the plugin",
            )
        if function.name in there:
            yield function.line, f"the function {function.name} is there already; give it another name"
        there[function.name] = function
        if function.type not in _TYPES:
            types_ = ", ".join(sorted(_TYPES))
            yield function.line, f"{function.name} returns {function.type}; it has to return one of {types_}"
        last = function.name.removeprefix(prefix)
        if last in wanted:
            type_, types = wanted[last]
            given = tuple(
                re.sub(r"\s*\*\s*", "* ", each).rpartition(" ")[0].strip() for each in function.parameters.split(",")
            )
            given = tuple(re.sub(r"\s+", " ", each) for each in given)
            plain = tuple(each if "*" in each else each.removeprefix("const ") for each in given)
            if (function.type, plain) != (type_, types):
                yield (
                    function.line,
                    f"the function {function.name} has to be `static {type_} {function.name}({', '.join(types)})`",
                )
    none = header.kind == "light" and not any(prefix + last in there for last in TOGETHER)
    for last, (type_, types) in wanted.items():
        optional = last in OPTIONAL or (none and last in TOGETHER)
        if not optional and prefix + last not in there:
            yield 1, f"the plugin has no function `static {type_} {prefix}{last}({', '.join(types)})`; add it"


def _body(header: Header, function: _Function, own: set[str], macros: set[str], known: Vocabulary) -> _Faults:
    """Faults of what a function names."""
    types = _TYPES | known.types | {header.struct}
    for text, first in ((function.parameters, function.line), (function.body, function.body_line)):
        for found in _IDENTIFIER.finditer(text):
            name, line = found.group(), first + text.count("\n", 0, found.start())
            called = bool(re.match(r"\s*\(", text[found.end() :]))
            if name in _KEYWORDS - {"static"} or (name in types and not called):
                continue
            if name.startswith("_"):
                yield line, f"{name} begins with an underscore, as words of compilers do; leave it out"
            elif name == "static" or name in _REFUSED or name in types:
                yield line, f"{name} is not possible {_instead(name)}"
            elif _VECTOR.match(name):
                yield line, f"{name} has a fixed number of lanes; write vfloat, vint or vuint"
            elif called:
                yield from ((line, what) for what in _call(name, function, own, known))
            elif re.match(r"[A-Z]", name) and name not in macros and name not in known.constants:
                names = sorted({*macros, *known.constants, *types})
                yield line, f"{name} is no constant or type that plugins know{suggestion(name, names)}"


def _instead(name: str) -> str:
    if name in ("global", "local", "constant", "private"):
        return "in a plugin, which has no memory but its parameters; leave it out"
    if name in ("while", "do", "goto"):
        return "in a plugin; write `for (int i = 0; i < 8; ++i)`"
    if name == "static":
        return "within a function; leave it out"
    return "in a plugin; write vfloat, vint, vuint, vmask, vec3, float, int or uint"


def _call(name: str, function: _Function, own: set[str], known: Vocabulary) -> Iterator[str]:
    if name in own or name in known.functions or name in _BUILT_IN:
        return
    if name == function.name:
        yield f"{name} calls itself, which devices cannot; write a loop"
    elif name in _CURES:
        yield f"{name} differs from driver to driver; write {_CURES[name]}"
    else:
        others = [other for header in INCLUDES if name in vocabulary(header).functions for other in [header]]
        cure = f'; #include "{others[0]}" has it' if others else suggestion(name, sorted({*own, *known.functions}))
        yield f"{name} is no function that a plugin may call here{cure}"
