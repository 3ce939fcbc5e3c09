// Metal below sheen or coat: of what it reflects, the lesser of what the cover leaves along both directions passes, so that nothing is
// gained and paths can be reversed. Where light turns towards grazing directions some is lost so, up to 5 % below a coat. A diffuse lobe
// returns it, in the manner of Kulla & Conti (SIGGRAPH course 2017): with D(μ) what is lost, D(μo) D(μi) / (π D_avg).
// eval: f in 1/sr, without the cosine.
#ifndef MATERIAL_LOBE_COVERED_H
#define MATERIAL_LOBE_COVERED_H

#include "material/albedo.h"

#define COVERED_BY_COAT 0u
#define COVERED_BY_SHEEN 1u

typedef struct {
    vmask present;
    vuint first;             // where the tables of the cover's alpha begin
    vfloat further;          // how far the next one's is
    vfloat row;              // of the metal's alpha
    vfloat lost;             // D(μo) for a cover that is all there
    vfloat scale;            // share of the cover over π D_avg
} Covered;

static vfloat covered_lost(const Covered* c, __global const float* tables, vfloat cosine) {
    const uint words = COVERED_COLUMNS - 1u, next = COVERED_ROWS * words;
    const vuint first = c->first * next + ALBEDO_COVERED;
    const vfloat x = root(cosine) * (float)words;
    const vfloat low = albedo_at(tables, first, COVERED_ROWS, words, words, c->row, x), high = albedo_at(tables, first + next, COVERED_ROWS, words, words, c->row, x);
    return fma(c->further, high - low, low) * 0.25f;
}

static Covered covered_by(__global const float* tables, uint which, vmask there, vfloat share, vfloat cover, vfloat metal, vfloat cosine) {
    Covered c;
    const vfloat layer = root(cover) * (float)(COVERED_LAYERS - 1u);
    const vint lower = vint_of(bounded(layer, 0.0f, (float)(COVERED_LAYERS - 2u)));
    c.present = there;
    c.first = vuint_from_int(lower) + which * COVERED_LAYERS;
    c.further = layer - vfloat_of(lower);
    c.row = root(metal) * (float)(COVERED_ROWS - 1u);
    const vuint first = c.first * COVERED_ROWS + ALBEDO_COVERED_MEAN;
    const vfloat low = albedo_between(tables, first, COVERED_ROWS, c.row), high = albedo_between(tables, first + COVERED_ROWS, COVERED_ROWS, c.row);
    c.lost = there ? covered_lost(&c, tables, cosine) : splat(0.0f);
    c.scale = there ? quotient(share * INV_PI, greater(fma(c.further, high - low, low), splat(1.0e-7f))) : splat(0.0f);
    return c;
}

static vfloat covered_eval(const Covered* c, __global const float* tables, vfloat cosine) {
    return c->present ? c->lost * covered_lost(c, tables, cosine) * c->scale : splat(0.0f);
}

#endif
