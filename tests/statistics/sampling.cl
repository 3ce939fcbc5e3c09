// What is sampled, and with which density, for tests: one sample a lane.
#include "core/roulette.h"
#include "light/light.h"
#include "material/bsdf.h"
#include "medium/phase.h"

// bits: uint [2][count]. setting: of the warp. results: float [4][count], the sample and its density.
#define WARP_DISK 0
#define WARP_COSINE_HEMISPHERE 1
#define WARP_SPHERE 2
#define WARP_CONE 3
#define WARP_TRIANGLE 4
#define WARP_PHASE 5
__kernel void sampling_warp(__global const float* bits, uint which, float setting, uint count, __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    const vfloat u = unit_interval(vfloat_bits(lane_load(bits + at))), v = unit_interval(vfloat_bits(lane_load(bits + count + at)));
    vec3 sample = vec3_all(0.0f);
    vfloat pdf = splat(0.0f);
    if (which == WARP_DISK) warp_disk(u, v, &sample.x, &sample.y);
    if (which == WARP_COSINE_HEMISPHERE) {
        sample = warp_cosine_hemisphere(u, v);
        pdf = warp_cosine_hemisphere_pdf(sample.z);
    }
    if (which == WARP_SPHERE) {
        sample = warp_sphere(u, v);
        pdf = splat(WARP_SPHERE_PDF);
    }
    if (which == WARP_CONE) {
        sample = warp_cone(u, v, splat(setting));
        pdf = warp_cone_pdf(splat(setting));
    }
    if (which == WARP_TRIANGLE) warp_triangle(u, v, &sample.x, &sample.y);
    if (which == WARP_PHASE) {
        sample = phase_sample(splat(setting), u, v);
        pdf = phase_eval(splat(setting), sample.z);
    }
    lane_save(sample.x, results + at);
    lane_save(sample.y, results + count + at);
    lane_save(sample.z, results + 2 * (size_t)count + at);
    lane_save(pdf, results + 3 * (size_t)count + at);
}

// numbers: uint [2][count], the pixel and the sample's number. results: uint [2][count].
__kernel void sampling_sequence(__global const float* numbers, uint seed, uint set, uint stratified, uint count,
                                __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    const Sampler sampler = sampler_start(seed, vfloat_bits(lane_load(numbers + at)), vfloat_bits(lane_load(numbers + count + at)));
    vuint a, b;
    if (stratified) sampler_bits(sampler, splat_uint(set), &a, &b);
    else sampler_hash_bits(sampler, splat_uint(set), &a, &b);
    lane_save(vfloat_from_bits(a), results + at);
    lane_save(vfloat_from_bits(b), results + count + at);
}

// numbers: uint [2][count], scattering events of a path whose throughput is 1; the second is not used. results: float [2][count]:
// probability to go on from a surface that absorbs nothing, and whether the roulette is played at all.
__kernel void sampling_roulette(__global const float* numbers, uint roulette, uint count, __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    const vuint depth = vfloat_bits(lane_load(numbers + at));
    lane_save(roulette_survival(roulette, vec3_all(1.0f), depth, splat(0.0f)), results + at);
    lane_save(splat(roulette_matters(roulette, depth) ? 1.0f : 0.0f), results + count + at);
}

// One material on a plane whose normal is z, seen along `direction`. results: float [11][count]: the direction taken, its weight and
// density, then f |cos| of it and the density as they are evaluated.
__kernel void sampling_bsdf(__global const float* bits, uint kind, float ior, uint front, float4 shading, float4 direction,
                            uint count, __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    Surface s;
    s.normal = vec3_of(splat(0.0f), splat(0.0f), splat(1.0f));
    s.shading = vec3_from(shading);
    s.front = splat_uint(front) != 0u;
    s.color = vec3_of(splat(0.5f), splat(0.25f), splat(1.0f));
    s.ior = splat(ior);
    s.kind = splat_uint(kind);
    Bsdf bsdf;
    bsdf_at(0, &s, vec3_from(direction), &bsdf);
    const BsdfSample taken = bsdf_sample(&bsdf, vfloat_bits(lane_load(bits + at)), vfloat_bits(lane_load(bits + count + at)));
    vfloat out[11], density;
    const vec3 f = bsdf_eval(&bsdf, taken.direction, &density);
    out[0] = taken.direction.x, out[1] = taken.direction.y, out[2] = taken.direction.z;
    out[3] = taken.weight.x, out[4] = taken.weight.y, out[5] = taken.weight.z;
    out[6] = taken.pdf;
    out[7] = f.x, out[8] = f.y, out[9] = f.z;
    out[10] = density;
    for (int k = 0; k < 11; ++k) lane_save(out[k], results + (size_t)k * count + at);
}

