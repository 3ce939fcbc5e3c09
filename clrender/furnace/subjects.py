"""Which materials are measured: a type by name, a table in TOML, or all of a scene; and their white versions."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from clrender.errors import UsageError
from clrender.flatten.plugin_rows import used_plugins
from clrender.furnace.surfaces import Uv
from clrender.importers import load
from clrender.plugins import Plugin, as_plugins
from clrender.scene import builtin_names
from clrender.scene.description import MATERIAL_TYPES, Scene
from clrender.scene.materials import Hair, Measured, Mix, PluginMaterial, material_textures
from clrender.scene.textures import PluginTexture
from clrender.scene.validation_errors import scene_error
from clrender.wording import quoted, suggestion

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

__all__ = ["ROUGHNESSES", "Subject", "subjects_of", "whitened"]

ROUGHNESSES: Final = (0.0, 0.04, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
"""Roughnesses of a material that is given only by the name of its type."""
_NEEDED: Final[Mapping[str, Mapping[str, Any]]] = {
    "lambert": {"reflectance": [1.0, 1.0, 1.0]},
    "oren_nayar": {"reflectance": [1.0, 1.0, 1.0]},
    "conductor": {"metal": "Au"},
    "dielectric": {"ior": 1.5},
    "hair": {"reflectance": [1.0, 1.0, 1.0]},
    "subsurface": {"albedo": 1.0, "radius": 0.01, "ior": 1.4},
}
"""Required keys of types."""
_COLORS: Final = tuple(
    dict.fromkeys(
        name
        for kind in MATERIAL_TYPES.values()
        for name in kind.model_fields
        if name in ("reflectance", "f0") or (name.endswith("_color") and name != "attenuation_color")
    )
)
"""Keys of colours, which do not absorb if they are 1."""
_WHITE_METAL: Final = {"eta": (1e-3,) * 3, "k": (1000.0,) * 3}
"""A metal that reflects all but 4e-9 of the light."""
_PIGMENTS: Final = ("absorption_coefficient", "eumelanin", "pheomelanin")
"""Keys of what absorbs in hair."""
_NAME: Final = re.compile(r"[A-Za-z0-9_-]{1,100}\Z")


@dataclass(frozen=True)
class Subject:
    """Materials to measure.

    Attributes
    ----------
    title : str
        Source of the materials, for headings.
    scene : Scene
        The scene that contains them.
    names : tuple of str
        Names of those to measure, in the scene's order.
    swept : mapping of str to tuple of (float, str)
        For some of them: roughness values, and the name of the material with each of them.
    uvs : tuple of (float, float)
        Texture coordinates at which textured materials are measured; empty: at the furnace's default.
    """

    title: str
    scene: Scene
    names: tuple[str, ...]
    swept: Mapping[str, tuple[tuple[float, str], ...]]
    uvs: tuple[Uv, ...] = ()

    @property
    def places(self) -> tuple[tuple[str, Uv | None], ...]:
        """What is measured: each material, and if it is textured, at each of the texture coordinates."""
        return tuple((n, uv) for n in self.names for uv in (self.uvs if _is_textured(self.scene, n) else ()) or (None,))

    def claims(self, name: str) -> frozenset[str]:
        """What a material claims, of ``reciprocal`` and ``lossless``: clrender's own both, a plugin as it says."""
        return _claims(self.scene, name)

    def has_plugin(self, name: str) -> bool:
        """Whether plugins scatter light at a material, or decide with what parameters."""
        materials, material = self.scene.materials, self.scene.materials[name]
        if isinstance(material, Mix) and any(self.has_plugin(part) for part in material.materials):
            return True
        textured = any(isinstance(each, PluginTexture) for _, each in material_textures(materials, name))
        return textured or isinstance(material, PluginMaterial)

    def eta(self, name: str) -> float:
        """Index of refraction behind the front side, relative to that in front; 1 if a material has none."""
        return _relative_index(self.scene, name, set())


