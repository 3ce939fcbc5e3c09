// What a path carries from one stage to the next: words in global memory. Those of STATE_BLOCK paths lie side by side, so that neighbouring work-items
// read neighbouring words, and a constant offset leads from one to the next: addresses would take registers.
//
// A kernel that reads a whole path and uses a part of it loads that part: compilers leave out the rest.
#ifndef STAGED_STATE_H
#define STAGED_STATE_H

#define PATH_STAGED
#include "integrator/shadow.h"
static void state_put_shadow(__global uint* state, const ShadowRay* shadow);
#include "integrator/path.h"

#if LANES != 1
#error "paths in stages have one lane each"
#endif

#define STATE_BLOCK_BITS 5
#define STATE_BLOCK (1u << STATE_BLOCK_BITS)

#ifdef SPECULAR_CHAINS
#define STATE_CHAIN(FLOAT, UINT)                                                                                            \
    UINT(path->chain.kind) FLOAT(path->chain.pdf) FLOAT(path->chain.chance)                                                  \
    PATH_VEC3(FLOAT, path->chain.by.point[0]) PATH_VEC3(FLOAT, path->chain.by.point[1])                                      \
    PATH_VEC3(FLOAT, path->chain.by.direction[0]) PATH_VEC3(FLOAT, path->chain.by.direction[1])
#else
#define STATE_CHAIN(FLOAT, UINT)
#endif
#ifdef PATH_SPLITS
#define STATE_SPLIT(FLOAT, UINT)                                                                                            \
    PATH_VEC3(FLOAT, path->split.origin) PATH_VEC3(FLOAT, path->split.direction) PATH_VEC3(FLOAT, path->split.throughput)    \
    FLOAT(path->split.hit.distance) UINT(path->split.hit.primitive) FLOAT(path->split.index_squared)                         \
    UINT(path->split.sampler.seed) UINT(path->split.sampler.index) UINT(path->split.depth) UINT(path->split.left)            \
    STATE_INTERIOR(UINT, path->split.interior)
#else
#define STATE_SPLIT(FLOAT, UINT)
#endif
#ifdef INTERIORS
#define STATE_INTERIOR(UINT, in) UINT(in.first) UINT(in.last) UINT(in.straight)
#else
#define STATE_INTERIOR(UINT, in)
#endif
#ifdef MOTION
#define STATE_TIME(FLOAT, ray) FLOAT(ray.time)
#else
#define STATE_TIME(FLOAT, ray)
#endif
#define STATE_PATH(FLOAT, UINT) PATH_MEMBERS(FLOAT, UINT) STATE_TIME(FLOAT, path->ray) STATE_CHAIN(FLOAT, UINT) STATE_SPLIT(FLOAT, UINT)

#define STATE_HIT(FLOAT, UINT) FLOAT(hit->distance) UINT(hit->primitive)

#ifdef STRAIGHT_SHADOWS
#define STATE_SHADOW_PASSES(FLOAT, UINT)                                                                                    \
    PATH_VEC3(FLOAT, shadow->target) UINT(shadow->infinite) STATE_INTERIOR(UINT, shadow->in)
#else
#define STATE_SHADOW_PASSES(FLOAT, UINT)
#endif
#define STATE_SHADOW(FLOAT, UINT)                                                                                           \
    PATH_VEC3(FLOAT, shadow->ray.origin) PATH_VEC3(FLOAT, shadow->ray.direction)                                             \
    FLOAT(shadow->ray.limit) UINT(shadow->ray.from) UINT(shadow->ray.to) STATE_TIME(FLOAT, shadow->ray)                      \
    STATE_SHADOW_PASSES(FLOAT, UINT)

// Where words begin: truths, the hit, light that may arrive, its shadow ray, the path.
#define STATE_COUNT(member) +1
enum {
    STATE_FLAGS = 0,
    STATE_HIT_WORD = 1,
    STATE_ARRIVING_WORD = STATE_HIT_WORD STATE_HIT(STATE_COUNT, STATE_COUNT),
    STATE_SHADOW_WORD = STATE_ARRIVING_WORD + 3,
    STATE_PATH_WORD = STATE_SHADOW_WORD STATE_SHADOW(STATE_COUNT, STATE_COUNT),
    STATE_WORDS = STATE_PATH_WORD STATE_PATH(STATE_COUNT, STATE_COUNT)
};

#define STATE_ALIVE 1u
#define STATE_COUNTS_IN_FULL 2u
#define STATE_ENDED 4u
#define STATE_SEES 8u            // else its ray ends where it begins
#define STATE_MET 16u            // of a path that splits
#define STATE_BACK 32u
#define STATE_BROKEN 64u
// There is something to do between rounds: a path is to be delivered, or has been back where it split; a debug build looks at all paths.
#ifdef INVARIANTS
#define STATE_ASKS STATE_ALIVE
#else
#define STATE_ASKS (STATE_ENDED | STATE_BACK)
#endif

// The first of a path's words.
typedef __global uint* State;

static State state_of(__global uint* words, uint path) {
    return words + (size_t)(path >> STATE_BLOCK_BITS) * (STATE_BLOCK * STATE_WORDS) + (path & (STATE_BLOCK - 1u));
}

