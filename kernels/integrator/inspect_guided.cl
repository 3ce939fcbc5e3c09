// Entry point of guided path tracing that writes its paths down: those of integrator_guided, for one pixel.
#define PATH_GUIDED
#define PATH_INSPECTED
#include "integrator/path.h"

// records: as inspect_path in inspect_path.cl.
__kernel GROUPED void inspect_guided_path(SCENE_PARAMETERS uint first_slot, uint slot_count, uint first_sample, uint sample_count,
                                          __global float* restrict samples, __global uint4* restrict stats,
                                          __global const uint* restrict nodes_of_field, __global const uint* restrict cells, float4 frame,
                                          __global uint* restrict records) {
    SCENE_COLLECT(scene);
    SCENE_FIELD(scene, nodes_of_field, cells, frame);
    Pool pool = pool_open(settings, samples, first_slot, slot_count, first_sample, sample_count);
    PoolStats counted = {0, 0, splat_uint(0u)};
    if (pool.base < slot_count) path_trace(&scene, &pool, &counted, records);
    stats[get_global_id(0)] = (uint4)(counted.rays, counted.shadow_rays, lane_largest_uint(counted.deepest), 0u);
}
