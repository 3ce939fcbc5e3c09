// Which lane carries which path: paths that met the same kind of material go on in neighbouring lanes, so that most packets evaluate the
// lobes of one material, and not those of all.
//
// Between two vertices the packets of a work-item exchange paths, by a counting sort. No result depends on where a path is carried.
//
// Built only where there are materials or textures to tell apart (-D MATERIALS, -D TEXTURES), and several packets.
#ifndef INTEGRATOR_REGROUP_H
#define INTEGRATOR_REGROUP_H

#include "integrator/path_state.h"

#if PACKETS > 1 && (defined(MATERIALS) || defined(TEXTURES)) && !defined(PATH_SPLITS)

#define REGROUP_KINDS 16u
#define REGROUP_TEXTURED 8u      // beside MATERIAL_*
#define REGROUP_OUTSIDE 7u       // the ray left the scene
#define REGROUP_NONE 15u         // there is no path

// What is to be done at the vertex of each lane.
static vuint regroup_kind(const Scene* scene, vmask alive, Hit hit) {
    const vmask found = alive & (hit.primitive != NONE);
    const vuint row = (found ? hit.primitive : splat_uint(0u)) * 16u;
    const vuint kind_and_flags = vfloat_bits(lane_gather(scene->primitive_rows, row + PRIMITIVE_ROW_KIND));
    vuint kind = kind_and_flags & ((1u << ROW_FLAGS) - 1u);
#ifdef MATERIALS
    const vmask by_row = found & (kind == MATERIAL_BY_ROW);
    const vuint material = vfloat_bits(lane_gather(scene->primitive_rows, row + PRIMITIVE_ROW_MATERIAL));
    kind = by_row ? vfloat_bits(lane_gather(scene->material_rows, (by_row ? material : splat_uint(0u)) * 32u + MATERIAL_ROW_KIND)) : kind;
#endif
    kind = (kind_and_flags & (SHAPE_TEXTURED << ROW_FLAGS)) != 0u ? kind | REGROUP_TEXTURED : kind;
    return found ? kind : alive ? splat_uint(REGROUP_OUTSIDE) : splat_uint(REGROUP_NONE);
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

// Move one number of every path.
#define REGROUP(array, member, to_bits, from_bits)                                            \
    {                                                                                         \
        uint words[PACKETS * LANES];                                                          \
        EACH_PACKET(k) lane_store(to_bits((array)[k].member), words + k * LANES);             \
        EACH_PACKET(k)(array)[k].member = from_bits(lane_look_up(words, from[k]));            \
    }
#define REGROUP_FLOAT(array, member) REGROUP(array, member, vfloat_bits, vfloat_from_bits)
#define REGROUP_UINT(array, member) REGROUP(array, member, vuint_from_int, vuint_from_int)
#define REGROUP_MASK(array, member) REGROUP(array, member, vuint_from_int, vint_from_uint)
#define REGROUP_VEC3(array, member) \
    REGROUP_FLOAT(array, member.x)  \
    REGROUP_FLOAT(array, member.y)  \
    REGROUP_FLOAT(array, member.z)

// What path_scatter sets anew at every vertex stays where it is.
static void path_regroup(const Scene* scene, Path* path, Hit* hit) {
    vuint from[PACKETS];
    if (!regroup_order(scene, path, hit, from)) return;
    REGROUP_MASK(path, alive)
    REGROUP_UINT(path, sample.slot)
    REGROUP_UINT(path, sample.number)
    REGROUP_UINT(path, sample.sampler.seed)
    REGROUP_UINT(path, sample.sampler.index)
    REGROUP_VEC3(path, ray.origin)
    REGROUP_VEC3(path, ray.direction)
    REGROUP_UINT(path, ray.from)
    REGROUP_VEC3(path, throughput)
    REGROUP_VEC3(path, radiance)
    REGROUP_UINT(path, depth)
    REGROUP_VEC3(path, normal)
    REGROUP_MASK(path, specular)
    REGROUP_FLOAT(path, bsdf_samples)
    REGROUP_FLOAT(path, bsdf_pdf)
#ifdef INTERIORS
    REGROUP_UINT(path, interior.first)
    REGROUP_UINT(path, interior.last)
    REGROUP_UINT(path, interior.straight)
#endif
    REGROUP_FLOAT(hit, distance)
    REGROUP_UINT(hit, primitive)
}

#else

static void path_regroup(const Scene* scene, Path* path, Hit* hit) {}

#endif

#endif
