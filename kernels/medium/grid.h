// Media whose density varies from place to place: a grid of numbers by which their coefficients are multiplied, linear in between (trilinear).
//
// Light's way through one is a random walk over tentative collisions (Woodcock et al. 1965). They come as often as if the density were the
// largest around, its majorant, and each is a real collision with the probability of the density there over the majorant. The grid is cut into
// bricks, each of which has a majorant of its own, and a walk goes from brick to brick (PBR 4ed, 11.4.4); those that are empty it crosses in one
// step. How much of a light arrives is estimated along the same walk, by the product of what each tentative collision leaves (ratio
// tracking: Novák et al. 2014).
//
// How many random numbers a walk takes is not known before. They are hashed from the ray and counted, so that they depend on nothing else.
//
// Colours scatter at different rates, but their ratio is the same everywhere. A walk goes by the coefficient of one channel, and weighs
// with the densities that it would have had by each, the balance heuristic over channels (PBR 4ed, 14.2.2).
//
// Built only where a scene has such media (-D GRIDS).
#ifndef MEDIUM_GRID_H
#define MEDIUM_GRID_H

#include "core/sampler.h"
#include "geometry/ray.h"
#include "scene.h"

#ifdef GRIDS

#define GRID_NO_DIRECTION 1.0e-20f      // of a component, below which the ray does not get on along that axis
#define GRID_FAINT 0.1f                 // what is left of a light, below which Russian roulette ends walks to it
#define GRID_SURVIVAL 0.25f

// A walk through a grid. Coordinates count its values, from half a step before the first on: the value number i is at i + 1, and one more
// surrounds the grid on all sides.
typedef struct {
    vec3 origin, direction;      // of the ray
    vec3 inverse;                // 1 over each component
    vec3 bricks;                 // how many there are along each axis
    vec3 brick;                  // in which the walk is
    vfloat side;                 // steps along a brick
    vuint table, values;         // words where the bricks' entries and the values begin
    vfloat at, leaves, end;      // distances along the ray: of the walk, where it leaves the brick, and the grid
    vfloat majorant;             // of the brick
    vuint data;                  // where its values begin
    vuint seed;
} GridWalk;

static vfloat grid_floor(vfloat x) { return vfloat_of(vint_of(x)); }      // of what is not below 0
static vfloat grid_inverse(vfloat d) {
    const vmask none = absolute(d) < GRID_NO_DIRECTION;
    return none ? with_sign(splat(1.0f / GRID_NO_DIRECTION), d) : quotient(splat(1.0f), none ? splat(1.0f) : d);
}

// Where the ray leaves the brick along one axis.
static vfloat grid_exit(vfloat brick, vfloat side, vfloat origin, vfloat inverse) {
    return (fma(brick + (inverse > 0.0f ? splat(1.0f) : splat(0.0f)), side, -origin)) * inverse;
}

// What is known of the brick, where the walk is in one.
static void grid_read_brick(const Scene* scene, GridWalk* w, vmask where) {
    const vfloat number = fma(fma(w->brick.z, w->bricks.y, w->brick.y), w->bricks.x, w->brick.x);
    const vuint entry = where ? w->table + vuint_from_int(vint_of(number)) * 2u : splat_uint(0u);
    w->data = where ? w->values + vfloat_bits(lane_gather(scene->grid_words, entry)) : w->data;
    w->majorant = where ? lane_gather(scene->grid_words, entry + 1u) : w->majorant;
    const vfloat x = grid_exit(w->brick.x, w->side, w->origin.x, w->inverse.x), y = grid_exit(w->brick.y, w->side, w->origin.y, w->inverse.y);
    const vfloat z = grid_exit(w->brick.z, w->side, w->origin.z, w->inverse.z);
    const vfloat leaves = greater(w->at, lesser(lesser(x, lesser(y, z)), w->end));
    w->leaves = where ? leaves : w->leaves;
}

