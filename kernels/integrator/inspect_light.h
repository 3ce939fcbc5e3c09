// A light path that a path from the camera was connected with, or that the camera sees, written down: it is traced again, by the functions that
// traced it. What it is is a function of its number and the sample's, so it is the same path.
#ifndef INTEGRATOR_INSPECT_LIGHT_H
#define INTEGRATOR_INSPECT_LIGHT_H

#include "bidirectional/light_path.h"

// Light path `number`, as far as the vertex after `last` scattering events, in rows of the path.
static void inspect_light_path(const Scene* scene, Path* path, uint pass, uint number, uint last) {
    LightPath p = light_path_none();
    LightArrival arrival;
    light_path_start(scene, pass, number, mask_all(), &p);
    inspect_light_start(scene, inspect_row(path, INSPECT_LIGHT_START), &p.ray, p.flux, p.light, p.far);
    for (;;) {
#ifdef MEDIA
        const FreePath free = medium_free_path(scene, &p.interior, &p.ray, p.sampler, p.depth, p.flux);
        p.ray.limit = lesser(p.ray.limit, free.length);
#else
        FreePath free;
        free.nothing = 0u;
#endif
        Hit hit = find_nearest(scene, &p.ray, p.sampler, p.depth, mask_none(), p.alive);
        const vec3 sent = p.flux;
        vec3 unseen = vec3_all(0.0f);
        medium_travel(scene, &p.interior, &p.ray, &free, p.alive, &p.flux, &hit, &unseen);
        p.row = inspect_row(path, INSPECT_LIGHT_VERTEX);
        light_path_arrive(scene, &p, hit, &arrival);
        if (arrival.joins && p.depth >= last) return;
        if (!light_path_scatter(scene, &p, &arrival, sent, hit)) return;
    }
}

// That of the path's connection, as far as its vertex; `arriving` is what the connection adds if nothing is in the way.
static void inspect_joined_path(const Scene* scene, Path* path, uint pass, vec3 arriving) {
    inspect_join_asked(path, arriving);
    inspect_light_path(scene, path, pass, path->inspection.joined, path->inspection.joined_depth);
}

#endif
