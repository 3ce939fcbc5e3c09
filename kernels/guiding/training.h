// Training of the guiding field: what paths find after each of their first events is added to sums of the cell that they were in.
//
// While paths are traced each event is recorded. When they have ended, another kernel adds to the sums: luminance relative to the mean of the image and to
// the albedo, as integers, whose sums do not depend on any order. Of light samples at the vertex itself nothing is added where directions are learned.
#ifndef GUIDING_TRAINING_H
#define GUIDING_TRAINING_H

#include "core/quotient.h"
#include "film/pool.h"
#include "guiding/guide.h"

// The records of a sample.
static size_t training_records(const Pool* pool, uint slot, uint number) {
    return ((size_t)number * pool->slot_count + slot) * (RECORD_EVENTS * RECORD_WORDS);
}

// After the light samples, and before paths that ended are delivered.
static void training_record(const Scene* scene, const Pool* pool, const Path* path, const Vertex* v, __global uint* records) {
    const Guide* guide = &v->guide;
    const vmask recorded = path->alive & guide->asked & (guide->event < RECORD_EVENTS);
    if (!lane_any(recorded)) return;
    vfloat unused;
    const vuint bin = field_bin(path->ray.direction, &unused);
    const vmask guided = guide->share > 0.0f;
    int is_recorded[LANES];
    uint slot[LANES], number[LANES], event[LANES], words[RECORD_WORDS][LANES];
    lane_store(recorded, is_recorded);
    lane_store(path->sample.slot, slot);
    lane_store(pool_number_of(&path->sample), number);
    lane_store(guide->event, event);
#define RECORD_PUT(column, value) lane_store(vfloat_bits(value), words[column]);
#define RECORD_PUT_VEC3(column, value) RECORD_PUT(column, (value).x) RECORD_PUT(column + 1, (value).y) RECORD_PUT(column + 2, (value).z)
    lane_store((guide->place * FIELD_BINS + bin), words[RECORD_ROW_PLACE]);
    RECORD_PUT(RECORD_ROW_PDF, path->bsdf_pdf)
    RECORD_PUT(RECORD_ROW_BSDF_PDF, guide->bsdf_pdf)
    RECORD_PUT(RECORD_ROW_FIELD_PDF, (guided ? field_pdf(&scene->field, guide->cell, path->ray.direction) : splat(0.0f)))
    RECORD_PUT_VEC3(RECORD_ROW_THROUGHPUT, guide->throughput)
    RECORD_PUT(RECORD_ROW_ALBEDO, guide->albedo)
    RECORD_PUT_VEC3(RECORD_ROW_BEFORE, guide->before)
    RECORD_PUT_VEC3(RECORD_ROW_AFTER, path->radiance)
    for (int lane = 0; lane < LANES; ++lane) {
        if (!is_recorded[lane]) continue;
        __global uint* row = records + training_records(pool, slot[lane], number[lane]) + event[lane] * RECORD_WORDS;
        for (uint k = 0; k < RECORD_WORDS - 2; ++k) row[k] = words[k][lane];
    }
}

static void training_add(volatile __global uint* sum, float value, uint most) {
    const float counted = clamp(value, 0.0f, (float)most);
    const ulong units = (ulong)(counted * (float)(1u << TRAINING_BITS));
    const uint low = (uint)units, before = atomic_add(sum, low);
    const uint high = (uint)(units >> 32) + (before + low < before ? 1u : 0u);
    if (high != 0u) atomic_add(sum + 1, high);
}

static float training_ratio(float a, float b) { return b > 0.0f ? quotient_one(a, b) : 0.0f; }

// The luminance that `found` has more than the record had in three columns from the given one on, per throughput.
static float training_luminance(__global const uint* row, uint column, float x, float y, float z) {
    const float r = training_ratio(x - as_float(row[column]), as_float(row[RECORD_ROW_THROUGHPUT]));
    const float g = training_ratio(y - as_float(row[column + 1]), as_float(row[RECORD_ROW_THROUGHPUT + 1]));
    const float b = training_ratio(z - as_float(row[column + 2]), as_float(row[RECORD_ROW_THROUGHPUT + 2]));
#ifdef SPECTRAL
    return fmax((r + g + b) * (1.0f / 3.0f), 0.0f);
#else
    return fmax(fma(r, 0.2126f, fma(g, 0.7152f, b * 0.0722f)), 0.0f);
#endif
}

// sums: [cell][TRAINING_SUMS][2], the low word first; counts: of records, of each place in the nodes. `scale`: the inverse of the image's mean.
static void training_sum(const Field* field, __global const uint* row, float x, float y, float z, float scale_of, volatile __global uint* sums,
                         volatile __global uint* counts) {
    const uint place = row[RECORD_ROW_PLACE] >> FIELD_BIN_BITS, bin = row[RECORD_ROW_PLACE] & (FIELD_BINS - 1u), cell = field->nodes[place];
    atomic_inc(counts + place);
    if (cell == NONE) return;
    volatile __global uint* of_cell = sums + (size_t)cell * (2 * TRAINING_SUMS);
    const float relative = training_ratio(scale_of, fmax(as_float(row[RECORD_ROW_ALBEDO]), 0.01f));
    const float reflected = training_luminance(row, RECORD_ROW_AFTER, x, y, z) * relative;
    training_add(of_cell + 2 * bin, reflected, TRAINING_MOST_IN_BIN);
    training_add(of_cell + 2 * TRAINING_REFLECTED, reflected, TRAINING_MOST);
    training_add(of_cell + 2 * TRAINING_OUTGOING, training_luminance(row, RECORD_ROW_BEFORE, x, y, z) * relative, TRAINING_MOST);

    // And what its square would be with other shares of the histogram
    const float pdf = as_float(row[RECORD_ROW_PDF]), bsdf = as_float(row[RECORD_ROW_BSDF_PDF]), histogram = as_float(row[RECORD_ROW_FIELD_PDF]);
    for (uint k = 0; k < 4u; ++k) {
        const float mixed = fma((float)k * 0.25f, histogram - bsdf, bsdf);
        training_add(of_cell + 2 * (TRAINING_SQUARES + k), reflected * reflected * training_ratio(pdf, mixed), TRAINING_MOST);
    }
}

#endif
