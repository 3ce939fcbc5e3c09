// The media around a point where a path begins. The host knows those around the origin of one of the camera's rays; from there to
// the point each surface on the way changes the list as it does that of a path. So it is found for the camera's other rays, where the film of an
// orthographic camera, or a lens, cuts the surface of a medium (-D CAMERA_CUTS_MEDIA), and for paths from lights, where volumes are about
// (-D LIGHTS_IN_MEDIA): even where a surface has a hole, it is then on either side of it what paths from the camera find there.
#ifndef CAMERA_SURROUNDINGS_H
#define CAMERA_SURROUNDINGS_H

#include "geometry/surface.h"
#include "geometry/traverse.h"
#include "material/interior.h"

#if defined(CAMERA_CUTS_MEDIA) || defined(LIGHTS_IN_MEDIA)

// The nearest surface of any kind: a volume has its whole surface, whatever is seen of it.
static Hit surroundings_nearest(const Scene* scene, const Ray* ray, vmask asked) {
    Hit hit = traverse_nearest(&scene->bvh, ray, asked);
#ifdef OPACITY
    Ray before = *ray;
    before.limit = hit.distance;
    const Hit masked = traverse_nearest(&scene->masked, &before, asked);
    const vmask nearer = masked.primitive != NONE;
    hit.distance = nearer ? masked.distance : hit.distance;
    hit.primitive = nearer ? masked.primitive : hit.primitive;
#endif
    return hit;
}

static Interior surroundings_at(const Scene* scene, vec3 origin, vmask asked, vfloat time) {
    Interior in = interior_none();
    interior_start(scene, &in, mask_all());
    const vec3 from = vec3_from(scene->camera->cuts_media ? scene->camera->around : scene->camera->origin), way = sub(origin, from);
    Ray ray = ray_in_time(ray_make(from, way), time);
    ray.limit = splat(1.0f);
    asked = asked & (largest_size(way) > 0.0f);
    while (lane_any(asked)) {
        const Hit hit = surroundings_nearest(scene, &ray, asked);
        asked = asked & (hit.primitive != NONE);
        Surface surface = surface_at(scene, &ray, hit, asked);
        const Crossing crossing = interior_meet(scene, &in, &surface, asked);
        interior_replace(&in, crossing.beyond, asked);

        // Go on behind it, unless that is beyond the origin already
        Ray behind = surface_leave(&surface, ray.direction);
        behind.direction = sub(origin, behind.origin);
        behind.limit = splat(1.0f);
        asked = asked & (inner(behind.direction, way) > 0.0f);
        ray_replace(&ray, behind, asked);
    }
    return in;
}

#endif

#endif
