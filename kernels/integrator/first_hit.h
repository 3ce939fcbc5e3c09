// What is seen first, as layers beside an image: its colour, light, normal, place, distance, texture coordinates and primitive. Each sample is the image's own,
// through the same point of the film and of the lens, so that the layers lie on the image exactly; one number or vector a launch. All samples
// count alike, also where a pixel filter is negative: a mean of distances or of reflectances is then one, too. What is let through to behind the scene
// counts as radiance does, so that an image over another one is what it would be before it.
//
// The albedo is that of the first surface that is neither mirror nor glass, on the way that the image's path takes, as Open Image
// Denoise advises (documentation of version 2, "Albedos"); all else is of the first surface of any kind. What is rough scatters too widely
// to be looked through: its albedo is the share of light that it reflects and passes, of all its lobes.
#ifndef INTEGRATOR_FIRST_HIT_H
#define INTEGRATOR_FIRST_HIT_H

#include "camera/towards.h"
#include "geometry/find.h"
#include "geometry/surface.h"
#include "integrator/path_state.h"
#include "light/light.h"
#include "material/bsdf.h"
#include "material/interior.h"
#include "medium/walk.h"
#include "texture/mapping.h"

// So many mirrors and glass walls are looked through: between two mirrors there is no end.
#define FIRST_HIT_FOLLOWED 16u

// Where the point lies in the texture coordinates of its shape, whether or not anything uses them.
static Attributes first_hit_attributes(const Scene* scene, __global const float* coordinates, const Surface* s, vmask found) {
    vfloat row[16];
    const Placed placed = placed_at(scene, found ? s->primitive : splat_uint(0u), surface_time(s));
    lane_rows(scene->primitive_rows, placed.row, row);
    Attributes a = mapping_attributes_of(coordinates, placed.row, found);
    vmask round = found & (placed.row >= scene->settings->triangle_count);
    placed_geometry(&placed, round, row);
#ifdef CURVES
    round = round & !s->curve;
#endif
    placed_axes(&placed, round, a.row);
    const vec3 corner = vec3_row(row, PRIMITIVE_ROW_A);
    a.ab = sub(vec3_row(row, PRIMITIVE_ROW_B), corner), a.ac = sub(vec3_row(row, PRIMITIVE_ROW_C), corner);
    surface_weights(s, row, &a.weight_b, &a.weight_c);
#ifdef CURVES
    a.ab = choose(s->curve, s->tangent, a.ab), a.ac = choose(s->curve, outer(s->normal, s->tangent), a.ac);
    a.weight_b = s->curve ? s->along : a.weight_b, a.weight_c = s->curve ? splat(0.5f) : a.weight_c;
#endif
    if (!lane_any(round)) return a;
    const vec3 from_center = sub(s->point, vec3_row(row, PRIMITIVE_ROW_CENTER)), normal = vec3_row(row, PRIMITIVE_ROW_NORMAL);
    a.disk = round & ((normal.x != 0.0f) | (normal.y != 0.0f) | (normal.z != 0.0f));
    a.sphere = round & !a.disk;
    a.radius = row[PRIMITIVE_ROW_RADIUS];
    a.out = choose(a.disk, scale(from_center, inverse_or_one(a.radius)), unit(from_center));
    return a;
}

// The direction in which the first texture coordinate grows, at right angles to `normal`; zero where there are no coordinates.
static vec3 first_hit_tangent(const Attributes* a, vec3 normal, vmask found) {
    vec3 along_u, along_v;
    mapping_tangents(a, splat_uint(0u), &along_u, &along_v);
    const vec3 ahead = scale(along_u, inverse_scale(along_u));       // so that no square is too large or too small
    const vec3 level = sub(ahead, scale(normal, inner(ahead, normal)));
    const vmask sound = found & (inner(level, level) > 1.0e-12f);
    return choose(sound, unit(choose(sound, level, vec3_all(1.0f))), vec3_all(0.0f));
}

// Where the camera rests: a point, and a direction, of its rays' time.
static vec3 first_hit_resting(const Scene* scene, const Surface* surface, vec3 v, int is_point) {
#ifdef MOTION
    const Camera camera = *scene->camera;
    if (shutter_camera_moves(&camera)) {
        MotionMap map;
        shutter_camera_map(scene, &camera, surface_time(surface), &map);
        return is_point ? shutter_point_back(&camera, &map, v) : shutter_direction_back(&map, v);
    }
#endif
    return v;
}