// Lights seen from `origin`; bits: uint [2][count], of which each lane's sampler is made. results: float [8][count]: direction and density of a sample and the primitive it lies on, as bits; then
// what a ray in that direction meets: the primitive, the density with which that would have been sampled, and how far that
// point is from where it was to be.
__kernel void sampling_light(SCENE_PARAMETERS __global const float* bits, float4 origin, float4 normal, uint count,
                             __global float* results) {
    SCENE_COLLECT(scene);
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    const vec3 from = vec3_from(origin), up = vec3_from(normal);
    const Sampler sampler = sampler_start(0u, vfloat_bits(lane_load(bits + at)), vfloat_bits(lane_load(bits + count + at)));
    const LightSample light = light_sample(&scene, from, up, splat_uint(NONE), sampler, sampler_set(splat_uint(0u), SET_LIGHT));
    const Ray ray = ray_make(from, light.direction);
    const Hit hit = traverse_nearest(&scene.bvh, &ray, mask_all());
    const vmask found = hit.primitive != NONE;
    const Surface surface = surface_at(&scene, &ray, hit, found);
    const vmask shines = found & light_shines(&surface);
    const vmask outside = !found & (splat_uint(settings->environment) != NONE);
    const LightRow met = light_met(&scene, &surface, shines, outside);
    vfloat density = shines ? light_density(&met, &surface, from) : splat(0.0f);
    if (lane_any(outside)) density = outside ? environment_found(&scene, &met, light.direction, outside).pdf : density;
    density = density * light_probability(&scene, from, up, &met);
    const vec3 off = sub(surface.point, light.target);
    vfloat out[8];
    out[0] = light.direction.x, out[1] = light.direction.y, out[2] = light.direction.z;
    out[3] = light.pdf;
    out[4] = vfloat_from_bits(light.primitive);
    out[5] = vfloat_from_bits(hit.primitive);
    out[6] = density;
    out[7] = found ? magnitude(off) : splat(0.0f);
    for (int k = 0; k < 8; ++k) lane_save(out[k], results + (size_t)k * count + at);
}

// Lights chosen at a point. results: float [6][count]: which, as bits, and how likely; how likely it is when asked; how likely the
// lights are in turn; the two numbers that are left for the point on it.
__kernel void sampling_light_choice(SCENE_PARAMETERS __global const float* bits, float4 origin, float4 normal, uint count,
                                    __global float* results) {
    SCENE_COLLECT(scene);
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    const vec3 from = vec3_from(origin), up = vec3_from(normal);
    const Sampler sampler = sampler_start(0u, vfloat_bits(lane_load(bits + at)), vfloat_bits(lane_load(bits + count + at)));
    const vuint set = sampler_set(splat_uint(0u), SET_LIGHT);
    LightChoice choice;
    TreeWalk walk = light_begin(&scene, from, up, sampler, set, &choice);
    tree_descend(&scene, &walk);
    light_choose(&scene, &walk, sampler, set, mask_all(), &choice);
    const LightRow light = light_at(&scene, choice.light, splat(0.0f));
    const uint number = (uint)at;
    const LightRow next = light_at(&scene, (splat_uint(number) + lane_index()) % settings->light_count, splat(0.0f));
    lane_save(vfloat_from_bits(choice.light), results + at);
    lane_save(settings->light_levels ? choice.probability : light.row[LIGHT_ROW_PROBABILITY], results + count + at);
    lane_save(light_probability(&scene, from, up, &light), results + (size_t)2 * count + at);
    lane_save(light_probability(&scene, from, up, &next), results + (size_t)3 * count + at);
    lane_save(choice.u, results + (size_t)4 * count + at);
    lane_save(choice.v, results + (size_t)5 * count + at);
}
