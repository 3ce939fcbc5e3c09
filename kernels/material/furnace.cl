// The materials of a scene of triangles, for `clrender furnace`: directions sampled, and directions evaluated, one a lane.
//
// Each goes the way of an integrator: a ray meets a primitive, surface_at, bsdf_at, and then bsdf_sample or bsdf_eval.

// Where materials are mixed, the host chooses: as if the one point were many.
#define PARAMETERS_CHOICE(surface) (surface)->point.x
#include "material/bsdf.h"

// Faults for tests, to show that they are found: factors of what the material says.
#ifndef FURNACE_WEIGHT
#define FURNACE_WEIGHT 1.0f
#endif
#ifndef FURNACE_PDF
#define FURNACE_PDF 1.0f
#endif
#ifndef FURNACE_VALUE
#define FURNACE_VALUE 1.0f
#endif

// A point in a triangle, seen from `wo`.
static Surface furnace_surface(const Scene* scene, uint primitive, vec3 wo, vfloat choice) {
    vfloat row[16];
    lane_rows(scene->primitive_rows, splat_uint(primitive), row);
    // Where no checker of a usual size has an edge; clrender/furnace/surfaces.py moves texture coordinates instead
    const vec3 at = surface_blend(row, splat(0.42f), splat(0.27f), splat(0.31f));
    const Ray ray = ray_make(add(at, wo), negate(wo));
    Hit hit;
    hit.distance = splat(1.0f);
    hit.primitive = splat_uint(primitive);
    Surface s = surface_at(scene, &ray, hit, mask_all());
    s.point.x = choice;      // of a surface's point, nothing else is asked
    return s;
}

static Bsdf furnace_bsdf(const Scene* scene, uint primitive, vec3 wo, vfloat choice) {
    const Surface s = furnace_surface(scene, primitive, wo, choice);
    Bsdf bsdf;
    bsdf_at(scene, &s, negate(wo), &bsdf);
    return bsdf;
}

#ifdef MATERIALS
// The row of the material that each choice among mixed ones meets. choices: float [count]. rows: uint [count].
__kernel void furnace_choose(SCENE_PARAMETERS __global const float* choices, uint primitive, uint count, __global uint* rows) {
    SCENE_COLLECT(scene);
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    const vec3 above = vec3_of(splat(0.0f), splat(0.0f), splat(1.0f));
    const Surface s = furnace_surface(&scene, primitive, above, lane_load(choices + at));
    vuint row = vfloat_bits(s.color.x);
    vfloat first[16];
    lane_rows(scene.material_rows, row * 2u, first);
    parameters_unmix(&scene, &s, s.kind == MATERIAL_BY_ROW, &row, first);
    lane_save(row, rows + at);
}
#endif

// choices: float [count]. bits: uint [2][count]. results: float [11][count]: direction, weight and density of a sample; f |cosθ| and density that
// bsdf_eval gives the same direction.
__kernel void furnace_sample(SCENE_PARAMETERS __global const float* choices, __global const float* bits, uint primitive,
                             float4 wo, uint count, __global float* results) {
    SCENE_COLLECT(scene);
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    const Bsdf bsdf = furnace_bsdf(&scene, primitive, vec3_from(wo), lane_load(choices + at));
    const BsdfSample s = bsdf_sample(&bsdf, vfloat_bits(lane_load(bits + at)), vfloat_bits(lane_load(bits + count + at)));
    vfloat pdf;
    const vec3 f = scale(bsdf_eval(&bsdf, s.direction, &pdf), splat(FURNACE_VALUE));
    const vec3 weight = scale(s.weight, splat(FURNACE_WEIGHT));
    const vfloat out[11] = {s.direction.x, s.direction.y,       s.direction.z, weight.x, weight.y, weight.z,
                            s.pdf * FURNACE_PDF, f.x,           f.y,           f.z,      pdf * FURNACE_PDF};
    for (int k = 0; k < 11; ++k) lane_save(out[k], results + (size_t)k * count + at);
}

// choices: float [count]. directions: float [6][count], wo and wi. results: float [4][count]: f |cosθ| of wi, and its density.
__kernel void furnace_eval(SCENE_PARAMETERS __global const float* choices, __global const float* directions, uint primitive,
                           uint count, __global float* results) {
    SCENE_COLLECT(scene);
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    vfloat in[6];
    for (int k = 0; k < 6; ++k) in[k] = lane_load(directions + (size_t)k * count + at);
    const Bsdf bsdf = furnace_bsdf(&scene, primitive, vec3_of(in[0], in[1], in[2]), lane_load(choices + at));
    vfloat pdf;
    const vec3 f = scale(bsdf_eval(&bsdf, vec3_of(in[3], in[4], in[5]), &pdf), splat(FURNACE_VALUE));
    const vfloat out[4] = {f.x, f.y, f.z, pdf * FURNACE_PDF};
    for (int k = 0; k < 4; ++k) lane_save(out[k], results + (size_t)k * count + at);
}
