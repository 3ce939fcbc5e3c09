// How much light the lobes of rough materials reflect, from tables (clrender.scene.microfacets.albedo_tables). Rows: √alpha; columns:
// √(μ (1 + α) / (μ + α)) of the cosine μ, because it is a function of the slope over alpha where both are small.
#ifndef MATERIAL_ALBEDO_H
#define MATERIAL_ALBEDO_H

#include "core/exact.h"
#include "types.h"

static vfloat albedo_low(vuint word) { return vfloat_of(vint_from_uint(word & 0xffffu)) * (1.0f / 65535.0f); }
static vfloat albedo_high(vuint word) { return vfloat_of(vint_from_uint(word >> 16)) * (1.0f / 65535.0f); }

static vfloat albedo_blend(vfloat a, vfloat b, vfloat c, vfloat d, vfloat right, vfloat down) {
    const vfloat upper = fma(right, b - a, a), lower = fma(right, d - c, c);
    return fma(down, lower - upper, upper);
}

// The two numbers of a table of that many rows and columns, which begins at word `first`, by bilinear interpolation.
static void albedo_pair(__global const float* tables, vuint first, uint size, vfloat alpha, vfloat cosine, vfloat* low, vfloat* high) {
    const float last = (float)(size - 1u);
    const vfloat y = root(alpha) * last, x = root(cosine * (splat(1.0f) + alpha) / (cosine + alpha)) * last;
    const vint row = vint_of(lesser(y, splat(last - 1.0f))), column = vint_of(lesser(x, splat(last - 1.0f)));
    const vfloat down = y - vfloat_of(row), right = x - vfloat_of(column);
    const vuint at = first + vuint_from_int(row) * size + vuint_from_int(column);
    const vuint a = vfloat_bits(lane_gather(tables, at)), b = vfloat_bits(lane_gather(tables, at + 1u));
    const vuint c = vfloat_bits(lane_gather(tables, at + size)), d = vfloat_bits(lane_gather(tables, at + size + 1u));
    *low = albedo_blend(albedo_low(a), albedo_low(b), albedo_low(c), albedo_low(d), right, down);
    *high = albedo_blend(albedo_high(a), albedo_high(b), albedo_high(c), albedo_high(d), right, down);
}

// A number for each row of such a table.
static vfloat albedo_line(__global const float* tables, vuint first, uint size, vfloat alpha) {
    const float last = (float)(size - 1u);
    const vfloat y = root(alpha) * last;
    const vint row = vint_of(lesser(y, splat(last - 1.0f)));
    const vuint at = first + vuint_from_int(row);
    const vfloat a = lane_gather(tables, at), b = lane_gather(tables, at + 1u);
    return fma(y - vfloat_of(row), b - a, a);
}

// What GGX facets that are perfect mirrors reflect of light along a direction at first, E(μ), and the same weighted by (1 − c)^5, c the
// cosine at the facet: with Schlick's Fresnel term, f0 + (f90 − f0) (1 − c)^5, a surface reflects f0 E + (f90 − f0) times the second.
static void albedo_ggx(__global const float* tables, vfloat alpha, vfloat cosine, vfloat* all, vfloat* grazing) {
    albedo_pair(tables, splat_uint(ALBEDO_GGX), GGX_TABLE_SIZE, alpha, cosine, all, grazing);
}
// 1 − E_avg.
static vfloat albedo_ggx_lost(__global const float* tables, vfloat alpha) {
    return albedo_line(tables, splat_uint(ALBEDO_GGX_LOST), GGX_TABLE_SIZE, alpha);
}

#endif
