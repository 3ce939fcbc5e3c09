// Between texels: wrap modes, and a value at any point of a picture.
//
// Linear interpolation of four texels, or where a pair of random numbers is at hand one of the four, with the probability of its weight
// (stochastic filtering: Fajardo, Wronski, Salvi and Pharr 2023; Pharr, Wronski, Salvi and Fajardo 2024). A mean over samples is the
// same where the value enters the radiance linearly; where it does not, it is the mean of what the texels look like.
#ifndef TEXTURE_FILTER_H
#define TEXTURE_FILTER_H

#include "core/exact.h"
#include "texture/texel.h"

// How to choose among four texels.
typedef struct {
    vfloat u, v;         // random numbers in [0, 1)
    int random;          // whether they are; else all four are read
} Taps;

static vuint filter_wrap_u(const Texture* t) { return (t->format >> 5) & 3u; }
static vuint filter_wrap_v(const Texture* t) { return (t->format >> 7) & 3u; }

// A coordinate folded into the picture: [0, 1].
static vfloat filter_fold(vfloat x, vuint wrap) {
    const vfloat repeated = x - floor(x);
    const vfloat twice = x - floor(x * 0.5f) * 2.0f;
    const vfloat mirrored = twice > 1.0f ? splat(2.0f) - twice : twice;
    return wrap == WRAP_REPEAT ? repeated : wrap == WRAP_MIRROR ? mirrored : bounded(x, 0.0f, 1.0f);
}

// The number of a texel that may lie one beyond the rim: repeated on the other side, or else that of the rim, as also a mirror has it.
static vuint filter_texel(vint i, vuint count, vuint wrap) {
    const vint n = vint_from_uint(count), low = i < 0 ? i + n : i, around = low >= n ? low - n : low;
    const vint above = i < 0 ? (vint)(0) : i, rim = above >= n ? n - 1 : above;
    return vuint_from_int(wrap == WRAP_REPEAT ? around : rim);
}

static Texel texel_mix(Texel a, Texel b, vfloat share) {
    Texel m;
    m.r = fma(share, b.r - a.r, a.r), m.g = fma(share, b.g - a.g, a.g);
    m.b = fma(share, b.b - a.b, a.b), m.a = fma(share, b.a - a.a, a.a);
    return m;
}
static Texel texel_choose(vmask m, Texel yes, Texel no) {
    Texel t;
    t.r = m ? yes.r : no.r, t.g = m ? yes.g : no.g, t.b = m ? yes.b : no.b, t.a = m ? yes.a : no.a;
    return t;
}

// The four texels around a point: their columns and rows, and where the point lies between them.
typedef struct {
    vuint x[2], y[2];
    vfloat share_x, share_y;
} Quartet;

static Quartet filter_quartet(const Texture* t, vfloat x, vfloat y) {
    const vuint wrap_u = filter_wrap_u(t), wrap_v = filter_wrap_v(t);
    const vfloat left = floor(x - 0.5f), top = floor(y - 0.5f);
    const vint column = vint_of(left), row = vint_of(top);
    Quartet q;
    q.x[0] = filter_texel(column, t->width, wrap_u), q.x[1] = filter_texel(column + 1, t->width, wrap_u);
    q.y[0] = filter_texel(row, t->height, wrap_v), q.y[1] = filter_texel(row + 1, t->height, wrap_v);
    q.share_x = (x - 0.5f) - left, q.share_y = (y - 0.5f) - top;
    return q;
}

// The value of each lane's picture at a point, column and row from 0 to 1 within it.
static Texel filter_value(const Scene* scene, const Texture* t, vfloat u, vfloat v, Taps taps, vmask active) {
    const vfloat x = filter_fold(u, filter_wrap_u(t)) * vfloat_of(vint_from_uint(t->width));
    const vfloat y = filter_fold(v, filter_wrap_v(t)) * vfloat_of(vint_from_uint(t->height));
    const vuint filter = (t->format >> 9) & 3u;
    const vmask nearest = filter == FILTER_NEAREST;
    vmask four = active & (filter == FILTER_EXACT);
    if (!taps.random) four = active & !nearest;
    const vmask one = active & !four;
    Texel value;
    value.r = value.g = value.b = value.a = splat(0.0f);
    if (lane_any(one)) {
        const vfloat at_x = nearest ? x : (x - 0.5f) + taps.u, at_y = nearest ? y : (y - 0.5f) + taps.v;
        const vuint column = filter_texel(vint_of(floor(at_x)), t->width, filter_wrap_u(t));
        const vuint row = filter_texel(vint_of(floor(at_y)), t->height, filter_wrap_v(t));
        value = texel_load(scene, t, column, row, one);
    }
    if (lane_any(four)) {
        const Quartet q = filter_quartet(t, x, y);
        const Texel above = texel_mix(texel_load(scene, t, q.x[0], q.y[0], four), texel_load(scene, t, q.x[1], q.y[0], four), q.share_x);
        const Texel below = texel_mix(texel_load(scene, t, q.x[0], q.y[1], four), texel_load(scene, t, q.x[1], q.y[1], four), q.share_x);
        value = texel_choose(four, texel_mix(above, below, q.share_y), value);
    }
    return value;
}

#endif
