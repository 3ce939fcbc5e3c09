// The pool of samples a work-item works through, and where they go.
#ifndef FILM_POOL_H
#define FILM_POOL_H

#include "core/exact.h"
#include "core/sampler.h"
#include "film/filter.h"
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
#ifdef PIXEL_FILTER_NEGATIVE
    float weight;                // of a sample where the filter is positive
#endif
} Pool;

// Beside a sample's number: the filter is negative at its place.
#define POOL_NEGATIVE 0x80000000u

typedef struct {
    vuint slot;                  // counted from first_slot
    vuint number;                // of the sample in this launch; may have the bit POOL_NEGATIVE
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

// `base`: where its slots begin, counted from first_slot.
static Pool pool_open_at(__global const Settings* settings, __global float* samples, uint first_slot, uint slot_count, uint first_sample,
                         uint sample_count, uint base) {
    Pool pool;
    pool.samples = samples;
    pool.first_slot = first_slot;
    pool.slot_count = slot_count;
    pool.first_sample = first_sample;
    pool.sample_count = sample_count;
    pool.base = base;
    pool.end = min(pool.base + LANES * PACKETS, slot_count);
    pool.block = slot_block(settings, first_slot + pool.base);
    pool.next = 0;
#ifdef PIXEL_FILTER_NEGATIVE
    pool.weight = settings->filter_weight;
#endif
    return pool;
}

static Pool pool_open(__global const Settings* settings, __global float* samples, uint first_slot, uint slot_count, uint first_sample,
                      uint sample_count) {
    return pool_open_at(settings, samples, first_slot, slot_count, first_sample, sample_count, pool_number() * (LANES * PACKETS));
}

static int pool_empty(const Pool* pool) { return pool->base >= pool->end; }

// The next sample of LANES neighbouring pixels, one in every lane, and its place on the film, (0, 0) top left and (1, 1) bottom right:
// uniform in its pixel, or as the filter has it, which may reach beyond the film. Returns which of the pixels are in the image.
static vmask pool_take(__global const Settings* settings, Pool* pool, PoolSample* sample, vfloat* film_x, vfloat* film_y) {
    vuint x, y;
    vfloat u, v;
    sample->slot = pool->base + lane_index();
    sample->number = splat_uint(pool->next);
    const vmask inside = slot_pixel(settings, pool->block, pool->first_slot + sample->slot, &x, &y);
    const uint number = pool->first_sample + pool->next, replicate = sampler_replicate(number, settings->replicate_spp);
    const uint index = sampler_within(number, settings->replicate_spp);
    const vuint column = x + settings->left, row = y - slot_view_top(settings, pool->block) + settings->top;
    sample->sampler = sampler_start_in(settings->seed, replicate, row * settings->width + column, splat_uint(index));
    sampler_get(sample->sampler, SET_PIXEL, &u, &v);
#ifdef PIXEL_FILTER
    const vmask negative = filter_place(settings, &u, &v);
#endif
#ifdef PIXEL_FILTER_NEGATIVE
    sample->number = negative ? sample->number | POOL_NEGATIVE : sample->number;
#endif
    *film_x = quotient(vfloat_of(vint_from_uint(column)) + u, splat((float)settings->width));
    *film_y = quotient(vfloat_of(vint_from_uint(row)) + v, splat((float)settings->height));
    if (++pool->next == pool->sample_count) {
        pool->next = 0;
        pool->base += LANES;
        pool->block = slot_block(settings, pool->first_slot + pool->base);
    }
    return inside & (sample->slot < pool->slot_count);
}

// What a sample adds to its pixel. The filter's sign comes in only here: a path's throughput decides about roulette and has none.
static vec3 pool_weighted(const Pool* pool, const PoolSample* sample, vec3 radiance) {
#ifdef PIXEL_FILTER_NEGATIVE
    return scale(radiance, sample->number >= POOL_NEGATIVE ? splat(-pool->weight) : splat(pool->weight));
#else
    return radiance;
#endif
}

// A sample's number without more.
static vuint pool_number_of(const PoolSample* sample) {
#ifdef PIXEL_FILTER_NEGATIVE
    return sample->number & (POOL_NEGATIVE - 1u);
#else
    return sample->number;
#endif
}

// Write what has been found for samples, as it is.
static void pool_put(const Pool* pool, const PoolSample* sample, vec3 found, vmask done) {
    int is_done[LANES];
    uint slot[LANES], number[LANES];
    float x[LANES], y[LANES], z[LANES];
    lane_store(done, is_done);
    lane_store(sample->slot, slot);
    lane_store(pool_number_of(sample), number);
    lane_store(found.x, x);
    lane_store(found.y, y);
    lane_store(found.z, z);
    for (int lane = 0; lane < LANES; ++lane) {
        if (!is_done[lane]) continue;
        const size_t channels = pool->slot_count;
        __global float* out = pool->samples + (size_t)number[lane] * 3 * channels + slot[lane];
        out[0] = x[lane];
        out[channels] = y[lane];
        out[2 * channels] = z[lane];
    }
}

// Radiance, weighted.
static void pool_deliver(const Pool* pool, const PoolSample* sample, vec3 radiance, vmask done) {
    pool_put(pool, sample, pool_weighted(pool, sample, radiance), done);
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
