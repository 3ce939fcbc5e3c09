// Cameras: a ray through a point of the film and a random point of the lens (PBR 4ed, 5.2 and 5.3). The film is [0, 1)²; with a pixel
// filter (film/filter.h) a point may lie beyond its edges, where each kind of camera sees what the film would show if it went on.
#ifndef CAMERA_CAMERA_H
#define CAMERA_CAMERA_H

#include "camera/calibrated.h"
#include "camera/lens.h"
#include "camera/shutter.h"
#include "core/sampler.h"
#include "geometry/ray.h"
#include "scene.h"

// Through a lens, or a pinhole: all rays of a point of the film meet where they are in focus. Without perspective they begin on a plane.
static Ray camera_lens_ray(const Camera* camera, vfloat film_x, vfloat film_y, Sampler sampler) {
    vec3 on_lens = vec3_all(0.0f);
    if (camera_has_lens(camera)) {
        vfloat u, v;
        sampler_get(sampler, SET_LENS, &u, &v);
        on_lens = camera_on_lens(camera, u, v);
    }
    const vec3 in_focus = along(along(vec3_from(camera->corner), vec3_from(camera->right), film_x), vec3_from(camera->down), film_y);
    if (camera->kind == CAMERA_PERSPECTIVE) return ray_make(add(vec3_from(camera->origin), on_lens), unit(sub(in_focus, on_lens)));
    const vec3 axis = vec3_from(camera->axis), on_film = sub(in_focus, axis);
    return ray_make(add(vec3_from(camera->origin), add(on_film, on_lens)), unit(sub(axis, on_lens)));
}

#ifdef PIXEL_FILTER
// The same angle in [0, 1): of any number of turns.
static vfloat camera_part_of_turn(vfloat turn) {
    const vfloat part = turn - vfloat_of(vint_of(turn)), positive = part < 0.0f ? part + 1.0f : part;
    return positive < 1.0f ? positive : splat(0.0f);
}
#endif

// All directions, in longitude and latitude: the middle of the image looks along the axis.
static Ray camera_panoramic_ray(const Camera* camera, vfloat film_x, vfloat film_y) {
    vfloat c, s, cosine, sine;
    const vfloat turn = film_x - 0.5f;
#ifdef PIXEL_FILTER
    // Beyond the left edge is the right one. Beyond a pole it goes down on the other side: there the sine is negative, which turns `level`
    cos_sin_turn(camera_part_of_turn(turn), &c, &s);
    cos_sin_turn(camera_part_of_turn(film_y * 0.5f), &cosine, &sine);
#else
    cos_sin_turn(turn < 0.0f ? turn + 1.0f : turn, &c, &s);
    cos_sin_turn(film_y * 0.5f, &cosine, &sine);                     // from the zenith
#endif
    const vec3 level = along(scale(vec3_from(camera->axis), c), vec3_from(camera->right), s);
    return ray_make(vec3_from(camera->origin), unit(along(scale(level, sine), vec3_from(camera->down), -cosine)));
}

// The angle from the axis grows with the distance from the middle of the image (equidistant projection). What lies beyond the image's
// upper edge from there on all sides is dark: the ray has no length.
static Ray camera_fisheye_ray(const Camera* camera, vfloat film_x, vfloat film_y) {
    const vfloat x = fma(film_x, splat(2.0f), splat(-1.0f)) * camera->aspect, y = fma(film_y, splat(2.0f), splat(-1.0f));
    const vfloat r = root(fma(x, x, y * y)), turn = lesser(r, splat(1.0f)) * camera->angle;
    vfloat cosine, sine;
    cos_sin_turn(turn, &cosine, &sine);
    const vfloat share = sine * inverse_or_one(r);
    const vec3 aside = along(scale(vec3_from(camera->right), x * share), vec3_from(camera->down), y * share);
    Ray ray = ray_make(vec3_from(camera->origin), unit(along(aside, vec3_from(camera->axis), cosine)));
    ray.limit = r > 1.0f ? splat(0.0f) : ray.limit;
    return ray;
}

static Ray camera_resting_ray(const Camera* camera, vfloat film_x, vfloat film_y, Sampler sampler) {
#ifdef CALIBRATED_CAMERA
    if (camera_is_calibrated(camera)) return camera_calibrated_ray(camera, film_x, film_y, sampler);
#endif
    if (camera->kind == CAMERA_PANORAMIC) return camera_panoramic_ray(camera, film_x, film_y);
    if (camera->kind == CAMERA_FISHEYE) return camera_fisheye_ray(camera, film_x, film_y);
    return camera_lens_ray(camera, film_x, film_y, sampler);
}

// Of one of the scene's cameras, at a time.
static Ray camera_ray(const Scene* scene, uint view, vfloat film_x, vfloat film_y, Sampler sampler, vfloat time) {
    const Camera camera = scene->camera[view];
    Ray ray = ray_in_time(camera_resting_ray(&camera, film_x, film_y, sampler), time);
#ifdef MOTION
    if (shutter_camera_moves(&camera)) {
        MotionMap map;
        shutter_camera_map(scene, &camera, time, &map);
        ray.origin = shutter_point(&camera, &map, ray.origin);
        ray.direction = shutter_direction(&map, ray.direction);
    }
#endif
    return ray;
}

// Whether a ray of the camera sees anything.
static vmask camera_sees(const Ray* ray) { return ray->limit > 0.0f; }

#endif
