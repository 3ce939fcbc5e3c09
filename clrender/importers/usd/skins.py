"""Points that skeletons and blend shapes of a USD stage move; runs in the child process."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, UsdSkel, Vt

__all__ = ["Skin", "skins_of"]

Skin: TypeAlias = tuple[Callable[[Any], "tuple[NDArray[np.float64], NDArray[np.int64] | None] | None"], bool]
"""Points of a mesh by a time, (n, 3), and on which sides they are, (n,): -1 where joints mirror, or 0 where they
flatten; None if none does. None where they cannot be computed. Then whether they move."""
_DRAWN = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)


def skins_of(stage: Any) -> dict[str, Skin]:
    """The meshes that are deformed, by their paths."""
    found: dict[str, Skin] = {}
    cache = UsdSkel.Cache()
    for prim in Usd.PrimRange.Stage(stage, _DRAWN):
        if not prim.IsA(UsdSkel.Root):
            continue
        root = UsdSkel.Root(prim)
        if not cache.Populate(root, _DRAWN):
            continue
        for binding in cache.ComputeSkelBindings(root, _DRAWN):
            skeleton = cache.GetSkelQuery(binding.GetSkeleton())
            motion = skeleton.GetAnimQuery()
            moves = bool(motion) and (
                motion.JointTransformsMightBeTimeVarying() or motion.BlendShapeWeightsMightBeTimeVarying()
            )
            for target in binding.GetSkinningTargets():
                if target.GetPrim().IsA(UsdGeom.Mesh):
                    path = str(target.GetPrim().GetPath())
                    found[path] = partial(_points, skeleton, motion, target), moves
    return found


def _points(
    skeleton: Any, motion: Any, target: Any, time: Any
) -> tuple[NDArray[np.float64], NDArray[np.int64] | None] | None:
    """The points of a mesh in its own space, and their sides."""
    prim = target.GetPrim()
    points = UsdGeom.Mesh(prim).GetPointsAttr().Get(time)
    if points is None:
        return None
    points = Vt.Vec3fArray(points)
    if target.HasBlendShapes() and motion:
        _blend(motion, target, time, points)
    if not target.HasJointInfluences():
        return np.array(points, np.float64), None
    transforms = skeleton.ComputeSkinningTransforms(time)
    rest = np.array(points, np.float64).reshape(-1, 3)
    if not transforms or not target.ComputeSkinnedPoints(transforms, points, time):
        return None
    places = UsdGeom.XformCache(time)
    whole = places.GetLocalToWorldTransform(skeleton.GetPrim()) * places.GetLocalToWorldTransform(prim).GetInverse()
    rows = np.array(whole, np.float64)
    x, y, z = np.array(points, np.float64).reshape(-1, 3).T
    placed = np.stack([((x * a + y * b) + z * c) + d for a, b, c, d in rows[:, :3].T], axis=1)
    mirrors = [each.GetDeterminant() <= 0.0 for each in (*transforms, whole)]
    return placed, _sides(target, transforms, time, rest, whole) if any(mirrors) else None


def _sides(target: Any, transforms: Any, time: Any, rest: NDArray[np.float64], whole: Any) -> NDArray[np.int64]:
    """Signs of the determinants of the maps of points, which are affine, from where points beside them go."""
    step = max(float(np.abs(rest).max(initial=0.0)), 1e-30)
    gone = []
    for offset in (np.zeros(3), *(step * np.eye(3))):
        some = Vt.Vec3fArray.FromNumpy((rest + offset).astype(np.float32))
        target.ComputeSkinnedPoints(transforms, some, time)
        gone.append(np.array(some, np.float64).reshape(-1, 3))
    a, b, c = (each - gone[0] for each in gone[1:])
    volume = (a * np.cross(b, c)).sum(axis=1) * np.sign(whole.GetDeterminant())
    sound = np.abs(volume) > 1e-6 * step * step * step
    return np.where(sound, np.sign(volume), 0.0).astype(np.int64)


def _blend(motion: Any, target: Any, time: Any, points: Any) -> None:
    """Add the offsets of the blend shapes to the points."""
    weights = motion.ComputeBlendShapeWeights(time)
    if not weights:
        return
    by_name = dict(zip(motion.GetBlendShapeOrder(), weights, strict=False))
    own = Vt.FloatArray([by_name.get(name, 0.0) for name in target.GetBlendShapeOrder()])
    shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(target.GetPrim()))
    parts = shapes.ComputeSubShapeWeights(own)
    shapes.ComputeDeformedPoints(
        *parts, shapes.ComputeBlendShapePointIndices(), shapes.ComputeSubShapePointOffsets(), points
    )
