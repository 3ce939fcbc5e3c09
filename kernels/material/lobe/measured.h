// Reflectance that was measured: tables of the RGL database (Dupuy and Jakob 2018) and of MERL (Matusik et al. 2003).
//
// A half vector m at the polar angle θ and the azimuth φ is the point (√(2θ/π), φ/2π + ½) of a unit square. For some directions towards the viewer
// there is a density over that square, about as that of the normals that are seen from there; between them it is interpolated. It makes a map M of
// the unit square onto itself. A second density says where in it light is sampled. Of RGL,
//
//     f cosθi = D(m) / (4 σ(ωo)) v(M⁻¹(m))
//
// with colours v from tables for the same directions (their equation 12); of MERL, f is looked up by half vector and difference (Rusinkiewicz
// 1998), and only the density is made of it (clrender.flatten.measured).
//
// Both need not be quite reciprocal: ωo is the direction towards the viewer. Frame: local, z = shading normal on the side of `wo`.
#ifndef MATERIAL_LOBE_MEASURED_H
#define MATERIAL_LOBE_MEASURED_H

#include "core/exact.h"
#include "types.h"

#define MERL_HALVES 90
#define MERL_DIFFERENCES 90
#define MERL_TURNS 180
#define MEASURED_VIEWS 4

// A density over a unit square, bilinear between its numbers, and its integrals: along each row, and over rows.
typedef struct {
    vuint width, height;
    vuint numbers, rows, column;        // words where each of them begins
} MeasuredDensity;

typedef struct {
    vmask present;
    __global const float* words;
    vuint flags;
    vec3 wo;                            // on the side that symmetry leaves
    vmask flip_x, flip_y;               // where a direction's components change their signs for that
    vfloat azimuth;                     // of the viewer, in turns, where only differences matter
    uint views;                         // how many directions the lanes interpolate between
    vuint view[MEASURED_VIEWS];
    vfloat share[MEASURED_VIEWS];
    MeasuredDensity normals, luminance;
    vuint values, side, facets, facets_width, facets_height;
    vfloat area;                        // 1 / (4 σ)
    vec3 albedo;
} Measured;

// Interpolated between the directions towards the viewer, each of which has `stride` numbers.
static vfloat measured_number(const Measured* m, vuint at, vuint stride) {
    vfloat sum = lane_gather(m->words, at + m->view[0] * stride) * m->share[0];
    for (uint k = 1; k < m->views; ++k) sum = fma(lane_gather(m->words, at + m->view[k] * stride), m->share[k], sum);
    return sum;
}

static vuint measured_least(vuint a, vuint b) { return a < b ? a : b; }

// The cell of numbers 0 to count − 1 that x, 0 to 1, lies in, and how far within.
static vuint measured_cell(vfloat x, vuint count, vfloat* within) {
    const vfloat scaled = x * vfloat_of(vint_from_uint(count - 1u));
    const vuint cell = measured_least(vuint_from_int(vint_of(scaled)), count - 2u);
    *within = lesser(scaled - vfloat_of(vint_from_uint(cell)), splat(1.0f));
    return cell;
}

// Of a table with two axes that does not depend on the direction.
static vfloat measured_bilinear(const Measured* m, vuint at, vuint width, vuint height, vfloat x, vfloat y) {
    vfloat s, t;
    const vuint column = measured_cell(x, width, &s), row = measured_cell(y, height, &t);
    const vuint first = at + row * width + column;
    const vfloat a = lane_gather(m->words, first), b = lane_gather(m->words, first + 1u);
    const vfloat c = lane_gather(m->words, first + width), d = lane_gather(m->words, first + width + 1u);
    const vfloat upper = fma(s, b - a, a), lower = fma(s, d - c, c);
    return fma(t, lower - upper, upper);
}

// Where the integral from 0 of a function that goes from a to b, none below 0, comes to `area`.
static vfloat measured_part(vfloat a, vfloat b, vfloat area) {
    const vfloat below = a + root(fma(a, a, (b - a) * area * 2.0f));
    return bounded(area * 2.0f * inverse_or_one(below), 0.0f, 1.0f);
}

