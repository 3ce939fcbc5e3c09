// A transparent film on a surface, thinner than the length over which light is coherent: what its two boundaries reflect interferes, so the
// share that is reflected depends on thickness, angle and wavelength (Belcour and Barla, "A Practical Extension to Microfacet Theory for the
// Modeling of Varying Iridescence", ACM TOG 36(4), 2017).
//
// With r and s what the outer and the inner boundary reflect of an amplitude, z = r s, and φ the phase of a way to and fro, the share
//     T = (1 − r²) (1 − |s|²) / |1 + z exp(iφ)|²
// passes (Airy), in each of both polarisations. At a wavelength that is the formula. Red, green and blue are means over wavelengths, of
//     1 / |1 + z exp(iφ)|² = (1 + 2 Re Σ (−z)^m exp(imφ)) / (1 − |z|²)
// term by term: the means of exp(imφ) are a table (clrender.flatten.thin_films), in which they fade where the way is long.
#ifndef MATERIAL_THIN_FILM_H
#define MATERIAL_THIN_FILM_H

#include "core/exact.h"
#include "material/fresnel.h"
#include "types.h"

#ifdef IRIDESCENCE

typedef struct {
    __global const float* tables; // of clrender.flatten.thin_films
    vmask present;
    vfloat share;                // of the surface that the film is on
    vfloat ior;                  // index of the film over that of the medium on this side
    vfloat way;                  // twice its thickness times its index, nanometres
#ifdef SPECTRAL
    vec3 lines;                  // the lanes' wavelengths: spectral/wavelengths.h
#endif
} ThinFilm;

#define THIN_FILM_MOST_F0 0.9999f
#define THIN_FILM_ROWS_PER_NANOMETRE 0.25f   // of the table of means

// Cosine and sine of mφ for m from 1 on, of one color.
#ifdef SPECTRAL
#define THIN_FILM_ORDERS 1
#else
#define THIN_FILM_ORDERS 8
#endif
typedef struct {
    vfloat cosine[THIN_FILM_ORDERS], sine[THIN_FILM_ORDERS];
} ThinFilmPhase;

static void thin_film_phases(const ThinFilm* film, vfloat way, ThinFilmPhase phase[3]) {
#ifdef SPECTRAL
    const vfloat lines[3] = {film->lines.x, film->lines.y, film->lines.z};
    for (int c = 0; c < 3; ++c) {
        const vfloat turns = quotient(way, fma(lines[c], splat(5.0f), splat(360.0f)));
        cos_sin_turn(turns - vfloat_of(vint_of(turns)), &phase[c].cosine[0], &phase[c].sine[0]);
    }
#else
    for (int m = 0; m < THIN_FILM_ORDERS; ++m) {
        const vfloat place = lesser(way * ((float)(m + 1) * THIN_FILM_ROWS_PER_NANOMETRE), splat((float)THIN_FILM_STEPS - 2.0f));
        const vuint row = vuint_from_int(vint_of(place));
        const vfloat after = place - vfloat_of(vint_from_uint(row));
        vfloat a[8], b[8];
        lane_octets(film->tables, row * 8u, a);
        lane_octets(film->tables, row * 8u + 8u, b);
        for (int c = 0; c < 3; ++c) {
            phase[c].cosine[m] = fma(b[c] - a[c], after, a[c]);
            phase[c].sine[m] = fma(b[3 + c] - a[3 + c], after, a[3 + c]);
        }
    }
#endif
}

// T of one polarisation; `re` and `im`: of s.
static vfloat thin_film_passes(vfloat r, vfloat re, vfloat im, const ThinFilmPhase* phase) {
    const vfloat x = -r * re, y = -r * im, square = fma(x, x, y * y);
    const vfloat both = fma(-r, r, splat(1.0f)) * greater(splat(1.0f) - fma(re, re, im * im), splat(0.0f));
#ifdef SPECTRAL
    const vfloat sum = fma(y, phase->sine[0], -x * phase->cosine[0]);
    return bounded(quotient(both, greater(fma(sum, splat(2.0f), splat(1.0f) + square), splat(1.0e-6f))), 0.0f, 1.0f);
#else
    vfloat sum = splat(0.5f), u = x, v = y;
    for (int m = 0; m < THIN_FILM_ORDERS; ++m) {
        sum = fma(u, phase->cosine[m], fma(-v, phase->sine[m], sum));
        const vfloat next = fma(u, x, -v * y);
        v = fma(u, y, v * x), u = next;
    }
    return bounded(quotient(both * (sum + sum), greater(splat(1.0f) - square, splat(1.0e-6f))), 0.0f, 1.0f);
#endif
}

