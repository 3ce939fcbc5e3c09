"""Takes materials, lights and the files that they name out of a USD stage; runs in the child process."""

from __future__ import annotations

from typing import Any, Final

from pxr import Sdf, UsdLux, UsdShade

from clrender.importers.usd.layers import Layers

__all__ = ["Networks"]

_OF_LIGHTS: Final = [
    "intensity",
    "exposure",
    "color",
    "normalize",
    "diffuse",
    "specular",
    "enableColorTemperature",
    "colorTemperature",
    "angle",
    "radius",
    "width",
    "height",
    "length",
    "texture:file",
    "texture:format",
    "shaping:cone:angle",
    "shaping:cone:softness",
    "shaping:focus",
    "shaping:focusTint",
    "shaping:ies:file",
    "shaping:ies:angleScale",
    "shaping:ies:normalize",
    "shadow:enable",
]
_DEEPEST: Final = 64


class Networks:
    """The shading of a stage at a time.

    Parameters
    ----------
    layers : Layers
    time : Usd.TimeCode

    Attributes
    ----------
    materials : dict of str to dict
        By key: name, key of the surface's node or None, and whether it has a displacement.
    nodes : dict of str to dict
        By key: identifier and inputs, each ``{"v": value}``, ``{"n": node, "o": output}`` or
        ``{"file": [name, path]}``.
    """

    def __init__(self, layers: Layers, time: Any) -> None:
        self._layers, self._time = layers, time
        self.materials: dict[str, dict[str, Any]] = {}
        self.nodes: dict[str, dict[str, Any]] = {}

    def material(self, material: Any) -> str:
        """The key of a material, which all instances of it share."""
        prim = material.GetPrim()
        origin = prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
        key = str(origin.GetPath())
        if key not in self.materials:
            surface, _, _ = material.ComputeSurfaceSource()
            displaced = bool(material.ComputeDisplacementSource()[0])
            self.materials[key] = {"name": str(prim.GetName()), "surface": None, "displaced": displaced}
            if surface:
                self.materials[key]["surface"] = self._node(surface, 0)
        return key

    def primvars(self, key: str) -> set[str]:
        """Names of the primvars that a material reads."""
        found, seen = set(), set()
        ahead = [self.materials[key]["surface"]]
        while ahead:
            at = ahead.pop()
            if at is None or at in seen:
                continue
            seen.add(at)
            node = self.nodes[at]
            if node["id"].startswith("UsdPrimvarReader"):
                name = node["in"].get("varname", {}).get("v")
                found |= {name} if isinstance(name, str) and name else set()
            ahead += [each["n"] for each in node["in"].values() if "n" in each]
        return found

    def _node(self, shader: Any, depth: int) -> str | None:
        prim = shader.GetPrim()
        origin = prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
        key = str(origin.GetPath())
        if key in self.nodes:
            return key
        if depth > _DEEPEST:
            return None
        made: dict[str, Any] = {"id": str(shader.GetShaderId() or ""), "in": {}, "path": str(prim.GetPath())}
        self.nodes[key] = made
        for given in shader.GetInputs():
            found = self._input(given, depth)
            if found is not None:
                made["in"][str(given.GetBaseName())] = found
        return key

    def _input(self, given: Any, depth: int) -> dict[str, Any] | None:
        for source in UsdShade.Utils.GetValueProducingAttributes(given):
            output = UsdShade.Output(source)
            if UsdShade.Output.IsOutput(source) and output:
                node = self._node(UsdShade.Shader(source.GetPrim()), depth + 1)
                return {"n": node, "o": str(output.GetBaseName())}
            value = source.Get(self._time)
            if isinstance(value, Sdf.AssetPath):
                return {"file": self._file(source, value)}
            return {"v": plain(value)}
        return None

    def _file(self, attribute: Any, value: Any) -> list[str]:
        """What a file is called, and where it is: absolute, also within a package."""
        if value.resolvedPath:
            return [value.path, value.resolvedPath]
        stack = attribute.GetPropertyStack(self._time)
        where = Sdf.ComputeAssetPathRelativeToLayer(stack[0].layer, value.path) if stack and value.path else value.path
        return [value.path, where]

    def light(self, prim: Any, kind: str) -> dict[str, Any]:
        """Inputs of a light."""
        made: dict[str, Any] = {}
        for name in _OF_LIGHTS:
            attribute = prim.GetAttribute(f"inputs:{name}")
            if not attribute:
                continue
            value = attribute.Get(self._time)
            if isinstance(value, Sdf.AssetPath):
                made[name] = self._file(attribute, value) if value.path else None
            elif name.startswith("shaping") and not attribute.HasAuthoredValue():
                continue
            else:
                made[name] = plain(value)
        if made.get("enableColorTemperature"):
            made["blackbody"] = [float(x) for x in UsdLux.BlackbodyTemperatureAsRgb(made["colorTemperature"])]
        if kind == "SphereLight":
            made["point"] = bool(prim.GetAttribute("treatAsPoint").Get(self._time))
        if kind == "CylinderLight":
            made["point"] = bool(prim.GetAttribute("treatAsLine").Get(self._time))
        if kind == "DomeLight_1":
            made["pole"] = str(prim.GetAttribute("poleAxis").Get())
        links = UsdLux.LightAPI(prim)
        made["linked"] = not links.GetLightLinkCollectionAPI().GetIncludeRootAttr().Get()
        made["filtered"] = bool(links.GetFiltersRel().GetTargets())
        return made


def plain(value: Any) -> Any:
    """A value of USD as a number, a text or a list of numbers; None for others."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    try:
        return [float(x) for x in value]
    except (TypeError, ValueError):
        return None
