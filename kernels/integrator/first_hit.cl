// Entry point of the layers that are seen first.
#include "integrator/first_hit.h"

// samples: float [sample_count][3][slot_count], what `wanted` (FIRST_HIT_*) asks for. stats: as integrator_path in path.cl.
// coordinates: attribute rows (ATTRIBUTE_ROW_*) of every primitive, also of those without textures; read where it asks for what
// they hold, else of any length.
__kernel GROUPED void integrator_first_hit(SCENE_PARAMETERS uint first_slot, uint slot_count, uint first_sample, uint sample_count,
                                           __global float* restrict samples, __global uint4* restrict stats, uint wanted,
                                           __global const float* restrict coordinates) {
    SCENE_COLLECT(scene);
    Pool pool = pool_open(settings, samples, first_slot, slot_count, first_sample, sample_count);
    PoolStats counted = {0, 0, splat_uint(0u)};
    if (pool.base < slot_count) first_hit_trace(&scene, &pool, &counted, wanted, coordinates);
    stats[get_global_id(0)] = (uint4)(counted.rays, counted.shadow_rays, lane_largest_uint(counted.deepest), 0u);
}