// The share of one color that is reflected, at a squared sine of the angle on this side. `here`, `within`: indices times cosines there and in the
// film; `eta` and `k`: of what lies below.
static vfloat thin_film_reflects_of(vfloat here, vfloat within, vfloat ior2, vfloat sine2, vfloat eta, vfloat k, const ThinFilmPhase* phase) {
    // The index below times the cosine there, complex: a + ib
    const vfloat re = fma(eta, eta, -k * k), im = eta * k * 2.0f, t = re - sine2, size = root(fma(t, t, im * im));
    const vfloat a = root(greater((size + t) * 0.5f, splat(0.0f))), b = root(greater((size - t) * 0.5f, splat(0.0f)));
    const vfloat least = splat(1.0e-12f), sum = within + a;
    const vfloat square = greater(fma(sum, sum, b * b), least);
    const vfloat perpendicular_re = quotient(fma(within - a, sum, -b * b), square), perpendicular_im = quotient(b * within * -2.0f, square);
    // Of the other polarisation
    const vfloat x = re * within, y = im * within, u = ior2 * a, v = ior2 * b;
    const vfloat whole = greater(fma(x + u, x + u, (y + v) * (y + v)), least);
    const vfloat parallel_re = quotient(fma(x - u, x + u, (y - v) * (y + v)), whole), parallel_im = quotient(fma(y, u, -x * v) * 2.0f, whole);
    const vfloat r_perpendicular = quotient(here - within, greater(here + within, least));
    const vfloat r_parallel = quotient(fma(ior2, here, -within), greater(fma(ior2, here, within), least));
    const vfloat passes = thin_film_passes(r_perpendicular, perpendicular_re, perpendicular_im, phase) +
                          thin_film_passes(r_parallel, parallel_re, parallel_im, phase);
    return fma(passes, splat(-0.5f), splat(1.0f));
}

// What a surface with that index below the film reflects, at a cosine from the normal; `bare`: without the film.
static vec3 thin_film_reflects(const ThinFilm* film, vec3 eta, vec3 k, vfloat cosine, vec3 bare) {
    if (!lane_any(film->present)) return bare;
    const vfloat here = bounded(cosine, 1.0e-4f, 1.0f), sine2 = fma(-here, here, splat(1.0f)), ior = film->present ? film->ior : splat(1.0f), ior2 = ior * ior;
    const vfloat within = root(greater(ior2 - sine2, splat(0.0f)));
    ThinFilmPhase phase[3];
    thin_film_phases(film, film->present ? film->way * quotient(within, ior) : splat(0.0f), phase);
    const vec3 seen = vec3_of(thin_film_reflects_of(here, within, ior2, sine2, eta.x, k.x, &phase[0]),
                              thin_film_reflects_of(here, within, ior2, sine2, eta.y, k.y, &phase[1]),
                              thin_film_reflects_of(here, within, ior2, sine2, eta.z, k.z, &phase[2]));
    return choose(film->present, along(bare, sub(seen, bare), film->share), bare);
}

// The index that reflects as much where it is seen straight on.
static vfloat thin_film_index(vfloat f0) {
    const vfloat amplitude = root(bounded(f0, 0.0f, THIN_FILM_MOST_F0));
    return quotient(splat(1.0f) + amplitude, splat(1.0f) - amplitude);
}

// The same of what reflects by Schlick's approximation.
static vec3 thin_film_schlick(const ThinFilm* film, vec3 f0, vec3 f90, vfloat cosine) {
    const vec3 bare = fresnel_schlick(f0, f90, cosine);
    if (!lane_any(film->present)) return bare;
    const vfloat over = inverse_or_one(f90.x);
    const vec3 eta = vec3_of(thin_film_index(f0.x * over), thin_film_index(f0.y * over), thin_film_index(f0.z * over));
    const vec3 seen = scale(thin_film_reflects(film, eta, vec3_all(0.0f), cosine, scale(bare, over)), f90.x);
    return choose(film->present, seen, bare);
}

