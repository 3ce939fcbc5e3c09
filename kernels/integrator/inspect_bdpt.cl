// Entry point of bidirectional path tracing that writes its paths down: those of integrator_bdpt, for one pixel, and the light paths that they were
// connected with, or that the camera sees.
#undef TERMINATOR_OFFSET         // as in bdpt.cl
#define PATH_INSPECTED
#ifdef INTERIORS
#define LIGHTS_IN_MEDIA          // as light_paths.cl has it where there are volumes: elsewhere none are found
#endif
#include "integrator/bdpt.h"

// vertices, counts, kept: as integrator_bdpt in bdpt.cl. records: as inspect_path in inspect_path.cl.
__kernel GROUPED void inspect_bdpt(SCENE_PARAMETERS uint first_slot, uint slot_count, uint first_sample, uint sample_count,
                                   __global float* restrict samples, __global uint4* restrict stats, __global const float* restrict vertices,
                                   __global const uint* restrict counts, uint kept, __global uint* restrict records) {
    SCENE_COLLECT(scene);
    Pool pool = pool_open(settings, samples, first_slot, slot_count, first_sample, sample_count);
    PoolStats counted = {0, 0, splat_uint(0u)};
    const LightVertices light = {vertices, counts, kept, first_sample};
    if (pool.base < slot_count) bdpt_trace(&scene, &light, &pool, &counted, records);
    stats[get_global_id(0)] = (uint4)(counted.rays, counted.shadow_rays, lane_largest_uint(counted.deepest), 0u);
}

// The light paths that were splatted, a work-item each: wanted: uint [count][3], the sample of the pixels, the light path, and the scattering events
// before the vertex that the camera sees. records: uint [count][INSPECT_ROWS][INSPECT_WORDS], a head, the start and the vertices of the light path.
__kernel GROUPED void inspect_splats(SCENE_PARAMETERS __global const uint* restrict wanted, uint count, __global uint* restrict records) {
    SCENE_COLLECT(scene);
    const uint at = (uint)get_global_id(0);
    if (at >= count) return;
    Path path;
    path.depth = 0u;
    path.inspection = inspection_of(records);
    inspection_begin(&path.inspection, at);
    scene_at_pass(&scene, wanted[at * 3u]);
    inspect_light_path(&scene, &path, wanted[at * 3u], wanted[at * 3u + 1u], wanted[at * 3u + 2u]);
    path.inspection.rows[INSPECT_SAMPLE_ROW_USED] = path.inspection.used;
}
