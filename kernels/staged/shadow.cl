// Stage of shadow rays: what of the light samples arrives.
#include "staged/stage.h"

__kernel GROUPED void stage_shadow(STAGE_PARAMETERS) {
    SCENE_COLLECT(scene);
    const Queues queues = stage_queues(counters, queued, capacity);
    const uint number = queue_path(&queues, COUNT_SHADOWS, (uint)get_global_id(0));
    if (get_global_id(0) == 0) counters[COUNT_ACTIVE] = 0u;
    if (number == NONE) return;
    const State s = state_of(state, number);
    ShadowRay shadow;
    Shadows shadows;
    state_get_shadow(s, &shadow);
    shadow_start(&scene, &shadows, 0, &shadow, mask_all());
    shadow_finish(&scene, &shadows);
    vec3 arriving = state_get_vec3(s, STATE_ARRIVING_WORD);
    if (shadow_arrives(&shadows, 0, &arriving)) state_put_vec3(s, STATE_PATH_WORD, add(state_get_vec3(s, STATE_PATH_WORD), arriving));
}
