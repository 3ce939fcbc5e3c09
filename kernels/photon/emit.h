// Where photons and the paths of light start: a light by its share of the power, a point of it and a direction, with the flux that they carry.
#ifndef PHOTON_EMIT_H
#define PHOTON_EMIT_H

#include "light/light.h"

typedef struct {
    Ray ray;
    vec3 flux;           // watts, of one photon if it were the only one: of n, each carries 1/n of it
    vmask far;           // it comes from infinitely far
    vfloat spread;       // one over the density of the direction, per steradian; from far, of the place, per square metre
    vfloat extent;       // of a light that rays can find: π over the density of the place there, or one over that of all from far, with the choice of the light
    vuint sphere;        // the light where it is a sphere that light samples see as a cone, or NONE
#ifdef PATH_INSPECTED
    vuint light;
#endif
} Emission;

// A point of a surface that shines: all of its area is as likely.
typedef struct {
    vec3 point, normal, error;
    vfloat area;
} EmissionPoint;

static EmissionPoint emission_triangle(const LightRow* l, vfloat u, vfloat v) {
    const vec3 a = vec3_row(l->row, LIGHT_ROW_A), ab = vec3_row(l->row, LIGHT_ROW_AB), ac = vec3_row(l->row, LIGHT_ROW_AC);
    const AreaSample s = triangle_sample(a, a, ab, ac, l->row[LIGHT_ROW_INVERSE], u, v);
    EmissionPoint e;
    e.point = s.point;
    e.normal = s.normal;
    e.error = s.error;
    e.area = inverse_or_one(l->row[LIGHT_ROW_INVERSE]) * 0.5f;
    return e;
}

static EmissionPoint emission_round(const LightRow* l, vmask sphere, vfloat u, vfloat v) {
    const vec3 center = vec3_row(l->row, LIGHT_ROW_CENTER), disk_normal = vec3_row(l->row, LIGHT_ROW_NORMAL);
    const vfloat radius = l->row[LIGHT_ROW_RADIUS], facing = l->row[LIGHT_ROW_FACING];
    const vec3 outward = warp_sphere(u, v);
    const AreaSample disk = disk_sample(center, center, radius, disk_normal, u, v);
    EmissionPoint e;
    e.point = choose(sphere, along(center, outward, radius), disk.point);
    e.normal = choose(sphere, scale(outward, facing), disk.normal);
    e.error = disk.error;
    e.area = radius * radius * (sphere ? splat(4.0f * PI) : splat(PI));
    return e;
}

// What comes from infinitely far falls through a disk before the scene, as wide as the scene: `bounds` is its centre and radius.
static vec3 emission_from_outside(float4 bounds, vec3 travel, vfloat u, vfloat v) {
    vfloat x, y;
    warp_disk(u, v, &x, &y);
    const Frame f = frame_around(travel);
    const vec3 center = vec3_of(splat(bounds.x), splat(bounds.y), splat(bounds.z));
    return along(along(along(center, travel, splat(-bounds.w)), f.tangent, x * bounds.w), f.bitangent, y * bounds.w);
}

