// The pixel of every slot, for a test: x, y, and whether it is in the image.
#include "film/slot.h"

__kernel void slot_order(__global const Settings* settings, uint count, __global uint* pixels) {
    const uint slot = (uint)get_global_id(0) * LANES;
    if (slot >= count) return;
    vuint x, y;
    const vmask inside = slot_pixel(settings, slot_block(settings, slot), slot + lane_index(), &x, &y);
    lane_save(x, pixels + slot);
    lane_save(y, pixels + count + slot);
    lane_save((inside ? splat_uint(1u) : splat_uint(0u)), pixels + 2 * (size_t)count + slot);
}
