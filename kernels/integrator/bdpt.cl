// Entry point of bidirectional path tracing, for one sample of each pixel: its light paths are ready.
#undef TERMINATOR_OFFSET         // as in bidirectional/light_paths.cl
#include "integrator/bdpt.h"

// samples and stats: as integrator_path in path.cl. vertices, counts: of `kept` light paths, as bidirectional/light_paths.cl writes them.
__kernel GROUPED void integrator_bdpt(SCENE_PARAMETERS uint first_slot, uint slot_count, uint first_sample, uint sample_count,
                                      __global float* restrict samples, __global uint4* restrict stats,
                                      __global const float* restrict vertices, __global const uint* restrict counts, uint kept) {
    SCENE_COLLECT(scene);
    Pool pool = pool_open(settings, samples, first_slot, slot_count, first_sample, sample_count);
    PoolStats counted = {0, 0, splat_uint(0u)};
    const LightVertices light = {vertices, counts, kept, first_sample};
    if (pool.base < slot_count) bdpt_trace(&scene, &light, &pool, &counted);
    stats[get_global_id(0)] = (uint4)(counted.rays, counted.shadow_rays, lane_largest_uint(counted.deepest), 0u);
}
