// Stochastic progressive photon mapping (Hachisuka and Jensen 2009) in the form whose passes are independent (Knaus and Zwicker, "Progressive
// photon mapping: a probabilistic approach", ACM TOG 30(3) 2011): each sample of a pixel looks into a photon map of its own, whose radius
// shrinks from map to map, so that noise and blur both vanish in the mean. Consistent, not unbiased.
//
// A path is followed to its first surface of the material `lambert`, or to where it scatters in a medium; light straight from the lights is added
// there by shadow rays, and all other light from the photons around. On the way it meets mirrors, glass and all that is rough, where it goes on as in path.h, with light
// and BSDF samples weighted: there every direction counts for something else, and few photons come from those that count.
#ifndef INTEGRATOR_PHOTON_H
#define INTEGRATOR_PHOTON_H

#define PATH_GATHERS         // paths end where photons are gathered
#define SHARED_TIME          // with the photons of the same sample
#include "integrator/path.h"
#include "photon/ball.h"
#include "photon/deposit.h"
#include "photon/disk.h"
#include "photon/grid.h"

typedef struct {
    __global const float* map;       // [words][stride]: DEPOSIT_ROW_* (photon/grid.cl)
    __global const uint* starts;
    uint stride, words;              // 10, and 11 in scenes with media or textures
    Grid grid;
    float radius;
    float scale;                     // one over number of photons and area of the disk
} PhotonMap;

// The flux around a point, as a density over the disk's plane: of all photons, and of those of caustics, which are not in the first.
typedef struct {
    float4 others, caustics;
} PhotonFlux;

static float photon_sum(float8 x) {
    const float4 half_ = x.lo + x.hi;
    const float2 quarter = half_.lo + half_.hi;
    return quarter.x + quarter.y;
}

#ifdef TEXTURES
// Of eight deposits those with directions count by the normal that is seen, over the cosine by which they were spread over their own surface.
static float8 photon_bent(const PhotonMap* m, uint first, float4 seen, int8 near, float8 cosine) {
    const uint8 kinds = as_uint8(vload8(0, m->map + first + DEPOSIT_ROW_KIND * (size_t)m->stride));
    if (!any(near & as_int8(kinds))) return cosine;
    float weight[8];
    uint kind[8];
    vstore8(cosine, 0, weight);
    vstore8(kinds, 0, kind);
    __global const float* normal = m->map + first + DEPOSIT_ROW_NORMAL * (size_t)m->stride;
    for (uint k = 0; k < 8u; ++k) {
        if (!(kind[k] & DEPOSIT_FROM)) continue;
        const float4 d = deposit_direction(kind[k]);
        const float own = fabs(fma(d.x, normal[k], fma(d.y, normal[k + m->stride], d.z * normal[k + 2u * m->stride])));
        const float there = -fma(d.x, seen.x, fma(d.y, seen.y, d.z * seen.z));
        weight[k] = there > 0.0f ? weight[k] * quotient_one(there, fmax(own, 1.0e-6f)) : 0.0f;
    }
    return vload8(0, weight);
}
#endif

