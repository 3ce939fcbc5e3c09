// Light that comes to a vertex over a specular chain: specular manifold sampling (Zeltner, Georgiev and Jakob, "Specular manifold sampling for rendering
// high-frequency caustics and glints", ACM TOG 39(4) 2020).
//
// A point of a light is chosen, what happens at the chain's vertices, and a direction in which it might begin. From there Newton's method walks to a
// direction whose chain ends at the light, by the differentials of the ray's way (here of directions, so that chains of any length are two equations).
// Where it arrives, the probability of arriving there is not known, but one over it is the mean number of further tries until one arrives there again
// (Booth 2007): counting them keeps the estimate unbiased. Light that ends there is that of the chain's deltas, by the density of directions over the
// area of the light.
//
// Where that density is large, near a focus, a path finds the light more easily than a chain. So both are weighed by the balance heuristic, with the
// density of the light's point for the chain: then no weight is larger than a path's. It does not say how often a walk arrives, but any function of the
// path of light alone is a right weight.
#ifndef SPECULAR_WALK_H
#define SPECULAR_WALK_H

#include "guiding/guide.h"
#include "integrator/shadow.h"
#include "specular/chain.h"
#include "specular/table.h"

// Newton's steps of a walk at most; a step is a convergence below this, squared; and two walks end at one chain where directions are this near, squared.
#define WALK_STEPS 24u
#define WALK_ARRIVED 4.0e-10f
#define WALK_SAME 1.0e-8f
// Longest step, and smallest share of one that is tried where its chain is broken.
#define WALK_LONGEST 0.5f
#define WALK_LEAST 0.02f
// After so many tries it is taken for that many.
#define WALK_TRIES 4096u
#define WALK_SET 0x40000000u     // of the sampler's sets of dimensions the first of these tries
// Walks are as likely as what they bring counts, but at least this likely.
#define WALK_SELDOM 0.125f

// What happens on chains: each kind as often as this, in all, and in scenes without glass. Of two vertices that are alike both mostly do the same.
static vfloat walk_kind_probability(const Scene* scene, vuint kind) {
    const vmask once = chain_kind_count(kind) == 1u, first = chain_kind_through(kind, splat_uint(0u)), second = chain_kind_through(kind, splat_uint(1u));
    if (!chain_head(scene, CHAIN_HEAD_ROW_GLASS)) return once ? splat(0.75f) : splat(0.25f);
    return once ? (first ? splat(0.25f) : splat(0.1875f)) : (first & second ? splat(0.375f) : splat(0.0625f));
}
static vuint walk_kind(const Scene* scene, vfloat u) {
    if (!chain_head(scene, CHAIN_HEAD_ROW_GLASS)) return u < 0.75f ? chain_kind_of(1u, 0u, 0u) : chain_kind_of(2u, 0u, 0u);
    const vuint mixed = u < 0.875f ? chain_kind_of(2u, 1u, 0u) : u < 0.9375f ? chain_kind_of(2u, 0u, 1u) : chain_kind_of(2u, 0u, 0u);
    return u < 0.25f ? chain_kind_of(1u, 1u, 0u) : u < 0.625f ? chain_kind_of(2u, 1u, 1u) : u < 0.8125f ? chain_kind_of(1u, 0u, 0u) : mixed;
}

// A direction in which a chain might begin.
static vec3 walk_try(const Scene* scene, const Path* path, const Vertex* v, const ChainEnd* end, vuint kind, vuint number) {
    vuint bits[6];
    const vuint set = path->depth * (4u * WALK_TRIES) + number * 4u + WALK_SET;
    for (uint i = 0; i < 3u; ++i) sampler_hash_bits(path->sample.sampler, set + i, &bits[2 * i], &bits[2 * i + 1]);
    const vec3 place = chain_place(scene, bits[0], bits[1], unit_interval(bits[2]), unit_interval(bits[3]), surface_time(&v->surface));
    // Towards the light: the chain through what is in between begins nearby
    const vmask straight = chain_kind_through(kind, splat_uint(0u)) & ((bits[4] & 1u) != 0u);
    const vec3 to_light = choose(end->infinite, end->point, unit(sub(end->point, v->surface.point)));
    return choose(straight, to_light, unit(sub(place, v->surface.point)));
}

