"""What plugins may call and include: names of the kernels' own functions, read from their files."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import Final

from clrender.files.package_data import kernels_folder
from clrender.plugins.kernel_rules import COMMENT

__all__ = ["ALWAYS", "INCLUDES", "Vocabulary", "taken_prefix", "vocabulary"]

ALWAYS: Final = ("core/exact.h", "core/quotient.h", "core/lane.h", "core/power.h", "core/warp.h")
"""Headers that every plugin has."""
INCLUDES: Final = (
    *("core/frame.h", "core/sampler.h", "material/beckmann.h", "material/eon.h", "material/fresnel.h"),
    *("material/ggx.h", "material/lambert.h"),
)
"""Headers that a plugin may include besides."""
_ONLY: Final = {
    "core/lane.h": (
        *("splat", "splat_uint", "mask_none", "mask_all", "lesser", "greater", "lane_any", "vfloat_bits"),
        *("vfloat_from_bits", "vfloat_of", "vint_of", "vuint_of", "vuint_from_int", "vint_from_uint"),
    ),
    "core/quotient.h": ("quotient", "square_root"),
    "core/sampler.h": ("hash", "hash_pair", "unit_interval"),
}
"""Functions of headers of which others depend on the number of lanes, or on what plugins do not have."""
_FUNCTION: Final = re.compile(r"^static \w+ \*?(\w+)\(", re.MULTILINE)
_MACRO: Final = re.compile(r"^#define (\w+)\(", re.MULTILINE)
_CONSTANT: Final = re.compile(r"^#define ([A-Z]\w+) +[-(]*[\d.]", re.MULTILINE)
_TYPE: Final = re.compile(r"^\} (\w+);", re.MULTILINE)
_NEEDED: Final = re.compile(r'^#include "([\w/]+\.h)"', re.MULTILINE)


@dataclass(frozen=True)
class Vocabulary:
    """Names that headers define.

    Attributes
    ----------
    functions, constants, types : frozenset of str
    """

    functions: frozenset[str]
    constants: frozenset[str]
    types: frozenset[str]


@cache
def vocabulary(*includes: str) -> Vocabulary:
    """What plugins know that include these headers.

    Parameters
    ----------
    *includes : str
        Of `INCLUDES`.
    """
    headers, left = list[str](), [*ALWAYS, *includes]
    while left:
        header = left.pop(0)
        if header not in headers and header in (*ALWAYS, *INCLUDES):
            headers.append(header)
            left += _NEEDED.findall(_bare(header))
    functions, constants, types = set[str](), set[str](), set[str]()
    for header in headers:
        text = _bare(header)
        functions.update(_ONLY.get(header, {*_FUNCTION.findall(text), *_MACRO.findall(text)}))
        constants.update(_CONSTANT.findall(text))
        types.update(_TYPE.findall(text))
    hidden = {"LANES", "PACKETS", "SETS_PER_BOUNCE"}
    own = {name for name in constants - hidden if not name.startswith("SET_")}
    return Vocabulary(frozenset(functions), frozenset(own), frozenset(types - {"vec3", "Sampler"}))


def taken_prefix(name: str) -> bool:
    """Whether kernels have functions of their own whose names begin with this one and an underscore."""
    return any(each.startswith(f"{name}_") or each == name for each in _all_names())


@cache
def _all_names() -> frozenset[str]:
    folder = kernels_folder()
    names = {"plugin", "plugins", "kernel", "kernels", "clrender"}
    for path in folder.rglob("*"):
        if path.suffix in (".h", ".inc", ".cl"):
            names |= {path.stem, path.parent.name}
            code = COMMENT.sub("", path.read_text(encoding="utf-8"))
            names.update(re.findall(r"\b([a-z]\w*)\(", code))
    return frozenset(names)


@cache
def _bare(header: str) -> str:
    return COMMENT.sub("", (kernels_folder() / header).read_text(encoding="utf-8"))
