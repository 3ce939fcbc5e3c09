// Path reuse with stochastic multiple importance sampling (West, Georgiev, Gruson, Hachisuka, "Continuous Multiple Importance
// Sampling", ACM TOG 39(4) 2020, section 5; Bekaert, Sbert, Halton 2002).
//
// Each pixel of a group sends a path to its first matt surface, the anchor y, and goes on from there in one sampled direction, to
// z. The light that leaves z, found by following the path to its end, then serves all pixels k of the group that see z:
//
//     T_k Σ_i f(y_k, z_i) G(y_k, z_i) V(y_k, z_i) L_i / Σ_j p(z_i | y_j) V(y_j, z_i)
//
// where p is the density, by area, with which anchor j finds z, the roulette's chance included. Given the anchors this is the balance
// heuristic over the group, one sample a technique: without bias. The visibility has to stand in both sums: an anchor that does not see
// z could not have found it, and counting it would lose light. Direct light, and what lies behind all that is not matt, seen from the
// anchor, stay with their own pixel.
//
// Matt is what sends the same radiance into all directions: only there L_i is the same for all anchors. Whether z is matt depends on z
// alone, so that the two kinds of light are a partition, and each is estimated without bias. Lobes of other kinds at an anchor would
// do, too, but each pixel would have to evaluate its own for the targets of all, and those of the others for their densities.
//
// Three kernels: integrator_reuse follows the paths and keeps a record of each; reuse_weigh asks, in the lane of i, which anchors see
// z_i, and divides L_i by the lower sum; reuse_gather adds up, in the lane of k.
#ifndef INTEGRATOR_REUSE_H
#define INTEGRATOR_REUSE_H

#define SHARED_TIME          // with the other pixels of the group
#include "integrator/path.h"
#include "material/reversed.h"

// A pixel's sample: two rows of sixteen floats, [sample][slot].
#define RECORD_WORDS 32

// Where the path has left its own pixel: what others need to know of it.
typedef struct {
    vmask anchored;          // it has met a matt surface, the anchor
    vec3 origin;             // where rays leave the anchor
    vec3 side, shading;      // its normals, of the geometry and of the shading, on the side that the camera sees
    vec3 reflects;           // throughput there times its reflectance
    vuint from, depth;       // Ray.from; scattering events before it
    vfloat survival;         // probability that a path leaves it
    vmask leaves;            // the last ray of the path is the one that left the anchor
    vmask shared;            // the next vertex, z, is matt too
    vec3 target, target_side;
    vuint primitive;         // of z
    vec3 own;                // radiance that belongs to this pixel alone
} Reuse;

static Reuse reuse_none(void) {
    Reuse r;
    r.anchored = r.leaves = r.shared = mask_none();
    r.origin = r.side = r.shading = r.reflects = r.target = r.target_side = r.own = vec3_all(0.0f);
    r.from = r.primitive = splat_uint(NONE);
    r.depth = splat_uint(0u);
    r.survival = splat(0.0f);
    return r;
}

// Where light scatters alike into all directions.
static vmask reuse_matt(const Vertex* vertex) {
#ifdef MATERIALS
    return vertex->samples_lights & (vertex->bsdf.kind == MATERIAL_LAMBERT) & !vertex->bsdf.closure.present;
#else
    return vertex->samples_lights;
#endif
}

// And where that is seen alike from all directions: a normal map's normal is bent towards the viewer.
static vmask reuse_alike(const Vertex* vertex) {
#ifdef TEXTURES
    return !bsdf_is_bent(&vertex->surface, &vertex->bsdf);
#else
    return mask_all();
#endif
}

