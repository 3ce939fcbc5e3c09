// Pinhole and thin lens: a ray through a point of the film, given in [0, 1)², and a random point of the lens.
#ifndef CAMERA_PERSPECTIVE_H
#define CAMERA_PERSPECTIVE_H

#include "core/sampler.h"
#include "core/warp.h"
#include "geometry/ray.h"
#include "scene.h"

static Ray perspective_ray(const Scene* scene, vfloat film_x, vfloat film_y, Sampler sampler) {
    const Camera camera = *scene->camera;
    const int has_lens = camera.lens_u.x != 0.0f || camera.lens_u.y != 0.0f || camera.lens_u.z != 0.0f;
    vec3 on_lens = vec3_all(0.0f);
    if (has_lens) {
        vfloat u, v, x, y;
        sampler_get(sampler, SET_LENS, &u, &v);
        warp_disk(u, v, &x, &y);
        on_lens = along(scale(vec3_from(camera.lens_u), x), vec3_from(camera.lens_v), y);
    }
    const vec3 in_focus = along(along(vec3_from(camera.corner), vec3_from(camera.right), film_x), vec3_from(camera.down), film_y);
    return ray_make(add(vec3_from(camera.origin), on_lens), unit(sub(in_focus, on_lens)));
}

#endif
