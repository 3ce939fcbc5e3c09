// Which lane carries which path: paths that met the same kind of material go on in neighbouring lanes, so that most packets evaluate the
// lobes of one material, and not those of all.
//
// Between two vertices the packets of a work-item exchange paths, by a counting sort. No result depends on where a path is carried.
//
// Built only where there are materials or textures to tell apart (-D MATERIALS, -D TEXTURES), and several packets.
#ifndef INTEGRATOR_REGROUP_H
#define INTEGRATOR_REGROUP_H

#include "geometry/instance.h"
#include "integrator/path_state.h"
#include "medium/homogeneous.h"

#if PACKETS > 1 && (defined(MATERIALS) || defined(TEXTURES)) && !defined(PATH_SPLITS)

#define REGROUP_KINDS 17u
#define REGROUP_TEXTURED 8u      // beside MATERIAL_*
#define REGROUP_OUTSIDE 7u       // the ray left the scene
#define REGROUP_NONE 15u         // there is no path
#define REGROUP_MEDIUM 16u       // it scatters before it meets anything

// What is to be done at the vertex of each lane.
static vuint regroup_kind(const Scene* scene, vmask alive, Hit hit) {
    const vmask in_medium = alive & medium_scatters(hit), found = alive & !in_medium & (hit.primitive != NONE);
    const vuint row = placed_at(scene, found ? hit.primitive : splat_uint(0u)).row * 16u;
    const vuint kind_and_flags = vfloat_bits(lane_gather(scene->primitive_rows, row + PRIMITIVE_ROW_KIND));
    vuint kind = kind_and_flags & ((1u << ROW_FLAGS) - 1u);
#ifdef MATERIALS
    const vmask by_row = found & (kind == MATERIAL_BY_ROW);
    const vuint material = vfloat_bits(lane_gather(scene->primitive_rows, row + PRIMITIVE_ROW_MATERIAL));
    kind = by_row ? vfloat_bits(lane_gather(scene->material_rows, (by_row ? material : splat_uint(0u)) * 32u + MATERIAL_ROW_KIND)) : kind;
#endif
    kind = (kind_and_flags & (SHAPE_TEXTURED << ROW_FLAGS)) != 0u ? kind | REGROUP_TEXTURED : kind;
    return in_medium ? splat_uint(REGROUP_MEDIUM) : found ? kind : alive ? splat_uint(REGROUP_OUTSIDE) : splat_uint(REGROUP_NONE);
}

// Where the path of each lane comes from: packet times LANES, plus lane. Returns whether any moves.
static int regroup_order(const Scene* scene, const Path* path, const Hit* hit, vuint* from) {
    uint kind[PACKETS * LANES], place[PACKETS * LANES], begin[REGROUP_KINDS + 1] = {0};
    EACH_PACKET(k) lane_store(regroup_kind(scene, path[k].alive, hit[k]), kind + k * LANES);
    for (uint i = 0; i < PACKETS * LANES; ++i) ++begin[kind[i] + 1];
    for (uint i = 0; i < REGROUP_KINDS; ++i) {
        if (begin[i + 1] == PACKETS * LANES) return 0;
        begin[i + 1] += begin[i];
    }
    for (uint i = 0; i < PACKETS * LANES; ++i) place[begin[kind[i]]++] = i;
    EACH_PACKET(k) from[k] = lane_restore(place + k * LANES);
    return 1;
}

