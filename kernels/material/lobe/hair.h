// A fibre of hair: a rough dielectric cylinder, whose scales are tilted, with an absorbing inside (Chiang, Bitterli, Tappan and Burley 2016; PBR
// 4ed, 9.9; d'Eon et al. 2011 for M). Light leaves it after p = 0, 1, 2 ways through the fibre, or more:
//
//     f |cosθi| = Σ A_p M_p(θo, θi) N_p(φi − φo)
//
// with A the attenuation of p ways, M a distribution over angles along the fibre, N over those around it, all of integral 1 but for A. The A add up
// to 1 where nothing is absorbed, for each point of the fibre.
//
// Frame: local, x along the fibre, from root to tip, z the normal of the point. θ is measured from the plane across the fibre, φ in that plane.
// How far the ray passes from the axis, h, is what `wo` says: the point is where a ray along it meets the cylinder.
#ifndef MATERIAL_LOBE_HAIR_H
#define MATERIAL_LOBE_HAIR_H

#include "core/power.h"
#include "material/dielectric.h"

#define HAIR_LOBES 4
#define HAIR_LEAST_COSINE 1.0e-6f

// Of a material: what its row has.
typedef struct {
    vfloat variance;             // of M_0
    vfloat spread;               // scale of the logistic distribution N
    vfloat per_logarithm;        // by which the logarithm of a reflectance makes the root of an absorption
    vfloat eta;
    vfloat tilt_sine, tilt_cosine;
} HairNumbers;

typedef struct {
    vmask present;
    vfloat variance, spread;
    vec3 attenuation[HAIR_LOBES];
    vfloat chance[HAIR_LOBES];   // with which each is sampled
    vfloat sine[3], cosine[3];   // of θo less the tilt of the scales
    vfloat turn[3];              // φi − φo in the middle of N, in turns
    vfloat cut;                  // share of the logistic distribution below −π
} Hair;

// −½ to ½, of a number of turns from −8 to 8; 0 to 1.
static vfloat hair_wrapped(vfloat turn) { return turn - vfloat_of(vint_of(turn + 8.5f) - 8); }
static vfloat hair_positive(vfloat turn) { return lesser(turn - vfloat_of(vint_of(turn + 8.0f) - 8), splat(0.99999994f)); }

// e^(−x) I0(x) of x ≥ 0 (Abramowitz and Stegun, 9.8.1 and 9.8.2), relative error below 1e-6.
static vfloat hair_bessel(vfloat x) {
    const vfloat t = x * (1.0f / 3.75f), t2 = t * t;
    vfloat near = fma(t2, splat(0.0045813f), splat(0.0360768f));
    near = fma(t2, fma(t2, near, splat(0.2659732f)), splat(1.2067492f));
    near = fma(t2, fma(t2, fma(t2, near, splat(3.0899424f)), splat(3.5156229f)), splat(1.0f));
    const vfloat far = x > 3.75f ? x : splat(3.75f), s = quotient(splat(3.75f), far);
    vfloat p = fma(s, splat(0.00392377f), splat(-0.01647633f));
    p = fma(s, fma(s, p, splat(0.02635537f)), splat(-0.02057706f));
    p = fma(s, fma(s, p, splat(0.00916281f)), splat(-0.00157565f));
    p = fma(s, fma(s, fma(s, p, splat(0.00225319f)), splat(0.01328592f)), splat(0.39894228f));
    return x > 3.75f ? quotient(p, square_root(far)) : near * exp_minus(lesser(x, splat(3.75f)));
}

// M for the given variance: density per radian of θi, times 1 / cosθi. `sine_o`, `cosine_o`: of θo with its tilt.
static vfloat hair_along(vfloat variance, vfloat sine_i, vfloat cosine_i, vfloat sine_o, vfloat cosine_o) {
    const vfloat inverse = quotient(splat(1.0f), variance);
    // cosθi cosθo − sinθi sinθo − 1 keeps its digits as a sum of squares
    const vfloat c = cosine_i - cosine_o, s = sine_i + sine_o, off = fma(c, c, s * s) * 0.5f;
    const vfloat norm = inverse_or_one(variance * (splat(1.0f) - exp_minus(inverse * 2.0f)));
    return hair_bessel(cosine_i * cosine_o * inverse) * exp_minus(off * inverse) * norm;
}

