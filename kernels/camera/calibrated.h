// Calibrated cameras (-D CALIBRATED_CAMERA): lenses with the distortion of Brown and Conrady, or of Kannala and Brandt. Their formulas, and what
// the field of a lens is, are in clrender/cameras/distortion.py; here, too, a place on the film is turned into a direction by a fixed number of
// steps. Places on the film are in focal lengths from the principal point, x to the right and y down.
#ifndef CAMERA_CALIBRATED_H
#define CAMERA_CALIBRATED_H

#include "camera/lens.h"
#include "core/exact.h"

#ifdef CALIBRATED_CAMERA

// Bisections, and steps of Newton's method, for the radius, or the angle; then steps on the film, for what is not radial. In single precision
// more change nothing, for 300 random lenses to the edge of their field.
#define CALIBRATED_HALVINGS 6
#define CALIBRATED_NEWTON_STEPS 4
#define CALIBRATED_FILM_STEPS 4
// Relative error of a place from which on it counts as outside of the field.
#define CALIBRATED_TOLERANCE 1.0e-4f
#define CALIBRATED_LEAST_SLOPE 1.0e-6f

static int camera_is_calibrated(const Camera* camera) { return camera->kind == CAMERA_BROWN_CONRADY || camera->kind == CAMERA_KANNALA_BRANDT; }

// 1 + k1 q + k2 q² + k3 q³, and its derivative.
static vfloat calibrated_polynomial(vfloat q, float k1, float k2, float k3) {
    return fma(q, fma(q, fma(q, splat(k3), splat(k2)), splat(k1)), splat(1.0f));
}
static vfloat calibrated_derivative(vfloat q, float k1, float k2, float k3) {
    return fma(q, fma(q, splat(3.0f * k3), splat(2.0f * k2)), splat(k1));
}

// The radial factor of Brown and Conrady, and its derivative with respect to the square of the radius.
static vfloat calibrated_ratio(const Camera* c, vfloat q, vfloat* derivative) {
    const vfloat above = calibrated_polynomial(q, c->radial.x, c->radial.y, c->radial.z);
    const vfloat below = calibrated_polynomial(q, c->rational.x, c->rational.y, c->rational.z);
    const vfloat inverse = quotient(splat(1.0f), greater(below, splat(CALIBRATED_LEAST_SLOPE)));
    const vfloat ratio = above * inverse, down = calibrated_derivative(q, c->rational.x, c->rational.y, c->rational.z);
    *derivative = (calibrated_derivative(q, c->radial.x, c->radial.y, c->radial.z) - ratio * down) * inverse;
    return ratio;
}

// The distance on the film of a radius, or of an angle, without what is not radial; and its derivative.
static vfloat calibrated_distance(const Camera* c, vfloat r, vfloat* derivative) {
    const vfloat q = r * r;
    if (c->kind == CAMERA_KANNALA_BRANDT) {
        const float4 k = c->radial;
        const vfloat factor = fma(q, fma(q, fma(q, fma(q, splat(k.w), splat(k.z)), splat(k.y)), splat(k.x)), splat(1.0f));
        *derivative = fma(q, fma(q, fma(q, fma(q, splat(9.0f * k.w), splat(7.0f * k.z)), splat(5.0f * k.y)), splat(3.0f * k.x)), splat(1.0f));
        return r * factor;
    }
    vfloat slope;
    const vfloat ratio = calibrated_ratio(c, q, &slope);
    *derivative = fma(q + q, slope, ratio);
    return r * ratio;
}

