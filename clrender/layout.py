"""The one table of structs, columns of rows and constants that host and kernels share.

`kernels/types.h` is generated from it by ``python -m clrender.layout`` and committed; a test compares the two,
and another asks every driver for its ``sizeof`` of each struct. Members are ``float4``, ``uint``, ``int``, ``float``
and arrays of these only, in natural order with explicit padding to a multiple of 16 bytes.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Final

import numpy as np

# And each of the constants that follow.
__all__ = [
    "CONSTANTS",
    "ROWS",
    "STRUCTS",
    "TEXTURE_CHANNELS",
    "TEXTURE_FILTERS",
    "TEXTURE_SLOTS",
    "TEXTURE_WRAPS",
    "columns",
    "dtype",
    "types_header",
]

NONE: Final = 0xFFFFFFFF
"""The invalid index, and the value for no limit."""

MATERIAL_LAMBERT: Final = 0
MATERIAL_MIRROR: Final = 1
MATERIAL_DIELECTRIC: Final = 2
MATERIAL_OREN_NAYAR: Final = 3
MATERIAL_CONDUCTOR: Final = 4
MATERIAL_PRINCIPLED: Final = 5
MATERIAL_MIX: Final = 6
MATERIAL_BY_ROW: Final = 7
MATERIAL_MEDIUM: Final = 8
MATERIAL_SUBSURFACE: Final = 9
MATERIAL_PLUGIN: Final = 10
MATERIAL_HAIR: Final = 11
MATERIAL_MEASURED: Final = 12
"""Kinds of a primitive's material. A material with rows of its own has its kind in the first of them."""

MATERIAL_FLAG_THIN: Final = 1
MATERIAL_FLAG_ONE_SIDED: Final = 2
MATERIAL_FLAG_SCHLICK: Final = 4
MATERIAL_FLAG_BECKMANN: Final = 8
MATERIAL_FLAG_SINGLE_SCATTERING: Final = 16
"""Flags of a material's row: a wall without thickness; black from behind; a metal by its colour, not by eta and k."""

COLORS_PER_DOUBLING: Final = 64
"""Entries of a table of black bodies' colours in which the temperature doubles."""

MEASURED_MERL: Final = 1
MEASURED_JACOBIAN: Final = 2
MEASURED_ISOTROPIC: Final = 4
MEASURED_HALVES: Final = 8
MEASURED_QUARTERS: Final = 16
"""Flags of measured reflectance: a table of MERL; a Jacobian; which viewers see the same."""

PLUGIN_NUMBERS: Final = 16
"""Most numbers that the parameters of a plugin are."""

MEDIUM_FLAG_SUBSURFACE: Final = 1
MEDIUM_FLAG_DARK: Final = 2
MEDIUM_FLAG_OPEN: Final = 4
MEDIUM_FLAG_GRID: Final = 8
MEDIUM_FLAG_GLOWS: Final = 16
"""Flags of a medium's row: of a subsurface material; no lights inside, so that light sampling is useless there; its
surface has a hole; a grid says its density; it shines."""

LIGHT_VERTICES: Final = 8
"""Vertices of a light path that are kept, each as likely, to stand for all."""

FIELD_LEAF: Final = 1 << 31
FIELD_LEVELS: Final = 16
FIELD_BIN_BITS: Final = 8
FIELD_BINS: Final = 1 << FIELD_BIN_BITS
FIELD_WORDS: Final = 132
"""The guiding field (kernels/guiding/field.h): the bit of a leaf's number, most levels, bins of directions, as bits of
their number too, and words of a cell."""

CHAIN_HEAD: Final = 16
"""Words of the head of the table of specular chains (kernels/specular/table.h)."""

RECORD_EVENTS: Final = 16
RECORD_WORDS: Final = 16
TRAINING_REFLECTED: Final = FIELD_BINS
TRAINING_OUTGOING: Final = FIELD_BINS + 1
TRAINING_SQUARES: Final = FIELD_BINS + 2
TRAINING_SUMS: Final = FIELD_BINS + 6
TRAINING_BITS: Final = 16
TRAINING_MOST: Final = 1 << 20
TRAINING_MOST_IN_BIN: Final = 10
"""Training of the field (kernels/guiding/training.h): scattering events of a path that are recorded, words of each
record; the sums of a cell, of 64 bits each, their fractional bits, and the most that a sample adds to one."""

INSPECT_WORDS: Final = 48
INSPECT_ROWS: Final = 256
"""Recorded paths (kernels/integrator/inspect.h): words of a row, and rows of a sample; the first is of the sample."""

SPLAT_WORDS: Final = 6
"""Words of a row of the list of splats (kernels/film/splat.h)."""

INSPECT_VERTEX: Final = 1
INSPECT_LIGHT_SAMPLE: Final = 2
INSPECT_EMISSION: Final = 3
INSPECT_CHAIN: Final = 4
INSPECT_GLOW: Final = 5
INSPECT_JOIN: Final = 6
INSPECT_LIGHT_START: Final = 7
INSPECT_LIGHT_VERTEX: Final = 8
"""Kinds of its other rows: a vertex of the path; radiance that a light sample, an emitter that the path met, a specular
chain, the medium on its way, and a connection with a light path added; after the last, the start and the vertices of
that light path."""

INSPECT_FOUND: Final = 1
INSPECT_IN_MEDIUM: Final = 2
INSPECT_BACK: Final = 4
INSPECT_STRAIGHT: Final = 8
INSPECT_SPECULAR: Final = 16
INSPECT_DARK: Final = 32
INSPECT_SAMPLES_LIGHTS: Final = 64
INSPECT_FRONT: Final = 128
INSPECT_SCATTERS: Final = 256
INSPECT_CARRIES: Final = 512
INSPECT_ROULETTE: Final = 1024
INSPECT_GOES_ON: Final = 2048
INSPECT_CROSSES: Final = 4096
INSPECT_BY_FIELD: Final = 8192
INSPECT_GUIDED: Final = 16384
"""Flags of a vertex: its ray hit something; it is a point of a medium; several rays leave it, and this is not the
first; no boundary; its BSDF is a delta; no light sample could arrive; lights are sampled; the ray met the front; the
path may go on from it; it still carries radiance after the event; roulette was played; the path goes on; on the other
side; its direction is of the guiding field; the field has a share of its directions."""

INSPECT_ASKED: Final = 1
INSPECT_ARRIVED: Final = 2
INSPECT_IN_FULL: Final = 4
INSPECT_DELTA: Final = 8
INSPECT_INFINITE: Final = 16
"""Flags of radiance that was added: a shadow ray was traced; light arrived; no light sample could have found it; a
light without extent; infinitely far away."""

