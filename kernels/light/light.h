// Every light behind one pair: light_sample, and light_pdf for a point of a light that was found in another way.
#ifndef LIGHT_LIGHT_H
#define LIGHT_LIGHT_H

#include "core/lane.h"
#include "core/sampler.h"
#include "geometry/surface.h"
#include "light/area.h"
#include "light/emission.h"
#include "light/environment.h"
#include "light/lamp.h"
#include "light/row.h"
#include "light/sun.h"
#include "light/tree.h"
#include "scene.h"

typedef struct {
    vec3 direction;      // unit, towards the light
    vec3 target;         // where the shadow ray ends, clear of the light's own surface; a direction when `infinite`
    vec3 radiance;       // arriving from there; of a delta light times what stands for 1/pdf
    vfloat pdf;          // per steradian, with the choice of the light in it; 0: no light from there
    vuint primitive;     // of the light, or NONE
    vmask delta;         // a point or a direction: nothing else can find it
    vmask infinite;
#ifdef PATH_BIDIRECTIONAL
    vfloat started;      // the density with which a path of light starts there and goes this way, over that of the sample, and over the cosine at the light
#endif
} LightSample;

// Of so many lights a choice takes digits that the point on the light would lack.
#define LIGHT_FEW 256u

// A light by its share of the power (Vose's alias table), by a number of 32 random bits; `rest`: what is left of it, as random as new.
// `set`: of random numbers, SET_LIGHT_DIGITS of the vertex.
static vuint light_by_power(const Scene* scene, vuint bits, Sampler sampler, vuint set, vuint* rest) {
    const uint count = scene->settings->light_count;
    vuint threshold_bits = splat_uint(0u), digits = splat_uint(0u);
    if (!scene->settings->lights_equal || count > LIGHT_FEW) sampler_bits(sampler, set, &threshold_bits, &digits);
    const vuint entry = sampler_pick(bits, count, digits, rest);
    if (scene->settings->lights_equal) return entry;
    const vfloat threshold = lane_gather(scene->light_alias, entry * 2u);
    const vuint alias = vfloat_bits(lane_gather(scene->light_alias, entry * 2u + 1u));
    return unit_interval(threshold_bits) < threshold ? entry : alias;
}

// Which light is sampled for a point, and where on it.
typedef struct {
    vuint bits;              // random, to choose it by
    vuint light;
    vfloat probability;      // of the light; counts only where there is a light BVH
    vfloat u, v;             // random numbers in [0, 1), as random as new
    EnvironmentChoice around;
} LightChoice;

// The beginning of a choice for a point with this normal, or with zero where light from either side counts: `set` is SET_LIGHT of a
// vertex. Between this and light_choose the walk takes `light_levels` steps down the light BVH.
static TreeWalk light_begin(const Scene* scene, vec3 origin, vec3 normal, Sampler sampler, vuint set, LightChoice* choice) {
    vuint bits_v, unused, digits = splat_uint(0u);
    sampler_bits(sampler, set, &choice->bits, &bits_v);
    if (scene->settings->light_levels > 0) sampler_hash_bits(sampler, set + (SET_LIGHT_DIGITS - SET_LIGHT), &digits, &unused);
    choice->v = unit_interval(bits_v);
    return tree_begin(scene, origin, normal, choice->bits, digits);
}

// Its end. Lanes that want no light look up the same place all together, which costs least, and so do those of other lights in the
// environment.
static void light_choose(const Scene* scene, const TreeWalk* walk, Sampler sampler, vuint set, vmask wanted, LightChoice* choice) {
    if (!lane_any(wanted)) return;
    choice->probability = tree_chance(walk->given, walk->power);
    if (scene->settings->light_levels > 0) {
        choice->light = tree_end(scene, walk);
        choice->u = walk->u;
    } else {
        vuint rest;
        choice->light = light_by_power(scene, choice->bits, sampler, set + (SET_LIGHT_DIGITS - SET_LIGHT), &rest);
        choice->u = unit_interval(rest);
    }
    choice->light = wanted ? choice->light : splat_uint(0u);
    choice->u = wanted ? choice->u : splat(0.0f);
    choice->v = wanted ? choice->v : splat(0.0f);
    const vmask around = choice->light == scene->settings->environment;
    choice->around = environment_choose_line(scene, around ? choice->u : splat(0.0f), around ? choice->v : splat(0.0f));
}

