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
        const vec3 sent = p.flux;
        const Hit hit = flux_travel(scene, &p.interior, &p.ray, p.sampler, p.depth, p.alive, &p.flux);
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
