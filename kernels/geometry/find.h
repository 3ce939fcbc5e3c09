// What rays find in a scene: the nearest surface that is there, and how much of their light gets through.
//
// Where surfaces have holes (-D OPACITY) there are two trees, one over opaque primitives, one over masked ones, whose opacity is not 1 everywhere.
// A ray's nearest opaque surface is found first. What is masked before it follows, one hit after the other in the order of distance and
// primitive number: each is there with the probability of its opacity. Shadow rays that nothing opaque stops multiply what
// their masked hits let through. So no texture is read on the way through a tree; only what is known of holes without one counts there
// (geometry/holes.h).
//
// Elsewhere all of this is a walk through the one tree.
#ifndef GEOMETRY_FIND_H
#define GEOMETRY_FIND_H

#include "core/sampler.h"
#include "geometry/opacity.h"
#include "geometry/traverse.h"
#include "scene.h"

#ifdef OPACITY

// The masked hits along rays of several packets, one after the other.
typedef struct {
    Ray ray[PACKETS];        // with what is done left out
    vmask open[PACKETS];     // rays that ask for more
    Hit hit[PACKETS];        // the next, where there is one
    vfloat opacity[PACKETS]; // and there
#ifdef HIDDEN_SHAPES
    vmask hidden[PACKETS];   // the surface there is hidden from the camera
    vmask held_out[PACKETS]; // and rays of the camera end there
#endif
    vuint key[PACKETS];      // tells it from the ray's other hits: the primitive, and its side
} Masked;

static void masked_start(Masked* m, uint packet, const Ray* ray, vfloat limit, vmask asked) {
    m->ray[packet] = *ray;
    m->ray[packet].limit = limit;
    m->open[packet] = asked;
}

// Go on to the next hit of each ray. Returns whether any has one; those without are open no more.
__attribute__((noinline)) static int masked_next(const Scene* scene, Masked* m) {
    Traversal t;
    int any = 0;
    if (!scene_has(scene, HAS_MASKED)) return 0;
    EACH_PACKET(k) any |= lane_any(m->open[k]);
    if (!any) return 0;
    EACH_PACKET(k) traverse_start(&scene->masked, &t, k, &m->ray[k], m->open[k], 0);
    traverse_finish(&scene->masked, &t, 0);
    any = 0;
    EACH_PACKET(k) {
        const Hit hit = traverse_hit(&t, k);
        m->hit[k] = hit;
        m->open[k] = m->open[k] & (hit.primitive != NONE);
        if (!lane_any(m->open[k])) continue;
        any = 1;
        const Surface s = surface_at(scene, &m->ray[k], hit, m->open[k]);
        m->opacity[k] = opacity_at(scene, &s, m->open[k]);
#ifdef HIDDEN_SHAPES
        m->hidden[k] = s.hidden;
        m->held_out[k] = s.held_out;
#endif
        m->key[k] = hash_pair(hit.primitive, s.front ? splat_uint(1u) : splat_uint(0u));
        m->ray[k].after = hit.distance;
        m->ray[k].after_primitive = hit.primitive;
    }
    return any;
}

typedef struct {
    Traversal opaque;
    Masked masked;
    Sampler sampler[PACKETS];
    vuint set[PACKETS];
#ifdef HIDDEN_SHAPES
    vmask camera[PACKETS];
#endif
} Search;

// A packet's rays go on to what is masked before this distance.
static void find_start_masked(Search* s, uint packet, const Ray* ray, Sampler sampler, vuint depth, vmask camera, vfloat limit, vmask active) {
    masked_start(&s->masked, packet, ray, limit, active);
    s->sampler[packet] = sampler;
    s->set[packet] = sampler_set(depth, SET_TEXTURE);
#ifdef HIDDEN_SHAPES
    s->camera[packet] = camera;
#endif
}

