// Rays of photons and of light paths: where they arrive, at a surface or in a medium, and what is left of their flux there.
#ifndef MEDIUM_FLUX_H
#define MEDIUM_FLUX_H

#include "geometry/find.h"
#include "material/interior.h"
#include "medium/homogeneous.h"

// What the next one meets; `ray` then ends where its medium scatters it, if that is nearer.
static Hit flux_travel(const Scene* scene, const Interior* in, Ray* ray, Sampler sampler, vuint depth, vmask alive, vec3* flux) {
#ifdef MEDIA
    const FreePath free = medium_free_path(scene, in, ray, sampler, depth, *flux);
    ray->limit = lesser(ray->limit, free.length);
#else
    FreePath free;
    free.nothing = 0u;
#endif
    Hit hit = find_nearest(scene, ray, sampler, depth, mask_none(), alive);
    vec3 unseen = vec3_all(0.0f);
    medium_travel(scene, in, ray, &free, alive, flux, &hit, &unseen);
    return hit;
}

#endif
