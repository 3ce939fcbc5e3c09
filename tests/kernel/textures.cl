// Textures for tests, one point a lane: the numbers of a material's slot, and of the geometry around it.
#define TEXTURES
#include "texture/normal_map.h"

static Scene textures_scene(__global const float* rows, __global const float* values, __global const uint* a, __global const uint* b,
                            __global const uint* c, __global const uint* d) {
    Scene scene;
    scene.texture_rows = rows;
    scene.texel_values = values;
    scene.texels_0 = a, scene.texels_1 = b, scene.texels_2 = c, scene.texels_3 = d;
    return scene;
}

// A triangle in the plane of z whose texture coordinates are u, v at A, and grow by 1 a metre.
static Attributes textures_point(vfloat u, vfloat v) {
    Attributes a;
    a.textured = mask_all();
    a.sphere = a.disk = mask_none();
    a.ab = vec3_of(splat(1.0f), splat(0.0f), splat(0.0f)), a.ac = vec3_of(splat(0.0f), splat(1.0f), splat(0.0f));
    a.weight_b = a.weight_c = a.radius = splat(0.0f);
    a.out = vec3_all(0.0f);
    a.taps.u = a.taps.v = splat(0.0f), a.taps.random = 0;
    for (int k = 0; k < 16; ++k) a.row[k] = splat(0.0f);
    const vfloat coordinates[12] = {u, v, u + 1.0f, v, u, v + 1.0f, v, u, v, u, v, u};       // set 1: exchanged
    for (int k = 0; k < 12; ++k) a.row[ATTRIBUTE_ROW_UV + k] = coordinates[k];
    return a;
}

// points: float [4][count]: u, v, and two random numbers. results: float [6][count]: the texture's value, and the normal it makes if it
// is a normal map.
__kernel void texture_values(__global const float* points, __global const float* rows, __global const float* values,
                             __global const uint* texels_0, __global const uint* texels_1, __global const uint* texels_2,
                             __global const uint* texels_3, uint texture, uint random, uint count, __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    const Scene scene = textures_scene(rows, values, texels_0, texels_1, texels_2, texels_3);
    Attributes a = textures_point(lane_load(points + at), lane_load(points + count + at));
    a.taps.u = lane_load(points + (size_t)2 * count + at), a.taps.v = lane_load(points + (size_t)3 * count + at);
    a.taps.random = random != 0u;
    const vec3 value = parameter_texture(&scene, &a, splat_uint(texture), mask_all());
    const vec3 up = vec3_of(splat(0.0f), splat(0.0f), splat(1.0f));
    vmask tilted;
    const vec3 normal = normal_map_normal(&scene, &a, splat_uint(texture), mask_all(), up, &tilted);
    const vfloat out[6] = {value.x, value.y, value.z, normal.x, normal.y, normal.z};
    for (int k = 0; k < 6; ++k) lane_save(out[k], results + (size_t)k * count + at);
}

// The same of a bump map: results: float [3][count].
__kernel void texture_bumps(__global const float* points, __global const float* rows, __global const float* values,
                            __global const uint* texels_0, __global const uint* texels_1, __global const uint* texels_2,
                            __global const uint* texels_3, uint texture, uint count, __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    const Scene scene = textures_scene(rows, values, texels_0, texels_1, texels_2, texels_3);
    const Attributes a = textures_point(lane_load(points + at), lane_load(points + count + at));
    const vec3 up = vec3_of(splat(0.0f), splat(0.0f), splat(1.0f));
    vmask tilted = mask_none();
    const vec3 normal = normal_map_bumped(&scene, &a, splat_uint(texture), mask_all(), up, &tilted);
    const vfloat out[3] = {normal.x, normal.y, normal.z};
    for (int k = 0; k < 3; ++k) lane_save(out[k], results + (size_t)k * count + at);
}

// vectors: float [9][count]: a normal, the geometry's and the view. results: float [3][count]: the normal, bent.
__kernel void texture_bent(__global const float* vectors, uint count, __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    vfloat in[9];
    for (int k = 0; k < 9; ++k) in[k] = lane_load(vectors + (size_t)k * count + at);
    const vec3 bent = bent_normal(vec3_of(in[0], in[1], in[2]), vec3_of(in[3], in[4], in[5]), vec3_of(in[6], in[7], in[8]));
    lane_save(bent.x, results + at);
    lane_save(bent.y, results + count + at);
    lane_save(bent.z, results + (size_t)2 * count + at);
}

// directions: float [3][count], unit. results: float [8][count]: texture coordinates of a sphere of radius 2 there, and its tangents.
__kernel void texture_sphere(__global const float* directions, uint count, __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    Attributes a = textures_point(splat(0.0f), splat(0.0f));
    a.sphere = mask_all();
    a.radius = splat(2.0f);
    a.out = vec3_of(lane_load(directions + at), lane_load(directions + count + at), lane_load(directions + (size_t)2 * count + at));
    for (int k = 0; k < 9; ++k) a.row[ATTRIBUTE_ROW_X + k] = splat(k % 4 == 0 ? 1.0f : 0.0f);
    vfloat u, v;
    vec3 along_u, along_v;
    mapping_uv(&a, splat_uint(0u), &u, &v);
    mapping_tangents(&a, splat_uint(0u), &along_u, &along_v);
    const vfloat out[8] = {u, v, along_u.x, along_u.y, along_u.z, along_v.x, along_v.y, along_v.z};
    for (int k = 0; k < 8; ++k) lane_save(out[k], results + (size_t)k * count + at);
}
