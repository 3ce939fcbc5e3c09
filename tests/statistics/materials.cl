// Rough materials for tests, one direction a lane. The surface is a plane whose normal is z, so that world and local are the same.
#define ROUGH_MATERIALS
#include "material/bsdf.h"

static Bsdf material_bsdf(__global const float* material_rows, __global const float* ggx_albedo, uint kind, float4 color, vec3 wo) {
    Scene scene;
    scene.material_rows = material_rows;
    scene.ggx_albedo = ggx_albedo;
    Surface s;
    s.normal = s.shading = vec3_of(splat(0.0f), splat(0.0f), splat(1.0f));
    s.front = mask_all();
    s.color = vec3_from(color);
    s.ior = vfloat_from_bits(splat_uint(0u));
    s.kind = splat_uint(kind);
    return bsdf_at(&scene, &s, negate(wo));
}

// bits: uint [2][count]. results: float [7][count]: direction, weight and density of a sample.
__kernel void material_sample(__global const float* bits, __global const float* material_rows, __global const float* ggx_albedo,
                              uint kind, float4 color, float4 wo, uint count, __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    const Bsdf bsdf = material_bsdf(material_rows, ggx_albedo, kind, color, vec3_from(wo));
    const BsdfSample s = bsdf_sample(&bsdf, vfloat_bits(lane_load(bits + at)), vfloat_bits(lane_load(bits + count + at)));
    const vfloat out[7] = {s.direction.x, s.direction.y, s.direction.z, s.weight.x, s.weight.y, s.weight.z, s.pdf};
    for (int k = 0; k < 7; ++k) lane_save(out[k], results + (size_t)k * count + at);
}

// directions: float [6][count], wo and wi. results: float [4][count]: f |cosθ| and the density of wi.
__kernel void material_eval(__global const float* directions, __global const float* material_rows, __global const float* ggx_albedo,
                            uint kind, float4 color, uint count, __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    vfloat in[6];
    for (int k = 0; k < 6; ++k) in[k] = lane_load(directions + (size_t)k * count + at);
    const Bsdf bsdf = material_bsdf(material_rows, ggx_albedo, kind, color, vec3_of(in[0], in[1], in[2]));
    vfloat pdf;
    const vec3 f = bsdf_eval(&bsdf, vec3_of(in[3], in[4], in[5]), &pdf);
    const vfloat out[4] = {f.x, f.y, f.z, pdf};
    for (int k = 0; k < 4; ++k) lane_save(out[k], results + (size_t)k * count + at);
}
