// What the material of each lane is made of: the numbers of its rows (MATERIAL_ROW_* and LAYER_ROW_* of types.h), as they are at the
// point that is shaded. All that depends on them is computed from here on.
#ifndef MATERIAL_PARAMETERS_H
#define MATERIAL_PARAMETERS_H

#include "core/sampler.h"
#include "geometry/surface.h"
#ifdef HAIR
#include "material/lobe/hair.h"
#endif
#include "plugin/given.h"
#include "spectral/color.h"
#ifdef TEXTURES
#include "plugin/textured.h"
#include "texture/normal_map.h"
#include "texture/parameter.h"
#endif

typedef struct {
    vuint kind, flags;             // MATERIAL_*, MATERIAL_FLAG_*
    vec3 color;
#if defined(SPECTRAL) && defined(TEXTURES)
    vec3 shade;                    // a spectrum in the place of the color is multiplied by it
#endif
    vfloat roughness, metallic, ior, transmission, specular;
#ifdef DISPERSION
    vmask disperses;               // `ior` depends on the wavelength
#endif
    vec3 specular_color;
    vfloat diffuse_roughness, coat, coat_roughness;
    vec3 sheen_color;
    vfloat sheen_most;             // the largest of them, or of its spectrum: the same whatever the wavelengths of the path are
    vfloat sheen_roughness, anisotropy, rotation;
    vfloat diffuse_transmission;
    vec3 diffuse_transmission_color;
    vec3 eta, k, fresnel;
#ifdef IRIDESCENCE
    vfloat film_share, film_thickness, film_ior, film_index; // of a thin film: nanometres; index over that of the medium before it, and alone
#endif
#ifdef SPECULAR_CHAINS
    vmask mixed;                   // it is one of mixed materials
#endif
#ifdef TEXTURES
    vec3 shading;                  // the shading normal, on the front side
#endif
#ifdef HAIR
    HairNumbers hair;              // of kind MATERIAL_HAIR
#endif
#ifdef MEASURED
    vuint measured;                // of kind MATERIAL_MEASURED, the first row of its tables
#endif
#ifdef PLUGIN_BSDFS
    vuint plugin;                  // its number; 0: none
    vfloat numbers[PLUGIN_NUMBERS];
#endif
} Parameters;

static vmask parameters_flag(const Parameters* p, uint flag) { return (p->flags & flag) != 0u; }

// Bits that differ from point to point, and are the same on every driver: what is next to zero counts as zero.
static vuint parameters_bits(vfloat x) { return absolute(x) < 1.0e-30f ? splat_uint(0u) : vfloat_bits(x); }
static vuint parameters_hash(vec3 point) {
    return hash_pair(hash_pair(parameters_bits(point.x), parameters_bits(point.y)), parameters_bits(point.z));
}

// The point's number in [0, 1), which chooses among mixed materials. `clrender furnace` has its own.
#ifndef PARAMETERS_CHOICE
#define PARAMETERS_CHOICE(surface) unit_interval(parameters_hash((surface)->point))
#endif

// Of mixed materials one is met, as often as its weight says: which, is a function of the point alone (PBR 4ed, 10.5.1, takes the
// direction, too), so that all that happens at a vertex happens to one material, and is reciprocal. `first` is the row of each lane's material.
// Returns where there was a choice.
static vmask parameters_unmix(const Scene* scene, const Surface* s, vmask has_row, vuint* row, vfloat first[16]) {
    vmask mixed = has_row & (vfloat_bits(first[MATERIAL_ROW_KIND]) == MATERIAL_MIX);
    const vmask mixtures = mixed;
    if (!lane_any(mixed)) return mixtures;
    vfloat u = PARAMETERS_CHOICE(s);
    while (lane_any(mixed)) {
        vfloat weight = first[MATERIAL_ROW_WEIGHT];
#ifdef TEXTURES
        const TextureSlots slots = parameter_slots(scene, &s->attributes, *row);
        weight = parameter_number(scene, &s->attributes, &slots, TEXTURE_WEIGHT, weight);
#endif
        const vmask second = u < weight;
        const vfloat again = quotient(second ? u : u - weight, second ? weight : splat(1.0f) - weight);
        const vuint next = second ? vfloat_bits(first[MATERIAL_ROW_SECOND]) : vfloat_bits(first[MATERIAL_ROW_FIRST]);
        u = mixed ? bounded(again, 0.0f, 0.99999994f) : u;
        *row = mixed ? next : *row;
        lane_rows(scene->material_rows, *row * 2u, first);
        mixed = has_row & (vfloat_bits(first[MATERIAL_ROW_KIND]) == MATERIAL_MIX);
    }
    return mixtures;
}

// Where an image is mirrored and nothing passes.
static vmask parameters_glossy(const Parameters* p) {
    const vmask opaque = (p->kind == MATERIAL_PRINCIPLED) & (p->transmission == 0.0f) & (p->diffuse_transmission == 0.0f);
    return opaque | (p->kind == MATERIAL_MIRROR) | (p->kind == MATERIAL_CONDUCTOR) | (p->kind == MATERIAL_MEASURED);
}