GGX_ROWS: Final = 48
GGX_COLUMNS: Final = 48
GGX_LOST_ROWS: Final = 4 * (GGX_ROWS - 1) + 1
SCHLICK_ROWS: Final = 32
SCHLICK_COLUMNS: Final = 48
TURNED_ROWS: Final = 28
TURNED_APART: Final = 20
TURNED_TURNS: Final = 17
TURNED_COLUMNS: Final = 32
GLASS_LAYERS: Final = 48
GLASS_ROWS: Final = 32
GLASS_COLUMNS: Final = 56
GLASS_LOST_ROWS: Final = 8 * (GLASS_ROWS - 1) + 1
TURNED_GLASS_LAYERS: Final = 22
TURNED_GLASS_ROWS: Final = 14
TURNED_GLASS_APART: Final = 12
TURNED_GLASS_TURNS: Final = 10
TURNED_GLASS_COLUMNS: Final = 28
TURNED_GLASS_LOST_ROWS: Final = 3 * (TURNED_GLASS_ROWS - 1) + 1
TURNED_GLASS_LOST_APART: Final = 2 * (TURNED_GLASS_APART - 1) + 1
SHEEN_ROWS: Final = 32
SHEEN_COLUMNS: Final = 48
COVERED_LAYERS: Final = 12
COVERED_ROWS: Final = 12
COVERED_COLUMNS: Final = 24
SLANT_ROWS: Final = 48
SLANT_NUMBERS: Final = 17
"""Sizes of the albedo tables (``scripts/albedo_tables.py``)."""

ALBEDO_GGX: Final = 0
ALBEDO_SCHLICK: Final = ALBEDO_GGX + GGX_ROWS * (GGX_COLUMNS - 1)
ALBEDO_GGX_LOST: Final = ALBEDO_SCHLICK + SCHLICK_ROWS * (SCHLICK_COLUMNS - 1)
ALBEDO_GGX_SCHLICK: Final = ALBEDO_GGX_LOST + GGX_LOST_ROWS
ALBEDO_TURNED: Final = ALBEDO_GGX_SCHLICK + GGX_ROWS
ALBEDO_TURNED_LOST: Final = ALBEDO_TURNED + TURNED_ROWS * TURNED_APART * TURNED_TURNS * (TURNED_COLUMNS - 1)
ALBEDO_GLASS: Final = ALBEDO_TURNED_LOST + TURNED_ROWS * TURNED_APART
ALBEDO_GLASS_LOST: Final = ALBEDO_GLASS + 2 * GLASS_LAYERS * GLASS_ROWS * (GLASS_COLUMNS - 1)
ALBEDO_SHEEN: Final = ALBEDO_GLASS_LOST + 2 * GLASS_LAYERS * GLASS_LOST_ROWS
ALBEDO_SHEEN_SCALE: Final = ALBEDO_SHEEN + SHEEN_ROWS * (SHEEN_COLUMNS - 1)
ALBEDO_SHEEN_MEAN: Final = ALBEDO_SHEEN_SCALE + SHEEN_ROWS
ALBEDO_SLANTS: Final = ALBEDO_SHEEN_MEAN + SHEEN_ROWS
ALBEDO_SLANT_NUMBERS: Final = ALBEDO_SLANTS + 3 * SLANT_ROWS
ALBEDO_COVERED: Final = ALBEDO_SLANT_NUMBERS + SLANT_NUMBERS
ALBEDO_COVERED_MEAN: Final = ALBEDO_COVERED + 2 * COVERED_LAYERS * COVERED_ROWS * (COVERED_COLUMNS - 1)
ALBEDO_END: Final = ALBEDO_COVERED_MEAN + 2 * COVERED_LAYERS * COVERED_ROWS
ALBEDO_BECKMANN: Final = ALBEDO_END
ALBEDO_BECKMANN_SLANTS: Final = ALBEDO_BECKMANN + ALBEDO_SHEEN
ALBEDO_TURNED_GLASS: Final = ALBEDO_BECKMANN_SLANTS + 2 * SLANT_ROWS
ALBEDO_TURNED_GLASS_LOST: Final = ALBEDO_TURNED_GLASS + (
    (2 * TURNED_GLASS_LAYERS * TURNED_GLASS_ROWS * TURNED_GLASS_APART)
    * (TURNED_GLASS_TURNS * (TURNED_GLASS_COLUMNS - 1))
)
ALBEDO_TURNED_GLASS_END: Final = ALBEDO_TURNED_GLASS_LOST + (
    2 * TURNED_GLASS_LAYERS * TURNED_GLASS_LOST_ROWS * TURNED_GLASS_LOST_APART
)
"""Offsets of the tables of `clrender.flatten.microfacets.albedo_tables`, in words, and the end of the last.

From `ALBEDO_BECKMANN` on are those of Beckmann's distribution, in the order of the tables of GGX before `ALBEDO_SHEEN`
and then the slants, and from `ALBEDO_TURNED_GLASS` on those of anisotropic glass; scenes that do not need them do not
have them.
"""

FILTER_LINES: Final = 64
"""Line segments that approximate half of a pixel filter's profile; a power of two, for binary search."""
FILTER_LINE_BEFORE: Final = 0
FILTER_LINE_PLACE: Final = 1
FILTER_LINE_HEIGHT: Final = 2
FILTER_LINE_SLOPE: Final = 3
"""Columns of a segment of the filter's absolute value, normalized to the integral 1: the integral before the segment,
its start, pixels, and its value and slope there."""

LIFTING_LIGHTNESSES: Final = 32
LIFTING_CHROMAS: Final = 40
"""Nodes of the table of colours' spectra along the largest channel, and along each of the others relative to it."""

SPECTRA_LINES: Final = 95
SPECTRA_SEGMENTS: Final = 256
SPECTRA_FILM: Final = 2 * SPECTRA_SEGMENTS + 4
SPECTRA_LIFTING: Final = SPECTRA_FILM + 4 * (SPECTRA_LINES + 1)
SPECTRA_GIVEN: Final = SPECTRA_LIFTING + 12 * LIFTING_LIGHTNESSES * LIFTING_CHROMAS**2
"""Wavelengths of tables of spectra; segments of the inverse of their distribution, with which the array begins; and
where in it red, green and blue of the film begin, the table of colours' spectra, and the spectra of the scene."""

THIN_FILM_STEPS: Final = 3072
THIN_FILM_FACETS: Final = 24
THIN_FILM_MATERIALS: Final = THIN_FILM_STEPS + THIN_FILM_FACETS**2
"""Rows of the table of what is left of the interference of light, by the difference of its ways: 4 nm each; rows and
columns of that of the cosines at which facets reflect; and where films of materials begin."""

CAMERA_PERSPECTIVE: Final = 0
CAMERA_ORTHOGRAPHIC: Final = 1
CAMERA_PANORAMIC: Final = 2
CAMERA_FISHEYE: Final = 3
CAMERA_BROWN_CONRADY: Final = 4
CAMERA_KANNALA_BRANDT: Final = 5

LIGHT_POINT: Final = 0
LIGHT_DIRECTIONAL: Final = 1
LIGHT_AREA_TRIANGLE: Final = 2
LIGHT_AREA_SPHERE: Final = 3
LIGHT_AREA_DISK: Final = 4
LIGHT_ENVIRONMENT: Final = 5
LIGHT_SPOT: Final = 6
LIGHT_IES: Final = 7
LIGHT_SUN: Final = 8
LIGHT_PROJECTOR: Final = 9
LIGHT_PLUGIN: Final = 10

