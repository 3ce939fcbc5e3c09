"""Converts Mitsuba's BSDFs to our materials."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from clrender.importers.mitsuba.plugins import Plugin
from clrender.importers.mitsuba.surfaces import SurfaceReader
from clrender.importers.mitsuba.textures import TextureReader
from clrender.importers.shared.staging import Staging
from clrender.scene.materials import MIX_DEPTH
from clrender.wording import quoted

__all__ = ["MaterialReader"]


class MaterialReader:
    """Converts BSDFs to materials, each once.

    Parameters
    ----------
    staging : Staging
    textures : TextureReader
    old : bool
        Whether the file is one of 0.6, whose defaults differ.

    Attributes
    ----------
    colored : set of str
        Names of materials whose colour is multiplied by that of the vertices.
    """

    def __init__(self, staging: Staging, textures: TextureReader, old: bool) -> None:
        self._staging, self._textures = staging, textures
        self._surfaces = SurfaceReader(staging, textures, old)
        self._made: dict[tuple[int, bool], str | None] = {}
        self.colored: set[str] = set()
        self._kept: list[Plugin] = []
        self._depth = 0

    def name(self, plugin: Plugin, two_sided: bool = False) -> str | None:
        """The name of the material; None for an invisible surface.

        Raises
        ------
        SceneError
            BSDFs contain each other, or are nested too deep.
        """
        key = (id(plugin), two_sided)
        if key not in self._made:
            self._kept.append(plugin)  # so that no other object gets its id
            around, self._textures.colored = self._textures.colored, False
            described = self._guarded(plugin, two_sided)
            # Not those of an equal material whose colour is not that of the vertices
            wanted = f"{plugin.id or plugin.type}{', of vertices' if self._textures.colored else ''}"
            name = None if described is None else self._staging.material(wanted, described)
            self._made[key] = name
            if name is not None and self._textures.colored:
                self.colored.add(name)
            self._textures.colored = around
        if self._made[key] in self.colored:
            self._textures.colored = True  # of the mixture that it is a part of
        return self._made[key]

    def _guarded(self, plugin: Plugin, two_sided: bool) -> dict[str, Any] | None:
        """The description of a material, unless it contains itself."""
        if self._depth >= MIX_DEPTH or plugin.busy:
            raise plugin.fault(f"BSDFs are nested more than {MIX_DEPTH} deep, or contain themselves; use fewer")
        plugin.busy, self._depth = True, self._depth + 1
        described = self._described(plugin, two_sided)
        plugin.busy, self._depth = False, self._depth - 1
        for unknown in plugin.unused():
            self._staging.note(f"{quoted(unknown)} of {plugin.label} is not understood and does nothing")
        return described

    def _described(self, plugin: Plugin, two_sided: bool) -> dict[str, Any] | None:
        surfaces = self._surfaces
        made: dict[str, Callable[[Plugin, bool], dict[str, Any] | None]] = {
            "diffuse": surfaces.diffuse,
            "roughdiffuse": surfaces.rough_diffuse,
            "dielectric": surfaces.dielectric,
            "thindielectric": surfaces.dielectric,
            "roughdielectric": surfaces.dielectric,
            "conductor": surfaces.conductor,
            "roughconductor": surfaces.conductor,
            "plastic": surfaces.plastic,
            "roughplastic": surfaces.plastic,
            "principled": surfaces.principled,
            "principledthin": surfaces.principled,
            "hair": surfaces.hair,
            "measured": surfaces.measured,
            "twosided": self._twosided,
            "mask": self._mask,
            "bumpmap": self._bumpy,
            "bump": self._bumpy,
            "normalmap": self._bumpy,
            "blendbsdf": self._blend,
            "mixturebsdf": self._mixture,
        }
        if plugin.type == "null":
            return None
        if plugin.type in made:
            return made[plugin.type](plugin, two_sided)
        self._staging.note(f"{plugin.label} is not known: a diffuse grey of 0.5 in its place")
        plugin.ignore(*plugin.values, *(child.name for child in plugin.children))
        plugin.children_of(*(child.kind for child in plugin.children))
        return {"type": "lambert", "reflectance": [0.5, 0.5, 0.5], "two_sided": two_sided}

    def _nested(self, plugin: Plugin, two_sided: bool) -> dict[str, Any] | None:
        """The description of the one nested BSDF; None if it is invisible."""
        inside = plugin.children_of("bsdf")
        if len(inside) != 1:
            raise plugin.fault(f"{plugin.label} has {len(inside)} BSDFs inside, but must have one")
        return self._guarded(inside[0], two_sided)

    # --- nested BSDFs

    def _twosided(self, plugin: Plugin, two_sided: bool) -> dict[str, Any] | None:
        inside = plugin.children_of("bsdf")
        if not 1 <= len(inside) <= 2:
            raise plugin.fault(f"{plugin.label} has {len(inside)} BSDFs inside, but must have one or two")
        if len(inside) == 2 and inside[0] is not inside[1]:
            self._staging.note("of two-sided surfaces with two BSDFs both sides have the first one")
        made = self._guarded(inside[0], True)
        if made is not None and self._has_relief(made):
            self._staging.note("from behind, two-sided surfaces show their bump and normal maps the other way round")
        return made

    def _has_relief(self, made: dict[str, Any]) -> bool:
        """Whether a material, or a part of it, has a bump or normal map."""
        materials = self._staging.draft.description["materials"]
        parts = (materials[name] for name in made.get("materials", ()))
        return "bump_map" in made or "normal_map" in made or any(map(self._has_relief, parts))

    def _mask(self, plugin: Plugin, two_sided: bool) -> dict[str, Any] | None:
        opacity = self._textures.share(plugin, "opacity", 0.5)
        made = self._nested(plugin, two_sided)
        if made is None or opacity == 1.0:
            return made
        solid = made["type"] == "dielectric" or made.get("transmission", 0.0) != 0.0
        if solid and not made.get("thin"):
            self._staging.note("the opacity of glass with an inside is left out")
            return made
        return {**made, "opacity": opacity}

    def _bumpy(self, plugin: Plugin, two_sided: bool) -> dict[str, Any] | None:
        made = self._nested(plugin, two_sided)
        plugin.ignore("use_shadowing_function", "flip_invalid_normals")
        scale = plugin.number("scale", 1.0)
        pictures = plugin.children_of("texture")
        if made is None or not pictures:
            return made
        for each in pictures:
            plugin.ignore(each.name)
        given = pictures[0]
        while given.type == "scale" and plugin.type != "normalmap" and given.children_of("texture"):
            scale *= sum(self._textures.factor(given)) / 3.0
            given = given.children_of("texture")[0]
        picture = self._textures.picture(given, plugin.type != "normalmap")
        if picture is not None and made["type"] == "hair":
            self._staging.note("normal and bump maps of hair are left out")
            return made
        if picture is None or made["type"] == "mix":
            if picture is not None:
                self._staging.note("normal and bump maps of mixtures are left out; put them inside")
            return made
        if plugin.type == "normalmap":
            return {**made, "normal_map": picture}
        return {**made, "bump_map": {**picture, "scale": scale}}

    def _blend(self, plugin: Plugin, two_sided: bool) -> dict[str, Any]:
        inside = plugin.children_of("bsdf")
        if len(inside) != 2:
            raise plugin.fault(f"{plugin.label} has {len(inside)} BSDFs inside, but must have two")
        return self._mix(plugin, inside, self._textures.share(plugin, "weight", 0.5), two_sided)

    def _mixture(self, plugin: Plugin, two_sided: bool) -> dict[str, Any]:
        """A mixture of 0.6: any number of BSDFs, each with a weight."""
        inside = plugin.children_of("bsdf")
        weights = [
            float(x) for x in plugin.text("weights").replace(",", " ").split() if x.replace(".", "", 1).isdigit()
        ]
        if len(inside) != 2 or len(weights) != 2 or sum(weights) > 1.0 + 1e-6:
            raise plugin.fault("a mixture of other than two BSDFs with weights up to 1 is not read; use blendbsdf")
        total = sum(weights)
        made = self._mix(plugin, inside, weights[1] / max(total, 1e-9), two_sided)
        return made if total > 1.0 - 1e-6 else self._surfaces.dimmed(plugin, made, total)

    def _mix(self, plugin: Plugin, inside: list[Plugin], weight: Any, two_sided: bool) -> dict[str, Any]:
        names = []
        for each in inside:
            name = self.name(each, two_sided)
            if name is None:
                raise plugin.fault('a mixture with "null" is not read; use a mask instead')
            if "opacity" in self._staging.draft.description["materials"][name]:
                raise plugin.fault("a mask inside of a mixture is not read; put the mask around it")
            names.append(name)
        if self._textures.colored:
            self._staging.note("colours of vertices are those of both parts of a mixture")
        return {"type": "mix", "materials": names, "weight": weight}