// One of Newton's steps, along the axes of the direction in which the chain begins.
typedef struct {
    vfloat a, b;
    vfloat density;          // differential_density
    vec3 direction;          // to the end, from the last vertex
    vmask ahead;             // the chain's ray goes that way
} WalkStep;

static WalkStep walk_step(const Chain* c, const ChainEnd* end) {
    WalkStep s;
    const vec3 to = sub(end->point, c->last.point);
    const vfloat nearness = end->infinite ? splat(0.0f) : inverse_magnitude(to);
    s.direction = choose(end->infinite, end->point, unit(to));
    s.ahead = inner(s.direction, c->direction) > 0.0f;
    const DifferentialMap m = differential_map(&c->by, c->direction, nearness);
    const vfloat x = inner(s.direction, m.across.tangent), y = inner(s.direction, m.across.bitangent);
    const vmask sound = absolute(m.determinant) > DIFFERENTIAL_SINGULAR;
    const vfloat inverse = quotient(splat(1.0f), sound ? m.determinant : splat(1.0f));
    s.a = sound ? difference_of_products(x, m.yy, y, m.xy) * inverse : splat(FAR);
    s.b = sound ? difference_of_products(m.xx, y, m.yx, x) * inverse : splat(FAR);
    s.density = differential_density(&m, nearness, end->infinite);
    return s;
}

// What a chain that ends at the light brings, if its last ray is free.
static vec3 walk_light(const Scene* scene, const Path* path, const Vertex* v, const Chain* c, const WalkStep* s, const ChainEnd* end, vfloat chance,
                       vec3 first, vmask where, PoolStats* stats) {
    vfloat pdf;
    const vec3 back = negate(s->direction);
    const vfloat cosine = end->surface ? greater(inner(back, end->normal), splat(0.0f)) : splat(1.0f);
    vec3 radiance = end->radiance;
    if (lane_any(end->point_like)) radiance = choose(end->point_like, lamp_intensity(scene, &end->light, back), radiance);
    const vec3 f_cosine = bsdf_eval(&v->bsdf, first, &pdf);
    // Among both ways to find it: a path would go this way by chance, but not to a light without extent
    const vfloat density = cosine * s->density, by_chain = end->pdf * chance;
    const vfloat by_path = (end->surface | sun_is(&end->light)) ? guide_pdf(scene, v, first, pdf) * c->chosen * density : splat(0.0f);
    const vfloat share = density * inverse_or_one(by_chain + by_path);
    vec3 arriving = scale(mul(mul(path->throughput, f_cosine), mul(mul(c->weight, c->media), radiance)), share);
    LightSample to;
    to.direction = s->direction;
    to.target = choose(end->surface, ray_end(c->last.point, end->point, end->normal, end->error), end->point);
    to.radiance = radiance;
    to.pdf = splat(1.0f);
    // A sphere that shines inwards may be in the way of its own light
    const vmask inwards = (end->light.kind == LIGHT_AREA_SPHERE) & (end->light.row[LIGHT_ROW_FACING] < 0.0f);
    to.primitive = end->surface & !inwards ? end->light.primitive : splat_uint(NONE);
    to.delta = mask_all();
    to.infinite = end->infinite;
    const ShadowRay shadow = shadow_ray(&c->last, &to, &c->in);
    arriving = mul(arriving, shadow_straight(scene, &c->in, &to, c->last.point));
    const vmask asked = where & (largest(arriving) > 0.0f);
    Shadows shadows;
    EACH_PACKET(k) shadow_start(scene, &shadows, k, &shadow, k == 0 ? asked : mask_none());
    shadow_finish(scene, &shadows);
    stats->shadow_rays += lane_count(asked);
    const vmask arrives = asked & shadow_arrives(&shadows, 0, &arriving);
    return choose(arrives, arriving, vec3_all(0.0f));
}

// The probability that a walk begins at the vertex: seldom where it counts for little.
static vfloat walk_chance(const Path* path) { return bounded(largest(path->throughput) * path->index_squared, WALK_SELDOM, 1.0f); }

