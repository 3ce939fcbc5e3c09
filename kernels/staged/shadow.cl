// Stage of shadow rays: what of the light samples arrives; where surfaces may be masked, only what nothing opaque stops.
#include "staged/stage.h"

__kernel GROUPED void stage_shadow(STAGE_PARAMETERS) {
    SCENE_COLLECT(scene);
    const Queues queues = stage_queues(counters, queued, capacity);
    const uint number = queue_path(&queues, COUNT_SHADOWS, (uint)get_global_id(0));
    if (get_global_id(0) == 0) counters[COUNT_ACTIVE] = 0u;
    if (number == NONE) return;
    const State s = state_of(state, number);
    ShadowRay shadow;
    state_get_shadow(s, &shadow);
    stage_look_of(&scene, s);
#ifdef OPACITY
    if (shadows_pass(&scene)) return;  // such rays pass both kinds of surfaces
    Passage passage;
    passage_start(&scene, &passage, 0, &shadow.ray, mask_all());
    passage_finish_opaque(&scene, &passage);
    if (passage_left(&passage, 0) == 0.0f) state_put_vec3(s, STATE_ARRIVING_WORD, vec3_all(0.0f));
#else
    Shadows shadows;
    shadow_start(&scene, &shadows, 0, &shadow, mask_all());
    shadow_finish(&scene, &shadows);
    state_add_arriving(s, &shadows);
#endif
}
