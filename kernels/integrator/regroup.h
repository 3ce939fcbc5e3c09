// Which lane carries which path: paths that met the same kind of material go on in neighbouring lanes, so that most packets evaluate the
// lobes of one material, and not those of all.
//
// Between two vertices the packets of a work-item exchange paths, by a counting sort. No result depends on where a path is carried.
//
// Built only where there are materials or textures to tell apart (-D MATERIALS, -D TEXTURES), and several packets.
#ifndef INTEGRATOR_REGROUP_H
#define INTEGRATOR_REGROUP_H

#include "integrator/path_state.h"
#include "integrator/vertex_kind.h"

#if PACKETS > 1 && (defined(MATERIALS) || defined(TEXTURES)) && !defined(PATH_SPLITS)

// Where the path of each lane comes from: packet times LANES, plus lane. Returns whether any moves.
static int regroup_order(const Scene* scene, const Path* path, const Hit* hit, vuint* from) {
    uint kind[PACKETS * LANES], place[PACKETS * LANES], begin[VERTEX_KINDS + 1] = {0};
    EACH_PACKET(k) lane_store(vertex_kind(scene, path[k].alive, hit[k]), kind + k * LANES);
    for (uint i = 0; i < PACKETS * LANES; ++i) ++begin[kind[i] + 1];
    for (uint i = 0; i < VERTEX_KINDS; ++i) {
        if (begin[i + 1] == PACKETS * LANES) return 0;
        begin[i + 1] += begin[i];
    }
    for (uint i = 0; i < PACKETS * LANES; ++i) place[begin[kind[i]]++] = i;
    EACH_PACKET(k) from[k] = lane_restore(place + k * LANES);
    return 1;
}

// A path's time in the bits of a word that its two masks leave: there is no room for a word of its own.
#ifdef MOTION
#define REGROUP_TIME (vuint_from_int(vint_of(path->ray.time * 16777216.0f)) << 2)
#define REGROUP_TAKE_TIME(word) path->ray.time = vfloat_of(vint_from_uint((word) >> 2)) * EPSILON;
#else
#define REGROUP_TIME splat_uint(0u)
#define REGROUP_TAKE_TIME(word)
#endif

// What moves with a path. What path_scatter sets anew at every vertex stays where it is.
#define REGROUP_MEMBERS(FLOAT, UINT, MASKS)    \
    MASKS(path->alive, path->counts_in_full)   \
    PATH_MEMBERS(FLOAT, UINT)                  \
    FLOAT(hit->distance)                       \
    UINT(hit->primitive)

// They stand in two rows of a table for each path, so that a move is one of rows, and costs a shuffle of vectors (core/lane.h).
static void regroup_write(const Path* path, const Hit* hit, float* first, float* second) {
    vfloat words[32] = {splat(0.0f)};
    uint n = 0;
#define WRITE_FLOAT(member) words[n++] = (member);
#define WRITE_UINT(member) words[n++] = vfloat_from_bits(member);
#define WRITE_MASKS(member, other) words[n++] = vfloat_from_bits(vuint_from_int((member & 1) | (other & 2)) | REGROUP_TIME);
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
    (other) = (vint_from_uint(vfloat_bits(words[n])) & 2) != 0;  \
    REGROUP_TAKE_TIME(vfloat_bits(words[n]))                     \
    ++n;
    REGROUP_MEMBERS(READ_FLOAT, READ_UINT, READ_MASKS)
}

// Returns whether any path moved.
static int path_regroup(const Scene* scene, Path* path, Hit* hit) {
    vuint from[PACKETS];
    float first[PACKETS * LANES * 16], second[PACKETS * LANES * 16];
    if (!regroup_order(scene, path, hit, from)) return 0;
    EACH_PACKET(k) regroup_write(&path[k], &hit[k], first + k * LANES * 16, second + k * LANES * 16);
    EACH_PACKET(k) regroup_read(first, second, from[k], &path[k], &hit[k]);
    return 1;
}

#else

static int path_regroup(const Scene* scene, Path* path, Hit* hit) { return 0; }

#endif

#endif
