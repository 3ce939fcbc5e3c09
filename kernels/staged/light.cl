// Stage of light at vertices: the emission that is met there, and a sample of the lights.
#include "staged/stage.h"

// Returns whether the path asks for a shadow ray.
static int light_vertex(Scene* scene, State s, PoolStats* counted) {
    // Arrays, as in path_trace: rusticl's compiler (Mesa 22.3) crashes over an index into what is none
    Path path[PACKETS];
    Vertex vertex[PACKETS];
    Hit hit;
    Direct direct;
    PoolStats by_scatter = {0, 0, splat_uint(0u)};
    state_get_path(s, path);
    state_get_hit(s, &hit);
    stage_look(scene, path);
    path_vertex(scene, path, hit, &by_scatter, vertex);
    path_add_emission(scene, path, vertex);
    path_add_sun(scene, path, vertex);
    state_put_radiance(s, path);
    path_sample_direct(scene, path, vertex, &direct, counted);
#if defined(SPECULAR_CHAINS) || defined(SEVERAL_SHADOW_RAYS)
    chains_add(scene, path, vertex, counted);
    state_put_radiance(s, path);
#endif
#ifdef SEVERAL_SHADOW_RAYS
    return 0;
#else
    if (!path_asks(&direct, 0)) return 0;
    state_put_arriving(s, &direct);
    return 1;
#endif
}

__kernel GROUPED void stage_light(STAGE_PARAMETERS) {
    SCENE_COLLECT(scene);
    __local uint of_group;
    const Queues queues = stage_queues(counters, queued, capacity);
    const uint number = queue_path_of_kinds(&queues, (uint)get_global_id(0));
    int asks = 0;
    if (number != NONE) {
        const State s = state_of(state, number);
        PoolStats counted = {0, 0, splat_uint(0u)};
        asks = light_vertex(&scene, s, &counted);
        if (counted.rays | counted.shadow_rays) stage_count(stats, number, counted);
    }
    queue_append(&queues, COUNT_SHADOWS, &of_group, number, asks);
}
