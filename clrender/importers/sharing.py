"""Makes instances of meshes that stand in a scene many times, whatever the format says of it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from clrender.errors import SceneError
from clrender.importers.draft import Draft
from clrender.scene.geometry import affine
from clrender.scene.groups import TransformArray
from clrender.scene.shapes import Transform

__all__ = ["share_meshes"]

_WORTH: Final = 2**17
"""Triangles that are spared: a ray's way into an instance takes time, which so few are not worth."""
_OWN_KEYS: Final = ("transform", "name")
"""Of a shape, what instances of the same group do not share."""


def share_meshes(draft: Draft) -> None:
    """Put instances of a group in the place of shapes that differ in place and name only.

    Parameters
    ----------
    draft : Draft
        Changed where that spares many triangles.
    """
    shapes: list[dict[str, Any]] = draft.description["shapes"]
    alike: dict[str, list[int]] = {}
    for index, shape in enumerate(shapes):
        if shape["type"] == "mesh" and shape.get("file") in draft.meshes:
            shared = {key: value for key, value in shape.items() if key not in _OWN_KEYS}
            alike.setdefault(json.dumps(shared, sort_keys=True), []).append(index)
    placed: dict[int, dict[str, Any] | None] = {}
    groups: dict[str, Any] = {}
    for key, indices in alike.items():
        shared = json.loads(key)
        triangles = len(draft.meshes[shared["file"]].triangles)
        if (len(indices) - 1) * triangles < _WORTH:
            continue
        try:
            named = _places(shapes, indices)
        except SceneError:  # of a scale that instances do not take
            continue
        group = shared["file"][:190]
        while group in groups:
            group = f"{group[:190]}'"
        groups[group] = {"shapes": [shared]}
        placed |= dict.fromkeys(indices)
        for first, name, array in named:
            places = f"places of {group} {first}"
            draft.places[places] = array
            instance = {"type": "instance", "group": group, "transforms": places}
            placed[first] = instance if name is None else {**instance, "name": name}
    if groups:
        every = [placed.get(index, shape) for index, shape in enumerate(shapes)]
        draft.description["shapes"] = [shape for shape in every if shape is not None]
        draft.description["groups"] = {**draft.description.get("groups", {}), **groups}


def _places(shapes: list[dict[str, Any]], indices: list[int]) -> list[tuple[int, str | None, TransformArray]]:
    """For each name that these shapes have, the first that has it, and where all those stand."""
    by_name: dict[str | None, list[int]] = {}
    for index in indices:
        by_name.setdefault(shapes[index].get("name"), []).append(index)
    return [
        (some[0], name, TransformArray.checked(np.stack([_map(shapes[index]) for index in some]), "places"))
        for name, some in by_name.items()
    ]


def _map(shape: Mapping[str, Any]) -> Any:
    """(3, 4) of its transform."""
    place = affine(Transform.model_validate(shape.get("transform", {})))
    return np.concatenate([np.array(place.linear), np.array(place.offset)[:, None]], axis=1)