// Where the point of a surface is when the shutter closes.
static vec3 first_hit_later(const Scene* scene, const Surface* surface, vmask found) {
#if defined(MOTION) && defined(INSTANCES)
    const vuint primitive = found ? surface->primitive : splat_uint(0u);
    const Placed here = placed_at(scene, primitive, surface_time(surface)), there = placed_at(scene, primitive, splat(1.0f));
#ifdef DEFORMATION
    if (lane_any(here.deforms)) {
        // The same point of the triangle
        vfloat row[16], b, c;
        for (int k = 0; k < 16; ++k) row[k] = splat(0.0f);
        placed_geometry(&here, mask_none(), row);
        surface_weights(surface, row, &b, &c);
        for (int k = 0; k < 16; ++k) row[k] = splat(0.0f);
        placed_geometry(&there, mask_none(), row);
        const vec3 later = surface_blend(row, splat(1.0f) - b - c, b, c);
        if (!lane_any(here.moves & !here.deforms)) return choose(here.deforms, later, surface->point);
        const vec3 within = placed_point(here.instance + INSTANCE_ROW_TO_OBJECT, surface->point);
        const vec3 carried = placed_point(there.placement + PLACEMENT_ROW_TO_WORLD, within);
        return choose(here.deforms, later, choose(here.moves, carried, surface->point));
    }
#endif
    if (!lane_any(here.moves)) return surface->point;
    const vec3 inside = placed_point(here.instance + INSTANCE_ROW_TO_OBJECT, surface->point);
    return choose(here.moves, placed_point(there.placement + PLACEMENT_ROW_TO_WORLD, inside), surface->point);
#else
    return surface->point;
#endif
}

// How many pixels right and down it goes there on the film; `seen` where the camera sees it at both ends.
static vec3 first_hit_flow(const Scene* scene, const Surface* surface, vmask found, vmask* seen) {
    const vfloat half_ = splat(0.5f);
    const CameraView here = camera_towards(scene, surface->point, half_, half_, surface_time(surface));
    const CameraView there = camera_towards(scene, first_hit_later(scene, surface, found), half_, half_, splat(1.0f));
    vfloat across = there.film_x - here.film_x;
    if (scene->camera->kind == CAMERA_PANORAMIC) {       // the shorter way round
        across = across > 0.5f ? across - 1.0f : across;
        across = across < -0.5f ? across + 1.0f : across;
    }
    *seen = found & (here.density > 0.0f) & (there.density > 0.0f);
    return vec3_of(across * (float)scene->settings->width, (there.film_y - here.film_y) * (float)scene->settings->height, splat(0.0f));
}

// What the sample gives where its ray ended. A sample that met nothing has no place: FAR is more than the film takes, so that it is
// left out of the mean; its normal is zero.
static vec3 first_hit_value(const Scene* scene, uint wanted, __global const float* coordinates, const Surface* surface, const Bsdf* bsdf,
                            vec3 albedo, vmask found) {
    const vec3 nowhere = vec3_all(FAR);
    if (wanted == FIRST_HIT_ALBEDO)
        return vec3_of(lesser(albedo.x, splat(1.0f)), lesser(albedo.y, splat(1.0f)), lesser(albedo.z, splat(1.0f)));
    if (wanted == FIRST_HIT_NORMAL) return choose(found, bsdf->frame.normal, vec3_all(0.0f));
    if (wanted == FIRST_HIT_NORMAL_CAMERA) return choose(found, first_hit_resting(scene, surface, bsdf->frame.normal, 0), vec3_all(0.0f));
    if (wanted == FIRST_HIT_POSITION) return choose(found, add(surface->point, vec3_from(scene->camera->world)), nowhere);
    if (wanted == FIRST_HIT_Z_DEPTH) {
        const vfloat ahead = inner(sub(first_hit_resting(scene, surface, surface->point, 1), vec3_from(scene->camera->origin)), unit(vec3_from(scene->camera->axis)));
        return choose(found, vec3_of(ahead, ahead, ahead), nowhere);
    }
    if (wanted == FIRST_HIT_DEPTH) {
        const vfloat depth = magnitude(sub(first_hit_resting(scene, surface, surface->point, 1), vec3_from(scene->camera->origin)));
        return choose(found, vec3_of(depth, depth, depth), nowhere);
    }
    if (wanted == FIRST_HIT_SCENE_FLOW) return choose(found, sub(first_hit_later(scene, surface, found), surface->point), nowhere);
    if (wanted == FIRST_HIT_FLOW) {
        vmask seen;
        const vec3 flow = first_hit_flow(scene, surface, found, &seen);
        return choose(seen, flow, nowhere);
    }
    if (wanted == FIRST_HIT_EMISSION) return light_emitted(scene, surface, found);
    if (wanted == FIRST_HIT_UV || wanted == FIRST_HIT_TANGENT) {
        const Attributes attributes = first_hit_attributes(scene, coordinates, surface, found);
        if (wanted == FIRST_HIT_TANGENT) return first_hit_tangent(&attributes, bsdf->frame.normal, found);
        vfloat u, v;
        mapping_uv(&attributes, splat_uint(0u), &u, &v);
        return choose(found, vec3_of(u, v, splat(0.0f)), nowhere);
    }
    // Which primitive, in two numbers that are exact as floats
    const vuint low = surface->primitive & 0xffffu, high = surface->primitive >> 16;
    return choose(found, vec3_of(vfloat_of(vint_from_uint(low)), vfloat_of(vint_from_uint(high)), splat(0.0f)), nowhere);
}

