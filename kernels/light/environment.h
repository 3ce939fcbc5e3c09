// Light from infinitely far all around: the same radiance everywhere, or a picture of it.
//
// The picture is in latitude and longitude. Between the centres of its pixels radiance is interpolated linearly in the longitude and in
// the cosine of the angle from the pole, so that a piece of the picture has the solid angle dφ d(cosθ): the radiance is then a bilinear
// function by solid angle, too, and can be sampled in exact proportion to its luminance, without a Jacobian. Beyond the centres of the
// first and of the last row it does not change along a meridian.
//
// sample: by inversion of the marginal distribution over latitudes, then of the conditional one along the latitude (PBR 4ed, 2.4.2 and
// A.5.2, there for constant cells), which is a mixture of those of two rows of pixels: numbers up to the first one's share go
// round along it, the others once more along the second, so that neighbouring random numbers give neighbouring directions. pdf: luminance over
// its integral, per steradian. Where BSDF samples find the environment, too, light samples leave what is darker than the mean to them: the
// luminance counts as far as it is above it (Karlik, Sik, Vevoda, Skrivan, Krivanek, "MIS compensation", ACM TOG 38(6), 2019).
#ifndef LIGHT_ENVIRONMENT_H
#define LIGHT_ENVIRONMENT_H

#include "core/search.h"
#include "core/warp.h"
#include "scene.h"
#include "spectral/color.h"

typedef struct {
    vec3 direction;      // unit, towards the light
    vec3 radiance;       // from there
    vfloat pdf;          // per steradian
} EnvironmentSample;

// The same light from everywhere.
static EnvironmentSample environment_even(vec3 radiance, vec3 direction) {
    EnvironmentSample s;
    s.direction = direction;
    s.radiance = radiance;
    s.pdf = splat(WARP_SPHERE_PDF);
    return s;
}

#ifdef ENVIRONMENT_MAP

// scene->environment_map (clrender/flatten/environment.py writes it): a row of numbers, ENVIRONMENT_ROW_*. Then a row for each band
// between two neighbouring lines of latitude, which are both poles and the centres of the rows of pixels: BAND_ROW_*. Then the rows of
// pixels, three words each: the sum of the luminance from the first pixel's centre to this one's, and the radiance; the first pixel once
// more stands at the end.
//
// Both distributions have guide tables (Chen and Asau, "On generating random variates from an empirical distribution", AIIE Transactions
// 6(2), 1974): entry k of n says what is found for k/n, so that the search for a number from k/n to (k + 1)/n has few steps or none.
typedef struct {
    uint width, height;
    uint band_guides, guides;        // entries of the guide table of the bands, and of each row's; powers of two
    __global const float *bands, *band_guide, *pixels, *guide;
} EnvironmentMap;

// A point of the map, between two lines and between the centres of two columns.
typedef struct {
    vuint line, column;  // the first of each two
    vfloat down, right;  // how far from them, 0 to 1
} EnvironmentPlace;

// What of such a point the first steps of a sample choose.
typedef struct {
    EnvironmentPlace place;          // line and down
    vfloat drop_before, drop_after;  // of its band: BAND_ROW_DROP
    vmask below;                     // of the two lines it is the second one
    vuint row;                       // of pixels, of that line
    vfloat sought;                   // the sum of the luminance along it that lies before the point
    vuint entry;                     // of its guide table
    vuint first, last;               // the columns that this says
} EnvironmentChoice;

// Two neighbouring pixels of a row, and the sums of the luminance up to each of them.
typedef struct {
    vec3 left, right;
    vfloat left_sum, right_sum;
} EnvironmentPair;

// Those at the corners of such a piece.
typedef struct {
    EnvironmentPair upper, lower;
} EnvironmentCorners;

static uint environment_word(const Scene* scene, uint word) { return as_uint(scene->environment_map[word]); }

static EnvironmentMap environment_map_of(const Scene* scene) {
    EnvironmentMap map;
    map.width = environment_word(scene, ENVIRONMENT_ROW_WIDTH);
    map.height = environment_word(scene, ENVIRONMENT_ROW_HEIGHT);
    map.band_guides = environment_word(scene, ENVIRONMENT_ROW_BAND_GUIDES);
    map.guides = environment_word(scene, ENVIRONMENT_ROW_GUIDES);
    const size_t height = map.height, length = (size_t)map.width + 1;
    map.bands = scene->environment_map + 16;
    map.band_guide = map.bands + (height + 1) * 8;
    map.pixels = map.band_guide + map.band_guides + 1;
    map.guide = map.pixels + height * length * 3;
    return map;
}

