// Where a ray arrives, by way of what it passes, and what kind of vertex that is.
#ifndef STAGED_ARRIVE_H
#define STAGED_ARRIVE_H

#include "staged/stage.h"

// Go to what was found, and note both. Returns the kind of vertex.
static uint arrive(const Scene* scene, State s, Path* path, const FreePath* free, Hit* hit) {
    split_again(&path->split, hit);
    path_travel(scene, path, free, hit);
    state_put_hit(s, hit);
#ifdef INTERIORS
    state_put_throughput(s, path);
#ifdef GLOWING_MEDIA
    state_put_radiance(s, path);
#endif
#endif
    return vertex_kind(scene, path->alive, *hit);
}

#endif
