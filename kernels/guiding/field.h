// The guiding field: in cells of space, where light that surfaces and media reflect has been found to come from.
//
// An octree over the scene's box; each leaf has a cell for each of six directions that a surface may face, and one for media. A cell has a histogram of
// directions, which is sampled and evaluated, and a few numbers about the light there. The host makes both arrays from sums of training samples
// (clrender/guiding/training.py), and nothing changes them while an image is rendered.
#ifndef GUIDING_FIELD_H
#define GUIDING_FIELD_H

#include "core/exact.h"
#include "core/lane.h"
#include "core/sampler.h"
#include "types.h"

#define FIELD_FACE_MEDIUM 6u

typedef struct {
    __global const uint* nodes;  // [][8]: of an inner node, its octants' nodes, of which leaves have FIELD_LEAF; of a leaf, its cells, or NONE
    __global const uint* cells;  // [][FIELD_WORDS]
    float4 frame;                // the box's lowest corner, and the inverse of its side
} Field;

static vuint field_word(const Field* field, vuint cell, vuint word) {
    const vuint at = cell * FIELD_WORDS + word;
    return LANE_LOOK_UP(uint, field->cells, at);
}
static vfloat field_number(const Field* field, vuint cell, uint word) { return vfloat_from_bits(field_word(field, cell, splat_uint(word))); }

// 0 to 2^FIELD_LEVELS - 1 along an axis; what is outside of the box belongs to its sides.
static vuint field_coordinate(vfloat x, float low, float inverse) {
    const float most = (float)((1u << FIELD_LEVELS) - 1u);
    return vuint_of(vint_of(bounded((x - low) * (inverse * (float)(1u << FIELD_LEVELS)), 0.0f, most)));
}

// Which of the axes a normal is closest to, and on which side.
static vuint field_face(vec3 normal) {
    const vfloat x = absolute(normal.x), y = absolute(normal.y), z = absolute(normal.z);
    const vmask by_x = (x >= y) & (x >= z), by_y = !by_x & (y >= z);
    const vuint axis = by_x ? splat_uint(0u) : (by_y ? splat_uint(2u) : splat_uint(4u));
    return axis + ((by_x ? normal.x : (by_y ? normal.y : normal.z)) < 0.0f ? splat_uint(1u) : splat_uint(0u));
}

// The place in `nodes` of a point's cell, where asked for.
static vuint field_place(const Field* field, vec3 point, vuint face, vmask asked) {
    const vuint x = field_coordinate(point.x, field->frame.x, field->frame.w);
    const vuint y = field_coordinate(point.y, field->frame.y, field->frame.w);
    const vuint z = field_coordinate(point.z, field->frame.z, field->frame.w);
    vuint node = splat_uint(0u);
    vmask inside = asked;
    for (uint level = FIELD_LEVELS; level-- > 0u && lane_any(inside);) {
        const vuint octant = ((x >> level) & 1u) | (((y >> level) & 1u) << 1) | (((z >> level) & 1u) << 2);
        const vuint at = inside ? node * 8u + octant : splat_uint(0u), child = LANE_LOOK_UP(uint, field->nodes, at);
        node = inside ? child & ~FIELD_LEAF : node;
        inside = inside & (child < FIELD_LEAF);
    }
    return node * 8u + face;
}

// Directions are in bins of equal height along z, and in each quadrant around it of equal steps of y / (|x| + |y|). Returns the bin; `steps`: how much
// the latter changes with the angle.
static vuint field_bin(vec3 direction, vfloat* steps) {
    const vfloat around = absolute(direction.x) + absolute(direction.y), part = direction.y * inverse_or_one(around);
    const vfloat turned = direction.x < 0.0f ? splat(2.0f) - part : part;
    const vfloat squared = fma(direction.x, direction.x, direction.y * direction.y);
    *steps = around > 0.0f ? squared * inverse_or_one(around * around) : splat(1.0f);
    const vuint column = vuint_of(vint_of(bounded(fma(turned, splat(4.0f), splat(4.0f)), 0.0f, 15.0f)));
    const vuint row = vuint_of(vint_of(bounded(fma(direction.z, splat(8.0f), splat(8.0f)), 0.0f, 15.0f)));
    return row * 16u + column;
}

// The density of a direction, per steradian. A cell's histogram is of FIELD_BINS equal shares, and says how many each bin has.
static vfloat field_pdf(const Field* field, vuint cell, vec3 direction) {
    vfloat steps;
    const vuint bin = field_bin(direction, &steps);
    const vuint shares = (field_word(field, cell, FIELD_ROW_SHARES + (bin >> 2)) >> ((bin & 3u) * 8u)) & 255u;
    return vfloat_of(vint_from_uint(shares)) * 0.125f * steps;
}

// A direction with this density: of one of the shares, in its bin.
static vec3 field_sample(const Field* field, vuint cell, vuint bits_u, vuint bits_v) {
    const vuint share = bits_u >> 24;
    const vuint bin = (field_word(field, cell, FIELD_ROW_BINS + (share >> 2)) >> ((share & 3u) * 8u)) & 255u;
    const vfloat turned = fma(vfloat_of(vint_from_uint(bin & 15u)) + unit_interval(bits_u << 8), splat(0.25f), splat(-1.0f));
    const vfloat z = fma(vfloat_of(vint_from_uint(bin >> 4)) + unit_interval(bits_v), splat(0.125f), splat(-1.0f));
    const vmask right = turned <= 1.0f;
    const vfloat y = right ? turned : splat(2.0f) - turned, across = splat(1.0f) - absolute(y), x = right ? across : -across;
    const vfloat length = root(fma(-z, z, splat(1.0f))) * inverse_or_one(root(fma(x, x, y * y)));
    return direction_again(vec3_of(x * length, y * length, z));
}

#endif
