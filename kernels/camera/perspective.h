// Pinhole and thin lens: a ray through a point of the film and a point of the lens, both given by numbers in [0, 1).
#ifndef CAMERA_PERSPECTIVE_H
#define CAMERA_PERSPECTIVE_H

#include "core/warp.h"
#include "geometry/ray.h"
#include "scene.h"

static Ray perspective_ray(const Scene* scene, vfloat film_x, vfloat film_y, vfloat u, vfloat v) {
    const Camera camera = *scene->camera;
    vfloat x, y;
    warp_disk(u, v, &x, &y);
    const vec3 on_lens = along(scale(vec3_from(camera.lens_u), x), vec3_from(camera.lens_v), y);
    const vec3 in_focus = along(along(vec3_from(camera.corner), vec3_from(camera.right), film_x), vec3_from(camera.down), film_y);
    Ray ray;
    ray.origin = add(vec3_from(camera.origin), on_lens);
    ray.direction = unit(sub(in_focus, on_lens));
    ray.limit = splat(FAR);
    ray.from = splat_uint(NONE);
    ray.to = splat_uint(NONE);
    return ray;
}

#endif
