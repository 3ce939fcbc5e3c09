// What a path carries from one surface to the next, in every lane, and how it begins.
#ifndef INTEGRATOR_PATH_STATE_H
#define INTEGRATOR_PATH_STATE_H

#include "camera/camera.h"
#include "camera/surroundings.h"
#include "core/roulette.h"
#include "film/pool.h"
#include "integrator/split.h"
#ifdef SPECULAR_CHAINS
#include "specular/differential.h"
#endif
#ifdef PATH_BIDIRECTIONAL
#include "bidirectional/techniques.h"
#include "camera/towards.h"
#endif
#ifdef PATH_INSPECTED
#include "integrator/inspected.h"
#endif

// Rays of the camera, for LANES pixels of the pool at once: most of the time only a lane or two ask for one.
typedef struct {
    float origin[3][LANES], direction[3][LANES];
    uint seed[LANES];
    int inside[LANES];       // whether the pixel is in the image
    int sees[LANES];         // and its ray sees anything
#ifdef MOTION
    float time[LANES];
#endif
#ifdef CAMERA_CUTS_MEDIA
    uint first[LANES], last[LANES];      // the media that it begins in
#endif
    uint base, number;       // the first one's slot, and the number of their sample in this launch
    uint index;              // and of it in their replicate
#ifdef PIXEL_FILTER_NEGATIVE
    uint numbers[LANES];     // with POOL_NEGATIVE
#endif
    uint left;               // that nobody has asked for yet: the last ones
} CameraRays;

#ifdef SPECULAR_CHAINS
// It is on no chain; and all vertices so far were deltas.
#define CHAIN_NONE 0xffu
#define CHAIN_CAMERA 0xfeu

// The specular chain that a path is on.
typedef struct {
    vuint kind;              // what happened on it (specular/delta.h), or CHAIN_*
    vfloat pdf;              // of its first direction, and of what happened
    vfloat chance;           // with which a walk began at its first vertex
    Differential by;
} ChainState;
#endif

typedef struct {
    vmask alive;
    PoolSample sample;       // which one of the pool, and its random numbers
    Ray ray;                 // the next segment
    vec3 throughput;         // what the camera gets of the radiance arriving along it
    vec3 radiance;           // found so far
    vfloat index_squared;           // of where the ray is, relative to where the path began: refraction divided the throughput by it
    vuint depth;             // scattering events so far
    vec3 normal;             // of the last vertex, for which lights were chosen there (bsdf_receives)
    vmask counts_in_full;    // emission that the ray meets: it comes from the camera or a delta, and no light sample could have gone its way
#ifdef PATH_BIDIRECTIONAL
    Techniques techniques;   // else: for its weight
#else
    vfloat bsdf_samples;     // else: such rays that left the last vertex, as the MIS weights count them
    vfloat bsdf_pdf;         // and the density of the ray's direction, per steradian
#endif
#ifdef PATH_GUIDED
    vfloat expected;         // luminance that the path was expected to bring where it met the guiding field first; 0: it has not
#endif
#ifdef SPECULAR_CHAINS
    ChainState chain;
#endif
    Interior interior;       // the dielectrics that the ray begins in
#ifdef STRAIGHT_SHADOWS
    vfloat passed;           // how far behind its origin the last vertex is: surfaces in between were no boundaries
#endif
    vmask ended;             // it ends where it is, and has to be delivered
    Split split;
#ifdef INVARIANTS
    vmask broken;            // by some struct on its way: core/invariant.h
#endif
#ifdef PATH_STAGED
    __global uint* state;    // where it stands in global memory (staged/state.h)
#endif
#ifdef PATH_INSPECTED
    Inspection inspection;   // where it is written down
#endif
} Path;

// In stages a path stands in global memory, too. While a BSDF is evaluated it takes no registers: it is put down before, as far as it has changed,
// and taken again after; `known` is a word of the result, which keeps a compiler from taking it before.
#ifdef PATH_STAGED
static void path_put_down(const Path* path);
static void path_take_again(Path* path, uint known);
#define path_put_shadow(path, shadow) state_put_shadow((path)->state, shadow)
#else
#define path_put_shadow(path, shadow)
static void path_put_down(const Path* path) {}
#define path_take_again(path, known)
#endif

