// Nearest hits in a scene with instances, and the surface there.
#include "geometry/surface.h"

__kernel void trace_scene(SCENE_PARAMETERS __global const float* rays, uint count, __global float* distances, __global uint* primitives,
                          __global float* surfaces) {
    SCENE_COLLECT(scene);
    const uint first = (uint)get_global_id(0) * LANES;
    if (first >= count) return;
    vfloat number[6];
    for (uint k = 0; k < 6; ++k) number[k] = lane_restore(rays + k * count + first);
    const Ray ray = ray_make(vec3_row(number, 0), vec3_row(number, 3));
    const Hit hit = traverse_nearest(&scene.bvh, &ray, mask_all());
    const vmask found = hit.primitive != NONE;
    const Surface s = surface_at(&scene, &ray, hit, found);
    lane_store(hit.distance, distances + first);
    lane_store(hit.primitive, primitives + first);
    const vec3 vectors[4] = {s.point, s.error, s.normal, s.shading};
    for (uint k = 0; k < 4; ++k) {
        lane_store(vectors[k].x, surfaces + (k * 3 + 0) * count + first);
        lane_store(vectors[k].y, surfaces + (k * 3 + 1) * count + first);
        lane_store(vectors[k].z, surfaces + (k * 3 + 2) * count + first);
    }
}
