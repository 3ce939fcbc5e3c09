// The order in which pixels are worked on. Slots run through the image tile by tile, inside a tile block by block of 4 × 4 pixels,
// so that a work-item's lanes look in almost the same direction. A tile's side is a multiple of 4; slots outside the image exist
// and are passed over. clrender/film/unit.py computes the same.
#ifndef FILM_SLOT_H
#define FILM_SLOT_H

#include "core/lane.h"
#include "types.h"

// The part of the image that is rendered, which is all of it but for a crop; pixels of a slot are counted from its corner.
static uint slot_columns(__global const Settings* settings) { return settings->width - settings->less_width; }
static uint slot_rows(__global const Settings* settings) {
    return settings->views > 0 ? settings->views * settings->view_rows : settings->height - settings->less_height;
}

// Of several cameras, the one whose image has this block, and the first row of its image in the film. Blocks below the film count as the last one's.
static uint slot_view(__global const Settings* settings, uint2 block) {
    const uint whole_divisor = settings->view_rows;
    return settings->views > 0 ? min(block.y / whole_divisor, settings->views - 1u) : 0u;
}
static uint slot_view_top(__global const Settings* settings, uint2 block) { return slot_view(settings, block) * settings->view_rows; }

// Where the block of 16 slots that holds `slot` begins: its top left pixel.
static uint2 slot_block(__global const Settings* settings, uint slot) {
    const uint tile = settings->tile;
    const uint tiles_across = (slot_columns(settings) + tile - 1) / tile, blocks_across = tile / 4;
    const uint number = slot / (tile * tile), block = (slot - number * (tile * tile)) / 16;
    const uint row = number / tiles_across, block_row = block / blocks_across;
    return (uint2)((number - row * tiles_across) * tile + (block - block_row * blocks_across) * 4, row * tile + block_row * 4);
}

// The slot of a pixel.
static vuint slot_of(__global const Settings* settings, vuint x, vuint y) {
    const uint tile = settings->tile, tiles_across = (slot_columns(settings) + tile - 1) / tile;
    const vuint column = x / tile, row = y / tile, in_x = x - column * tile, in_y = y - row * tile;
    const vuint block = (in_y >> 2) * (tile / 4) + (in_x >> 2);
    return (row * tiles_across + column) * (tile * tile) + block * 16u + (in_y & 3u) * 4u + (in_x & 3u);
}

// The pixels of slots that share that block, and whether they are in the image.
static vmask slot_pixel(__global const Settings* settings, uint2 block, vuint slot, vuint* x, vuint* y) {
    *x = block.x + (slot & 3u);
    *y = block.y + ((slot >> 2) & 3u);
    return (*x < slot_columns(settings)) & (*y < slot_rows(settings));
}

#endif