// A packet sets out to find what is nearest; every one of them has to before they finish. `depth`: of the vertices that the rays leave.
// `camera`: rays that come from there. They pass what is hidden from it, and meet nothing where something is held out; the distance of that is told.
static void find_start(const Scene* scene, Search* s, uint packet, const Ray* ray, Sampler sampler, vuint depth, vmask camera, vmask active) {
    traverse_start(&scene->bvh, &s->opaque, packet, ray, active, 0);
    find_start_masked(s, packet, ray, sampler, depth, camera, ray->limit, active);
}

// The nearest opaque surfaces; then, with what is masked before them, the nearest that are there.
static void find_finish_opaque(const Scene* scene, Search* s, Hit* hit) {
    traverse_finish(&scene->bvh, &s->opaque, 0);
    EACH_PACKET(k) {
        hit[k] = traverse_hit(&s->opaque, k);
        s->masked.ray[k].limit = hit[k].distance;
    }
}
static void find_finish_masked(const Scene* scene, Search* s, Hit* hit) {
    while (masked_next(scene, &s->masked)) {
        EACH_PACKET(k) {
            if (!lane_any(s->masked.open[k])) continue;
            // Each surface has random numbers of its own, which spread evenly over the samples of the pixel
            Sampler own = s->sampler[k];
            own.seed ^= s->masked.key[k];
            vuint bits, unused;
            sampler_bits(own, s->set[k], &bits, &unused);
            vmask there = s->masked.open[k] & (unit_interval(bits) < s->masked.opacity[k]);
#ifdef HIDDEN_SHAPES
            there = there & !(s->camera[k] & s->masked.hidden[k]);
            const vmask ends = s->camera[k] & s->masked.held_out[k];
            s->masked.hit[k].primitive = ends ? splat_uint(NONE) : s->masked.hit[k].primitive;
#endif
            hit[k].distance = there ? s->masked.hit[k].distance : hit[k].distance;
            hit[k].primitive = there ? s->masked.hit[k].primitive : hit[k].primitive;
            s->masked.open[k] = s->masked.open[k] & !there;
        }
    }
}

static void find_finish(const Scene* scene, Search* s, Hit* hit) {
    find_finish_opaque(scene, s, hit);
    find_finish_masked(scene, s, hit);
}

// Shadow rays: the share of light that gets through.
typedef struct {
    Traversal opaque;
    Masked masked;
    vfloat left[PACKETS];
} Passage;

static void passage_start(const Scene* scene, Passage* p, uint packet, const Ray* ray, vmask asked) {
    traverse_start(&scene->bvh, &p->opaque, packet, ray, asked, 1);
    masked_start(&p->masked, packet, ray, ray->limit, asked);
}

// What is masked on the way of the rays that are open takes its share; of rays to the camera (-D PASSAGE_TO_CAMERA) not what is hidden from it.
static void passage_through(const Scene* scene, Masked* m, vfloat* left) {
    while (masked_next(scene, m)) {
        EACH_PACKET(k) {
            if (!lane_any(m->open[k])) continue;
#if defined(HIDDEN_SHAPES) && defined(PASSAGE_TO_CAMERA)
            m->opacity[k] = m->hidden[k] ? splat(0.0f) : m->opacity[k];
#endif
            left[k] = m->open[k] ? left[k] * (splat(1.0f) - m->opacity[k]) : left[k];
            m->open[k] = m->open[k] & (left[k] > 0.0f);
        }
    }
}

#if defined(HOLES) && !(defined(HIDDEN_SHAPES) && defined(PASSAGE_TO_CAMERA))
// Rays that are open and meet a masked surface where it is known to be whole get no further; those that meet none of which anything is
// unknown are through.
__attribute__((noinline)) static void passage_known(const Scene* scene, Masked* m, vfloat* left) {
    Traversal t;
    int any = 0;
    if (!scene_has(scene, HAS_HOLES)) return;
    EACH_PACKET(k) any |= lane_any(m->open[k]);
    if (!any) return;
    EACH_PACKET(k) traverse_start(&scene->masked, &t, k, &m->ray[k], m->open[k], 1);
    traverse_finish(&scene->masked, &t, 1);
    EACH_PACKET(k) {
        const vmask blocked = m->open[k] & traverse_blocked(&t, k);
        left[k] = blocked ? splat(0.0f) : left[k];
        m->open[k] = m->open[k] & !blocked & (t.primitive[k] != NONE);
    }
}
#else
static void passage_known(const Scene* scene, Masked* m, vfloat* left) {}
#endif

