// The rays of all lanes through the tree together, each box and primitive against all of them, while they agree; a subtree that only
// a few of them want is left to each of those alone, once all else is done and the rays are as short as they get (Benthin, Wald,
// Woop, Ernst, "Combining single and packet-ray tracing for arbitrary ray distributions", 2012).
#ifndef GEOMETRY_BVH_PACKET_H
#define GEOMETRY_BVH_PACKET_H

#include "geometry/bvh_single.h"
#include "geometry/ray.h"

// With so few lanes left, they part: sooner where several packets' rays take turns, which spares each of them waiting, but not where
// paths are sorted by their materials (measured: docs/notes/materials.md); and among leaves with holes sooner still. 0: never, as on a GPU, where one lane walks the tree and
// nothing is left to part.
#ifndef PACKET_PARTS
#if defined(OPACITY)
#define PACKET_PARTS (LANES * 3 / 4)
#elif PACKETS > 1 && !defined(MATERIALS) && !defined(TEXTURES)
#define PACKET_PARTS (LANES / 2)
#else
#define PACKET_PARTS (LANES / 4)
#endif
#endif

typedef struct {
    vec3 origin, direction, inverse;
    vfloat slack;                // for the triangle test
    vfloat inverse2;             // one over the direction's square
    vuint from, to;
#ifdef OPACITY
    vfloat after;
    vuint after_primitive;
#endif
    vfloat nearest;
    vuint primitive;
#ifdef INSTANCES
    vfloat start;                // where it enters the instance that it is in; elsewhere BOX_START
    uint instance;               // NONE: none
    uint triangle_offset, analytic_offset;   // from primitives in packs to their numbers
#endif
#ifdef BVH_COUNT_STEPS
    uint steps;                  // nodes and packs looked into
#endif
} PacketRay;

// Counts what a traversal costs wherever it runs (tests/kernel/test_steps.py).
#ifdef BVH_COUNT_STEPS
#define BVH_STEP(ray) ++(ray)->steps
#else
#define BVH_STEP(ray)
#endif

static void packet_aim(PacketRay* p, vec3 origin, vec3 direction) {
    p->origin = origin;
    p->direction = direction;
    p->inverse = vec3_of(ray_inverse_lanes(direction.x), ray_inverse_lanes(direction.y), ray_inverse_lanes(direction.z));
    p->inverse2 = ray_inverse2_lanes(direction.x, direction.y, direction.z);
    p->slack = ray_slack_lanes(direction.x, direction.y, direction.z);
}

static PacketRay packet_ray(const Ray* ray, vmask active) {
    PacketRay p;
    packet_aim(&p, ray->origin, ray->direction);
    p.from = ray->from;
    p.to = ray->to;
#ifdef OPACITY
    p.after = ray->after;
    p.after_primitive = ray->after_primitive;
#endif
    p.nearest = active ? ray->limit : splat(-1.0f);
    p.primitive = splat_uint(NONE);
#ifdef INSTANCES
    p.start = splat(BOX_START);
    p.instance = NONE;
    p.triangle_offset = p.analytic_offset = 0;
#endif
#ifdef BVH_COUNT_STEPS
    p.steps = 0;
#endif
    return p;
}

#ifdef INSTANCES
static vfloat packet_begin(const PacketRay* ray) { return ray->start; }
static uint packet_triangle_offset(const PacketRay* ray) { return ray->triangle_offset; }
static uint packet_analytic_offset(const PacketRay* ray, uint kind) {
    return kind >= ANALYTIC_RECTANGLE ? ray->triangle_offset : ray->analytic_offset;
}
#else
static vfloat packet_begin(const PacketRay* ray) { return splat(BOX_START); }
static uint packet_triangle_offset(const PacketRay* ray) { return 0; }
static uint packet_analytic_offset(const PacketRay* ray, uint kind) { return 0; }
#endif