// The logistic distribution, cut off at −π and π, per radian.
static vfloat hair_around(const Hair* h, vfloat turn) {
    const vfloat e = exp_minus(quotient(absolute(turn) * (2.0f * PI), h->spread)), one = splat(1.0f), sum = one + e;
    return quotient(e, h->spread * (sum * sum) * fma(h->cut, splat(-2.0f), one));
}

static vfloat hair_variance(const Hair* h, uint p) { return h->variance * (p == 0 ? 1.0f : p == 1 ? 0.25f : 4.0f); }

// What strands of the hair that reflect this, seen from afar, absorb in a radius (Chiang et al., 4.2).
static vec3 hair_absorption(const HairNumbers* n, vec3 color) {
    const vec3 roots = vec3_of(log2_of(greater(color.x, splat(1.0e-30f))), log2_of(greater(color.y, splat(1.0e-30f))),
                               log2_of(greater(color.z, splat(1.0e-30f))));
    const vec3 root = scale(roots, n->per_logarithm);
    return mul(root, root);
}

static vec3 hair_passed(vec3 absorption, vfloat length) {
    return vec3_of(exp_minus(absorption.x * length), exp_minus(absorption.y * length), exp_minus(absorption.z * length));
}

// The fibre as it is seen along `wo`.
static void hair_prepare(const HairNumbers* n, vec3 color, vec3 wo, vmask present, Hair* h) {
    const vfloat one = splat(1.0f), sine = wo.x, cosine = greater(root(fma(wo.y, wo.y, wo.z * wo.z)), splat(HAIR_LEAST_COSINE));
    const vfloat across = quotient(-wo.y, cosine), bent = root(fma(n->eta, n->eta, -(sine * sine)));
    const vfloat inside = quotient(-wo.y, bent), level = root(fma(-inside, inside, one));
    const vfloat sine_t = quotient(sine, n->eta), cosine_t = root(fma(-sine_t, sine_t, one));
    h->present = present;
    h->variance = n->variance, h->spread = n->spread;
    vfloat beyond;
    const vfloat back = dielectric_fresnel(lesser(wo.z, one), n->eta, &beyond), through = one - back;
    const vec3 passed = hair_passed(hair_absorption(n, color), quotient(level * 2.0f, cosine_t)), again = scale(passed, back);
    h->attenuation[0] = vec3_of(back, back, back);
    h->attenuation[1] = scale(passed, through * through);
    h->attenuation[2] = mul(h->attenuation[1], again);
    const vec3 more = mul(h->attenuation[2], again);
    h->attenuation[3] = vec3_of(quotient(more.x, one - again.x), quotient(more.y, one - again.y), quotient(more.z, one - again.z));
    vfloat sum = splat(0.0f);
    for (uint p = 0; p < HAIR_LOBES; ++p) {
        h->chance[p] = (h->attenuation[p].x + h->attenuation[p].y + h->attenuation[p].z) * (1.0f / 3.0f);
        sum = sum + h->chance[p];
    }
    for (uint p = 0; p < HAIR_LOBES; ++p) h->chance[p] = h->chance[p] * inverse_or_one(sum);
    // Reflection is tilted by two tilts one way, transmission by one the other way, and the third lobe by four
    const vfloat s1 = n->tilt_sine, c1 = n->tilt_cosine, s2 = s1 * c1 * 2.0f, c2 = fma(s1 * s1, splat(-2.0f), one);
    const vfloat s4 = s2 * c2 * 2.0f, c4 = fma(s2 * s2, splat(-2.0f), one);
    const vfloat s[3] = {-s2, s1, s4}, c[3] = {c2, c1, c4};
    // Around the fibre, light turns by 2 γo where it enters and by π − 2 γt on each way through it
    const vfloat outside_turn = turn_of(root(fma(-across, across, one)), across), inside_turn = turn_of(level, inside);
    for (uint p = 0; p < 3; ++p) {
        h->sine[p] = fma(sine, c[p], cosine * s[p]);
        h->cosine[p] = absolute(fma(cosine, c[p], -(sine * s[p])));
        h->turn[p] = fma(inside_turn, splat(2.0f * (float)p), fma(outside_turn, splat(-2.0f), splat(0.5f * (float)p)));
    }
    const vfloat tail = exp_minus(quotient(splat(PI), h->spread));
    h->cut = quotient(tail, one + tail);
}

