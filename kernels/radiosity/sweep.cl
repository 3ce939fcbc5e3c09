// Entry point of the iteration: what each side reflects of what the sides that it sees send out. A row in every work-item.

// out[row] = reflectance[row] × mean over the row's rays of sent[hits]; rgb. hits: uint [rows][rays], sides; sent: by side. With
// `few`, only sides whose bit in `senders` is set send anything, and the others are not looked at: the bits fit the nearest cache.
// Always summed in the order of the rays, so the result is the same bits everywhere.
__kernel void radiosity_sweep(__global const uint* hits, uint rows, uint rays, float share, __global const float4* reflectance,
                              __global const float4* sent, uint few, __global const uint* senders, __global float4* out) {
    const uint row = (uint)get_global_id(0);
    if (row >= rows) return;
    __global const uint* met = hits + (size_t)row * rays;
    float4 sum = (float4)(0.0f);
    if (few) {
        for (uint k = 0; k < rays; ++k) {
            const uint side = met[k];
            if (senders[side >> 5] >> (side & 31u) & 1u) sum = sum + sent[side];
        }
    } else {
        for (uint k = 0; k < rays; ++k) sum = sum + sent[met[k]];
    }
    out[row] = reflectance[row] * (sum * share);
}