// From a to b, neither of them negative, without a difference: beside the sun a pixel keeps its digits.
static vfloat between(vfloat a, vfloat b, vfloat share) { return fma(b, share, a * (splat(1.0f) - share)); }
static vec3 vec3_between(vec3 a, vec3 b, vfloat share) {
    return vec3_of(between(a.x, b.x, share), between(a.y, b.y, share), between(a.z, b.z, share));
}

// What samples are in proportion to, at a pixel: its luminance, or how far this is above the mean.
static vfloat environment_weight(const Scene* scene, vec3 pixel) {
    const vfloat luminance = fma(pixel.x, splat(0.2126f), fma(pixel.y, splat(0.7152f), pixel.z * 0.0722f));
    return greater(luminance - scene->environment_map[ENVIRONMENT_ROW_COMPENSATION], splat(0.0f));
}

// The row that a line of latitude lies on; a pole has that of the row beside it.
static vuint environment_row(const EnvironmentMap* map, vuint line) {
    const vuint row = line > 0u ? line - 1u : splat_uint(0u);
    return row < map->height ? row : splat_uint(map->height - 1u);
}

// A pixel: three mantissas of 19 bits that share an exponent of 7 (compare Ward, "Real Pixels", 1991).
static vec3 environment_pixel(vuint low, vuint high) {
    const vfloat unit_of_it = vfloat_from_bits(((high >> 25) + (127u - 64u)) << 23);
    const vuint green = (low >> 19) | ((high & 0x3fu) << 13);
    return scale(vec3_of(vfloat_of(vint_from_uint(low & 0x7ffffu)), vfloat_of(vint_from_uint(green)),
                         vfloat_of(vint_from_uint((high >> 6) & 0x7ffffu))), unit_of_it);
}

// Where a pixel's words begin.
static vuint environment_at(const EnvironmentMap* map, vuint row, vuint column) { return (row * (map->width + 1u) + column) * 3u; }

// The pixel of a row in this column, and the next.
static EnvironmentPair environment_pair(const EnvironmentMap* map, vuint row, vuint column) {
    vfloat words[8];
    lane_octets(map->pixels, environment_at(map, row, column), words);
    EnvironmentPair p;
    p.left_sum = words[0], p.right_sum = words[3];
    p.left = environment_pixel(vfloat_bits(words[1]), vfloat_bits(words[2]));
    p.right = environment_pixel(vfloat_bits(words[4]), vfloat_bits(words[5]));
    return p;
}

static EnvironmentCorners environment_corners(const EnvironmentMap* map, vuint line, vuint column) {
    EnvironmentCorners c;
    c.upper = environment_pair(map, environment_row(map, line), column);
    c.lower = environment_pair(map, environment_row(map, line + 1u), column);
    return c;
}

static vec3 environment_between(const EnvironmentCorners* c, vfloat down, vfloat right) {
    return vec3_between(vec3_between(c->upper.left, c->lower.left, down), vec3_between(c->upper.right, c->lower.right, down), right);
}

// The density with which that point is sampled.
static vfloat environment_density(const Scene* scene, const EnvironmentCorners* c, vfloat down, vfloat right) {
    const vfloat upper = between(environment_weight(scene, c->upper.left), environment_weight(scene, c->upper.right), right);
    const vfloat lower = between(environment_weight(scene, c->lower.left), environment_weight(scene, c->lower.right), right);
    return between(upper, lower, down) * scene->environment_map[ENVIRONMENT_ROW_INVERSE];
}