// Where a surface shows an image of what is before or behind it: deltas, and metal and glass of the least roughness that lobes have.
static vmask first_hit_clear(const Bsdf* b) {
#ifdef MATERIALS
    const Closure* c = &b->closure;
    const vmask smooth = (c->facets.mean <= LAYERING_SMOOTH) & (!c->coat.present | (c->coat.alpha <= LAYERING_SMOOTH));
    return b->specular | (c->present & smooth & !c->diffuse.present & !c->sheen.present);
#else
    return b->specular;
#endif
}

// The colour of that image: what becomes of flux, for that radiance changes with the index says nothing about colour.
static vec3 first_hit_tint(const Bsdf* b, const BsdfSample* next) {
#ifdef MATERIALS
    const vec3 w = scale(next->weight, bsdf_index_squared(b, next->direction));
    const vec3 most = vec3_of(lesser(w.x, splat(1.0f)), lesser(w.y, splat(1.0f)), lesser(w.z, splat(1.0f)));
    return choose(b->closure.present | (b->kind == MATERIAL_CONDUCTOR) | b->thin, most, b->color);
#else
    return b->color;
#endif
}

static void first_hit_trace(const Scene* scene, Pool* pool, PoolStats* stats, uint wanted,
                            __global const float* coordinates) {
    __global const Settings* settings = scene->settings;
    const uint followed = wanted == FIRST_HIT_ALBEDO ? FIRST_HIT_FOLLOWED : 0u;
    CameraRays waiting = camera_rays_none();
    Path path = path_none();             // its radiance is the albedo

    while (path_next(scene, pool, &waiting, &path)) {
        // Find the nearest surface; what shines counts as if its light were its colour
        const Hit hit = find_nearest(scene, &path.ray, path.sample.sampler, path.depth, path.depth == 0u, path.alive);
        stats->rays += lane_count(path.alive);
        stats->deepest = pool_deepest(stats->deepest, path.depth, path.alive);
        const vmask found = path.alive & (hit.primitive != NONE);
        Surface surface = surface_at(scene, &path.ray, hit, found);
        const Crossing crossing = interior_meet(scene, &path.interior, &surface, found);
        if (wanted == FIRST_HIT_ALPHA) {
            // What is scattered away, too, is not what lies behind
            const vec3 passed = interior_transmittance(scene, &path.interior, path.ray.origin, path.ray.direction, hit.distance, !found, path.alive);
            path.throughput = choose(path.alive, mul(path.throughput, passed), path.throughput);
        } else {
            path.throughput = choose(found, interior_absorb(scene, &path.interior, &path.ray, hit, found, path.throughput), path.throughput);
        }
        const vmask straight = interior_straight(&crossing);
        const vec3 through = path.throughput;
        vec3 outside = vec3_all(0.0f);
        const vmask escapes = path.alive & !found & !environment_hidden(scene, path.depth);
        if (lane_any(escapes)) {
            const vec3 emitted = mul(environment_emitted(scene, path.ray.direction, escapes), interior_through_fog(scene));
            outside = choose(escapes, emitted, outside);
        }
        const vec3 seen = mul(path.throughput, choose(found, light_emitted(scene, &surface, found), outside));
        path.radiance = choose(path.alive, add(path.radiance, seen), path.radiance);

        // Look through mirrors and glass, in the direction that the image's path takes there; their colour counts
        Bsdf bsdf;
        bsdf_at(scene, &surface, path.ray.direction, &bsdf);
        vuint bits_u, bits_v;
        sampler_bits(path.sample.sampler, sampler_set(path.depth, SET_BSDF), &bits_u, &bits_v);
        BsdfSample next = bsdf_sample(&bsdf, bits_u, bits_v);
        interior_straighten(&crossing, path.ray.direction, &next.direction, &next.weight);
        vec3 albedo = bsdf_albedo(&bsdf);
        const vmask below = walk_begins(scene, &surface, found, &albedo);
        const vmask looks_on = first_hit_clear(&bsdf) & !below & (path.depth < followed);
        vmask goes_on = found & (looks_on | straight) & (largest(next.weight) > 0.0f);
        interior_cross(&path.interior, &crossing, next.direction, bsdf.side);
        goes_on = goes_on & interior_goes_on(&path.interior, &crossing, path.sample.sampler, &path.throughput);
        const vmask ended = path.alive & !goes_on;
        const vec3 color = choose(looks_on, first_hit_tint(&bsdf, &next), albedo);
        path.throughput = choose(found, mul(path.throughput, color), path.throughput);
        path.radiance = choose(ended & found, add(path.radiance, path.throughput), path.radiance);
        if (wanted == FIRST_HIT_ALPHA) {
            // The share that passes, and the weight of the sample
            const vfloat share = found ? splat(0.0f) : (through.x + through.y + through.z) * (1.0f / 3.0f);
            if (lane_any(ended)) pool_deliver(pool, &path.sample, vec3_of(share, splat(1.0f), splat(0.0f)), ended);
        } else if (lane_any(ended)) {
            const vec3 value = first_hit_value(scene, wanted, coordinates, &surface, &bsdf, path.radiance, found);
            pool_put(pool, &path.sample, value, ended);
        }
        path.depth = straight ? path.depth : path.depth + 1u;
        path.ray = surface_leave(&surface, next.direction);
        path.alive = path.alive & !ended;
    }
}

#endif
