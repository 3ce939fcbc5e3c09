"""Converts repeated meshes to instances, even if the format does not declare them as such."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.importers.draft import Draft
from clrender.scene.groups import TransformArray
from clrender.scene.shapes import Transform
from clrender.scene.transforms import affine

__all__ = ["place_group", "share_meshes"]

_WORTH: Final = 2**17
"""Fewest triangles that sharing must save: entering an instance costs a ray time."""
_OWN_KEYS: Final = ("transform", "name")
"""Keys of a shape that instances of the same group do not share."""


def share_meshes(draft: Draft) -> None:
    """Replace shapes that differ only in transform and name by instances of a group.

    Parameters
    ----------
    draft : Draft
        Changed if that saves many triangles.
    """
    shapes: list[dict[str, Any]] = draft.description["shapes"]
    alike: dict[str, list[int]] = {}
    for index, shape in enumerate(shapes):
        if shape["type"] == "mesh" and shape.get("file") in draft.meshes:
            shared = {key: value for key, value in shape.items() if key not in _OWN_KEYS}
            alike.setdefault(json.dumps(shared, sort_keys=True), []).append(index)
    placed: dict[int, dict[str, Any] | None] = {}
    groups: dict[str, Any] = {**draft.description.get("groups", {})}
    for key, indices in alike.items():
        shared = json.loads(key)
        triangles = len(draft.meshes[shared["file"]].triangles)
        if (len(indices) - 1) * triangles < _WORTH:
            continue
        try:
            named = _places(shapes, indices)
        except SceneError:  # of a scale that instances do not take
            continue
        # What follows the transform of a shape follows those of instances
        after = {"motion": shared.pop("motion")} if "motion" in shared else {}
        group = _named(groups, [shared])
        placed |= dict.fromkeys(indices)
        for first, name, array in named:
            places = f"places of {group} {first}"
            draft.places[places] = array
            instance = {"type": "instance", "group": group, "transforms": places, **after}
            placed[first] = instance if name is None else {**instance, "name": name}
    if groups:
        every = [placed.get(index, shape) for index, shape in enumerate(shapes)]
        draft.description["shapes"] = [shape for shape in every if shape is not None]
        draft.description["groups"] = groups


def place_group(
    draft: Draft,
    shapes: list[dict[str, Any]],
    maps: NDArray[np.float64],
    name: str = "",
    more: Mapping[str, Any] | None = None,
) -> bool:
    """Place shapes many times, as instances of a group, if that saves many triangles.

    Parameters
    ----------
    draft : Draft
        Receives a shape of type ``instance``, its group and its transforms.
    shapes : list of dict
        Meshes of the draft, in the form of a scene file, without transform and name.
    maps : (n, 3, 4) float64
        Affine maps to world space.
    name : str
        Name of the instances; default: none.
    more : mapping, optional
        Other keys of the instances.

    Returns
    -------
    bool
        Whether it placed them.
    """
    triangles = sum(len(draft.meshes[shape["file"]].triangles) for shape in shapes)
    if (len(maps) - 1) * triangles < _WORTH:
        return False
    description = draft.description
    try:
        array = TransformArray.checked(maps, "places")
    except SceneError:  # of a scale that instances do not take
        return False
    group = _named(description.setdefault("groups", {}), shapes)
    places = f"places of {group} {len(description['shapes'])}"
    draft.places[places] = array
    instance = {"type": "instance", "group": group, "transforms": places, **(more or {})}
    description["shapes"].append({**instance, "name": name} if name else instance)
    return True


def _named(groups: dict[str, Any], shapes: list[dict[str, Any]]) -> str:
    """The name of a group of these shapes, which is added if there is none."""
    group: str = shapes[0]["file"][:190]
    while group in groups and groups[group]["shapes"] != shapes:
        group = f"{group[:190]}'"
    groups.setdefault(group, {"shapes": shapes})
    return group


def _places(shapes: list[dict[str, Any]], indices: list[int]) -> list[tuple[int, str | None, TransformArray]]:
    """For each name of these shapes: the first shape with it, and the transforms of all shapes with it."""
    by_name: dict[str | None, list[int]] = {}
    for index in indices:
        by_name.setdefault(shapes[index].get("name"), []).append(index)
    return [
        (some[0], name, TransformArray.checked(np.stack([_map(shapes[index]) for index in some]), "places"))
        for name, some in by_name.items()
    ]


def _map(shape: Mapping[str, Any]) -> Any:
    """Matrix of its transform, (3, 4)."""
    place = affine(Transform.model_validate(shape.get("transform", {})))
    return np.concatenate([np.array(place.linear), np.array(place.offset)[:, None]], axis=1)