// The first matt surface of the path.
static void reuse_anchor(const Scene* scene, Reuse* r, const Path* path, const Vertex* vertex, vmask anchors) {
    const Surface* surface = &vertex->surface;
    const Bsdf* bsdf = &vertex->bsdf;
    const vec3 origin = ray_leave(surface->point, surface->normal, surface->clearance, !surface->front);
    const vec3 reflects = mul(path->throughput, bsdf->color);
    // From a black surface no path goes on
    const vmask dark = !(largest(reflects) > 0.0f);
    const vfloat going_on = path_survival(scene, path, reflects, path->depth + 1u, surface->termination);
    const vfloat survival = dark ? splat(0.0f) : going_on;
    r->origin = choose(anchors, origin, r->origin);
    r->side = choose(anchors, bsdf->side, r->side);
    r->shading = choose(anchors, bsdf->frame.normal, r->shading);
    r->reflects = choose(anchors, reflects, r->reflects);
    r->from = anchors ? surface->from : r->from;
    r->depth = anchors ? path->depth : r->depth;
    r->survival = anchors ? survival : r->survival;
    r->anchored = r->anchored | anchors;
}

// The surface that the ray from the anchor met. From here on the path gathers what leaves it, for whoever may see it.
static void reuse_share(Reuse* r, Path* path, const Vertex* vertex, vmask shares) {
    const Surface* surface = &vertex->surface;
    const vec3 target = ray_leave(surface->point, surface->normal, surface->clearance, !surface->front);
    r->target = choose(shares, target, r->target);
    r->target_side = choose(shares, vertex->bsdf.side, r->target_side);
    r->primitive = shares ? surface->primitive : r->primitive;
    r->own = choose(shares, path->radiance, r->own);
    r->shared = r->shared | shares;
    path->radiance = choose(shares, vec3_all(0.0f), path->radiance);
    path->throughput = choose(shares, vec3_all(1.0f), path->throughput);
    path->index_squared = shares ? splat(1.0f) : path->index_squared;
}

#define RECORD_ANCHORED 1u
#define RECORD_SHARED 2u

// The numbers of a record, as ANCHOR_ROW_* and TARGET_ROW_* of types.h name them: two rows.
static void reuse_words(const Reuse* r, vec3 reflects, vec3 light, vfloat words[RECORD_WORDS]) {
    const vuint flags = (r->anchored ? splat_uint(RECORD_ANCHORED) : splat_uint(0u)) | (r->shared ? splat_uint(RECORD_SHARED) : splat_uint(0u));
    vfloat* target = words + 16;
    for (int k = 0; k < RECORD_WORDS; ++k) words[k] = splat(0.0f);
    vec3_row_put(words, ANCHOR_ROW_ORIGIN, r->origin);
    vec3_row_put(words, ANCHOR_ROW_SIDE, r->side);
    vec3_row_put(words, ANCHOR_ROW_SHADING, r->shading);
    vec3_row_put(words, ANCHOR_ROW_REFLECTS, reflects);
    words[ANCHOR_ROW_FROM] = vfloat_from_bits(r->from);
    words[ANCHOR_ROW_DEPTH] = vfloat_from_bits(r->depth);
    words[ANCHOR_ROW_SURVIVAL] = r->survival;
    words[ANCHOR_ROW_FLAGS] = vfloat_from_bits(flags);
    vec3_row_put(target, TARGET_ROW_POINT, r->target);
    vec3_row_put(target, TARGET_ROW_SIDE, r->target_side);
    target[TARGET_ROW_PRIMITIVE] = vfloat_from_bits(r->primitive);
    vec3_row_put(target, TARGET_ROW_LIGHT, light);
}

// Write the records of paths that ended, and their own radiance to the film.
static void reuse_deliver(const Scene* scene, const Pool* pool, __global float* records, const Path* path, const Reuse* r, vmask done) {
    const PoolSample* sample = &path->sample;
    vfloat words[RECORD_WORDS];
    // Whatever light the anchor gets, from whichever pixel, counts as this sample does; what the sample finds for others has no weight
    reuse_words(r, pool_weighted(pool, sample, r->reflects), path->radiance, words);
    int is_done[LANES];
    uint slot[LANES], number[LANES];
    float word[LANES];
    lane_store(done, is_done);
    lane_store(sample->slot, slot);
    lane_store(pool_number_of(sample), number);
    for (uint k = 0; k < RECORD_WORDS; ++k) {
        lane_store(words[k], word);
        for (int lane = 0; lane < LANES; ++lane)
            if (is_done[lane]) records[((size_t)number[lane] * pool->slot_count + slot[lane]) * RECORD_WORDS + k] = word[lane];
    }
    pool_deliver(pool, sample, color_of_film(scene, choose(r->shared, r->own, path->radiance)), done);
}