#ifdef OPACITY
static vfloat packet_after(const PacketRay* ray) { return ray->after; }
static vmask packet_reaches(const PacketRay* ray, vfloat far) { return far >= ray->after; }
#else
static vfloat packet_after(const PacketRay* ray) { return splat(0.0f); }
static vmask packet_reaches(const PacketRay* ray, vfloat far) { return mask_all(); }
#endif

// Whether a hit of this primitive is behind what is left out.
static vmask packet_counts(const PacketRay* ray, vfloat at, vuint id) {
#ifdef OPACITY
    return (at > ray->after) | ((at == ray->after) & (id > ray->after_primitive));
#else
    return at > BOX_START;
#endif
}

// Keep the hit where it is nearer; of equally near ones the lowest number, so that the order of visits does not matter: a hit with
// a lower number may be as far as the one that is kept, which is to be nearer than the next larger float. `entered` is where the
// rays enter the leaf's box, NEVER for those that do not. A ray that starts on one of [first, last] hits none of them, nor, in search of
// any hit, does one that is aimed at them. A distance that is not a number is never nearer.
static void packet_keep(const PacketRay* ray, vmask hit, vfloat distance, vfloat entered, vuint id, uint first, uint last,
                        int any_hit, vfloat* nearest, vuint* primitive) {
    const vfloat at = distance < entered ? entered : distance;
    const vuint one = any_hit ? splat_uint(1u) : (id < *primitive ? splat_uint(1u) : splat_uint(0u));
    const vfloat limit = vfloat_from_bits(vfloat_bits(*nearest) + one);
    const vuint most = splat_uint(last - first);
    const vmask other = BVH_PASSES_TARGET(any_hit) ? (ray->from - first > most) & (ray->to - first > most) : ray->from - first > most;
    const vmask keep = (hit & other) & packet_counts(ray, at, id) & (at < limit);
    *nearest = keep ? (any_hit ? splat(-1.0f) : at) : *nearest;
    if (!any_hit) *primitive = keep ? id : *primitive;
}

// The hits of a triangle or pair that count, as single_solid.
static vmask packet_solid(const Bvh* bvh, uint word, vmask hit, vmask near, vfloat determinant, vfloat b, vfloat c, int any_hit,
                          vuint* primitive) {
#ifdef HOLES
    if (bvh->hole_rows == 0 || !lane_any(hit & near)) return hit;
    int hits[LANES];
    uint doubtful[LANES];
    float determinants[LANES], weights_b[LANES], weights_c[LANES];
    lane_store((hit & near), hits);
    lane_store(*primitive, doubtful);
    lane_store(determinant, determinants);
    lane_store(b, weights_b);
    lane_store(c, weights_c);
    for (int lane = 0; lane < LANES; ++lane) {
        if (!hits[lane]) continue;
        const int known = holes_at(bvh, word, determinants[lane], weights_b[lane], weights_c[lane]);
        if (known == HOLES_HOLE || (any_hit && known == HOLES_UNKNOWN)) hits[lane] = 0;
        if (any_hit && known == HOLES_UNKNOWN) doubtful[lane] = 0u;
    }
    if (any_hit) *primitive = lane_restore(doubtful);
    return lane_restore(hits);
#else
    return hit;
#endif
}

