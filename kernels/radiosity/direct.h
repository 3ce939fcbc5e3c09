// Light that reaches a point of a surface straight from the scene's lights: one of them, sampled.
#ifndef RADIOSITY_DIRECT_H
#define RADIOSITY_DIRECT_H

#include "light/light.h"

typedef struct {
    vec3 irradiance;     // W/m², if nothing hides it; zero: there is nothing to hide
    Ray ray;             // that has to be free
} DirectSample;

static DirectSample direct_sample(const Scene* scene, const Surface* s, vec3 normal, Sampler sampler) {
    const LightSample light = light_sample(scene, s->point, normal, s->primitive, sampler, sampler_set(splat_uint(0u), SET_LIGHT));
    const vfloat cosine = inner(light.direction, normal);
    const vmask usable = (light.pdf > 0.0f) & (cosine > 0.0f);
    DirectSample d;
    d.irradiance = choose(usable, scale(light.radiance, cosine * inverse_or_one(light.pdf)), vec3_all(0.0f));
    d.ray = light_shadow_ray(s, &light);
    return d;
}

#endif