// T of both polarisations where nothing is absorbed: `r` and `s` are real.
static vfloat thin_film_passes_clear(vfloat r, vfloat s, const ThinFilmPhase* phase) {
    const vfloat x = -r * s, square = x * x, both = fma(-r, r, splat(1.0f)) * fma(-s, s, splat(1.0f));
#ifdef SPECTRAL
    const vfloat sum = -x * phase->cosine[0];
    return bounded(quotient(both, greater(fma(sum, splat(2.0f), splat(1.0f) + square), splat(1.0e-6f))), 0.0f, 1.0f);
#else
    vfloat sum = splat(0.5f), u = x;
    for (int m = 0; m < THIN_FILM_ORDERS; ++m) {
        sum = fma(u, phase->cosine[m], sum);
        u = u * x;
    }
    return bounded(quotient(both * (sum + sum), greater(splat(1.0f) - square, splat(1.0e-6f))), 0.0f, 1.0f);
#endif
}

// What a boundary to the index `eta` passes, of which `bare` without a film. From the cosines on both sides: near the critical angle `beyond` is
// known better where a direction is given there than from `cosine`. Beyond that angle it is 0.
static vec3 thin_film_boundary(const ThinFilm* film, vfloat eta, vfloat cosine, vfloat beyond, vfloat bare) {
    const vec3 all = vec3_of(bare, bare, bare);
    if (!lane_any(film->present)) return all;
    const vfloat here = bounded(cosine, 1.0e-4f, 1.0f), ior = film->present ? film->ior : splat(1.0f), ior2 = ior * ior;
    const vfloat within = root(greater(fma(here, here, ior2 - 1.0f), splat(0.0f))), least = splat(1.0e-12f);
    ThinFilmPhase phase[3];
    thin_film_phases(film, film->present ? film->way * quotient(within, ior) : splat(0.0f), phase);
    const vfloat below = eta * beyond, x = eta * eta * within, u = ior2 * below;
    const vfloat s_perpendicular = quotient(within - below, greater(within + below, least)), s_parallel = quotient(x - u, greater(x + u, least));
    const vfloat r_perpendicular = quotient(here - within, greater(here + within, least));
    const vfloat r_parallel = quotient(fma(ior2, here, -within), greater(fma(ior2, here, within), least));
    vfloat passes[3];
    for (int c = 0; c < 3; ++c) {
        const vfloat both = thin_film_passes_clear(r_perpendicular, s_perpendicular, &phase[c]) + thin_film_passes_clear(r_parallel, s_parallel, &phase[c]);
        passes[c] = both * 0.5f;
    }
    return choose(film->present, along(all, sub(vec3_of(passes[0], passes[1], passes[2]), all), film->share), all);
}

// Two cosines between a direction and the facets of GGX that reflect it, the second with the probability `second`: the mean over these is that over
// all facets of what is about a cubic function of the cosine. Rows: √alpha; columns: the root of the direction's cosine.
typedef struct {
    vfloat low, high, second;
} ThinFilmFacets;

static ThinFilmFacets thin_film_facets(const ThinFilm* film, vfloat alpha, vfloat cosine) {
    const vfloat y = root(alpha) * ((float)THIN_FILM_FACETS - 1.0f), x = root(cosine) * ((float)THIN_FILM_FACETS - 1.0f);
    const vint row = vint_of(bounded(y, 0.0f, (float)(THIN_FILM_FACETS - 2u))), column = vint_of(bounded(x, 0.0f, (float)(THIN_FILM_FACETS - 2u)));
    const vfloat down = y - vfloat_of(row), right = x - vfloat_of(column);
    const vuint at = (vuint_from_int(row) * THIN_FILM_FACETS + vuint_from_int(column) + THIN_FILM_STEPS) * 8u;
    vfloat a[8], b[8], mean[3];
    lane_octets(film->tables, at, a);
    lane_octets(film->tables, at + THIN_FILM_FACETS * 8u, b);
    for (int i = 0; i < 3; ++i) {
        const vfloat upper = fma(right, a[3 + i] - a[i], a[i]), lower = fma(right, b[3 + i] - b[i], b[i]);
        mean[i] = fma(down, lower - upper, upper);
    }
    const ThinFilmFacets facets = {mean[0], mean[1], mean[2]};
    return facets;
}

#endif

#endif
