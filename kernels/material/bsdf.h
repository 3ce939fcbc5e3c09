// Every scatterer behind one triple: bsdf_at, bsdf_eval, bsdf_sample. World space; directions point away from the surface.
//
// Rough materials are built only where a scene has them (-D ROUGH_MATERIALS): a scene without pays nothing for them.
#ifndef MATERIAL_BSDF_H
#define MATERIAL_BSDF_H

#include "core/frame.h"
#include "core/sampler.h"
#include "geometry/surface.h"
#include "material/conductor.h"
#include "material/dielectric.h"
#include "material/eon.h"
#include "material/lambert.h"
#include "material/mirror.h"
#ifdef TEXTURES
#include "texture/normal_map.h"
#include "texture/parameter.h"
#endif

typedef struct {
    Frame frame;         // around the shading normal, on the side of wo
    vec3 wo;             // local, towards where the light is seen from
    vec3 side;           // geometric normal on the side of wo
    vec3 color;
    vfloat eta;          // index beyond over index on wo's side
    vuint kind;
    vmask specular;      // all of it is a delta: only sampling it finds where light comes from
#ifdef ROUGH_MATERIALS
    vfloat roughness;
    Conductor conductor;
#endif
} Bsdf;

typedef struct {
    vec3 direction;      // unit, world
    vec3 weight;         // f |cosθ| / pdf; zero ends the path
    vfloat pdf;          // per steradian; 0 where the BSDF is specular (but whether it is, the mask says)
} BsdfSample;

#ifdef ROUGH_MATERIALS
// What the material of each lane has beyond a colour and an index.
static void bsdf_read_row(const Scene* scene, const Surface* s, Bsdf* b) {
    const vmask has_row = s->kind >= MATERIAL_OREN_NAYAR;
    vfloat row[16];
    lane_rows(scene->material_rows, has_row ? vfloat_bits(s->ior) : splat_uint(0u), row);
    b->roughness = row[MATERIAL_ROW_ROUGHNESS];
    b->conductor = conductor_at(scene->ggx_albedo, row, b->wo);
    b->specular = b->specular & ((s->kind != MATERIAL_OREN_NAYAR) & ((s->kind != MATERIAL_CONDUCTOR) | (b->roughness == 0.0f)));
}
#endif

static Bsdf bsdf_at(const Scene* scene, const Surface* s, vec3 direction) {
    Bsdf b;
    b.side = choose(s->front, s->normal, negate(s->normal));
    vec3 shading = s->shading, color = s->color;
#ifdef TEXTURES
    if (lane_any(s->attributes.textured)) {
        const TextureSlots slots = parameter_slots(scene, &s->attributes);
        color = parameter_color(scene, &s->attributes, &slots, TEXTURE_BASE_COLOR, color);
        shading = normal_map_shading(scene, &s->attributes, &slots, s->normal, shading, s->front, direction);
    }
#endif
    b.frame = frame_around(choose(s->front, shading, negate(shading)));
    b.wo = frame_to_local(b.frame, negate(direction));
    b.wo.z = greater(b.wo.z, splat(1.0e-7f));      // an interpolated normal may look away from the viewer
    b.color = color;
    b.eta = s->front ? s->ior : splat(1.0f) / s->ior;
    b.kind = s->kind;
    b.specular = s->kind != MATERIAL_LAMBERT;
#ifdef ROUGH_MATERIALS
    bsdf_read_row(scene, s, &b);
#endif
    return b;
}

// The normal of the side that light has to arrive on to be scattered; zero: on either.
static vec3 bsdf_receives(const Bsdf* b) { return choose(b->kind == MATERIAL_DIELECTRIC, vec3_all(0.0f), b->side); }

// f in 1/sr times |cosθ| of a local direction, and the density with which bsdf_sample chooses it. Deltas do not count.
static vec3 bsdf_eval_local(const Bsdf* b, vec3 wi, vfloat* pdf) {
    vec3 f = lambert_eval(b->color, wi);
    *pdf = lambert_pdf(wi);
#ifdef ROUGH_MATERIALS
    const vmask rough_diffuse = b->kind == MATERIAL_OREN_NAYAR;
    if (lane_any(rough_diffuse)) f = choose(rough_diffuse, eon_eval(b->color, b->roughness, b->wo, wi), f);
    const vmask metal = b->kind == MATERIAL_CONDUCTOR;
    if (lane_any(metal)) {
        vfloat metal_pdf;
        f = choose(metal, conductor_eval(&b->conductor, b->wo, wi, &metal_pdf), f);
        *pdf = metal ? metal_pdf : *pdf;
    }
#endif
    return scale(f, greater(wi.z, splat(0.0f)));
}

// The same of a direction in the world.
static vec3 bsdf_eval(const Bsdf* b, vec3 direction, vfloat* pdf) {
    vfloat density;
    const vec3 f = bsdf_eval_local(b, frame_to_local(b->frame, direction), &density);
    const vmask seen = !b->specular & (inner(direction, b->side) > 0.0f);
    *pdf = seen ? density : splat(0.0f);
    return choose(seen, f, vec3_all(0.0f));
}

// A local direction of a delta, and its weight.
static vec3 bsdf_sample_delta(const Bsdf* b, vfloat u, vec3* wi) {
    vec3 mirrored, through;
    const vec3 mirror_weight = mirror_sample(b->color, b->wo, &mirrored);
    const vec3 glass_weight = dielectric_sample(b->color, b->eta, b->wo, u, &through);
    const vmask glass = b->kind == MATERIAL_DIELECTRIC;
    *wi = choose(glass, through, mirrored);
    vec3 weight = choose(glass, glass_weight, mirror_weight);
#ifdef ROUGH_MATERIALS
    weight = choose(b->kind == MATERIAL_CONDUCTOR, conductor_fresnel(&b->conductor, b->wo.z), weight);
#endif
    return weight;
}

static BsdfSample bsdf_sample(const Bsdf* b, vuint bits_u, vuint bits_v) {
    const vfloat u = unit_interval(bits_u), v = unit_interval(bits_v);
    BsdfSample s;
    vec3 wi;
    s.weight = lambert_sample(b->color, u, v, &wi);
    s.pdf = lambert_pdf(wi);
#ifdef ROUGH_MATERIALS
    const vmask rough = !b->specular & (b->kind >= MATERIAL_OREN_NAYAR);
    if (lane_any(rough)) {
        const vmask metal = rough & (b->kind == MATERIAL_CONDUCTOR);
        if (lane_any(metal)) wi = choose(metal, conductor_sample(&b->conductor, b->wo, u, v), wi);
        vfloat pdf;
        const vec3 f = bsdf_eval_local(b, wi, &pdf);
        s.weight = choose(rough, scale(f, inverse_or_one(pdf)), s.weight);
        s.pdf = rough ? pdf : s.pdf;
    }
#endif
    if (lane_any(b->specular)) {
        vec3 delta;
        s.weight = choose(b->specular, bsdf_sample_delta(b, u, &delta), s.weight);
        wi = choose(b->specular, delta, wi);
        s.pdf = b->specular ? splat(0.0f) : s.pdf;
    }
    s.direction = direction_again(frame_to_world(b->frame, wi));
    // A direction on the other side of the geometry than it is of the shading normal carries no light.
    const vmask crossed = (inner(s.direction, b->side) > 0.0f) != (wi.z > 0.0f);
    s.weight = choose(crossed, vec3_all(0.0f), s.weight);
    return s;
}

#endif
