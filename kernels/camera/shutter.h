// The time of a sample, while the shutter is open; and a camera that moves meanwhile.
//
// A moving camera's row has it where it is when the shutter opens. Rays are made there, and carried to where it is at their time.
#ifndef CAMERA_SHUTTER_H
#define CAMERA_SHUTTER_H

#include "core/sampler.h"
#include "geometry/motion.h"
#include "geometry/ray.h"
#include "scene.h"

#ifdef MOTION

// As times are: geometry/motion.h.
static vfloat shutter_share(vfloat x) { return vfloat_of(vint_of(lesser(x * 16777216.0f, splat(16777215.0f)))) * EPSILON; }

// Of all pixels and paths from lights, for sample number `pass` of each: so they can be joined.
static vfloat shutter_time_of_pass(const Scene* scene, uint pass) {
    __global const Settings* settings = scene->settings;
    const vuint index = splat_uint(sampler_within(pass, settings->replicate_spp));
    const Sampler own = sampler_start_in(settings->seed, sampler_replicate(pass, settings->replicate_spp), splat_uint(NONE), index);
    vfloat u, unused;
    sampler_get(own, SET_TIME, &u, &unused);
    return shutter_share(u);
}

// Of a sample of a pixel; where rows open one after the other, at this height of the film.
static vfloat shutter_time(const Scene* scene, uint view, Sampler sampler, uint pass, vfloat film_y) {
#ifdef SHARED_TIME
    return shutter_time_of_pass(scene, pass);
#else
    __global const Camera* camera = scene->camera + view;
    const float rows = (float)scene->settings->height;
    vfloat u, unused;
    sampler_get(sampler, SET_TIME, &u, &unused);
    const vfloat row = vfloat_of(vint_of(bounded(film_y * rows, 0.0f, rows - 1.0f)));
    return shutter_share(fma(u, splat(camera->open), row * quotient_one(camera->readout, rows)));
#endif
}

static void shutter_camera_map(const Scene* scene, const Camera* camera, vfloat time, MotionMap* map) {
    motion_at(scene->camera_knots, splat_uint(camera->first_knot), splat_uint(camera->segments), time, map);
}

// From where it rests to where it is at a time, and back.
static vec3 shutter_point(const Camera* camera, const MotionMap* map, vec3 p) {
    return add(motion_turned(map->linear, sub(p, vec3_from(camera->origin))), motion_offset(map));
}
static vec3 shutter_direction(const MotionMap* map, vec3 d) { return unit(motion_turned(map->linear, d)); }
static vec3 shutter_point_back(const Camera* camera, const MotionMap* map, vec3 p) { return add(motion_point_back(map, p), vec3_from(camera->origin)); }
static vec3 shutter_direction_back(const MotionMap* map, vec3 d) { return unit(motion_turned(map->inverse, d)); }

static int shutter_camera_moves(const Camera* camera) { return camera->segments > 0u; }

#else

static vfloat shutter_time_of_pass(const Scene* scene, uint pass) { return splat(0.0f); }
static vfloat shutter_time(const Scene* scene, uint view, Sampler sampler, uint pass, vfloat film_y) { return splat(0.0f); }

#endif

#endif