static vec3 hair_albedo(const Hair* h) { return add(add(h->attenuation[0], h->attenuation[1]), add(h->attenuation[2], h->attenuation[3])); }

// f without the cosine, and the density.
static vec3 hair_eval(const Hair* h, vec3 wo, vec3 wi, vfloat* pdf) {
    const vfloat sine = wi.x, cosine = root(fma(wi.y, wi.y, wi.z * wi.z));
    const vfloat turn = turn_of(fma(wo.y, wi.y, wo.z * wi.z), fma(wo.y, wi.z, -(wo.z * wi.y)));
    const vfloat sine_o = wo.x, cosine_o = root(fma(wo.y, wo.y, wo.z * wo.z));
    const vfloat rest = hair_along(hair_variance(h, 3), sine, cosine, sine_o, cosine_o) * (0.5f * INV_PI);
    vec3 f = scale(h->attenuation[3], rest);
    vfloat density = h->chance[3] * rest;
    for (uint p = 0; p < 3; ++p) {
        const vfloat m = hair_along(hair_variance(h, p), sine, cosine, h->sine[p], h->cosine[p]);
        const vfloat d = m * hair_around(h, hair_wrapped(turn - h->turn[p]));
        f = along(f, h->attenuation[p], d);
        density = fma(h->chance[p], d, density);
    }
    *pdf = density;
    return scale(f, quotient(splat(1.0f), greater(absolute(wi.z), splat(1.0e-7f))));
}

// A direction, of three random numbers.
static vec3 hair_sample(const Hair* h, vec3 wo, vfloat u, vfloat v, vfloat w) {
    vfloat first = splat(0.0f), variance = hair_variance(h, 3), chance = h->chance[3], middle = splat(0.0f);
    vfloat sine_o = wo.x, cosine_o = root(fma(wo.y, wo.y, wo.z * wo.z)), below = h->chance[0] + h->chance[1] + h->chance[2];
    vmask open = mask_all(), even = mask_all();
    for (uint p = 0; p < 3; ++p) {
        const vmask taken = open & (u < first + h->chance[p]);
        below = taken ? first : below, chance = taken ? h->chance[p] : chance;
        variance = taken ? hair_variance(h, p) : variance;
        sine_o = taken ? h->sine[p] : sine_o, cosine_o = taken ? h->cosine[p] : cosine_o;
        middle = taken ? h->turn[p] : middle;
        first = first + h->chance[p];
        open = open & !taken;
        even = even & !taken;
    }
    const vfloat one = splat(1.0f), share = bounded((u - below) * inverse_or_one(chance), 0.0f, 0.99999994f);
    // Along the fibre, and how far round its direction that cone is cut
    const vfloat e = exp_minus(quotient(splat(2.0f), variance));
    const vfloat drop = bounded(log2_of(fma(one - v, e, greater(v, splat(1.0e-5f)))) * variance * -0.693147181f, 0.0f, 2.0f);
    vfloat c, unused;
    cos_sin_turn(w, &c, &unused);
    const vfloat sine = bounded(fma(root(drop * (splat(2.0f) - drop)) * c, cosine_o, -((one - drop) * sine_o)), -1.0f, 1.0f);
    const vfloat cosine = root(fma(-sine, sine, one));
    // Around it
    const vfloat within = fma(h->cut, splat(-2.0f), one);
    const vfloat low = greater(fma(share, within, h->cut), splat(1.0e-30f)), high = greater(fma(one - share, within, h->cut), splat(1.0e-30f));
    const vfloat off = bounded((log2_of(low) - log2_of(high)) * h->spread * (0.693147181f * 0.5f * INV_PI), -0.5f, 0.5f);
    const vfloat turn = even ? share : hair_positive(turn_of(wo.y, wo.z) + middle + off);
    vfloat y, z;
    cos_sin_turn(turn, &y, &z);
    z = absolute(z) < 1.0e-7f ? splat(1.0e-7f) : z;
    return unit(vec3_of(sine, cosine * y, cosine * z));
}

#endif
