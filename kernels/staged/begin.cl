// Stage of paths that ended: they are delivered, and others take their places.
#include "staged/stage.h"

// Start a path with sample number `index` of the launch: of one pixel after the other, so that neighbours begin together.
static void begin_sample(const Scene* scene, Pool* pool, uint whole_divisor, uint index, Path* path) {
    const uint number = index / whole_divisor;
    CameraRays waiting = camera_rays_none();
    pool->base = index - number * whole_divisor;
    pool->end = pool->base + 1u;
    pool->block = slot_block(scene->settings, pool->first_slot + pool->base);
    pool->next = number;
    path_camera_rays(scene, pool, &waiting);
    path_start(scene, &waiting, path, mask_all());
}

// sizes: words of a path, queues, counters, paths in a block.
__kernel GROUPED void stage_sizes(__global uint* sizes) {
    if (get_global_id(0) != 0) return;
    sizes[0] = STATE_WORDS;
    sizes[1] = QUEUES;
    sizes[2] = COUNTERS;
    sizes[3] = STATE_BLOCK;
}

__kernel GROUPED void stage_begin(STAGE_PARAMETERS) {
    SCENE_COLLECT(scene);
    __local uint starts, goes_on;
    const Queues queues = stage_queues(counters, queued, capacity);
    const uint number = (uint)get_global_id(0), total = slot_count * sample_count;
    const State s = state_of(state, number);
    const uint flags = number < capacity ? state_load(s + STATE_FLAGS) : 0u;
    vmask alive = (flags & STATE_ALIVE) != 0u;
    Pool pool = pool_open_at(settings, samples, first_slot, slot_count, first_sample, sample_count, 0u);
    Path path;
    if ((flags & STATE_ASKS) != 0u) {
        state_get_path(s, &path);
        stage_look(&scene, &path);
        path_deliver(&scene, &pool, &path);
        path.ended = mask_none();
        alive = path.alive;
        state_put_path(s, &path);
    }
    const int asks = number < capacity && !alive;
    const uint index = queue_take(counters + COUNT_SAMPLES, total, &starts, asks);
    if (asks && index < total) {
        path = path_none();
        begin_sample(&scene, &pool, slot_count, index, &path);
        alive = path.alive;
        state_put_path(s, &path);
    }
    queue_append(&queues, COUNT_ACTIVE, &goes_on, number, alive);
    if (number < VERTEX_KINDS) counters[COUNT_KINDS + number] = 0u;
    if (number == 0u) counters[COUNT_SHADOWS] = 0u;
}
