// Splats: what a path from a light adds to the pixel it is seen in, whichever that is. Any work-item adds to any pixel, in any order; the sums are
// exact (film/fixed.h), by atomic additions of 32-bit words that carry, so that their bits do not depend on it.
#ifndef FILM_SPLAT_H
#define FILM_SPLAT_H

#include "core/exact.h"
#include "film/filter.h"
#include "film/fixed.h"
#include "film/slot.h"
#include "types.h"

typedef struct {
    __global uint* sums;         // [slot][3][4], the lowest word first
    uint first_slot, slot_count;
#ifdef SPLATS_LISTED
    __global uint* listed;       // their number, and from SPLAT_WORDS on a row for each of the first `most`, in any order
    uint most;
#endif
} Splats;

// Where splats go that a camera sees at this place of its film, and by what factor they count there: pixels whose filter reaches there share them,
// each by chance as often as its filter says.
typedef struct {
    vuint slot;                  // counted from the first one; slot_count and more: not of these
    vfloat weight;
} SplatPlace;

#ifdef PIXEL_FILTER
// Of the pixels along one axis one, whose number may be negative or too large; the place is in pixels. `weight` is the sum of all filters there,
// with the sign of the chosen one.
static vint splat_choose(__global const Settings* settings, vfloat place, vfloat u, vfloat* weight) {
    const float radius = settings->filter_radius;
    const vfloat first = floor(place - radius - 0.5f);
    const uint count = (uint)(2.0f * radius) + 3u;
    vmask negative;
    vfloat sum = splat(0.0f);
    for (uint k = 0; k < count; ++k) sum = sum + filter_density(settings, first + (float)k + 0.5f - place, &negative);
    const vfloat sought = u * sum;
    vfloat before = splat(0.0f), sign = splat(1.0f), chosen = first;
    for (uint k = 0; k < count; ++k) {
        const vfloat density = filter_density(settings, first + (float)k + 0.5f - place, &negative);
        const vmask here = (density > 0.0f) & (before <= sought);
        chosen = here ? first + (float)k : chosen;
        sign = here ? (negative ? splat(-1.0f) : splat(1.0f)) : sign;
        before = before + density;
    }
    *weight = sum * sign;
    return vint_of(chosen);
}
#endif

static SplatPlace splat_place(__global const Settings* settings, const Splats* splats, int wraps, vfloat film_x, vfloat film_y, vfloat u, vfloat v) {
    const float width = (float)settings->width, height = (float)settings->height;
    const vfloat x = film_x * width, y = film_y * height;
    // Far beyond the film nothing is seen, and numbers may have no integer
    const vmask near = (x > -64.0f) & (x < width + 64.0f) & (y > -64.0f) & (y < height + 64.0f);
    const vfloat at_x = near ? x : splat(0.0f), at_y = near ? y : splat(0.0f);
    SplatPlace place;
#ifdef PIXEL_FILTER
    vfloat across, down;
    vint row = splat_choose(settings, at_y, v, &down);
    vfloat from = at_x;
    if (wraps) {
        // Beyond a pole the film goes on on the other side
        const vint rows = (vint)((int)settings->height);
        const vmask beyond = (row < 0) | (row >= rows);
        row = row < 0 ? -1 - row : (row >= rows ? 2 * rows - 1 - row : row);
        const vfloat turned = at_x + 0.5f * width;
        from = beyond ? (turned < width ? turned : turned - width) : at_x;
    }
    vint column = splat_choose(settings, from, u, &across);
    if (wraps) {
        const vint columns = (vint)((int)settings->width);
        column = column < 0 ? column + columns : (column >= columns ? column - columns : column);
    }
    place.weight = across * down * settings->filter_weight;
#else
    const vint column = vint_of(floor(at_x)), row = vint_of(floor(at_y));
    place.weight = splat(1.0f);
#endif
    const vint crop_column = column - (vint)((int)settings->left), crop_row = row - (vint)((int)settings->top);
    const vmask inside = near & (crop_column >= 0) & (crop_row >= 0) & (crop_column < (int)slot_columns(settings)) & (crop_row < (int)slot_rows(settings));
    const vuint slot = slot_of(settings, inside ? vuint_from_int(crop_column) : splat_uint(0u), inside ? vuint_from_int(crop_row) : splat_uint(0u));
    const vuint of_these = slot - splats->first_slot;
    place.slot = inside & (slot >= splats->first_slot) ? of_these : splat_uint(NONE);
    return place;
}

static void splat_add_words(volatile __global uint* sum, Fixed term, int negative) {
    const uint words[4] = {(uint)term.low, (uint)(term.low >> 32), (uint)term.high, (uint)(term.high >> 32)};
    uint carry = 0;
    for (uint k = 0; k < 4u; ++k) {
        const uint word = words[k] + carry;
        carry = word < carry;                            // then it is zero, and there is nothing else to add here
        if (word == 0) continue;
        const uint before = negative ? atomic_sub(sum + k, word) : atomic_add(sum + k, word);
        carry += negative ? before < word : before + word < word;
    }
}

#ifdef SPLATS_LISTED
// Write down what is added: by which light path, and with which MIS weight.
static void splat_list(const Splats* splats, uint path, uint depth, float weight, const float color[3]) {
    const uint at = atomic_inc((volatile __global uint*)splats->listed);
    if (at >= splats->most) return;
    __global uint* row = splats->listed + (size_t)(at + 1u) * SPLAT_WORDS;
    row[SPLAT_ROW_PATH] = path;
    row[SPLAT_ROW_DEPTH] = depth;
    row[SPLAT_ROW_WEIGHT] = as_uint(weight);
    for (uint c = 0; c < 3u; ++c) row[SPLAT_ROW_COLOR + c] = as_uint(color[c]);
}
#endif

// `path`, `depth` and `weight`: the light path, the scattering events before its vertex, and the MIS weight.
static void splat_add(const Splats* splats, vuint slot, vec3 radiance, vmask where, vuint path, vuint depth, vfloat weight) {
    int is_there[LANES];
    uint at[LANES];
    float value[3][LANES];
    lane_store(where, is_there);
    lane_store(slot, at);
    lane_store(radiance.x, value[0]);
    lane_store(radiance.y, value[1]);
    lane_store(radiance.z, value[2]);
#ifdef SPLATS_LISTED
    uint number[LANES], events[LANES];
    float counts[LANES];
    lane_store(path, number);
    lane_store(depth, events);
    lane_store(weight, counts);
#endif
    for (int lane = 0; lane < LANES; ++lane) {
        if (!is_there[lane]) continue;
        if (!(fixed_representable(value[0][lane]) && fixed_representable(value[1][lane]) && fixed_representable(value[2][lane]))) continue;
        for (int c = 0; c < 3; ++c)
            splat_add_words(splats->sums + ((size_t)at[lane] * 3 + c) * 4, fixed_of(value[c][lane]), as_uint(value[c][lane]) >> 31);
#ifdef SPLATS_LISTED
        const float color[3] = {value[0][lane], value[1][lane], value[2][lane]};
        splat_list(splats, number[lane], events[lane], counts[lane], color);
#endif
    }
}

#endif
