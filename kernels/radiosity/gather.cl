// Entry point of the final gather.
#include "radiosity/gather.h"

// samples and stats: as integrator_path in integrator/path.cl. rows and texels: radiosity/gather.h.
__kernel GROUPED void radiosity_gather(SCENE_PARAMETERS uint first_slot, uint slot_count, uint first_sample, uint sample_count,
                               __global float* restrict samples, __global uint4* restrict stats, __global const float* restrict rows,
                               __global const float* restrict texels) {
    SCENE_COLLECT(scene);
    Pool pool = pool_open(settings, samples, first_slot, slot_count, first_sample, sample_count);
    PoolStats counted = {0, 0, splat_uint(0u)};
    const Atlas atlas = {rows, texels};
    if (pool.base < slot_count) gather_trace(&scene, &atlas, &pool, &counted);
    stats[get_global_id(0)] = (uint4)(counted.rays, counted.shadow_rays, lane_largest_uint(counted.deepest), 0u);
}
