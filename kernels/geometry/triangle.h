// A triangle as the ray test (triangle.inc) wants it, and how far the test's roundings may reach.
#ifndef GEOMETRY_TRIANGLE_H
#define GEOMETRY_TRIANGLE_H

#include "core/exact.h"

#define TRIANGLE_SLACK (32.0f * EPSILON)

// No determinant so small is told from zero: on zero's sign, and on what is smaller than a normal number, drivers do not agree.
#define TRIANGLE_EDGE_ON 1.0e-36f

typedef struct {
    vec3 a, ba, ac;      // the vertex A, A − B, C − A
    vec3 normal;         // (B − A) × (C − A)
    vfloat size;         // the largest component of the edges
    vfloat unsure;       // twice the error of the determinant, for a direction whose largest component is 1, over TRIANGLE_SLACK
} Triangle;

// What rounding took away from b − a, exactly (Knuth's two-sum), to within its sign.
static vfloat triangle_lost(vfloat a, vfloat b, vfloat difference) {
    const vfloat back = b - difference;
    return absolute((back - a) - ((back + difference) - b));
}

static Triangle triangle_of(vec3 a, vec3 b, vec3 c) {
    Triangle t;
    t.a = a;
    t.ba = sub(a, b);
    t.ac = sub(c, a);
    t.normal = outer(t.ac, t.ba);
    const vfloat size_ba = largest_size(t.ba), size_ac = largest_size(t.ac);
    t.size = greater(size_ba, size_ac);
    // Each component of the normal is off by two roundings of its own, and by the edges' errors times the other edge, twice; the three
    // products of the determinant by three roundings.
    const vfloat lost_ba = largest_size(vec3_of(triangle_lost(b.x, a.x, t.ba.x), triangle_lost(b.y, a.y, t.ba.y), triangle_lost(b.z, a.z, t.ba.z)));
    const vfloat lost_ac = largest_size(vec3_of(triangle_lost(a.x, c.x, t.ac.x), triangle_lost(a.y, c.y, t.ac.y), triangle_lost(a.z, c.z, t.ac.z)));
    const vfloat rounding = (absolute(t.normal.x) + absolute(t.normal.y) + absolute(t.normal.z)) * (5.0f * EPSILON);
    const vfloat edges = fma(lost_ba, size_ac, lost_ac * size_ba) * 6.0f;
    t.unsure = (rounding + edges) * (2.125f / TRIANGLE_SLACK);
    return t;
}

#endif
