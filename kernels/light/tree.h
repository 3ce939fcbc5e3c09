// Which of many lights is looked at from a point: a walk down a tree of lights, at every node to the child that is likely to give
// more (Conty Estevez & Kulla, HPG 2018). clrender/flatten/light_tree.py builds it.
//
// What is likely may be wrong: of a child whose lights are far apart the walk knows little, and one of them may be beside the point. So
// of sixteen walks one goes by the powers alone, and no light is found more than sixteen times as seldom as by its power.
//
// Lengths in the tree are scaled so that the scene's size is about 1, and powers so that two children's add up to 1: products of both
// remain normal numbers in scenes of any size. Only ratios count.
//
// No light that shines on the point is left out, and what the walk finds with a probability can be asked for that probability again.
#ifndef LIGHT_TREE_H
#define LIGHT_TREE_H

#include "core/exact.h"
#include "core/sampler.h"
#include "scene.h"

// Twice the mean of the positive part of a number, of which the mean and the mean square of the deviation are known: exact without any,
// and never 0 with some.
static vfloat tree_positive(vfloat mean, vfloat deviation2) { return mean + square_root(fma(mean, mean, deviation2)); }

// About what the lights below a child send to a surface with this normal: their power over the distance's square, times how far they
// face the point, and the surface them. The cosines are left as they are, times the distance: so it is `weight` over the square of
// `distance2`, and takes no division. A normal of zero stands for a surface that scatters light from either side, whose cosine
// counts as 1.
typedef struct {
    vfloat weight, distance2;
} TreeImportance;

// `child` is its eight words, NODE_ROW_*; `either` is 1 for such a surface, else 0.
static TreeImportance tree_importance(const vfloat child[8], vec3 origin, vec3 normal, vfloat either) {
    const vec3 to = sub(vec3_row(child, NODE_ROW_CENTER), origin), mean = vec3_row(child, NODE_ROW_NORMAL);
    const vfloat radius = child[NODE_ROW_RADIUS], radius2 = radius * radius, power = child[NODE_ROW_POWER], spread2 = radius2 * 0.1f;
    const vfloat distance2 = fma(radius2, splat(0.25f), inner(to, to));
    // A mean of unit length may be longer by a rounding
    const vfloat differ2 = greater(fma(inner(mean, mean), splat(-0.25f), splat(0.25f)), splat(0.0f));
    const vfloat facing = tree_positive(-inner(mean, to), fma(differ2, distance2, spread2));
    const vfloat receiving = tree_positive(inner(normal, to), fma(either, distance2, spread2));
    const vmask infinite = radius < 0.0f;
    TreeImportance i;
    i.weight = infinite ? power : power * facing * receiving * 0.25f;
    i.distance2 = infinite ? splat(1.0f) : distance2;
    return i;
}

#ifdef LAMPS
// Whether light from below a child can come to a point: its lights lie in a sphere and shine into a cone, CONE_ROW_*. Where it says no
// there is none; the sphere is a little wider than it has to be, as the cone is, for roundings.
static vmask tree_reaches(const vfloat child[8], const vfloat cone[4], vec3 origin) {
    const vec3 center = vec3_row(child, NODE_ROW_CENTER), axis = vec3_row(cone, CONE_ROW_AXIS), to = sub(origin, center);
    const vfloat radius = fma(absolute(center.x) + absolute(center.y) + absolute(center.z), splat(4.0f * EPSILON), child[NODE_ROW_RADIUS] * 1.0005f);
    const vfloat distance = magnitude(to);
    const vmask apart = distance > radius * 1.0005f;
    const vfloat inverse = inverse_or_one(distance);
    // The angle from the axis to the point, and the one that the sphere fills: the cone has to reach their difference
    const vfloat cosine = inner(axis, to) * inverse, sine = magnitude(outer(axis, to)) * inverse;
    const vfloat sphere_sine = apart ? radius * inverse : splat(0.0f), sphere_cosine = root(splat(1.0f) - sphere_sine * sphere_sine);
    const vfloat least = fma(cosine, sphere_cosine, sine * sphere_sine);
    return (child[NODE_ROW_RADIUS] < 0.0f) | !apart | (cosine >= sphere_cosine) | (least >= cone[CONE_ROW_COSINE]);
}
#endif

// The probability of the first child of a node, for walks by what it may give and for those by power alone; the latter is negative where
// neither child can give anything.
typedef struct {
    vfloat given, power;
} TreeShares;