// The integral of a row up to `column`, at a share `t` of the way to the next row.
static vfloat measured_row(const Measured* m, const MeasuredDensity* d, vuint row, vuint column, vfloat t) {
    const vuint at = d->rows + row * d->width + column, stride = d->width * d->height;
    const vfloat upper = measured_number(m, at, stride), lower = measured_number(m, at + d->width, stride);
    return fma(t, lower - upper, upper);
}

// A point of the square with the density d, of two random numbers, which are changed to it. Returns the density there.
static vfloat measured_sample_density(const Measured* m, const MeasuredDensity* d, vfloat* x, vfloat* y) {
    vuint low = splat_uint(0u), high = d->height - 2u;
    while (lane_any(low < high)) {
        const vuint middle = (low + high + 1u) >> 1;
        const vmask reached = measured_number(m, d->column + middle, d->height) <= *y;
        high = reached | !(low < high) ? high : middle - 1u;
        low = reached ? middle : low;
    }
    const vuint row = low, last = d->width - 1u;
    const vfloat none = splat(0.0f), rows = vfloat_of(vint_from_uint(d->height - 1u)), columns = vfloat_of(vint_from_uint(last));
    const vfloat first = measured_row(m, d, row, last, none), next = measured_row(m, d, row, last, splat(1.0f));
    const vfloat t = measured_part(first, next, (*y - measured_number(m, d->column + row, d->height)) * rows);
    const vfloat sought = *x * fma(t, next - first, first);
    low = splat_uint(0u), high = d->width - 2u;
    while (lane_any(low < high)) {
        const vuint middle = (low + high + 1u) >> 1;
        const vmask reached = measured_row(m, d, row, middle, t) <= sought;
        high = reached | !(low < high) ? high : middle - 1u;
        low = reached ? middle : low;
    }
    const vuint at = d->numbers + row * d->width + low, stride = d->width * d->height;
    const vfloat upper = measured_number(m, at, stride), right = measured_number(m, at + 1u, stride);
    const vfloat a = fma(t, measured_number(m, at + d->width, stride) - upper, upper);
    const vfloat b = fma(t, measured_number(m, at + d->width + 1u, stride) - right, right);
    const vfloat s = measured_part(a, b, (sought - measured_row(m, d, row, low, t)) * columns);
    *x = quotient(vfloat_of(vint_from_uint(low)) + s, columns);
    *y = quotient(vfloat_of(vint_from_uint(row)) + t, rows);
    return fma(s, b - a, a);
}

// The density at a point, and where `map` is given, the two numbers that the point is sampled by.
static vfloat measured_density(const Measured* m, const MeasuredDensity* d, vfloat* x, vfloat* y, int map) {
    vfloat s, t;
    const vuint column = measured_cell(*x, d->width, &s), row = measured_cell(*y, d->height, &t);
    const vuint at = d->numbers + row * d->width + column, stride = d->width * d->height;
    const vfloat upper = measured_number(m, at, stride), right = measured_number(m, at + 1u, stride);
    const vfloat a = fma(t, measured_number(m, at + d->width, stride) - upper, upper);
    const vfloat b = fma(t, measured_number(m, at + d->width + 1u, stride) - right, right);
    if (map) {
        const vfloat rows = vfloat_of(vint_from_uint(d->height - 1u)), columns = vfloat_of(vint_from_uint(d->width - 1u)), none = splat(0.0f);
        const vfloat first = measured_row(m, d, row, d->width - 1u, none), next = measured_row(m, d, row, d->width - 1u, splat(1.0f));
        const vfloat along_row = quotient(s * fma(s * 0.5f, b - a, a), columns) + measured_row(m, d, row, column, t);
        *x = bounded(along_row * inverse_or_one(fma(t, next - first, first)), 0.0f, 1.0f);
        *y = bounded(quotient(t * fma(t * 0.5f, next - first, first), rows) + measured_number(m, d->column + row, d->height), 0.0f, 1.0f);
    }
    return fma(s, b - a, a);
}

