// What the colors of a scene are at the wavelengths of each lane.
//
// A color stands for the spectrum of Jakob and Hanika's ("A low-dimensional function space for efficient spectral upsampling", EG 2019):
// a sigmoid of a polynomial of degree two, whose coefficients are in a table. A reflectance has this color in daylight, and light of this
// color is such a reflectance in daylight. What is grey is the same at all wavelengths, exactly. Where a scene says a spectrum, the color is
// not one: its x is below zero, and says which spectrum, and its y by how much that is to be multiplied.
//
// Without wavelengths (no -D SPECTRAL) colors are what they are.
#ifndef SPECTRAL_COLOR_H
#define SPECTRAL_COLOR_H

#include "core/exact.h"
#include "scene.h"
#include "spectral/wavelengths.h"

#ifdef SPECTRAL

static vmask color_is_spectrum(vec3 color) { return color.x < 0.0f; }
static vmask color_is_grey(vec3 color) { return (color.x == color.y) & (color.y == color.z); }

// One of the spectra that the scene says, at a wavelength.
static vfloat color_spectrum_at(const Scene* scene, vuint first, vfloat line) {
    vfloat share;
    const vuint at = first + wavelengths_before(line, &share);
    const vfloat a = lane_gather(scene->spectra, at), b = lane_gather(scene->spectra, at + 1u);
    return fma(b - a, share, a);
}
static vec3 color_spectrum(const Scene* scene, vec3 color, vmask where) {
    const vuint number = vuint_from_int(vint_of(where ? -1.0f - color.x : splat(0.0f)));
    const vuint first = (uint)SPECTRA_GIVEN + number * (uint)SPECTRA_LINES;
    const vec3 lines = scene->wavelengths.lines;
    const vec3 values = vec3_of(color_spectrum_at(scene, first, lines.x), color_spectrum_at(scene, first, lines.y), color_spectrum_at(scene, first, lines.z));
    return scale(values, color.y);
}

// As in clrender/spectra/lifting.py: the ends of the parameter of lightness, the lightness at the first, and nodes per unit of the parameter.
#define LIFTING_LOWEST 0.03125f
#define LIFTING_HIGHEST 0.9921875f
#define LIFTING_DARKEST 0.001953125f
#define LIFTING_STEPS 32.260163f

// Between the nodes of the table along one axis: the first, and the share of the second.
typedef struct {
    vuint first;
    vfloat share;
} ColorPlace;

static ColorPlace color_place(vfloat at, uint nodes) {
    ColorPlace p;
    const vfloat inside = bounded(at, 0.0f, (float)nodes - 1.0f);
    p.first = vuint_from_int(vint_of(lesser(inside, splat((float)nodes - 2.0f))));
    p.share = inside - vfloat_of(vint_from_uint(p.first));
    return p;
}

// The parameter of a number from 0 to 1: the inverse of lifting.py's `spread`.
static vfloat color_parameter(vfloat number) {
    const vmask low = number < 0.5f;
    const vfloat root_of = root((low ? number : splat(1.0f) - number) * 0.5f);
    return low ? root_of : splat(1.0f) - root_of;
}

// Of a channel relative to the largest one.
static ColorPlace color_chroma(vfloat channel, vfloat most) {
    const vfloat relative = bounded(quotient(channel, most), 0.0f, 1.0f);
    return color_place(color_parameter(relative) * ((float)LIFTING_CHROMAS - 1.0f), LIFTING_CHROMAS);
}

static vec3 color_nodes(const Scene* scene, vuint node, vfloat share) {
    vfloat two[8];
    lane_octets(scene->spectra, (uint)SPECTRA_LIFTING + node * 4u, two);
    return vec3_of(fma(two[4] - two[0], share, two[0]), fma(two[5] - two[1], share, two[1]), fma(two[6] - two[2], share, two[2]));
}
static vec3 color_between(vec3 a, vec3 b, vfloat share) { return along(a, sub(b, a), share); }

static vfloat color_sigmoid(vec3 coefficients, vfloat line) {
    const vfloat place = line * 0.010638298f;
    const vfloat at = fma(fma(coefficients.x, place, coefficients.y), place, coefficients.z);
    return fma(quotient(at, root(fma(at, at, splat(1.0f)))), splat(0.5f), splat(0.5f));
}

