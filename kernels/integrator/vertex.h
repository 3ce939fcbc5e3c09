// Where paths have arrived.
#ifndef INTEGRATOR_VERTEX_H
#define INTEGRATOR_VERTEX_H

#include "geometry/surface.h"
#include "material/bsdf.h"
#include "material/interior.h"

// Those of a packet.
typedef struct {
    Surface surface;
    Bsdf bsdf;
    Crossing crossing;       // what the surface is to the path's list of dielectrics
    vmask traced;            // the path's ray came here for the first time
    vmask found;             // and met something; else it has left the scene
    vmask scatters;          // the path may go on from it
    vmask dark;              // no light sample could arrive
    vmask samples_lights;    // here: not from deltas alone, nor in the dark
} Vertex;

#endif
