"""The kernel files of plugins: their text, and the functions by which the kernels call whichever a lane needs."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Final

from clrender.layout import TEXTURE_SLOTS
from clrender.plugins.header import Parameter
from clrender.plugins.kernel_rules import COMMENT
from clrender.plugins.plugin import Plugin

__all__ = ["GIVEN", "SLOTS", "TEXTURED_FILE", "kernel_files", "samples_directions"]

GIVEN: Final = "plugin/given.h"
TEXTURED_FILE: Final = "plugin/textured.h"
SLOTS: Final = tuple(
    TEXTURE_SLOTS[name]
    for name in (
        *("BASE_COLOR", "METALLIC", "SPECULAR", "SPECULAR_COLOR", "TRANSMISSION", "COAT", "COAT_ROUGHNESS"),
        *("SHEEN_COLOR", "SHEEN_ROUGHNESS", "DIFFUSE_ROUGHNESS"),
    )
)
"""Columns of a material's texture slots for those parameters of a plugin that may be textures, in their order.

The others decide something for materials of all kinds: roughness and anisotropy, opacity, weight, normals.
"""
_INCLUDE: Final = re.compile(r'^[ \t]*#include +"([^"]*)"', re.MULTILINE)
_HEADERS: Final = ("core/exact.h", "core/power.h", "core/warp.h")


def kernel_files(plugins: Sequence[Plugin]) -> dict[str, str]:
    """Kernel files that take the place of those in ``kernels/plugin``.

    Parameters
    ----------
    plugins : sequence of Plugin
        The first has the number 1.

    Returns
    -------
    dict of str to str
        Text by name.
    """
    return {GIVEN: _given(plugins), TEXTURED_FILE: _textured(plugins)}


def _given(plugins: Sequence[Plugin]) -> str:
    included = (name for each in plugins for name in _INCLUDE.findall(COMMENT.sub("", each.text)))
    headers = dict.fromkeys([*_HEADERS, *sorted(included)])
    lines = ["// The plugins of a scene.", "#ifndef PLUGIN_GIVEN_H", "#define PLUGIN_GIVEN_H", ""]
    lines += [f'#include "{name}"' for name in headers]
    kinds = {each.kind for each in plugins}
    lines += ["", *(f"#define PLUGIN_{kind.upper()}S 1" for kind in sorted(kinds))]
    for each in plugins:
        members = [f"    {_TYPE[one.type]} {one.name};" for one in each.parameters] or ["    vfloat unused;"]
        lines += ["", "typedef struct {", *members, f"}} {each.header.struct};"]
        lines += [f"// plugin {each.name}"]  # marks what follows as no file of the kernels' own
        lines += [f'#line 1 "{shown_file(each.source)}"', *_INCLUDE.sub("", each.text).rstrip("\n").split("\n")]
        lines.append(f'#line {len(lines) + 2} "{GIVEN}"')
    for number, each in enumerate(plugins, 1):
        lines += ["", *_read(number, each)]
    if "bsdf" in kinds:
        lines += ["", *_bsdfs([(i, each) for i, each in enumerate(plugins, 1) if each.kind == "bsdf"])]
    if "light" in kinds:
        lines += ["", *_lights([(i, each) for i, each in enumerate(plugins, 1) if each.kind == "light"])]
    if "texture" in kinds:
        lines += ["", *_textures([(i, each) for i, each in enumerate(plugins, 1) if each.kind == "texture"])]
    return "\n".join([*lines, "", "#endif", ""])


_TYPE: Final = {"number": "vfloat", "color": "vec3"}


def shown_file(source: str) -> str:
    """Name of a plugin's file as a ``#line`` directive can say it."""
    return re.sub(r"[^\w. /-]|/(?=/)", "_", source, flags=re.ASCII)