HAS_MASKED: Final = 1
"""Rays may pass through some surfaces, which have a BVH of their own."""
HAS_SUN: Final = 2
HAS_HIDDEN_ENVIRONMENT: Final = 4
HAS_ENVIRONMENT_MAP: Final = 8
HAS_STRAIGHT_SHADOWS: Final = 16
HAS_LAMPS: Final = 32
HAS_HOLES: Final = 128
HAS_CAMERA_CUTS_MEDIA: Final = 64

ROULETTE_NONE: Final = 0
ROULETTE_THROUGHPUT: Final = 1
ROULETTE_CONSTANT: Final = 2

SHAPE_SMOOTH: Final = 1
"""Flag of a shape with vertex normals that are interpolated."""
SHAPE_TEXTURED: Final = 2
"""Flag of a shape whose material or emission is textured: its primitives have attribute rows."""
SHAPE_MASKED: Final = 4
"""Flag of a shape whose opacity is not 1 everywhere."""
SHAPE_TERMINATOR_OFFSET: Final = 8
"""Flag of a shape with interpolated normals whose shadow terminator is moved."""
SHAPE_HIDDEN: Final = 16
"""Flag of a shape that rays of the camera pass; it is among the masked ones."""
SHAPE_HELD_OUT: Final = 32
"""Flag of a shape where rays of the camera end, as if nothing were there; it is among the masked ones."""

HOLE_GRID: Final = 32
ANALYTIC_SHAPE_CURVE: Final = 2
"""Least `w` of the normal of a curve's `AnalyticShape`: 1 more if another goes on from its beginning, 2 from its end.

Centre and radius are of a sphere around it, and the rest of the normal is half the extents of its box.
"""
"""Cells along each side of a masked triangle; a cell may be known to be entirely transparent or entirely opaque."""

TEXTURE_SLOTS: Final[Mapping[str, int]] = {
    "BASE_COLOR": 0,
    "ROUGHNESS": 1,
    "METALLIC": 2,
    "SPECULAR": 3,
    "SPECULAR_COLOR": 4,
    "TRANSMISSION": 5,
    "COAT": 6,
    "COAT_ROUGHNESS": 7,
    "SHEEN_COLOR": 8,
    "SHEEN_ROUGHNESS": 9,
    "ANISOTROPY": 10,
    "OPACITY": 11,
    "DIFFUSE_ROUGHNESS": 12,
    "WEIGHT": 13,
    "NORMAL": 14,
    "BUMP": 15,
}
"""Columns of a material's texture row, by the parameter that the texture controls."""

TEXEL_FOUR: Final = 8
TEXEL_FLOAT: Final = 16
TEXTURE_PLUGIN: Final = 1 << 15
TEXTURE_WRAPS: Final = {"repeat": 0, "clamp": 1, "mirror": 2}
TEXTURE_FILTERS: Final = {"nearest": 0, "linear": 1, "exact": 2}
TEXTURE_CHANNELS: Final = {None: 0, "r": 1, "g": 2, "b": 3, "a": 4, "luminance": 5}
"""Parts of TEXTURE_ROW_FORMAT: the lowest three bits are the logarithm of a texel's bytes."""

FIRST_HIT_ALBEDO: Final = 0
FIRST_HIT_NORMAL: Final = 1
FIRST_HIT_POSITION: Final = 2
FIRST_HIT_DEPTH: Final = 3
FIRST_HIT_PRIMITIVE: Final = 4
FIRST_HIT_EMISSION: Final = 5
FIRST_HIT_UV: Final = 6
FIRST_HIT_TANGENT: Final = 7
FIRST_HIT_ALPHA: Final = 8
FIRST_HIT_Z_DEPTH: Final = 9
FIRST_HIT_NORMAL_CAMERA: Final = 10
FIRST_HIT_FLOW: Final = 11
FIRST_HIT_SCENE_FLOW: Final = 12
"""Attributes of a camera ray's first hit."""

CONSTANTS: Final[Mapping[str, int]] = {
    **{name: value for name, value in globals().items() if name.isupper() and isinstance(value, int)},
    **{f"TEXTURE_{name}": slot for name, slot in TEXTURE_SLOTS.items()},
    **{f"WRAP_{name.upper()}": number for name, number in TEXTURE_WRAPS.items()},
    **{f"FILTER_{name.upper()}": number for name, number in TEXTURE_FILTERS.items()},
}
"""Every number above: kernels know it by the same name."""

