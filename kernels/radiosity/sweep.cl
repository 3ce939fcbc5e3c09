// Entry point of the iteration: what reaches each side of what the sides that it sees send out. A row in every work-item.

// out[row] = mean over the row's rays of sent[hits]; rgb. hits: uint [rows][rays], sides; sent: by side. Four sums, so that an addition
// need not wait for the one before, of every fourth ray each: the same order, so the same bits, everywhere.
__kernel void radiosity_sweep(__global const uint* hits, uint rows, uint rays, float share, __global const float4* sent,
                              __global float4* out) {
    const uint row = (uint)get_global_id(0);
    if (row >= rows) return;
    __global const uint* met = hits + (size_t)row * rays;
    float4 a = (float4)(0.0f), b = a, c = a, d = a;
    uint k = 0;
    for (; k + 3u < rays; k += 4u) {
        a = a + sent[met[k]];
        b = b + sent[met[k + 1u]];
        c = c + sent[met[k + 2u]];
        d = d + sent[met[k + 3u]];
    }
    for (; k < rays; ++k) a = a + sent[met[k]];
    out[row] = ((a + b) + (c + d)) * share;
}
