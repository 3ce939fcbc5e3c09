// Entry points of path reuse, launched one after the other (integrator/reuse.h).
#include "integrator/reuse.h"

// samples and stats: as integrator_path in path.cl. records: float [sample_count][slot_count][32].
#define REUSE_PARAMETERS                                                                                                    \
    SCENE_PARAMETERS uint first_slot, uint slot_count, uint first_sample, uint sample_count, __global float *samples,       \
        __global uint4 *stats, __global float *records

__kernel GROUPED void integrator_reuse(REUSE_PARAMETERS) {
    SCENE_COLLECT(scene);
    Pool pool = pool_open(settings, samples, first_slot, slot_count, first_sample, sample_count);
    PoolStats counted = {0, 0, splat_uint(0u)};
    if (pool.base < slot_count) reuse_trace(&scene, &pool, records, &counted);
    stats[get_global_id(0)] = (uint4)(counted.rays, counted.shadow_rays, lane_largest_uint(counted.deepest), 0u);
}

__kernel GROUPED void reuse_weigh(REUSE_PARAMETERS) {
    SCENE_COLLECT(scene);
    const Pool pool = pool_open(settings, samples, first_slot, slot_count, first_sample, sample_count);
    PoolStats counted = {0, 0, splat_uint(0u)};
    if (pool.base >= slot_count) return;
    for (uint number = 0; number < sample_count; ++number) reuse_weigh_sample(&scene, &pool, records, number, &counted);
    stats[get_global_id(0)].y += counted.shadow_rays;
}

__kernel GROUPED void reuse_gather(REUSE_PARAMETERS) {
    SCENE_COLLECT(scene);
    const Pool pool = pool_open(settings, samples, first_slot, slot_count, first_sample, sample_count);
    if (pool.base >= slot_count) return;
    for (uint number = 0; number < sample_count; ++number) {
        scene_at_pass(&scene, first_sample + number);
        reuse_gather_sample(&scene, &pool, records, number);
    }
}
