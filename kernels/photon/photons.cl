// Entry point of the photons' way through the scene.
#define SHARED_TIME              // with the paths from the camera
#include "photon/trace.h"

// As many as keep the lanes full. With one lane there is nothing to fill, and a driver that lets work-items run side by side may allow a
// loop only so many rounds.
#define PHOTONS_PER_ITEM (LANES == 1 ? 1u : LANES * 16u)

// bounds: centre and radius of a sphere about the scene. deposits: float [photon_count][8][12]; deposit_counts: uint [photon_count], how
// many there were, also of those not kept; ray_counts: uint a work-item.
__kernel GROUPED void photon_pass(SCENE_PARAMETERS float4 bounds, uint pass, uint photon_count, __global float* restrict deposits,
                                  __global uint* restrict deposit_counts, __global uint* restrict ray_counts) {
    SCENE_COLLECT(scene);
    const uint first = (uint)get_global_id(0) * PHOTONS_PER_ITEM, last = min(photon_count, first + PHOTONS_PER_ITEM);
    scene_at_pass(&scene, pass);
    ray_counts[get_global_id(0)] = first < last ? photon_trace(&scene, bounds, pass, first, last, deposits, deposit_counts) : 0u;
}
