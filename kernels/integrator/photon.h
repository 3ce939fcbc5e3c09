// Stochastic progressive photon mapping (Hachisuka and Jensen 2009) in the form whose passes are independent (Knaus and Zwicker, "Progressive
// photon mapping: a probabilistic approach", ACM TOG 30(3) 2011): each sample of a pixel looks into a photon map of its own, whose radius
// shrinks from map to map, so that noise and blur both vanish in the mean. Consistent, not unbiased.
//
// A path is followed through mirrors and glass to its first diffuse surface; light straight from the lights is added there by shadow
// rays, and all other light from the photons around.
#ifndef INTEGRATOR_PHOTON_H
#define INTEGRATOR_PHOTON_H

#include "integrator/path.h"
#include "photon/deposit.h"
#include "photon/grid.h"

typedef struct {
    __global const float* map;       // [10][stride]: position, direction it came from, flux, scattering events (photon/grid.cl)
    __global const uint* starts;
    uint stride;
    Grid grid;
    float radius;
    float scale;                     // one over number of photons and area of the disk
} PhotonMap;

// Of a photon within the radius at most this far above or below the tangent plane, in radii: around a corner lies another surface.
#define PHOTON_OFF_PLANE 0.25f

// The flux that arrives around a point, on the side of `side`, from photons with at most `depth` scattering events, eight at a time.
static float4 photon_gather_one(const PhotonMap* m, float4 point, float4 side, float depth) {
    const float r = m->radius, r2 = r * r, off = r * PHOTON_OFF_PLANE, caustic_r2 = r2 * (CAUSTIC_RADIUS * CAUSTIC_RADIUS);
    const float4 low = m->grid.low;
    const uint4 size = m->grid.size;
    const uint x0 = grid_along(point.x - r, low.x, low.w, size.x), x1 = grid_along(point.x + r, low.x, low.w, size.x);
    const uint y0 = grid_along(point.y - r, low.y, low.w, size.y), y1 = grid_along(point.y + r, low.y, low.w, size.y);
    const uint z0 = grid_along(point.z - r, low.z, low.w, size.z), z1 = grid_along(point.z + r, low.z, low.w, size.z);
    const uint8 step = (uint8)(0, 1, 2, 3, 4, 5, 6, 7);
    float8 red = (float8)(0.0f), green = (float8)(0.0f), blue = (float8)(0.0f);
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
                const float8 faces = fma(vload8(0, at + 3 * n), (float8)(side.x),
                                         fma(vload8(0, at + 4 * n), (float8)(side.y), vload8(0, at + 5 * n) * side.z));
                const float8 events = vload8(0, at + 9 * n), within = events < 0.0f ? (float8)(caustic_r2) : (float8)(r2);
                const int8 near = (distance2 <= within) & (above <= off) & (above >= -off) & (faces > 0.0f) &
                                  (events <= depth) & (events >= -depth) & (i + step < end);
                red += near ? vload8(0, at + 6 * n) : (float8)(0.0f);
                green += near ? vload8(0, at + 7 * n) : (float8)(0.0f);
                blue += near ? vload8(0, at + 8 * n) : (float8)(0.0f);
            }
        }
    const float4 r4 = red.lo + red.hi, g4 = green.lo + green.hi, b4 = blue.lo + blue.hi;
    const float2 rr = r4.lo + r4.hi, gg = g4.lo + g4.hi, bb = b4.lo + b4.hi;
    return (float4)(rr.x + rr.y, gg.x + gg.y, bb.x + bb.y, 0.0f);
}

// Radiant exitance that photons bring to each lane's surface, per reflectance: the flux around it over the disk's area.
static vec3 photon_irradiance(const Scene* scene, const PhotonMap* m, const Surface* surface, const Bsdf* bsdf, vuint depth, vmask where) {
    int is_there[LANES];
    float x[LANES], y[LANES], z[LANES], nx[LANES], ny[LANES], nz[LANES];
    uint events[LANES];
    lane_store(where, is_there);
    lane_store(surface->point.x, x);
    lane_store(surface->point.y, y);
    lane_store(surface->point.z, z);
    lane_store(bsdf->side.x, nx);
    lane_store(bsdf->side.y, ny);
    lane_store(bsdf->side.z, nz);
    lane_store(depth, events);
    const uint most = scene->settings->max_depth;
    for (int lane = 0; lane < LANES; ++lane) {
        float4 flux = (float4)(0.0f);
        if (is_there[lane]) {
            const float left = most == NONE ? FAR : (float)(most - events[lane] - 1u);
            flux = photon_gather_one(m, (float4)(x[lane], y[lane], z[lane], 0.0f), (float4)(nx[lane], ny[lane], nz[lane], 0.0f), left);
        }
        x[lane] = flux.x;
        y[lane] = flux.y;
        z[lane] = flux.z;
    }
    return scale(vec3_of(lane_restore(x), lane_restore(y), lane_restore(z)), splat(m->scale));
}

static void photon_look(const Scene* scene, const PhotonMap* map, Pool* pool, PoolStats* stats) {
    __global const Settings* settings = scene->settings;
    Path path = path_none();

    while (path_next(scene, pool, &path)) {
        // Find the nearest surface, and add the light the ray ran into
        const Hit hit = traverse_nearest(&scene->bvh, &path.ray, path.alive);
        const vmask found = path.alive & (hit.primitive != NONE);
        const Surface surface = surface_at(scene, &path.ray, hit, found);
        stats->rays += lane_count(path.alive);
        stats->deepest = pool_deepest(stats->deepest, path.depth, path.alive);
        path.radiance = choose(path.alive, add(path.radiance, path_emission(scene, &path, &surface, found)), path.radiance);

        // On a diffuse surface add light straight from the lights, and what the photons brought
        const Bsdf bsdf = bsdf_at(&surface, path.ray.direction);
        const vmask may_scatter = found & (path.depth < settings->max_depth);
        const vmask diffuse = may_scatter & bsdf.smooth;
        if (lane_any(diffuse)) {
            if (settings->light_count > 0) path_add_direct(scene, &path, &surface, &bsdf, diffuse, stats);
            const vec3 arriving = photon_irradiance(scene, map, &surface, &bsdf, path.depth, diffuse);
            const vec3 leaving = scale(mul(mul(path.throughput, bsdf.color), arriving), splat(INV_PI));
            path.radiance = choose(diffuse, add(path.radiance, leaving), path.radiance);
        }

        // Follow mirrors and glass: settings have no indirect rays, so that a path ends at a diffuse surface
        const vmask goes_on = path_scatter(scene, &path, &surface, &bsdf, may_scatter);
        const vmask done = path.alive & !goes_on;
        if (lane_any(done)) pool_deliver(pool, &path.sample, path.radiance, done);
        path.alive = path.alive & !done;
    }
}

#endif
