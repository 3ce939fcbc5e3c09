// How much light the lobes of rough materials reflect, from tables (scripts/albedo_tables.py; clrender.flatten.microfacets.albedo_tables).
// Rows: √alpha; columns: √(μ (1 + α) / (μ + α)) of the cosine μ, because it is a function of the slope over alpha where both are small.
#ifndef MATERIAL_ALBEDO_H
#define MATERIAL_ALBEDO_H

#include "core/power.h"
#include "material/ggx.h"
#include "types.h"

// By bilinear interpolation at row `y` and column `x` of a table, two neighbours in a word. Rows are `stride` words apart.
static vfloat albedo_at(__global const float* tables, vuint first, uint rows, uint stride, uint words, vfloat y, vfloat x) {
    const vint row = vint_of(bounded(y, 0.0f, (float)(rows - 2u))), column = vint_of(bounded(x, 0.0f, (float)(words - 1u)));
    const vfloat down = y - vfloat_of(row), right = x - vfloat_of(column);
    const vuint at = first + vuint_from_int(row) * stride + vuint_from_int(column);
    const vuint a = vfloat_bits(lane_gather(tables, at)), b = vfloat_bits(lane_gather(tables, at + stride));
    const vfloat a0 = vfloat_of(vint_from_uint(a & 0xffffu)), a1 = vfloat_of(vint_from_uint(a >> 16));
    const vfloat b0 = vfloat_of(vint_from_uint(b & 0xffffu)), b1 = vfloat_of(vint_from_uint(b >> 16));
    const vfloat upper = fma(right, a1 - a0, a0), lower = fma(right, b1 - b0, b0);
    return fma(down, lower - upper, upper) * (1.0f / 65535.0f);
}
static vfloat albedo_column(vfloat alpha, vfloat cosine) { return root(quotient(cosine * (splat(1.0f) + alpha), cosine + alpha)); }

// A number for each row of such a table, interpolated at row `y`.
static vfloat albedo_between(__global const float* tables, vuint first, uint rows, vfloat y) {
    const vint row = vint_of(bounded(y, 0.0f, (float)(rows - 2u)));
    const vuint at = first + vuint_from_int(row);
    const vfloat a = lane_gather(tables, at), b = lane_gather(tables, at + 1u);
    return fma(y - vfloat_of(row), b - a, a);
}
static vfloat albedo_line(__global const float* tables, vuint first, uint rows, vfloat alpha) {
    return albedo_between(tables, first, rows, root(alpha) * (float)(rows - 1u));
}

// What is to be added to the places of the tables of GGX, for those of Beckmann's distribution. Only scenes that need them have them
// (-D BECKMANN).
static vuint albedo_base(vmask beckmann) {
#ifdef BECKMANN
    return beckmann ? splat_uint(ALBEDO_BECKMANN) : splat_uint(0u);
#else
    return splat_uint(0u);
#endif
}

// E(μ): what facets that are perfect mirrors reflect of light along a direction at first.
static vfloat albedo_even(__global const float* tables, vuint base, vfloat alpha, vfloat cosine) {
    const vfloat x = albedo_column(alpha, cosine) * (float)(GGX_COLUMNS - 1u);
    return albedo_at(tables, base + ALBEDO_GGX, GGX_ROWS, GGX_COLUMNS - 1u, GGX_COLUMNS - 1u, root(alpha) * (float)(GGX_ROWS - 1u), x);
}
// 1 − E_avg. The table has it over alpha^(3/2), and more rows: where alpha is small, it grows too fast to be interpolated.
static vfloat albedo_even_lost(__global const float* tables, vuint base, vfloat alpha) {
    return albedo_line(tables, base + ALBEDO_GGX_LOST, GGX_LOST_ROWS, alpha) * alpha * root(alpha);
}
static vfloat albedo_ggx(__global const float* tables, vfloat alpha, vfloat cosine) { return albedo_even(tables, splat_uint(0u), alpha, cosine); }
static vfloat albedo_ggx_lost(__global const float* tables, vfloat alpha) { return albedo_even_lost(tables, splat_uint(0u), alpha); }

