// A ray to a surface, and another that leaves it again on the side asked for.
#include "geometry/surface.h"

// rays: float [6][count], origin and direction. leaving: float [3][count], the second direction; its sign is turned to the side of
// the normal if `outwards`, else to the other. hits: uint [2][count], what each of the two rays hit. seconds: float [6][count], the
// second ray.
__kernel void leave(SCENE_PARAMETERS __global const float* rays, __global const float* leaving, uint outwards, uint count,
                    __global uint* hits, __global float* seconds) {
    SCENE_COLLECT(scene);
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    const Ray ray = ray_make(vec3_of(lane_load(rays + at), lane_load(rays + count + at), lane_load(rays + 2 * (size_t)count + at)),
                             vec3_of(lane_load(rays + 3 * (size_t)count + at), lane_load(rays + 4 * (size_t)count + at),
                                     lane_load(rays + 5 * (size_t)count + at)));
    const Hit first = traverse_nearest(&scene.bvh, &ray, mask_all());
    const vmask found = first.primitive != NONE;
    const Surface surface = surface_at(&scene, &ray, first, found);
    const vec3 given =
        vec3_of(lane_load(leaving + at), lane_load(leaving + count + at), lane_load(leaving + 2 * (size_t)count + at));
    const vmask behind = inner(given, surface.normal) < 0.0f;
    const Ray next = surface_leave(&surface, outwards ? choose(behind, negate(given), given) : choose(behind, given, negate(given)));
    const Hit second = traverse_nearest(&scene.bvh, &next, found);
    lane_save(first.primitive, hits + at);
    lane_save(second.primitive, hits + count + at);
    const vfloat out[6] = {next.origin.x, next.origin.y, next.origin.z, next.direction.x, next.direction.y, next.direction.z};
    for (int k = 0; k < 6; ++k) lane_save(out[k], seconds + (size_t)k * count + at);
}
