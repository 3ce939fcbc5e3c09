// Path tracing in stages: every kernel takes one step of path.h for many paths (Laine, Karras and Aila, "Megakernels considered harmful:
// wavefront path tracing on GPUs", 2013). The samples are those of integrator/path.cl, bit for bit, because the steps are the same functions.
//
//     kernel                of which paths   does                                                   fills
//     stage_begin           all              deliver paths that ended, start others in their place  the queue of paths to extend
//     stage_extend          that queue       find where rays meet opaque surfaces                   a queue for each kind of vertex
//     stage_masked          that queue       find masked surfaces before those                      in its place, where there are any
//     stage_light           those queues     emission, light samples                                the queue of shadow rays
//     stage_scatter         those queues     sample the BSDF, roulette                              –
//     stage_shadow          that queue       trace the shadow rays, add what arrives                –
//     stage_masked_shadow   that queue       the same among masked surfaces, where there are any    –
//
// The host clears counters and flags, launches stage_begin, and then rounds of all others and stage_begin, until no path is active and no sample is
// left. A kernel is launched for as many work-items as there are paths at most; those behind the end of its queue do nothing.
//
// Built with one lane only: for GPUs, where a kernel of one step takes fewer registers than one of all, and where paths that are shaded side by side
// have met the same kind of surface.
#ifndef STAGED_STAGE_H
#define STAGED_STAGE_H

#include "staged/queue.h"
#include "staged/state.h"

// samples, stats: as in integrator/path.cl, but stats has a row for each path. state: STATE_WORDS words for each path.
#define STAGE_PARAMETERS                                                                                                    \
    SCENE_PARAMETERS uint first_slot, uint slot_count, uint first_sample, uint sample_count, __global float *restrict samples, \
        __global uint4 *restrict stats, __global uint *restrict state, __global uint *restrict queued, __global uint *restrict counters,   \
        uint capacity

static Queues stage_queues(__global uint* counters, __global uint* queued, uint capacity) {
    Queues q;
    q.counters = counters;
    q.paths = queued;
    q.capacity = capacity;
    return q;
}

// Read the scene at a path's wavelengths; and at those of one that only stands in global memory.
static void stage_look(Scene* scene, const Path* path) {
    scene_at_wavelengths(scene, split_first_sampler(&path->split, path->sample.sampler), splat_uint(0u));
    path_choose_wavelength(scene, path);
}
static void stage_look_of(Scene* scene, State s) {
#ifdef SPECTRAL
    Path path;
    state_get_path(s, &path);
    stage_look(scene, &path);
#endif
}

// Add to what a path has counted.
static void stage_count(__global uint4* stats, uint path, PoolStats counted) {
    const uint4 before = stats[path];
    stats[path] = (uint4)(before.x + counted.rays, before.y + counted.shadow_rays, max(before.z, counted.deepest), 0u);
}

#endif