# struct -> ((member, C type, comment), ...). Order is memory order.
STRUCTS: Final[Mapping[str, tuple[tuple[str, str, str], ...]]] = {
    "AnalyticShape": (
        ("center_radius", "float4", "xyz centre, world space, metres; w radius"),
        ("normal", "float4", "disk: unit normal; sphere: xyz = 0 and w = +1 (front outside) or -1 (front inside);"),
    ),
    "Shape": (
        ("material", "uint", "index into materials"),
        ("first_primitive", "uint", "primitives of one shape are contiguous"),
        ("first_light", "uint", "light of the first primitive, or NONE; the others follow in order"),
        ("flags", "uint", "SHAPE_*"),
    ),
    "Material": (
        ("color", "float4", "rgb reflectance; w probability that the constant roulette ends a path here"),
        ("kind", "uint", "MATERIAL_*"),
        ("ior", "float", "index inside (behind the front side) over index outside"),
        ("medium", "uint", "behind the front: row of media_rows; 0: none that paths keep account of"),
        ("row", "uint", "of kind MATERIAL_BY_ROW: which pair of material_rows it has"),
    ),
    "Light": (
        (
            "radiance",
            "float4",
            "rgb: radiance W/(sr m2), at a point: (largest) intensity W/sr, directional: irradiance W/m2",
        ),
        ("position", "float4", "at a point: position; directional and sun: unit direction of travel"),
        (
            "axis",
            "float4",
            "lamp: unit, middle of its light; spot: w 1 - cosine of half its cone; plugin: x row of its own",
        ),
        (
            "zero",
            "float4",
            "unit; IES: horizontal angle 0, projector: right; spot: w one over what the cosine gains in its fall",
        ),
        ("kind", "uint", "LIGHT_*"),
        ("primitive", "uint", "area lights: row of the primitive that shines; others that move: first knot; or NONE"),
        ("probability", "float", "with which the alias table picks this light"),
        ("alias_threshold", "float", "Vose: keep this entry when the rescaled number is below it"),
        ("alias", "uint", "otherwise take this one"),
        ("place", "uint", "in the tree of lights; NONE where the alias table picks"),
        ("texture", "uint", "number of the texture that it shines as, plus 1; 0: none, it is the same all over"),
        ("table", "uint", "IES, projector: row of lamp_tables where its own begins"),
        ("offset", "uint", "of a moving light: number of its primitive, less the row"),
        ("unused", "uint[3]", ""),
    ),
    "Camera": (
        ("origin", "float4", "xyz, metres"),
        ("corner", "float4", "from origin to the top left corner of the image plane at focus distance"),
        (
            "right",
            "float4",
            "whole width of that plane, left to right; unit of panoramas, fisheyes and calibrated cameras",
        ),
        ("down", "float4", "whole height of it, top to bottom; of those, unit"),
        ("axis", "float4", "from origin to the middle of that plane; of those, unit"),
        ("lens_u", "float4", "aperture radius along image right; 0: pinhole"),
        ("lens_v", "float4", "aperture radius along image up"),
        ("world", "float4", "xyz: where the origin of all coordinates on the device lies in world space"),
        ("focal", "float4", "calibrated: focal lengths in widths and heights of the image, skew; distance in focus"),
        ("principal", "float4", "calibrated: principal point in widths and heights; tangential coefficients"),
        ("radial", "float4", "calibrated: k1 to k3, or k1 to k4 of Kannala-Brandt"),
        ("rational", "float4", "calibrated: k4 to k6"),
        ("field", "float4", "calibrated: largest radius, or angle, of the image; end of the field of the lens"),
        ("around", "float4", "xyz: the origin of one of its rays, around which the media are known"),
        ("interior_first", "uint", "those, highest first, a byte each from the highest on"),
        ("interior_last", "uint", "and four more of them"),
        ("kind", "uint", "CAMERA_*"),
        ("blades", "uint", "corners of the lens; 0: a disk"),
        ("blade_turn", "float", "where the first corner is, fraction of a turn from image right to up, below 1"),
        ("aspect", "float", "fisheye: width over height of the image"),
        ("angle", "float", "fisheye: from the axis to the upper edge, fraction of a turn"),
        ("cuts_media", "uint", "whether other media may be around the origins of its other rays"),
        ("first_knot", "uint", "of a moving camera: row of camera_knots where its motion begins"),
        ("segments", "uint", "between its knots; 0: it rests"),
        (
            "readout",
            "float",
            "rolling shutter: share of the interval between the first row's opening and the last row's",
        ),
        ("open", "float", "share of the interval for which each row is open"),
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
        (
            "light_samples",
            "uint",
            "MIS: samples of lights at a diffuse hit that the weights count; 0: BSDF sampling alone",
        ),
        ("bsdf_samples", "uint", "MIS: samples of the BSDF at the first diffuse hit; 0: light sampling alone"),
        ("light_count", "uint", ""),
        ("environment", "uint", "index of the environment light, or NONE"),
        ("triangle_count", "uint", "primitives below it are triangles, the rest analytic_shapes"),
        ("primitive_count", "uint", ""),
        ("lights_equal", "uint", "1: each light of the alias table keeps its own entry"),
        ("light_levels", "uint", "of the tree of lights; 0: the alias table picks"),
        ("reuse", "uint", "pixels that share their indirect light: 1, 2, 4, 8 or 16"),
        ("filter_negative", "uint", "pixel filter: the first of its lines where it is negative"),
        (
            "filter_weight",
            "float",
            "of a sample: integral of the filter's absolute value over that of the filter; 0: a box",
        ),
        ("replicate_spp", "uint", "samples of a replicate, a power of two; 0: a pixel's samples are one sequence"),
        ("filter_lines", "float[256]", "FILTER_LINES times FILTER_LINE_*, from the pixel's centre outwards"),
        ("bounds", "float4", "of integrators whose paths start at lights: a sphere around all that rays can hit"),
        ("light_paths", "uint", "of those: paths from the lights for each sample of all pixels"),
        ("filter_radius", "float", "pixels"),
        ("specular_chains", "uint", "1: light over chains of deltas is sampled"),
        ("has", "uint", "HAS_*: what of the features that kernels are compiled for this scene has"),
        ("left", "uint", "first column of the image that is rendered"),
        ("top", "uint", "first row"),
        ("less_width", "uint", "columns of the image that are not rendered"),
        ("less_height", "uint", "rows"),
        ("views", "uint", "cameras whose images lie below each other in the film; 0: there is one"),
        ("view_rows", "uint", "rows of the film for each of them, a multiple of 4"),
        ("spectral", "uint", "1: wavelengths in the place of red, green and blue; 2: the film has three bands of them"),
        (
            "bands",
            "uint",
            "1024 times the number of the first of these, plus that of all bands; kernels do not read it",
        ),
    ),
}

