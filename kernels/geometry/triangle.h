// A triangle as the ray test (triangle.inc) wants it, and how far the test's roundings may reach.
#ifndef GEOMETRY_TRIANGLE_H
#define GEOMETRY_TRIANGLE_H

#include "core/exact.h"

#define TRIANGLE_SLACK (32.0f * EPSILON)

// No determinant so small is told from zero: on zero's sign, and on what is smaller than a normal number, drivers do not agree.
#define TRIANGLE_EDGE_ON 1.0e-36f

typedef struct {
    vec3 a, ab, ca;      // the vertex A, B − A, A − C
    vec3 normal;         // (B − A) × (C − A)
    vfloat size;         // the largest component of the edges
    vfloat unsure;       // twice the error of the determinant, for a direction whose largest component is 1, over TRIANGLE_SLACK
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

static Triangle triangle_of(vec3 a, vec3 b, vec3 c) {
    Triangle t;
    t.a = a;
    t.ab = sub(b, a);
    t.ca = sub(a, c);
    t.normal = outer(t.ca, t.ab);
    const vfloat size_ab = largest_size(t.ab), size_ca = largest_size(t.ca);
    t.size = greater(size_ab, size_ca);
    // Each component of the normal is off by two roundings of its own, and by the edges' errors times the other edge, twice; the three
    // products of the determinant by three roundings.
    const vfloat lost_ab = triangle_lost(a, b, t.ab), lost_ca = triangle_lost(c, a, t.ca);
    const vfloat rounding = (absolute(t.normal.x) + absolute(t.normal.y) + absolute(t.normal.z)) * (5.0f * EPSILON);
    const vfloat edges = fma(lost_ab, size_ca, lost_ca * size_ab) * 6.0f;
    t.unsure = (rounding + edges) * (2.125f / TRIANGLE_SLACK);
    return t;
}

#endif