// The inverse.
static vfloat calibrated_radius(const Camera* c, vfloat distance) {
    vfloat low = splat(0.0f), high = splat(c->field.x), slope;
    for (int i = 0; i < CALIBRATED_HALVINGS; ++i) {
        const vfloat middle = (low + high) * 0.5f;
        const vmask below = calibrated_distance(c, middle, &slope) < distance;
        low = below ? middle : low;
        high = below ? high : middle;
    }
    vfloat r = (low + high) * 0.5f;
    for (int i = 0; i < CALIBRATED_NEWTON_STEPS; ++i) {
        const vfloat off = calibrated_distance(c, r, &slope) - distance;
        low = off < 0.0f ? r : low;
        high = off < 0.0f ? high : r;
        const vfloat step = quotient(off, greater(slope, splat(CALIBRATED_LEAST_SLOPE)));
        r = lesser(greater(r - step, low), high);
    }
    return r;
}

// Where Brown's and Conrady's lens takes the direction (x, y, 1), and the derivatives there: of the first by x, of the first by y, which is that
// of the second by x, and of the second by y.
typedef struct {
    vfloat x, y;
    vfloat xx, xy, yy;
} Bent;

static Bent calibrated_bent(const Camera* c, vfloat x, vfloat y) {
    const float p1 = c->principal.z, p2 = c->principal.w;
    const vfloat q = fma(x, x, y * y);
    vfloat derivative;
    const vfloat ratio = calibrated_ratio(c, q, &derivative), slope = derivative + derivative;
    Bent b;
    b.x = fma(x, ratio, fma(2.0f * p1 * x, y, p2 * fma(2.0f * x, x, q)));
    b.y = fma(y, ratio, fma(2.0f * p2 * x, y, p1 * fma(2.0f * y, y, q)));
    b.xx = fma(x * x, slope, ratio) + fma(y, splat(2.0f * p1), x * (6.0f * p2));
    b.xy = fma(x * y, slope, fma(x, splat(2.0f * p1), y * (2.0f * p2)));
    b.yy = fma(y * y, slope, ratio) + fma(y, splat(6.0f * p1), x * (2.0f * p2));
    return b;
}
static vfloat calibrated_area(const Bent* b) { return fma(b->xx, b->yy, -(b->xy * b->xy)); }

static vmask calibrated_in_field(const Camera* c, vfloat x, vfloat y, const Bent* b) {
    return (fma(x, x, y * y) < c->field.y * c->field.y) & (calibrated_area(b) > 0.0f);
}

// The direction of a place, right, down and forward; (x, y, 1) of Brown's and Conrady's lens, a unit vector of Kannala's and Brandt's.
static vec3 calibrated_direction(const Camera* c, vfloat place_x, vfloat place_y, vmask* seen) {
    const vfloat distance = root(fma(place_x, place_x, place_y * place_y)), r = calibrated_radius(c, distance);
    const vfloat tolerance = fma(distance, splat(CALIBRATED_TOLERANCE), splat(CALIBRATED_TOLERANCE));
    if (c->kind == CAMERA_KANNALA_BRANDT) {
        vfloat slope, cosine, sine;
        *seen = (absolute(calibrated_distance(c, r, &slope) - distance) <= tolerance) & (r < c->field.y);
        cos_sin_turn(r * quotient_one(1.0f, 2.0f * PI), &cosine, &sine);
        const vfloat share = sine * inverse_or_one(distance);
        return vec3_of(place_x * share, place_y * share, cosine);
    }
    // Just within the field, as what is not radial may have its end before that of what is
    const vfloat start = lesser(r, splat(c->field.y * 0.98f));
    const vfloat share = distance > 0.0f ? start * inverse_or_one(distance) : splat(1.0f);
    vfloat x = place_x * share, y = place_y * share;
    Bent b = calibrated_bent(c, x, y);
    if (c->principal.z != 0.0f || c->principal.w != 0.0f) {
        for (int i = 0; i < CALIBRATED_FILM_STEPS; ++i) {
            const vfloat off_x = b.x - place_x, off_y = b.y - place_y, area = calibrated_area(&b);
            const vfloat sized = absolute(area) > CALIBRATED_LEAST_SLOPE ? area : splat(CALIBRATED_LEAST_SLOPE);
            x = x - quotient(fma(b.yy, off_x, -(b.xy * off_y)), sized);
            y = y - quotient(fma(b.xx, off_y, -(b.xy * off_x)), sized);
            b = calibrated_bent(c, x, y);
        }
    }
    *seen = (absolute(b.x - place_x) <= tolerance) & (absolute(b.y - place_y) <= tolerance) & calibrated_in_field(c, x, y, &b);
    return vec3_of(x, y, splat(1.0f));
}

