// Stage of rays among masked surfaces: those that are there before the nearest opaque one, and the end of the way (staged/arrive.h).
#include "staged/arrive.h"

__kernel GROUPED void stage_masked(STAGE_PARAMETERS) {
    SCENE_COLLECT(scene);
    __local uint of_group[VERTEX_KINDS];
    const Queues queues = stage_queues(counters, queued, capacity);
    const uint number = queue_path(&queues, COUNT_ACTIVE, (uint)get_global_id(0));
    uint kind = 0u;
    if (number != NONE) {
        const State s = state_of(state, number);
        Path path;
        FreePath free;
        Hit hit[PACKETS];
        state_get_path(s, &path);
        state_get_hit(s, hit);
#ifdef OPACITY
        Search ahead;
        find_start_masked(&ahead, 0, &path.ray, path.sample.sampler, path.depth, path.depth == 0u, hit[0].distance, path_traces(&path));
        find_finish_masked(&scene, &ahead, hit);
        path_take_again(&path, as_uint(hit[0].distance));
#endif
        stage_look(&scene, &path);
        path_free(&scene, &path, &free);
        kind = arrive(&scene, s, &path, &free, hit);
    }
    queue_append_kind(&queues, of_group, number, kind, number != NONE);
}
