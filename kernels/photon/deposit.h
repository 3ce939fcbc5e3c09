// What photons leave on diffuse surfaces, and where they scatter in media.
#ifndef PHOTON_DEPOSIT_H
#define PHOTON_DEPOSIT_H

#include "core/exact.h"

// Of a photon's deposits so many are kept, each as likely, for all.
#define PHOTON_DEPOSITS 8u
// A deposit: DEPOSIT_ROW_* of types.h.
#define DEPOSIT_WORDS 12u
// Deposits whose flux counts by the normal that is seen where they are gathered say from where they came: x and y of the direction in the octahedron,
// unfolded where z is negative.
#define DEPOSIT_FROM 0x80000000u
#define DEPOSIT_STEPS 32767.0f
// Caustics are sharp, and have many photons where they are bright: of theirs only those within so much of the radius count.
#define CAUSTIC_RADIUS 0.5f
// In media, so that the ball is as much smaller as the disk: the cube root of the square of that.
#define CAUSTIC_BALL 0.629960525f

static vmask deposit_is_in_medium(vuint kind) { return (kind != 0u) & ((kind & DEPOSIT_FROM) == 0u); }

static vuint deposit_step(vfloat x) { return vuint_of(fma(x, splat(0.5f * DEPOSIT_STEPS), splat(0.5f * DEPOSIT_STEPS + 0.5f))); }

// The unit direction of a photon, as DEPOSIT_ROW_KIND.
static vuint deposit_from(vec3 d) {
    const vfloat one = splat(1.0f), inverse = quotient(one, absolute(d.x) + absolute(d.y) + absolute(d.z));
    const vfloat x = d.x * inverse, y = d.y * inverse;
    const vfloat over_x = (one - absolute(y)) * (x < 0.0f ? -one : one), over_y = (one - absolute(x)) * (y < 0.0f ? -one : one);
    const vmask below = d.z < 0.0f;
    return DEPOSIT_FROM | deposit_step(below ? over_x : x) << 15 | deposit_step(below ? over_y : y);
}

// And back, of any length.
static float4 deposit_direction(uint kind) {
    const float step = 6.1037019e-5f;      // 2 over DEPOSIT_STEPS
    const float x = fma((float)(kind >> 15 & 32767u), step, -1.0f), y = fma((float)(kind & 32767u), step, -1.0f);
    const float z = 1.0f - fabs(x) - fabs(y), over = fmax(-z, 0.0f);
    return (float4)(x < 0.0f ? x + over : x - over, y < 0.0f ? y + over : y - over, z, 0.0f);
}

#endif
