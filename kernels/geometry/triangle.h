// A triangle as the ray test (triangle.inc) wants it, and how far the test's roundings may reach.
#ifndef GEOMETRY_TRIANGLE_H
#define GEOMETRY_TRIANGLE_H

#include "core/exact.h"

#define TRIANGLE_SLACK (5.0f * EPSILON)

// No determinant so small is told from zero: on zero's sign, and on what is smaller than a normal number, drivers do not agree.
#define TRIANGLE_EDGE_ON 1.0e-36f

typedef struct {
    vec3 a, ab, ca;      // the vertex A, B − A, A − C
    vec3 normal;         // (B − A) × (C − A)
    vfloat size_ab;      // the largest component of B − A
    vfloat unsure;       // twice the error of the determinant, for a direction whose largest component is 1, over TRIANGLE_SLACK
    vfloat size_ca;      // of A − C; negative for a parallelogram, the two triangles A B C and A C D as one: D stands for C in the above
} Triangle;

// What rounding took away from b − a, exactly (Knuth's two-sum), but for its sign.
static vfloat triangle_lost_of(vfloat a, vfloat b, vfloat difference) {
    const vfloat back = b - difference;
    return absolute((back - a) - ((back + difference) - b));
}
// Of its components the largest.
static vfloat triangle_lost(vec3 a, vec3 b, vec3 difference) {
    return largest_size(vec3_of(triangle_lost_of(a.x, b.x, difference.x), triangle_lost_of(a.y, b.y, difference.y),
                                triangle_lost_of(a.z, b.z, difference.z)));
}

// A zero that all drivers write alike: they do not agree about its sign.
static vec3 triangle_without_signed_zero(vec3 a) {
    return vec3_of(a.x == 0.0f ? splat(0.0f) : a.x, a.y == 0.0f ? splat(0.0f) : a.y, a.z == 0.0f ? splat(0.0f) : a.z);
}

// Products of the edges are taken with the edges near 1, or what a small triangle's lose by rounding would be below the smallest
// normal number, about which drivers do not agree either.
static Triangle triangle_of(vec3 a, vec3 b, vec3 c) {
    Triangle t;
    t.a = a;
    t.ab = sub(b, a);
    t.ca = sub(a, c);
    t.size_ab = largest_size(t.ab);
    t.size_ca = largest_size(t.ca);
    const vfloat size = greater(t.size_ab, t.size_ca);
    const vfloat up = inverse_scale(vec3_of(size, size, size)), down = inverse_scale(vec3_of(up, up, up));
    const vec3 ab = scale(t.ab, up), ca = scale(t.ca, up), normal = outer(ca, ab);
    // Each component of the normal is off by two roundings of its own, and by the edges' errors times the other edge, twice; the
    // three products of the determinant by three roundings.
    const vfloat lost_ab = triangle_lost(a, b, t.ab) * up, lost_ca = triangle_lost(c, a, t.ca) * up;
    const vfloat rounding = (absolute(normal.x) + absolute(normal.y) + absolute(normal.z)) * (5.0f * EPSILON);
    const vfloat edges = fma(lost_ab, largest_size(ca), lost_ca * largest_size(ab)) * 6.0f;
    t.normal = triangle_without_signed_zero(scale(scale(normal, down), down));
    t.unsure = (rounding + edges) * (2.125f / TRIANGLE_SLACK) * down * down;
    return t;
}

// How far C is from where a parallelogram would have it, |(B − A) − (C − D)|₁, with what rounding may hide.
static vfloat parallelogram_gap(vec3 a, vec3 b, vec3 c, vec3 d) {
    const vec3 ab = sub(b, a), dc = sub(c, d), gap = sub(ab, dc);
    const vfloat lost = triangle_lost(a, b, ab) + triangle_lost(d, c, dc);
    return (absolute(gap.x) + absolute(gap.y) + absolute(gap.z)) * 1.000001f + lost * 3.0f;
}

// Whether the triangle is taken as B C A, since BC is much shorter than the two other sides: the test allows for errors beyond BC by the
// lengths of AB and CA, but beyond each of these by its own.
static vmask triangle_turns(vec3 a, vec3 b, vec3 c) {
    return largest_size(sub(c, b)) * 4.0f < greater(largest_size(sub(b, a)), largest_size(sub(a, c)));
}

// The triangles A B C and A C D as one. A gap moves the weights by no more than 2 m size gap.
static Triangle triangle_pair_of(vec3 a, vec3 b, vec3 c, vec3 d) {
    Triangle t = triangle_of(a, b, d);
    t.unsure = t.unsure + parallelogram_gap(a, b, c, d) * greater(t.size_ab, t.size_ca) * (2.0f / TRIANGLE_SLACK);
    t.size_ca = -t.size_ca;
    return t;
}

#endif
