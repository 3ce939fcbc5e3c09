// How much light the lobes of rough materials reflect, from tables (scripts/albedo_tables.py; clrender.scene.microfacets.albedo_tables).
// Rows: √alpha; columns: √(μ (1 + α) / (μ + α)) of the cosine μ, because it is a function of the slope over alpha where both are small.
#ifndef MATERIAL_ALBEDO_H
#define MATERIAL_ALBEDO_H

#include "core/exact.h"
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
static vfloat albedo_column(vfloat alpha, vfloat cosine) { return root(cosine * (splat(1.0f) + alpha) / (cosine + alpha)); }

// A number for each row of such a table.
static vfloat albedo_line(__global const float* tables, vuint first, uint rows, vfloat alpha) {
    const vfloat y = root(alpha) * (float)(rows - 1u);
    const vint row = vint_of(bounded(y, 0.0f, (float)(rows - 2u)));
    const vuint at = first + vuint_from_int(row);
    const vfloat a = lane_gather(tables, at), b = lane_gather(tables, at + 1u);
    return fma(y - vfloat_of(row), b - a, a);
}

// E(μ): what GGX facets that are perfect mirrors reflect of light along a direction at first.
static vfloat albedo_ggx(__global const float* tables, vfloat alpha, vfloat cosine) {
    const vfloat x = albedo_column(alpha, cosine) * (float)(GGX_COLUMNS - 1u);
    return albedo_at(tables, splat_uint(ALBEDO_GGX), GGX_ROWS, GGX_COLUMNS - 1u, GGX_COLUMNS - 1u, root(alpha) * (float)(GGX_ROWS - 1u), x);
}
// 1 − E_avg.
static vfloat albedo_ggx_lost(__global const float* tables, vfloat alpha) { return albedo_line(tables, splat_uint(ALBEDO_GGX_LOST), GGX_ROWS, alpha); }

// B(μ) / E(μ), where B is what E would be with facets that reflect (1 − c)^5, c the cosine at the facet: with Schlick's Fresnel term,
// f0 + (f90 − f0) (1 − c)^5, a surface reflects f0 E + (f90 − f0) B at first.
static vfloat albedo_grazing(__global const float* tables, vfloat alpha, vfloat cosine) {
    const uint words = SCHLICK_COLUMNS - 1u;
    const vfloat y = root(alpha) * (float)(SCHLICK_ROWS - 1u), x = root(cosine) * (float)words;
    const vfloat root5 = albedo_at(tables, splat_uint(ALBEDO_SCHLICK), SCHLICK_ROWS, words, words, y, x);
    const vfloat square = root5 * root5;
    return square * square * root5;
}
static vfloat albedo_grazing_average(__global const float* tables, vfloat alpha) { return albedo_line(tables, splat_uint(ALBEDO_GGX_SCHLICK), GGX_ROWS, alpha); }

// Facets that are rougher along x: by how much, from 0 to 1.
typedef struct {
    Alpha alpha;
    vfloat mean;             // of both alphas
    vmask turned;            // they differ
    vfloat strength;
} Facets;

// E of a direction above such facets.
static vfloat albedo_facets(__global const float* tables, const Facets* f, vec3 w) {
    const vfloat even = albedo_ggx(tables, f->mean, w.z);
    if (!lane_any(f->turned)) return even;
    const vfloat across = fma(w.x, w.x, w.y * w.y);
    const vfloat i = f->strength * (float)(TURNED_STRENGTHS - 1u), k = w.x * w.x * inverse_or_one(across) * (float)(TURNED_TURNS - 1u);
    const vint strength = vint_of(bounded(i, 0.0f, (float)(TURNED_STRENGTHS - 2u))), turn = vint_of(bounded(k, 0.0f, (float)(TURNED_TURNS - 2u)));
    const vfloat y = root(f->alpha.y) * (float)(TURNED_ROWS - 1u), x = albedo_column(f->mean, w.z) * (float)(TURNED_COLUMNS - 1u);
    const uint words = TURNED_COLUMNS - 1u, stride = TURNED_TURNS * words, next = TURNED_ROWS * stride;
    const vuint first = vuint_from_int(strength) * next + vuint_from_int(turn) * words + ALBEDO_TURNED;
    const vfloat further = i - vfloat_of(strength), around = k - vfloat_of(turn);
    const vfloat a = albedo_at(tables, first, TURNED_ROWS, stride, words, y, x), b = albedo_at(tables, first + words, TURNED_ROWS, stride, words, y, x);
    const vfloat c = albedo_at(tables, first + next, TURNED_ROWS, stride, words, y, x);
    const vfloat d = albedo_at(tables, first + (next + words), TURNED_ROWS, stride, words, y, x);
    const vfloat weak = fma(around, b - a, a), strong = fma(around, d - c, c);
    return f->turned ? fma(further, strong - weak, weak) : even;
}
static vfloat albedo_facets_lost(__global const float* tables, const Facets* f) {
    const vfloat even = albedo_ggx_lost(tables, f->mean);
    if (!lane_any(f->turned)) return even;
    const vfloat i = f->strength * (float)(TURNED_STRENGTHS - 1u);
    const vint strength = vint_of(bounded(i, 0.0f, (float)(TURNED_STRENGTHS - 2u)));
    const vuint first = vuint_from_int(strength) * TURNED_ROWS + ALBEDO_TURNED_LOST;
    const vfloat a = albedo_line(tables, first, TURNED_ROWS, f->alpha.y), b = albedo_line(tables, first + TURNED_ROWS, TURNED_ROWS, f->alpha.y);
    return f->turned ? fma(i - vfloat_of(strength), b - a, a) : even;
}

#endif