// B(μ) / E(μ), where B is what E would be with facets that reflect (1 − c)^5, c the cosine at the facet: with Schlick's Fresnel term,
// f0 + (f90 − f0) (1 − c)^5, a surface reflects f0 E + (f90 − f0) B at first.
static vfloat albedo_grazing(__global const float* tables, vuint base, vfloat alpha, vfloat cosine) {
    const uint words = SCHLICK_COLUMNS - 1u;
    const vfloat y = root(alpha) * (float)(SCHLICK_ROWS - 1u), x = root(cosine) * (float)words;
    const vfloat root5 = albedo_at(tables, base + ALBEDO_SCHLICK, SCHLICK_ROWS, words, words, y, x);
    const vfloat square = root5 * root5;
    return square * square * root5;
}
static vfloat albedo_grazing_average(__global const float* tables, vuint base, vfloat alpha) {
    return albedo_line(tables, base + ALBEDO_GGX_SCHLICK, GGX_ROWS, alpha);
}

// How E, B or the albedo of sheen varies over μ: its components along two functions b and c, which have average 0 and with weight 2μ
// are orthonormal (scripts/albedo_tables.py).
typedef struct {
    vfloat b, c;
} Slant;

// `first`: of the table.
static Slant albedo_slant(__global const float* tables, vuint first, vfloat alpha) {
    const vfloat y = root(alpha) * (float)(SLANT_ROWS - 1u);
    const vint row = vint_of(bounded(y, 0.0f, (float)(SLANT_ROWS - 2u)));
    const vuint at = first + vuint_from_int(row);
    const vuint upper = vfloat_bits(lane_gather(tables, at)), lower = vfloat_bits(lane_gather(tables, at + 1u));
    const vfloat down = y - vfloat_of(row);
    const vfloat b0 = vfloat_of(vint_from_uint(upper & 0xffffu)), b1 = vfloat_of(vint_from_uint(lower & 0xffffu));
    const vfloat c0 = vfloat_of(vint_from_uint(upper >> 16)), c1 = vfloat_of(vint_from_uint(lower >> 16));
    Slant s;
    s.b = fma(fma(down, b1 - b0, b0), splat(0.2f / 65535.0f), splat(-0.05f));
    s.c = fma(fma(down, c1 - c0, c0), splat(0.2f / 65535.0f), splat(-0.05f));
    return s;
}

static Slant albedo_sheen_slant(__global const float* tables, vfloat alpha) {
    return albedo_slant(tables, splat_uint(ALBEDO_SLANTS + 2u * SLANT_ROWS), alpha);
}
// Of E (0) and B (1); `base`: albedo_base.
static Slant albedo_facets_slant(__global const float* tables, vuint base, uint which, vfloat alpha) {
    const vuint first = splat_uint(ALBEDO_SLANTS + which * SLANT_ROWS);
#ifdef BECKMANN
    return albedo_slant(tables, base != 0u ? splat_uint(ALBEDO_BECKMANN_SLANTS + which * SLANT_ROWS) : first, alpha);
#else
    return albedo_slant(tables, first, alpha);
#endif
}

// Facets that are rougher along x. E of a direction is nearly a function of the alpha that it sees, √(alpha_x² cos²φ + alpha_y² sin²φ),
// and between both alphas nearly linear in its logarithm.
typedef struct {
    Alpha alpha;
    vuint base;              // of the tables: albedo_base
    vfloat mean;             // of both alphas
    vmask turned;            // they differ
    vfloat row, apart;       // where they are in the tables
    vfloat stretch;          // cells of the table over the binary logarithm of a squared alpha
} Facets;

