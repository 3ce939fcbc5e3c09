// Entry point of the paths from the lights, for one sample of all pixels.
#undef TERMINATOR_OFFSET         // it moves light from a surface and not to it: a path would depend on the way it is made
#define PASSAGE_TO_CAMERA        // where the only shadow rays of this program go
#define PATH_BIDIRECTIONAL
#define SHARED_TIME              // with the paths from the camera
#include "bidirectional/light_path.h"

// As many as keep the lanes full. With one lane there is nothing to fill, and a driver that lets work-items run side by side may allow a
// loop only so many rounds.
#define LIGHT_PATHS_PER_ITEM (LANES == 1 ? 1u : LANES * 16u)

#ifdef SPLATS_LISTED
#define LISTED_PARAMETERS , __global uint* listed, uint most_listed
#define LISTED_COLLECT(splats) (splats).listed = listed, (splats).most = most_listed
#else
#define LISTED_PARAMETERS
#define LISTED_COLLECT(splats)
#endif

// Paths [first, last) of sample `pass`; splats into slots [first_slot, first_slot + slot_count), uint [slot][3][4]. vertices: float
// [most][8][16]; counts: uint [most], vertices to join with, also of those not kept. ray_counts: uint a work-item. listed: of film/splat.h.
__kernel GROUPED void light_paths(SCENE_PARAMETERS uint pass, uint first, uint last, uint first_slot, uint slot_count, __global uint* splat_sums,
                                  __global float* restrict vertices, __global uint* restrict counts, uint most, __global uint* restrict ray_counts LISTED_PARAMETERS) {
    SCENE_COLLECT(scene);
    Splats splats;
    splats.sums = splat_sums;
    splats.first_slot = first_slot;
    splats.slot_count = slot_count;
    LISTED_COLLECT(splats);
    const uint begin = first + (uint)get_global_id(0) * LIGHT_PATHS_PER_ITEM, end = min(last, begin + LIGHT_PATHS_PER_ITEM);
    scene_at_pass(&scene, pass);
    ray_counts[get_global_id(0)] = begin < end ? light_paths_trace(&scene, &splats, pass, begin, end, vertices, counts, most) : 0u;
}
