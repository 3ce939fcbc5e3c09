// Colours of a medium that vary from place to place: by which its scattering and its emission are multiplied. Numbers of a table in space, trilinear,
// which keeps those at its edges beyond them. Where it has temperatures, each stands for a colour of a second table.
//
// Built only where a scene has media with a grid (-D GRIDS).
#ifndef MEDIUM_GRID_COLORS_H
#define MEDIUM_GRID_COLORS_H

#include "core/power.h"
#include "medium/grid.h"
#include "spectral/color.h"

#ifdef GRIDS

// A coordinate in such a table: the number before it, and how far from there to the next.
typedef struct {
    vuint before;
    vfloat share;
} GridPlace;

static GridPlace grid_place(vfloat coordinate, vfloat last) {
    GridPlace p;
    const vfloat within = greater(lesser(coordinate, last), splat(0.0f)), whole = lesser(grid_floor(within), greater(last - 1.0f, splat(0.0f)));
    p.before = vuint_from_int(vint_of(whole));
    p.share = within - whole;
    return p;
}

// Between two numbers of a table that stand `step` words apart.
static vfloat grid_between(__global const float* words, vuint at, vuint step, vfloat share) {
    const vfloat a = lane_gather(words, at), b = lane_gather(words, at + step);
    return fma(b - a, share, a);
}

// What the table whose first row this is has at a point. Lanes that do not ask get numbers of some other.
static vec3 grid_colors_at(const Scene* scene, vuint table, vec3 point, vmask where) {
    vfloat row[16], more[16];
    const vuint at = where ? table : splat_uint(0u);
    lane_rows(scene->grid_rows, at, row);
    lane_rows(scene->grid_rows, at + 1u, more);
    const vec3 x = vec3_row(row, GRID_COLORS_ROW_X), y = vec3_row(row, GRID_COLORS_ROW_Y), z = vec3_row(row, GRID_COLORS_ROW_Z);
    const vec3 last = choose(where, vec3_row(row, GRID_COLORS_ROW_LAST), vec3_all(0.0f));
    const GridPlace i = grid_place(inner(x, point) + row[GRID_COLORS_ROW_X + 3], last.x), j = grid_place(inner(y, point) + row[GRID_COLORS_ROW_Y + 3], last.y);
    const GridPlace k = grid_place(inner(z, point) + row[GRID_COLORS_ROW_Z + 3], last.z);
    const vuint channels = where ? vfloat_bits(row[GRID_COLORS_ROW_CHANNELS]) : splat_uint(1u);
    const vuint width = vuint_from_int(vint_of(last.x)) + 1u, height = vuint_from_int(vint_of(last.y)) + 1u;
    const vuint right = last.x > 0.0f ? channels : splat_uint(0u), down = last.y > 0.0f ? channels * width : splat_uint(0u);
    const vuint up = last.z > 0.0f ? channels * width * height : splat_uint(0u);
    const vuint values = where ? vfloat_bits(more[GRID_COLORS_ROW_VALUES - 16]) : splat_uint(0u);
    const vuint first = values + ((k.before * height + j.before) * width + i.before) * channels;
    __global const float* words = scene->grid_words;
    vfloat found[3];
    for (uint channel = 0; channel < 3; ++channel) {
        const vuint begin = first + (channels == 3u ? splat_uint(channel) : splat_uint(0u));
        const vfloat a = grid_between(words, begin, right, i.share), b = grid_between(words, begin + down, right, i.share);
        const vfloat c = grid_between(words, begin + up, right, i.share), d = grid_between(words, begin + up + down, right, i.share);
        const vfloat lower = fma(b - a, j.share, a), upper = fma(d - c, j.share, c);
        found[channel] = fma(upper - lower, k.share, lower);
        if (channel == 0 && !lane_any(channels == 3u)) {
            found[1] = found[2] = found[0];
            break;
        }
    }
    vec3 colors = vec3_of(found[0], found[1], found[2]);
    const vuint of_numbers = where ? vfloat_bits(more[GRID_COLORS_ROW_COLORS - 16]) : splat_uint(0u);
    const vmask stands = of_numbers != 0u;
    if (lane_any(stands)) {
        const vfloat heat = (found[0] - more[GRID_COLORS_ROW_COLOR_OFFSET - 16]) * more[GRID_COLORS_ROW_COLOR_SCALE - 16];
        const vmask warm = stands & (heat > 1.0f);
        const vfloat place = log2_of(warm ? heat : splat(1.0f)) * (float)COLORS_PER_DOUBLING;
        const GridPlace c = grid_place(place, stands ? more[GRID_COLORS_ROW_COLOR_LAST - 16] : splat(1.0f));
        const vuint begin = of_numbers + c.before * 3u, three = splat_uint(3u);
        const vec3 color = vec3_of(grid_between(words, begin, three, c.share), grid_between(words, begin + 1u, three, c.share),
                                   grid_between(words, begin + 2u, three, c.share));
        colors = choose(stands, choose(warm, color, vec3_all(0.0f)), colors);
    }
    return colors;
}

// At a point of the medium with this grid, where it scatters: multiplies its albedo and what it sends out.
static void grid_colors(const Scene* scene, vuint head, vec3 point, vmask where, vec3* albedo, vec3* emission) {
    if (!lane_any(where)) return;
    vfloat more[16];
    lane_rows(scene->grid_rows, where ? head + 1u : splat_uint(0u), more);
    const vuint of_albedo = vfloat_bits(more[GRID_ROW_ALBEDO - 16]);
    const vmask has_albedo = where & (of_albedo != 0u);
    if (lane_any(has_albedo)) *albedo = choose(has_albedo, mul(*albedo, color_reflectance(scene, grid_colors_at(scene, of_albedo, point, has_albedo))), *albedo);
#ifdef GLOWING_MEDIA
    const vuint of_emission = vfloat_bits(more[GRID_ROW_EMISSION - 16]);
    const vmask has_emission = where & (of_emission != 0u);
    if (lane_any(has_emission)) *emission = choose(has_emission, mul(*emission, color_unbounded(scene, grid_colors_at(scene, of_emission, point, has_emission))), *emission);
#endif
}

#endif

#endif
