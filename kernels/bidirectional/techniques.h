// The weights of bidirectional path tracing (Veach 1997, chapter 10): a path with n vertices can be made from a path from the camera and one
// from a light in n + 1 ways, which differ in the edge that joins the two. Its weight is that of the balance heuristic among all of them.
//
// Every path carries the sum of the relative densities of the ways that join at an edge behind it, in two numbers (Georgiev, "Implementing
// vertex connection and merging", 2012): for where it is now, as far as that does not depend on where it goes on from here. Densities are
// those of directions, per steradian; `reach` of a vertex turns them into those of places, times the squared distance: it is the
// cosine of a surface, and in a medium the probability of scattering per metre. What a medium lets pass counts in none of them, nor does roulette:
// any function of the path alone is a right weight, if only all ways know it alike.
//
// A way that joins at a delta cannot find anything.
#ifndef BIDIRECTIONAL_TECHNIQUES_H
#define BIDIRECTIONAL_TECHNIQUES_H

#include "core/exact.h"

// A camera vertex is joined with one of the vertices of a light path, so that each of those has this share, about.
#define TECHNIQUES_JOIN_SHARE 0.25f

typedef struct {
    vfloat edge;         // joins at the path's last edge, over the density of the place there
    vfloat earlier;      // at one before it, over that and over the density of the direction back
} Techniques;

// Numbers stay where products of two are normal: drivers do not agree about smaller ones.
static vfloat techniques_bounded(vfloat x) { return x < 1.0e-18f ? splat(0.0f) : lesser(x, splat(1.0e18f)); }
static vfloat techniques_over(vfloat a, vfloat b) { return techniques_bounded(quotient(a, greater(b, splat(1.0e-18f)))); }

static Techniques techniques_none(void) {
    Techniques t;
    t.edge = t.earlier = splat(0.0f);
    return t;
}

// The path arrives at its next vertex. `far`: it comes from infinity, and its density there is that of places already.
static void techniques_arrive(Techniques* t, vfloat distance, vmask far, vfloat reach, vmask where) {
    const vfloat spread = far ? splat(1.0f) : techniques_bounded(distance * distance);
    t->edge = where ? techniques_over(techniques_bounded(t->edge * spread), reach) : t->edge;
    t->earlier = where ? techniques_over(t->earlier, reach) : t->earlier;
}

// It scatters there. `ahead`: the density of its new direction; `back`: of the direction back, for a path that comes from there. `behind`
// and `before`: whether a way may join at the edge that it came along, and at the one that it goes along.
static void techniques_scatter(Techniques* t, vfloat ahead, vfloat back, vfloat reach, vmask behind, vmask before, vmask where) {
    const vfloat all = techniques_bounded(t->earlier * techniques_bounded(back)) + (behind ? t->edge : splat(0.0f));
    const vfloat share = techniques_over(techniques_bounded(reach), ahead);
    t->earlier = where ? techniques_bounded(techniques_bounded(all) * share) : t->earlier;
    t->edge = where ? (before ? techniques_over(splat(TECHNIQUES_JOIN_SHARE), ahead) : splat(0.0f)) : t->edge;
}

// By a delta. Densities of both directions are the same but for their measures: `reach` is that of where the path came from, over the square of the index
// beyond.
static void techniques_pass(Techniques* t, vfloat reach, vfloat index_squared, vmask where) {
    t->earlier = where ? techniques_over(techniques_bounded(t->earlier * techniques_bounded(reach)), index_squared) : t->earlier;
    t->edge = where ? splat(0.0f) : t->edge;
}

// Those of all ways that join behind the path's end. `density`: of the end's place for a path from the other side, times the squared distance
// that `techniques_arrive` has; `back`: of its direction from there.
static vfloat techniques_behind(const Techniques* t, vfloat density, vfloat back) {
    const vfloat all = t->edge + techniques_bounded(t->earlier * techniques_bounded(back));
    return techniques_bounded(techniques_bounded(all) * techniques_bounded(density));
}

// The weight of a way, of whose samples a path takes `share`, when all others have this sum.
static vfloat techniques_weight(vfloat others, float share) { return quotient(splat(1.0f), fma(others, splat(quotient_one(1.0f, share)), splat(1.0f))); }

// For tests of all ways alone that have so many vertices of one side: these count in full, and no other.
static vfloat techniques_only(vfloat weight, vuint camera, vuint light) {
#ifdef ONLY_CAMERA_VERTICES
    return camera == ONLY_CAMERA_VERTICES ? splat(1.0f) : splat(0.0f);
#elif defined(ONLY_LIGHT_VERTICES)
    return light == ONLY_LIGHT_VERTICES ? splat(1.0f) : splat(0.0f);
#else
    return weight;
#endif
}

#endif