static Emission emission_sample(const Scene* scene, Sampler sampler, float4 bounds, vfloat time) {
    vuint bits_choice, bits_v, rest;
    vfloat u2, v2;
    sampler_bits(sampler, splat_uint(SET_LIGHT), &bits_choice, &bits_v);
    sampler_get(sampler, SET_BSDF, &u2, &v2);
    const vuint light = light_by_power(scene, bits_choice, sampler, splat_uint(SET_LIGHT_DIGITS), &rest);
    const LightRow l = light_at(scene, light, time);
    const vfloat u = unit_interval(rest), v = unit_interval(bits_v);
    const vmask triangle = l.kind == LIGHT_AREA_TRIANGLE, sphere = l.kind == LIGHT_AREA_SPHERE, disk = l.kind == LIGHT_AREA_DISK;
    const vmask directional = l.kind == LIGHT_DIRECTIONAL, environment = l.kind == LIGHT_ENVIRONMENT;
    const vmask sun = sun_is(&l), parallel = directional | environment | sun;
    const vec3 a = vec3_row(l.row, LIGHT_ROW_POSITION);              // of a directional light its direction
    const vec3 anywhere = warp_sphere(u2, v2);
    vfloat direction_pdf = splat(WARP_SPHERE_PDF);                   // of what comes from far, or from a point

    EmissionPoint from = emission_triangle(&l, u, v);
    if (lane_any(sphere | disk)) {
        const EmissionPoint round = emission_round(&l, sphere, u, v);
        const vmask is_round = sphere | disk;
        from.point = choose(is_round, round.point, from.point);
        from.normal = choose(is_round, round.normal, from.normal);
        from.error = choose(is_round, round.error, from.error);
        from.area = is_round ? round.area : from.area;
    }
    Emission e;
    const vmask surface = triangle | sphere | disk;
    const vec3 forwards = direction_again(frame_to_world(frame_around(from.normal), warp_cosine_hemisphere(u2, v2)));
    vec3 direction = choose(surface, forwards, choose(directional, a, anywhere));
    vec3 radiance = emission_sampled(scene, &l, from.point, from.normal, u, v, surface);
#ifdef ENVIRONMENT_MAP
    // Where the environment is brighter more photons start: each direction stands for the same flux, up to its colour
    if (scene_has(scene, HAS_ENVIRONMENT_MAP) && lane_any(environment)) {
        const EnvironmentSample around = environment_sample(scene, l.radiance, u2, v2);
        direction = choose(environment, negate(around.direction), direction);
        radiance = choose(environment, scale(around.radiance, inverse_or_one(around.pdf) * (0.25f * INV_PI)), radiance);
        direction_pdf = environment ? around.pdf : direction_pdf;
    }
#endif
#ifdef LAMPS
#ifdef PLUGIN_LIGHTS
    const vmask lamp = (l.kind == LIGHT_SPOT) | lamp_has_table(&l) | lamp_is_given(&l);
#else
    const vmask lamp = (l.kind == LIGHT_SPOT) | lamp_has_table(&l);
#endif
    if (lane_any(lamp)) {
        vfloat pdf;
        const vec3 beam = lamp_sample(scene, &l, u2, v2, &pdf);
        direction = choose(lamp, beam, direction);
        radiance = choose(lamp, scale(lamp_intensity(scene, &l, beam), inverse_or_one(pdf) * (0.25f * INV_PI)), radiance);
#ifdef PLUGIN_LIGHTS
        radiance = choose(lamp & !(pdf > 0.0f), vec3_all(0.0f), radiance);  // a plugin's sample that its own density excludes
#endif
        direction_pdf = lamp ? pdf : direction_pdf;
    }
#endif
#ifdef SUN
    if (lane_any(sun)) {
        const EnvironmentSample disc = sun_sample(scene, u2, v2);
        direction = choose(sun, negate(disc.direction), direction);
        radiance = choose(sun, scale(disc.radiance, inverse_or_one(disc.pdf)), radiance);
        direction_pdf = sun ? disc.pdf : direction_pdf;
    }
#endif
    vec3 origin = choose(surface, ray_leave(from.point, from.normal, ray_clearance(from.normal, from.error), mask_none()), a);
    if (lane_any(parallel))
        origin = choose(parallel, emission_from_outside(bounds, direction, u, v), origin);
    e.ray = ray_in_time(ray_make(origin, direction), time);
    e.ray.from = (triangle | disk) ? l.primitive : splat_uint(NONE);

    // Power: π A L of a surface, 4π I of a point (of a lamp, over 4π times the density), E times the disk's area of a direction and of the sun, 4π L times it of an environment
    const float disk_area = bounds.w * bounds.w * PI;
    vfloat factor = surface ? from.area * PI : splat(4.0f * PI);
    factor = (directional | sun) ? splat(disk_area) : (environment ? splat(4.0f * PI) * disk_area : factor);
    const vfloat chosen = inverse_or_one(l.row[LIGHT_ROW_PROBABILITY]);
    e.flux = scale(radiance, factor * chosen);

    // The same densities for whoever weighs them
    const vfloat cosine = inner(direction, from.normal);
    e.far = parallel;
    e.spread = parallel ? splat(disk_area) : inverse_or_one(surface ? cosine * INV_PI : direction_pdf);
    e.extent = surface ? from.area * PI * chosen : splat(0.0f);
    e.extent = (environment | sun) ? chosen * disk_area * inverse_or_one(direction_pdf) : e.extent;
    e.sphere = sphere & (l.row[LIGHT_ROW_FACING] > 0.0f) ? light : splat_uint(NONE);
#ifdef PATH_INSPECTED
    e.light = light;
#endif
    return e;
}

#endif