def _read(number: int, plugin: Plugin) -> Iterable[str]:
    yield f"static void plugin_read_{number}(const vfloat* numbers, {plugin.header.struct}* p) {{"
    at = 0
    for each in plugin.parameters:
        one = f"numbers[{at}]" if each.count == 1 else f"vec3_of(numbers[{at}], numbers[{at + 1}], numbers[{at + 2}])"
        yield f"    p->{each.name} = {one};"
        at += each.count
    if not plugin.parameters:
        yield "    p->unused = splat(0.0f);"
    yield "}"


def _each(plugins: Sequence[tuple[int, Plugin]], statement: str) -> Iterable[str]:
    """A statement for the lanes of each plugin."""
    for number, each in plugins:
        yield f"    const vmask of_{number} = plugin == {number}u;"
        yield f"    if (lane_any(of_{number})) {{"
        yield f"        {each.header.struct} p;"
        yield f"        plugin_read_{number}(numbers, &p);"
        for line in statement.split("\n"):
            yield "        " + line.replace("OF", f"of_{number}").replace("NAME", each.name)
        yield "    }"


def _bsdfs(plugins: Sequence[tuple[int, Plugin]]) -> Iterable[str]:
    passing = [f"(plugin == {number}u)" for number, each in plugins if each.header.transmits]
    yield f"static vmask plugin_transmits(vuint plugin) {{ return {' | '.join(passing) or 'mask_none()'}; }}"
    yield "static vec3 plugin_eval(vuint plugin, const vfloat* numbers, vec3 wo, vec3 wi, vfloat* pdf) {"
    yield "    vec3 f = vec3_all(0.0f);"
    yield "    vfloat density = splat(0.0f);"
    statement = "f = choose(OF, NAME_eval(&p, wo, wi), f);\ndensity = OF ? NAME_pdf(&p, wo, wi) : density;"
    yield from _each(plugins, statement)
    yield "    const vmask reached = (wi.z > 0.0f) | plugin_transmits(plugin);"
    yield "    *pdf = reached ? density : splat(0.0f);"
    yield "    return choose(reached, f, vec3_all(0.0f));"
    yield "}"
    yield ("static vec3 plugin_sample(vuint plugin, const vfloat* numbers, vec3 wo, vfloat u, vfloat v, vfloat w) {")
    yield "    vec3 wi = vec3_all(0.0f);"
    yield from _each(plugins, "wi = choose(OF, NAME_sample(&p, wo, u, v, w), wi);")
    yield "    const vec3 direction = unit(wi);"
    yield "    const vmask reached = (direction.z > 0.0f) | ((direction.z < 0.0f) & plugin_transmits(plugin));"
    yield "    return choose(reached, direction, vec3_all(0.0f));"
    yield "}"
    yield "static vec3 plugin_albedo(vuint plugin, const vfloat* numbers, vec3 wo) {"
    yield "    vec3 a = vec3_all(0.5f);"
    for number, each in plugins:
        yield from _each([(number, each)], f"a = choose(OF, {_albedo(each)}, a);")
    yield "    return vec3_of(bounded(a.x, 0.0f, 1.0f), bounded(a.y, 0.0f, 1.0f), bounded(a.z, 0.0f, 1.0f));"
    yield "}"


def _albedo(plugin: Plugin) -> str:
    """The plugin's own albedo, or its first colour, or grey."""
    if re.search(rf"\b{plugin.name}_albedo\s*\(", plugin.text):
        return f"{plugin.name}_albedo(&p, wo)"
    color = next((each.name for each in plugin.parameters if each.type == "color"), None)
    return "vec3_all(0.5f)" if color is None else f"p.{color}"