// To the next brick; false where there is none.
static vmask grid_next_brick(const Scene* scene, GridWalk* w, vmask where) {
    const vfloat x = grid_exit(w->brick.x, w->side, w->origin.x, w->inverse.x), y = grid_exit(w->brick.y, w->side, w->origin.y, w->inverse.y);
    const vfloat z = grid_exit(w->brick.z, w->side, w->origin.z, w->inverse.z);
    const vmask by_x = (x <= y) & (x <= z), by_y = !by_x & (y <= z);
    const vfloat step_x = w->inverse.x > 0.0f ? splat(1.0f) : splat(-1.0f), step_y = w->inverse.y > 0.0f ? splat(1.0f) : splat(-1.0f);
    const vfloat step_z = w->inverse.z > 0.0f ? splat(1.0f) : splat(-1.0f);
    w->brick.x = where & by_x ? w->brick.x + step_x : w->brick.x;
    w->brick.y = where & by_y ? w->brick.y + step_y : w->brick.y;
    w->brick.z = where & !(by_x | by_y) ? w->brick.z + step_z : w->brick.z;
    const vmask lower = (w->brick.x >= 0.0f) & (w->brick.y >= 0.0f) & (w->brick.z >= 0.0f);
    const vmask within = lower & (w->brick.x < w->bricks.x) & (w->brick.y < w->bricks.y) & (w->brick.z < w->bricks.z);
    const vmask goes_on = where & within & (w->at < w->end);
    grid_read_brick(scene, w, goes_on);
    return goes_on;
}

// The grid of a medium, whose place is `head`, and a ray through it; where the ray meets it the walk may begin, and elsewhere it is not used.
static vmask grid_enter(const Scene* scene, vuint head, vec3 origin, vec3 direction, vfloat limit, vmask where, GridWalk* w) {
    vfloat row[16], more[16];
    const vuint at = where ? head : splat_uint(0u);
    lane_rows(scene->grid_rows, at, row);
    lane_rows(scene->grid_rows, at + 1u, more);
    const vec3 x = vec3_row(row, GRID_ROW_X), y = vec3_row(row, GRID_ROW_Y), z = vec3_row(row, GRID_ROW_Z);
    w->origin = vec3_of(inner(x, origin) + row[GRID_ROW_X + 3], inner(y, origin) + row[GRID_ROW_Y + 3], inner(z, origin) + row[GRID_ROW_Z + 3]);
    w->direction = vec3_of(inner(x, direction), inner(y, direction), inner(z, direction));
    w->inverse = vec3_of(grid_inverse(w->direction.x), grid_inverse(w->direction.y), grid_inverse(w->direction.z));
    w->side = row[GRID_ROW_SIDE];
    w->bricks = vec3_row(more, GRID_ROW_BRICKS - 16);
    w->table = vfloat_bits(more[GRID_ROW_TABLE - 16]);
    w->values = vfloat_bits(more[GRID_ROW_VALUES - 16]);
    const vec3 high = vec3_row(row, GRID_ROW_HIGH);
    const vfloat low_x = (0.5f - w->origin.x) * w->inverse.x, low_y = (0.5f - w->origin.y) * w->inverse.y, low_z = (0.5f - w->origin.z) * w->inverse.z;
    const vfloat high_x = (high.x - w->origin.x) * w->inverse.x, high_y = (high.y - w->origin.y) * w->inverse.y;
    const vfloat high_z = (high.z - w->origin.z) * w->inverse.z;
    const vfloat first = greater(greater(lesser(low_x, high_x), lesser(low_y, high_y)), greater(lesser(low_z, high_z), splat(0.0f)));
    const vfloat last = lesser(lesser(greater(low_x, high_x), greater(low_y, high_y)), lesser(greater(low_z, high_z), limit));
    const vmask meets = where & (first < last);
    w->at = first;
    w->leaves = w->end = last;
    const vfloat per_side = quotient(splat(1.0f), meets ? w->side : splat(1.0f));
    const vec3 entry = scale(along(w->origin, w->direction, meets ? first : splat(0.0f)), per_side);
    w->brick.x = meets ? grid_floor(lesser(greater(entry.x, splat(0.0f)), w->bricks.x - 1.0f)) : splat(0.0f);
    w->brick.y = meets ? grid_floor(lesser(greater(entry.y, splat(0.0f)), w->bricks.y - 1.0f)) : splat(0.0f);
    w->brick.z = meets ? grid_floor(lesser(greater(entry.z, splat(0.0f)), w->bricks.z - 1.0f)) : splat(0.0f);
    w->majorant = splat(0.0f);
    w->data = splat_uint(0u);
    grid_read_brick(scene, w, meets);

    // Whose random numbers these are
    const vuint from = hash_pair(hash_pair(vfloat_bits(origin.x), vfloat_bits(origin.y)), vfloat_bits(origin.z));
    const vuint to = hash_pair(hash_pair(vfloat_bits(direction.x), vfloat_bits(direction.y)), vfloat_bits(direction.z));
    w->seed = hash_pair(hash_pair(from, to), splat_uint(scene->settings->seed));
    return meets;
}

