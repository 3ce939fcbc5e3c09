// Stage of rays: where each meets the scene, and what that is.
#include "staged/stage.h"

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
        Hit hit;
        state_get_path(s, &path);
        path_find(&scene, &path, &free, &hit);
        path_travel(&scene, &path, &free, &hit);
        state_put_hit(s, &hit);
#ifdef INTERIORS
        state_put_throughput(s, &path);
#endif
        kind = vertex_kind(&scene, path.alive, hit);
    }
    queue_append_kind(&queues, of_group, number, kind, number != NONE);
}
