"""Converts UsdPreviewSurface materials to `principled` ones."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final

from clrender.importers.asset_files import AssetFiles
from clrender.importers.draft import Draft
from clrender.importers.usd.textures import Node, Nodes, Textures, value
from clrender.wording import quoted

__all__ = ["GREY", "Materials", "Used"]

GREY: Final = [0.18, 0.18, 0.18]
"""Colour of what has neither a material nor a colour of its own, and the default of UsdPreviewSurface."""
_SURFACES: Final = ("UsdPreviewSurface", "ND_UsdPreviewSurface_surfaceshader")
_READ: Final = frozenset(
    [
        "diffuseColor",
        "emissiveColor",
        "useSpecularWorkflow",
        "specularColor",
        "metallic",
        "roughness",
        "clearcoat",
        "clearcoatRoughness",
        "opacity",
        "opacityMode",
        "opacityThreshold",
        "ior",
        "normal",
        "displacement",
        "occlusion",
    ]
)
_MOST_SPECULAR: Final = 0.98
"""Largest reflectance at normal incidence for which an index of refraction is found."""
_MOST_EMISSION: Final = 1e12


@dataclass(frozen=True)
class Used:
    """A material of the draft.

    Attributes
    ----------
    name : str
        Name in the draft.
    sets : tuple of str
        Primvars of its texture coordinates, at most two.
    colors : str or None
        Primvar whose colours multiply the material's.
    shines : bool
        Whether it has an emission.
    filled : bool
        Whether light passes it.
    """

    name: str
    sets: tuple[str, ...] = ()
    colors: str | None = None
    shines: bool = False
    filled: bool = False


@dataclass
class _Making:
    """A material under construction."""

    place: str
    made: dict[str, Any] = field(default_factory=lambda: {"type": "principled"})
    sets: list[str] = field(default_factory=list)
    colors: str | None = None


class Materials:
    """Converts materials when something is drawn with them.

    Parameters
    ----------
    draft : Draft
    files : AssetFiles
    tables : dict
        See `clrender.importers.usd.extraction`.
    """

    def __init__(self, draft: Draft, files: AssetFiles, tables: dict[str, Any]) -> None:
        self._draft, self._given = draft, tables["materials"]
        self._nodes: Nodes = tables["nodes_of_materials"]
        self._textures = Textures(draft, files, self._nodes)
        self._made: dict[str, Used] = {}

    def of(self, key: str | None, color: list[float] | None = None, opacity: float = 1.0) -> Used:
        """The material of a key; for None one of a colour and an opacity.

        Parameters
        ----------
        key : str or None
        color : list of float, optional
            Default: `GREY`.
        opacity : float
        """
        if key is None:
            return self._plain(GREY if color is None else color, opacity)
        if key not in self._made:
            self._made[key] = self._material(key)
        return self._made[key]

    def _plain(self, color: list[float], opacity: float) -> Used:
        held = [min(max(x, 0.0), 1.0) if math.isfinite(x) else 0.0 for x in color]
        made: dict[str, Any] = {"type": "principled", "base_color": held}
        if opacity < 1.0:
            made["opacity"] = max(opacity, 0.0)
        return Used(self._named("no material", made))

    def _named(self, wanted: str, made: dict[str, Any]) -> str:
        materials = self._draft.description["materials"]
        wanted = wanted[:150] or "material"
        name, number = wanted, 2
        while name in materials and materials[name] != made:
            name, number = f"{wanted} {number}", number + 1
        materials[name] = made
        return name

    def _material(self, key: str) -> Used:
        given = self._given[key]
        surface = self._nodes.get(given["surface"] or "")
        if surface is None or surface["id"] not in _SURFACES:
            what = "has no surface" if surface is None else f"is a {quoted(surface['id'] or 'shader without a name')}"
            self._draft.note(f"the material {quoted(key)} {what}, where UsdPreviewSurface is read: grey in its place")
            return self._plain(GREY, 1.0)
        if given["displaced"] or "displacement" in surface["in"]:
            self._draft.note(f"the displacement of the material {quoted(key)} was left out")
        for name in sorted(set(surface["in"]) - _READ):
            self._draft.note(f"{quoted(name)} of the material {quoted(key)} is not understood and does nothing")
        making = _Making(f"the material {quoted(key)}")
        glass = self._fill(making, surface)
        made = making.made
        sets = tuple(making.sets)
        shines = "emission" in made
        if glass is None:
            return Used(self._named(given["name"], made), sets, making.colors, shines)
        weight, sheet = glass
        if weight == 0.0:
            return Used(self._named(given["name"], sheet), sets, None, False, True)
        parts = [self._named(f"{given['name']} {part}", each) for part, each in (("sheet", sheet), ("surface", made))]
        name = self._named(given["name"], {"type": "mix", "materials": parts, "weight": weight})
        return Used(name, sets, making.colors, shines, True)

    def _fill(self, making: _Making, surface: Node) -> tuple[float, dict[str, Any]] | None:
        """Set the keys of a material; for a translucent one, return its opacity and the clear sheet around it."""
        made = making.made
        self._color(making, surface, "diffuseColor", "base_color", GREY)
        if value(surface, "useSpecularWorkflow", 0):
            self._specular(making, surface)
        else:
            self._number(making, surface, "metallic", "metallic", 0.0)
            made["ior"] = self._index(making, surface)
        self._number(making, surface, "roughness", "roughness", 0.5)
        if "clearcoat" in surface["in"]:
            self._number(making, surface, "clearcoat", "coat", 0.0)
            self._number(making, surface, "clearcoatRoughness", "coat_roughness", 0.01)
        self._color(making, surface, "emissiveColor", "emission", [0.0] * 3)
        if not isinstance(made["emission"], dict) and not any(made["emission"]):
            del made["emission"]
        self._normal(making, surface)
        return self._opacity(making, surface)

    def _index(self, making: _Making, surface: Node) -> float:
        ior = value(surface, "ior", 1.5)
        if "n" in surface["in"].get("ior", {}):
            self._draft.note(f"{making.place}: the picture of ior was left out")
        used = min(max(ior, 1.0), 1000.0) if math.isfinite(ior) else 1.5
        if used != ior:
            self._draft.note(f"{making.place}: ior is {ior:g}; {used:g} is taken instead")
        return used

    def _specular(self, making: _Making, surface: Node) -> None:
        """The specular workflow: the index is that of the largest reflectance, and the colour relative to it."""
        made = making.made
        made["metallic"] = 0.0
        found = self._input(making, surface, "specularColor", [0.0] * 3, number=False)
        if isinstance(found, dict):
            most = max(found.get("scale", [1.0] * 3))
            factors = [x / most if most > 0.0 else 0.0 for x in found.get("scale", [1.0] * 3)]
            color: Any = {**found, "scale": factors}
        else:
            most = max(found)
            color = [x / most if most > 0.0 else 0.0 for x in found]
        root = math.sqrt(min(max(most, 0.0), _MOST_SPECULAR))
        made |= {"ior": (1.0 + root) / (1.0 - root), "specular_color": color}

    def _opacity(self, making: _Making, surface: Node) -> tuple[float, dict[str, Any]] | None:
        made = making.made
        found = self._input(making, surface, "opacity", 1.0, number=True)
        threshold = value(surface, "opacityThreshold", 0.0)
        presence = value(surface, "opacityMode", "transparent") == "presence"
        if isinstance(found, dict):
            made["opacity"] = found
            if threshold > 0.0:
                made["opacity_cutoff"] = min(threshold, 1.0)
            elif not presence:
                self._draft.note("where a picture makes a surface translucent it reflects less, too, as if cut out")
            return None
        opacity = found if isinstance(found, float) else found[0]
        if threshold > 0.0:
            if opacity < threshold:
                made["opacity"] = 0.0
            return None
        if opacity >= 1.0:
            return None
        opacity = max(opacity, 0.0)
        if presence or "emission" in made:
            made["opacity"] = opacity
            if not presence:
                self._draft.note(f"{making.place} shines and is translucent: it reflects less, too, as if cut out")
            return None
        sheet: dict[str, Any] = {"type": "dielectric", "thin": True, "ior": made["ior"], "roughness": made["roughness"]}
        if "normal_map" in made:
            sheet["normal_map"] = made["normal_map"]
        self._draft.note("translucent materials are thin sheets, which do not refract")
        return opacity, sheet

    def _normal(self, making: _Making, surface: Node) -> None:
        given = surface["in"].get("normal", {})
        if "n" not in given:
            return
        node = self._nodes.get(given["n"] or "")
        if node is None or node["id"] != "UsdUVTexture":
            self._draft.note(f"{making.place}: its normal is not that of a picture, and was left out")
            return
        place = f"{making.place}: normal"
        found = self._textures.made(given["n"], "rgb", place, making.sets, number=False, normal=True)
        if isinstance(found, dict):
            making.made["normal_map"] = found

    def _color(self, making: _Making, surface: Node, name: str, key: str, default: list[float]) -> None:
        found = self._input(making, surface, name, default, number=False)
        if not isinstance(found, dict):
            most = _MOST_EMISSION if key == "emission" else 1.0
            held = [min(max(x, 0.0), most) if math.isfinite(x) else 0.0 for x in found]
            if held != found:
                self._draft.note(f"{making.place}: {name} goes beyond 0 to {most:g}, where it was cut off")
            found = held
        making.made[key] = found

    def _number(self, making: _Making, surface: Node, name: str, key: str, default: float) -> None:
        found = self._input(making, surface, name, default, number=True)
        if not isinstance(found, dict):
            found = found if isinstance(found, float) else found[0]
            held = min(max(found, 0.0), 1.0) if math.isfinite(found) else default
            if held != found:
                self._draft.note(f"{making.place}: {name} is {found:g}; {held:g} is taken instead")
            found = held
        making.made[key] = found

    def _input(self, making: _Making, surface: Node, name: str, default: Any, *, number: bool) -> Any:
        """A constant or a texture."""
        given = surface["in"].get(name, {})
        if "n" not in given:
            return value(surface, name, default)
        node = self._nodes.get(given["n"] or "")
        place = f"{making.place}: {name}"
        if node is None:
            return default
        if node["id"] == "UsdUVTexture":
            found = self._textures.made(given["n"], given["o"], place, making.sets, number=number)
            if found is None:
                return default
            return found[0] if number and isinstance(found, list) else found
        if node["id"].startswith("UsdPrimvarReader") and name == "diffuseColor":
            making.colors = value(node, "varname", "displayColor")
            return [1.0] * 3
        self._draft.note(f"{place}: {quoted(node['id'])} is not read; {_told(default)} is taken instead")
        return default


def _told(default: Any) -> str:
    return f"{default:g}" if isinstance(default, float) else ", ".join(f"{x:g}" for x in default)
