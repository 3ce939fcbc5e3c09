// The pool of samples a work-item works through, and where they go.
#ifndef FILM_POOL_H
#define FILM_POOL_H

#include "core/exact.h"
#include "core/sampler.h"
#include "film/slot.h"
#include "types.h"

// One launch: samples [first_sample, first_sample + sample_count) of slots [first_slot, first_slot + slot_count).
typedef struct {
    __global float* samples;     // radiance: [sample][channel][slot]
    uint first_slot, slot_count;
    uint first_sample, sample_count;
    uint base, end;              // this work-item's slots, counted from first_slot: from the next to hand out on
    uint2 block;                 // top left pixel of the block that the next LANES slots are in
    uint next;                   // the next of the launch's samples of them to hand out
} Pool;

typedef struct {
    vuint slot;                  // counted from first_slot
    vuint number;                // of the sample in this launch
    Sampler sampler;
} PoolSample;

typedef struct {
    uint rays, shadow_rays;
    vuint deepest;
} PoolStats;

// Which of the launch's pools a work-item works through. Some CPU drivers give a thread up to half of all work-items at a time, and pools
// beside each other cost alike: so every stretch of work-items has pools from all over. On a GPU neighbours stay neighbours.
static uint pool_number(void) {
    const uint item = (uint)get_global_id(0);
#if LANES == 1
    return item;
#else
    const uint stretch = (uint)get_global_size(0) / 8;
    return item < stretch * 8 ? item % stretch * 8 + item / stretch : item;
#endif
}

static Pool pool_open(__global const Settings* settings, __global float* samples, uint first_slot, uint slot_count,
                      uint first_sample, uint sample_count) {
    Pool pool;
    pool.samples = samples;
    pool.first_slot = first_slot;
    pool.slot_count = slot_count;
    pool.first_sample = first_sample;
    pool.sample_count = sample_count;
    pool.base = pool_number() * (LANES * PACKETS);
    pool.end = min(pool.base + LANES * PACKETS, slot_count);
    pool.block = slot_block(settings, first_slot + pool.base);
    pool.next = 0;
    return pool;
}

static int pool_empty(const Pool* pool) { return pool->base >= pool->end; }

// The next sample of LANES neighbouring pixels, one in every lane, and its place on the film, (0, 0) top left and (1, 1) bottom right:
// uniform in its pixel. Returns which of the pixels are in the image.
static vmask pool_take(__global const Settings* settings, Pool* pool, PoolSample* sample, vfloat* film_x, vfloat* film_y) {
    vuint x, y;
    vfloat u, v;
    sample->slot = pool->base + lane_index();
    sample->number = splat_uint(pool->next);
    const vmask inside = slot_pixel(settings, pool->block, pool->first_slot + sample->slot, &x, &y);
    sample->sampler = sampler_start(settings->seed, y * settings->width + x, pool->first_sample + sample->number);
    sampler_get(sample->sampler, SET_PIXEL, &u, &v);
    *film_x = (vfloat_of(vint_from_uint(x)) + u) / (float)settings->width;
    *film_y = (vfloat_of(vint_from_uint(y)) + v) / (float)settings->height;
    if (++pool->next == pool->sample_count) {
        pool->next = 0;
        pool->base += LANES;
        pool->block = slot_block(settings, pool->first_slot + pool->base);
    }
    return inside & (sample->slot < pool->slot_count);
}

static void pool_deliver(const Pool* pool, const PoolSample* sample, vec3 radiance, vmask done) {
    int is_done[LANES];
    uint slot[LANES], number[LANES];
    float x[LANES], y[LANES], z[LANES];
    lane_store(done, is_done);
    lane_store(sample->slot, slot);
    lane_store(sample->number, number);
    lane_store(radiance.x, x);
    lane_store(radiance.y, y);
    lane_store(radiance.z, z);
    for (int lane = 0; lane < LANES; ++lane) {
        if (!is_done[lane]) continue;
        const size_t channels = pool->slot_count;
        __global float* out = pool->samples + (size_t)number[lane] * 3 * channels + slot[lane];
        out[0] = x[lane];
        out[channels] = y[lane];
        out[2 * channels] = z[lane];
    }
}

// Add to the sample that each of the work-item's own slots already has.
static void pool_add(const Pool* pool, uint number, vec3 radiance, vmask where) {
    int is_there[LANES];
    float x[LANES], y[LANES], z[LANES];
    lane_store(where, is_there);
    lane_store(radiance.x, x);
    lane_store(radiance.y, y);
    lane_store(radiance.z, z);
    for (int lane = 0; lane < LANES; ++lane) {
        if (!is_there[lane]) continue;
        const size_t channels = pool->slot_count;
        __global float* out = pool->samples + (size_t)number * 3 * channels + pool->base + lane;
        out[0] += x[lane];
        out[channels] += y[lane];
        out[2 * channels] += z[lane];
    }
}

static vuint pool_deepest(vuint deepest, vuint depth, vmask counted) {
    return counted & (depth > deepest) ? depth : deepest;
}

#endif