// Where a direction of any length points to. Lines are counted from the nearer pole, from which 1 − |cosine| has all its digits.
static EnvironmentPlace environment_place(const Scene* scene, const EnvironmentMap* map, vec3 direction) {
    const vfloat sine2 = fma(direction.x, direction.x, direction.z * direction.z), up = absolute(direction.y);
    const vfloat across2 = sine2 < 1.0e-30f ? splat(0.0f) : sine2;           // drivers do not agree about the smallest numbers
    const vfloat size = square_root(fma(direction.y, direction.y, across2));
    const vfloat drop = across2 * inverse_or_one(size * (size + up));
    const vuint nearer = vuint_from_int(vint_of(fma(turn_of(up, square_root(across2)), splat(2.0f * (float)map->height), splat(0.5f))));
    const vuint line = nearer < map->height / 2u ? nearer : splat_uint(map->height / 2u);
    vfloat band[8];
    lane_octets(map->bands, line * 8u, band);
    const vfloat before = band[BAND_ROW_DROP], after = band[BAND_ROW_NEXT_DROP];
    const vfloat down = bounded(quotient(drop - before, after - before), 0.0f, 1.0f);
    const vmask south = direction.y < 0.0f;
    EnvironmentPlace place;
    place.line = south ? map->height - line : line;
    place.down = south ? splat(1.0f) - down : down;

    const float width = (float)map->width;
    const vfloat turned = turn_of(-direction.z, direction.x) + scene->environment_map[ENVIRONMENT_ROW_TURN];
    const vfloat at = fma(turned < 1.0f ? turned : turned - 1.0f, splat(width), splat(-0.5f));
    const vfloat column = at < 0.0f ? at + width : at;
    const vuint whole = vuint_from_int(vint_of(column));
    place.column = whole < map->width ? whole : splat_uint(map->width - 1u);
    place.right = bounded(column - vfloat_of(vint_from_uint(place.column)), 0.0f, 1.0f);
    return place;
}

// The direction to it; the drops are those of its band, in the south of the one that mirrors it.
static vec3 environment_direction(const Scene* scene, const EnvironmentMap* map, EnvironmentPlace place, vfloat drop_before, vfloat drop_after) {
    const vmask south = place.line * 2u > map->height;
    const vfloat drop = between(drop_before, drop_after, south ? splat(1.0f) - place.down : place.down);
    const vfloat across = root(drop * (splat(2.0f) - drop)), up = splat(1.0f) - drop;
    const vfloat column = vfloat_of(vint_from_uint(place.column)) + (place.right + 0.5f);
    const vfloat turned = quotient(column, splat((float)map->width)) - scene->environment_map[ENVIRONMENT_ROW_TURN];
    const vfloat below_one = turned < 1.0f ? turned : turned - 1.0f;
    vfloat c, s;
    cos_sin_turn(below_one < 0.0f ? below_one + 1.0f : below_one, &c, &s);
    return vec3_of(across * s, south ? -up : up, -(across * c));
}

// Where the integral of a linear function from a to b over [0, 1] reaches its share p (PBR 4ed, A.4.2, of the two roots the stable one).
static vfloat environment_linear(vfloat a, vfloat b, vfloat p) {
    const vfloat inverse = inverse_or_one(greater(a, b)), a1 = a * inverse, b1 = b * inverse;
    const vfloat below = a1 + root(between(a1 * a1, b1 * b1, p));
    return bounded(p * (a1 + b1) * inverse_or_one(below), 0.0f, 1.0f);
}

// What a guide table says: the first and the last place that a search has to look at.
static void environment_guided(__global const float* guide, vuint entry, vuint* first, vuint* last) {
    *first = vfloat_bits(lane_gather(guide, entry));
    *last = vfloat_bits(lane_gather(guide, entry + 1u));
}

static vuint environment_entry(vfloat part, uint entries) { return vuint_from_int(vint_of(part * (float)entries)); }

// Without a picture: the two numbers.
static EnvironmentChoice environment_anywhere(vfloat u, vfloat v) {
    EnvironmentChoice c = {{splat_uint(0u), splat_uint(0u), u, v}};
    return c;
}

// A sample takes three steps. The first two ask for the memory that the next one reads, so that other packets can take theirs meanwhile.
//
// First, choose the latitude, between two lines, by all light there, and of the two lines one.
static EnvironmentChoice environment_choose_line(const Scene* scene, vfloat u, vfloat v) {
    if (!scene_has(scene, HAS_ENVIRONMENT_MAP)) return environment_anywhere(u, v);
    const EnvironmentMap map = environment_map_of(scene);
    vuint first, last;
    environment_guided(map.band_guide, environment_entry(u, map.band_guides), &first, &last);
    const vuint line = search_last(map.bands, splat_uint(BAND_ROW_SHARE), 8u, u, first, last);
    vfloat band[8];
    lane_octets(map.bands, line * 8u, band);
    const vfloat share = band[BAND_ROW_SHARE], sum = band[BAND_ROW_SUM], next_sum = band[BAND_ROW_NEXT_SUM];
    EnvironmentChoice c;
    c.place.line = line;
    c.place.down = environment_linear(sum, next_sum, (u - share) * inverse_or_one(band[BAND_ROW_NEXT_SHARE] - share));
    c.drop_before = band[BAND_ROW_DROP], c.drop_after = band[BAND_ROW_NEXT_DROP];

    // Take one of them by its share of the light along that latitude, and with what is left of the random number a part of its light
    const vfloat upper_light = sum * (splat(1.0f) - c.place.down), lower_light = next_sum * c.place.down;
    const vfloat at = v * (upper_light + lower_light);
    c.below = (at >= upper_light) & (lower_light > 0.0f);
    const vfloat before = c.below ? upper_light : splat(0.0f), of_it = c.below ? lower_light : upper_light;
    const vfloat part = bounded((at - before) * inverse_or_one(of_it), 0.0f, 1.0f - EPSILON);
    c.sought = part * (c.below ? next_sum : sum);
    c.row = environment_row(&map, line + (c.below ? splat_uint(1u) : splat_uint(0u)));
    c.entry = c.row * (map.guides + 1u) + environment_entry(part, map.guides);
    lane_prefetch(map.guide, c.entry);
    return c;
}

