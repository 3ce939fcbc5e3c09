// Stage of scattering: where each path goes on from its vertex, and whether it does.
#include "staged/stage.h"

__kernel GROUPED void stage_scatter(STAGE_PARAMETERS) {
    SCENE_COLLECT(scene);
    const Queues queues = stage_queues(counters, queued, capacity);
    const uint number = queue_path_of_kinds(&queues, (uint)get_global_id(0));
    if (number == NONE) return;
    const State s = state_of(state, number);
    Path path;
    Hit hit;
    Vertex vertex;
    PoolStats counted = {0, 0, splat_uint(0u)};
    state_get_path(s, &path);
    state_get_hit(s, &hit);
    stage_look(&scene, &path);
    path_vertex(&scene, &path, hit, &counted, &vertex);
    stage_count(stats, number, counted);
    path_scatter(&scene, &path, &vertex, hit);
    state_put_path(s, &path);
}