// Radiance that chains bring to each lane's vertex, on its way to the camera.
static vec3 walk_to_light(const Scene* scene, const Path* path, const Vertex* v, vmask asked, PoolStats* stats) {
    const vuint set_of_choice = path->depth * (4u * WALK_TRIES) + WALK_SET + 3u;
    vuint bits, unused;
    vfloat chance = walk_chance(path);
    sampler_hash_bits(path->sample.sampler, set_of_choice, &bits, &unused);
    vmask walking = asked & (unit_interval(bits) < chance);
    vec3 found = vec3_all(0.0f);
    if (!lane_any(walking)) return found;

    sampler_bits(path->sample.sampler, sampler_set(path->depth, SET_SPARE), &bits, &unused);
    const vuint kind = walk_kind(scene, unit_interval(bits));
    chance = chance * walk_kind_probability(scene, kind);
    walking = walking & (path->depth + chain_kind_count(kind) < scene->settings->max_depth);
    const ChainEnd end = chain_end(scene, path->sample.sampler, sampler_set(path->depth, SET_LOBE), unused, set_of_choice + 4u, surface_time(&v->surface));
    vuint number = splat_uint(0u), steps = splat_uint(0u);       // of the try, and of its steps
    vec3 next = walk_try(scene, path, v, &end, kind, number), at = next, first = next;
    vec3 turn = vec3_all(0.0f);                                  // Newton's step from `at`
    vfloat part = splat(1.0f);                                   // of it
    vmask fresh = mask_all();
    while (lane_any(walking)) {
        Chain chain;
        const Frame axes = frame_around(next);
        chain_follow(scene, path, v, kind, next, walking, &chain, stats);
        const WalkStep step = walk_step(&chain, &end);
        const vfloat length2 = fma(step.a, step.a, step.b * step.b);
        const vmask arrived = chain.valid & (length2 < WALK_ARRIVED), ahead = arrived & step.ahead;
        steps = steps + 1u;

        // A step further, or a part of the last one where the chain is broken
        const vmask goes_on = chain.valid & !arrived & (length2 < 1.0e20f);
        const vfloat shorter = length2 > WALK_LONGEST * WALK_LONGEST ? quotient(splat(WALK_LONGEST), square_root(goes_on ? length2 : splat(1.0f))) : splat(1.0f);
        const vec3 whole = scale(along(scale(axes.tangent, step.a), axes.bitangent, step.b), shorter);
        part = goes_on ? lesser(part * 2.0f, splat(1.0f)) : part * 0.5f;
        at = choose(goes_on, next, at);
        turn = choose(goes_on, whole, turn);
        const vmask fails = !arrived & ((steps >= WALK_STEPS) | (!chain.valid & (fresh | (part < WALK_LEAST))) | (chain.valid & !goes_on));
        fresh = mask_none();
        const vec3 nearby = unit(along(at, turn, part));

        // The first walk finds the chain; others count how often that happens
        const vmask is_first = number == 0u, finds = walking & is_first & ahead;
        if (lane_any(finds)) {
            const vec3 light = walk_light(scene, path, v, &chain, &step, &end, chance, next, finds, stats);
            found = choose(finds, light, found);
            first = choose(finds, next, first);
        }
        const vec3 apart = sub(next, first);
        const vmask again = !is_first & ahead & (inner(apart, apart) < WALK_SAME), ended = walking & (arrived | fails);
        const vmask done = ended & ((is_first & !(largest(found) > 0.0f)) | again | (number >= WALK_TRIES - 1u));
        found = choose(done & !is_first, scale(found, vfloat_of(vint_from_uint(number))), found);
        walking = walking & !done;

        // The next try
        const vmask anew = ended & walking;
        next = nearby;
        if (!lane_any(anew)) continue;
        number = anew ? number + 1u : number;
        const vec3 start = walk_try(scene, path, v, &end, kind, number);
        next = choose(anew, start, next);
        steps = anew ? splat_uint(0u) : steps;
        part = anew ? splat(1.0f) : part;
        fresh = anew;
    }
    // A driver that ends long loops has lost the sample: it counts as one that is not finite
    return choose(walking, vec3_all(NAN), found);
}

#endif
