// The sun: a disc infinitely far away that is darker towards its limb. It is built only where a scene has one (-D SUN).
//
// sample: a direction of its cone, uniformly by solid angle, and the density of that. along: what is seen in a direction, and the density with which it
// would have been sampled, 0 outside of the disc. Nothing of it is seen below the horizon.
#ifndef LIGHT_SUN_H
#define LIGHT_SUN_H

#include "core/frame.h"
#include "core/warp.h"
#include "light/environment.h"
#include "light/row.h"

#ifdef SUN

// The sun's table, SUN_ROW_*, is the first of scene->lamp_tables; clrender/flatten/sky.py writes it.
static vmask sun_is(const LightRow* l) { return l->kind == LIGHT_SUN; }
static vec3 sun_axis(const Scene* scene) { return vec3_from(vload4(0, scene->lamp_tables + SUN_ROW_AXIS)); }
static float sun_spread(const Scene* scene) { return scene->lamp_tables[SUN_ROW_SPREAD]; }
static uint sun_light(const Scene* scene) { return as_uint(scene->lamp_tables[SUN_ROW_LIGHT]); }

static vfloat sun_polynomial(__global const float* coefficients, vfloat x) {
    vfloat sum = splat(coefficients[5]);
    for (int power = 4; power >= 0; --power) sum = fma(sum, x, splat(coefficients[power]));
    return greater(sum, splat(0.0f));
}

// Radiance where the cosine of the angle from the sun's middle is 1 - drop: by the cosine at which a ray meets the sun's surface there.
static vec3 sun_radiance(const Scene* scene, vec3 direction, vfloat drop) {
    __global const float* table = scene->lamp_tables;
    const float spread = sun_spread(scene);
    const vfloat sine2 = drop * (splat(2.0f) - drop), cosine = root(splat(1.0f) - quotient(sine2, spread * (2.0f - spread)));
    const vec3 radiance = vec3_of(sun_polynomial(table + SUN_ROW_RED, cosine), sun_polynomial(table + SUN_ROW_GREEN, cosine),
                                  sun_polynomial(table + SUN_ROW_BLUE, cosine));
    return color_light(scene, choose(direction.y > 0.0f, radiance, vec3_all(0.0f)));
}

static EnvironmentSample sun_sample(const Scene* scene, vfloat u, vfloat v) {
    const vfloat spread = splat(sun_spread(scene));
    EnvironmentSample s;
    s.direction = direction_again(frame_to_world(frame_around(sun_axis(scene)), warp_cone(u, v, spread)));
    s.radiance = sun_radiance(scene, s.direction, u * spread);
    s.pdf = warp_cone_pdf(spread);
    return s;
}

static EnvironmentSample sun_along(const Scene* scene, vec3 direction) {
    const vfloat spread = splat(sun_spread(scene));
    const vec3 off_axis = sub(direction, sun_axis(scene));
    const vfloat drop = inner(off_axis, off_axis) * 0.5f;            // 1 - cosine, with all its digits near the axis
    const vmask inside = drop < spread;
    EnvironmentSample s;
    s.direction = direction;
    s.radiance = choose(inside, sun_radiance(scene, direction, drop), vec3_all(0.0f));
    s.pdf = inside ? warp_cone_pdf(spread) : splat(0.0f);
    return s;
}

// On a surface that faces it, of its mean radiance: where the light is the sun.
static vec3 sun_irradiance(const Scene* scene, vec3 radiance, vmask sun) {
    return choose(sun, scale(radiance, splat(2.0f * PI * sun_spread(scene))), radiance);
}

#else

static vmask sun_is(const LightRow* l) { return mask_none(); }
static vec3 sun_irradiance(const Scene* scene, vec3 radiance, vmask sun) { return radiance; }

#endif
#endif
