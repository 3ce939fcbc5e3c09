// Entry points of training, launched one after the other.
#define PATH_GUIDED
#define PATH_RECORDED
#include "integrator/path.h"

// samples and stats: as integrator_path in path.cl; field: kernels/guiding/field.h; sums and counts: training.h. `records` are of this launch alone.
#define TRAINING_PARAMETERS                                                                                                 \
    SCENE_PARAMETERS uint first_slot, uint slot_count, uint first_sample, uint sample_count, __global float *samples,       \
        __global uint4 *stats, __global const uint *nodes_of_field, __global const uint *cells, float4 frame,               \
        volatile __global uint *sums, volatile __global uint *counts, float scale_of, __global uint *records

__kernel GROUPED void training_clear(TRAINING_PARAMETERS) {
    const Pool pool = pool_open(settings, samples, first_slot, slot_count, first_sample, sample_count);
    for (uint number = 0; number < sample_count; ++number)
        for (uint slot = pool.base; slot < pool.end; ++slot)
            for (uint event = 0; event < RECORD_EVENTS; ++event)
                records[training_records(&pool, slot, number) + event * RECORD_WORDS + RECORD_ROW_PLACE] = NONE;
}

__kernel GROUPED void training_trace(TRAINING_PARAMETERS) {
    SCENE_COLLECT(scene);
    SCENE_FIELD(scene, nodes_of_field, cells, frame);
    Pool pool = pool_open(settings, samples, first_slot, slot_count, first_sample, sample_count);
    PoolStats counted = {0, 0, splat_uint(0u)};
    if (pool.base < slot_count) path_trace(&scene, &pool, &counted, records);
    stats[get_global_id(0)] = (uint4)(counted.rays, counted.shadow_rays, lane_largest_uint(counted.deepest), 0u);
}

__kernel GROUPED void training_add_all(TRAINING_PARAMETERS) {
    const Field field = {nodes_of_field, cells, frame};
    const Pool pool = pool_open(settings, samples, first_slot, slot_count, first_sample, sample_count);
    for (uint number = 0; number < sample_count; ++number)
        for (uint slot = pool.base; slot < pool.end; ++slot) {
            __global const float* found = samples + (size_t)number * 3 * slot_count + slot;
            __global const uint* row = records + training_records(&pool, slot, number);
            for (uint event = 0; event < RECORD_EVENTS; ++event, row += RECORD_WORDS)
                if (row[RECORD_ROW_PLACE] != NONE)
                    training_sum(&field, row, found[0], found[slot_count], found[2 * slot_count], scale_of, sums, counts);
        }
}
