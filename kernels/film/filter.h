// Pixel filters by importance sampling: a sample's place about its pixel is drawn in proportion to the filter's absolute value, so that all
// samples of a pixel count alike but for the sign (PBR 4ed, 8.8). No sample is anybody else's, so that pixels stay independent.
//
// A filter is the product of the same even function along x and along y. From the centre outwards that function is a chain of straight
// lines, whose integral is inverted exactly; clrender/image/pixel_filter.py makes the table of them.
//
// Built only where it is asked for (-D PIXEL_FILTER): a box is what the random numbers are anyway. -D PIXEL_FILTER_NEGATIVE beside it
// where the function is negative somewhere.
#ifndef FILM_FILTER_H
#define FILM_FILTER_H

#include "core/exact.h"
#include "types.h"

#ifdef PIXEL_FILTER

// From the pixel's centre, pixels: from a number u in [0, 1), rising with it. And where the function is negative there.
static vfloat filter_offset(__global const Settings* settings, vfloat u, vmask* negative) {
    __global const float* lines = settings->filter_lines;
    const vfloat side = fma(u, splat(2.0f), splat(-1.0f)), share = absolute(side);
    vuint line = splat_uint(0u);
    for (uint step = FILTER_LINES / 2u; step > 0u; step /= 2u)
        line = lane_gather(lines, (line + step) * 4u + FILTER_LINE_BEFORE) <= share ? line + step : line;
    const vuint at = line * 4u;
    const vfloat rest = share - lane_gather(lines, at + FILTER_LINE_BEFORE);
    const vfloat begin = lane_gather(lines, at + FILTER_LINE_PLACE), height = lane_gather(lines, at + FILTER_LINE_HEIGHT);
    const vfloat slope = lane_gather(lines, at + FILTER_LINE_SLOPE);
    // height t + slope t² / 2 = rest, in the form that subtracts nothing
    const vfloat t = (rest + rest) * inverse_or_one(height + root(fma(height, height, (slope + slope) * rest)));
    *negative = line >= settings->filter_negative;
    return side < 0.0f ? -(begin + t) : begin + t;
}

// The density of that, in either direction from the centre, and whether the function is negative there.
static vfloat filter_density(__global const Settings* settings, vfloat offset, vmask* negative) {
    __global const float* lines = settings->filter_lines;
    const vfloat place = absolute(offset);
    vuint line = splat_uint(0u);
    for (uint step = FILTER_LINES / 2u; step > 0u; step /= 2u)
        line = lane_gather(lines, (line + step) * 4u + FILTER_LINE_PLACE) <= place ? line + step : line;
    const vuint at = line * 4u;
    const vfloat beyond = place - lane_gather(lines, at + FILTER_LINE_PLACE);
    const vfloat height = fma(lane_gather(lines, at + FILTER_LINE_SLOPE), beyond, lane_gather(lines, at + FILTER_LINE_HEIGHT));
    *negative = line >= settings->filter_negative;
    return place < settings->filter_radius ? greater(height, splat(0.0f)) * 0.5f : splat(0.0f);
}

// Two random numbers become a place, counted from the pixel's top left corner. Returns where the filter is negative.
static vmask filter_place(__global const Settings* settings, vfloat* u, vfloat* v) {
    vmask across, down;
    *u = filter_offset(settings, *u, &across) + 0.5f;
    *v = filter_offset(settings, *v, &down) + 0.5f;
    return (across & !down) | (!across & down);
}

#endif

#endif