// Written without branches: whether any of the rays hits a triangle is a coin toss that no processor predicts.
static void packet_triangles(PacketRay* ray, const Bvh* bvh, uint reference, vfloat entered, int any_hit) {
    __global const float* pack = bvh_pack(bvh->triangle_packs, TRIANGLE_BLOCK_WORDS, reference);
    vfloat nearest = ray->nearest;
    vuint primitive = ray->primitive;
    const uint offset = packet_triangle_offset(ray);
    for (uint left = bvh_members(reference); left > 0; --left, ++pack) {
        const uint word = as_uint(pack[TRIANGLE_ID]) & ~BVH_NUMBER, first = (word & ~BVH_PAIR) + offset, last = first + (word >> 31);
        const vec3 from = vec3_of(ray->origin.x - pack[0], ray->origin.y - pack[8], ray->origin.z - pack[16]);
        const vfloat nx = splat(pack[72]), ny = splat(pack[80]), nz = splat(pack[88]);
        vfloat determinant, b, c;
        const vec3 d = ray->direction;
        const vmask hit = triangle_hit_lanes(from.x, from.y, from.z, splat(pack[24]), splat(pack[32]), splat(pack[40]),
                                             splat(pack[48]), splat(pack[56]), splat(pack[64]), nx, ny, nz, splat(pack[96]),
                                             splat(pack[104]), splat(pack[112]), d.x, d.y, d.z, ray->slack, &determinant, &b, &c);
        const vfloat distance = triangle_distance_lanes(from.x, from.y, from.z, nx, ny, nz, determinant);
        vuint id = splat_uint(first);
        if (!any_hit && last != first) id = c > b ? splat_uint(last) : id;
        const vmask there = packet_solid(bvh, as_uint(pack[TRIANGLE_ID]), hit, distance <= nearest, determinant, b, c, any_hit, &primitive);
        packet_keep(ray, there, distance, entered, id, first, last, any_hit, &nearest, &primitive);
    }
    ray->nearest = nearest;
    ray->primitive = primitive;
}

// The rectangle in the pack's first column, square to the axis `a`, with sides along `u` and `v`.
#define PACKET_RECTANGLE(a, u, v)                                                                                           \
    rectangle_hit_lanes(from.a, -ray->inverse.a, from.u, from.v, ray->direction.u, ray->direction.v, splat(pack[24]),         \
                        splat(pack[32]), &distance, &place_u, &place_v)

static void packet_analytic(PacketRay* ray, const Bvh* bvh, uint reference, vfloat entered, int any_hit) {
    __global const float* pack = bvh_pack(bvh->analytic_packs, ANALYTIC_BLOCK_WORDS, reference);
    for (uint left = bvh_members(reference); left > 0; --left, ++pack) {
        const uint kind = as_uint(pack[ANALYTIC_KIND]) & ~BVH_NUMBER, word = as_uint(pack[ANALYTIC_ID]) & ~BVH_NUMBER;
        const uint first = (word & ~BVH_PAIR) + packet_analytic_offset(ray, kind), last = first + (word >> 31);
        const vec3 from = vec3_of(ray->origin.x - pack[0], ray->origin.y - pack[8], ray->origin.z - pack[16]);
        vuint id = splat_uint(first);
        vfloat distance;
        vmask hit;
        if (kind >= ANALYTIC_RECTANGLE) {
            vfloat place_u, place_v;
            if (kind == ANALYTIC_RECTANGLE)
                hit = PACKET_RECTANGLE(x, y, z);
            else if (kind == ANALYTIC_RECTANGLE + 1u)
                hit = PACKET_RECTANGLE(y, z, x);
            else
                hit = PACKET_RECTANGLE(z, x, y);
            if (!any_hit) id = rectangle_second_lanes(place_u, place_v, splat(pack[40]), splat(pack[48])) ? splat_uint(last) : id;
        } else {
            const vec3 to = negate(from), d = ray->direction;
            const vfloat radius = splat(pack[24]);
            if (kind == ANALYTIC_DISK)
                hit = disk_hit_lanes(to.x, to.y, to.z, radius, splat(pack[32]), splat(pack[40]), splat(pack[48]), d.x, d.y, d.z, &distance);
            else
                hit = sphere_hit_lanes(to.x, to.y, to.z, radius, d.x, d.y, d.z, ray->inverse2, packet_after(ray), &distance);
        }
#ifdef HOLES
        // Nothing is known of their holes
        if (any_hit && bvh->hole_rows != 0) {
            ray->primitive = hit & (distance <= ray->nearest) ? splat_uint(0u) : ray->primitive;
            continue;
        }
#endif
        packet_keep(ray, hit, distance, entered, id, first, last, any_hit, &ray->nearest, &ray->primitive);
    }
}

