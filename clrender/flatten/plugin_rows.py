"""The plugins that a scene uses, and the numbers of their parameters as the kernels read them."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, TypeAlias

from clrender.errors import SceneError
from clrender.plugins import Plugin
from clrender.plugins.header import Parameter
from clrender.plugins.program import SLOTS
from clrender.scene.description import PluginLight, Scene
from clrender.scene.materials import PluginMaterial
from clrender.scene.shapes import Mesh
from clrender.scene.textures import MaterialTexture, PluginTexture, textures_of
from clrender.scene.values import Part
from clrender.wording import place, printable, quoted, suggestion

__all__ = [
    "needs_uvs",
    "parameter_numbers",
    "parameter_slots",
    "plugin_hashes",
    "plugin_number",
    "plugin_of",
    "used_plugins",
]

_UNKNOWN: Final = 0.5
"""Placeholder for a value that a texture gives."""
_Made: TypeAlias = PluginMaterial | PluginTexture | PluginLight
_KINDS: Final[Mapping[type[_Made], str]] = {PluginMaterial: "bsdf", PluginTexture: "texture", PluginLight: "light"}
_TITLES: Final = {"bsdf": "BSDF", "texture": "texture", "light": "light"}
_Place: TypeAlias = tuple[str | int, ...]


def used_plugins(scene: Scene) -> tuple[Plugin, ...]:
    """The plugins that a scene's materials and lights use, sorted by name, after checking all parameters.

    Parameters
    ----------
    scene : Scene

    Raises
    ------
    SceneError
        A plugin is not given, or a parameter is none of its parameters or outside of their bounds.
    """
    return scene.of_contents("plugins", lambda: _used(scene))


def plugin_number(scene: Scene, name: str) -> int:
    """Number of a plugin among those of a scene, from 1 on; of a name that is used."""
    return next(number for number, each in enumerate(used_plugins(scene), 1) if each.name == name)


def parameter_numbers(scene: Scene, part: PluginMaterial | PluginTexture | PluginLight) -> list[float]:
    """Numbers of all parameters of a plugin, in its own order; those that are not given have its defaults.

    Parameters
    ----------
    scene : Scene
    part : PluginMaterial, PluginTexture or PluginLight
        After `used_plugins` has checked it.
    """
    numbers: list[float] = []
    for each in plugin_of(scene, part).parameters:
        value = part.parameters.get(each.name, each.default)
        if isinstance(value, Part):
            value = (_UNKNOWN,) * each.count
        numbers += [value] if isinstance(value, float | int) else value
    return numbers


def parameter_slots(scene: Scene, material: PluginMaterial) -> dict[str, tuple[int, bool]]:
    """Column of the texture slots of each parameter that may be a texture, and whether it is a colour; by its name."""
    textured = (each for each in plugin_of(scene, material).parameters if each.textured)
    return {each.name: (slot, each.type == "color") for each, slot in zip(textured, SLOTS, strict=False)}


def needs_uvs(scene: Scene, texture: MaterialTexture) -> bool:
    """Whether a texture depends on texture coordinates."""
    return not isinstance(texture, PluginTexture) or "uv" in plugin_of(scene, texture).header.needs


def plugin_of(scene: Scene, part: PluginMaterial | PluginTexture | PluginLight) -> Plugin:
    """The plugin of a material, texture or light, which `used_plugins` has found."""
    return next(each for each in scene.plugins if each.name == part.plugin)


def _parts(scene: Scene) -> Iterator[tuple[_Place, _Made]]:
    for name, material in scene.materials.items():
        if isinstance(material, PluginMaterial):
            yield ("materials", name), material
        for key, texture in textures_of(material):
            if isinstance(texture, PluginTexture):
                yield ("materials", name, *key.split(".", 1)), texture
    yield from ((("lights", index), each) for index, each in enumerate(scene.lights) if isinstance(each, PluginLight))


def _used(scene: Scene) -> tuple[Plugin, ...]:
    given = {each.name: each for each in scene.plugins}
    used: set[str] = set()
    for at, part in _parts(scene):
        where = f"{scene.source}: {place((*at, 'plugin'))}"
        kind = _KINDS[type(part)]
        if part.plugin not in given:
            near = suggestion(part.plugin, given) if given else ""
            cure = f"give its file with --plugin {_file_of(scene, part.plugin)} (in Python: plugins=[FILE])"
            raise SceneError(f"{where} names the plugin {quoted(part.plugin)}, which is not given; {cure}{near}")
        plugin = given[part.plugin]
        if plugin.kind != kind:
            one, other = _TITLES[kind], _TITLES[plugin.kind]
            raise SceneError(
                f"{where} is {quoted(part.plugin)}, which is the plugin of a {other}; a {one} is wanted here"
            )
        _check(scene, at, part, plugin)
        used.add(part.plugin)
    _check_terminators(scene)
    return tuple(given[name] for name in sorted(used))


def _file_of(scene: Scene, name: str) -> str:
    """The file beside the scene that is called like a plugin, as a shell takes it; ``FILE`` if there is none."""
    folders = (scene.base_folder / each for each in ("", "plugins", "scenes/plugins"))
    found = (folder / f"{name}.cl" for folder in folders) if name.isidentifier() else ()
    return next((shlex.quote(printable(str(path))) for path in found if path.is_file()), "FILE")


def _check(scene: Scene, at: _Place, part: _Made, plugin: Plugin) -> None:
    """Check the parameters that a scene gives to a plugin."""
    known = {each.name: each for each in plugin.parameters}
    for name, value in part.parameters.items():
        where = f"{scene.source}: {place((*at, 'parameters', name))}"
        if name not in known:
            raise SceneError(f"{where} is no parameter of the plugin {plugin.name}{suggestion(name, known)}")
        _check_value(where, known[name], value, plugin)
    if isinstance(part, PluginMaterial) and part.anisotropy_rotation != 0.0 and "tangents" not in plugin.header.needs:
        where = f"{scene.source}: {place((*at, 'anisotropy_rotation'))}"
        raise SceneError(f"{where} does nothing, as the plugin {plugin.name} needs no tangents; leave it out")


def _check_value(where: str, parameter: Parameter, value: Any, plugin: Plugin) -> None:
    bounds = f"from {parameter.min:g} to {parameter.max:g}"
    wanted = "a colour of three numbers" if parameter.type == "color" else "a number"
    if isinstance(value, Part):
        if not parameter.textured:
            raise SceneError(
                f"{where} is a texture, whose values are from 0 to 1, but this parameter of {plugin.name} is {bounds}; "
                f"give {wanted}"
            )
        return
    values: Sequence[float] = value if isinstance(value, tuple | list) else (value,)
    if len(values) != parameter.count:
        raise SceneError(f"{where} is {'a colour' if len(values) == 3 else 'a number'}, but must be {wanted}")
    for each in values:
        if not parameter.min <= each <= parameter.max:
            raise SceneError(f"{where} is {each:g}, but must be {bounds}")


def _check_terminators(scene: Scene) -> None:
    """Check that no sheet that transmits has its shadow terminator moved."""
    transmitting = {each.name for each in scene.plugins if each.header.transmits}
    for at, shape in scene.all_shapes():
        material = None if shape.material is None else scene.materials[shape.material]
        moved = isinstance(shape, Mesh) and shape.shadow_terminator_offset
        if moved and isinstance(material, PluginMaterial) and material.plugin in transmitting:
            text = "is given, but the shape lets light through, which begins at the triangles themselves; leave it out"
            raise SceneError(f"{scene.source}: {place((*at, 'shadow_terminator_offset'))} {text}")


def plugin_hashes(plugins: Sequence[Plugin]) -> Mapping[str, str]:
    """Hash of the text of each plugin, by its name."""
    return {each.name: each.sha256 for each in plugins}
