"""The rules that keep kernels exact and portable, line by line: for the kernels' own files and for plugins."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

__all__ = ["COMMENT", "FAST_MATH", "line_faults"]

# Built-ins that drivers round differently. core/ may contain the one hand-written version of each.
_INEXACT: Final = (
    *("dot", "cross", "normalize", "length", "distance", "mix", "rsqrt", "rootn", "cbrt", "hypot", "smoothstep"),
    *("sin", "cos", "tan", "sincos", "sinpi", "cospi", "tanpi", "sinh", "cosh", "tanh", "degrees", "radians"),
    *("asin", "acos", "atan", "atan2", "asinpi", "acospi", "atanpi", "atan2pi", "asinh", "acosh", "atanh"),
    *("exp", "exp2", "exp10", "expm1", "log", "log2", "log10", "log1p", "logb", "pow", "pown", "powr"),
    *("erf", "erfc", "tgamma", "lgamma", "fmod", "remainder", "remquo", "fract"),
)
_EVERYWHERE: Final = (
    (r"\b(?:native|half|fast)_\w+\s*\(", "is a built-in of unspecified precision"),
    (r"\bmad\s*\(", "may or may not round between; write fma, or a product and a sum"),
    (r"\bdouble\d*\b", "does not exist on every device"),
    (r"\bhalf\d*\b(?!_)", "does not exist on every device"),
    (r"\bprintf\b", "breaks some drivers' linkers"),
    (r"\b(?:read_image\w+|write_image\w+|image[123]d\w*_t|sampler_t)\b", "filters differently on each device"),
    (r"(?<![\w.])(?:\d+\.\d*|\.\d+)(?:[eE][+-]?\d+)?(?![\w.])", "is a double constant; it needs the suffix f"),
    (r"(?<![\w.])\d+[eE][+-]?\d+(?![\w.])", "is a double constant; it needs the suffix f"),
    (r"FP_CONTRACT\s+ON", "lets the compiler round differently"),
    (r"\b(?:row|look|anchor|target|deposit)\[(?:\d|1[0-5])\]", "is a bare column; use its name in types.h"),
)
# Divisions of integers, by literals and by these, and of constants, at compile time. Others must use quotient.h.
_WHOLE: Final = (
    r"\d+u?\b(?!\.)|\(tile \* tile\)|\(\(settings->|"
    r"(?:blocks_across|tiles_across|block_words|tile|stretch|rays|whole_divisor|[A-Z]+_(?:CHUNK|DEPOSITS))\b"
)
_DIVISION: Final = re.compile(
    r"\d[\d.]*f / (?:\d[\d.]*f|[A-Z]\w*|\([A-Z\d_ -]+\))(?=[\s),;])"
    rf"|(?P<bad>/(?![/*])=? *(?!{_WHOLE})[\w(*-][\w.]*|\bsqrt\()"
)
_INEXACT_CALL: Final = re.compile(rf"\b(?:{'|'.join(_INEXACT)})\s*\(")
FAST_MATH: Final = re.compile(
    r"-cl-(?:fast-relaxed-math|unsafe-math-optimizations|mad-enable|finite-math-only|no-signed-zeros|denorms-are-zero)"
)
"""Options of compilers that let them round differently."""
COMMENT: Final = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)
"""A comment of OpenCL C."""
_FUNCTION: Final = re.compile(r"(?:__attribute__\S+ )?static [\w*]+ \w+\((.*)\) \{")
_BY_VALUE: Final = re.compile(r"(?:const )?(?:vec3|[A-Z]\w+) (\w+)")
_RETURNED: Final = re.compile(r"__attribute__\(\(always_inline\)\) static (vec3|[A-Z]\w+) ")
_MEMBER: Final = re.compile(r"\s*(\w+)(\s*\*)?\s*\w+(?:\[\w+\])?\s*;")
_SHARED_TYPES: Final = frozenset({"float4", "float", "uint", "int"})


def line_faults(name: str, text: str) -> Iterator[tuple[int, str]]:
    """Faults of a kernel file or plugin.

    Parameters
    ----------
    name : str
        Path below the kernels folder, which decides what is allowed: only ``core/`` may call what rounds differently.
    text : str

    Yields
    ------
    line : int
        From 1 on.
    what : str
        What is wrong there.
    """
    code = COMMENT.sub(lambda match: "\n" * match.group().count("\n"), text)
    depth = 0
    signature, given = "", list[str]()
    for number, line in enumerate(code.splitlines(), 1):
        if line.lstrip().startswith("#include"):
            ends = "cl" if name == "common.cl" else "h|inc"
            if not re.fullmatch(rf'#include "[\w/]+\.(?:{ends})"\s*', line):
                yield number, 'includes read #include "room/file.h", relative to the kernels folder'
            continue
        for pattern, why in _EVERYWHERE:
            if found := re.search(pattern, line):
                yield number, f"{found.group().strip()} {why}"
        if not name.startswith("core/") and (found := _INEXACT_CALL.search(line)):
            yield number, f"{found.group().strip(' (')} differs from driver to driver; use the function of core/"
        if not name.startswith("core/quotient."):
            for found in (each for each in _DIVISION.finditer(line) if each["bad"]):
                yield number, f"{found['bad'].strip()} is not rounded right on every device; use core/quotient.h"
        if found := FAST_MATH.search(line):
            yield number, f"{found.group()} lets the compiler round differently"
        if found := _RETURNED.search(line):
            yield number, f"{found.group(1)} is a struct, and Oclgrind runs no inlined function that returns one"
        signature = "" if line.startswith("}") else line if line[:1].strip() else signature + line
        given = [] if line.startswith("}") else given
        if function := _FUNCTION.match(signature):
            parameters = (_BY_VALUE.fullmatch(each.strip()) for each in function.group(1).split(","))
            given, signature = [each.group(1) for each in parameters if each], ""
        for each in given:
            if re.search(rf"(?<![\w.>&*]){each}(?:\.\w+)*\s*(?:[-+*/^|&]|<<|>>)?=(?!=)", line):
                yield number, f"{each} was given by value, and rusticl may share it with the caller; write to a copy"
        if name == "types.h":
            depth += line.count("{") - line.count("}")
            member = _MEMBER.match(line)
            if depth > 0 and member and (member.group(2) or member.group(1) not in _SHARED_TYPES):
                yield number, f"shared structs hold float4, float, uint and int, not {member.group().strip()}"