// The probability with which it is chosen there.
static vfloat light_probability(const Scene* scene, vec3 origin, vec3 normal, const LightRow* light) {
    if (scene->settings->light_levels == 0) return light->row[LIGHT_ROW_PROBABILITY];
    return tree_probability(scene, origin, normal, vfloat_bits(light->row[LIGHT_ROW_PLACE]));
}

#if defined(PATH_BIDIRECTIONAL) || defined(SPECULAR_CHAINS)
// Square metres of a light that is a surface; of others, any.
static vfloat light_area(const LightRow* l) {
    const vfloat radius = l->row[LIGHT_ROW_RADIUS], disk = radius * radius * PI;
    const vmask sphere = l->kind == LIGHT_AREA_SPHERE, triangle = l->kind == LIGHT_AREA_TRIANGLE;
    return triangle ? inverse_or_one(l->row[LIGHT_ROW_INVERSE]) * 0.5f : sphere ? disk * 4.0f : disk;
}
#endif

// A point of the light for the point `origin` of the primitive `own`. Only from inside a sphere does a surface see itself; what else it
// would send to itself is made of rounding errors.
static LightSample light_sample_one(const Scene* scene, vec3 origin, vuint own, const LightRow* l, vfloat probability, const LightChoice* choice) {
    const vfloat u = choice->u, v = choice->v;
    const vmask triangle = l->kind == LIGHT_AREA_TRIANGLE, sphere = l->kind == LIGHT_AREA_SPHERE, disk = l->kind == LIGHT_AREA_DISK;
    const vmask point = lamp_at_point(l), directional = l->kind == LIGHT_DIRECTIONAL, environment = l->kind == LIGHT_ENVIRONMENT;
    const vmask sun = sun_is(l);
    const vec3 center = vec3_row(l->row, LIGHT_ROW_CENTER);        // of a triangle A, of a point its position, or a direction
    const vfloat radius = l->row[LIGHT_ROW_RADIUS], facing = l->row[LIGHT_ROW_FACING];
    AreaSample area = triangle_sample(origin, vec3_row(l->row, LIGHT_ROW_A), vec3_row(l->row, LIGHT_ROW_AB), vec3_row(l->row, LIGHT_ROW_AC),
                                      l->row[LIGHT_ROW_INVERSE], u, v);
    if (lane_any(sphere)) area = area_sample_choose(sphere, sphere_sample(origin, center, radius, facing, u, v), area);
    if (lane_any(disk)) area = area_sample_choose(disk, disk_sample(origin, center, radius, vec3_row(l->row, LIGHT_ROW_NORMAL), u, v), area);

    const vec3 clear = ray_end(origin, area.point, area.normal, area.error);
    const vec3 on_light = choose(point, center, area.point);
    const vec3 to = sub(on_light, origin);
    const vfloat distance2 = inner(to, to);
    LightSample s;
    s.direction = direction_of(to);
    s.target = choose(point, center, clear);
    s.pdf = (point | directional) ? probability : area.pdf * probability;
    s.pdf = (l->primitive == own) & !(sphere & (facing < 0.0f)) ? splat(0.0f) : s.pdf;
    const vec3 emitted = emission_sampled(scene, l, area.point, area.normal, u, v, s.pdf > 0.0f);
    s.radiance = choose(point, scale(lamp_intensity(scene, l, negate(s.direction)), inverse_or_one(distance2)), emitted);
    const vmask across = sphere & !sphere_shines_on(origin, center, radius, facing);   // its near side may be in the way
    s.primitive = (triangle | sphere | disk) & !across ? l->primitive : splat_uint(NONE);
    s.delta = point | directional;
    s.infinite = directional | environment | sun;
    if (lane_any(s.infinite)) {
        const EnvironmentSample around = environment_sample_chosen(scene, l->radiance, &choice->around);
        const vec3 to_infinity = choose(environment, around.direction, negate(center));
        s.direction = choose(s.infinite, to_infinity, s.direction);
        s.target = choose(s.infinite, to_infinity, s.target);
        s.radiance = choose(environment, around.radiance, s.radiance);
        s.pdf = environment ? probability * around.pdf : s.pdf;
#ifdef SUN
        const EnvironmentSample disc = sun_sample(scene, u, v);
        s.direction = choose(sun, disc.direction, s.direction);
        s.target = choose(sun, disc.direction, s.target);
        s.radiance = choose(sun, disc.radiance, s.radiance);
        s.pdf = sun ? probability * disc.pdf : s.pdf;
#endif
    }
#ifdef PATH_BIDIRECTIONAL
    const vfloat from_point = lamp_pdf(scene, l, negate(s.direction)) * inverse_or_one(distance2);
    const vfloat from_surface = inverse_or_one(light_area(l) * area.pdf * PI);
    s.started = point ? from_point : s.infinite ? splat(quotient_one(INV_PI, scene->settings->bounds.w * scene->settings->bounds.w)) : from_surface;
#endif
    return s;
}

