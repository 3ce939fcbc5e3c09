// Stage of rays: the nearest opaque surface of each. Where nothing is masked, it is also the end of its way (staged/arrive.h).
#include "staged/arrive.h"

__kernel GROUPED void stage_extend(STAGE_PARAMETERS) {
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
        Search ahead;
        state_get_path(s, &path);
        stage_look(&scene, &path);
        path_free(&scene, &path, &free);
        find_start(&scene, &ahead, 0, &path.ray, path.sample.sampler, path.depth, path.depth == 0u, path_traces(&path));
        find_finish_opaque(&scene, &ahead, hit);
        path_take_again(&path, as_uint(hit[0].distance));
#ifdef OPACITY
        state_put_hit(s, hit);
#else
        kind = arrive(&scene, s, &path, &free, hit);
#endif
    }
#ifndef OPACITY
    queue_append_kind(&queues, of_group, number, kind, number != NONE);
#endif
}
