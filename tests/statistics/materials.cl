// Materials for tests, one direction a lane. The surface is a plane whose normal is z, so that world and local are the same.
#define MATERIALS
#include "material/bsdf.h"

// The material is that of the first rows. `ior`: of it. `front`: seen from the front.
static Bsdf material_bsdf(__global const float* material_rows, __global const float* albedo_tables, __global const float* measured_rows,
                          __global const float* measured_words, float ior, uint front, vec3 wo) {
    Scene scene;
    scene.material_rows = material_rows;
    scene.albedo_tables = albedo_tables;
    scene.measured_rows = measured_rows, scene.measured_words = measured_words;
    Surface s;
    s.point = vec3_all(0.0f);
    s.front = front ? mask_all() : mask_none();
    s.normal = s.shading = vec3_of(splat(0.0f), splat(0.0f), splat(front ? 1.0f : -1.0f));
    s.color = vec3_all(0.0f);
    s.ior = splat(ior);
    s.kind = splat_uint(MATERIAL_BY_ROW);
    Bsdf bsdf;
    bsdf_at(&scene, &s, negate(wo), &bsdf);
    return bsdf;
}

// bits: uint [2][count]. results: float [8][count]: direction, weight and density of a sample, and what of the weight is due to eta.
__kernel void material_sample(__global const float* bits, __global const float* material_rows, __global const float* albedo_tables,
                              __global const float* measured_rows, __global const float* measured_words, float ior, uint front, float4 wo, uint count, __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    const Bsdf bsdf = material_bsdf(material_rows, albedo_tables, measured_rows, measured_words, ior, front, vec3_from(wo));
    const BsdfSample s = bsdf_sample(&bsdf, vfloat_bits(lane_load(bits + at)), vfloat_bits(lane_load(bits + count + at)));
    const vfloat squeezed = splat(1.0f) / bsdf_index_squared(&bsdf, s.direction);
    const vfloat out[8] = {s.direction.x, s.direction.y, s.direction.z, s.weight.x, s.weight.y, s.weight.z, s.pdf, squeezed};
    for (int k = 0; k < 8; ++k) lane_save(out[k], results + (size_t)k * count + at);
}

// directions: float [6][count], wo and wi. results: float [7][count]: f |cosθ|, the density of wi, and the albedo of wo.
__kernel void material_eval(__global const float* directions, __global const float* material_rows, __global const float* albedo_tables,
                            __global const float* measured_rows, __global const float* measured_words, float ior, uint front, uint count, __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    vfloat in[6];
    for (int k = 0; k < 6; ++k) in[k] = lane_load(directions + (size_t)k * count + at);
    const Bsdf bsdf = material_bsdf(material_rows, albedo_tables, measured_rows, measured_words, ior, front, vec3_of(in[0], in[1], in[2]));
    vfloat pdf;
    const vec3 f = bsdf_eval(&bsdf, vec3_of(in[3], in[4], in[5]), &pdf), albedo = bsdf_albedo(&bsdf);
    const vfloat out[7] = {f.x, f.y, f.z, pdf, albedo.x, albedo.y, albedo.z};
    for (int k = 0; k < 7; ++k) lane_save(out[k], results + (size_t)k * count + at);
}

// facets: float [3][count]. results: float [2][count]: D and G1 of GGX, or of Beckmann's distribution.
__kernel void material_facets(__global const float* facets, float4 alpha, uint beckmann, uint count, __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    const vec3 m = vec3_of(lane_load(facets + at), lane_load(facets + count + at), lane_load(facets + 2 * count + at));
    Alpha a;
    a.x = splat(alpha.x), a.y = splat(alpha.y);
    const vfloat lambda = beckmann ? beckmann_lambda(a, m) : ggx_lambda(a, m);
    lane_save(beckmann ? beckmann_distribution(a, m) : ggx_distribution(a, m), results + at);
    lane_save(splat(1.0f) / (splat(1.0f) + lambda), results + count + at);
}
