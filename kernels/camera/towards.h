// From a point of the scene to the camera: the inverse of camera_ray, for light that comes from the lamps. And the density of camera rays.
//
// A camera measures the mean of the radiance over each pixel. So what counts is how many pixels a steradian covers that is seen from the
// camera, or, where all rays have the same direction, a square metre across them: camera_density. At a distance r, a square metre
// that is seen head-on covers 1/r² steradian.
#ifndef CAMERA_TOWARDS_H
#define CAMERA_TOWARDS_H

#include "camera/camera.h"

// Whether rays of the camera have a density by area alone: those of a point of the lens are parallel.
static int camera_is_parallel(const Scene* scene) { return scene->camera->kind == CAMERA_ORTHOGRAPHIC; }

// At least this much of a denominator counts.
#define CAMERA_LEAST 1.0e-20f

// Pixels per steradian, or per square metre across parallel rays, about a ray of the camera of this origin and direction, where it rests.
static vfloat camera_resting_density(const Scene* scene, vec3 origin, vec3 direction) {
    const Camera camera = *scene->camera;
    const vfloat pixels = splat((float)scene->settings->width * (float)scene->settings->height);
#ifdef CALIBRATED_CAMERA
    if (camera_is_calibrated(&camera)) {
        const CalibratedPlace place = calibrated_place(&camera, sub(origin, vec3_from(camera.origin)), direction);
        return place.density * pixels * (camera.focal.x * camera.focal.y);
    }
#endif
    if (camera.kind == CAMERA_PANORAMIC) {
        // Longitude and colatitude are 2π and π times the place on the film
        const vfloat cosine = inner(direction, vec3_from(camera.down)), sine = root(fma(cosine, -cosine, splat(1.0f)));
        return quotient(pixels, greater(sine * (2.0f * PI * PI), splat(CAMERA_LEAST)));
    }
    if (camera.kind == CAMERA_FISHEYE) {
        // The angle from the axis is `most` times the distance from the middle, in halves of the film's height
        const vfloat cosine = inner(direction, vec3_from(camera.axis)), sine = root(fma(cosine, -cosine, splat(1.0f)));
        const float most = 2.0f * PI * camera.angle;
        const vfloat r = quotient(turn_of(cosine, sine), splat(camera.angle));
        const vfloat stretch = sine > 1.0e-6f ? quotient(r, greater(sine, splat(CAMERA_LEAST))) : splat(quotient_one(1.0f, most));
        return quotient(stretch * pixels, splat(4.0f * camera.aspect * most));
    }
    // Of the plane in focus, which the film covers: its normal, of the length of its area
    const vec3 across = outer(vec3_from(camera.right), vec3_from(camera.down));
    const vfloat slope = greater(absolute(inner(direction, across)), splat(CAMERA_LEAST));
    if (camera.kind != CAMERA_PERSPECTIVE) return quotient(pixels, slope);
    const vfloat distance = quotient(absolute(inner(vec3_from(camera.corner), across)), slope);
    return quotient(pixels * distance * distance, slope);
}

// The same at a time.
static vfloat camera_density(const Scene* scene, vec3 origin, vec3 direction, vfloat time) {
#ifdef MOTION
    const Camera camera = *scene->camera;
    if (shutter_camera_moves(&camera)) {
        MotionMap map;
        shutter_camera_map(scene, &camera, time, &map);
        return camera_resting_density(scene, shutter_point_back(&camera, &map, origin), shutter_direction_back(&map, direction));
    }
#endif
    return camera_resting_density(scene, origin, direction);
}

// How a point is seen.
typedef struct {
    vec3 direction;          // unit, from the point
    vec3 target;             // a point of the lens, or of the film of parallel rays
    vfloat density;          // pixels per square metre that is seen head-on; 0: the camera does not see it
    vfloat film_x, film_y;   // as for camera_ray; they may lie beyond the film
} CameraView;

