// The lens of a camera: where it is, and a random point of it.
#ifndef CAMERA_LENS_H
#define CAMERA_LENS_H

#include "core/sampler.h"
#include "core/warp.h"
#include "geometry/ray.h"
#include "scene.h"

// A point of the lens: a disk, or a regular polygon in it where the diaphragm has blades.
static void camera_lens(const Camera* camera, vfloat u, vfloat v, vfloat* x, vfloat* y) {
    if (camera->blades == 0u) {
        warp_disk(u, v, x, y);
        return;
    }
    // One of the triangles between the centre and two neighbouring corners, then a point of it
    const float count = (float)camera->blades;
    const vfloat number = vfloat_of(vint_of(u * count));
    vfloat b1, b2, c1, s1, c2, s2;
    warp_triangle(bounded(u * count - number, 0.0f, 1.0f), v, &b1, &b2);
    const vfloat first = quotient(number, count) + camera->blade_turn, second = quotient(number + 1.0f, count) + camera->blade_turn;
    cos_sin_turn(first < 1.0f ? first : first - 1.0f, &c1, &s1);
    cos_sin_turn(second < 1.0f ? second : second - 1.0f, &c2, &s2);
    *x = fma(b1, c1, b2 * c2);
    *y = fma(b1, s1, b2 * s2);
}

static int camera_has_lens(const Camera* camera) { return camera->lens_u.x != 0.0f || camera->lens_u.y != 0.0f || camera->lens_u.z != 0.0f; }

// The same in the scene, from the middle of the lens.
static vec3 camera_on_lens(const Camera* camera, vfloat u, vfloat v) {
    vfloat x, y;
    camera_lens(camera, u, v, &x, &y);
    return along(scale(vec3_from(camera->lens_u), x), vec3_from(camera->lens_v), y);
}

#endif
