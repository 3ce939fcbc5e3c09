// Wood: rings around the y axis of the world, bent by noise.
//
// [plugin]
// name = "wood"
// kind = "texture"
// [parameters]
// early = { type = "color", default = [0.64, 0.42, 0.22], about = "colour of the wood that grew in spring" }
// late = { type = "color", default = [0.33, 0.17, 0.08], about = "colour of the wood that grew in summer" }
// rings = { type = "number", default = 12.0, min = 0.1, max = 1000.0, about = "rings per metre" }
// bend = { type = "number", default = 0.6, min = 0.0, max = 10.0, about = "by how many rings they are bent" }
#include "core/sampler.h"

// A number from 0 to 1 for each corner of a lattice.
static vfloat wood_corner(vint x, vint y, vint z) {
    return unit_interval(hash_pair(hash_pair(vuint_from_int(x), vuint_from_int(y)), vuint_from_int(z)));
}

static vfloat wood_between(vfloat a, vfloat b, vfloat share) { return fma(share, b - a, a); }

// Value noise: between the corners of the lattice, smooth steps.
static vfloat wood_noise(vec3 at) {
    const vint x = vint_of(floor(at.x)), y = vint_of(floor(at.y)), z = vint_of(floor(at.z));
    const vfloat a = at.x - floor(at.x), b = at.y - floor(at.y), c = at.z - floor(at.z);
    const vfloat u = a * a * fma(a, splat(-2.0f), splat(3.0f)), v = b * b * fma(b, splat(-2.0f), splat(3.0f));
    const vfloat w = c * c * fma(c, splat(-2.0f), splat(3.0f));
    vfloat plane[2];
    for (int i = 0; i < 2; ++i) {
        const vfloat low = wood_between(wood_corner(x, y, z + i), wood_corner(x + 1, y, z + i), u);
        const vfloat high = wood_between(wood_corner(x, y + 1, z + i), wood_corner(x + 1, y + 1, z + i), u);
        plane[i] = wood_between(low, high, v);
    }
    return wood_between(plane[0], plane[1], w);
}

// The colour at a point of the world, metres; u and v are 0, as the header does not ask for texture coordinates.
static vec3 wood_value(const WoodParameters* p, vfloat u, vfloat v, vec3 position) {
    const vfloat radius = root(fma(position.x, position.x, position.z * position.z));
    const vfloat rings = fma(radius, p->rings, wood_noise(scale(position, splat(3.0f))) * p->bend);
    const vfloat ring = rings - floor(rings);
    return along(p->early, sub(p->late, p->early), ring * ring * ring);
}
