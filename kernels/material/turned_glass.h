// How much light rough glass reflects and passes at first whose facets are rougher along x: tables over both alphas, the index, and the
// azimuth and the cosine of a direction (scripts/albedo_tables.py). Only scenes that need them have them (-D TURNED_GLASS).
#ifndef MATERIAL_TURNED_GLASS_H
#define MATERIAL_TURNED_GLASS_H

#include "material/albedo.h"

// A place between the nodes of a table: the lower one, and how far the next is.
typedef struct {
    vuint node;
    vfloat further;
} Between;

static Between between_nodes(vfloat place, uint nodes) {
    const vfloat y = place * (float)(nodes - 1u);
    const vint lower = vint_of(bounded(y, 0.0f, (float)(nodes - 2u)));
    Between b;
    b.node = vuint_from_int(lower);
    b.further = y - vfloat_of(lower);
    return b;
}
static vuint between_node(const Between* b, uint upper) { return b->node + upper; }
static vfloat between_weight(const Between* b, uint upper) { return upper ? b->further : splat(1.0f) - b->further; }

// Where the tables have an index and alphas, from 0 to 1 each.
typedef struct {
    vfloat layer, row, apart;
    vfloat critical;         // cosine of the critical angle
} TurnedGlass;

static vfloat turned_glass_bend(vfloat apart, vfloat wide) { return quotient(apart, absolute(apart) + wide); }

// E of light within the denser medium or the thinner one, along `w`.
static vfloat turned_glass_albedo(__global const float* tables, const Facets* f, const TurnedGlass* g, vmask denser, vec3 w) {
    const vfloat x2 = w.x * w.x, across2 = fma(w.y, w.y, x2), least = f->alpha.y, most = f->alpha.x;
    const vfloat along_x = across2 > 1.0e-20f ? x2 * inverse_or_one(across2) : splat(0.0f);
    const vfloat seen2 = fma(along_x, fma(most, most, -(least * least)), least * least), seen = root(seen2);
    const vfloat ratio = greater(quotient(most, least), splat(1.000001f)), relative = greater(quotient(seen2, least * least), splat(1.0f));
    const vfloat turn = fma(lesser(quotient(log2_of(relative) * 0.5f, log2_of(ratio)), splat(1.0f)), splat(0.4f), along_x * 0.6f);
    const vfloat wide = fma(seen, splat(3.0f), most * 0.6f), low = turned_glass_bend(-g->critical, wide);
    const vfloat bend = quotient(turned_glass_bend(w.z - g->critical, wide) - low, turned_glass_bend(splat(1.0f) - g->critical, wide) - low);
    const vfloat by_slope = albedo_column(seen, w.z) + albedo_column(most, w.z);
    const vfloat column = denser ? fma(by_slope, splat(0.4f), bend * 0.2f) : by_slope * 0.5f;

    const Between layer = between_nodes(g->layer, TURNED_GLASS_LAYERS), row = between_nodes(g->row, TURNED_GLASS_ROWS);
    const Between apart = between_nodes(g->apart, TURNED_GLASS_APART);
    const uint words = TURNED_GLASS_COLUMNS - 1u;
    vfloat e = splat(0.0f);
    for (uint corner = 0u; corner < 8u; ++corner) {
        const uint a = corner & 1u, b = corner >> 1 & 1u, c = corner >> 2;
        vuint part = between_node(&layer, c) + (denser ? splat_uint(TURNED_GLASS_LAYERS) : splat_uint(0u));
        part = (part * TURNED_GLASS_ROWS + between_node(&row, b)) * TURNED_GLASS_APART + between_node(&apart, a);
        const vuint first = part * (TURNED_GLASS_TURNS * words) + ALBEDO_TURNED_GLASS;
        const vfloat one = albedo_at(tables, first, TURNED_GLASS_TURNS, words, words, turn * (float)(TURNED_GLASS_TURNS - 1u), column * (float)words);
        e = fma(between_weight(&layer, c) * between_weight(&row, b) * between_weight(&apart, a), one, e);
    }
    return e;
}

// 1 − E_avg.
static vfloat turned_glass_lost(__global const float* tables, const Facets* f, const TurnedGlass* g, vmask denser) {
    const Between layer = between_nodes(g->layer, TURNED_GLASS_LAYERS), row = between_nodes(g->row, TURNED_GLASS_LOST_ROWS);
    vfloat lost = splat(0.0f);
    for (uint corner = 0u; corner < 4u; ++corner) {
        const uint b = corner & 1u, c = corner >> 1;
        const vuint part = between_node(&layer, c) + (denser ? splat_uint(TURNED_GLASS_LAYERS) : splat_uint(0u));
        const vuint first = (part * TURNED_GLASS_LOST_ROWS + between_node(&row, b)) * TURNED_GLASS_LOST_APART + ALBEDO_TURNED_GLASS_LOST;
        const vfloat one = albedo_between(tables, first, TURNED_GLASS_LOST_APART, g->apart * (float)(TURNED_GLASS_LOST_APART - 1u));
        lost = fma(between_weight(&layer, c) * between_weight(&row, b), one, lost);
    }
    return lost * f->mean;
}

#endif