// Written in place: where a function that is always inlined returns a struct, Oclgrind cannot run it.
__attribute__((always_inline)) static void tree_first(const Scene* scene, vuint node, vec3 origin, vec3 normal, TreeShares* shares) {
    vfloat row[16];
    lane_rows(scene->light_nodes, node, row);
    const vmask two_sided = (normal.x == 0.0f) & (normal.y == 0.0f) & (normal.z == 0.0f);
    const vfloat either = two_sided ? splat(1.0f) : splat(0.0f);
    TreeImportance a = tree_importance(row, origin, normal, either), b = tree_importance(row + 8, origin, normal, either);
#ifdef LAMPS
    if (scene_has(scene, HAS_LAMPS)) {
        vfloat cones[8];
        lane_octets(scene->light_cones, node * 8u, cones);
        a.weight = tree_reaches(row, cones, origin) ? a.weight : splat(0.0f);
        b.weight = tree_reaches(row + 8, cones + 4, origin) ? b.weight : splat(0.0f);
    }
#endif
    // The farther one near 1 and the other not too far below it, so that no product is lost
    const vfloat most = greater(a.distance2, b.distance2), near_one = inverse_scale(vec3_of(most, most, most));
    const vfloat distance_a = greater(a.distance2 * near_one, splat(1.0e-12f));
    const vfloat distance_b = greater(b.distance2 * near_one, splat(1.0e-12f));
    const vfloat first = a.weight * near_one * (distance_b * distance_b), second = b.weight * near_one * (distance_a * distance_a);
    const vfloat both = first + second;
    const vmask some_a = a.weight > 0.0f, some_b = b.weight > 0.0f;
    shares->power = some_b ? (some_a ? row[NODE_ROW_POWER] : splat(0.0f)) : some_a ? splat(1.0f) : splat(-1.0f);
    shares->given = both > 0.0f ? quotient(first, both) : shares->power;
}

#define TREE_BY_POWER 0.0625f       // of the walks so many go by power alone: 1/16
#define TREE_REST 1.0666667f        // 16/15

// The way down to a light, for the surface point `origin` with this normal.
typedef struct {
    vec3 origin, normal; // the origin in the tree's lengths
    vuint digits;        // random bits, from which each step draws the digits that its choice used up
    vuint node;          // so far; and what is left of the random number
    vfloat u;
    vmask by_power;
    vfloat given, power; // the probabilities to come here by what lights may give and by power; 0 where no light gives anything
} TreeWalk;

static vec3 tree_place(const Scene* scene, vec3 point) { return scale(point, splat(scene->light_nodes[NODE_ROW_SCALE])); }

// New digits below those that are left of a random number.
static vfloat tree_refill(TreeWalk* walk, vfloat left, float step) {
    walk->digits = walk->digits * 0x2c9277b5u + 0xac564b05u;
    return fma(unit_interval(hash(walk->digits)), splat(step), left);
}

static TreeWalk tree_begin(const Scene* scene, vec3 origin, vec3 normal, vuint bits, vuint digits) {
    TreeWalk walk;
    walk.origin = tree_place(scene, origin);
    walk.normal = normal;
    walk.digits = digits;
    walk.node = splat_uint(1u);
    const vfloat u = unit_interval(bits);
    walk.by_power = u < TREE_BY_POWER;
    const vfloat rest = (u - TREE_BY_POWER) * TREE_REST;
    const vfloat left = tree_refill(&walk, u, 5.9604645e-8f);
    walk.u = bounded(walk.by_power ? left * 16.0f : rest, 0.0f, 0.99999994f);
    walk.given = walk.power = splat(1.0f);
    return walk;
}

// Go on to a child that these are the probabilities of.
static void tree_enter(TreeShares first, vmask to_first, vfloat* given, vfloat* power) {
    const vmask none = first.power < 0.0f;
    *given = none ? splat(0.0f) : *given * (to_first ? first.given : splat(1.0f) - first.given);
    *power = none ? splat(0.0f) : *power * (to_first ? first.power : splat(1.0f) - first.power);
}

static void tree_step(const Scene* scene, TreeWalk* walk) {
    TreeShares shares;
    tree_first(scene, walk->node, walk->origin, walk->normal, &shares);
    const vfloat first = walk->by_power ? shares.power : shares.given;
    const vmask to_first = walk->u < first;
    const vfloat share = to_first ? first : splat(1.0f) - first;
    // The number has 24 digits. What is left of it, as wide as the child's share, is stretched and has fewer: new ones go below them
    const vfloat left = tree_refill(walk, to_first ? walk->u : walk->u - first, 5.9604645e-8f);
    walk->u = bounded(quotient(left, greater(share, splat(1.0e-30f))), 0.0f, 0.99999994f);
    tree_enter(shares, to_first, &walk->given, &walk->power);
    walk->node = walk->node * 2u + (to_first ? splat_uint(0u) : splat_uint(1u));
}

static void tree_descend(const Scene* scene, TreeWalk* walk) {
    for (uint level = 0; level < scene->settings->light_levels; ++level) tree_step(scene, walk);
}

// The light at the end; what is left of the number, `u`, is as random as new.
static vuint tree_end(const Scene* scene, const TreeWalk* walk) {
    return vfloat_bits(lane_gather(scene->light_order, walk->node - (1u << scene->settings->light_levels)));
}

// The probability of a light that walks of either kind find with these.
static vfloat tree_chance(vfloat given, vfloat power) { return fma(given, splat(1.0f - TREE_BY_POWER), power * TREE_BY_POWER); }

// The probability with which such a walk finds the light at this place of the last level.
static vfloat tree_probability(const Scene* scene, vec3 origin, vec3 normal, vuint place) {
    const vec3 at = tree_place(scene, origin);
    vfloat given = splat(1.0f), power = splat(1.0f);
    const uint levels = scene->settings->light_levels;
    for (uint level = 0; level < levels; ++level) {
        const vuint node = place >> (levels - level), next = place >> (levels - level - 1);
        TreeShares shares;
        tree_first(scene, node, at, normal, &shares);
        tree_enter(shares, (next & 1u) == 0u, &given, &power);
    }
    return tree_chance(given, power);
}

#endif