#ifdef IRIDESCENCE
// The film that lies on the lanes' materials, where they have rows. `given`: their indices by their rows.
static void parameters_film(const Scene* scene, const Surface* s, vmask has_row, vuint row, vfloat given, Parameters* p) {
    vfloat film[8];
    lane_octets(scene->thin_film_rows, (row + THIN_FILM_MATERIALS) * 8u, film);
    p->film_share = has_row ? film[THIN_FILM_ROW_SHARE] : splat(0.0f);
    // The surface may lie in something else than what the material says
    const vfloat own = given > 0.0f ? given : p->ior;
    p->film_ior = film[THIN_FILM_ROW_IOR] * quotient(p->ior, own), p->film_index = film[THIN_FILM_ROW_INDEX];
    vfloat most = splat(1.0f);
#ifdef TEXTURES
    const Attributes* a = &s->attributes;
    const vuint share = vfloat_bits(film[THIN_FILM_ROW_SHARE_TEXTURE]), thickness = vfloat_bits(film[THIN_FILM_ROW_THICKNESS_TEXTURE]);
    const vmask varies = has_row & a->textured & (share != NONE), swells = has_row & a->textured & (thickness != NONE);
    if (lane_any(varies)) p->film_share = varies ? bounded(parameter_texture(scene, a, share, varies).x, 0.0f, 1.0f) : p->film_share;
    if (lane_any(swells)) most = swells ? bounded(parameter_texture(scene, a, thickness, swells).x, 0.0f, 1.0f) : most;
#endif
    p->film_thickness = fma(film[THIN_FILM_ROW_RANGE], most, film[THIN_FILM_ROW_LEAST]);
}
#endif

#ifdef TEXTURES
// Textures in the place of parameters; `material` is the number of each lane's material.
static void parameters_texture(const Scene* scene, const Surface* s, vuint material, vec3 direction, Parameters* p) {
    const Attributes* a = &s->attributes;
    p->shading = s->shading;
    if (!lane_any(a->textured)) return;
    const TextureSlots slots = parameter_slots(scene, a, material);
#ifdef SPECTRAL
    p->color = parameter_base_color(scene, a, &slots, p->color, &p->shade);
#else
    vec3 none;
    p->color = parameter_base_color(scene, a, &slots, p->color, &none);
#endif
    p->roughness = parameter_number(scene, a, &slots, TEXTURE_ROUGHNESS, p->roughness);
    p->metallic = parameter_number(scene, a, &slots, TEXTURE_METALLIC, p->metallic);
    p->transmission = parameter_number(scene, a, &slots, TEXTURE_TRANSMISSION, p->transmission);
    p->specular = parameter_number(scene, a, &slots, TEXTURE_SPECULAR, p->specular);
    p->specular_color = parameter_color(scene, a, &slots, TEXTURE_SPECULAR_COLOR, p->specular_color);
    p->diffuse_roughness = parameter_number(scene, a, &slots, TEXTURE_DIFFUSE_ROUGHNESS, p->diffuse_roughness);
    p->coat = parameter_number(scene, a, &slots, TEXTURE_COAT, p->coat);
    p->coat_roughness = parameter_number(scene, a, &slots, TEXTURE_COAT_ROUGHNESS, p->coat_roughness);
    p->sheen_color = parameter_color(scene, a, &slots, TEXTURE_SHEEN_COLOR, p->sheen_color);
    p->sheen_roughness = parameter_number(scene, a, &slots, TEXTURE_SHEEN_ROUGHNESS, p->sheen_roughness);
    p->anisotropy = parameter_number(scene, a, &slots, TEXTURE_ANISOTROPY, p->anisotropy);
    p->shading = normal_map_shading(scene, a, &slots, s->normal, s->shading, s->front, direction);
#ifdef PLUGIN_BSDFS
    plugin_textured(scene, a, &slots, p->plugin, p->numbers);
#endif
}
#endif

// What they are at the lanes' wavelengths. Only metals have the last three.
static void parameters_at_wavelengths(const Scene* scene, Parameters* p) {
    p->sheen_most = color_most(scene, p->sheen_color);
#ifdef SPECTRAL
    p->color = color_reflectance(scene, p->color);
#ifdef TEXTURES
    p->color = mul(p->color, color_reflectance(scene, p->shade));
#endif
    p->specular_color = color_reflectance(scene, p->specular_color);
    p->sheen_color = color_reflectance(scene, p->sheen_color);
    p->diffuse_transmission_color = color_reflectance(scene, p->diffuse_transmission_color);
    const vmask metal = p->kind == MATERIAL_CONDUCTOR;
    if (!lane_any(metal)) return;
    const vec3 none = vec3_all(0.0f);
    p->eta = color_unbounded(scene, choose(metal, p->eta, none));
    p->k = color_unbounded(scene, choose(metal, p->k, none));
    p->fresnel = color_reflectance(scene, choose(metal, p->fresnel, none));
#endif
}