// Of the ascending numbers of a table the one before x, and the share of the next.
static vuint measured_between(__global const float* words, vuint at, vuint count, vfloat x, vfloat* share) {
    vuint low = splat_uint(0u), high = count > 1u ? count - 2u : splat_uint(0u);
    while (lane_any(low < high)) {
        const vuint middle = (low + high + 1u) >> 1;
        const vmask reached = lane_gather(words, at + middle) <= x;
        high = reached | !(low < high) ? high : middle - 1u;
        low = reached ? middle : low;
    }
    const vmask several = count > 1u;
    const vfloat before = lane_gather(words, at + low), after = lane_gather(words, at + low + (several ? splat_uint(1u) : splat_uint(0u)));
    const vfloat part = (x - before) * inverse_or_one(after - before);
    *share = several ? bounded(part, 0.0f, 1.0f) : splat(0.0f);
    return low;
}

// The polar angle of a unit vector, in turns.
static vfloat measured_polar(vec3 v) { return turn_of(v.z, root(fma(v.x, v.x, v.y * v.y))); }

static vec3 measured_flipped(const Measured* m, vec3 v) { return vec3_of(m->flip_x ? -v.x : v.x, m->flip_y ? -v.y : v.y, v.z); }

// What is seen along `wo`. `head`: the first row of each lane's tables.
static void measured_prepare(__global const float* rows, __global const float* words, vuint head, vec3 wo, vmask present, Measured* m) {
    vfloat a[16], b[16];
    head = present ? head : splat_uint(0u);
    lane_rows(rows, head, a);
    lane_rows(rows, head + 1u, b);
    m->present = present;
    m->words = words;
    m->flags = vfloat_bits(a[MEASURED_ROW_FLAGS]);
    m->normals.width = vfloat_bits(a[MEASURED_ROW_NORMALS_WIDTH]), m->normals.height = vfloat_bits(a[MEASURED_ROW_NORMALS_HEIGHT]);
    m->side = m->luminance.width = m->luminance.height = vfloat_bits(a[MEASURED_ROW_SIDE]);
    m->facets_width = vfloat_bits(a[MEASURED_ROW_FACETS_WIDTH]), m->facets_height = vfloat_bits(a[MEASURED_ROW_FACETS_HEIGHT]);
    m->normals.numbers = vfloat_bits(b[MEASURED_ROW_NORMALS - 16]);
    m->normals.rows = vfloat_bits(b[MEASURED_ROW_NORMALS_ROWS - 16]), m->normals.column = vfloat_bits(b[MEASURED_ROW_NORMALS_COLUMN - 16]);
    m->luminance.numbers = vfloat_bits(b[MEASURED_ROW_LUMINANCE - 16]);
    m->luminance.rows = vfloat_bits(b[MEASURED_ROW_LUMINANCE_ROWS - 16]);
    m->luminance.column = vfloat_bits(b[MEASURED_ROW_LUMINANCE_COLUMN - 16]);
    m->values = vfloat_bits(b[MEASURED_ROW_VALUES - 16]), m->facets = vfloat_bits(b[MEASURED_ROW_FACETS - 16]);

    // Of a surface that looks the same after half a turn, or in a mirror, too, a part was measured
    const vmask quarters = (m->flags & MEASURED_QUARTERS) != 0u, halves = (m->flags & MEASURED_HALVES) != 0u;
    m->flip_y = (halves | quarters) & (wo.y >= 0.0f);
    m->flip_x = (halves & (wo.y >= 0.0f)) | (quarters & (wo.x >= 0.0f));
    m->wo = measured_flipped(m, wo);

    // Directions that were measured, around this one
    const vuint thetas = vfloat_bits(a[MEASURED_ROW_THETAS]), phis = vfloat_bits(a[MEASURED_ROW_PHIS]);
    const vuint angles = vfloat_bits(b[MEASURED_ROW_ANGLES - 16]);
    const vmask level = (m->wo.x == 0.0f) & (m->wo.y == 0.0f);
    const vfloat polar = measured_polar(m->wo), turn = level ? splat(0.0f) : turn_of(m->wo.x, m->wo.y);
    const vfloat azimuth = turn > 0.5f ? turn - 1.0f : turn;
    vfloat up, around;
    const vuint theta = measured_between(words, angles, thetas, polar * (2.0f * PI), &up);
    const vuint phi = measured_between(words, angles + thetas, phis, azimuth * (2.0f * PI), &around);
    const vuint above = thetas > 1u ? theta + 1u : theta, beside = phis > 1u ? phi + 1u : phi;
    m->azimuth = (m->flags & MEASURED_ISOTROPIC) != 0u ? azimuth : splat(0.0f);
    m->views = lane_any(around > 0.0f) ? 4u : 2u;
    m->view[0] = phi * thetas + theta, m->view[1] = phi * thetas + above;
    m->view[2] = beside * thetas + theta, m->view[3] = beside * thetas + above;
    m->share[0] = (splat(1.0f) - around) * (splat(1.0f) - up), m->share[1] = (splat(1.0f) - around) * up;
    m->share[2] = around * (splat(1.0f) - up), m->share[3] = around * up;

    const vuint width = vfloat_bits(a[MEASURED_ROW_PROJECTED_WIDTH]), height = vfloat_bits(a[MEASURED_ROW_PROJECTED_HEIGHT]);
    const vfloat projected =
        measured_bilinear(m, vfloat_bits(b[MEASURED_ROW_PROJECTED - 16]), width, height, root(polar * 4.0f), azimuth + 0.5f);
    m->area = quotient(splat(0.25f), greater(projected, splat(1.0e-8f)));
    const vuint albedo = vfloat_bits(b[MEASURED_ROW_ALBEDO - 16]), three = splat_uint(3u);
    m->albedo = vec3_of(measured_number(m, albedo, three), measured_number(m, albedo + 1u, three), measured_number(m, albedo + 2u, three));
}

