// Entry point of Whitted's ray tracing.
#include "integrator/whitted.h"

// samples and stats: as integrator_path in path.cl.
__kernel GROUPED void integrator_whitted(SCENE_PARAMETERS uint first_slot, uint slot_count, uint first_sample, uint sample_count,
                                         __global float* restrict samples, __global uint4* restrict stats) {
    SCENE_COLLECT(scene);
    Pool pool = pool_open(settings, samples, first_slot, slot_count, first_sample, sample_count);
    PoolStats counted = {0, 0, splat_uint(0u)};
    if (pool.base < slot_count) whitted_trace(&scene, &pool, &counted);
    stats[get_global_id(0)] = (uint4)(counted.rays, counted.shadow_rays, lane_largest_uint(counted.deepest), 0u);
}