// What reuse_weigh found out about the records of its lanes.
static void reuse_store(__global float* records, vuint record, vmask shared, vec3 light, vuint seen) {
    int is_shared[LANES];
    uint at[LANES], seen_by[LANES];
    float x[LANES], y[LANES], z[LANES];
    lane_store(shared, is_shared);
    lane_store(record, at);
    lane_store(seen, seen_by);
    lane_store(light.x, x);
    lane_store(light.y, y);
    lane_store(light.z, z);
    for (int lane = 0; lane < LANES; ++lane) {
        if (!is_shared[lane]) continue;
        __global float* target = records + (size_t)at[lane] * RECORD_WORDS + 16;
        target[TARGET_ROW_LIGHT] = x[lane];
        target[TARGET_ROW_LIGHT + 1] = y[lane];
        target[TARGET_ROW_LIGHT + 2] = z[lane];
        target[TARGET_ROW_SEEN] = as_float(seen_by[lane]);
    }
}

// As path_trace; every pixel has one ray from its first matt surface, which is what it shares.
static void reuse_trace(const Scene* given, Pool* pool, __global float* records, PoolStats* stats) {
    Scene scene[SCENES];
    scenes_of(given, scene);
    CameraRays waiting = camera_rays_none();
    Path path[PACKETS] = {path_none()};
    FreePath free[PACKETS];
    Hit hit[PACKETS];
    Vertex vertex[PACKETS];
    Direct direct;
    Reuse reuse = reuse_none();

    while (path_next(scene, pool, &waiting, path)) {
        const vmask goes = path->depth > 0u;
        reuse.anchored = reuse.anchored & goes;
        reuse.leaves = reuse.leaves & goes;
        reuse.shared = reuse.shared & goes;

        // Find the nearest surface along each ray, and add the light the ray ran into
        EACH_SCENE(k) path_look(&scene[k], pool, path);
        path_find(scene, path, free, hit);
        path_vertex(scene, path, hit[0], stats, &vertex[0]);
        path_add_emission(scene, path, vertex);
        path_add_sun(scene, path, vertex);

        // The first matt surface anchors the path; a matt one right after it sends its light to the whole group
        // What has been moved is not where another anchor would see it
        const vmask alike = reuse_alike(vertex) & !terminator_moved(&vertex->surface);
        const vmask matt = reuse_matt(vertex), anchors = matt & !reuse.anchored, shares = matt & alike & reuse.leaves;
        if (lane_any(shares)) reuse_share(&reuse, path, vertex, shares);
        if (lane_any(anchors)) reuse_anchor(scene, &reuse, path, vertex, anchors);
        reuse.leaves = anchors;

        // Add light that comes straight from the lights, and go on in a sampled direction
        path_sample_direct(scene, path, vertex, &direct, stats);
        path_scatter(scene, path, vertex, hit[0]);
        path_add_direct(scene, path, &direct);

        if (lane_any(path->ended)) reuse_deliver(scene, pool, records, path, &reuse, path->ended);
        path->alive = path->alive & !path->ended;
    }
}

// The pixels of a group: their places in the block of 4 × 4 differ by these. Sixteen are the block, one is the pixel alone; in between
// the groups are the cosets of a space of bits spanned by random vectors, new for every block and sample.
static void reuse_group(__global const Settings* settings, uint2 block, uint sample, uint partners[16]) {
    const uint number = (block.y + settings->top) / 4 * ((settings->width + 3) / 4) + (block.x + settings->left) / 4;
    uint random[LANES], span = 1;
    lane_store(hash_pair(hash_pair(splat_uint(number), splat_uint(sample)), splat_uint(settings->seed ^ 0x1f83d9abu)), random);
    partners[0] = 0;
    while (span < settings->reuse) {
        const uint vector = random[0] >> 28;
        int known = 0;
        for (uint m = 0; m < span; ++m) known |= partners[m] == vector;
        random[0] = random[0] * 0x2c9277b5u + 0xac564b05u;
        if (known) continue;
        for (uint m = 0; m < span; ++m) partners[span + m] = partners[m] ^ vector;
        span *= 2;
    }
}

