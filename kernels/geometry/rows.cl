// The tables that shading reads lane by lane, rows of sixteen floats (scene.h), from the arrays of the host.
#include "types.h"

static void rows_put(__global float* row, const float values[16]) {
    for (int k = 0; k < 16; ++k) row[k] = values[k];
}

static void rows_geometry(float row[9], uint primitive, uint triangle_count, __global const float* vertices,
                          __global const uint* triangles, __global const Round* rounds) {
    if (primitive < triangle_count) {
        for (uint k = 0; k < 9; ++k) row[k] = vertices[(size_t)triangles[(size_t)primitive * 3 + k / 3] * 3 + k % 3];
    } else {
        const Round r = rounds[primitive - triangle_count];
        row[0] = r.center_radius.x, row[1] = r.center_radius.y, row[2] = r.center_radius.z, row[3] = r.center_radius.w;
        row[4] = r.normal.x, row[5] = r.normal.y, row[6] = r.normal.z, row[7] = r.normal.w;
        row[8] = 0.0f;
    }
}

__kernel void rows_primitives(__global const float* vertices, __global const uint* triangles, __global const Round* rounds,
                              __global const uint* primitive_shape, uint triangle_count, uint count, __global float* rows) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    float row[16] = {0.0f};
    rows_geometry(row, i, triangle_count, vertices, triangles, rounds);
    row[9] = as_float(primitive_shape[i]);
    rows_put(rows + (size_t)i * 16, row);
}

__kernel void rows_normals(__global const float* normals, __global const uint* triangles, uint count, __global float* rows) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    float row[16] = {0.0f};
    for (uint k = 0; k < 9; ++k) row[k] = normals[(size_t)triangles[(size_t)i * 3 + k / 3] * 3 + k % 3];
    rows_put(rows + (size_t)i * 16, row);
}

__kernel void rows_shapes(__global const Shape* shapes, __global const Material* materials, uint count, __global float* rows) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    const Shape s = shapes[i];
    const Material m = materials[s.material];
    const float row[16] = {m.color.x, m.color.y, m.color.z, m.color.w, as_float(m.kind), m.ior, m.roughness,
                           as_float(s.first_primitive), as_float(s.first_light), as_float(s.flags), 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
    rows_put(rows + (size_t)i * 16, row);
}

// After the six numbers every light has: a triangle's vertices; a sphere's or disk's centre, (radius, facing, 0) and normal; a
// point's position; a directional light's direction.
__kernel void rows_lights(__global const Light* lights, __global const float* vertices, __global const uint* triangles,
                          __global const Round* rounds, uint triangle_count, uint count, __global float* rows,
                          __global float* alias) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    const Light l = lights[i];
    float row[16] = {l.radiance.x, l.radiance.y, l.radiance.z, as_float(l.kind), l.probability, as_float(l.primitive)};
    if (l.kind == LIGHT_AREA_TRIANGLE || l.kind == LIGHT_AREA_SPHERE || l.kind == LIGHT_AREA_DISK) {
        float g[9];
        rows_geometry(g, l.primitive, triangle_count, vertices, triangles, rounds);
        if (l.primitive < triangle_count) {
            for (int k = 0; k < 9; ++k) row[6 + k] = g[k];
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
