// Entry point of path tracing: `path`, and `direct` as path with no indirect rays.
#include "integrator/path.h"

// samples: float [sample_count][3][slot_count], radiance W/(sr m²).
// stats: uint4 a work-item: closest-hit rays, shadow rays, deepest path, 0.
__kernel GROUPED void integrator_path(SCENE_PARAMETERS uint first_slot, uint slot_count, uint first_sample, uint sample_count,
                                      __global float* restrict samples, __global uint4* restrict stats) {
    SCENE_COLLECT(scene);
    Pool pool = pool_open(settings, samples, first_slot, slot_count, first_sample, sample_count);
    PoolStats counted = {0, 0, splat_uint(0u)};
    if (pool.base < slot_count) path_trace(&scene, &pool, &counted);
    stats[get_global_id(0)] = (uint4)(counted.rays, counted.shadow_rays, lane_largest_uint(counted.deepest), 0u);
}
