// The tables that shading reads lane by lane, rows of sixteen floats (scene.h), from the arrays of the host.
#include "core/exact.h"
#include "scene.h"

static void rows_put(__global float* row, const float values[16]) {
    for (int k = 0; k < 16; ++k) row[k] = values[k];
}

static void rows_geometry(float row[9], uint primitive, uint triangle_count, __global const float* vertices,
                          __global const uint* triangles, __global const AnalyticShape* analytic_shapes) {
    if (primitive < triangle_count) {
        for (uint k = 0; k < 9; ++k) row[k] = vertices[(size_t)triangles[(size_t)primitive * 3 + k / 3] * 3 + k % 3];
    } else {
        const AnalyticShape r = analytic_shapes[primitive - triangle_count];
        row[0] = r.center_radius.x, row[1] = r.center_radius.y, row[2] = r.center_radius.z, row[3] = r.center_radius.w;
        row[4] = r.normal.x, row[5] = r.normal.y, row[6] = r.normal.z, row[7] = r.normal.w;
        row[8] = 0.0f;
    }
}

// Its geometry, then colour, absorption, index of refraction, light or NONE, and the material's kind with the shape's flags above it.
__kernel void rows_primitives(__global const float* vertices, __global const uint* triangles, __global const AnalyticShape* analytic_shapes,
                              __global const uint* primitive_shape, __global const Shape* shapes, __global const Material* materials,
                              uint triangle_count, uint count, __global float* rows) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    const Shape s = shapes[primitive_shape[i]];
    const Material m = materials[s.material];
    const uint light = s.first_light == NONE ? NONE : s.first_light + (i - s.first_primitive);
    float row[16] = {0.0f};
    rows_geometry(row, i, triangle_count, vertices, triangles, analytic_shapes);
    row[9] = m.color.x, row[10] = m.color.y, row[11] = m.color.z;
    row[12] = m.color.w;
    row[13] = m.ior;
    row[14] = as_float(light);
    row[15] = as_float(m.kind | (s.flags << ROW_FLAGS));
    rows_put(rows + (size_t)i * 16, row);
}

__kernel void rows_normals(__global const float* normals, __global const uint* triangles, uint count, __global float* rows) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    float row[16] = {0.0f};
    for (uint k = 0; k < 9; ++k) row[k] = normals[(size_t)triangles[(size_t)i * 3 + k / 3] * 3 + k % 3];
    rows_put(rows + (size_t)i * 16, row);
}

// After the six numbers every light has: a triangle's A, B − A, C − A and one over the length of their cross product, twice the area; a
// sphere's or disk's centre, (radius, facing, 0) and normal; a point's position; a directional light's direction.
__kernel void rows_lights(__global const Light* lights, __global const float* vertices, __global const uint* triangles,
                          __global const AnalyticShape* analytic_shapes, uint triangle_count, uint count, __global float* rows,
                          __global float* alias) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    const Light l = lights[i];
    float row[16] = {l.radiance.x, l.radiance.y, l.radiance.z, as_float(l.kind), l.probability, as_float(l.primitive)};
    if (l.place != NONE) row[4] = as_float(l.place);
    if (l.kind == LIGHT_AREA_TRIANGLE || l.kind == LIGHT_AREA_SPHERE || l.kind == LIGHT_AREA_DISK) {
        float g[9];
        rows_geometry(g, l.primitive, triangle_count, vertices, triangles, analytic_shapes);
        if (l.primitive < triangle_count) {
            const vec3 a = vec3_of(g[0], g[1], g[2]), ab = sub(vec3_of(g[3], g[4], g[5]), a), ac = sub(vec3_of(g[6], g[7], g[8]), a);
            row[6] = a.x, row[7] = a.y, row[8] = a.z;
            row[9] = ab.x, row[10] = ab.y, row[11] = ab.z;
            row[12] = ac.x, row[13] = ac.y, row[14] = ac.z;
            row[15] = inverse_magnitude(outer(ab, ac));
        } else {
            row[6] = g[0], row[7] = g[1], row[8] = g[2];
            row[9] = g[3], row[10] = g[7];
            row[12] = g[4], row[13] = g[5], row[14] = g[6];
        }
    } else {
        row[6] = l.position.x, row[7] = l.position.y, row[8] = l.position.z;
    }
    rows_put(rows + (size_t)i * 16, row);
    alias[i * 2] = l.alias_threshold;
    alias[i * 2 + 1] = as_float(l.alias);
}
