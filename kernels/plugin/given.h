// The plugins of a scene. In the place of this file, which is for scenes without, the host gives the programs of scenes with plugins
// their text, with the functions below (clrender/plugins/program.py). PLUGIN_BSDFS, PLUGIN_TEXTURES and PLUGIN_LIGHTS are defined there if any
// is of that kind.
//
// A plugin has a number, from 1 on, and its parameters are up to PLUGIN_NUMBERS numbers. Directions are local unit vectors away from the
// surface, z = shading normal on the side of `wo`. A plugin says nothing below the surface, but where it transmits.
//
//     vmask plugin_transmits(vuint plugin)      light goes to the other side, or comes from there
//     vec3 plugin_eval(vuint plugin, const vfloat* numbers, vec3 wo, vec3 wi, vfloat* pdf)
//                                               f in 1/sr, without the cosine, and the density per steradian
//     vec3 plugin_sample(vuint plugin, const vfloat* numbers, vec3 wo, vfloat u, vfloat v, vfloat w)
//                                               a direction; zero: none
//     vec3 plugin_albedo(vuint plugin, const vfloat* numbers, vec3 wo)
//                                               about the share of light along `wo` that is scattered
//     vec3 plugin_value(vuint plugin, const vfloat* numbers, vfloat u, vfloat v, vec3 position)
//                                               of a texture, at these coordinates and this point of the world, metres
//     vec3 plugin_intensity(vuint plugin, const vfloat* numbers, vec3 direction)
//                                               of a light, W/sr, away from it in its own frame; never negative, nor not a number
//     vec3 plugin_said(vuint plugin, const vfloat* numbers, vec3 direction)
//                                               the same, whatever it is
//     vec3 plugin_emit(vuint plugin, const vfloat* numbers, vfloat spread, vfloat u, vfloat v)
//                                               a direction for what starts at the light; `spread`: 1 - cosine of half its cone
//     vfloat plugin_emit_pdf(vuint plugin, const vfloat* numbers, vfloat spread, vec3 direction)
//                                               its density per steradian
#ifndef PLUGIN_GIVEN_H
#define PLUGIN_GIVEN_H

#endif