// What nothing opaque stops; then, of that, what is left behind masked surfaces.
static void passage_finish_opaque(const Scene* scene, Passage* p) {
    traverse_finish(&scene->bvh, &p->opaque, 1);
    EACH_PACKET(k) {
        p->masked.open[k] = p->masked.open[k] & !traverse_blocked(&p->opaque, k);
        p->left[k] = p->masked.open[k] ? splat(1.0f) : splat(0.0f);
    }
}
static void passage_finish_masked(const Scene* scene, Passage* p) {
    passage_known(scene, &p->masked, p->left);
    passage_through(scene, &p->masked, p->left);
}

static void passage_finish(const Scene* scene, Passage* p) {
    passage_finish_opaque(scene, p);
    passage_finish_masked(scene, p);
}

// Rays that nothing opaque stops, of which the first half of the search was elsewhere.
static void passage_open(Passage* p, uint packet, const Ray* ray, vmask open) {
    masked_start(&p->masked, packet, ray, ray->limit, open);
    p->left[packet] = open ? splat(1.0f) : splat(0.0f);
}

static vfloat passage_left(const Passage* p, uint packet) { return p->left[packet]; }

// Whether any does; less may than was sent.
static vmask passage_arrives(const Passage* p, uint packet, vec3* arriving) {
    *arriving = scale(*arriving, p->left[packet]);
    return p->left[packet] > 0.0f;
}

// Of one packet, what masked surfaces leave before this distance.
static vfloat passage_masked(const Scene* scene, const Ray* ray, vfloat limit, vmask asked) {
    Masked m;
    vfloat left[PACKETS];
    EACH_PACKET(k) {
        masked_start(&m, k, ray, limit, k == 0 ? asked : mask_none());
        left[k] = splat(1.0f);
    }
    passage_through(scene, &m, left);
    return left[0];
}

#else

typedef Traversal Search;

static void find_start(const Scene* scene, Search* s, uint packet, const Ray* ray, Sampler sampler, vuint depth, vmask camera, vmask active) {
    traverse_start(&scene->bvh, s, packet, ray, active, 0);
}
static void find_finish_opaque(const Scene* scene, Search* s, Hit* hit) {
    traverse_finish(&scene->bvh, s, 0);
    EACH_PACKET(k) hit[k] = traverse_hit(s, k);
}
static void find_finish(const Scene* scene, Search* s, Hit* hit) { find_finish_opaque(scene, s, hit); }

typedef Traversal Passage;

static void passage_start(const Scene* scene, Passage* p, uint packet, const Ray* ray, vmask asked) {
    traverse_start(&scene->bvh, p, packet, ray, asked, 1);
}
static void passage_finish(const Scene* scene, Passage* p) { traverse_finish(&scene->bvh, p, 1); }
static vfloat passage_left(const Passage* p, uint packet) { return traverse_blocked(p, packet) ? splat(0.0f) : splat(1.0f); }
static vmask passage_arrives(const Passage* p, uint packet, vec3* arriving) { return !traverse_blocked(p, packet); }
static vfloat passage_masked(const Scene* scene, const Ray* ray, vfloat limit, vmask asked) { return splat(1.0f); }

#endif

// One packet on its own.
static Hit find_nearest(const Scene* scene, const Ray* ray, Sampler sampler, vuint depth, vmask camera, vmask active) {
    Search s;
    Hit hit[PACKETS];
    EACH_PACKET(k) find_start(scene, &s, k, ray, sampler, depth, camera, k == 0 ? active : mask_none());
    find_finish(scene, &s, hit);
    return hit[0];
}
static vfloat passage_of(const Scene* scene, const Ray* ray, vmask asked) {
    Passage p;
    EACH_PACKET(k) passage_start(scene, &p, k, ray, k == 0 ? asked : mask_none());
    passage_finish(scene, &p);
    return passage_left(&p, 0);
}

#endif
