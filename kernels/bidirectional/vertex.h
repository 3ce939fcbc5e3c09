// Vertices of light paths, as camera paths join with them: what is needed to make the surface and its BSDF again.
#ifndef BIDIRECTIONAL_VERTEX_H
#define BIDIRECTIONAL_VERTEX_H

#include "bidirectional/techniques.h"
#include "core/frame.h"
#include "core/sampler.h"
#include "geometry/surface.h"
#include "material/interior.h"
#include "material/reversed.h"
#include "medium/homogeneous.h"

// Where the random numbers of light path number `number` of a sample of all pixels come from.
static Sampler light_path_sampler(const Scene* scene, uint pass, vuint number) {
    Sampler s;
    s.seed = hash_pair(hash_pair(splat_uint(pass), splat_uint(scene->settings->seed)), splat_uint(0x3c6ef372u));
    s.index = number;
    return s;
}

// The reach of a vertex for a direction (bidirectional/techniques.h), and what a square metre there is worth that is seen from that direction: in a
// medium, which has no sides, one. `in`: the medium where the path arrived.
static vfloat vertex_cosine(const Surface* s, const Bsdf* b, vec3 direction) {
    return bsdf_in_medium(b) ? splat(1.0f) : absolute(inner(s->normal, direction));
}
static vfloat vertex_reach(const Scene* scene, const Interior* in, const Surface* s, const Bsdf* b, vec3 direction) {
    const vfloat cosine = absolute(inner(s->normal, direction));
#ifdef MEDIA
    const vmask medium = bsdf_in_medium(b);
    if (!lane_any(medium)) return cosine;
    vfloat row[16];
    interior_row(scene, medium ? interior_top(in) : splat_uint(0u), row);
    const vec3 extinction = vec3_row(row, MEDIUM_ROW_EXTINCTION);
    const vfloat reach = (extinction.x + extinction.y + extinction.z) * (1.0f / 3.0f);
    return medium ? reach * medium_density(scene, row, s->point, medium) : cosine;
#else
    return cosine;
#endif
}

// The same for paths that come from there. Those that meet a curve do so on its outside only, while a path that it scatters may go on through it.
static vfloat vertex_reached(const Scene* scene, const Interior* in, const Surface* s, const Bsdf* b, vec3 direction) {
    const vfloat reach = vertex_reach(scene, in, s, b, direction);
#ifdef CURVES
    return s->curve & !(inner(s->normal, direction) > 0.0f) ? splat(0.0f) : reach;
#else
    return reach;
#endif
}

// A vertex of a light path: how it was reached, and with what.
typedef struct {
    vec3 origin, direction;      // of the ray that met it
    Hit hit;
    vec3 flux;                   // that arrives
    Techniques techniques;
    vuint depth;                 // scattering events before it
    Interior interior;           // on the way there
} LightVertex;

static void light_vertex_write(const LightVertex* v, vfloat row[16]) {
    vec3_row_put(row, LIGHT_VERTEX_ROW_ORIGIN, v->origin);
    vec3_row_put(row, LIGHT_VERTEX_ROW_DIRECTION, v->direction);
    vec3_row_put(row, LIGHT_VERTEX_ROW_FLUX, v->flux);
    row[LIGHT_VERTEX_ROW_DISTANCE] = v->hit.distance;
    row[LIGHT_VERTEX_ROW_PRIMITIVE] = vfloat_from_bits(v->hit.primitive);
    row[LIGHT_VERTEX_ROW_EDGE] = v->techniques.edge;
    row[LIGHT_VERTEX_ROW_EARLIER] = v->techniques.earlier;
    row[LIGHT_VERTEX_ROW_DEPTH] = vfloat_from_bits(v->depth);
    row[LIGHT_VERTEX_ROW_MEDIA] = row[LIGHT_VERTEX_ROW_MEDIA + 1] = splat(0.0f);
#ifdef INTERIORS
    row[LIGHT_VERTEX_ROW_MEDIA] = vfloat_from_bits(v->interior.first);
    row[LIGHT_VERTEX_ROW_MEDIA + 1] = vfloat_from_bits(v->interior.last);
#endif
}

static LightVertex light_vertex_read(__global const float* vertices, vuint number) {
    vfloat row[16];
    lane_rows(vertices, number, row);
    LightVertex v;
    v.origin = vec3_row(row, LIGHT_VERTEX_ROW_ORIGIN);
    v.direction = vec3_row(row, LIGHT_VERTEX_ROW_DIRECTION);
    v.flux = vec3_row(row, LIGHT_VERTEX_ROW_FLUX);
    v.hit.distance = row[LIGHT_VERTEX_ROW_DISTANCE];
    v.hit.primitive = vfloat_bits(row[LIGHT_VERTEX_ROW_PRIMITIVE]);
    v.techniques.edge = row[LIGHT_VERTEX_ROW_EDGE];
    v.techniques.earlier = row[LIGHT_VERTEX_ROW_EARLIER];
    v.depth = vfloat_bits(row[LIGHT_VERTEX_ROW_DEPTH]);
    v.interior = interior_none();
#ifdef INTERIORS
    v.interior.first = vfloat_bits(row[LIGHT_VERTEX_ROW_MEDIA]);
    v.interior.last = vfloat_bits(row[LIGHT_VERTEX_ROW_MEDIA + 1]);
#endif
    return v;
}

#endif