// What a path carries through global memory or to another lane, member by member: the kind of number, and where it stands in `path`. The ends of
// its ray are not among it: a path sets them anew at every vertex.
#ifdef INTERIORS
#define PATH_INTERIOR(UINT) UINT(path->interior.first) UINT(path->interior.last) UINT(path->interior.straight)
#else
#define PATH_INTERIOR(UINT)
#endif
#ifdef STRAIGHT_SHADOWS
#define PATH_PASSED(FLOAT) FLOAT(path->passed)
#else
#define PATH_PASSED(FLOAT)
#endif
#ifdef PATH_BIDIRECTIONAL
#define PATH_WEIGHTS(FLOAT) FLOAT(path->techniques.edge) FLOAT(path->techniques.earlier)
#else
#define PATH_WEIGHTS(FLOAT) FLOAT(path->bsdf_samples) FLOAT(path->bsdf_pdf)
#endif
#ifdef PATH_GUIDED
#define PATH_EXPECTED(FLOAT) FLOAT(path->expected)
#else
#define PATH_EXPECTED(FLOAT)
#endif
#define PATH_VEC3(FLOAT, v) FLOAT(v.x) FLOAT(v.y) FLOAT(v.z)
#define PATH_MEMBERS(FLOAT, UINT)         \
    PATH_VEC3(FLOAT, path->radiance)      \
    PATH_VEC3(FLOAT, path->throughput)    \
    UINT(path->sample.slot)            \
    UINT(path->sample.number)          \
    UINT(path->sample.sampler.seed)    \
    UINT(path->sample.sampler.index)   \
    PATH_VEC3(FLOAT, path->ray.origin)    \
    PATH_VEC3(FLOAT, path->ray.direction) \
    UINT(path->ray.from)               \
    FLOAT(path->index_squared)         \
    UINT(path->depth)                  \
    PATH_VEC3(FLOAT, path->normal)     \
    PATH_WEIGHTS(FLOAT)                \
    PATH_EXPECTED(FLOAT)               \
    PATH_INTERIOR(UINT)                \
    PATH_PASSED(FLOAT)

// No lane has a path. All is set all the same: a lane without one computes along, and must do so without harm.
static Path path_none(void) {
    Path path;
    path.alive = path.counts_in_full = path.ended = mask_none();
    path.depth = splat_uint(0u);
#ifdef PATH_BIDIRECTIONAL
    path.techniques = techniques_none();
#else
    path.bsdf_samples = path.bsdf_pdf = splat(0.0f);
#endif
#ifdef PATH_GUIDED
    path.expected = splat(0.0f);
#endif
#ifdef SPECULAR_CHAINS
    path.chain.kind = splat_uint(CHAIN_CAMERA);
    path.chain.pdf = path.chain.chance = splat(1.0f);
    path.chain.by = differential_begin(vec3_of(splat(0.0f), splat(0.0f), splat(1.0f)));
#endif
    path.index_squared = splat(1.0f);
    path.throughput = path.radiance = path.normal = vec3_all(0.0f);
    path.ray = ray_make(vec3_all(0.0f), vec3_all(1.0f));
    path.interior = interior_none();
    path.split = split_none();
    path.sample.slot = path.sample.number = path.sample.sampler.seed = path.sample.sampler.index = splat_uint(0u);
#ifdef STRAIGHT_SHADOWS
    path.passed = splat(0.0f);
#endif
#ifdef INVARIANTS
    path.broken = mask_none();
#endif
    return path;
}

// It goes straight on at this point: the last vertex stays where it was. Elsewhere this is the next.
static void path_pass(Path* path, vec3 point, vmask shadows_pass) {
#ifdef STRAIGHT_SHADOWS
    path->passed = shadows_pass ? path->passed + magnitude(sub(point, path->ray.origin)) : splat(0.0f);
#endif
}

// The last vertex, from which a light sample might have found what the ray finds.
static vec3 path_last_point(const Path* path) {
#ifdef STRAIGHT_SHADOWS
    return along(path->ray.origin, path->ray.direction, -path->passed);
#else
    return path->ray.origin;
#endif
}

// The probability that the path goes on, with this throughput, after so many scattering events. As flux: refraction scatters no light away.
static vfloat path_survival(const Scene* scene, const Path* path, vec3 throughput, vuint depth, vfloat termination) {
    return roulette_survival(scene->settings->roulette, scale(throughput, path->index_squared), depth, termination);
}

static CameraRays camera_rays_none(void) {
    CameraRays rays;
    rays.left = 0;
    return rays;
}

static void path_camera_rays(const Scene* scene, Pool* pool, CameraRays* rays) {
    PoolSample sample;
    vfloat film_x, film_y;
    rays->base = pool->base;
    rays->number = pool->next;
    rays->index = sampler_within(pool->first_sample + pool->next, scene->settings->replicate_spp);
    rays->left = LANES;
    const uint view = slot_view(scene->settings, pool->block);
    const uint number = pool->first_sample + pool->next;
    const vmask inside = pool_take(scene->settings, pool, &sample, &film_x, &film_y);
    const vfloat time = shutter_time(scene, view, sample.sampler, number, film_y);
    const Ray ray = camera_ray(scene, view, film_x, film_y, sample.sampler, time);
#ifdef MOTION
    lane_store(time, rays->time);
#endif
    lane_store(ray.origin.x, rays->origin[0]);
    lane_store(ray.origin.y, rays->origin[1]);
    lane_store(ray.origin.z, rays->origin[2]);
    lane_store(ray.direction.x, rays->direction[0]);
    lane_store(ray.direction.y, rays->direction[1]);
    lane_store(ray.direction.z, rays->direction[2]);
    lane_store(sample.sampler.seed, rays->seed);
#ifdef PIXEL_FILTER_NEGATIVE
    lane_store(sample.number, rays->numbers);
#endif
    lane_store(inside, rays->inside);
    lane_store(camera_sees(&ray), rays->sees);
#ifdef CAMERA_CUTS_MEDIA
    if (scene_has(scene, HAS_CAMERA_CUTS_MEDIA)) {
        const Interior around = surroundings_at(scene, ray.origin, inside & camera_sees(&ray), time);
        lane_store(around.first, rays->first);
        lane_store(around.last, rays->last);
    }
#endif
}

