// The three wavelengths of a path, and what the film makes of the radiance that it finds at them. Everywhere else the numbers of a color
// are then radiances, reflectances or coefficients at these wavelengths, in the place of red, green and blue.
//
// Each is from another third of the distribution (Wilkie, Nawaz, Droske, Weidlich and Hanika, "Hero wavelength spectral sampling", EGSR 2014),
// which is about how much the film makes of a wavelength in daylight. Paths that are joined with others of the same sample, of whichever
// pixel, have the wavelengths of their sample (SHARED_TIME).
//
// Built only where wavelengths are rendered (-D SPECTRAL).
#ifndef SPECTRAL_WAVELENGTHS_H
#define SPECTRAL_WAVELENGTHS_H

#include "core/exact.h"
#include "core/sampler.h"
#include "types.h"

#ifdef SPECTRAL

typedef struct {
    vec3 lines;              // where in the tables of clrender/spectra/kernel_table.py they lie: 5 nm each, from 360 nm on
    vec3 daylight;           // the illuminant D65 there
    vec3 film[3];            // the color that the film sees of radiance 1 there, over three times the density of the wavelength
#ifdef DISPERSION
    vuint first;             // the one, 0 to 2, at which indices of refraction are read
#endif
} Wavelengths;


// A wavelength, and how many lines of the table a unit of random numbers covers there, which is one over its density, and linear in between
// the nodes of the table (0.001953125: half of a segment).
static vfloat wavelengths_line(__global const float* table, vfloat u, vfloat* spread) {
    const vfloat place = u * (float)SPECTRA_SEGMENTS;
    const vuint segment = vuint_from_int(vint_of(lesser(place, splat((float)SPECTRA_SEGMENTS - 1.0f))));
    const vfloat share = place - vfloat_of(vint_from_uint(segment)), line = lane_gather(table, segment * 2u);
    const vfloat before = lane_gather(table, segment * 2u + 1u), after = lane_gather(table, segment * 2u + 3u);
    *spread = fma(after - before, share, before);
    return lesser(fma((before + *spread) * 0.001953125f, share, line), splat((float)SPECTRA_LINES - 1.0f));
}

// The line before a place in the table, and how far from there to the next.
static vuint wavelengths_before(vfloat line, vfloat* share) {
    const vuint before = vuint_from_int(vint_of(lesser(line, splat((float)SPECTRA_LINES - 2.0f))));
    *share = line - vfloat_of(vint_from_uint(before));
    return before;
}

// Red, green and blue of the film and the illuminant D65 at a wavelength.
static vfloat wavelengths_look_up(__global const float* table, vfloat line, vec3* film) {
    vfloat rows[8], share;
    const vuint before = wavelengths_before(line, &share);
    lane_octets(table, (uint)SPECTRA_FILM + before * 4u, rows);
    *film = vec3_of(fma(rows[4] - rows[0], share, rows[0]), fma(rows[5] - rows[1], share, rows[1]), fma(rows[6] - rows[2], share, rows[2]));
    return fma(rows[7] - rows[3], share, rows[3]);
}

// The random numbers of a sample; where they are shared, of sample number `pass` of all pixels.
static Sampler wavelengths_sampler(__global const Settings* settings, Sampler own, vuint pass) {
#ifdef SHARED_TIME
    const uint size = settings->replicate_spp;
    const vuint replicate = pass & (0u - size);
    Sampler shared;
    shared.seed = hash_pair(hash_pair(splat_uint(NONE), splat_uint(settings->seed)), replicate + 0x5851f42du);
    shared.index = pass & (size - 1u);
    return shared;
#else
    return own;
#endif
}

// Where glass disperses light, paths that are joined or sample chains have one wavelength: all three are the same. Other paths go on with one of
// theirs (integrator/path.h).
#if defined(DISPERSION) && (defined(SHARED_TIME) || defined(SPECULAR_CHAINS))
#define WAVELENGTHS_EQUAL
#endif

// A number in units of 2^-32. Over the samples of a pixel, or of a replicate, they are evenly spaced from one offset on, so that the sum of what
// varies smoothly from one end of the spectrum to the other has next to no error: the film sees little of either end.
static vuint wavelengths_number(Sampler sampler) {
    return reverse_bits(sampler.index) + hash_pair(sampler.seed, splat_uint(SET_WAVELENGTH));
}

// This number and those a third beside it, in ascending order.
static vec3 wavelengths_numbers(Sampler sampler) {
    const vuint number = wavelengths_number(sampler);
#ifdef WAVELENGTHS_EQUAL
    const vfloat all = unit_interval(number);
    return vec3_of(all, all, all);
#else
    const vfloat u = unit_interval(number * 3u) * (1.0f / 3.0f), second = u + 1.0f / 3.0f, third = u + 2.0f / 3.0f;
    return vec3_of(u, second, third);
#endif
}

// A random number that chooses one of three, the number itself if they are as likely: then those chosen are evenly spaced, too. For one choice of a
// path alone: given what followed from it, the number is no longer random.
static vfloat wavelengths_choice(Sampler sampler, vfloat random) {
    const vuint third = mul_hi(wavelengths_number(sampler), splat_uint(3u));
    return (vfloat_of(vint_from_uint(third)) + random) * (1.0f / 3.0f);
}

// One of the three: where it is in the tables, with the illuminant there, and what the film makes of it.
static vfloat wavelengths_one(__global const float* table, vfloat u, vfloat* daylight, vec3* film) {
    vfloat spread;
    const vfloat line = wavelengths_line(table, u, &spread);
    *daylight = wavelengths_look_up(table, line, film);
    *film = scale(*film, spread * (1.0f / 3.0f));
    return line;
}

// The film of three bands of equal width, which are the thirds of the distribution: it has the mean radiance in each.
static void wavelengths_bands(vec3 u, vec3 film[3]) {
    const vfloat one = splat(1.0f), none = splat(0.0f);
#ifdef WAVELENGTHS_EQUAL
    const vmask first = u.x < 1.0f / 3.0f, last = u.x >= 2.0f / 3.0f;
    film[0] = film[1] = film[2] = vec3_of(first ? one : none, first | last ? none : one, last ? one : none);
#else
    film[0] = vec3_of(one, none, none), film[1] = vec3_of(none, one, none), film[2] = vec3_of(none, none, one);
#endif
}

static Wavelengths wavelengths_of(__global const float* table, __global const Settings* settings, Sampler sampler, vuint pass) {
    const vec3 u = wavelengths_numbers(wavelengths_sampler(settings, sampler, pass));
    Wavelengths w;
#ifdef DISPERSION
    w.first = splat_uint(0u);
#endif
    w.lines.x = wavelengths_one(table, u.x, &w.daylight.x, &w.film[0]);
    w.lines.y = wavelengths_one(table, u.y, &w.daylight.y, &w.film[1]);
    w.lines.z = wavelengths_one(table, u.z, &w.daylight.z, &w.film[2]);
    if (settings->spectral > 1u) wavelengths_bands(u, w.film);
    return w;
}

#endif

#endif
