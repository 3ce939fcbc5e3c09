// Which of many lights is looked at from a point: a walk down a tree of lights, at every node to the child that is likely to give
// more (Conty Estevez & Kulla, HPG 2018). clrender/scene/light_tree.py builds it.
//
// No light that shines on the point is left out, and what the walk finds with a probability can be asked for that probability again.
#ifndef LIGHT_TREE_H
#define LIGHT_TREE_H

#include "core/exact.h"
#include "core/sampler.h"
#include "scene.h"

// The mean of the positive part of a cosine, of which the mean and the mean square of the deviation are known: exact without any, and
// never 0 with some.
static vfloat tree_positive(vfloat mean, vfloat deviation2) {
    return fma(mean, splat(0.5f), sqrt(fma(mean, mean, deviation2)) * 0.5f);
}

// About what the lights below a child send to a surface with this normal: their power over the distance's square, times how far they
// face the point, and the surface them. `child` is its eight words: centre and radius, mean normal, power.
static vfloat tree_importance(const vfloat child[8], vec3 origin, vec3 normal) {
    const vec3 to = sub(vec3_of(child[0], child[1], child[2]), origin), mean = vec3_of(child[4], child[5], child[6]);
    const vfloat radius2 = child[3] * child[3], power = child[7];
    const vfloat inverse2 = splat(1.0f) / greater(fma(radius2, splat(0.25f), inner(to, to)), splat(1.0e-30f));
    const vfloat inverse = sqrt(inverse2), spread2 = radius2 * inverse2;
    const vfloat facing = tree_positive(-inner(mean, to) * inverse, fma(splat(0.25f), splat(1.0f) - inner(mean, mean), spread2 * 0.1f));
    const vfloat receiving = tree_positive(inner(normal, to) * inverse, spread2 * 0.1f);
    return child[3] < 0.0f ? power : power * facing * receiving * inverse2;
}

// The probability of the first child of a node; negative where neither can give anything.
static vfloat tree_first_probability(const Scene* scene, vuint node, vec3 origin, vec3 normal) {
    vfloat row[16];
    lane_rows(scene->light_nodes, node, row);
    const vfloat first = tree_importance(row, origin, normal), second = tree_importance(row + 8, origin, normal);
    const vfloat both = first + second;
    return both > 0.0f ? first / both : splat(-1.0f);
}

// A light, and the probability with which it was chosen, 0 for none; what is left of the number is as random as new.
static vuint tree_choose(const Scene* scene, vec3 origin, vec3 normal, vuint bits, vuint* rest, vfloat* probability) {
    vuint node = splat_uint(1u);
    vfloat u = unit_interval(bits), chance = splat(1.0f);
    for (uint level = 0; level < scene->settings->light_levels; ++level) {
        const vfloat first = tree_first_probability(scene, node, origin, normal);
        const vmask to_first = u < first;
        const vfloat share = to_first ? first : splat(1.0f) - first;
        u = bounded((to_first ? u : u - first) / greater(share, splat(1.0e-30f)), 0.0f, 0.99999994f);
        chance = first < 0.0f ? splat(0.0f) : chance * share;
        node = node * 2u + (to_first ? splat_uint(0u) : splat_uint(1u));
    }
    // The number had 24 digits, of which the choice has used some up: the last ones are drawn anew.
    const vfloat step = splat(5.9604645e-8f) / greater(chance, splat(5.9604645e-8f));
    u = bounded(fma(unit_interval(hash(bits ^ splat_uint(0x3c6ef372u))), step, u), 0.0f, 0.99999994f);
    *rest = vuint_of(u * 16777216.0f) << 8;
    *probability = chance;
    return vfloat_bits(lane_gather(scene->light_order, node - (1u << scene->settings->light_levels)));
}

// The probability with which tree_choose finds the light at this place of the last level.
static vfloat tree_probability(const Scene* scene, vec3 origin, vec3 normal, vuint place) {
    vfloat chance = splat(1.0f);
    const uint levels = scene->settings->light_levels;
    for (uint level = 0; level < levels; ++level) {
        const vuint node = place >> (levels - level), next = place >> (levels - level - 1);
        const vfloat first = tree_first_probability(scene, node, origin, normal);
        const vfloat share = (next & 1u) == 0u ? first : splat(1.0f) - first;
        chance = first < 0.0f ? splat(0.0f) : chance * share;
    }
    return chance;
}

#endif