def _lights(plugins: Sequence[tuple[int, Plugin]]) -> Iterable[str]:
    sampled = [(number, each) for number, each in plugins if samples_directions(each)]
    yield "static vec3 plugin_said(vuint plugin, const vfloat* numbers, vec3 direction) {"
    yield "    vec3 said = vec3_all(0.0f);"
    yield from _each(plugins, "said = choose(OF, NAME_intensity(&p, direction), said);")
    yield "    return said;"
    yield "}"
    yield "static vfloat plugin_sound(vfloat x) { return x > 0.0f ? lesser(x, splat(1.0e12f)) : splat(0.0f); }"
    yield "static vec3 plugin_intensity(vuint plugin, const vfloat* numbers, vec3 direction) {"
    yield "    const vec3 said = plugin_said(plugin, numbers, direction);"
    yield "    return vec3_of(plugin_sound(said.x), plugin_sound(said.y), plugin_sound(said.z));"
    yield "}"
    yield "static vec3 plugin_emit(vuint plugin, const vfloat* numbers, vfloat spread, vfloat u, vfloat v) {"
    yield "    vec3 direction = warp_cone(u, v, spread);"
    yield from _each(sampled, "direction = choose(OF, NAME_sample(&p, u, v), direction);")
    if sampled:  # no ray may have a direction that is none
        yield "    direction = unit(direction);"
        yield "    const vec3 axis = vec3_of(splat(0.0f), splat(0.0f), splat(1.0f));"
        yield "    direction = choose(inner(direction, direction) > 0.5f, direction, axis);"
    yield "    return direction;"
    yield "}"
    yield "static vfloat plugin_emit_pdf(vuint plugin, const vfloat* numbers, vfloat spread, vec3 direction) {"
    yield "    vfloat pdf = warp_cone_pdf(spread);"
    yield from _each(sampled, "pdf = OF ? NAME_pdf(&p, direction) : pdf;")
    yield "    return plugin_sound(pdf);"
    yield "}"


def samples_directions(plugin: Plugin) -> bool:
    """Whether a light says how directions are sampled; else they are uniform in its cone."""
    return bool(re.search(rf"\b{plugin.name}_sample\s*\(", COMMENT.sub("", plugin.text)))


def _textures(plugins: Sequence[tuple[int, Plugin]]) -> Iterable[str]:
    yield "static vec3 plugin_value(vuint plugin, const vfloat* numbers, vfloat u, vfloat v, vec3 position) {"
    yield "    vec3 value = vec3_all(0.0f);"
    yield from _each(plugins, "value = choose(OF, NAME_value(&p, u, v, position), value);")
    yield "    return value;"
    yield "}"


def _textured(plugins: Sequence[Plugin]) -> str:
    lines = [
        "// Textures in the place of plugins' parameters.",
        "#ifndef PLUGIN_TEXTURED_H",
        "#define PLUGIN_TEXTURED_H",
        "",
        '#include "texture/parameter.h"',
        "",
    ]
    lines += [
        "static void plugin_textured(const Scene* scene, const Attributes* a, const TextureSlots* slots, vuint plugin,"
    ]
    lines += ["                            vfloat* numbers) {"]
    for number, each in enumerate(plugins, 1):
        if each.kind == "bsdf" and any(one.textured for one in each.parameters):
            lines += [f"    const vmask of_{number} = plugin == {number}u;", f"    if (lane_any(of_{number})) {{"]
            lines += [f"        {line}" for line in _replaced(f"of_{number}", each.parameters)]
            lines += ["    }"]
    return "\n".join([*lines, "}", "", "#endif", ""])


def _replaced(mask: str, parameters: Sequence[Parameter]) -> Iterable[str]:
    at = slot = 0
    for each in parameters:
        if each.textured and each.count == 1:
            value = f"parameter_number(scene, a, slots, {SLOTS[slot]}u, numbers[{at}])"
            yield f"numbers[{at}] = {mask} ? {value} : numbers[{at}];"
        elif each.textured:
            old = f"vec3_of(numbers[{at}], numbers[{at + 1}], numbers[{at + 2}])"
            yield f"const vec3 c{at} = parameter_color(scene, a, slots, {SLOTS[slot]}u, {old});"
            for i, axis in enumerate("xyz"):
                yield f"numbers[{at + i}] = {mask} ? c{at}.{axis} : numbers[{at + i}];"
        at += each.count
        slot += each.textured
