// What a path carries while its events are written down: integrator/inspect.h.
#ifndef INTEGRATOR_INSPECTED_H
#define INTEGRATOR_INSPECTED_H

#include "core/lane.h"
#include "types.h"

#if LANES != 1 || PACKETS != 1
#error "paths are written down one by one: build with -D LANES=1 -D PACKETS=1"
#endif

// A path has rows of its own, found by the number of its sample in the launch: only one pixel is asked for.
typedef struct {
    __global uint* records;      // of the launch: [sample][INSPECT_ROWS][INSPECT_WORDS]
    __global uint* rows;         // of this sample
    __global uint* vertex;       // row of the vertex that the path is at, and of its last light sample; 0: there was no row left
    __global uint* light_sample;
    uint used, additions;        // rows so far, and additions to the radiance
    uint light;                  // chosen for the next light sample, with this probability
    float choice;
#ifdef PATH_BIDIRECTIONAL
    __global uint* join;         // row of the vertex's connection with a light path
    uint joined, joined_depth;   // number of that light path, and events before its vertex
    int straight;                // the vertex is no boundary
    float bsdf_pdf;              // density of the direction in which the last other one was left, per steradian
#endif
    vec3 rest;                   // radiance that was added without a row
} Inspection;

static Inspection inspection_of(__global uint* records) {
    Inspection i;
    i.records = i.rows = records;
    i.vertex = i.light_sample = 0;
    i.used = i.additions = i.light = 0u;
    i.choice = 0.0f;
#ifdef PATH_BIDIRECTIONAL
    i.join = 0;
    i.joined = i.joined_depth = 0u;
    i.straight = 0;
    i.bsdf_pdf = 0.0f;
#endif
    i.rest = vec3_all(0.0f);
    return i;
}

// A sample begins. Its head says that it is not complete yet.
static void inspection_begin(Inspection* i, uint number) {
    *i = inspection_of(i->records);
    i->rows = i->records + (size_t)number * (INSPECT_ROWS * INSPECT_WORDS);
    i->used = 1u;
    for (uint k = 0; k < INSPECT_WORDS; ++k) i->rows[k] = 0u;
}

#endif
