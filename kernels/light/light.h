// Every light behind one pair: light_sample, and light_pdf for a direction that was found in another way.
#ifndef LIGHT_LIGHT_H
#define LIGHT_LIGHT_H

#include "core/lane.h"
#include "core/sampler.h"
#include "geometry/surface.h"
#include "light/area.h"
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
} LightSample;

typedef struct {
    vfloat row[16];
    vec3 radiance;
    vuint kind, primitive;
    vfloat probability;  // with which the alias table picks it
    vuint place;         // or where it is in the tree of lights
} Light_;

static Light_ light_at(const Scene* scene, vuint light) {
    Light_ l;
    lane_rows(scene->light_rows, light, l.row);
    l.radiance = vec3_of(l.row[0], l.row[1], l.row[2]);
    l.kind = vfloat_bits(l.row[3]);
    l.probability = l.row[4];
    l.place = vfloat_bits(l.row[4]);
    l.primitive = vfloat_bits(l.row[5]);
    return l;
}

// A light by its share of the power (Vose's alias table); what is left of the number is as random as new.
static vuint light_by_power(const Scene* scene, vuint bits, vuint* rest) {
    const uint count = scene->settings->light_count;
    vuint left;
    const vuint entry = sampler_pick(bits, count, &left);
    if (scene->settings->lights_equal) {
        *rest = left;
        return entry;
    }
    const vfloat threshold = lane_gather(scene->light_alias, entry * 2u);
    const vuint alias = vfloat_bits(lane_gather(scene->light_alias, entry * 2u + 1u));
    const vfloat u = unit_interval(left);
    const vmask keep = u < threshold;
    const vfloat width = keep ? threshold : splat(1.0f) - threshold;
    const vfloat stretched = (keep ? u : u - threshold) / (width > 0.0f ? width : splat(1.0f));
    *rest = vuint_of(bounded(stretched, 0.0f, 0.99999994f) * 16777216.0f) << 8;
    return keep ? entry : alias;
}

// Which light is sampled for a point, and where on it.
typedef struct {
    vuint light;
    vuint bits_u, bits_v;    // random numbers, as random as new
    vfloat probability;      // of the light; counts only where there is a tree of lights
} LightChoice;

// The choice at the end of a walk down the tree of lights, or by power where there is none.
static void light_choose(const Scene* scene, const TreeWalk* walk, LightChoice* choice) {
    choice->probability = walk->chance;
    choice->light = scene->settings->light_levels > 0 ? tree_end(scene, walk, &choice->bits_u) : light_by_power(scene, walk->bits, &choice->bits_u);
}

// The probability with which it is chosen there.
static vfloat light_probability(const Scene* scene, vec3 origin, vec3 normal, const Light_* light) {
    return scene->settings->light_levels > 0 ? tree_probability(scene, origin, normal, light->place) : light->probability;
}

static LightSample light_sample_one(const Scene* scene, vec3 origin, vuint own, const Light_* light, vfloat probability, vfloat u,
                                    vfloat v) {
    const Light_ l = *light;
    const vec3 a = vec3_of(l.row[6], l.row[7], l.row[8]);
    const vec3 b = vec3_of(l.row[9], l.row[10], l.row[11]);
    const vec3 c = vec3_of(l.row[12], l.row[13], l.row[14]);
    const vmask triangle = l.kind == LIGHT_AREA_TRIANGLE, sphere = l.kind == LIGHT_AREA_SPHERE, disk = l.kind == LIGHT_AREA_DISK;
    const vmask point = l.kind == LIGHT_POINT, directional = l.kind == LIGHT_DIRECTIONAL, environment = l.kind == LIGHT_ENVIRONMENT;
    AreaSample area = triangle_sample(origin, a, b, c, l.row[15], u, v);
    if (lane_any(sphere)) area = area_sample_choose(sphere, sphere_sample(origin, a, b.x, b.y, u, v), area);
    if (lane_any(disk)) area = area_sample_choose(disk, disk_sample(origin, a, b.x, c, u, v), area);

    // The shadow ray ends in front of the light's surface, as far as rounding could have moved it.
    const vec3 clear = ray_leave(area.point, area.normal, area.error, inner(sub(area.point, origin), area.normal) > 0.0f);
    const vec3 on_light = choose(point, a, area.point);
    const vec3 to = sub(on_light, origin);
    const vfloat distance2 = inner(to, to);
    LightSample s;
    s.direction = direction_of(to);
    s.target = choose(point, a, clear);
    s.radiance = choose(point, scale(l.radiance, inverse_or_one(distance2)), l.radiance);
    s.pdf = (point | directional) ? probability : area.pdf * probability;
    s.pdf = (l.primitive == own) & !(sphere & (b.y < 0.0f)) ? splat(0.0f) : s.pdf;
    s.primitive = (triangle | sphere | disk) ? l.primitive : splat_uint(NONE);
    s.delta = (point | directional) & (probability > 0.0f);
    s.infinite = directional | environment;
    if (lane_any(s.infinite)) {
        const vec3 to_infinity = choose(environment, warp_sphere(u, v), negate(a));
        s.direction = choose(s.infinite, to_infinity, s.direction);
        s.target = choose(s.infinite, to_infinity, s.target);
        s.pdf = environment ? probability * WARP_SPHERE_PDF : s.pdf;
    }
    return s;
}