// Through a point of the lens, chosen by two numbers in [0, 1).
static CameraView camera_towards_lens(const Camera* camera, vec3 point, vfloat u, vfloat v) {
    const vec3 on_lens = camera_has_lens(camera) ? camera_on_lens(camera, u, v) : vec3_all(0.0f);
    const vec3 right = vec3_from(camera->right), down = vec3_from(camera->down), corner = vec3_from(camera->corner);
    const vec3 from_lens = sub(sub(point, vec3_from(camera->origin)), on_lens);
    vec3 in_focus, ray;
    vmask ahead;
    CameraView view;
    if (camera->kind == CAMERA_PERSPECTIVE) {
        // Where the ray from the lens through the point meets the plane in focus
        const vec3 across = outer(right, down);
        const vfloat plane = inner(corner, across), slope = inner(from_lens, across);
        ahead = ((slope > 0.0f) & (plane > 0.0f)) | ((slope < 0.0f) & (plane < 0.0f));
        in_focus = along(on_lens, from_lens, quotient(plane, ahead ? slope : splat(1.0f)));
        view.target = add(vec3_from(camera->origin), on_lens);
        ray = from_lens;
    } else {
        const vec3 axis = vec3_from(camera->axis);
        ray = sub(axis, on_lens);
        const vfloat steps = quotient(inner(from_lens, axis), greater(inner(axis, axis), splat(CAMERA_LEAST)));
        ahead = steps > 0.0f;
        in_focus = add(along(from_lens, ray, -steps), axis);
        view.target = along(point, ray, -steps);
    }
    const vec3 on_plane = sub(in_focus, corner);
    view.film_x = quotient(inner(on_plane, right), greater(inner(right, right), splat(CAMERA_LEAST)));
    view.film_y = quotient(inner(on_plane, down), greater(inner(down, down), splat(CAMERA_LEAST)));
    view.direction = negate(unit(ray));
    view.density = ahead ? splat(1.0f) : splat(0.0f);
    return view;
}

#ifdef CALIBRATED_CAMERA
static CameraView camera_towards_calibrated(const Camera* camera, vec3 point, vfloat u, vfloat v) {
    const vec3 on_lens = camera_has_lens(camera) ? camera_on_lens(camera, u, v) : vec3_all(0.0f);
    CameraView view;
    view.target = add(vec3_from(camera->origin), on_lens);
    const vec3 seen = unit(sub(point, view.target));
    const CalibratedPlace place = calibrated_place(camera, on_lens, seen);
    view.direction = negate(seen);
    view.density = place.density;
    view.film_x = fma(place.x, splat(camera->focal.x), fma(place.y, splat(camera->focal.z), splat(camera->principal.x)));
    view.film_y = fma(place.y, splat(camera->focal.y), splat(camera->principal.y));
    return view;
}
#endif

static CameraView camera_towards_center(const Camera* camera, vec3 point) {
    const vec3 origin = vec3_from(camera->origin), seen = unit(sub(point, origin));
    const vec3 axis = vec3_from(camera->axis), right = vec3_from(camera->right), down = vec3_from(camera->down);
    const vfloat x = inner(seen, right), y = inner(seen, down), z = inner(seen, axis);
    CameraView view;
    view.target = origin;
    view.direction = negate(seen);
    view.density = splat(1.0f);
    if (camera->kind == CAMERA_PANORAMIC) {
        const vfloat turn = turn_of(z, x) + 0.5f;
        view.film_x = turn < 1.0f ? turn : turn - 1.0f;
        view.film_y = turn_of(-y, root(fma(x, x, z * z))) * 2.0f;
        return view;
    }
    const vfloat sine = root(fma(x, x, y * y));
    const vfloat r = quotient(turn_of(z, sine), splat(camera->angle)), share = r * inverse_or_one(sine);
    view.film_x = fma(quotient(x * share, splat(camera->aspect)), splat(0.5f), splat(0.5f));
    view.film_y = fma(y * share, splat(0.5f), splat(0.5f));
    view.density = r > 1.0f ? splat(0.0f) : view.density;
    return view;
}

static CameraView camera_towards_resting(const Scene* scene, vec3 point, vfloat u, vfloat v) {
    const Camera camera = *scene->camera;
    const int center = camera.kind == CAMERA_PANORAMIC || camera.kind == CAMERA_FISHEYE;
    CameraView view;
#ifdef CALIBRATED_CAMERA
    if (camera_is_calibrated(&camera)) view = camera_towards_calibrated(&camera, point, u, v);
    else
#endif
        view = center ? camera_towards_center(&camera, point) : camera_towards_lens(&camera, point, u, v);
    const vec3 to = sub(view.target, point);
    const vfloat distance2 = camera_is_parallel(scene) ? splat(1.0f) : greater(inner(to, to), splat(CAMERA_LEAST));
    view.density = view.density > 0.0f ? quotient(camera_resting_density(scene, view.target, negate(view.direction)), distance2) : splat(0.0f);
    return view;
}

// At a time.
static CameraView camera_towards(const Scene* scene, vec3 point, vfloat u, vfloat v, vfloat time) {
#ifdef MOTION
    const Camera camera = *scene->camera;
    if (shutter_camera_moves(&camera)) {
        MotionMap map;
        shutter_camera_map(scene, &camera, time, &map);
        CameraView view = camera_towards_resting(scene, shutter_point_back(&camera, &map, point), u, v);
        view.direction = shutter_direction(&map, view.direction);
        view.target = shutter_point(&camera, &map, view.target);
        return view;
    }
#endif
    return camera_towards_resting(scene, point, u, v);
}

#endif