// On the side of `side`, from photons with at most `depth` scattering events, eight at a time; `flat` is disk_flat, and `seen` the shading normal.
static PhotonFlux photon_gather_one(const PhotonMap* m, float4 point, float4 side, float4 seen, float flat, float depth) {
    const float r = m->radius, r2 = r * r, caustic_r2 = r2 * (CAUSTIC_RADIUS * CAUSTIC_RADIUS);
    const float off = disk_off_plane(r), caustic_off = disk_off_plane(r * CAUSTIC_RADIUS);
    const float4 low = m->grid.low;
    const uint4 size = m->grid.size;
    const uint x0 = grid_along(point.x - r, low.x, low.w, size.x), x1 = grid_along(point.x + r, low.x, low.w, size.x);
    const uint y0 = grid_along(point.y - r, low.y, low.w, size.y), y1 = grid_along(point.y + r, low.y, low.w, size.y);
    const uint z0 = grid_along(point.z - r, low.z, low.w, size.z), z1 = grid_along(point.z + r, low.z, low.w, size.z);
    const uint8 step = (uint8)(0, 1, 2, 3, 4, 5, 6, 7);
    const float8 none = (float8)(0.0f);
    float8 red = none, green = none, blue = none, caustic_red = none, caustic_green = none, caustic_blue = none;
    for (uint z = z0; z <= z1; ++z)
        for (uint y = y0; y <= y1; ++y) {
            const size_t row = ((size_t)z * size.y + y) * size.x;
            const uint begin = m->starts[row + x0], end = m->starts[row + x1 + 1u];
            for (uint i = begin; i < end; i += 8) {
                __global const float* at = m->map + i;
                const size_t n = m->stride;
                const float8 dx = vload8(0, at) - point.x, dy = vload8(0, at + n) - point.y, dz = vload8(0, at + 2 * n) - point.z;
                const float8 distance2 = fma(dx, dx, fma(dy, dy, dz * dz));
                const float8 above = fma(dx, (float8)(side.x), fma(dy, (float8)(side.y), dz * side.z));
                const float8 nx = vload8(0, at + DEPOSIT_ROW_NORMAL * n), ny = vload8(0, at + (DEPOSIT_ROW_NORMAL + 1) * n);
                const float8 nz = vload8(0, at + (DEPOSIT_ROW_NORMAL + 2) * n);
                float8 cosine = fma(nx, (float8)(side.x), fma(ny, (float8)(side.y), nz * side.z));
                const float8 before = fma(dx, nx, fma(dy, ny, dz * nz));
                const float8 events = vload8(0, at + DEPOSIT_ROW_EVENTS * n), within = events < 0.0f ? (float8)(caustic_r2) : (float8)(r2);
                const float8 beside = events < 0.0f ? (float8)(caustic_off) : (float8)(off);
                const int8 behind = (above < -flat) & (before < -flat);
                const int8 near = (distance2 <= within) & (above <= beside) & (above >= -beside) & (cosine > 0.0f) & !behind &
                                  (events <= depth) & (events >= -depth) & (i + step < end);
#ifdef TEXTURES
                if (m->words > 10u) cosine = photon_bent(m, i, seen, near, cosine);
#endif
                const int8 other = near & (events >= 0.0f), caustic = near & (events < 0.0f);
                const float8 r8 = vload8(0, at + DEPOSIT_ROW_FLUX * n), g8 = vload8(0, at + (DEPOSIT_ROW_FLUX + 1) * n);
                const float8 b8 = vload8(0, at + (DEPOSIT_ROW_FLUX + 2) * n);
                red += other ? r8 * cosine : none;
                green += other ? g8 * cosine : none;
                blue += other ? b8 * cosine : none;
                if (!any(caustic)) continue;
                caustic_red += caustic ? r8 * cosine : none;
                caustic_green += caustic ? g8 * cosine : none;
                caustic_blue += caustic ? b8 * cosine : none;
            }
        }
    PhotonFlux flux;
    flux.others = (float4)(photon_sum(red), photon_sum(green), photon_sum(blue), 0.0f);
    flux.caustics = (float4)(photon_sum(caustic_red), photon_sum(caustic_green), photon_sum(caustic_blue), 0.0f);
    return flux;
}

#ifdef MEDIA
// The same in a ball, each with the phase function of light that goes on along `onwards`, in 1/sr; over the whole ball's volume, after a scaling.
static PhotonFlux photon_gather_in_medium(const PhotonMap* m, float4 point, float4 onwards, uint medium, float g, float depth) {
    const float r = m->radius, r2 = r * r, caustic_r2 = r2 * (CAUSTIC_BALL * CAUSTIC_BALL);
    const float4 low = m->grid.low;
    const uint4 size = m->grid.size;
    const uint x0 = grid_along(point.x - r, low.x, low.w, size.x), x1 = grid_along(point.x + r, low.x, low.w, size.x);
    const uint y0 = grid_along(point.y - r, low.y, low.w, size.y), y1 = grid_along(point.y + r, low.y, low.w, size.y);
    const uint z0 = grid_along(point.z - r, low.z, low.w, size.z), z1 = grid_along(point.z + r, low.z, low.w, size.z);
    PhotonFlux flux;
    flux.others = flux.caustics = (float4)(0.0f);
    for (uint z = z0; z <= z1; ++z)
        for (uint y = y0; y <= y1; ++y) {
            const size_t row = ((size_t)z * size.y + y) * size.x + size.w;
            const uint begin = m->starts[row + x0], end = m->starts[row + x1 + 1u];
            for (uint i = begin; i < end; ++i) {
                __global const float* at = m->map + i;
                const size_t n = m->stride;
                const float dx = at[0] - point.x, dy = at[n] - point.y, dz = at[2 * n] - point.z, distance2 = fma(dx, dx, fma(dy, dy, dz * dz));
                const float events = at[DEPOSIT_ROW_EVENTS * n];
                const int caustic = events < 0.0f, near = distance2 <= (caustic ? caustic_r2 : r2) && (caustic ? -events : events) <= depth;
                if (!near || as_uint(at[DEPOSIT_ROW_KIND * n]) != medium) continue;
                const float nx = at[DEPOSIT_ROW_NORMAL * n], ny = at[(DEPOSIT_ROW_NORMAL + 1) * n], nz = at[(DEPOSIT_ROW_NORMAL + 2) * n];
                const float cosine = fma(nx, onwards.x, fma(ny, onwards.y, nz * onwards.z));
                const float spread = fmax(fma(g, fma(cosine, -2.0f, g), 1.0f), 1.0e-5f);
                const float phase = quotient_one(fma(g, -g, 1.0f), spread * square_root_one(spread)) * 0.0795774715459477f;
                const float4 all = (float4)(at[DEPOSIT_ROW_FLUX * n], at[(DEPOSIT_ROW_FLUX + 1) * n], at[(DEPOSIT_ROW_FLUX + 2) * n], 0.0f) * phase;
                flux.others += caustic ? (float4)(0.0f) : all;
                flux.caustics += caustic ? all : (float4)(0.0f);
            }
        }
    return flux;
}

