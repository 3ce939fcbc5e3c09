// Where a point lies in the texture coordinates of its shape, and which way they run there.
#ifndef TEXTURE_MAPPING_H
#define TEXTURE_MAPPING_H

#include "core/exact.h"
#include "core/frame.h"
#include "geometry/instance.h"
#include "plugin/given.h"
#include "texture/filter.h"
#include "types.h"

// What a surface with textures has beside a Surface.
typedef struct {
    vmask textured;          // its material has textures, or it shines as one
    vmask sphere, disk;      // else it is a triangle
    vfloat row[16];          // ATTRIBUTE_ROW_*
    vec3 ab, ac;             // triangle: two edges, and the barycentric weights of B and C
    vfloat weight_b, weight_c;
    vec3 out;                // sphere or disk: from its centre, in multiples of the radius
    vfloat radius;
    Taps taps;
#if defined(TANGENTS) && defined(INSTANCES)
    Placed placed;           // tangents of an instance's triangles are in the space of its group
#endif
#ifdef PLUGIN_TEXTURES
    vec3 point;              // on the device, for textures that are functions of it
#endif
} Attributes;

// Those of each lane's primitive, of these rows, without the point. All four texels around it are read, if surface_random does not say
// otherwise.
static Attributes mapping_attributes_of(__global const float* rows, vuint primitive, vmask textured) {
    Attributes a;
    a.textured = textured;
    a.sphere = a.disk = mask_none();
    a.out = vec3_all(0.0f);
    a.radius = splat(0.0f);
    a.taps.u = a.taps.v = splat(0.0f);
    a.taps.random = 0;
#ifdef PLUGIN_TEXTURES
    a.point = vec3_all(0.0f);
#endif
    lane_rows(rows, textured ? primitive : splat_uint(0u), a.row);
    return a;
}

static Attributes mapping_attributes(const Scene* scene, vuint primitive, vmask textured) {
    return mapping_attributes_of(scene->attribute_rows, primitive, textured);
}

// atan(x) / 2π for x in [0, 1]: a minimax polynomial, absolute error below 3e-8.
static vfloat mapping_small_turn(vfloat x) {
    const vfloat y = x * x;
    vfloat p = fma(splat(-6.45303749e-4f), y, splat(3.47959646e-3f));
    p = fma(p, y, splat(-8.89872294e-3f));
    p = fma(p, y, splat(1.53460354e-2f));
    p = fma(p, y, splat(-2.21362729e-2f));
    p = fma(p, y, splat(3.17459442e-2f));
    p = fma(p, y, splat(-5.30461222e-2f));
    return fma(p, y, splat(1.59154832e-1f)) * x;
}

// The angle of (x, y), in turns from -1/2 to 1/2; 0 at the origin.
static vfloat mapping_turn(vfloat y, vfloat x) {
    const vfloat ax = absolute(x), ay = absolute(y);
    const vmask steep = ay > ax;
    const vfloat large = steep ? ay : ax, small = steep ? ax : ay;
    const vfloat eighth = mapping_small_turn(small * inverse_or_one(large));
    const vfloat quarter = steep ? splat(0.25f) - eighth : eighth;
    const vfloat half_turn = x < 0.0f ? splat(0.5f) - quarter : quarter;
    return y < 0.0f ? -half_turn : half_turn;
}

// The corners' coordinates of each lane's set: A, and the steps to B and C.
static void mapping_steps(const Attributes* a, vuint set, vfloat at[2], vfloat b[2], vfloat c[2]) {
    const vmask second = set != 0u;
    for (int k = 0; k < 2; ++k) {
        at[k] = second ? a->row[ATTRIBUTE_ROW_UV_1 + k] : a->row[ATTRIBUTE_ROW_UV + k];
        b[k] = (second ? a->row[ATTRIBUTE_ROW_UV_1 + 2 + k] : a->row[ATTRIBUTE_ROW_UV + 2 + k]) - at[k];
        c[k] = (second ? a->row[ATTRIBUTE_ROW_UV_1 + 4 + k] : a->row[ATTRIBUTE_ROW_UV + 4 + k]) - at[k];
    }
}

// Where `out` lies along the axes of a sphere or disk.
static vec3 mapping_local(const Attributes* a) {
    return vec3_of(inner(a->out, vec3_row(a->row, ATTRIBUTE_ROW_X)), inner(a->out, vec3_row(a->row, ATTRIBUTE_ROW_Y)),
                   inner(a->out, vec3_row(a->row, ATTRIBUTE_ROW_Z)));
}

// Texture coordinates of the point, of set 0 or 1. Spheres and disks have the same in both.
static void mapping_uv(const Attributes* a, vuint set, vfloat* u, vfloat* v) {
    vfloat at[2], b[2], c[2];
    mapping_steps(a, set, at, b, c);
    *u = fma(c[0], a->weight_c, fma(b[0], a->weight_b, at[0]));
    *v = fma(c[1], a->weight_c, fma(b[1], a->weight_b, at[1]));
    if (!lane_any(a->sphere | a->disk)) return;
    const vec3 place = mapping_local(a);
    *u = a->disk ? fma(place.x, splat(0.5f), splat(0.5f)) : *u;
    *v = a->disk ? fma(place.y, splat(0.5f), splat(0.5f)) : *v;
    const vfloat level = root(place.x * place.x + place.z * place.z);
    *u = a->sphere ? mapping_turn(place.x, place.z) + 0.5f : *u;
    *v = a->sphere ? fma(mapping_turn(place.y, level), splat(2.0f), splat(0.5f)) : *v;
}

// The derivatives of the point by its texture coordinates, metres; zero where the coordinates are degenerate.
static void mapping_tangents(const Attributes* a, vuint set, vec3* along_u, vec3* along_v) {
    vfloat at[2], b[2], c[2];
    mapping_steps(a, set, at, b, c);
    const vfloat area = difference_of_products(b[0], c[1], b[1], c[0]);
    const vmask sound = absolute(area) >= 1.0e-30f;
    const vfloat inverse = sound ? quotient(splat(1.0f), sound ? area : splat(1.0f)) : splat(0.0f);
    *along_u = scale(sub(scale(a->ab, c[1]), scale(a->ac, b[1])), inverse);
    *along_v = scale(sub(scale(a->ac, b[0]), scale(a->ab, c[0])), inverse);
    if (!lane_any(a->sphere | a->disk)) return;
    const vec3 x = vec3_row(a->row, ATTRIBUTE_ROW_X), y = vec3_row(a->row, ATTRIBUTE_ROW_Y), z = vec3_row(a->row, ATTRIBUTE_ROW_Z);
    const vec3 place = mapping_local(a);
    const vec3 east = scale(sub(scale(x, place.z), scale(z, place.x)), a->radius * (2.0f * PI));
    const vec3 north = scale(unit(sub(y, scale(a->out, place.y))), a->radius * PI);
    *along_u = choose(a->sphere, east, choose(a->disk, scale(x, a->radius * 2.0f), *along_u));
    *along_v = choose(a->sphere, north, choose(a->disk, scale(y, a->radius * 2.0f), *along_v));
}

#endif