// The light that was chosen.
static LightSample light_sample_chosen(const Scene* scene, vec3 origin, vuint own, const LightChoice* choice, vfloat time) {
    const LightRow light = light_at(scene, choice->light, time);
    const vfloat probability = scene->settings->light_levels > 0 ? choice->probability : light.row[LIGHT_ROW_PROBABILITY];
    return light_sample_one(scene, origin, own, &light, probability, choice);
}

// The same with the choice, for a point with this normal, of what does not move.
static LightSample light_sample(const Scene* scene, vec3 origin, vec3 normal, vuint own, Sampler sampler, vuint set) {
    LightChoice choice;
    TreeWalk walk = light_begin(scene, origin, normal, sampler, set, &choice);
    tree_descend(scene, &walk);
    light_choose(scene, &walk, sampler, set, mask_all(), &choice);
    environment_guide(scene, &choice.around);
    return light_sample_chosen(scene, origin, own, &choice, splat(0.0f));
}

// Whitted's lights: the whole light as if it shone from its centre with its mean radiance, with nothing left to chance, for the point
// `origin` of the primitive `own`. An environment has no centre and gives nothing; nor does a surface that turns its dark side to the point. `radiance` stands for
// what a delta light's does, so `pdf` is 1 where there is light.
static LightSample light_from_center(const Scene* scene, vec3 origin, vuint own, vuint light, vfloat time) {
    const LightRow l = light_at(scene, light, time);
    const vec3 a = vec3_row(l.row, LIGHT_ROW_A), b = vec3_row(l.row, LIGHT_ROW_AB), c = vec3_row(l.row, LIGHT_ROW_AC);
    const vfloat radius = l.row[LIGHT_ROW_RADIUS], facing = l.row[LIGHT_ROW_FACING], inverse = l.row[LIGHT_ROW_INVERSE];
    const vmask triangle = l.kind == LIGHT_AREA_TRIANGLE, sphere = l.kind == LIGHT_AREA_SPHERE, disk = l.kind == LIGHT_AREA_DISK;
    const vmask sun = sun_is(&l), directional = (l.kind == LIGHT_DIRECTIONAL) | sun, flat = triangle | disk;
    const vec3 center = choose(triangle, along(a, add(b, c), splat(1.0f / 3.0f)), a);
    const vec3 to = sub(center, origin);
    LightSample s;
    s.direction = choose(directional, negate(a), unit(to));
    const vec3 normal = choose(triangle, scale(outer(b, c), inverse), vec3_row(l.row, LIGHT_ROW_NORMAL));
    s.target = choose(directional, negate(a), choose(flat, ray_end(origin, center, normal, vec3_all(0.0f)), center));
    const vfloat cosine = greater(-inner(s.direction, normal), splat(0.0f)), disk_area = radius * radius * PI;
    const vfloat area = triangle ? inverse_or_one(inverse) * 0.5f : disk_area;
    const vfloat size = flat ? area * cosine : (sphere ? disk_area : splat(1.0f));
    s.radiance = scale(lamp_intensity(scene, &l, negate(s.direction)), directional ? splat(1.0f) : size * inverse_or_one(inner(to, to)));
    s.radiance = sun_irradiance(scene, s.radiance, sun);
    const vmask dark = (l.kind == LIGHT_ENVIRONMENT) | (flat & ((l.primitive == own) | (cosine == 0.0f))) |
                       (sphere & !sphere_shines_on(origin, a, radius, facing));
    s.pdf = dark ? splat(0.0f) : splat(1.0f);
    s.primitive = (flat | sphere) ? l.primitive : splat_uint(NONE);
    s.delta = !dark;
    s.infinite = directional;
    return s;
}