// What moves with a path. What path_scatter sets anew at every vertex stays where it is.
#ifdef INTERIORS
#define REGROUP_INTERIOR(UINT) UINT(path->interior.first) UINT(path->interior.last) UINT(path->interior.straight)
#else
#define REGROUP_INTERIOR(UINT)
#endif
#ifdef STRAIGHT_SHADOWS
#define REGROUP_PASSED(FLOAT) FLOAT(path->passed)
#else
#define REGROUP_PASSED(FLOAT)
#endif
#ifdef PATH_BIDIRECTIONAL
#define REGROUP_WEIGHTS(FLOAT) FLOAT(path->techniques.edge) FLOAT(path->techniques.earlier)
#else
#define REGROUP_WEIGHTS(FLOAT) FLOAT(path->bsdf_samples) FLOAT(path->bsdf_pdf)
#endif
#ifdef PATH_GUIDED
#define REGROUP_EXPECTED(FLOAT) FLOAT(path->expected)
#else
#define REGROUP_EXPECTED(FLOAT)
#endif
#define REGROUP_VEC3(FLOAT, v) FLOAT(v.x) FLOAT(v.y) FLOAT(v.z)
#define REGROUP_MEMBERS(FLOAT, UINT, MASKS)                                                    \
    MASKS(path->alive, path->counts_in_full)                                                   \
    UINT(path->sample.slot)                                                                    \
    UINT(path->sample.number)                                                                  \
    UINT(path->sample.sampler.seed)                                                            \
    UINT(path->sample.sampler.index)                                                           \
    REGROUP_VEC3(FLOAT, path->ray.origin)                                                      \
    REGROUP_VEC3(FLOAT, path->ray.direction)                                                   \
    UINT(path->ray.from)                                                                       \
    REGROUP_VEC3(FLOAT, path->throughput)                                                      \
    FLOAT(path->index_squared)                                                                 \
    REGROUP_VEC3(FLOAT, path->radiance)                                                        \
    UINT(path->depth)                                                                          \
    REGROUP_VEC3(FLOAT, path->normal)                                                          \
    REGROUP_WEIGHTS(FLOAT)                                                                     \
    REGROUP_EXPECTED(FLOAT)                                                                    \
    REGROUP_INTERIOR(UINT)                                                                     \
    REGROUP_PASSED(FLOAT)                                                                      \
    FLOAT(hit->distance)                                                                       \
    UINT(hit->primitive)

// They stand in two rows of a table for each path, so that a move is one of rows, and costs a shuffle of vectors (core/lane.h).
static void regroup_write(const Path* path, const Hit* hit, float* first, float* second) {
    vfloat words[32] = {splat(0.0f)};
    uint n = 0;
#define WRITE_FLOAT(member) words[n++] = (member);
#define WRITE_UINT(member) words[n++] = vfloat_from_bits(member);
#define WRITE_MASKS(member, other) words[n++] = vfloat_from_bits(vuint_from_int((member & 1) | (other & 2)));
    REGROUP_MEMBERS(WRITE_FLOAT, WRITE_UINT, WRITE_MASKS)
    lane_write_rows(words, first);
    lane_write_rows(words + 16, second);
}
static void regroup_read(const float* first, const float* second, vuint from, Path* path, Hit* hit) {
    vfloat words[32];
    lane_own_rows(first, from, words);
    lane_own_rows(second, from, words + 16);
    uint n = 0;
#define READ_FLOAT(member) (member) = words[n++];
#define READ_UINT(member) (member) = vfloat_bits(words[n++]);
#define READ_MASKS(member, other)                                \
    (member) = (vint_from_uint(vfloat_bits(words[n])) & 1) != 0; \
    (other) = (vint_from_uint(vfloat_bits(words[n++])) & 2) != 0;
    REGROUP_MEMBERS(READ_FLOAT, READ_UINT, READ_MASKS)
}

static void path_regroup(const Scene* scene, Path* path, Hit* hit) {
    vuint from[PACKETS];
    float first[PACKETS * LANES * 16], second[PACKETS * LANES * 16];
    if (!regroup_order(scene, path, hit, from)) return;
    EACH_PACKET(k) regroup_write(&path[k], &hit[k], first + k * LANES * 16, second + k * LANES * 16);
    EACH_PACKET(k) regroup_read(first, second, from[k], &path[k], &hit[k]);
}

#else

static void path_regroup(const Scene* scene, Path* path, Hit* hit) {}

#endif

#endif