// The density where the walk is, at most the majorant but for roundings.
static vfloat grid_density(const Scene* scene, const GridWalk* w, vmask where) {
    const vec3 at = along(w->origin, w->direction, w->at);
    const vfloat zero = splat(0.0f), last = w->side - 1.0f;
    const vfloat x = lesser(greater(fma(w->brick.x, -w->side, at.x), zero), w->side), y = lesser(greater(fma(w->brick.y, -w->side, at.y), zero), w->side);
    const vfloat z = lesser(greater(fma(w->brick.z, -w->side, at.z), zero), w->side);
    const vfloat i = lesser(grid_floor(x), last), j = lesser(grid_floor(y), last), k = lesser(grid_floor(z), last);
    const vuint line = vuint_from_int(vint_of(w->side)) + 1u, sheet = line * line;
    const vuint cell = (vuint_from_int(vint_of(k)) * line + vuint_from_int(vint_of(j))) * line + vuint_from_int(vint_of(i));
    const vuint corner = where ? w->data + cell : splat_uint(0u), right = where ? line : splat_uint(0u), up = where ? sheet : splat_uint(0u);
    __global const float* values = scene->grid_words;
    const vuint one = where ? splat_uint(1u) : splat_uint(0u);
    const vfloat a = lane_gather(values, corner), b = lane_gather(values, corner + one);
    const vfloat c = lane_gather(values, corner + right), d = lane_gather(values, corner + right + one);
    const vfloat e = lane_gather(values, corner + up), f = lane_gather(values, corner + up + one);
    const vfloat g = lane_gather(values, corner + up + right), h = lane_gather(values, corner + up + right + one);
    const vfloat tx = x - i, ty = y - j, tz = z - k;
    const vfloat ab = fma(b - a, tx, a), cd = fma(d - c, tx, c), ef = fma(f - e, tx, e), gh = fma(h - g, tx, g);
    const vfloat lower = fma(cd - ab, ty, ab), upper = fma(gh - ef, ty, ef);
    return fma(upper - lower, tz, lower);
}

// Go on to the next tentative collision, at this coefficient times the majorant; false where the walk gets through before. `passed`: the
// integral of the majorant along the way, which grows.
static vmask grid_seek(const Scene* scene, GridWalk* w, vfloat coefficient, vfloat depth, vfloat* passed, vmask where) {
    vmask seeks = where, found = mask_none();
    while (lane_any(seeks)) {
        const vfloat way = w->leaves - w->at, rest = w->majorant * way, needed = coefficient * rest;
        const vmask here = seeks & (depth < needed), moves = seeks & !here;
        if (lane_any(here)) {
            const vfloat step = quotient(depth, here ? coefficient * w->majorant : splat(1.0f));
            w->at = here ? lesser(w->at + step, w->leaves) : w->at;
            *passed = here ? fma(w->majorant, lesser(step, way), *passed) : *passed;
        }
        depth = moves ? depth - needed : depth;
        *passed = moves ? *passed + rest : *passed;
        w->at = moves ? w->leaves : w->at;
        found = found | here;
        seeks = lane_any(moves) ? grid_next_brick(scene, w, moves) : mask_none();
    }
    return found;
}

// Two random numbers of a walk's tentative collision number n: one over an exponential scale, and the second in [0, 1).
static vfloat grid_depth(const GridWalk* w, uint n) { return minus_log_of_bits(hash(w->seed ^ hash(splat_uint(2u * n + 1u)))); }
static vfloat grid_chance(const GridWalk* w, uint n) { return unit_interval(hash(w->seed ^ hash(splat_uint(2u * n + 2u)))); }

// Where the medium that is there has a grid; and the place of its head.
static vmask grid_fills(const vfloat* row) { return (vfloat_bits(row[MEDIUM_ROW_FLAGS]) & MEDIUM_FLAG_GRID) != 0u; }
static vuint grid_head(const vfloat* row) { return vfloat_bits(row[MEDIUM_ROW_GRID]); }

