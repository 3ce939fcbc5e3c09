"""The one table of structs and constants that host and kernels share.

`kernels/types.h` is generated from it by ``python -m clrender.layout`` and committed; a test compares the two,
and another asks every driver for its ``sizeof`` of each struct. Members are ``float4``, ``uint``, ``int`` and
``float`` only, in natural order with explicit padding to a multiple of 16 bytes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

__all__ = [
    "CONSTANTS",
    "FIRST_HIT_ALBEDO",
    "FIRST_HIT_DEPTH",
    "FIRST_HIT_NORMAL",
    "FIRST_HIT_POSITION",
    "FIRST_HIT_PRIMITIVE",
    "LIGHT_AREA_DISK",
    "LIGHT_AREA_SPHERE",
    "LIGHT_AREA_TRIANGLE",
    "LIGHT_DIRECTIONAL",
    "LIGHT_ENVIRONMENT",
    "LIGHT_POINT",
    "MATERIAL_DIELECTRIC",
    "MATERIAL_LAMBERT",
    "MATERIAL_MIRROR",
    "NONE",
    "ROULETTE_ABSORPTION",
    "ROULETTE_NONE",
    "ROULETTE_THROUGHPUT",
    "SHAPE_SMOOTH",
    "STRATEGY_BOTH",
    "STRATEGY_LIGHTS",
    "STRATEGY_MATERIALS",
    "STRUCTS",
    "dtype",
    "types_header",
]

NONE: Final = 0xFFFFFFFF
"""An index that points at nothing, and a limit that never binds."""

MATERIAL_LAMBERT: Final = 0
MATERIAL_MIRROR: Final = 1
MATERIAL_DIELECTRIC: Final = 2

LIGHT_POINT: Final = 0
LIGHT_DIRECTIONAL: Final = 1
LIGHT_AREA_TRIANGLE: Final = 2
LIGHT_AREA_SPHERE: Final = 3
LIGHT_AREA_DISK: Final = 4
LIGHT_ENVIRONMENT: Final = 5

ROULETTE_NONE: Final = 0
ROULETTE_THROUGHPUT: Final = 1
ROULETTE_ABSORPTION: Final = 2

STRATEGY_BOTH: Final = 0
STRATEGY_LIGHTS: Final = 1
STRATEGY_MATERIALS: Final = 2
"""How light from area lights is found: by sampling lights and materials, weighted, or by one of them alone."""

SHAPE_SMOOTH: Final = 1
"""Flag of a shape whose vertices carry normals to interpolate."""

FIRST_HIT_ALBEDO: Final = 0
FIRST_HIT_NORMAL: Final = 1
FIRST_HIT_POSITION: Final = 2
FIRST_HIT_DEPTH: Final = 3
FIRST_HIT_PRIMITIVE: Final = 4
"""What is asked of what a camera ray sees first."""

CONSTANTS: Final[Mapping[str, int]] = {
    "NONE": NONE,
    "SHAPE_SMOOTH": SHAPE_SMOOTH,
    "MATERIAL_LAMBERT": MATERIAL_LAMBERT,
    "MATERIAL_MIRROR": MATERIAL_MIRROR,
    "MATERIAL_DIELECTRIC": MATERIAL_DIELECTRIC,
    "LIGHT_POINT": LIGHT_POINT,
    "LIGHT_DIRECTIONAL": LIGHT_DIRECTIONAL,
    "LIGHT_AREA_TRIANGLE": LIGHT_AREA_TRIANGLE,
    "LIGHT_AREA_SPHERE": LIGHT_AREA_SPHERE,
    "LIGHT_AREA_DISK": LIGHT_AREA_DISK,
    "LIGHT_ENVIRONMENT": LIGHT_ENVIRONMENT,
    "ROULETTE_NONE": ROULETTE_NONE,
    "ROULETTE_THROUGHPUT": ROULETTE_THROUGHPUT,
    "ROULETTE_ABSORPTION": ROULETTE_ABSORPTION,
    "STRATEGY_BOTH": STRATEGY_BOTH,
    "STRATEGY_LIGHTS": STRATEGY_LIGHTS,
    "STRATEGY_MATERIALS": STRATEGY_MATERIALS,
    "FIRST_HIT_ALBEDO": FIRST_HIT_ALBEDO,
    "FIRST_HIT_NORMAL": FIRST_HIT_NORMAL,
    "FIRST_HIT_POSITION": FIRST_HIT_POSITION,
    "FIRST_HIT_DEPTH": FIRST_HIT_DEPTH,
    "FIRST_HIT_PRIMITIVE": FIRST_HIT_PRIMITIVE,
}

# struct -> ((member, C type, comment), ...). Order is memory order.
STRUCTS: Final[Mapping[str, tuple[tuple[str, str, str], ...]]] = {
    "AnalyticShape": (
        ("center_radius", "float4", "xyz centre, world space, metres; w radius"),
        ("normal", "float4", "disk: unit normal; sphere: xyz = 0 and w = +1 (front outside) or -1 (front inside)"),
    ),
    "Shape": (
        ("material", "uint", "index into materials"),
        ("first_primitive", "uint", "primitives of one shape are contiguous"),
        ("first_light", "uint", "light of the first primitive, or NONE; the others follow in order"),
        ("flags", "uint", "SHAPE_*"),
    ),
    "Material": (
        ("color", "float4", "rgb reflectance; w probability that the absorption roulette ends a path here"),
        ("kind", "uint", "MATERIAL_*"),
        ("ior", "float", "index inside (behind the front side) over index outside"),
        ("roughness", "float", ""),
        ("padding", "uint", ""),
    ),
    "Light": (
        ("radiance", "float4", "rgb: radiance W/(sr m2), point: intensity W/sr, directional: irradiance W/m2"),
        ("position", "float4", "point: position; directional: unit direction of travel"),
        ("kind", "uint", "LIGHT_*"),
        ("primitive", "uint", "area lights: the primitive that shines"),
        ("probability", "float", "with which the alias table picks this light"),
        ("alias_threshold", "float", "Vose: keep this entry when the rescaled number is below it"),
        ("alias", "uint", "otherwise take this one"),
        ("place", "uint", "in the tree of lights; NONE where the alias table picks"),
        ("padding_0", "uint", ""),
        ("padding_1", "uint", ""),
    ),
    "Camera": (
        ("origin", "float4", "xyz, world space"),
        ("corner", "float4", "from origin to the top left corner of the image plane at focus distance"),
        ("right", "float4", "whole width of that plane, left to right"),
        ("down", "float4", "whole height of it, top to bottom"),
        ("lens_u", "float4", "aperture radius along image right; 0: pinhole"),
        ("lens_v", "float4", "aperture radius along image up"),
    ),
    "Settings": (
        ("width", "uint", "pixels"),
        ("height", "uint", "pixels"),
        ("tile", "uint", "side of a tile, pixels"),
        ("seed", "uint", ""),
        ("shadow_rays", "uint", "per diffuse hit"),
        ("indirect_rays", "uint", "at the first diffuse hit; 0: direct light only"),
        ("max_depth", "uint", "scattering events at most, or NONE"),
        ("roulette", "uint", "ROULETTE_*"),
        ("strategy", "uint", "STRATEGY_*"),
        ("light_count", "uint", ""),
        ("environment", "uint", "index of the environment light, or NONE"),
        ("triangle_count", "uint", "primitives below it are triangles, the rest analytic_shapes"),
        ("primitive_count", "uint", ""),
        ("lights_equal", "uint", "1: each light of the alias table keeps its own entry"),
        ("light_levels", "uint", "of the tree of lights; 0: the alias table picks"),
        ("reuse", "uint", "pixels that share their indirect light: 1, 2, 4, 8 or 16"),
    ),
}

_SCALARS: Final[Mapping[str, tuple[str, tuple[int, ...]]]] = {
    "float4": ("<f4", (4,)),
    "float": ("<f4", ()),
    "uint": ("<u4", ()),
    "int": ("<i4", ()),
}


def dtype(struct: str) -> np.dtype[np.void]:
    """NumPy dtype of a shared struct, little-endian, the layout OpenCL gives it.

    Parameters
    ----------
    struct : str
        A key of `STRUCTS`.

    Returns
    -------
    numpy.dtype
        Structured; ``float4`` members are sub-arrays of four ``float32``.
    """
    members = STRUCTS[struct]
    return np.dtype([(name, *_SCALARS[c_type]) for name, c_type, _ in members])


def types_header() -> str:
    """Text of `kernels/types.h`."""
    lines = [
        "// Structs and constants shared with the host.",
        "// Generated by `python -m clrender.layout`; change clrender/layout.py instead.",
        "#ifndef TYPES_H",
        "#define TYPES_H",
        "",
    ]
    lines += [f"#define {name} {value}u" for name, value in CONSTANTS.items()]
    for struct, members in STRUCTS.items():
        lines += ["", "typedef struct {"]
        for name, c_type, comment in members:
            declaration = f"    {c_type} {name};"
            lines.append(f"{declaration:<32}// {comment}" if comment else declaration)
        lines.append(f"}} {struct};")
    return "\n".join([*lines, "", "#endif", ""])


if __name__ == "__main__":
    from pathlib import Path

    Path(__file__).resolve().parent.parent.joinpath("kernels", "types.h").write_text(types_header())
