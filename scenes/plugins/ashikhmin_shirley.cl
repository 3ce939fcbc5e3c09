// Varnish over a matt base, and brushed metal: the anisotropic Phong model of Ashikhmin and Shirley ("An anisotropic Phong BRDF model",
// Journal of Graphics Tools 5(2), 2000). Equation numbers are theirs.
//
// [plugin]
// name = "ashikhmin_shirley"
// kind = "bsdf"
// needs = ["tangents"]
// claims = ["reciprocal"]
// [parameters]
// diffuse = { type = "color", default = [0.3, 0.3, 0.3], about = "colour of the base" }
// specular = { type = "color", default = [0.05, 0.05, 0.05], about = "reflectance of the coat where it is seen straight on" }
// n_u = { type = "number", default = 20.0, min = 0.0, max = 1000.0, about = "exponent along the x axis" }
// n_v = { type = "number", default = 200.0, min = 0.0, max = 1000.0, about = "exponent along the y axis" }

// The exponent in the azimuth of h: n_u cos^2 + n_v sin^2.
static vfloat ashikhmin_shirley_exponent(const AshikhminShirleyParameters* p, vec3 h) {
    const vfloat x2 = h.x * h.x, y2 = h.y * h.y;
    return fma(p->n_u, x2, p->n_v * y2) * inverse_or_one(x2 + y2);
}

// (1 - a / 2)^5
static vfloat ashikhmin_shirley_fifth(vfloat a) {
    const vfloat b = fma(a, splat(-0.5f), splat(1.0f)), b2 = b * b;
    return b2 * b2 * b;
}

static vfloat ashikhmin_shirley_half_pdf(const AshikhminShirleyParameters* p, vec3 h) {
    return root((p->n_u + 1.0f) * (p->n_v + 1.0f)) * (0.5f * INV_PI) * power(h.z, ashikhmin_shirley_exponent(p, h));
}

static vec3 ashikhmin_shirley_eval(const AshikhminShirleyParameters* p, vec3 wo, vec3 wi) {
    const vec3 h = unit(add(wo, wi)), white = vec3_all(1.0f);
    const vfloat c = greater(inner(h, wi), splat(1.0e-6f)), m = splat(1.0f) - c, m2 = m * m;
    const vec3 fresnel = along(p->specular, sub(white, p->specular), m2 * m2 * m);
    const vfloat gloss = quotient(ashikhmin_shirley_half_pdf(p, h), c * greater(wo.z, wi.z) * 4.0f);      // (3)
    const vfloat layers = (splat(1.0f) - ashikhmin_shirley_fifth(wi.z)) * (splat(1.0f) - ashikhmin_shirley_fifth(wo.z));
    const vec3 base = scale(mul(p->diffuse, sub(white, p->specular)), layers * (28.0f / 23.0f * INV_PI));  // (5)
    return along(base, fresnel, gloss);
}

static vfloat ashikhmin_shirley_pdf(const AshikhminShirleyParameters* p, vec3 wo, vec3 wi) {
    const vec3 h = unit(add(wo, wi));
    const vfloat glossy = quotient(ashikhmin_shirley_half_pdf(p, h), greater(inner(h, wi), splat(1.0e-6f)) * 4.0f);  // (8)
    return fma(glossy, splat(0.5f), wi.z * (0.5f * INV_PI));
}

// Half of the directions by the cosine, half around the mirrored one. The azimuth of h has tangent √((n_u + 1)/(n_v + 1)) tan(v 2π), (9).
static vec3 ashikhmin_shirley_sample(const AshikhminShirleyParameters* p, vec3 wo, vfloat u, vfloat v, vfloat w) {
    vfloat c, s;
    cos_sin_turn(v, &c, &s);
    const vec3 level = unit(vec3_of(c * root(p->n_v + 1.0f), s * root(p->n_u + 1.0f), splat(0.0f)));
    const vfloat z = power(splat(1.0f) - u, quotient(splat(1.0f), ashikhmin_shirley_exponent(p, level) + 1.0f));  // (10)
    const vfloat r = root(fma(-z, z, splat(1.0f)));
    const vec3 h = vec3_of(level.x * r, level.y * r, z), mirrored = sub(scale(h, inner(wo, h) * 2.0f), wo);
    return choose(w < 0.5f, mirrored, warp_cosine_hemisphere(u, v));
}