// What is left of light, by channel, after a way through the grid with these coefficients; of a unit direction.
static vec3 grid_transmittance(const Scene* scene, vuint head, vec3 coefficients, vec3 origin, vec3 direction, vfloat distance, vmask where) {
    GridWalk w;
    vec3 left = vec3_all(1.0f);
    const vfloat most = largest(coefficients);
    vmask walks = grid_enter(scene, head, origin, direction, distance, where & (most > 0.0f), &w);
    const vec3 ratio = scale(coefficients, inverse_or_one(most));
    vfloat unused = splat(0.0f);
    for (uint n = 0; lane_any(walks); ++n) {
        walks = grid_seek(scene, &w, most, grid_depth(&w, n), &unused, walks);
        if (!lane_any(walks)) break;
        const vfloat share = lesser(grid_density(scene, &w, walks) * inverse_or_one(w.majorant), splat(1.0f));
        const vec3 passes = vec3_of(fma(-share, ratio.x, splat(1.0f)), fma(-share, ratio.y, splat(1.0f)), fma(-share, ratio.z, splat(1.0f)));
        left = choose(walks, mul(left, passes), left);
        const vmask faint = walks & (largest(left) < GRID_FAINT), ends = faint & (grid_chance(&w, n) >= GRID_SURVIVAL);
        left = choose(faint, choose(ends, vec3_all(0.0f), scale(left, splat(1.0f / GRID_SURVIVAL))), left);
        walks = walks & !ends & (largest(left) > 0.0f);
    }
    return left;
}

// Where a path through the grid scatters before it has gone so far, and by what its throughput changes on the way, without the share that
// is scattered. `share`: of each channel, how often the walk goes by it.
typedef struct {
    vmask scatters;
    vfloat distance;
    vec3 weight;
} GridEvent;

static GridEvent grid_travel(const Scene* scene, vuint head, vec3 extinction, vec3 share, vec3 origin, vec3 direction, vfloat distance, vmask where) {
    GridWalk w;
    GridEvent event;
    event.scatters = mask_none();
    event.distance = distance;
    event.weight = vec3_all(1.0f);
    vmask walks = grid_enter(scene, head, origin, direction, distance, where, &w);
    if (!lane_any(walks)) return event;
    const vfloat u = unit_interval(hash(w.seed ^ 0x68e31da4u));
    const vfloat chosen = u < share.x ? extinction.x : u < share.x + share.y ? extinction.y : extinction.z;
    const vfloat most = largest(extinction), least = lesser(extinction.x, lesser(extinction.y, extinction.z));
    const vmask colored = walks & (most > least);
    const vec3 ratio = scale(extinction, inverse_or_one(most)), excess = vec3_of(extinction.x - least, extinction.y - least, extinction.z - least);
    vec3 densities = vec3_all(1.0f);     // of the walk by each channel, relative to the largest
    vfloat passed = splat(0.0f);
    for (uint n = 0; lane_any(walks); ++n) {
        const vmask meets = grid_seek(scene, &w, chosen, grid_depth(&w, n), &passed, walks);
        if (!lane_any(meets)) break;
        const vmask real = meets & (grid_chance(&w, n) * w.majorant < grid_density(scene, &w, meets));
        event.scatters = event.scatters | real;
        event.distance = real ? w.at : event.distance;
        if (lane_any(meets & colored)) {
            const vec3 left = vec3_of(exp_minus(excess.x * passed), exp_minus(excess.y * passed), exp_minus(excess.z * passed));
            const vec3 next = mul(densities, mul(left, ratio));
            densities = choose(meets & colored, scale(next, inverse_or_one(largest(next))), densities);
            passed = meets ? splat(0.0f) : passed;
        }
        walks = meets & !real;
    }
    if (lane_any(colored)) {
        const vec3 left = vec3_of(exp_minus(excess.x * passed), exp_minus(excess.y * passed), exp_minus(excess.z * passed));
        densities = choose(event.scatters, densities, mul(densities, left));
        event.weight = choose(colored, scale(densities, inverse_or_one(inner(share, densities))), event.weight);
    }
    return event;
}

// The density at a point, for weights.
static vfloat grid_density_at(const Scene* scene, vuint head, vec3 point, vmask where) {
    GridWalk w;
    const vmask within = grid_enter(scene, head, point, vec3_of(splat(1.0f), splat(0.0f), splat(0.0f)), splat(FAR), where, &w);
    if (!lane_any(within)) return splat(0.0f);
    const vmask here = within & !(w.at > 0.0f);
    return here ? grid_density(scene, &w, here) : splat(0.0f);
}

#endif

#endif
