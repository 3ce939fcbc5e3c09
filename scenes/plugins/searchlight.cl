// A searchlight with the beam of a laser: on a screen across it the irradiance is a Gaussian (A. E. Siegman, "Lasers", 1986, chapter 17).
//
// [plugin]
// name = "searchlight"
// kind = "light"
// cone_degrees = 120.0
// [parameters]
// power = { type = "number", default = 100.0, max = 1e6, about = "radiant flux, W" }
// tint = { type = "color", default = [1.0, 1.0, 1.0], about = "share of each colour" }
// divergence = { type = "number", default = 3.0, min = 0.1, max = 20.0, about = "angle from the axis where 1/e² is left, degrees" }

// The square of the tangent of the divergence.
static vfloat searchlight_width(const SearchlightParameters* p) {
    vfloat c, s;
    cos_sin_turn(p->divergence * (1.0f / 360.0f), &c, &s);
    const vfloat tangent = quotient(s, c);
    return tangent * tangent;
}

// The share of the power per steradian, and so the density of directions: 2 exp(-2 t²/w²) / (π w² cos³), with t the tangent.
static vfloat searchlight_pdf(const SearchlightParameters* p, vec3 direction) {
    const vfloat z = greater(direction.z, splat(0.5f)), width = searchlight_width(p);  // 0.5 at the edge of the cone
    const vfloat t2 = quotient(fma(direction.x, direction.x, direction.y * direction.y), z * z);
    return quotient(exp2_of(quotient(t2 * -2.88539008f, width)) * (2.0f * INV_PI), width * z * z * z);
}

static vec3 searchlight_intensity(const SearchlightParameters* p, vec3 direction) {
    return scale(p->tint, p->power * searchlight_pdf(p, direction));
}

// A direction with that density: t² = -w²/2 ln(1 - u).
static vec3 searchlight_sample(const SearchlightParameters* p, vfloat u, vfloat v) {
    const vfloat t = root(searchlight_width(p) * log2_of(splat(1.0f) - u) * -0.34657359f);
    vfloat c, s;
    cos_sin_turn(v, &c, &s);
    return unit(vec3_of(t * c, t * s, splat(1.0f)));
}
