// A light-emitting diode with a lens: by the angle from its axis its intensity is a sum of Gaussians, here a lobe around the axis and a
// ring (Moreno and Sun, "Modeling the radiation pattern of LEDs", Optics Express 16(3), 2008).
//
// [plugin]
// name = "led"
// kind = "light"
// cone_degrees = 180.0
// [parameters]
// lobe = { type = "color", default = [1.0, 1.0, 1.0], max = 1e5, about = "intensity of the lobe along the axis, W/sr" }
// lobe_angle = { type = "number", default = 35.0, min = 1.0, max = 90.0, about = "angle at which it is half of that, degrees" }
// ring = { type = "color", default = [0.5, 0.5, 0.5], max = 1e5, about = "largest intensity of the ring, W/sr" }
// ring_angle = { type = "number", default = 60.0, min = 0.0, max = 90.0, about = "angle at which it has that, degrees" }
// ring_width = { type = "number", default = 12.0, min = 1.0, max = 90.0, about = "from there to where it is half of that, degrees" }

// Half at the distance `width` from the middle, both degrees.
static vfloat led_gaussian(vfloat angle, vfloat middle, vfloat width) {
    const vfloat x = quotient(angle - middle, width);
    return exp2_of(-(x * x));
}

// W/sr by colour. The direction is a unit vector away from the light; z is its axis.
static vec3 led_intensity(const LedParameters* p, vec3 direction) {
    const vfloat across = root(fma(direction.x, direction.x, direction.y * direction.y));
    const vfloat angle = turn_of(direction.z, across) * 360.0f;
    const vec3 lobe = scale(p->lobe, led_gaussian(angle, splat(0.0f), p->lobe_angle));
    return along(lobe, p->ring, led_gaussian(angle, p->ring_angle, p->ring_width));
}