// From an anchor to a target: the direction, and whether either turns away from the other.
typedef struct {
    vec3 to, direction;
    vfloat facing;           // cosine at the target over the distance's square; 0 where nothing passes
    vfloat cosine;           // at the anchor, of the shading normal
} ReuseLink;

static ReuseLink reuse_link(vec3 origin, vec3 side, vec3 shading, vec3 target, vec3 target_side, vmask exists) {
    ReuseLink l;
    l.to = sub(target, origin);
    const vfloat inverse = inverse_magnitude(l.to);
    l.direction = scale(l.to, inverse);
    const vfloat facing = -inner(l.direction, target_side) * inverse * inverse;
    const vmask open = exists & (inner(l.direction, side) > 0.0f) & (facing > 0.0f) & (facing < FAR);
    l.facing = open ? facing : splat(0.0f);
    l.cosine = greater(inner(l.direction, shading), splat(0.0f));
    return l;
}

// The records of the pixels that are so far from the lanes' own in the block, and where there is such a pixel.
static vuint reuse_partners(__global const Settings* settings, const Pool* pool, uint number, uint partner, vmask* exists) {
    const vuint slot = (pool->base + lane_index()) ^ partner;
    vuint x, y;
    *exists = slot_pixel(settings, pool->block, pool->first_slot + slot, &x, &y) & (slot < pool->slot_count);
    return (*exists ? slot : splat_uint(0u)) + number * pool->slot_count;
}

// Decides whether anchor m of the group sees the lanes' target through what lets a share of light pass: to see it or not with that chance is
// without bias, as long as both sums take the same decision. In [0, 1).
static vfloat reuse_chance(__global const Settings* settings, const Pool* pool, uint number, uint m) {
    vuint x, y;
    slot_pixel(settings, pool->block, pool->first_slot + pool->base + lane_index(), &x, &y);
    const vuint sample = hash_pair((y + settings->top) * settings->width + (x + settings->left), splat_uint(pool->first_sample + number));
    return unit_interval(hash_pair(sample, splat_uint((settings->seed ^ 0x5be0cd19u) + m)));
}

static vmask reuse_flag(vfloat flags, uint flag) { return (vfloat_bits(flags) & flag) != 0u; }

// Row 0 of a record is its anchor, row 1 its target.
static void reuse_row(__global const float* records, vuint record, uint row, vfloat words[16]) { lane_rows(records, record * 2u + row, words); }

static ReuseLink reuse_link_rows(const vfloat anchor[16], const vfloat target[16], vmask exists) {
    return reuse_link(vec3_row(anchor, ANCHOR_ROW_ORIGIN), vec3_row(anchor, ANCHOR_ROW_SIDE), vec3_row(anchor, ANCHOR_ROW_SHADING),
                      vec3_row(target, TARGET_ROW_POINT), vec3_row(target, TARGET_ROW_SIDE),
                      exists & reuse_flag(anchor[ANCHOR_ROW_FLAGS], RECORD_ANCHORED));
}