// In one lane, with the first of the camera rays that wait.
static void path_start(const Scene* scene, CameraRays* rays, Path* path, vmask lane) {
    // For a compiler the index is known where there is one lane
    const uint i = (LANES - rays->left--) % LANES;
    if (!rays->inside[i]) return;
    const vec3 origin = vec3_of(splat(rays->origin[0][i]), splat(rays->origin[1][i]), splat(rays->origin[2][i]));
    const vec3 direction = vec3_of(splat(rays->direction[0][i]), splat(rays->direction[1][i]), splat(rays->direction[2][i]));
    Ray ray = ray_make(origin, direction);
#ifdef MOTION
    ray.time = splat(rays->time[i]);
#endif
    const float sees = rays->sees[i] ? 1.0f : 0.0f;
    ray.limit = splat(FAR * sees);
    ray_replace(&path->ray, ray, lane);
    PoolSample* sample = &path->sample;
    sample->slot = lane ? splat_uint(rays->base + i) : sample->slot;
#ifdef PIXEL_FILTER_NEGATIVE
    sample->number = lane ? splat_uint(rays->numbers[i]) : sample->number;
#else
    sample->number = lane ? splat_uint(rays->number) : sample->number;
#endif
    sample->sampler.seed = lane ? splat_uint(rays->seed[i]) : sample->sampler.seed;
    sample->sampler.index = lane ? splat_uint(rays->index) : sample->sampler.index;
    path->throughput = choose(lane, vec3_all(sees), path->throughput);
    path->radiance = choose(lane, vec3_all(0.0f), path->radiance);
    path->depth = lane ? splat_uint(0u) : path->depth;
    path->index_squared = lane ? splat(1.0f) : path->index_squared;
#ifdef PATH_GUIDED
    path->expected = lane ? splat(0.0f) : path->expected;
#endif
#ifdef SPECULAR_CHAINS
    path->chain.kind = lane ? splat_uint(CHAIN_CAMERA) : path->chain.kind;
#endif
#ifdef PATH_BIDIRECTIONAL
    const vfloat edge = techniques_over(splat((float)scene->settings->light_paths), camera_density(scene, origin, direction, ray_time(&ray)));
    path->techniques.edge = lane ? edge : path->techniques.edge;
    path->techniques.earlier = lane ? splat(0.0f) : path->techniques.earlier;
#endif
#ifdef STRAIGHT_SHADOWS
    path->passed = lane ? splat(0.0f) : path->passed;
#endif
    path->counts_in_full = path->counts_in_full | lane;
    interior_start(scene, &path->interior, lane);
#ifdef CAMERA_CUTS_MEDIA
    if (scene_has(scene, HAS_CAMERA_CUTS_MEDIA)) {
        path->interior.first = lane ? splat_uint(rays->first[i]) : path->interior.first;
        path->interior.last = lane ? splat_uint(rays->last[i]) : path->interior.last;
    }
#endif
    split_start(&path->split, lane);
    path->alive = path->alive | lane;
#ifdef PATH_INSPECTED
    inspection_begin(&path->inspection, pool_number_of(sample));
#endif
}

// Lanes without a path take the next sample of the pool. Returns whether any lane has one: if not, the pool is used up.
static int path_next(const Scene* scene, Pool* pool, CameraRays* waiting, Path* path) {
    while (lane_any(!path->alive) && (waiting->left > 0 || !pool_empty(pool))) {
        if (waiting->left == 0) path_camera_rays(scene, pool, waiting);
        path_start(scene, waiting, path, lane_first(!path->alive));
    }
    return lane_any(path->alive);
}

#ifdef INVARIANTS
static vmask path_violates(const Path* path, vmask where) {
#ifdef PATH_BIDIRECTIONAL
    const vfloat a = path->techniques.edge, b = path->techniques.earlier;
#else
    const vfloat a = path->bsdf_pdf, b = path->bsdf_samples;
#endif
    const vmask carries = invariant_positive3(path->throughput) & (path->index_squared > 0.0f) & invariant_positive(a);
    return where & !(carries & invariant_positive3(path->radiance) & invariant_positive(b));
}
#endif

#endif