# table -> ((column, offset, count, comment), ...). Rows are sixteen numbers (kernels/core/lane.h, lane_rows).
# Offsets that a triangle and a sphere or disk, or two kinds of light, use differently have several names.
ROWS: Final[Mapping[str, tuple[tuple[str, int, int, str], ...]]] = {
    "FIELD": (
        ("BINS", 0, 64, "bits: the bin of each of FIELD_BINS equal shares of the directions, four in a word"),
        ("SHARES", 64, 64, "bits: how many of them each bin has, four in a word"),
        ("GUIDED", 128, 1, "share of the directions from here that are drawn from this histogram; 0: none"),
        ("REFLECTED", 129, 1, "luminance that later events bring, relative to the albedo; 0: not known"),
        ("OUTGOING", 130, 1, "the same with light straight from the lights"),
        ("LIGHT", 131, 1, "probability that light samples are taken"),
    ),
    "RECORD": (
        (
            "PLACE",
            0,
            1,
            "bits: the cell's place in the nodes, times FIELD_BINS, plus the direction's bin; NONE: there is no record",
        ),
        ("PDF", 1, 1, "density of the direction, per steradian"),
        ("BSDF_PDF", 2, 1, "that of the BSDF"),
        ("FIELD_PDF", 3, 1, "that of the cell's histogram; 0: it has none"),
        ("THROUGHPUT", 4, 3, "before the event"),
        ("ALBEDO", 7, 1, "luminance of the BSDF's albedo"),
        ("BEFORE", 8, 3, "radiance that the path had found before the vertex, W/(sr m2)"),
        ("AFTER", 11, 3, "and with the light of its light samples there"),
        ("RECORD_SPARE", 14, 2, ""),
    ),
    "INSPECT_SAMPLE": (
        ("USED", 0, 1, "recorded path, head of a sample, bits: rows that it would take, this one included"),
        ("DEPTH", 1, 1, "bits: scattering events"),
        ("RADIANCE", 2, 3, "that the path found, W/(sr m2), or at three wavelengths"),
        ("VALUE", 5, 3, "what the sample adds to its pixel, red, green and blue"),
        ("WAVELENGTHS", 8, 3, "nm; 0: none"),
        ("FILTER", 11, 1, "weight of the pixel filter, with its sign"),
        ("REST", 12, 3, "part of the radiance whose rows were left out"),
        ("ENDS", 15, 1, "bits: 1 when the sample is complete"),
        ("TIME", 16, 1, "while the shutter is open, 0 to 1"),
        ("SAMPLE_SPARE", 17, 31, ""),
    ),
    "INSPECT_VERTEX": (
        ("KIND", 0, 1, "bits: INSPECT_VERTEX; INSPECT_LIGHT_START or INSPECT_LIGHT_VERTEX: throughputs are fluxes"),
        ("DEPTH", 1, 1, "bits: scattering events before it"),
        ("FLAGS", 2, 1, "bits: INSPECT_*"),
        ("PRIMITIVE", 3, 1, "bits"),
        ("MATERIAL", 4, 1, "bits: MATERIAL_*; of the start of a light path LIGHT_*"),
        ("DISTANCE", 5, 1, "from the origin of its ray, metres"),
        ("POINT", 6, 3, "relative to the scene's origin; of a ray that left the scene nothing"),
        ("NORMAL", 9, 3, "of the geometry, unit, out of the front"),
        ("SHADING", 12, 3, "shading normal, on the side that the path came from"),
        ("ORIGIN", 15, 3, "of the ray that arrived"),
        ("ARRIVES", 18, 3, "its direction"),
        ("BEFORE", 21, 3, "throughput with which the path arrived"),
        ("LEAVES", 24, 3, "direction in which it goes on"),
        ("WEIGHT", 27, 3, "f |cosine| / pdf"),
        ("PDF", 30, 1, "density of this direction, per steradian; 0: a delta"),
        ("BSDF_PDF", 31, 1, "that of the BSDF alone, where the path is guided"),
        ("SURVIVAL", 32, 1, "probability that roulette lets it go on"),
        ("RANDOM", 33, 1, "number that it was compared with: it goes on below the survival"),
        ("AFTER", 34, 3, "throughput with which it goes on"),
        ("SHARE", 37, 1, "share of the directions that are the guiding field's"),
        ("LIGHT_SHARE", 38, 1, "probability that light samples are taken"),
        ("LIGHT", 39, 1, "bits: the light that it is, or NONE"),
        ("INDEX", 40, 1, "squared index of refraction beyond, relative to where the path began"),
        ("VERTEX_SPARE", 41, 7, ""),
    ),
    "INSPECT_LIGHT": (
        ("KIND", 0, 1, "bits: INSPECT_LIGHT_SAMPLE, INSPECT_EMISSION, INSPECT_CHAIN, INSPECT_GLOW or INSPECT_JOIN"),
        ("DEPTH", 1, 1, "bits: scattering events before it"),
        ("FLAGS", 2, 1, "bits: INSPECT_*"),
        ("ORDER", 3, 1, "bits: number of the addition to the sample's radiance; 0: nothing was added"),
        ("LIGHT", 4, 1, "bits: number of the light, or NONE"),
        ("LIGHT_KIND", 5, 1, "bits: LIGHT_*"),
        ("TARGET", 6, 3, "point of the light, or a direction if it is infinitely far away; or vertex of a light path"),
        ("DIRECTION", 9, 3, "unit, towards the light"),
        ("EMITTED", 12, 3, "radiance from there; or flux that arrives at the vertex of a light path"),
        ("LIGHT_PDF", 15, 1, "density of light samples, with the choice of the light, or of a light path; per sr"),
        ("CHOICE", 16, 1, "probability of the choice"),
        ("BSDF_PDF", 17, 1, "density of directions of the BSDF, and of the guiding field"),
        ("LIGHT_WEIGHT", 18, 1, "MIS weight of light samples"),
        ("BSDF_WEIGHT", 19, 1, "MIS weight of directions of the BSDF"),
        ("UNSHADOWED", 20, 3, "what it adds if nothing is in the way"),
        ("ADDED", 23, 3, "what it added to the radiance"),
        ("COLOR", 26, 3, "the same as red, green and blue of the film"),
        ("THROUGHPUT", 29, 3, "of the path there"),
        ("PATH", 32, 1, "bits: number of the light path that it was connected with"),
        ("EVENTS", 33, 1, "bits: scattering events of that before its vertex"),
        ("STANDS_FOR", 34, 1, "vertices of that which this one stands for"),
        ("LIGHT_SPARE", 35, 13, ""),
    ),
    "SPLAT": (
        ("PATH", 0, 1, "listed splat, bits: number of the light path among those of its sample"),
        ("DEPTH", 1, 1, "bits: scattering events before the vertex that the camera sees"),
        ("WEIGHT", 2, 1, "MIS weight"),
        ("COLOR", 3, 3, "what it adds to the pixel, red, green and blue of the film"),
    ),
    "CHAIN_HEAD": (
        ("LIGHTS", 0, 1, "bits: number of lights that specular chains lead to"),
        ("ALL_LIGHTS", 1, 1, "bits: of all"),
        ("SURFACES", 2, 1, "bits: of primitives that may be deltas"),
        ("FIRST_SURFACE", 3, 1, "bits: word of the first of those"),
        ("GLASS", 4, 1, "bits: 1 if any of them is glass"),
        ("HEAD_SPARE", 5, 11, ""),
    ),
    "INSTANCE": (
        ("TO_OBJECT", 0, 12, "first row of an instance: world to object, three rows of the linear part and the offset"),
        ("ROOT", 12, 1, "bits: of its group's tree, a reference"),
        ("MASKED_ROOT", 13, 1, "bits: of the tree over what rays may pass in it"),
        ("TRIANGLE_OFFSET", 14, 1, "bits: number of its triangle, less that of the triangle's row"),
        ("ANALYTIC_OFFSET", 15, 1, "bits: the same of what is no triangle"),
    ),
    "PLACEMENT": (
        ("TO_WORLD", 0, 12, "second row of an instance: object to world"),
        ("FIRST", 12, 1, "bits: number of its first primitive"),
        ("FIRST_ANALYTIC", 13, 1, "bits: and of the first that is no triangle"),
        ("SCALE", 14, 1, "factor of lengths, of a similarity"),
        ("FACING", 15, 1, "-1 if it mirrors, else 1"),
    ),
    "MOTION": (
        ("ROTATION", 0, 4, "knot of a motion: quaternion of about unit length, the scalar last"),
        ("OFFSET", 4, 3, ""),
        ("STRETCH", 7, 6, "symmetric matrix, before the rotation: xx, yy, zz, xy, xz, yz"),
        ("TIME", 13, 1, "share of the interval, from 0 on"),
        ("INVERSE_SPAN", 14, 1, "one over the time to the next knot"),
        ("SEGMENTS", 15, 1, "bits: of the first knot of a light's motion, the ways between its knots"),
    ),
    "PRIMITIVE": (
        ("A", 0, 3, "triangle: its vertices"),
        ("B", 3, 3, ""),
        ("C", 6, 3, ""),
        ("CENTER", 0, 3, "sphere or disk"),
        ("RADIUS", 3, 1, ""),
        ("NORMAL", 4, 3, "disk: unit normal; sphere: 0"),
        ("FACING", 7, 1, "sphere: +1 front outside, -1 front inside; of curves at least ANALYTIC_SHAPE_CURVE"),
        ("COLOR", 9, 3, "reflectance"),
        ("MATERIAL", 9, 1, "bits, in its place of MATERIAL_BY_ROW: which pair of rows"),
        ("TERMINATION", 12, 1, "probability that the constant roulette ends a path here"),
        ("IOR", 13, 1, "index behind the front over index before it"),
        ("LIGHT", 14, 1, "bits: index of the light it is, or NONE"),
        ("KIND", 15, 1, "bits: MATERIAL_*, and the shape's flags from bit ROW_FLAGS on"),
    ),
    "MATERIAL": (
        ("KIND", 0, 1, "bits: MATERIAL_*"),
        ("COLOR", 1, 3, "reflectance, base colour, or f0"),
        ("ROUGHNESS", 4, 1, "of reflection and transmission; its square is alpha of GGX"),
        ("METALLIC", 5, 1, "share of metal"),
        ("IOR", 6, 1, "index behind the front over index before it"),
        ("TRANSMISSION", 7, 1, "share of what is no metal that is glass"),
        ("SPECULAR", 8, 1, "strength of reflection by what is no metal"),
        ("SPECULAR_COLOR", 9, 3, "its colour where it is seen straight on"),
        ("DIFFUSE_ROUGHNESS", 12, 1, "r of EON"),
        ("COAT", 13, 1, "share of the surface with a clear coat"),
        ("COAT_ROUGHNESS", 14, 1, ""),
        ("FLAGS", 15, 1, "bits: MATERIAL_FLAG_*"),
        ("WEIGHT", 1, 1, "mix: share of the second material"),
        ("FIRST", 2, 1, "mix, bits: row of the first"),
        ("SECOND", 3, 1, "mix, bits: row of the second"),
        ("PLUGIN", 5, 1, "plugin, bits: its number among those of the scene"),
        ("HAIR_VARIANCE", 5, 1, "hair: of its first lobe along the fibre"),
        ("HAIR_SPREAD", 7, 1, "hair: scale of its lobes around the fibre"),
        ("HAIR_PER_LOGARITHM", 8, 1, "hair: root of the absorption, over log2 of the reflectance"),
        ("MEASURED", 5, 1, "measured, bits: the row of measured_rows where its head begins"),
        ("NUMBERS", 7, 8, "plugin: what its parameters are, the first half"),
    ),
    "LAYER": (
        ("SHEEN_COLOR", 0, 3, "second row of a material"),
        ("SHEEN_ROUGHNESS", 3, 1, ""),
        ("ANISOTROPY", 4, 1, "strength: 0 alike in all directions, 1 most"),
        ("ROTATION", 5, 1, "of the direction of most roughness from the tangent, in turns"),
        ("ETA", 6, 3, "metal: its index of refraction over that of the medium before it, real part"),
        ("K", 9, 3, "and imaginary part"),
        ("FRESNEL", 12, 3, "and the cosine-weighted average of its Fresnel term"),
        ("DIFFUSE_TRANSMISSION", 6, 1, "principled: share of the diffuse light that leaves on the other side"),
        ("DIFFUSE_TRANSMISSION_COLOR", 7, 3, "and its colour"),
        ("HAIR_ETA", 9, 1, "hair: index of refraction"),
        ("HAIR_TILT_SINE", 10, 1, "hair: of the tilt of its scales"),
        ("HAIR_TILT_COSINE", 11, 1, ""),
        ("MORE_NUMBERS", 6, 8, "plugin: the second half of what its parameters are"),
        ("OPACITY", 15, 1, "or, where it is a texture, the value below which that is a hole; 0: it counts as it is"),
    ),
    "ATTRIBUTE": (
        ("UV", 0, 6, "triangle: texture coordinates at A, B and C"),
        ("UV_1", 6, 6, "and of the second set"),
        ("X", 0, 3, "sphere: axes of its longitude and latitude; disk: axes of its texture coordinates"),
        ("Y", 3, 3, ""),
        ("Z", 6, 3, ""),
        ("COLORS", 12, 1, "bits: of a triangle: the row with the colours of A, B and C; 0: none"),
        ("HOLES", 13, 1, "bits: of a triangle: its row of holes (geometry/find.h)"),
        ("TANGENTS", 14, 1, "bits: of a triangle: the row with the tangents of A, B and C; 0: none"),
        ("SLOTS", 15, 1, "bits: the row of textures of its material"),
    ),
    "TANGENT": (
        ("A", 0, 3, "unit tangents at the vertices of a triangle: the directions of red in a normal map"),
        ("B", 3, 3, ""),
        ("C", 6, 3, ""),
        ("SIGN", 9, 1, "+1 or -1: green is that times normal x tangent"),
    ),
    "TEXTURE": (
        ("FIRST", 0, 1, "bits: its first tile"),
        ("WIDTH", 1, 1, "bits: texels"),
        ("HEIGHT", 2, 1, "bits"),
        ("FORMAT", 3, 1, "bits: 0-2 logarithm of the bytes of a texel, 3 TEXEL_FOUR, 4 TEXEL_FLOAT, 5-6 WRAP_* of u,"),
        ("VALUES", 4, 1, "bits: where the table of what its numbers stand for begins;   7-8 of v, 9-10 FILTER_*,"),
        (
            "ALPHAS",
            5,
            1,
            "bits: the same of its alpha;   11-13 channel, 14 set of texture coordinates, 15 TEXTURE_PLUGIN",
        ),
        ("U", 6, 3, "column of the picture, 0 to 1: what to multiply u and v by, and what to add"),
        ("V", 9, 3, "row of the picture, 0 at its top, likewise"),
        ("FACTOR", 12, 3, "of the value"),
        ("BIAS", 15, 1, "added then"),
        ("PLUGIN", 0, 1, "plugin, bits: its number among those of the scene"),
        ("NUMBERS", 4, 1, "plugin, bits: the row of what its parameters are"),
    ),
    "MEDIUM": (
        ("IOR", 0, 1, "of a dielectric: its index of refraction; row 0: 1"),
        ("SIGMA", 1, 3, "absorption coefficients, per metre"),
        ("UNRANKED", 4, 1, "bits, in row 0: so many media have no priority"),
        ("GRID", 4, 1, "bits, in other rows: of media with a grid, the row of grid_rows where its head begins"),
        ("EXTINCTION", 5, 3, "absorption and scattering coefficients together, per metre"),
        ("SCATTERING", 8, 3, "scattering coefficients"),
        ("G", 11, 1, "mean cosine of scattering: Henyey and Greenstein's parameter"),
        ("ALBEDO", 12, 3, "of subsurface materials: share of light that a flat, thick piece returns"),
        ("EMISSION", 12, 3, "of media that shine: radiance that a metre of them adds"),
        ("FLAGS", 15, 1, "bits: MEDIUM_FLAG_*"),
    ),
    "CURVE": (("COEFFICIENTS", 0, 16, "of u^0 to u^3, each of x, y, z and the radius: geometry/curve.inc"),),
    "GRID": (
        (
            "X",
            0,
            4,
            "head of a grid, two rows: from the world to its coordinates, a row of the matrix each: medium/grid.h",
        ),
        ("Y", 4, 4, ""),
        ("Z", 8, 4, ""),
        ("HIGH", 12, 3, "where it ends; it begins at 0.5"),
        ("SIDE", 15, 1, "steps between values along a brick"),
        ("BRICKS", 16, 3, "how many there are along each axis"),
        ("TABLE", 19, 1, "bits: word of the bricks' entries, each the word of its values, bits, and its majorant"),
        ("VALUES", 20, 1, "bits: word from which those words count"),
        ("ALBEDO", 21, 1, "bits: row of grid_rows where the table of its albedo begins; 0: none"),
        ("EMISSION", 22, 1, "likewise, of what its emission is multiplied by"),
    ),
    "GRID_COLORS": (
        ("X", 0, 4, "table of a medium's colours, two rows: from the world to its coordinates; medium/grid_colors.h"),
        ("Y", 4, 4, ""),
        ("Z", 8, 4, ""),
        ("LAST", 12, 3, "of its numbers along each axis the last"),
        ("CHANNELS", 15, 1, "bits: 1 or 3"),
        ("VALUES", 16, 1, "bits: word of grid_words where its numbers begin"),
        ("COLORS", 17, 1, "bits: word where the colours begin that numbers stand for; 0: for themselves"),
        ("COLOR_SCALE", 18, 1, "by which a number, less the next, is its temperature over that of the first colour"),
        ("COLOR_OFFSET", 19, 1, ""),
        ("COLOR_LAST", 20, 1, "place of the last"),
    ),
    "MEASURED": (
        ("FLAGS", 0, 1, "head of measured reflectance, two rows, all bits: MEASURED_*; material/lobe/measured.h"),
        ("THETAS", 1, 1, "numbers of polar angles and azimuths of viewers"),
        ("PHIS", 2, 1, ""),
        (
            "NORMALS_WIDTH",
            3,
            1,
            "sides of the densities of normals and luminance, of D and of σ",
        ),
        ("NORMALS_HEIGHT", 4, 1, ""),
        ("SIDE", 5, 1, ""),
        ("FACETS_WIDTH", 6, 1, ""),
        ("FACETS_HEIGHT", 7, 1, ""),
        ("PROJECTED_WIDTH", 8, 1, ""),
        ("PROJECTED_HEIGHT", 9, 1, ""),
        ("ANGLES", 16, 1, "words of measured_words where each begins: polar angles and then azimuths"),
        ("NORMALS", 17, 1, "density, its integrals along each row, and over the rows"),
        ("NORMALS_ROWS", 18, 1, ""),
        ("NORMALS_COLUMN", 19, 1, ""),
        ("LUMINANCE", 20, 1, "likewise"),
        ("LUMINANCE_ROWS", 21, 1, ""),
        ("LUMINANCE_COLUMN", 22, 1, ""),
        ("VALUES", 23, 1, ""),
        ("FACETS", 24, 1, ""),
        ("PROJECTED", 25, 1, ""),
        ("ALBEDO", 26, 1, "colour of the light that is reflected towards each viewer"),
    ),
    "NORMAL": (
        ("A", 0, 3, "unit normals at the vertices of a triangle of a smooth shape"),
        ("B", 3, 3, ""),
        ("C", 6, 3, ""),
    ),
    "LIGHT": (
        ("RADIANCE", 0, 3, "or intensity, or irradiance; of a texture the mean"),
        ("KIND", 3, 1, "bits: LIGHT_*, and from bit LIGHT_TEXTURE on, which texture"),
        ("PROBABILITY", 4, 1, "with which the alias table picks it"),
        ("PLACE", 4, 1, "bits: its leaf in the light BVH, where there is one"),
        ("PRIMITIVE", 5, 1, "bits: the primitive that shines, or where the motion of another light begins, or NONE"),
        ("A", 6, 3, "triangle: vertex A"),
        ("AB", 9, 3, "B - A"),
        ("AC", 12, 3, "C - A"),
        ("INVERSE", 15, 1, "one over the length of AB x AC, twice the area"),
        ("CENTER", 6, 3, "sphere or disk"),
        ("RADIUS", 9, 1, ""),
        ("FACING", 10, 1, "sphere: +1 shines outwards, -1 inwards"),
        ("NORMAL", 12, 3, "disk"),
        ("POSITION", 6, 3, "light at a point"),
        ("AXIS", 9, 3, "lamp: unit, the middle of its light"),
        ("SPREAD", 12, 1, "spot: 1 - cosine of half its cone"),
        ("STEEPNESS", 13, 1, "spot: one over what the cosine grows by as it falls off"),
        ("ZERO", 12, 3, "unit; IES: where horizontal angle 0 is, projector: right"),
        ("TABLE", 15, 1, "IES, projector, bits: row of lamp_tables where its own begins"),
        ("GIVEN", 9, 1, "plugin: row of lamp_tables where its own begin, a number; light_at puts the rest here"),
        ("DIRECTION", 6, 3, "directional light, middle of the sun: of travel, unit"),
    ),
    "ENVIRONMENT": (
        ("WIDTH", 0, 1, "head of the environment's picture: bits: pixels"),
        ("HEIGHT", 1, 1, "bits"),
        ("TURN", 2, 1, "fraction of a turn that it is rotated by, about +y"),
        ("INVERSE", 3, 1, "one over the integral by solid angle of what samples are in proportion to"),
        ("BAND_GUIDES", 4, 1, "bits: entries of the guide table of the bands, less one"),
        ("GUIDES", 5, 1, "bits: entries of each row's guide table, less one"),
        ("COMPENSATION", 6, 1, "luminance that light samples leave to those of the BSDF: the mean, or 0"),
    ),
    "BAND": (
        ("SHARE", 0, 1, "between two lines of latitude, half a row: share of the light that lies before the first"),
        ("NEXT_SHARE", 1, 1, "before the second"),
        ("SUM", 2, 1, "of the luminance along the first"),
        ("NEXT_SUM", 3, 1, ""),
        ("DROP", 4, 1, "1 - |cosine| from the nearer pole; in the south, of the band that mirrors it"),
        ("NEXT_DROP", 5, 1, ""),
    ),
    "LAMP": (
        ("LINES", 0, 1, "head of the table of an IES file or a picture: bits: vertical angles, or heights"),
        ("COLUMNS", 1, 1, "bits: horizontal angles, or places across"),
        ("LINE", 2, 1, "bits: word where the vertical angles begin, fractions of a turn, or heights over the distance"),
        ("COLUMN", 3, 1, "bits: the horizontal ones, 0 to 1, or places to the right over the distance"),
        ("VALUE", 4, 1, "bits: intensities over the largest, line by line; of a picture red, then green, then blue"),
        ("DROP", 5, 1, "bits: 1 - cosine of each vertical angle"),
        ("BAND", 6, 1, "bits: share of the light before each vertical angle, or height"),
        ("CELL", 7, 1, "bits: of the light between two of them, share before each horizontal angle, or place"),
        ("EVEN", 8, 1, "picture, bits: whether it lights a screen evenly, else all of its directions"),
    ),
    "GIVEN": (
        ("PLUGIN", 0, 1, "light of a plugin, bits: its number among those of the scene; its parameters follow, a row"),
        ("SPREAD", 1, 1, "1 - cosine of half the cone that it shines into; 2: all around"),
        ("AXIS", 2, 3, "unit, its z axis"),
        ("RIGHT", 5, 3, "unit, its x axis"),
    ),
    "SUN": (
        ("RED", 0, 6, "table of the sun: coefficients of its radiance in the cosine at its surface, constant first"),
        ("GREEN", 6, 6, ""),
        ("BLUE", 12, 6, ""),
        ("AXIS", 18, 3, "unit, towards its middle"),
        ("SPREAD", 21, 1, "1 - cosine of its angular radius"),
        ("LIGHT", 22, 1, "bits: which light it is"),
    ),
    "LIGHT_VERTEX": (
        ("ORIGIN", 0, 3, "vertex of a light path: of the ray that met it"),
        ("DIRECTION", 3, 3, "unit"),
        ("FLUX", 6, 3, "that arrives, watts, of one path if it were the only one"),
        ("DISTANCE", 9, 1, "along the ray"),
        ("PRIMITIVE", 10, 1, "bits"),
        ("EDGE", 11, 1, "weights: kernels/bidirectional/techniques.h"),
        ("EARLIER", 12, 1, ""),
        ("DEPTH", 13, 1, "bits: scattering events before it"),
        ("MEDIA", 14, 2, "bits: those that the ray was in, highest first"),
    ),
    "CONE": (
        ("AXIS", 0, 3, "child of a node of the light BVH: unit, middle of a cone with all directions of its light"),
        ("COSINE", 3, 1, "of half the cone's angle"),
    ),
    "THIN_FILM": (
        ("SHARE", 0, 1, "film of a material: share of the surface that it is on"),
        ("SHARE_TEXTURE", 1, 1, "bits: the texture that stands for it, or NONE"),
        ("LEAST", 2, 1, "thickness, nanometres, where its texture is 0"),
        ("RANGE", 3, 1, "what is added where that is 1, or where there is none"),
        ("THICKNESS_TEXTURE", 4, 1, "bits: that texture, or NONE"),
        ("IOR", 5, 1, "its index over that of the medium before it"),
        ("INDEX", 6, 1, "its index"),
    ),
    "NODE": (
        ("CENTER", 0, 3, "child of a node of the light BVH: sphere about its lights"),
        ("RADIUS", 3, 1, "negative: infinitely far"),
        ("NORMAL", 4, 3, "mean of the lights' normals"),
        ("POWER", 7, 1, "relative to its sibling's"),
        ("SCALE", 0, 1, "in row 0: what lengths in the tree are multiplied by"),
    ),
    "ANCHOR": (
        ("ORIGIN", 0, 3, "path reuse, first row of a record: where rays leave the anchor"),
        ("SIDE", 3, 3, "geometric normal on the side seen"),
        ("SHADING", 6, 3, "shading normal on that side"),
        ("REFLECTS", 9, 3, "throughput times reflectance"),
        ("FROM", 12, 1, "bits: Ray.from"),
        ("DEPTH", 13, 1, "bits: scattering events before it"),
        ("SURVIVAL", 14, 1, "probability that a path leaves it"),
        ("FLAGS", 15, 1, "bits: RECORD_*"),
    ),
    "TARGET": (
        ("POINT", 0, 3, "path reuse, second row of a record: where rays to the target end"),
        ("SIDE", 3, 3, "geometric normal on the side that the path came from"),
        ("PRIMITIVE", 6, 1, "bits"),
        ("LIGHT", 7, 3, "radiance that leaves it, later over the sum of densities"),
        ("SEEN", 10, 1, "bits: which anchors of the group see it"),
    ),
    "ATLAS": (
        ("OWN", 0, 3, "final gather: radiance that the primitive's front sends out"),
        ("COUNTED", 3, 1, "1 where a gathering ray counts it, because no shadow ray looks for it"),
        ("FIRST", 4, 1, "bits: its first texel"),
        ("ALONG", 5, 1, "bits: texels along an edge"),
    ),
    "LOOK": (
        ("A", 0, 3, "display of radiosity, of a side: radiance reflected at the corners"),
        ("B", 3, 3, ""),
        ("C", 6, 3, ""),
        ("OWN", 9, 3, "radiance sent out by itself"),
    ),
    "DEPOSIT": (
        ("POINT", 0, 3, "what a photon leaves"),
        ("NORMAL", 3, 3, "of the surface, on the side that the photon came from; in a medium, its unit direction"),
        ("FLUX", 6, 3, "watts"),
        ("EVENTS", 9, 1, "scattering events before it; with a minus where all were at deltas: a caustic"),
        ("KIND", 10, 1, "bits: the medium that it scattered in, plus 1; on a surface 0, or from where it came"),
    ),
}