// Then look up about where along that line.
static void environment_guide(const Scene* scene, EnvironmentChoice* c) {
    if (!scene_has(scene, HAS_ENVIRONMENT_MAP)) return;
    const EnvironmentMap map = environment_map_of(scene);
    environment_guided(map.guide, c->entry, &c->first, &c->last);
    lane_prefetch(map.pixels, environment_at(&map, environment_row(&map, c->place.line), c->first));
    lane_prefetch(map.pixels, environment_at(&map, environment_row(&map, c->place.line + 1u), c->first));
}

// And choose where exactly. `mean` is the radiance of all directions.
static EnvironmentSample environment_sample_chosen(const Scene* scene, vec3 mean, const EnvironmentChoice* c) {
    if (!scene_has(scene, HAS_ENVIRONMENT_MAP)) return environment_even(mean, warp_sphere(c->place.down, c->place.right));
    const EnvironmentMap map = environment_map_of(scene);
    EnvironmentPlace place = c->place;
    place.column = search_last(map.pixels, environment_at(&map, c->row, splat_uint(0u)), 3u, c->sought, c->first, c->last);
    const EnvironmentCorners corners = environment_corners(&map, place.line, place.column);
    const vfloat left = c->below ? corners.lower.left_sum : corners.upper.left_sum;
    const vfloat right = c->below ? corners.lower.right_sum : corners.upper.right_sum;
    const vfloat at_left = environment_weight(scene, choose(c->below, corners.lower.left, corners.upper.left));
    const vfloat at_right = environment_weight(scene, choose(c->below, corners.lower.right, corners.upper.right));
    place.right = environment_linear(at_left, at_right, (c->sought - left) * inverse_or_one(right - left));
    EnvironmentSample s;
    s.direction = environment_direction(scene, &map, place, c->drop_before, c->drop_after);
    s.radiance = color_light(scene, environment_between(&corners, place.down, place.right));
    s.pdf = environment_density(scene, &corners, place.down, place.right);
    return s;
}

// The sample that a direction of any length would be.
static EnvironmentSample environment_along(const Scene* scene, vec3 mean, vec3 direction) {
    if (!scene_has(scene, HAS_ENVIRONMENT_MAP)) return environment_even(mean, direction);
    const EnvironmentMap map = environment_map_of(scene);
    const EnvironmentPlace place = environment_place(scene, &map, direction);
    const EnvironmentCorners corners = environment_corners(&map, place.line, place.column);
    EnvironmentSample s;
    s.direction = direction;
    s.radiance = color_light(scene, environment_between(&corners, place.down, place.right));
    s.pdf = environment_density(scene, &corners, place.down, place.right);
    return s;
}

#else

typedef struct {
    vfloat u, v;
} EnvironmentChoice;

static EnvironmentChoice environment_choose_line(const Scene* scene, vfloat u, vfloat v) {
    EnvironmentChoice c;
    c.u = u, c.v = v;
    return c;
}
static void environment_guide(const Scene* scene, EnvironmentChoice* c) {}
static EnvironmentSample environment_sample_chosen(const Scene* scene, vec3 mean, const EnvironmentChoice* c) {
    return environment_even(mean, warp_sphere(c->u, c->v));
}
static EnvironmentSample environment_along(const Scene* scene, vec3 mean, vec3 direction) { return environment_even(mean, direction); }

#endif

static EnvironmentSample environment_sample(const Scene* scene, vec3 mean, vfloat u, vfloat v) {
    EnvironmentChoice choice = environment_choose_line(scene, u, v);
    environment_guide(scene, &choice);
    return environment_sample_chosen(scene, mean, &choice);
}

#endif
