// Stage of shadow rays among masked surfaces: what they leave of the light samples that nothing opaque stops.
#include "staged/stage.h"

__kernel GROUPED void stage_masked_shadow(STAGE_PARAMETERS) {
#ifdef OPACITY
    SCENE_COLLECT(scene);
    const Queues queues = stage_queues(counters, queued, capacity);
    const uint number = queue_path(&queues, COUNT_SHADOWS, (uint)get_global_id(0));
    if (number == NONE) return;
    const State s = state_of(state, number);
    ShadowRay shadow;
    Shadows shadows;
    state_get_shadow(s, &shadow);
    stage_look_of(&scene, s);
    shadow_start_masked(&scene, &shadows, 0, &shadow, largest(state_get_vec3(s, STATE_ARRIVING_WORD)) > 0.0f);
    shadow_finish_masked(&scene, &shadows);
    state_add_arriving(s, &shadows);
#endif
}