// Radiance that photons bring to each lane's point of a medium, on its way against the path's ray, over what the medium scatters.
static vec3 photon_in_medium(const Scene* scene, const PhotonMap* m, const Vertex* v, const Path* path, vmask where, PoolStats* stats) {
    int is_there[LANES];
    float number[7][LANES];
    uint medium[LANES], events[LANES];
    const vec3 point = v->surface.point, onwards = negate(path->ray.direction);
    lane_store(where, is_there);
    lane_store(point.x, number[0]);
    lane_store(point.y, number[1]);
    lane_store(point.z, number[2]);
    lane_store(onwards.x, number[3]);
    lane_store(onwards.y, number[4]);
    lane_store(onwards.z, number[5]);
    lane_store(bsdf_mean_cosine(&v->bsdf), number[6]);
    lane_store(ball_medium(&path->interior), medium);
    lane_store(path->depth, events);
    const uint most = scene->settings->max_depth;
    for (int lane = 0; lane < LANES; ++lane) {
        PhotonFlux flux;
        flux.others = flux.caustics = (float4)(0.0f);
        if (is_there[lane]) {
            const float left = most == NONE ? FAR : (float)(most - events[lane] - 1u);
            const float4 at = (float4)(number[0][lane], number[1][lane], number[2][lane], 0.0f);
            const float4 to = (float4)(number[3][lane], number[4][lane], number[5][lane], 0.0f);
            flux = photon_gather_in_medium(m, at, to, medium[lane], number[6][lane], left);
        }
        number[0][lane] = flux.others.x, number[1][lane] = flux.others.y, number[2][lane] = flux.others.z;
        number[3][lane] = flux.caustics.x, number[4][lane] = flux.caustics.y, number[5][lane] = flux.caustics.z;
    }
    const vfloat per_volume = splat(quotient_one(m->scale * 0.75f, m->radius));      // the scale is for the area of a disk
    vec3 sum = vec3_all(0.0f);
    for (uint kind = 0; kind < 2u; ++kind) {
        const vec3 flux = vec3_of(lane_restore(number[3 * kind]), lane_restore(number[3 * kind + 1]), lane_restore(number[3 * kind + 2]));
        const vmask asked = where & (largest(flux) > 0.0f);
        if (!lane_any(asked)) continue;
        const vuint set = BALL_SET + (path->depth * 2u + kind) * (2u * BALL_MOST_TRIES);
        const float radius = kind == 0u ? m->radius : m->radius * CAUSTIC_BALL;
        sum = add(sum, scale(flux, per_volume * ball_tries(scene, &path->interior, point, ray_time(&path->ray), path->sample.sampler, set, radius, asked, stats)));
    }
    // Deposits are of what is scattered
    vfloat row[16];
    interior_row(scene, where ? interior_top(&path->interior) : splat_uint(0u), row);
    const vec3 scattering = vec3_row(row, MEDIUM_ROW_SCATTERING);
    return vec3_of(sum.x * inverse_or_one(scattering.x), sum.y * inverse_or_one(scattering.y), sum.z * inverse_or_one(scattering.z));
}
#endif

