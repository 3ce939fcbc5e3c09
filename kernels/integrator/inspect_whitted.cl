// Entry point of Whitted's ray tracing that writes its paths down: those of integrator_whitted, for one pixel.
#define PATH_INSPECTED
#include "integrator/whitted.h"

// records: as inspect_path in inspect_path.cl.
__kernel GROUPED void inspect_whitted_path(SCENE_PARAMETERS uint first_slot, uint slot_count, uint first_sample, uint sample_count,
                                           __global float* restrict samples, __global uint4* restrict stats, __global uint* restrict records) {
    SCENE_COLLECT(scene);
    Pool pool = pool_open(settings, samples, first_slot, slot_count, first_sample, sample_count);
    PoolStats counted = {0, 0, splat_uint(0u)};
    if (pool.base < slot_count) whitted_trace(&scene, &pool, &counted, records);
    stats[get_global_id(0)] = (uint4)(counted.rays, counted.shadow_rays, lane_largest_uint(counted.deepest), 0u);
}