// Hand a subtree to the lanes that want it.
static void packet_hand_over(SingleRays* rays, uint packet, vmask wants, uint reference, vfloat entered) {
    int wanted[LANES];
    float enters[LANES];
    lane_store(wants, wanted);
    lane_store(entered, enters);
    const uint first = packet * LANES;
    for (int lane = 0; lane < LANES; ++lane) {
        rays->stack[first + lane][rays->top[first + lane] + 1] = single_entry(reference, enters[lane]);
        rays->top[first + lane] += wanted[lane] ? 1 : 0;
    }
}

#ifdef INSTANCES
// A packet goes on in an instance. Those of its rays that do not enter have `entered` NEVER, which keeps them out.
static void packet_enter(const Bvh* bvh, PacketRay* ray, uint instance, vfloat entered) {
    __global const float* row = bvh->instance_rows + (size_t)instance * INSTANCE_WORDS;
    const vec3 o = ray->origin, d = ray->direction;
    float m[12];
    for (int k = 0; k < 12; ++k) m[k] = row[INSTANCE_ROW_TO_OBJECT + k];
    vfloat origin[3], direction[3];
    for (int k = 0; k < 3; ++k) {
        const vfloat m_x = splat(m[k * 4]), m_y = splat(m[k * 4 + 1]), m_z = splat(m[k * 4 + 2]);
        origin[k] = ray_carried_lanes(m_x, m_y, m_z, splat(m[k * 4 + 3]), o.x, o.y, o.z);
        direction[k] = ray_carried_lanes(m_x, m_y, m_z, splat(0.0f), d.x, d.y, d.z);
    }
    packet_aim(ray, vec3_row(origin, 0), vec3_row(direction, 0));
    ray->start = entered;
    ray->instance = instance;
    ray->triangle_offset = as_uint(row[INSTANCE_ROW_TRIANGLE_OFFSET]);
    ray->analytic_offset = as_uint(row[INSTANCE_ROW_ANALYTIC_OFFSET]);
}

// And back in the world.
static void packet_leave(PacketRay* ray, vec3 origin, vec3 direction) {
    packet_aim(ray, origin, direction);
    ray->start = splat(BOX_START);
    ray->instance = NONE;
    ray->triangle_offset = ray->analytic_offset = 0;
}

// Hand over a subtree of the instance that the packet is in. Returns how many entries that takes.
static int packet_hand_over_within(const PacketRay* ray, SingleRays* rays, uint packet, vmask wants, uint reference, vfloat entered) {
    packet_hand_over(rays, packet, wants, reference, entered);
    if (ray->instance == NONE) return 1;
    packet_hand_over(rays, packet, wants, ray->instance | BVH_INSTANCE | SINGLE_WITHIN, ray->start);
    return 2;
}
#else
static int packet_hand_over_within(const PacketRay* ray, SingleRays* rays, uint packet, vmask wants, uint reference, vfloat entered) {
    packet_hand_over(rays, packet, wants, reference, entered);
    return 1;
}
#endif

// Along one axis, what a packet's rays alone start with.
static void packet_part_axis(SingleRays* rays, uint first, uint axis, vfloat origin, vfloat direction, vfloat inverse) {
    const vuint low = splat_uint(BVH_LOW + 8 * axis), high = splat_uint(BVH_HIGH + 8 * axis);
    const vmask down = inverse < 0.0f;
    lane_store(origin, rays->origin[axis] + first);
    lane_store(direction, rays->direction[axis] + first);
    lane_store((-inverse), rays->minus_inverse[axis] + first);
    lane_store((down ? high : low), rays->near_plane[axis] + first);
    lane_store((down ? low : high), rays->far_plane[axis] + first);
}

