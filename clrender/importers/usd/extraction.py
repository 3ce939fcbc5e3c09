"""Takes what is drawn out of a USD stage, as plain tables and arrays; runs in the child process."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdLux, UsdRender, UsdShade

from clrender.errors import SceneError
from clrender.importers.usd.layers import Layers, reason
from clrender.importers.usd.networks import Networks
from clrender.importers.usd.skins import skins_of
from clrender.wording import quoted

__all__ = ["extracted"]

_INSIDE: Final = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded & ~Usd.PrimIsAbstract)
"""Below a prototype, which may itself be a class or an override."""
_DRAWN: Final = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
_SOLIDS: Final = ("Sphere", "Cube", "Cylinder", "Cone", "Capsule", "Plane", "Cylinder_1", "Capsule_1")
_LIGHTS: Final = (
    "DistantLight",
    "DomeLight",
    "DomeLight_1",
    "SphereLight",
    "RectLight",
    "DiskLight",
    "CylinderLight",
)
_SHOWN: Final = ("default", "render")
_PRIMVARS: Final = ("displayColor", "displayOpacity")
_HELD: Final = ("Xform", "Scope", "Material", "Shader", "NodeGraph", "SkelRoot", "Skeleton", "SkelAnimation")
_SILENT: Final = (*_HELD, "GeomSubset", "BlendShape", "Camera", "PointInstancer", "")
"""Types of prims that are not drawn themselves, or elsewhere."""


def extracted(request: dict[str, Any], arrays: list[Any]) -> dict[str, Any]:
    """What is drawn of a stage.

    Parameters
    ----------
    request : dict
        See `clrender.importers.usd.process.read_stage`.
    arrays : list
        Receives the arrays, which the answer names by number.

    Raises
    ------
    SceneError
        The stage cannot be read.
    """
    source = request["source"]
    try:
        layers = Layers(source, Path(request["path"]), [Path(each) for each in request["allowed"]])
        return _Extraction(source, layers, request, arrays).answer()
    except SceneError:
        raise
    except Exception as error:  # of a damaged file, whatever the library, or what is made of its answers, stumbles over
        raise SceneError(f"{source}: it cannot be read: {reason(error)}; export it again") from None


class _Extraction:
    """A stage that is being read, at one time or at several."""

    def __init__(self, source: str, layers: Layers, request: dict[str, Any], arrays: list[Any]) -> None:
        self._source, self._layers, self._arrays = source, layers, arrays
        self._stage = stage = layers.stage()
        rate = stage.GetTimeCodesPerSecond()
        first = stage.GetStartTimeCode() if stage.HasAuthoredTimeCodeRange() else None
        if request["time_at"] is not None:
            first = request["time_at"] * rate
        elif first is None and request["offsets"]:
            first = 0.0
        self._times = [Usd.TimeCode.EarliestTime() if first is None else Usd.TimeCode(first)]
        self._times += [Usd.TimeCode(first + each * rate) for each in request["offsets"]]
        self._time = self._times[0]
        self._notes: list[str] = []
        self._moving = False
        self._nodes: list[Any] = []
        self._ops: list[Any] = []
        self._known: dict[str, dict[str, int]] = {"ops": {}, "meshes": {}, "curves": {}}
        self._meshes: list[Any] = []
        self._lists: dict[str, list[Any]] = {}
        self._networks = Networks(layers, self._time)
        self._skins = skins_of(stage)

    def answer(self) -> dict[str, Any]:
        stage = self._stage
        self._walk("", stage.GetPseudoRoot().GetFilteredChildren(_DRAWN), -1, _DRAWN)
        return {
            "layers": self._layers.opened,
            "missing": self._layers.missing,
            "notes": self._notes,
            "up": str(UsdGeom.GetStageUpAxis(stage)),
            "meters": UsdGeom.GetStageMetersPerUnit(stage),
            "animated": self._moving or any(each["animated"] for each in self._meshes),
            "lists": self._lists,
            "nodes": self._nodes,
            "ops": self._ops,
            "meshes": self._meshes,
            "materials": self._networks.materials,
            "nodes_of_materials": self._networks.nodes,
            "render": self._render(),
        }

    def _note(self, sentence: str) -> None:
        if sentence not in self._notes:
            self._notes.append(sentence)

    def _walk(self, key: str, roots: Sequence[Any], parent: int, predicate: Any) -> None:
        """Fill the list `key` with what is drawn below these prims."""
        items = self._lists.setdefault(key, [])
        stack = [(prim, parent, "default") for prim in reversed(roots)]
        while stack:
            prim, above, purpose = stack.pop()
            node, kind = above, str(prim.GetTypeName())
            image = UsdGeom.Imageable(prim)
            if image:
                if len(self._times) > 1 and image.GetVisibilityAttr().ValueMightBeTimeVarying():
                    text = "its visibility changes, and is taken as it is at the time of the image"
                    self._note(f"{quoted(str(prim.GetPath()))}: {text}")
                if image.GetVisibilityAttr().Get(self._time) == UsdGeom.Tokens.invisible:
                    continue
                own = image.GetPurposeAttr()
                purpose = str(own.Get()) if own and own.HasAuthoredValue() else purpose
                if prim.IsA(UsdGeom.Xformable):
                    node = self._node(prim, above)
                if purpose in _SHOWN:
                    self._item(items, prim, kind, node)
            if kind != "PointInstancer":
                stack += [(child, node, purpose) for child in reversed(prim.GetFilteredChildren(predicate))]

    def _node(self, prim: Any, parent: int) -> int:
        """The number of a prim's place, which is relative to its parent's."""
        form = UsdGeom.Xformable(prim)
        key = str(_origin(prim).GetPath())
        if key not in self._known["ops"]:
            self._known["ops"][key] = len(self._ops)
            self._ops.append([self._op(op) for op in form.GetOrderedXformOps()])
        ops, resets = self._known["ops"][key], form.GetResetXformStack()
        if not self._ops[ops] and not resets:
            return parent
        self._nodes.append([-1 if resets else parent, ops, bool(resets)])
        return len(self._nodes) - 1

    def _op(self, op: Any) -> list[Any]:
        moving = op.MightBeTimeVarying()
        self._moving = self._moving or moving
        times = self._times if moving else self._times[:1]
        kind = str(UsdGeom.XformOp.GetOpTypeToken(op.GetOpType()))
        return [kind, op.IsInverseOp(), [_numbers(op.Get(time)) for time in times]]

    def _item(self, items: list[Any], prim: Any, kind: str, node: int) -> None:
        path = str(prim.GetPath())
        item: dict[str, Any] = {"type": kind, "path": path, "node": node}
        if kind in _LIGHTS:
            items.append({**item, **self._networks.light(prim, kind)})
        elif kind == "Camera":
            items.append({**item, **self._camera(prim)})
        elif kind == "Mesh":
            bound = self._bound(prim)
            subsets = UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets()
            materials = [self._bound(each) for each in subsets]
            faces = [self._array(each.GetIndicesAttr().Get(self._time)) for each in subsets]
            parts = list(zip(faces, materials, strict=True))
            mesh = self._mesh(prim, [bound, *materials])
            light = {"light": self._networks.light(prim, "MeshLight")} if prim.HasAPI(UsdLux.LightAPI) else {}
            items.append({**item, "mesh": mesh, "material": bound, "subsets": parts, **light})
        elif kind in _SOLIDS:
            names = ("radius", "size", "height", "width", "length", "axis", "radiusTop", "radiusBottom")
            found = {name: _value(prim, name, self._time) for name in names if prim.HasAttribute(name)}
            items.append({**item, **found, "material": self._bound(prim), "color": self._color(prim)})
        elif kind == "BasisCurves":
            if len(self._times) > 1 and UsdGeom.BasisCurves(prim).GetPointsAttr().ValueMightBeTimeVarying():
                self._note(f"the points of {quoted(path)} rest while the shutter is open")
            items.append({**item, **self._curves(prim), "material": self._bound(prim), "color": self._color(prim)})
        elif kind == "PointInstancer":
            made = self._instancer(prim)
            items.extend([{**item, **made}] if made else [])
        elif kind not in _SILENT and (prim.IsA(UsdGeom.Gprim) or prim.HasAPI(UsdLux.LightAPI)):
            self._note(f"{kind} is not read: {quoted(path)} and others of this type were left out")

    def _bound(self, prim: Any) -> str | None:
        """The key of the material that a prim is drawn with."""
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial(UsdShade.Tokens.full)
        return self._networks.material(material) if material else None

    def _array(self, values: Any, dtype: str = "i8") -> int | None:
        """The number of an array of the answer; None if there are no values."""
        if values is None:
            return None
        self._arrays.append(np.array(values, dtype))
        return len(self._arrays) - 1

    def _over_time(self, attribute: Any, dtype: str) -> list[int | None]:
        """Values at the times, or one that holds at all of them."""
        times = self._times if attribute.ValueMightBeTimeVarying() else self._times[:1]
        return [self._array(attribute.Get(time), dtype) for time in times]

    def _mesh(self, prim: Any, materials: list[str | None]) -> int:
        wanted = sorted({*_PRIMVARS, *(name for key in materials if key for name in self._networks.primvars(key))})
        found = {name: self._primvar(prim, name) for name in wanted}
        inherited = [str(each.GetAttr().GetPath()) for each in found.values() if each is not None]
        path = str(prim.GetPath())
        skin = self._skins.get(path)
        where = _origin(prim).GetPath() if skin is None else path
        key = f"{where} {wanted} {inherited if prim.IsInstanceProxy() else ''}"
        if key in self._known["meshes"]:
            return self._known["meshes"][key]
        mesh = UsdGeom.Mesh(prim)
        normals = UsdGeom.PrimvarsAPI(prim).GetPrimvar("normals")
        if normals and normals.HasAuthoredValue():
            times = self._times if normals.ValueMightBeTimeVarying() else self._times[:1]
            normal_values = [self._flattened(normals, time, "f8") for time in times]
            interpolation = str(normals.GetInterpolation())
        else:
            normal_values = self._over_time(mesh.GetNormalsAttr(), "f8") if mesh.GetNormalsAttr().HasValue() else []
            interpolation = str(mesh.GetNormalsInterpolation())
        attribute = mesh.GetPointsAttr()
        points, animated = self._over_time(attribute, "f8"), attribute.ValueMightBeTimeVarying()
        sides: list[int | None] = []
        if skin is not None:
            animated = animated or skin[1]
            moments = self._times if animated else self._times[:1]
            deformed = [each for each in map(skin[0], moments) if each is not None]
            if len(deformed) < len(moments):
                self._note(f"the skeleton of {quoted(path)} cannot be read: it is drawn at rest")
            else:
                points = [self._array(each, "f8") for each, _ in deformed]
                sides = [self._array(each) for _, each in deformed]
        made = {
            "path": path,
            "points": points,
            "sides": sides,
            "deformed": skin is not None,
            "counts": self._array(mesh.GetFaceVertexCountsAttr().Get(self._time)),
            "indices": self._array(mesh.GetFaceVertexIndicesAttr().Get(self._time)),
            "holes": self._array(mesh.GetHoleIndicesAttr().Get(self._time)),
            "normals": normal_values,
            "normals_interpolation": interpolation,
            "scheme": str(mesh.GetSubdivisionSchemeAttr().Get() or "catmullClark"),
            "left_handed": mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded,
            "double_sided": bool(mesh.GetDoubleSidedAttr().Get()),
            "animated": animated,
            "primvars": {name: self._primvar_values(each) for name, each in found.items() if each is not None},
        }
        self._known["meshes"][key] = len(self._meshes)
        self._meshes.append(made)
        return len(self._meshes) - 1

    def _primvar(self, prim: Any, name: str) -> Any:
        found = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
        return found if found and found.HasValue() else None

    def _primvar_values(self, primvar: Any) -> dict[str, Any]:
        return {
            "values": self._flattened(primvar, self._time, "f4"),
            "interpolation": str(primvar.GetInterpolation()),
        }

    def _flattened(self, primvar: Any, time: Any, dtype: str) -> int | None:
        try:
            values = primvar.ComputeFlattened(time)
            return self._array(values, dtype) if isinstance(values, Sequence | np.ndarray) or values else None
        except (TypeError, ValueError, Tf.ErrorException):
            return None

    def _color(self, prim: Any) -> list[Any]:
        """A constant colour and opacity of what has no material; None for each that there is not."""
        found: list[Any] = []
        for name in _PRIMVARS:
            primvar = self._primvar(prim, name)
            values = None if primvar is None else primvar.Get(self._time)
            found.append(_numbers(values[0]) if values else None)
        return found

    def _curves(self, prim: Any) -> dict[str, Any]:
        curves = UsdGeom.BasisCurves(prim)
        widths = curves.GetWidthsAttr()
        primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar("widths")
        given = primvar if primvar and primvar.HasAuthoredValue() else None
        interpolation = given.GetInterpolation() if given else curves.GetWidthsInterpolation()
        return {
            "points": self._array(curves.GetPointsAttr().Get(self._time), "f8"),
            "counts": self._array(curves.GetCurveVertexCountsAttr().Get(self._time)),
            "widths": self._array((given or widths).Get(self._time), "f8"),
            "widths_interpolation": str(interpolation),
            "kind": str(curves.GetTypeAttr().Get()),
            "basis": str(curves.GetBasisAttr().Get()),
            "wrap": str(curves.GetWrapAttr().Get()),
            "ribbon": curves.GetNormalsAttr().HasValue() and bool(curves.GetNormalsAttr().Get(self._time)),
        }

    def _camera(self, prim: Any) -> dict[str, Any]:
        names = [
            "projection",
            "horizontalAperture",
            "verticalAperture",
            "horizontalApertureOffset",
            "verticalApertureOffset",
            "focalLength",
            "fStop",
            "focusDistance",
            "exposure",
            "exposure:iso",
            "exposure:time",
            "exposure:fStop",
            "exposure:responsivity",
            "shutter:open",
            "shutter:close",
        ]
        return {name: _value(prim, name, self._time) for name in names if prim.HasAttribute(name)}

    def _instancer(self, prim: Any) -> dict[str, Any] | None:
        instancer, time, path = UsdGeom.PointInstancer(prim), self._time, str(prim.GetPath())
        keys: list[str] = []
        for target in instancer.GetPrototypesRel().GetForwardedTargets():
            root = self._stage.GetPrimAtPath(target)
            key = f"prototype {_origin(root).GetPath() if root else target}"
            keys.append(key)
            if key not in self._lists:
                self._lists[key] = []
                if root:
                    self._walk(key, [root], -1, _INSIDE)
        attributes = [instancer.GetPositionsAttr(), instancer.GetScalesAttr(), instancer.GetOrientationsAttr()]
        if len(self._times) > 1 and any(each.ValueMightBeTimeVarying() for each in attributes):
            self._note(f"the points of {quoted(path)} rest while the shutter is open")
        indices = instancer.GetProtoIndicesAttr().Get(time)
        if indices is None or not keys:
            self._note(f"{quoted(path)} was left out: it has no prototypes, or no protoIndices")
            return None
        mask = instancer.ComputeMaskAtTime(time)
        turns = instancer.GetOrientationsfAttr().Get(time) or instancer.GetOrientationsAttr().Get(time)
        # Rows of real and imaginary parts
        quaternions = None if not turns else [(each.GetReal(), *each.GetImaginary()) for each in turns]
        return {
            "prototypes": keys,
            "indices": self._array(indices),
            "mask": self._array(mask) if mask else None,
            "positions": self._array(instancer.GetPositionsAttr().Get(time), "f8"),
            "orientations": self._array(quaternions, "f8"),
            "scales": self._array(instancer.GetScalesAttr().Get(time), "f8"),
        }

    def _render(self) -> dict[str, Any]:
        """Camera and resolution of the render settings that the stage names."""
        settings = UsdRender.Settings.GetStageRenderSettings(self._stage)
        if not settings:
            return {}
        cameras = settings.GetCameraRel().GetForwardedTargets()
        size = settings.GetResolutionAttr()
        found: dict[str, Any] = {"camera": str(cameras[0])} if cameras else {}
        return {**found, "resolution": list(size.Get())} if size and size.HasAuthoredValue() else found


def _origin(prim: Any) -> Any:
    """The prim that instances share."""
    return prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim


def _value(prim: Any, name: str, time: Any) -> Any:
    return _numbers(prim.GetAttribute(name).Get(time))


def _numbers(value: Any) -> Any:
    """A value of USD as numbers, texts and lists."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, Gf.Quatd | Gf.Quatf | Gf.Quath):
        return [float(value.GetReal()), *(float(x) for x in value.GetImaginary())]
    if isinstance(value, Gf.Matrix4d):
        return [[float(x) for x in row] for row in value]
    if isinstance(value, Sdf.AssetPath):
        return value.path
    try:
        return [float(x) for x in value]
    except (TypeError, ValueError):
        return None