def subjects_of(
    text: str,
    names: Sequence[str] = (),
    allow_paths: Sequence[Path] = (),
    uvs: Sequence[Uv] = (),
    plugins: Sequence[str | Path | Plugin] = (),
) -> Subject:
    """Determine the materials that a user's text means.

    Parameters
    ----------
    text : str
        Name of a material type or a plugin, an inline table such as ``{type = "conductor", metal = "Au"}``, a scene
        file or the name of a built-in scene.
    names : sequence of str
        Restricts a scene to these materials.
    allow_paths : sequence of Path
        See `clrender.scene.load`.
    uvs : sequence of (float, float)
        See `Subject`.
    plugins : sequence of str, Path or Plugin
        Plugins that the materials may use.

    Raises
    ------
    SceneError
        If the table or the scene is invalid.
    UsageError
        If there is no such type or scene, or no such material in it, or no textured one for `uvs`.
    """
    subject = replace(_subject(text, names, allow_paths, as_plugins(plugins)), uvs=tuple(dict.fromkeys(uvs)))
    used_plugins(subject.scene)
    if uvs and not any(_is_textured(subject.scene, name) for name in subject.names):
        raise UsageError("--uv chooses a place in textures, and no material here has any; leave it out")
    return subject


def _is_textured(scene: Scene, name: str) -> bool:
    return any(material_textures(scene.materials, name))


def _subject(text: str, names: Sequence[str], allow_paths: Sequence[Path], plugins: Sequence[Plugin]) -> Subject:
    if text.lstrip().startswith("{"):
        _no_names(names, "a table")
        return _of_table(_parsed(text), text.strip(), sweep=False, plugins=plugins)
    known_plugins = {each.name: each for each in plugins}
    if text in known_plugins:
        _no_names(names, "a plugin")
        return _of_plugin(known_plugins[text], plugins)
    if text == "plugin":
        raise UsageError("a plugin is measured by its own name: give its file with --plugin FILE, and then its name")
    if text in MATERIAL_TYPES:
        _no_names(names, "a type")
        return _of_table({"type": text, **_NEEDED.get(text, {})}, text, sweep=True)
    if _NAME.match(text) and text not in builtin_names() and not Path(text).exists():
        known = [*known_plugins, *MATERIAL_TYPES, *builtin_names()]
        nearest = suggestion(text, known)
        cure = nearest if "did you mean" in nearest else f"; types: {', '.join(MATERIAL_TYPES)}"
        raise UsageError(f"there is no material type and no built-in scene {quoted(text)}{cure}")
    scene = load(text, allow_paths=allow_paths, plugins=plugins)
    for name in names:
        if name not in scene.materials:
            raise UsageError(f"{scene.source}: there is no material {quoted(name)}{suggestion(name, scene.materials)}")
    if not scene.materials:
        raise UsageError(f"{scene.source}: the scene has no materials, so there is nothing to measure")
    return Subject(scene.source, scene, tuple(n for n in scene.materials if not names or n in names), {})


def whitened(scene: Scene) -> Scene:
    """The materials without absorbing colours: any remaining loss of light has another cause."""
    return scene.with_checked(materials={name: _white(each, scene.plugins) for name, each in scene.materials.items()})


def _shown(material: Any, key: str) -> bool:
    """Whether a material has this colour; black sheen does not count."""
    color = getattr(material, key, None)
    return color is not None and (key != "sheen_color" or any(color))


def _white(material: Any, plugins: Sequence[Plugin] = ()) -> Any:
    if isinstance(material, PluginMaterial):
        plugin = next(each for each in plugins if each.name == material.plugin)
        white = {each.name: (each.max,) * 3 for each in plugin.parameters if each.type == "color" and each.textured}
        return material.changed({"parameters": {**material.parameters, **white}})
    fields = type(material).model_fields
    changes: dict[str, Any] = {key: (1.0, 1.0, 1.0) for key in _COLORS if _shown(material, key)}
    if {"metal", "eta", "k"} <= set(fields) and "f0" not in changes:
        changes |= {"metal": None, **_WHITE_METAL}
    if isinstance(material, Hair):
        changes = {"reflectance": (1.0, 1.0, 1.0), **dict.fromkeys(_PIGMENTS)}
    return material.changed(changes)