// `alpha` along y, the least one that counts, and the strength of anisotropy from 0 to 1 (glTF, KHR_materials_anisotropy).
static Facets facets_of(vfloat alpha, float least, vfloat strength, vmask beckmann) {
    Facets f;
    f.base = albedo_base(beckmann);
    f.alpha.y = greater(alpha, splat(least));
    f.alpha.x = fma(strength * strength, splat(1.0f) - f.alpha.y, f.alpha.y);
    f.mean = (f.alpha.x + f.alpha.y) * 0.5f;
    f.turned = strength > 0.0f;
    f.row = f.apart = f.stretch = splat(0.0f);
    if (!lane_any(f.turned)) return f;
    const vfloat most = root(f.alpha.x), ratio = quotient(f.alpha.x, f.alpha.y);
    f.row = most * (float)(TURNED_ROWS - 1u);
    f.apart = (most - root(f.alpha.y)) * inverse_or_one(most - root(splat(least))) * (float)(TURNED_APART - 1u);
    f.stretch = ratio > 1.0001f ? quotient(splat(0.5f * (float)(TURNED_TURNS - 1u)), log2_of(greater(ratio, splat(1.0001f)))) : splat(0.0f);
    return f;
}

// The alpha that a direction sees.
static vfloat albedo_seen(const Facets* f, vec3 w) {
    if (!lane_any(f->turned)) return f->mean;
    const vfloat across2 = fma(w.x, w.x, w.y * w.y), x = w.x * f->alpha.x, y = w.y * f->alpha.y;
    const vfloat seen2 = across2 > 1.0e-20f ? fma(x, x, y * y) * inverse_or_one(across2) : f->alpha.y * f->alpha.y;
    return f->turned ? lesser(greater(root(seen2), f->alpha.y), f->alpha.x) : f->mean;
}

// E of a direction above such facets.
static vfloat albedo_facets(__global const float* tables, const Facets* f, vec3 w) {
    const vfloat even = albedo_even(tables, f->base, f->mean, w.z);
    if (!lane_any(f->turned)) return even;
    const vfloat seen = albedo_seen(f, w), ratio = quotient(seen, f->alpha.y);
    const vfloat turn = log2_of(ratio) * 2.0f * f->stretch, column = albedo_column(seen, w.z) * (float)(TURNED_COLUMNS - 1u);
    const vint row = vint_of(bounded(f->row, 0.0f, (float)(TURNED_ROWS - 2u))), apart = vint_of(bounded(f->apart, 0.0f, (float)(TURNED_APART - 2u)));
    const uint words = TURNED_COLUMNS - 1u, part = TURNED_TURNS * words, next = TURNED_APART * part;
    const vuint first = f->base + vuint_from_int(row) * next + vuint_from_int(apart) * part + ALBEDO_TURNED;
    const vfloat a = albedo_at(tables, first, TURNED_TURNS, words, words, turn, column);
    const vfloat b = albedo_at(tables, first + part, TURNED_TURNS, words, words, turn, column);
    const vfloat c = albedo_at(tables, first + next, TURNED_TURNS, words, words, turn, column);
    const vfloat d = albedo_at(tables, first + (next + part), TURNED_TURNS, words, words, turn, column);
    const vfloat further = f->apart - vfloat_of(apart), upper = fma(further, b - a, a), lower = fma(further, d - c, c);
    return f->turned ? fma(f->row - vfloat_of(row), lower - upper, upper) : even;
}
static vfloat albedo_facets_lost(__global const float* tables, const Facets* f) {
    const vfloat even = albedo_even_lost(tables, f->base, f->mean);
    if (!lane_any(f->turned)) return even;
    const vint row = vint_of(bounded(f->row, 0.0f, (float)(TURNED_ROWS - 2u)));
    const vuint first = f->base + vuint_from_int(row) * TURNED_APART + ALBEDO_TURNED_LOST;
    const vfloat a = albedo_between(tables, first, TURNED_APART, f->apart), b = albedo_between(tables, first + TURNED_APART, TURNED_APART, f->apart);
    return f->turned ? fma(f->row - vfloat_of(row), b - a, a) * f->mean * root(f->mean) : even;
}

#endif
