// The tables that shading reads lane by lane, rows of sixteen floats (scene.h), from the arrays of the host.
#include "core/exact.h"
#include "scene.h"

static void rows_put(__global float* row, const float values[16]) {
    for (int k = 0; k < 16; ++k) row[k] = values[k];
}

static void rows_vector(float* to, float4 v) { to[0] = v.x, to[1] = v.y, to[2] = v.z; }

// The first nine numbers of a primitive's row.
static void rows_geometry(float* row, uint primitive, uint triangle_count, __global const float* vertices,
                          __global const uint* triangles, __global const AnalyticShape* analytic_shapes) {
    if (primitive < triangle_count) {
        for (uint k = 0; k < 9; ++k) row[k] = vertices[(size_t)triangles[(size_t)primitive * 3 + k / 3] * 3 + k % 3];
    } else {
        const AnalyticShape r = analytic_shapes[primitive - triangle_count];
        rows_vector(row + PRIMITIVE_ROW_CENTER, r.center_radius);
        rows_vector(row + PRIMITIVE_ROW_NORMAL, r.normal);
        row[PRIMITIVE_ROW_RADIUS] = r.center_radius.w;
        row[PRIMITIVE_ROW_FACING] = r.normal.w;
    }
}

// PRIMITIVE_ROW_* of types.h.
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
    rows_vector(row + PRIMITIVE_ROW_COLOR, m.color);
    if (m.kind == MATERIAL_BY_ROW) row[PRIMITIVE_ROW_MATERIAL] = as_float(m.row);
    row[PRIMITIVE_ROW_TERMINATION] = m.color.w;
    row[PRIMITIVE_ROW_IOR] = m.ior;
    row[PRIMITIVE_ROW_LIGHT] = as_float(light);
    row[PRIMITIVE_ROW_KIND] = as_float(m.kind | (s.flags << ROW_FLAGS) | (m.medium << ROW_MEDIUM));
    rows_put(rows + (size_t)i * 16, row);
}

// NORMAL_ROW_*. Meshes are found whose normals are turned against the triangles, all or some: there the triangles' say which side is
// the front, and all three are turned round.
__kernel void rows_normals(__global const float* normals, __global const float* vertices, __global const uint* triangles, uint count,
                           __global float* rows) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    float row[16] = {0.0f}, corners[9];
    for (uint k = 0; k < 9; ++k) row[k] = normals[(size_t)triangles[(size_t)i * 3 + k / 3] * 3 + k % 3];
    for (uint k = 0; k < 9; ++k) corners[k] = vertices[(size_t)triangles[(size_t)i * 3 + k / 3] * 3 + k % 3];
    const vec3 a = vec3_row(corners, PRIMITIVE_ROW_A), ab = sub(vec3_row(corners, PRIMITIVE_ROW_B), a);
    const vec3 front = outer(ab, sub(vec3_row(corners, PRIMITIVE_ROW_C), a));
    const vec3 sum = add(vec3_row(row, NORMAL_ROW_A), add(vec3_row(row, NORMAL_ROW_B), vec3_row(row, NORMAL_ROW_C)));
    const float turned = inner(sum, scale(front, inverse_scale(front))) < 0.0f ? -1.0f : 1.0f;
    for (uint k = 0; k < 9; ++k) row[k] *= turned;
    rows_put(rows + (size_t)i * 16, row);
}

// LIGHT_ROW_*, and the alias table: threshold and alias of each light.
__kernel void rows_lights(__global const Light* lights, __global const float* vertices, __global const uint* triangles,
                          __global const AnalyticShape* analytic_shapes, uint triangle_count, uint count, __global float* rows,
                          __global float* alias) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    const Light l = lights[i];
    float row[16] = {0.0f};
    rows_vector(row + LIGHT_ROW_RADIANCE, l.radiance);
    row[LIGHT_ROW_KIND] = as_float(l.kind | (l.texture << LIGHT_TEXTURE));
    row[LIGHT_ROW_PROBABILITY] = l.probability;
    if (l.place != NONE) row[LIGHT_ROW_PLACE] = as_float(l.place);
    row[LIGHT_ROW_PRIMITIVE] = as_float(l.primitive == NONE ? NONE : l.primitive + l.offset);
    if (l.kind == LIGHT_AREA_TRIANGLE || l.kind == LIGHT_AREA_SPHERE || l.kind == LIGHT_AREA_DISK) {
        float g[9] = {0.0f};
        rows_geometry(g, l.primitive, triangle_count, vertices, triangles, analytic_shapes);
        if (l.primitive < triangle_count) {
            const vec3 a = vec3_row(g, PRIMITIVE_ROW_A), ab = sub(vec3_row(g, PRIMITIVE_ROW_B), a), ac = sub(vec3_row(g, PRIMITIVE_ROW_C), a);
            vec3_row_put(row, LIGHT_ROW_A, a);
            vec3_row_put(row, LIGHT_ROW_AB, ab);
            vec3_row_put(row, LIGHT_ROW_AC, ac);
            row[LIGHT_ROW_INVERSE] = inverse_magnitude(outer(ab, ac));
        } else {
            vec3_row_put(row, LIGHT_ROW_CENTER, vec3_row(g, PRIMITIVE_ROW_CENTER));
            row[LIGHT_ROW_RADIUS] = g[PRIMITIVE_ROW_RADIUS];
            row[LIGHT_ROW_FACING] = g[PRIMITIVE_ROW_FACING];
            vec3_row_put(row, LIGHT_ROW_NORMAL, vec3_row(g, PRIMITIVE_ROW_NORMAL));
        }
    } else {
        rows_vector(row + LIGHT_ROW_POSITION, l.position);
        rows_vector(row + LIGHT_ROW_AXIS, l.axis);
    }
    if (l.kind == LIGHT_SPOT) row[LIGHT_ROW_SPREAD] = l.axis.w, row[LIGHT_ROW_STEEPNESS] = l.zero.w;
    if (l.kind == LIGHT_IES || l.kind == LIGHT_PROJECTOR) {
        rows_vector(row + LIGHT_ROW_ZERO, l.zero);
        row[LIGHT_ROW_TABLE] = as_float(l.table);
    }
    rows_put(rows + (size_t)i * 16, row);
    alias[i * 2] = l.alias_threshold;
    alias[i * 2 + 1] = as_float(l.alias);
}
