"""Checks animations: samplers and channels fit their targets, times ascend, rotations are unit quaternions."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from clrender.importers.gltf.accessors import Accessors
from clrender.importers.gltf.document import Document
from clrender.wording import counted

__all__ = ["check_animations", "target_count"]

_TYPES: Final = {"translation": "VEC3", "rotation": "VEC4", "scale": "VEC3", "weights": "SCALAR"}
_NOT_UNIT: Final = 0.02
"""Tolerance of a quaternion's length: that of normalised bytes has an error of a hundredth."""


def target_count(document: Document, node: dict[str, Any]) -> int:
    """Number of morph targets of a node's mesh."""
    if "mesh" not in node:
        return 0
    return len(document.items("meshes")[node["mesh"]]["primitives"][0].get("targets", []))


def check_animations(document: Document, accessors: Accessors) -> None:
    """Check all animations, used or not.

    Raises
    ------
    SceneError
        With the JSON pointer of the first fault.
    """
    for index, animation in enumerate(document.items("animations")):
        at = f"/animations/{index}"
        for number, sampler in enumerate(animation["samplers"]):
            _check_times(document, accessors, sampler, f"{at}/samplers/{number}")
        met: set[tuple[int, str]] = set()
        for number, channel in enumerate(animation["channels"]):
            place = f"{at}/channels/{number}"
            if channel["sampler"] >= len(animation["samplers"]):
                text = f"is {channel['sampler']}, but of samplers there are {len(animation['samplers'])}"
                raise document.fault(f"{place}/sampler", f"{text}; name one that exists")
            path, node = channel["target"].get("path"), channel["target"].get("node")
            if path not in _TYPES or node is None:
                continue
            if (node, path) in met:
                text = f"is {path} of node {node}, which another channel moves already; leave one of them out"
                raise document.fault(f"{place}/target", text)
            met.add((node, path))
            _check_target(document, node, path, f"{place}/target")
            sampler = animation["samplers"][channel["sampler"]]
            _check_values(document, accessors, sampler, node, path, f"{place}/sampler")


def _strided(document: Document, accessor: dict[str, Any]) -> bool:
    views = document.items("bufferViews")
    return "bufferView" in accessor and "byteStride" in views[accessor["bufferView"]]


def _check_times(document: Document, accessors: Accessors, sampler: dict[str, Any], at: str) -> None:
    for key in ("input", "output"):
        if _strided(document, document.items("accessors")[sampler[key]]):
            document.forgive(
                f"{at}/{key}", "names data with a byteStride, which an animation must not have; export it again"
            )
    accessor = document.items("accessors")[sampler["input"]]
    if accessor.get("type") != "SCALAR" or accessor["componentType"] != 5126:
        raise document.fault(f"{at}/input", "must name floats, the times of its key frames; export it again")
    if "min" not in accessor or "max" not in accessor:
        document.forgive(f"{at}/input", "names an accessor without min and max; export it again")
    if sampler.get("interpolation") == "CUBICSPLINE" and accessor["count"] < 2:
        raise document.fault(f"{at}/input", "has one key frame, but a cubic spline needs two; export it again")
    if not accessors.known(sampler["input"]):
        return
    times = accessors.raw(sampler["input"])
    if times[0] < 0.0:
        raise document.fault(f"{at}/input", f"begins at {times[0]:g} seconds, before 0; export it again")
    if (times[1:] <= times[:-1]).any():
        row = int(np.argmax(times[1:] <= times[:-1])) + 1
        raise document.fault(
            f"{at}/input", f"does not grow: key frame {row} is at {times[row]:g} seconds; export it again"
        )


def _check_target(document: Document, node: int, path: str, at: str) -> None:
    moved = document.items("nodes")[node]
    if path == "weights":
        if not target_count(document, moved):
            raise document.fault(at, f"moves weights of node {node}, whose mesh has no morph targets; leave it out")
    elif "matrix" in moved:
        text = f"moves node {node}, which has a matrix; it must have translation, rotation and scale instead"
        raise document.fault(at, text)


def _check_values(
    document: Document, accessors: Accessors, sampler: dict[str, Any], node: int, path: str, at: str
) -> None:
    accessor = document.items("accessors")[sampler["output"]]
    share = accessor["componentType"] == 5126 or (path in ("rotation", "weights") and accessor.get("normalized"))
    if accessor.get("type") != _TYPES[path] or not share:
        raise document.fault(at, f"has values that cannot be a {path}: they must be {_TYPES[path]} of floats")
    cubic = 3 if sampler.get("interpolation") == "CUBICSPLINE" else 1
    frames = document.items("accessors")[sampler["input"]]["count"]
    needed = frames * cubic * (target_count(document, document.items("nodes")[node]) if path == "weights" else 1)
    if accessor["count"] != needed:
        raise document.fault(
            at, f"has {counted(accessor['count'], 'value')}, but {frames} key frames need {needed}; export it again"
        )
    if path == "rotation" and accessors.known(sampler["output"]):
        turns = accessors.floats(sampler["output"]).astype(np.float64)
        turns = turns[1::3] if cubic == 3 else turns
        off = np.abs(np.sqrt((turns * turns).sum(axis=1)) - 1.0)
        if (off > _NOT_UNIT).any():
            row = int(np.argmax(off > _NOT_UNIT))
            raise document.fault(
                at, f"has a rotation, of key frame {row}, whose quaternion has not length 1; export it again"
            )