def _parsed(text: str) -> Any:
    try:
        parsed = tomllib.loads(f"material = {text}\n")
        if len(parsed) > 1:
            raise ValueError("more than one table")
        return parsed["material"]
    except (tomllib.TOMLDecodeError, RecursionError, ValueError) as error:
        problem = re.sub(r" \(at .*\)$", "", ascii(str(error))[1:-1])[:100]
        raise UsageError(
            f"{quoted(text)} is no inline table of TOML ({problem}); write "
            '\'{type = "conductor", metal = "Au", roughness = 0.3}\''
        ) from None


def _of_plugin(plugin: Plugin, plugins: Sequence[Plugin]) -> Subject:
    """A plugin with its defaults, and where it is a BSDF, with the bounds of each of its numbers.

    A texture is measured as the colour of a Lambertian surface.
    """
    if plugin.kind == "light":
        raise UsageError(
            f"{plugin.name} is a light, which is no material; `clrender.furnace.measure_light` measures it"
        )
    table: dict[str, Any] = {"type": "plugin", "plugin": plugin.name}
    if plugin.kind == "texture":
        table = {"type": "lambert", "reflectance": {"plugin": plugin.name}}
    tables = {plugin.name: table}
    for each in plugin.parameters if plugin.kind == "bsdf" else ():
        for value in dict.fromkeys((each.min, each.max)) if each.type == "number" else ():
            tables[f"{plugin.name}, {each.name} {value:g}"] = {**table, "parameters": {each.name: value}}
    return _of_tables(tables, plugin.source, plugins)


def _of_tables(tables: dict[str, Any], title: str, plugins: Sequence[Plugin]) -> Subject:
    camera = {"position": [0.0, 0.0, 4.0], "target": [0.0, 0.0, 0.0]}
    try:
        scene = Scene.model_validate({"camera": camera, "materials": tables})
    except ValidationError as error:
        raise scene_error(error, Scene, "command line") from None
    scene = scene.placed("command line", scene.base_folder).with_plugins(plugins)
    return Subject(title, scene, tuple(tables), {})


def _of_table(table: Any, title: str, sweep: bool, plugins: Sequence[Plugin] = ()) -> Subject:
    """One material; with `sweep` also with each roughness, if it has one."""
    kind = table.get("type") if isinstance(table, dict) else None
    name = kind if isinstance(kind, str) and kind in MATERIAL_TYPES else "material"
    rough = sweep and "roughness" in MATERIAL_TYPES[name].model_fields
    swept = tuple((value, f"{name}, roughness {value:g}") for value in ROUGHNESSES if rough)
    tables = {name: table, **{other: {**table, "roughness": value} for value, other in swept}}
    subject = _of_tables(tables, title, plugins)
    return replace(subject, names=(name,), swept={name: swept} if swept else {})


def _no_names(names: Iterable[str], what: str) -> None:
    if list(names):
        raise UsageError(f"--material chooses among the materials of a scene, and this is {what}; leave it out")


def _claims(scene: Scene, name: str) -> frozenset[str]:
    material = scene.materials[name]
    if isinstance(material, Mix):
        first, second = (_claims(scene, part) for part in material.materials)
        return first & second
    if isinstance(material, PluginMaterial):
        return frozenset(next(each for each in scene.plugins if each.name == material.plugin).header.claims)
    if isinstance(material, Measured):
        return frozenset()  # nothing measured is exactly reciprocal, and there is no white version of it
    # How far from the axis of a fibre light arrives is told by the direction that it leaves in
    return frozenset(("lossless",) if isinstance(material, Hair) else ("reciprocal", "lossless"))


def _relative_index(scene: Scene, name: str, seen: set[str]) -> float:
    """Relative index of a material, or of the first of its parts that has one."""
    material: Any = scene.materials[name]
    seen.add(name)
    index = None if isinstance(material, Hair) else getattr(material, "ior", None)
    if isinstance(index, float | int):
        thin = any(getattr(material, key, False) is True for key in ("thin", "thin_walled"))
        return 1.0 if thin else float(index) / float(getattr(material, "exterior_ior", 1.0))
    for value in dict(material).values():
        for part in value if isinstance(value, list | tuple) else (value,):
            if isinstance(part, str) and part in scene.materials and part not in seen:
                eta = _relative_index(scene, part, seen)
                if eta != 1.0:
                    return eta
    return 1.0