_SCALARS: Final[Mapping[str, tuple[str, tuple[int, ...]]]] = {
    "float4": ("<f4", (4,)),
    "float": ("<f4", ()),
    "uint": ("<u4", ()),
    "int": ("<i4", ()),
}


def columns(table: str) -> dict[str, int]:
    """Offsets of the columns of a row.

    Parameters
    ----------
    table : str
        A key of `ROWS`.

    Returns
    -------
    dict of str to int
        Column name to its offset.
    """
    return {name: first for name, first, _, _ in ROWS[table]}


@cache
def dtype(struct: str) -> np.dtype[np.void]:
    """NumPy dtype of a shared struct, little-endian, in OpenCL's memory layout.

    Parameters
    ----------
    struct : str
        A key of `STRUCTS`.

    Returns
    -------
    numpy.dtype
        Structured; ``float4`` members are sub-arrays of four ``float32``.
    """
    return np.dtype([(name, *_numbers(c_type)) for name, c_type, _ in STRUCTS[struct]])


def _numbers(c_type: str) -> tuple[str, tuple[int, ...]]:
    """NumPy's type and shape of a struct member."""
    scalar, _, count = c_type.partition("[")
    kind, shape = _SCALARS[scalar]
    return kind, (int(count[:-1]), *shape) if count else shape


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
            scalar, bracket, count = c_type.partition("[")
            declaration = f"    {scalar} {name}{bracket}{count};"
            lines.append(f"{declaration:<32}// {comment}" if comment else declaration)
        lines.append(f"}} {struct};")
    for table, columns in ROWS.items():
        lines.append("")
        for name, first, _, comment in columns:
            definition = f"#define {table}_ROW_{name} {first}"
            lines.append(f"{definition:<40}// {comment}" if comment else definition)
    return "\n".join([*lines, "", "#endif", ""])


if __name__ == "__main__":
    from pathlib import Path

    Path(__file__).resolve().parent.parent.joinpath("kernels", "types.h").write_text(types_header())
