// Entry point of progressive photon mapping, for one sample of each pixel: its photon map is ready.
#include "integrator/photon.h"

// samples and stats: as integrator_path in path.cl. low, size: the grid of photon/grid.h.
__kernel GROUPED void integrator_photon(SCENE_PARAMETERS uint first_slot, uint slot_count, uint first_sample, uint sample_count,
                                        __global float* restrict samples, __global uint4* restrict stats,
                                        __global const float* restrict map, __global const uint* restrict starts, uint stride,
                                        uint words, float4 low, uint4 size, float radius, float per_photon) {
    SCENE_COLLECT(scene);
    Pool pool = pool_open(settings, samples, first_slot, slot_count, first_sample, sample_count);
    PoolStats counted = {0, 0, splat_uint(0u)};
    PhotonMap photons;
    photons.map = map;
    photons.starts = starts;
    photons.stride = stride;
    photons.words = words;
    photons.grid.low = low;
    photons.grid.size = size;
    photons.radius = radius;
    photons.scale = per_photon;
    if (pool.base < slot_count) photon_look(&scene, &photons, &pool, &counted);
    stats[get_global_id(0)] = (uint4)(counted.rays, counted.shadow_rays, lane_largest_uint(counted.deepest), 0u);
}
