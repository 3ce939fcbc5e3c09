// Stripes over texture coordinates, whose values are from low to high.
//
// [plugin]
// name = "grain"
// kind = "texture"
// needs = ["uv"]
// [parameters]
// low = { type = "color", default = [0.3, 0.4, 0.5] }
// high = { type = "color", default = [0.8, 0.7, 0.6] }

// The colour at texture coordinates; the position in the world does not matter.
static vec3 grain_value(const GrainParameters* p, vfloat u, vfloat v, vec3 position) {
    const vfloat at = fma(u, splat(3.0f), v) - floor(fma(u, splat(3.0f), v));
    return along(p->low, sub(p->high, p->low), at);
}