// Whether a surface shines towards where the ray came from: not from behind.
static vmask light_shines(const Surface* s) { return (s->light != NONE) & s->front; }

// Its light, where it does, and the environment where a ray has left the scene.
static LightRow light_met(const Scene* scene, const Surface* s, vmask shines, vmask outside) {
    const vuint other = outside ? splat_uint(scene->settings->environment) : splat_uint(0u);
    return light_at(scene, shines ? s->light : other, surface_time(s));
}

// The radiance that it sends there.
static vec3 light_emitted(const Scene* scene, const Surface* s, vmask found) {
    const vmask shines = found & light_shines(s);
    if (!lane_any(shines)) return vec3_all(0.0f);
    const LightRow light = light_met(scene, s, shines, mask_none());
    return choose(shines, emission_found(scene, &light, s, shines), vec3_all(0.0f));
}

// The density, per steradian, with which a point of a surface that shines is chosen among the points of its light, from `origin`.
static vfloat light_density(const LightRow* l, const Surface* s, vec3 origin) {
    const vfloat radius = l->row[LIGHT_ROW_RADIUS];
    const vmask sphere = l->kind == LIGHT_AREA_SPHERE, disk = l->kind == LIGHT_AREA_DISK;
    vfloat inverse_area = l->row[LIGHT_ROW_INVERSE] * 2.0f;
    if (lane_any(disk)) inverse_area = disk ? inverse_or_one(radius * radius * PI) : inverse_area;
    vfloat density = area_pdf(sub(s->point, origin), s->normal, inverse_area);
    if (lane_any(sphere)) {
        const vec3 center = vec3_row(l->row, LIGHT_ROW_CENTER);
        density = sphere ? sphere_pdf(origin, center, radius, l->row[LIGHT_ROW_FACING], s->point, s->normal) : density;
    }
    return density;
}

// What a ray finds that leaves the scene, where that has an environment: its radiance, and its density among the environment's samples.
static EnvironmentSample environment_found(const Scene* scene, const LightRow* environment, vec3 direction, vmask leaves) {
    return environment_along(scene, environment->radiance, choose(leaves, direction, vec3_of(splat(0.0f), splat(1.0f), splat(0.0f))));
}
// Whether it is hidden from rays that leave a path's vertex of this depth: from those of the camera.
static vmask environment_hidden(const Scene* scene, vuint depth) {
#ifdef HIDDEN_ENVIRONMENT
    return scene_has(scene, HAS_HIDDEN_ENVIRONMENT) ? depth == 0u : mask_none();
#else
    return mask_none();
#endif
}
static vec3 environment_emitted(const Scene* scene, vec3 direction, vmask leaves) {
    vec3 emitted = vec3_all(0.0f);
    if (scene->settings->environment != NONE) {
        const LightRow environment = light_at(scene, splat_uint(scene->settings->environment), splat(0.0f));
        emitted = environment_found(scene, &environment, direction, leaves).radiance;
    }
#ifdef SUN
    if (scene_has(scene, HAS_SUN)) emitted = add(emitted, sun_along(scene, direction).radiance);
#endif
    return emitted;
}

// The ray that has to be free for the sample to arrive. It ends before the light's surface (ray_end), and before a point by a few roundings.
#define SHADOW_LIMIT_POINT (1.0f - 16.0f * EPSILON)
static Ray light_shadow_ray(const Surface* s, const LightSample* l) {
    Ray ray = surface_leave(s, l->direction);
    ray.direction = choose(l->infinite, l->target, sub(l->target, ray.origin));
    ray.limit = l->infinite ? splat(FAR) : (l->primitive == NONE ? splat(SHADOW_LIMIT_POINT) : splat(1.0f));
    ray.to = l->primitive;
    return ray;
}

#ifdef INVARIANTS
static vmask light_sample_violates(const LightSample* s, vmask where) {
    return where & (s->pdf > 0.0f) & !(invariant_unit(s->direction) & invariant_positive3(s->radiance) & (s->pdf <= FAR) & invariant_finite3(s->target));
}
#endif

#endif