// The packet's rays as each of them goes on alone, through what is handed to it.
static void packet_part(const PacketRay* ray, SingleRays* rays, uint packet) {
    const uint first = packet * LANES;
    packet_part_axis(rays, first, 0, ray->origin.x, ray->direction.x, ray->inverse.x);
    packet_part_axis(rays, first, 1, ray->origin.y, ray->direction.y, ray->inverse.y);
    packet_part_axis(rays, first, 2, ray->origin.z, ray->direction.z, ray->inverse.z);
    lane_store(ray->slack, rays->slack + first);
    lane_store(ray->inverse2, rays->inverse2 + first);
    lane_store(ray->from, rays->from + first);
    lane_store(ray->to, rays->to + first);
#ifdef OPACITY
    lane_store(ray->after, rays->after + first);
    lane_store(ray->after_primitive, rays->after_primitive + first);
#endif
    lane_store(ray->nearest, rays->nearest + first);
    lane_store(ray->primitive, rays->primitive + first);
#ifdef INSTANCES
    const vfloat world[6] = {ray->origin.x, ray->origin.y, ray->origin.z, ray->direction.x, ray->direction.y, ray->direction.z};
    for (uint k = 0; k < 6; ++k) lane_store(world[k], rays->world[k] + first);
    lane_store(splat(BOX_START), rays->start + first);
    for (uint lane = first; lane < first + LANES; ++lane) rays->base[lane] = 0, rays->triangle_offset[lane] = rays->analytic_offset[lane] = 0;
#endif
}

// Push the children that any lane enters, in the order in which the node has them. Returns the new top of the stack.
static int packet_children(const PacketRay* ray, __global const float* node, uint* stack, vfloat* stack_near, int top) {
    for (int i = 0; i < 8 && as_uint(node[BVH_CHILD + i]) != BVH_EMPTY; ++i) {
        vfloat near, far;
        box_interval_lanes(ray->origin.x - node[i], ray->origin.y - node[8 + i], ray->origin.z - node[16 + i],
                           ray->origin.x - node[24 + i], ray->origin.y - node[32 + i], ray->origin.z - node[40 + i],
                           -ray->inverse.x, -ray->inverse.y, -ray->inverse.z, packet_begin(ray), &near, &far);
        const vmask enters = (near <= far) & (near <= ray->nearest) & packet_reaches(ray, far);
        stack[top + 1] = as_uint(node[BVH_CHILD + i]);
        stack_near[top + 1] = enters ? near : splat(NEVER);
        top += lane_any(enters) ? 1 : 0;
    }
    return top;
}

// Returns how many subtrees are left to the rays alone.
__attribute__((always_inline)) static int bvh_packet(const Bvh* bvh, PacketRay* ray, SingleRays* alone, uint packet, int any_hit) {
    uint stack[BVH_STACK];
    vfloat stack_near[BVH_STACK];
    int top = 0, handed_over = 0;
    stack[0] = bvh->root;
    stack_near[0] = splat(0.0f);
#ifdef INSTANCES
    const vec3 origin = ray->origin, direction = ray->direction;
    int base = 0;                // of the stack's entries those below it are in the world
#endif
    while (top >= 0) {
#ifdef INSTANCES
        if (top < base) {
            packet_leave(ray, origin, direction);
            base = 0;
        }
#endif
        const uint reference = stack[top];
        const vfloat entered = stack_near[top];
        const vmask wants = entered <= ray->nearest;
        --top;
        if (!lane_any(wants)) continue;
        BVH_STEP(ray);
        if (!(reference & BVH_LEAF)) {
#if PACKET_PARTS > 0
            if (lane_count(wants) <= PACKET_PARTS && handed_over < SINGLE_STARTS - 1)
                handed_over += packet_hand_over_within(ray, alone, packet, wants, reference, entered);
            else
#endif
#ifdef INSTANCES
            if (reference & BVH_INSTANCE) {
                packet_enter(bvh, ray, reference & BVH_INDEX, entered);
                stack[++top] = as_uint(bvh->instance_rows[(size_t)ray->instance * INSTANCE_WORDS + bvh->instance_root]);
                stack_near[top] = entered;
                base = top;
            } else
#endif
                top = packet_children(ray, bvh->nodes + (size_t)reference * BVH_NODE_WORDS, stack, stack_near, top);
        } else if (reference & BVH_ANALYTIC)
            packet_analytic(ray, bvh, reference, entered, any_hit);
        else
            packet_triangles(ray, bvh, reference, entered, any_hit);
    }
#ifdef INSTANCES
    packet_leave(ray, origin, direction);
#endif
    return handed_over;
}

#endif