// `direction`: of the ray that arrives. Lanes whose material has no row get their kind, colour and index; the rest says nothing there.
static Parameters material_at(const Scene* scene, const Surface* s, vec3 direction) {
    const vmask has_row = s->kind == MATERIAL_BY_ROW;
    vuint row = has_row ? vfloat_bits(s->color.x) : splat_uint(0u);
    vfloat a[16], b[16];
    lane_rows(scene->material_rows, row * 2u, a);
    const vmask mixed = parameters_unmix(scene, s, has_row, &row, a);
    lane_rows(scene->material_rows, row * 2u + 1u, b);
    Parameters p;
#ifdef SPECULAR_CHAINS
    p.mixed = mixed;
#endif
    p.kind = has_row ? vfloat_bits(a[MATERIAL_ROW_KIND]) : s->kind;
    p.flags = has_row ? vfloat_bits(a[MATERIAL_ROW_FLAGS]) : splat_uint(0u);
    p.color = choose(has_row, vec3_row(a, MATERIAL_ROW_COLOR), s->color);
#if defined(SPECTRAL) && defined(TEXTURES)
    p.shade = vec3_all(1.0f);
#endif
    p.roughness = has_row ? a[MATERIAL_ROW_ROUGHNESS] : splat(0.0f);
    p.metallic = a[MATERIAL_ROW_METALLIC];
#ifdef DISPERSION
    p.disperses = s->disperses;
    p.ior = lane_any(mixed) ? (mixed ? color_index(scene, mixed ? a[MATERIAL_ROW_IOR] : splat(1.0f), &p.disperses) : s->ior) : s->ior;
#else
    p.ior = mixed ? a[MATERIAL_ROW_IOR] : s->ior;      // of one material, what the integrator takes it for
#endif
    p.transmission = a[MATERIAL_ROW_TRANSMISSION];
    p.specular = a[MATERIAL_ROW_SPECULAR];
    p.specular_color = vec3_row(a, MATERIAL_ROW_SPECULAR_COLOR);
    p.diffuse_roughness = a[MATERIAL_ROW_DIFFUSE_ROUGHNESS];
    p.coat = a[MATERIAL_ROW_COAT];
    p.coat_roughness = a[MATERIAL_ROW_COAT_ROUGHNESS];
    p.sheen_color = vec3_row(b, LAYER_ROW_SHEEN_COLOR);
    p.sheen_roughness = b[LAYER_ROW_SHEEN_ROUGHNESS];
    p.anisotropy = has_row ? b[LAYER_ROW_ANISOTROPY] : splat(0.0f);
    p.rotation = b[LAYER_ROW_ROTATION];
    p.eta = vec3_row(b, LAYER_ROW_ETA);
    p.k = vec3_row(b, LAYER_ROW_K);
    p.fresnel = vec3_row(b, LAYER_ROW_FRESNEL);
    p.diffuse_transmission = p.kind == MATERIAL_PRINCIPLED ? b[LAYER_ROW_DIFFUSE_TRANSMISSION] : splat(0.0f);
    p.diffuse_transmission_color = vec3_row(b, LAYER_ROW_DIFFUSE_TRANSMISSION_COLOR);
#ifdef HAIR
    p.hair.variance = a[MATERIAL_ROW_HAIR_VARIANCE];
    p.hair.spread = a[MATERIAL_ROW_HAIR_SPREAD];
    p.hair.per_logarithm = a[MATERIAL_ROW_HAIR_PER_LOGARITHM];
    p.hair.eta = b[LAYER_ROW_HAIR_ETA];
    p.hair.tilt_sine = b[LAYER_ROW_HAIR_TILT_SINE], p.hair.tilt_cosine = b[LAYER_ROW_HAIR_TILT_COSINE];
#endif
#ifdef MEASURED
    p.measured = vfloat_bits(a[MATERIAL_ROW_MEASURED]);
#endif
#ifdef PLUGIN_BSDFS
    p.plugin = p.kind == MATERIAL_PLUGIN ? vfloat_bits(a[MATERIAL_ROW_PLUGIN]) : splat_uint(0u);
    for (int i = 0; i < PLUGIN_NUMBERS / 2; ++i) {
        p.numbers[i] = a[MATERIAL_ROW_NUMBERS + i];
        p.numbers[PLUGIN_NUMBERS / 2 + i] = b[LAYER_ROW_MORE_NUMBERS + i];
    }
#endif
#ifdef IRIDESCENCE
    parameters_film(scene, s, has_row, row, a[MATERIAL_ROW_IOR], &p);
#endif
#ifdef TEXTURES
    parameters_texture(scene, s, has_row ? row : vfloat_bits(s->attributes.row[ATTRIBUTE_ROW_SLOTS]), direction, &p);
#endif
    parameters_at_wavelengths(scene, &p);
    return p;
}

#endif