// Divide the light of each lane's target by the sum of the densities with which the group's anchors, those that see it, find it; and
// remember which do.
static void reuse_weigh_sample(const Scene* scene, const Pool* pool, __global float* records, uint number, PoolStats* stats) {
    __global const Settings* settings = scene->settings;
    uint partners[16];
    reuse_group(settings, pool->block, pool->first_sample + number, partners);
    vmask exists;
    const vuint own = reuse_partners(settings, pool, number, 0u, &exists);
    vfloat target[16], anchor[16];
    reuse_row(records, own, 0u, anchor);
    reuse_row(records, own, 1u, target);
    const vmask shared = exists & reuse_flag(anchor[ANCHOR_ROW_FLAGS], RECORD_SHARED);
    const vfloat time = shutter_time_of_pass(scene, pool->first_sample + number);
    const vuint depth = vfloat_bits(anchor[ANCHOR_ROW_DEPTH]), primitive = vfloat_bits(target[TARGET_ROW_PRIMITIVE]);
    if (!lane_any(shared)) return;
    vfloat density = splat(0.0f);
    vuint seen = splat_uint(0u);
    for (uint m = 0; m < settings->reuse; ++m) {
        reuse_row(records, reuse_partners(settings, pool, number, partners[m], &exists), 0u, anchor);
        // With a limited depth, light may go on for more vertices from one anchor than from another: they cannot share
        const vmask alike = settings->max_depth == NONE ? shared : shared & (vfloat_bits(anchor[ANCHOR_ROW_DEPTH]) == depth);
        const ReuseLink link = reuse_link_rows(anchor, target, alike & exists);
        const vfloat pdf = warp_cosine_hemisphere_pdf(link.cosine) * link.facing * anchor[ANCHOR_ROW_SURVIVAL];
        vmask open = pdf > 0.0f;
        if (m > 0 && lane_any(open)) {       // its own anchor sees it: the path went there
            const vec3 origin = vec3_row(anchor, ANCHOR_ROW_ORIGIN);
            const vec3 end = ray_end(origin, vec3_row(target, TARGET_ROW_POINT), vec3_row(target, TARGET_ROW_SIDE), vec3_all(0.0f));
            Ray ray = ray_in_time(ray_make(origin, sub(end, origin)), time);
            ray.limit = splat(1.0f);
            ray.from = vfloat_bits(anchor[ANCHOR_ROW_FROM]);
            ray.to = primitive;
            stats->shadow_rays += lane_count(open);
            open = open & (reuse_chance(settings, pool, number, m) < passage_of(scene, &ray, open));
        }
#ifdef REUSE_ASSUMES_VISIBLE                 // wrong, to show why (tests/statistics/test_reuse.py)
        density = density + pdf;
#else
        density = open ? density + pdf : density;
#endif
        seen = open ? seen | (1u << m) : seen;
    }
    const vfloat inverse = density > 0.0f ? quotient(splat(1.0f), density > 0.0f ? density : splat(1.0f)) : splat(0.0f);
    const vec3 light = scale(vec3_row(target, TARGET_ROW_LIGHT), inverse);
    reuse_store(records, own, shared, light, seen);
}

// Add what reaches the lanes' pixels from the targets of their group.
static void reuse_gather_sample(const Scene* scene, const Pool* pool, __global const float* records, uint number) {
    __global const Settings* settings = scene->settings;
    uint partners[16];
    reuse_group(settings, pool->block, pool->first_sample + number, partners);
    vmask exists, inside;
    vfloat anchor[16], target[16], flags[16];
    reuse_row(records, reuse_partners(settings, pool, number, 0u, &inside), 0u, anchor);
    vec3 radiance = vec3_all(0.0f);
    for (uint m = 0; m < settings->reuse; ++m) {
        const vuint partner = reuse_partners(settings, pool, number, partners[m], &exists);
        reuse_row(records, partner, 0u, flags);
        reuse_row(records, partner, 1u, target);
        const vmask sees = exists & reuse_flag(flags[ANCHOR_ROW_FLAGS], RECORD_SHARED) & ((vfloat_bits(target[TARGET_ROW_SEEN]) & (1u << m)) != 0u);
        const ReuseLink link = reuse_link_rows(anchor, target, sees & inside);
        const vfloat term = link.cosine * link.facing * INV_PI;
        radiance = choose(sees, along(radiance, vec3_row(target, TARGET_ROW_LIGHT), term), radiance);
    }
    pool_add(pool, number, color_of_film(scene, mul(radiance, vec3_row(anchor, ANCHOR_ROW_REFLECTS))), inside);
}

#endif