static vec3 calibrated_in_scene(const Camera* c, vec3 way) {
    return along(along(scale(vec3_from(c->right), way.x), vec3_from(c->down), way.y), vec3_from(c->axis), way.z);
}

static Ray camera_calibrated_ray(const Camera* camera, vfloat film_x, vfloat film_y, Sampler sampler) {
    const vfloat place_y = quotient(film_y - camera->principal.y, splat(camera->focal.y));
    const vfloat place_x = quotient(fma(place_y, splat(-camera->focal.z), film_x - camera->principal.x), splat(camera->focal.x));
    vmask seen;
    const vec3 found = calibrated_direction(camera, place_x, place_y, &seen);
    // Outside of the field the steps may lead anywhere
    const vec3 way = calibrated_in_scene(camera, choose(seen, found, vec3_of(splat(0.0f), splat(0.0f), splat(1.0f))));
    Ray ray;
    if (camera_has_lens(camera)) {
        vfloat u, v;
        sampler_get(sampler, SET_LENS, &u, &v);
        const vec3 on_lens = camera_on_lens(camera, u, v);
        ray = ray_make(add(vec3_from(camera->origin), on_lens), unit(sub(scale(way, splat(camera->focal.w)), on_lens)));
    } else {
        ray = ray_make(vec3_from(camera->origin), unit(way));
    }
    ray.limit = seen ? ray.limit : splat(0.0f);
    return ray;
}

// A direction from the camera's origin, or for Brown's and Conrady's lens the place in focus of one from elsewhere on the lens: its place on the film, in
// focal lengths, and how much of the film's area, in squares of the focal length, a steradian covers there. 0: the camera does not see it.
typedef struct {
    vfloat x, y;
    vfloat density;
} CalibratedPlace;

static CalibratedPlace calibrated_place(const Camera* c, vec3 on_lens, vec3 direction) {
    const vfloat right = inner(direction, vec3_from(c->right)), down = inner(direction, vec3_from(c->down));
    const vfloat ahead = inner(direction, vec3_from(c->axis));
    CalibratedPlace place;
    if (c->kind == CAMERA_KANNALA_BRANDT) {
        const vfloat sine = root(fma(right, right, down * down)), angle = turn_of(ahead, sine) * (2.0f * PI);
        vfloat slope;
        const vfloat distance = calibrated_distance(c, angle, &slope), stretch = sine > 1.0e-6f ? quotient(distance, greater(sine, splat(1.0e-6f))) : splat(1.0f);
        place.x = right * stretch;
        place.y = down * stretch;
        place.density = angle < c->field.y ? greater(stretch * slope, splat(0.0f)) : splat(0.0f);
        return place;
    }
    const vmask before = ahead > 1.0e-6f;
    const vfloat inverse = quotient(splat(1.0f), before ? ahead : splat(1.0f));
    const float nearer = quotient_one(1.0f, c->focal.w);
    const vfloat x = fma(right, inverse, inner(on_lens, vec3_from(c->right)) * nearer);
    const vfloat y = fma(down, inverse, inner(on_lens, vec3_from(c->down)) * nearer);
    const Bent b = calibrated_bent(c, x, y);
    place.x = b.x;
    place.y = b.y;
    // Area in the plane at distance 1, over cos³, is a steradian
    place.density = before & calibrated_in_field(c, x, y, &b) ? calibrated_area(&b) * inverse * inverse * inverse : splat(0.0f);
    return place;
}

#endif

#endif