// A point of the chosen light for the point `origin` of the primitive `own`. Only from inside a sphere does a surface see itself; what
// else it would send to itself is made of rounding errors.
static LightSample light_sample_chosen(const Scene* scene, vec3 origin, vuint own, const LightChoice* choice) {
    const Light_ light = light_at(scene, choice->light);
    const vfloat probability = scene->settings->light_levels > 0 ? choice->probability : light.probability;
    return light_sample_one(scene, origin, own, &light, probability, unit_interval(choice->bits_u), unit_interval(choice->bits_v));
}

// The same with the choice, for a point with this normal.
static LightSample light_sample(const Scene* scene, vec3 origin, vec3 normal, vuint own, vuint bits_u, vuint bits_v) {
    TreeWalk walk = tree_begin(origin, normal, bits_u);
    LightChoice choice;
    choice.bits_v = bits_v;
    tree_descend(scene, &walk);
    light_choose(scene, &walk, &choice);
    return light_sample_chosen(scene, origin, own, &choice);
}

// Whitted's lights: the whole light as if it shone from its centre, with nothing left to chance. An environment has no centre and
// gives nothing. `radiance` stands for what a delta light's does, so `pdf` is 1.
static LightSample light_from_center(const Scene* scene, vec3 origin, vuint light) {
    const Light_ l = light_at(scene, light);
    const vec3 a = vec3_of(l.row[6], l.row[7], l.row[8]);
    const vec3 b = vec3_of(l.row[9], l.row[10], l.row[11]);
    const vec3 c = vec3_of(l.row[12], l.row[13], l.row[14]);
    const vmask triangle = l.kind == LIGHT_AREA_TRIANGLE, sphere = l.kind == LIGHT_AREA_SPHERE, disk = l.kind == LIGHT_AREA_DISK;
    const vmask directional = l.kind == LIGHT_DIRECTIONAL;
    const vec3 center = choose(triangle, along(a, add(b, c), splat(1.0f / 3.0f)), a);
    const vec3 to = sub(center, origin);
    const vfloat distance2 = inner(to, to);
    LightSample s;
    s.direction = choose(directional, negate(a), unit(to));
    s.target = choose(directional, negate(a), center);
    const vec3 normal = choose(triangle, scale(outer(b, c), l.row[15]), c);
    const vfloat facing = greater(-inner(s.direction, normal), splat(0.0f));
    const vfloat disk_area = b.x * b.x * PI;
    const vfloat size = triangle ? inverse_or_one(l.row[15]) * 0.5f * facing : (disk ? disk_area * facing : (sphere ? disk_area : splat(1.0f)));
    const vfloat spread = directional ? splat(1.0f) : size * inverse_or_one(distance2);
    s.radiance = scale(l.radiance, spread);
    s.pdf = l.kind == LIGHT_ENVIRONMENT ? splat(0.0f) : splat(1.0f);
    s.primitive = (triangle | sphere | disk) ? l.primitive : splat_uint(NONE);
    s.delta = s.pdf > 0.0f;
    s.infinite = directional;
    return s;
}

// Radiance from a surface that shines, towards where the ray came from; black from behind. `pdf` is the density, per steradian,
// with which light_sample would have chosen it from `origin`, with this normal.
static vec3 light_emitted(const Scene* scene, const Surface* s, vec3 origin, vec3 normal, vfloat* pdf) {
    const vmask shines = (s->light != NONE) & s->front;
    const Light_ l = light_at(scene, shines ? s->light : splat_uint(0u));
    const vec3 a = vec3_of(l.row[6], l.row[7], l.row[8]);
    const vfloat radius = l.row[9], facing = l.row[10];
    const vmask sphere = l.kind == LIGHT_AREA_SPHERE, disk = l.kind == LIGHT_AREA_DISK;
    vfloat inverse_area = l.row[15] * 2.0f;
    if (lane_any(disk)) inverse_area = disk ? inverse_or_one(radius * radius * PI) : inverse_area;
    vfloat density = area_pdf(sub(s->point, origin), s->normal, inverse_area);
    if (lane_any(sphere)) density = sphere ? sphere_pdf(origin, a, radius, facing, s->point, s->normal) : density;
    *pdf = shines ? density * light_probability(scene, origin, normal, &l) : splat(0.0f);
    return choose(shines, l.radiance, vec3_all(0.0f));
}

// The same for a ray that leaves the scene.
static vec3 light_environment(const Scene* scene, vec3 origin, vec3 normal, vfloat* pdf) {
    const uint environment = scene->settings->environment;
    if (environment == NONE) {
        *pdf = splat(0.0f);
        return vec3_all(0.0f);
    }
    const Light_ l = light_at(scene, splat_uint(environment));
    *pdf = light_probability(scene, origin, normal, &l) * WARP_SPHERE_PDF;
    return l.radiance;
}

// The ray that has to be free for the sample to arrive. The limit leaves out a few roundings before the light.
#define SHADOW_LIMIT 0.999996f
static Ray light_shadow_ray(const Surface* s, const LightSample* l) {
    Ray ray = surface_leave(s, l->direction);
    ray.direction = choose(l->infinite, l->target, sub(l->target, ray.origin));
    ray.limit = l->infinite ? splat(FAR) : splat(SHADOW_LIMIT);
    ray.to = l->primitive;
    return ray;
}

#endif