// Of a color between 0 and 1 that is not grey.
static vec3 color_lifted(const Scene* scene, vec3 color, vmask where) {
    const vmask red = (color.x >= color.y) & (color.x >= color.z), green = !red & (color.y >= color.z);
    const vfloat most = where ? (red ? color.x : green ? color.y : color.z) : splat(1.0f);
    const vfloat after = red ? color.y : green ? color.z : color.x, after_next = red ? color.z : green ? color.x : color.y;
    const vfloat light = bounded(most, LIFTING_DARKEST, 1.0f);
    const vfloat parameter = bounded(color_parameter(light), LIFTING_LOWEST, LIFTING_HIGHEST);
    const ColorPlace z = color_place((parameter - LIFTING_LOWEST) * LIFTING_STEPS, LIFTING_LIGHTNESSES);
    const ColorPlace y = color_chroma(after_next, most), x = color_chroma(after, most);
    const uint row = LIFTING_CHROMAS, layer = LIFTING_CHROMAS * LIFTING_CHROMAS;
    const vuint channel = red ? splat_uint(0u) : green ? splat_uint(1u) : splat_uint(2u);
    const vuint node = channel * (LIFTING_LIGHTNESSES * layer) + z.first * layer + y.first * row + x.first;
    const vec3 near = color_between(color_nodes(scene, node, x.share), color_nodes(scene, node + row, x.share), y.share);
    const vec3 far = color_between(color_nodes(scene, node + layer, x.share), color_nodes(scene, node + layer + row, x.share), y.share);
    const vfloat pole = quotient(splat(1.0f), parameter * (splat(1.0f) - parameter));
    const vec3 coefficients = scale(color_between(near, far, z.share), pole), lines = scene->wavelengths.lines;
    const vec3 values = vec3_of(color_sigmoid(coefficients, lines.x), color_sigmoid(coefficients, lines.y), color_sigmoid(coefficients, lines.z));
    return scale(values, lesser(most * 512.0f, splat(1.0f)));
}

// A share of light.
static vec3 color_reflectance(const Scene* scene, vec3 color) {
    const vmask spectrum = color_is_spectrum(color), lifts = !spectrum & !color_is_grey(color);
    vec3 values = color;
    if (lane_any(lifts)) values = choose(lifts, color_lifted(scene, color, lifts), values);
    if (lane_any(spectrum)) values = choose(spectrum, color_spectrum(scene, color, spectrum), values);
    return values;
}

// The largest component of a share; of a spectrum about its largest value.
static vfloat color_most(const Scene* scene, vec3 color) {
    const vmask spectrum = color_is_spectrum(color);
    if (!lane_any(spectrum)) return largest(color);
    const vuint number = vuint_from_int(vint_of(spectrum ? -1.0f - color.x : splat(0.0f)));
    const vuint first = (uint)SPECTRA_GIVEN + number * (uint)SPECTRA_LINES;
    vfloat most = splat(0.0f);
    for (uint k = 1; k < 6u; ++k) most = greater(most, color_spectrum_at(scene, first, splat(12.0f * (float)k)));     // 420 to 660 nm
    return spectrum ? most * color.y : largest(color);
}

// What has no bound, such as a coefficient.
static vec3 color_unbounded(const Scene* scene, vec3 color) {
    const vmask spectrum = color_is_spectrum(color), lifts = !spectrum & !color_is_grey(color);
    vec3 values = color;
    if (lane_any(lifts)) {
        const vfloat half_of = largest(color) * 2.0f;
        const vec3 shade = color_lifted(scene, scale(color, inverse_or_one(half_of)), lifts);
        values = choose(lifts, scale(shade, half_of), values);
    }
    if (lane_any(spectrum)) values = choose(spectrum, color_spectrum(scene, color, spectrum), values);
    return values;
}

// Light. A spectrum that the scene says is that of the light itself.
static vec3 color_light(const Scene* scene, vec3 color) {
    return mul(color_unbounded(scene, color), choose(color_is_spectrum(color), vec3_all(1.0f), scene->wavelengths.daylight));
}

