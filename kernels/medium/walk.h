// Random walks below the surface of skin, wax and marble (Chiang, Kutz and Burley, "Practical and controllable subsurface scattering for
// production path tracing", SIGGRAPH 2016 Talks): the points of a medium that fills a subsurface material.
//
// No light is sampled there, unless something shines inside: no shadow ray passes such a surface. Where the walk meets it from within, light
// is sampled as at any diffuse surface. So a step is one turn of the path's loop, and takes a fraction of the time of others.
//
// Built only where a scene has such a material (-D SUBSURFACE).
#ifndef MEDIUM_WALK_H
#define MEDIUM_WALK_H

#include "material/bsdf.h"
#include "medium/homogeneous.h"

#ifdef SUBSURFACE

static vmask walk_flag(const Scene* scene, vuint medium, uint flag) {
    return (vfloat_bits(lane_gather(scene->media_rows, medium * 16u + (uint)MEDIUM_ROW_FLAGS)) & flag) != 0u;
}

// Where a path scatters in a medium without light, or passes a subsurface material's surface into one, and none of it is reflected.
static vmask walk_in_the_dark(const Scene* scene, const Interior* in, const Crossing* c, const Bsdf* b) {
    const vmask either = b->medium | (b->passes & !bsdf_keeps(b));
    if (!lane_any(either)) return either;
    const vuint medium = b->passes ? interior_top(&c->beyond) : interior_top(in);
    return either & walk_flag(scene, either ? medium : splat_uint(0u), MEDIUM_FLAG_DARK);
}

// Where subsurface materials begin, layers show their albedo.
static vmask walk_begins(const Scene* scene, const Surface* s, vmask found, vec3* albedo) {
    const vmask begins = found & s->front & walk_flag(scene, s->medium, MEDIUM_FLAG_SUBSURFACE);
    if (!lane_any(begins)) return begins;
    vfloat row[16];
    lane_rows(scene->media_rows, begins ? s->medium : splat_uint(0u), row);
    *albedo = choose(begins, vec3_row(row, MEDIUM_ROW_ALBEDO), *albedo);
    return begins;
}

#else

static vmask walk_in_the_dark(const Scene* scene, const Interior* in, const Crossing* c, const Bsdf* b) { return mask_none(); }
static vmask walk_begins(const Scene* scene, const Surface* s, vmask found, vec3* albedo) { return mask_none(); }

#endif

#endif
