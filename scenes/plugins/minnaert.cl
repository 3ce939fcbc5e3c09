// Minnaert's law of dusty surfaces such as the Moon's ("The reciprocity principle in lunar photometry", ApJ 93, 1941):
// f = r (k + 1) / (2 pi) (cos i cos e)^(k - 1). With k = 1 it is Lambert's; above, the limb is darker.
//
// [plugin]
// name = "minnaert"
// kind = "bsdf"
// claims = ["reciprocal"]
// [parameters]
// reflectance = { type = "color", default = [0.5, 0.5, 0.5], about = "share of light that is reflected where it is seen straight on" }
// k = { type = "number", default = 1.3, min = 1.0, max = 4.0, about = "limb darkening" }

// f in 1/sr, without the cosine. Local frame: z is the normal on the side of wo; wo.z and wi.z are above 0.
static vec3 minnaert_eval(const MinnaertParameters* p, vec3 wo, vec3 wi) {
    const vfloat limb = power(wo.z * wi.z, p->k - 1.0f);
    return scale(p->reflectance, (p->k + 1.0f) * (0.5f * INV_PI) * limb);
}

// Density per steradian of the directions below.
static vfloat minnaert_pdf(const MinnaertParameters* p, vec3 wo, vec3 wi) {
    return (p->k + 1.0f) * (0.5f * INV_PI) * power(wi.z, p->k);
}

// A direction of light; u, v and w are random numbers from 0 to 1. The cosine has the density (k + 1) cos^k.
static vec3 minnaert_sample(const MinnaertParameters* p, vec3 wo, vfloat u, vfloat v, vfloat w) {
    const vfloat z = power(u, quotient(splat(1.0f), p->k + 1.0f)), r = root(fma(-z, z, splat(1.0f)));
    vfloat c, s;
    cos_sin_turn(v, &c, &s);
    return vec3_of(r * c, r * s, greater(z, splat(1.0e-6f)));
}

// The share of light along wo that is scattered.
static vec3 minnaert_albedo(const MinnaertParameters* p, vec3 wo) {
    return scale(p->reflectance, power(wo.z, p->k - 1.0f));
}