// An index of refraction. One that depends on the wavelength is below zero, and says which spectrum; then it is that of the wavelength `first`.
static vfloat color_index(const Scene* scene, vfloat index, vmask* disperses) {
#ifdef DISPERSION
    const vmask spectrum = index < 0.0f;
    if (!lane_any(spectrum)) return index;
    const vuint number = vuint_from_int(vint_of(spectrum ? -1.0f - index : splat(0.0f)));
    const Wavelengths* at = &scene->wavelengths;
    const vfloat line = at->first == 0u ? at->lines.x : at->first == 1u ? at->lines.y : at->lines.z;
    const vfloat value = color_spectrum_at(scene, (uint)SPECTRA_GIVEN + number * (uint)SPECTRA_LINES, line);
    *disperses = *disperses | spectrum;
    return spectrum ? value : index;
#else
    return index;
#endif
}

// From here on the scene is read at the wavelengths of these samples; and the color that the film sees of radiance there.
static void scene_at_wavelengths(Scene* scene, Sampler sampler, vuint pass) {
    scene->wavelengths = wavelengths_of(scene->spectra, scene->settings, sampler, pass);
}
static vec3 color_of_film(const Scene* scene, vec3 radiance) {
    const vec3* film = scene->wavelengths.film;
    return along(along(scale(film[0], radiance.x), film[1], radiance.y), film[2], radiance.z);
}

// Choose the wavelength at which paths with this throughput read indices of refraction at their next vertex: each as often as it carries.
static void scene_choose_wavelength(Scene* scene, Sampler sampler, vuint depth, vec3 throughput) {
#if defined(DISPERSION) && !defined(WAVELENGTHS_EQUAL)
    vuint bits, unused;
    Sampler own;
    own.seed = sampler.seed ^ 0x2545f491u;
    own.index = sampler.index;
    sampler_hash_bits(own, sampler_set(depth, SET_SPARE), &bits, &unused);
    const vfloat random = unit_interval(bits), part = depth == 0u ? wavelengths_choice(sampler, random) : random;
    const vfloat u = part * (throughput.x + throughput.y + throughput.z), two = throughput.x + throughput.y;
    const vuint other = (u < two) | !(throughput.z > 0.0f) ? splat_uint(1u) : splat_uint(2u);
    const vuint second = (throughput.y > 0.0f) | (throughput.z > 0.0f) ? other : splat_uint(0u);
    scene->wavelengths.first = u < throughput.x ? splat_uint(0u) : second;
#endif
}

// What a path has of its throughput where glass sends each wavelength another way: all of it at the one that was chosen.
static vec3 color_alone(const Scene* scene, vec3 throughput, vmask where) {
#if defined(DISPERSION) && !defined(WAVELENGTHS_EQUAL)
    const vuint first = scene->wavelengths.first;
    const vfloat all = throughput.x + throughput.y + throughput.z, none = splat(0.0f);
    return choose(where, vec3_of(first == 0u ? all : none, first == 1u ? all : none, first == 2u ? all : none), throughput);
#else
    return throughput;
#endif
}

// Each packet of paths has wavelengths of its own, and so a scene of its own.
#define SCENES PACKETS
#define EACH_SCENE(k) EACH_PACKET(k)
#define scene_of(scenes, k) ((scenes) + (k))

#else

#define SCENES 1
#define EACH_SCENE(k) for (uint k = 0; k < 0u; ++k)
#define scene_of(scenes, k) (scenes)

static vec3 color_reflectance(const Scene* scene, vec3 color) { return color; }
static vfloat color_most(const Scene* scene, vec3 color) { return largest(color); }
static vec3 color_unbounded(const Scene* scene, vec3 color) { return color; }
static vec3 color_light(const Scene* scene, vec3 color) { return color; }
static vfloat color_index(const Scene* scene, vfloat index, vmask* disperses) { return index; }
static void scene_choose_wavelength(Scene* scene, Sampler sampler, vuint depth, vec3 throughput) {}
static void scene_at_wavelengths(Scene* scene, Sampler sampler, vuint pass) {}
static vec3 color_of_film(const Scene* scene, vec3 radiance) { return radiance; }

#endif

// Of all pixels and paths from lights, for sample number `pass` of each (-D SHARED_TIME).
static void scene_at_pass(Scene* scene, uint pass) {
    Sampler none;
    none.seed = none.index = splat_uint(0u);
    scene_at_wavelengths(scene, none, splat_uint(pass));
}

static void scenes_of(const Scene* given, Scene scenes[SCENES]) {
    for (uint k = 0; k < SCENES; ++k) scenes[k] = *given;
}

#endif
