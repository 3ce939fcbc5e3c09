// Queues of paths in global memory. The work-items of a group take their places together, so that one atomic operation serves all of them. The
// order of a queue differs from run to run, and no result depends on it.
#ifndef STAGED_QUEUE_H
#define STAGED_QUEUE_H

#include "integrator/vertex_kind.h"

// Counters: samples that were handed out, paths to extend, shadow rays, and paths to shade by kind of vertex (integrator/vertex_kind.h).
#define COUNT_SAMPLES 0u
#define COUNT_ACTIVE 1u
#define COUNT_SHADOWS 2u
#define COUNT_KINDS 3u
#define COUNTERS (COUNT_KINDS + VERTEX_KINDS)
#define QUEUES (COUNTERS - COUNT_ACTIVE)

typedef struct {
    __global uint* counters;
    __global uint* paths;        // places for `capacity` paths in each queue: those to extend, shadow rays, then each kind
    uint capacity;
} Queues;

// Functions with barriers are inlined: in others some CPU drivers lose what a work-item knew before.
#define WITH_BARRIERS __attribute__((always_inline)) static

// The place behind a counter of a work-item that wants one, or a number from `end` on if there is none; all of the group have to ask.
WITH_BARRIERS uint queue_take(__global uint* counter, uint end, __local uint* of_group, int wants) {
    if (get_local_id(0) == 0) *of_group = 0u;
    barrier(CLK_LOCAL_MEM_FENCE);
    const uint place = wants ? atomic_inc(of_group) : 0u;
    barrier(CLK_LOCAL_MEM_FENCE);
    if (get_local_id(0) == 0) *of_group = atomic_max(counter, 0u) < end ? atomic_add(counter, *of_group) : end;
    barrier(CLK_LOCAL_MEM_FENCE);
    return *of_group + place;
}

// Append the path to one of the first two queues.
WITH_BARRIERS void queue_append(const Queues* q, uint counter, __local uint* of_group, uint path, int wants) {
    const uint place = queue_take(q->counters + counter, NONE, of_group, wants);
    if (wants) q->paths[(size_t)(counter - COUNT_ACTIVE) * q->capacity + place] = path;
}

// Append the path to the queue of its kind of vertex.
WITH_BARRIERS void queue_append_kind(const Queues* q, __local uint* of_group, uint path, uint kind, int wants) {
    const uint item = (uint)get_local_id(0), items = (uint)get_local_size(0);
    for (uint k = item; k < VERTEX_KINDS; k += items) of_group[k] = 0u;
    barrier(CLK_LOCAL_MEM_FENCE);
    const uint place = wants ? atomic_inc(of_group + kind) : 0u;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (uint k = item; k < VERTEX_KINDS; k += items) of_group[k] = of_group[k] ? atomic_add(q->counters + COUNT_KINDS + k, of_group[k]) : 0u;
    barrier(CLK_LOCAL_MEM_FENCE);
    if (wants) q->paths[(size_t)(COUNT_KINDS - COUNT_ACTIVE + kind) * q->capacity + of_group[kind] + place] = path;
}

// The path at a place of one of the first two queues; NONE behind its end.
static uint queue_path(const Queues* q, uint counter, uint place) {
    return place < q->counters[counter] ? q->paths[(size_t)(counter - COUNT_ACTIVE) * q->capacity + place] : NONE;
}

// The path at a place of the queues of all kinds, one behind the other.
static uint queue_path_of_kinds(const Queues* q, uint place) {
    for (uint k = 0; k < VERTEX_KINDS; ++k) {
        const uint count = q->counters[COUNT_KINDS + k];
        if (place < count) return q->paths[(size_t)(COUNT_KINDS - COUNT_ACTIVE + k) * q->capacity + place];
        place -= count;
    }
    return NONE;
}

#endif