// Every access to these words. scripts/gpu_static counts the calls that a compiler leaves.
#ifdef STATE_COUNTED
uint state_load(const __global uint* word) __attribute__((pure));
void state_store(__global uint* word, uint value);
#else
static uint state_load(const __global uint* word) { return *word; }
static void state_store(__global uint* word, uint value) { *word = value; }
#endif
#define STATE_PUT_FLOAT(member) state_store(word + n++ * STATE_BLOCK, as_uint(member));
#define STATE_PUT_UINT(member) state_store(word + n++ * STATE_BLOCK, as_uint(member));
#define STATE_GET_FLOAT(member) member = as_float(state_load(word + n++ * STATE_BLOCK));
#define STATE_GET_UINT(member) member = state_load(word + n++ * STATE_BLOCK);

static void state_put_path(State s, const Path* path) {
    __global uint* word = s + STATE_PATH_WORD * STATE_BLOCK;
    uint n = 0;
    STATE_PATH(STATE_PUT_FLOAT, STATE_PUT_UINT)
    uint flags = (path->alive ? STATE_ALIVE : 0u) | (path->counts_in_full ? STATE_COUNTS_IN_FULL : 0u) | (path->ended ? STATE_ENDED : 0u) |
                 (path->ray.limit > 0.0f ? STATE_SEES : 0u);
#ifdef PATH_SPLITS
    flags |= (path->split.met ? STATE_MET : 0u) | (path->split.back ? STATE_BACK : 0u);
#endif
#ifdef INVARIANTS
    flags |= path->broken ? STATE_BROKEN : 0u;
#endif
    state_store(s + STATE_FLAGS, flags);
}

static void state_get_path(State s, Path* path) {
    const uint flags = state_load(s + STATE_FLAGS);
    const __global uint* word = s + STATE_PATH_WORD * STATE_BLOCK;
    uint n = 0;
    *path = path_none();
    STATE_PATH(STATE_GET_FLOAT, STATE_GET_UINT)
    path->alive = (flags & STATE_ALIVE) != 0u;
    path->counts_in_full = (flags & STATE_COUNTS_IN_FULL) != 0u;
    path->ended = (flags & STATE_ENDED) != 0u;
    path->state = s;
    path->ray.limit = flags & STATE_SEES ? FAR : 0.0f;
#ifdef PATH_SPLITS
    path->split.met = (flags & STATE_MET) != 0u;
    path->split.back = (flags & STATE_BACK) != 0u;
#endif
#ifdef INVARIANTS
    path->broken = (flags & STATE_BROKEN) != 0u;
#endif
}

// integrator/path_state.h says when. What steps have changed by then, and not put down, is kept.
static void path_put_down(const Path* path) {
#if defined(PATH_SPLITS) || (defined(SPECTRAL) && defined(DISPERSION))
    state_put_path(path->state, path);
#endif
}
static void path_take_again(Path* path, uint known) {
    const vmask counts_in_full = path->counts_in_full;
    const vfloat bsdf_samples = path->bsdf_samples;
    const vec3 radiance = path->radiance;
#ifdef INVARIANTS
    const vmask broken = path->broken;
#endif
    state_get_path(path->state + (known == NONE), path);
    path->counts_in_full = counts_in_full;
    path->bsdf_samples = bsdf_samples;
    path->radiance = radiance;
#ifdef INVARIANTS
    path->broken = broken;
#endif
}

// Its first members.
static void state_put_vec3(State s, uint first, vec3 v) {
    __global uint* word = s + first * STATE_BLOCK;
    uint n = 0;
    PATH_VEC3(STATE_PUT_FLOAT, v)
}
static vec3 state_get_vec3(State s, uint first) {
    const __global uint* word = s + first * STATE_BLOCK;
    uint n = 0;
    vec3 v;
    PATH_VEC3(STATE_GET_FLOAT, v)
    return v;
}
static void state_put_radiance(State s, const Path* path) { state_put_vec3(s, STATE_PATH_WORD, path->radiance); }
static void state_put_throughput(State s, const Path* path) { state_put_vec3(s, STATE_PATH_WORD + 3u, path->throughput); }

static void state_put_hit(State s, const Hit* hit) {
    __global uint* word = s + STATE_HIT_WORD * STATE_BLOCK;
    uint n = 0;
    STATE_HIT(STATE_PUT_FLOAT, STATE_PUT_UINT)
}

static void state_get_hit(State s, Hit* hit) {
    const __global uint* word = s + STATE_HIT_WORD * STATE_BLOCK;
    uint n = 0;
    STATE_HIT(STATE_GET_FLOAT, STATE_GET_UINT)
}

static void state_put_shadow(State s, const ShadowRay* shadow) {
    __global uint* word = s + STATE_SHADOW_WORD * STATE_BLOCK;
    uint n = 0;
    STATE_SHADOW(STATE_PUT_FLOAT, STATE_PUT_UINT)
}

static void state_put_arriving(State s, const Direct* direct) { state_put_vec3(s, STATE_ARRIVING_WORD, direct->arriving[0]); }

static void state_get_shadow(State s, ShadowRay* shadow) {
    const __global uint* word = s + STATE_SHADOW_WORD * STATE_BLOCK;
    uint n = 0;
    *shadow = shadow_none();
    STATE_SHADOW(STATE_GET_FLOAT, STATE_GET_UINT)
}

// Add to the path's radiance what of the light sample arrives.
static void state_add_arriving(State s, const Shadows* shadows) {
    vec3 arriving = state_get_vec3(s, STATE_ARRIVING_WORD);
    if (shadow_arrives(shadows, 0, &arriving)) state_put_vec3(s, STATE_PATH_WORD, add(state_get_vec3(s, STATE_PATH_WORD), arriving));
}

#endif