// f by half vector and difference; trilinear between the middles of its steps.
static vec3 measured_merl(const Measured* m, vec3 wm, vec3 wi) {
    const vfloat across = root(fma(wm.x, wm.x, wm.y * wm.y));
    const vmask pole = across < 1.0e-7f;
    const vfloat c = pole ? splat(1.0f) : quotient(wm.x, pole ? splat(1.0f) : across), s = pole ? splat(0.0f) : quotient(wm.y, pole ? splat(1.0f) : across);
    const vec3 x_axis = vec3_of(wm.z * c, wm.z * s, -across), y_axis = vec3_of(-s, c, splat(0.0f));
    const vfloat x = inner(x_axis, wi), y = inner(y_axis, wi), z = inner(wm, wi), level = root(fma(x, x, y * y));
    const vfloat half_at = fma(root(measured_polar(wm) * 4.0f), splat((float)MERL_HALVES), splat(-0.5f));
    const vfloat difference_at = fma(turn_of(z, level), splat(4.0f * MERL_DIFFERENCES), splat(-0.5f));
    const vfloat turn = level > 0.0f ? turn_of(x, y) : splat(0.0f), positive = turn < 0.5f ? turn : turn - 0.5f;
    const vfloat turn_at = fma(positive, splat(2.0f * MERL_TURNS), splat(-0.5f));
    const vfloat h = bounded(half_at, 0.0f, (float)(MERL_HALVES - 1)), d = bounded(difference_at, 0.0f, (float)(MERL_DIFFERENCES - 1));
    const vint h0 = vint_of(bounded(h, 0.0f, (float)(MERL_HALVES - 2))), d0 = vint_of(bounded(d, 0.0f, (float)(MERL_DIFFERENCES - 2)));
    // The steps of the turn go round: after half a turn, half vector and difference are the same again
    const vfloat wrapped = turn_at < 0.0f ? turn_at + (float)MERL_TURNS : lesser(turn_at, splat(MERL_TURNS - 0.5f));
    const vint t0 = vint_of(lesser(wrapped, splat((float)(MERL_TURNS - 1)))), t1 = t0 < MERL_TURNS - 1 ? t0 + 1 : vint_of(splat(0.0f));
    const vfloat hs = h - vfloat_of(h0), ds = d - vfloat_of(d0), ts = wrapped - vfloat_of(t0);
    vec3 sum = vec3_all(0.0f);
    for (uint corner = 0; corner < 8; ++corner) {
        const int by_half = corner & 1, by_difference = (corner >> 1) & 1, by_turn = corner >> 2;
        const vfloat share = (by_half ? hs : splat(1.0f) - hs) * (by_difference ? ds : splat(1.0f) - ds) * (by_turn ? ts : splat(1.0f) - ts);
        const vint step = ((h0 + by_half) * MERL_DIFFERENCES + (d0 + by_difference)) * MERL_TURNS + (by_turn ? t1 : t0);
        const vuint at = m->values + vuint_from_int(step) * 3u;
        sum = along(sum, vec3_of(lane_gather(m->words, at), lane_gather(m->words, at + 1u), lane_gather(m->words, at + 2u)), share);
    }
    return sum;
}