// The flux in each lane's disk, over the whole disk's area.
static void photon_gather(const Scene* scene, const PhotonMap* m, const Surface* surface, vec3 side, vec3 seen, vuint depth, vmask where,
                          vec3* others, vec3* caustics) {
    int is_there[LANES];
    float x[LANES], y[LANES], z[LANES], nx[LANES], ny[LANES], nz[LANES], sx[LANES], sy[LANES], sz[LANES], flat[LANES];
    uint events[LANES];
    lane_store(where, is_there);
    lane_store(surface->point.x, x);
    lane_store(surface->point.y, y);
    lane_store(surface->point.z, z);
    lane_store(side.x, nx);
    lane_store(side.y, ny);
    lane_store(side.z, nz);
    lane_store(seen.x, sx);
    lane_store(seen.y, sy);
    lane_store(seen.z, sz);
    lane_store(disk_flat(surface, side, m->radius), flat);
    lane_store(depth, events);
    const uint most = scene->settings->max_depth;
    for (int lane = 0; lane < LANES; ++lane) {
        PhotonFlux flux;
        flux.others = flux.caustics = (float4)(0.0f);
        if (is_there[lane]) {
            const float left = most == NONE ? FAR : (float)(most - events[lane] - 1u);
            const float4 point = (float4)(x[lane], y[lane], z[lane], 0.0f), normal = (float4)(nx[lane], ny[lane], nz[lane], 0.0f);
            flux = photon_gather_one(m, point, normal, (float4)(sx[lane], sy[lane], sz[lane], 0.0f), flat[lane], left);
        }
        x[lane] = flux.others.x;
        y[lane] = flux.others.y;
        z[lane] = flux.others.z;
        nx[lane] = flux.caustics.x;
        ny[lane] = flux.caustics.y;
        nz[lane] = flux.caustics.z;
    }
    *others = scale(vec3_of(lane_restore(x), lane_restore(y), lane_restore(z)), splat(m->scale));
    *caustics = scale(vec3_of(lane_restore(nx), lane_restore(ny), lane_restore(nz)), splat(m->scale));
}

// Radiant exitance that photons bring to each lane's surface, per reflectance: the flux around it over the area that it is on.
static vec3 photon_irradiance(const Scene* scene, const PhotonMap* m, const Vertex* v, const Path* path, vmask where, PoolStats* stats) {
    vec3 others, caustics;
    // Photons lie on the triangles themselves
    const Surface mesh = terminator_mesh(&v->surface);
    const vec3 side = choose(mesh.front, mesh.normal, negate(mesh.normal));
    photon_gather(scene, m, &mesh, side, v->bsdf.frame.normal, path->depth, where, &others, &caustics);
    vec3 sum = vec3_all(0.0f);
    for (uint kind = 0; kind < 2u; ++kind) {
        const vec3 flux = kind == 0u ? others : caustics;
        const vmask asked = where & (largest(flux) > 0.0f);
        if (!lane_any(asked)) continue;
        const float radius = kind == 0u ? m->radius : m->radius * CAUSTIC_RADIUS;
        const vuint set = DISK_SET + (path->depth * 2u + kind) * DISK_MOST_TRIES;
        sum = add(sum, scale(flux, disk_tries(scene, &mesh, side, path->sample.sampler, set, radius, asked, stats)));
    }
    return sum;
}

static void photon_look(const Scene* given, const PhotonMap* map, Pool* pool, PoolStats* stats) {
    Scene scene[SCENES];
    scenes_of(given, scene);
    CameraRays waiting = camera_rays_none();
    Path path[PACKETS] = {path_none()};
    FreePath free[PACKETS];
    Hit hit[PACKETS];
    Vertex vertex[PACKETS];
    Direct direct;

    while (path_next(scene, pool, &waiting, path)) {
        // Find the nearest surface, and add the light the ray ran into
        EACH_SCENE(k) path_look(&scene[k], pool, path);
        path_find(scene, path, free, hit);
        path_travel(scene, path, free, hit);
        path_vertex(scene, path, hit[0], stats, &vertex[0]);
        path_add_emission(scene, path, vertex);
        path_add_sun(scene, path, vertex);

        // On a diffuse surface add light straight from the lights, and what the photons brought
        path_sample_direct(scene, path, vertex, &direct, stats);
        path_add_direct(scene, path, &direct);
#ifdef MEDIA
        const vmask in_medium = vertex->samples_lights & ball_receives(scene, &path->interior, &vertex->bsdf, vertex->dark);
        if (lane_any(in_medium)) {
            const vec3 arriving = mul(path->throughput, photon_in_medium(scene, map, vertex, path, in_medium, stats));
            path->radiance = choose(in_medium, add(path->radiance, arriving), path->radiance);
        }
#endif
        const vmask gathers = vertex->samples_lights & disk_receives(&vertex->surface);
        if (lane_any(gathers)) {
            const vec3 arriving = photon_irradiance(scene, map, vertex, path, gathers, stats);
            const vec3 leaving = scale(mul(mul(path->throughput, vertex->bsdf.color), arriving), splat(INV_PI));
            path->radiance = choose(gathers, add(path->radiance, leaving), path->radiance);
        }

        // Go on, but not from where photons were gathered
        path_scatter(scene, path, vertex, hit[0]);
        path_deliver(scene, pool, path);
    }
}

#endif
