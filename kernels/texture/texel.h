// Texels. All pictures of a scene lie one after the other in tiles of 64 bytes, a line of memory: 8 by 8 texels of one byte, 4 by 4 of
// four, 2 by 2 of sixteen (clrender/image/texel_tiles.py). Row 0 of a picture is its top. Tile numbers are 32 bits wide, addresses are not.
//
// What does not fit into a device's largest buffer is cut into as many as four pages (-D TEXEL_PAGE_BITS, of tile numbers).
#ifndef TEXTURE_TEXEL_H
#define TEXTURE_TEXEL_H

#include "core/lane.h"
#include "scene.h"

// A texture's row (types.h, TEXTURE_ROW_*).
typedef struct {
    vfloat row[16];
    vuint width, height, format;
} Texture;

typedef struct {
    vfloat r, g, b, a;
} Texel;

static Texture texture_at(const Scene* scene, vuint texture) {
    Texture t;
    lane_rows(scene->texture_rows, texture, t.row);
    t.width = vfloat_bits(t.row[TEXTURE_ROW_WIDTH]);
    t.height = vfloat_bits(t.row[TEXTURE_ROW_HEIGHT]);
    t.format = vfloat_bits(t.row[TEXTURE_ROW_FORMAT]);
    return t;
}

static __global const uint* texel_tile(const Scene* scene, uint tile) {
#ifdef TEXEL_PAGE_BITS
    const uint page = tile >> TEXEL_PAGE_BITS;
    __global const uint* texels = page == 0u ? scene->texels_0 : page == 1u ? scene->texels_1 : page == 2u ? scene->texels_2 : scene->texels_3;
    return texels + (size_t)(tile & ((1u << TEXEL_PAGE_BITS) - 1u)) * 16;
#else
    return scene->texels_0 + (size_t)tile * 16;
#endif
}

// One texel: the numbers of 8 and 16 bits stand for what tables say, which are exact.
static float4 texel_one(const Scene* scene, uint tile, uint byte, uint format, uint values, uint alphas) {
    __global const uint* at = texel_tile(scene, tile) + (byte >> 2);
    __global const float* value = scene->texel_values + values;
    __global const float* alpha = scene->texel_values + alphas;
    const uint bytes = 1u << (format & 7u);
    if ((format & TEXEL_FOUR) == 0u) {
        const uint bits = (at[0] >> ((byte & 3u) * 8u)) & (bytes == 1u ? 0xffu : 0xffffu);
        const float grey = (format & TEXEL_FLOAT) ? as_float(at[0]) : value[bits];
        return (float4)(grey, grey, grey, 1.0f);
    }
    if (format & TEXEL_FLOAT) return (float4)(as_float(at[0]), as_float(at[1]), as_float(at[2]), as_float(at[3]));
    if (bytes == 4u) return (float4)(value[at[0] & 0xffu], value[(at[0] >> 8) & 0xffu], value[(at[0] >> 16) & 0xffu], alpha[at[0] >> 24]);
    return (float4)(value[at[0] & 0xffffu], value[at[0] >> 16], value[at[1] & 0xffffu], alpha[at[1] >> 16]);
}

#ifndef TEXEL_PAGE_BITS
// Four numbers of 8 bits each, in every lane that is active: what nearly all pictures hold. One page has 2^32 words at most, which the host
// sees to, so that their addresses have 32 bits.
static Texel texel_four_bytes(const Scene* scene, const Texture* t, vuint tile, vuint byte, vmask active) {
    const vuint bits = vfloat_bits(lane_gather((__global const float*)scene->texels_0, active ? tile * 16u + (byte >> 2) : splat_uint(0u)));
    const vuint values = active ? vfloat_bits(t->row[TEXTURE_ROW_VALUES]) : splat_uint(0u);
    const vuint alphas = active ? vfloat_bits(t->row[TEXTURE_ROW_ALPHAS]) : splat_uint(0u);
    Texel texel;
    texel.r = active ? lane_gather(scene->texel_values, values + (bits & 0xffu)) : splat(0.0f);
    texel.g = active ? lane_gather(scene->texel_values, values + ((bits >> 8) & 0xffu)) : splat(0.0f);
    texel.b = active ? lane_gather(scene->texel_values, values + ((bits >> 16) & 0xffu)) : splat(0.0f);
    texel.a = active ? lane_gather(scene->texel_values, alphas + (bits >> 24)) : splat(0.0f);
    return texel;
}
#endif

// The texel at column x and row y of each lane's picture; zero where the lane is not active.
static Texel texel_load(const Scene* scene, const Texture* t, vuint x, vuint y, vmask active) {
    const vuint size = t->format & 7u, down = (6u - size) >> 1, across = 6u - size - down;
    const vuint one = splat_uint(1u), columns = (t->width + (one << across) - 1u) >> across;
    const vuint in_tile = ((y & ((one << down) - 1u)) << across) | (x & ((one << across) - 1u));
    const vuint tile_number = vfloat_bits(t->row[TEXTURE_ROW_FIRST]) + (y >> down) * columns + (x >> across);
#ifndef TEXEL_PAGE_BITS
    if (!lane_any(active & ((t->format & (7u | TEXEL_FOUR | TEXEL_FLOAT)) != (2u | TEXEL_FOUR))))
        return texel_four_bytes(scene, t, tile_number, in_tile << size, active);
#endif
    uint tile[LANES], byte[LANES], format[LANES], values[LANES], alphas[LANES];
    int is_active[LANES];
    float r[LANES], g[LANES], b[LANES], a[LANES];
    lane_store(tile_number, tile);
    lane_store(in_tile << size, byte);
    lane_store(t->format, format);
    lane_store(vfloat_bits(t->row[TEXTURE_ROW_VALUES]), values);
    lane_store(vfloat_bits(t->row[TEXTURE_ROW_ALPHAS]), alphas);
    lane_store(active, is_active);
    for (int lane = 0; lane < LANES; ++lane) {
        float4 texel = (float4)(0.0f);
        if (is_active[lane]) texel = texel_one(scene, tile[lane], byte[lane], format[lane], values[lane], alphas[lane]);
        r[lane] = texel.x, g[lane] = texel.y, b[lane] = texel.z, a[lane] = texel.w;
    }
    Texel all;
    all.r = lane_restore(r), all.g = lane_restore(g), all.b = lane_restore(b), all.a = lane_restore(a);
    return all;
}

#endif
