// Where paths have arrived.
#ifndef INTEGRATOR_VERTEX_H
#define INTEGRATOR_VERTEX_H

#include "geometry/surface.h"
#include "material/bsdf.h"
#include "material/interior.h"

#ifdef PATH_GUIDED
// What the guiding field knows of a vertex (guiding/guide.h), and what it was like before its event.
typedef struct {
    vmask asked;             // it is one that may be guided
    vuint place, cell;       // its cell's place in the field's nodes, and its number, or 0
    vfloat share;            // of the directions that are drawn from the cell's histogram
    vmask chosen;            // the direction is drawn from it
    vfloat light;            // probability that light samples are taken
    vfloat reflected;        // luminance that later events will bring, relative to the albedo; 0: not known
    vfloat albedo;           // luminance
    vec3 throughput;
    vfloat index_squared;
    vuint event;
    vfloat bsdf_pdf;         // of the direction that the path goes on in
#ifdef PATH_RECORDED
    vec3 before;             // radiance that the path had found
#endif
} Guide;
#endif

// Those of a packet.
typedef struct {
    Surface surface;
    Bsdf bsdf;
#ifdef BSDF_APART
    Bsdf each[3];            // of rough glass that disperses light, at each wavelength
#endif
    Crossing crossing;       // what the surface is to the path's list of dielectrics
    vmask traced;            // the path's ray came here for the first time
    vmask found;             // and met something; else it has left the scene
    vmask scatters;          // the path may go on from it
    vmask dark;              // no light sample could arrive
    vmask samples_lights;    // here: not from deltas alone, nor in the dark
#ifdef PATH_GUIDED
    Guide guide;
#endif
} Vertex;

#endif