// f cosθi of the RGL database at the half vector (x, y), to which the map takes the point (u, v).
static vec3 measured_rgl(const Measured* m, vfloat x, vfloat y, vfloat u, vfloat v) {
    vfloat s, t;
    const vuint column = measured_cell(u, m->side, &s), row = measured_cell(v, m->side, &t), stride = m->side * m->side * 3u;
    vec3 sum = vec3_all(0.0f);
    for (uint corner = 0; corner < 4; ++corner) {
        const vfloat share = (corner & 1 ? s : splat(1.0f) - s) * (corner & 2 ? t : splat(1.0f) - t);
        const vuint at = m->values + ((row + (corner >> 1)) * m->side + column + (corner & 1)) * 3u;
        const vec3 color = vec3_of(measured_number(m, at, stride), measured_number(m, at + 1u, stride), measured_number(m, at + 2u, stride));
        sum = along(sum, color, share);
    }
    const vfloat facets = measured_bilinear(m, m->facets, m->facets_width, m->facets_height, x, y) * m->area;
    return scale(sum, (m->flags & MEASURED_JACOBIAN) != 0u ? facets : splat(1.0f));
}

// Turns round, 0 to 1.
static vfloat measured_positive(vfloat turn) { return bounded(turn - vfloat_of(vint_of(turn + 2.0f) - 2), 0.0f, 1.0f); }

// f without the cosine, and the density. `cosine`: that of `wi`, above 0.
static vec3 measured_eval(const Measured* m, vec3 wi, vfloat cosine, vfloat* pdf) {
    const vec3 in = measured_flipped(m, wi), sum = add(m->wo, in), wm = unit(sum);
    const vfloat level = root(fma(wm.x, wm.x, wm.y * wm.y)), toward = inner(m->wo, wm);
    const vfloat x = root(measured_polar(wm) * 4.0f);
    const vfloat y = measured_positive((level > 0.0f ? turn_of(wm.x, wm.y) : splat(0.0f)) - m->azimuth + 0.5f);
    vfloat u = x, v = y;
    const vfloat seen = measured_density(m, &m->normals, &u, &v, 1);
    vfloat unused_u = u, unused_v = v;
    const vfloat lit = measured_density(m, &m->luminance, &unused_u, &unused_v, 0);
    // dω of the light over dx dy: 4 (ωo·m) of that of m, which is 2π² x sinθ
    *pdf = seen * lit * inverse_or_one(greater(x * level, splat(1.0e-20f)) * (8.0f * PI * PI) * greater(toward, splat(1.0e-7f)));
    const vmask merl = (m->flags & MEASURED_MERL) != 0u;
    vec3 f = vec3_all(0.0f);
    if (lane_any(m->present & !merl)) f = scale(measured_rgl(m, x, y, u, v), quotient(splat(1.0f), cosine));
    if (lane_any(m->present & merl)) f = choose(merl, measured_merl(m, wm, in), f);
    return f;
}

// A direction; zero where it would lie below the surface.
static vec3 measured_sample(const Measured* m, vfloat u, vfloat v) {
    measured_sample_density(m, &m->luminance, &u, &v);
    measured_sample_density(m, &m->normals, &u, &v);
    vfloat sine, cosine, c, s;
    cos_sin_turn(u * u * 0.25f, &cosine, &sine);
    cos_sin_turn(measured_positive(v - 0.5f + m->azimuth), &c, &s);
    const vec3 wm = vec3_of(sine * c, sine * s, cosine);
    const vfloat toward = inner(m->wo, wm);
    const vec3 wi = measured_flipped(m, sub(scale(wm, toward * 2.0f), m->wo));
    return choose((toward > 0.0f) & (wi.z > 0.0f), wi, vec3_all(0.0f));
}

#endif
