"""The same scene elsewhere, in another size, or read by a program with all features of the kernels."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Final
from unittest.mock import patch

import numpy as np
from exact import Floats
from mixed_parts import Json

from clrender.exact.matrices import inverse
from clrender.flatten.features import Features

__all__ = ["FAR_LAMP", "PLACES", "compiled_for_volumes", "moved", "with_all_features"]

_POINTS: Final = ("center", "origin", "position", "target", "points")
_LENGTHS: Final = (
    "radius",
    "size",
    "edge_u",
    "edge_v",
    "height",
    "aperture_radius",
    "focus_distance",
    "attenuation_distance",
)
FAR_LAMP: Final = [1e-4, 1e-4, 1e-4]
"""Intensity of the lamp that is added for its features only, in a closed black box."""
VOLUMES: Final = (
    "interiors",
    "media",
    "equiangular",
    "subsurface",
    "straight_shadows",
    "grids",
    "glowing_media",
    "curves",
    "hair",
    "measured",
    "moving_lights",
)
"""Features of kernels that change no bit where a scene has no such thing."""
_FAR: Final = 40.0
"""Distance of what is added for its features only; lens and view do not reach it."""


def _times(value: Any, factor: float) -> Any:
    return [_times(each, factor) for each in value] if isinstance(value, list) else value * factor


def _plus(point: list[float], by: list[float]) -> list[float]:
    return [a + b for a, b in zip(point, by, strict=True)]


def moved(content: Json, factor: float, by: list[float]) -> Json:
    """A scene with all lengths times a factor, and then moved; radiance stays as it is.

    Parameters
    ----------
    content : dict
        What a scene file says.
    factor : float
    by : (3,) float
        Metres.
    """
    scene = copy.deepcopy(content)
    moving = (each.get("motion", []) for each in (*scene["shapes"], *scene["lights"]))
    if any(key.keys() & {"rotate_degrees", "matrix"} for keys in moving for key in keys):
        by = [0.0, 0.0, 0.0]  # about another point they turn in another way
    for shape in _all_shapes(scene):
        _enlarge(shape, factor)
        for key in shape.get("motion", []):
            _enlarge_key(key, factor)
    for shape in scene["shapes"]:
        _shift(shape, by)
    for light in scene["lights"]:
        for key in light.get("motion", []):
            _enlarge_key(key, factor)
    for part in (scene["camera"], *scene["lights"]):
        _enlarge(part, factor)
        if "position" in part:
            part["position"] = _plus(part["position"], by)
        if "target" in part:
            part["target"] = _plus(part["target"], by)
        for key in part.get("motion", []):
            key |= {name: _plus(_times(key[name], factor), by) for name in ("position", "target") if name in key}
        for key in ("camera_to_world", "world_to_camera"):
            if key in part:
                part[key] = _posed_elsewhere(np.array(part[key]), factor, by, inward=key == "world_to_camera").tolist()
        if part.get("type") in ("point", "spot"):
            part["intensity"] = _times_color(part["intensity"], factor * factor)
        if part.get("type") in ("ies", "projector", "plugin"):
            part["scale"] = _times_color(part.get("scale", 1.0), factor * factor)
    for material in scene.get("materials", {}).values():
        for key in ("radius", "attenuation_distance"):
            if key in material:
                material[key] = _times(material[key], factor)
        if "bump_map" in material:
            material["bump_map"]["scale"] = material["bump_map"].get("scale", 1.0) * factor
    for medium in scene.get("media", {}).values():
        for key in ("absorption", "scattering", "emission"):
            if key in medium:
                medium[key] = _times_color(medium[key], 1.0 / factor)
    of_groups = {shape.get("interior") for group in scene.get("groups", {}).values() for shape in group["shapes"]}
    for name, medium in scene.get("media", {}).items():
        for key in ("density", "albedo", "emission_grid", "temperature"):
            if key in medium:
                _enlarge_grid(medium[key], factor, [0.0, 0.0, 0.0] if name in of_groups else by)
    return scene


def _enlarge_grid(grid: Json, factor: float, by: list[float]) -> None:
    transform = grid.setdefault("transform", {})
    if "box" in grid:
        grid["box"] = _times(grid["box"], factor)
    else:
        transform["scale"] = _times(transform.get("scale", 1.0), factor)
    transform["translate"] = _plus(_times(transform.get("translate", [0.0] * 3), factor), by)


def _all_shapes(scene: Json) -> Iterator[Json]:
    yield from scene["shapes"]
    for group in scene.get("groups", {}).values():
        yield from group["shapes"]


def _enlarge(part: Json, factor: float) -> None:
    by_transform = "file" in part and part["type"] == "curves"  # as below, of radii and all
    for key in (*_POINTS, *_LENGTHS, "vertices"):
        if key in part and not by_transform:
            part[key] = _times(part[key], factor)
    for pose in part.get("poses", []):
        pose["vertices"] = _times(pose["vertices"], factor)
    if isinstance(part.get("transforms"), str):
        part["transforms"] = copy.deepcopy(PLACES)
    matrices = part.get("transforms", [])
    if "transform" in part and "matrix" in part["transform"]:
        matrices = [part["transform"]["matrix"]]
    elif "translate" in part.get("transform", {}):
        part["transform"]["translate"] = _times(part["transform"]["translate"], factor)
    for matrix in matrices:
        for row in matrix[:3]:
            row[3] *= factor
    if "file" in part and part["type"] in ("mesh", "curves"):  # its vertices are what they are
        part["transform"]["scale"] = _times(part["transform"].get("scale", 1.0), factor)


def _enlarge_key(key: Json, factor: float) -> None:
    if "translate" in key:
        key["translate"] = _times(key["translate"], factor)
    for row in key.get("matrix", [])[:3]:
        row[3] *= factor


def _posed_elsewhere(matrix: Floats, factor: float, by: list[float], *, inward: bool) -> Floats:
    """The pose of a camera whose distance from the origin is multiplied, and which is then moved."""
    matrix = inverse(matrix) if inward else matrix
    matrix[:3, 3] = matrix[:3, 3] * factor + by
    return inverse(matrix) if inward else matrix


def _shift(shape: Json, by: list[float]) -> None:
    """Move a shape of the scene, or an instance."""
    transform = shape.get("transform")
    matrices = shape.get("transforms", [])
    if transform and "matrix" in transform:
        matrices = [transform["matrix"]]
    if matrices:
        for matrix in matrices:
            for row, step in zip(matrix[:3], by, strict=True):
                row[3] += step
    else:
        shape["transform"] = {
            **(transform or {}),
            "translate": _plus((transform or {}).get("translate", [0.0] * 3), by),
        }


PLACES: Final = [
    [[0.3, 0.1, 0.0, -0.7], [0.0, -0.2, 0.1, 0.6], [0.05, 0.0, 0.25, 0.5], [0.0, 0.0, 0.0, 1.0]],
    [[0.2, 0.0, 0.1, 0.8], [0.0, 0.3, 0.0, -0.6], [-0.1, 0.1, 0.2, 0.4], [0.0, 0.0, 0.0, 1.0]],
]
"""The transforms of ``places.npy``."""


def with_all_features(content: Json) -> Json:
    """The scene and, far away, one thing for each feature that kernels are compiled for: so scenes share programs.

    None of it changes the image by more than the specks that it is; lamps are in a closed black box. The environment
    becomes a map. What is left to the scene is sun, fog, and whether it has an environment, volumes and media: these
    are what some integrators refuse; see `compiled_for_volumes`.

    Parameters
    ----------
    content : dict
        What a scene file says.
    """
    scene = copy.deepcopy(content)
    here = iter([0.3 * step, -0.2 * step, _FAR] for step in range(-3, 18))
    made = scene.setdefault("materials", {}).values()
    scatters = "media" in scene or any(each["type"] == "subsurface" for each in made)
    if scatters or any("priority" in each or "attenuation_color" in each for each in made):
        scene["materials"]["far glass"] = {"type": "dielectric", "ior": 1.5, "priority": 1}
        scene["shapes"].append({"type": "sphere", "center": next(here), "radius": 0.1, "material": "far glass"})
    if scatters:
        scene["materials"]["far wax"] = {"type": "subsurface", "albedo": 1.0, "radius": 0.02}
        scene.setdefault("media", {})["far smoke"] = {"scattering": 10.0}
        for key, name in (("material", "far wax"), ("interior", "far smoke")):
            scene["shapes"].append({"type": "sphere", "center": next(here), "radius": 0.1, key: name})
    _add_surfaces(scene, here)
    dark = next(here)
    low = _plus(dark, [-0.02, -0.02, 0.0])
    shape = {"type": "quad", "origin": low, "edge_u": [0.04, 0.0, 0.0], "edge_v": [0.0, 0.04, 0.0]}
    scene["shapes"] += [
        {"type": "box", "center": dark, "size": [0.1] * 3},
        {**shape, "emission": {"checker": [0.1, 0.2]}},
    ]
    lamp = {"type": "spot", "position": _plus(dark, [0.0, 0.0, 0.01]), "direction": [0.0, 0.0, 1.0]}
    lights = [_as_map(light) for light in scene["lights"]]
    scene["lights"] = [*lights, {**lamp, "intensity": FAR_LAMP, "cone_degrees": 60.0}]
    return scene


@contextmanager
def compiled_for_volumes() -> Iterator[None]:
    """Kernels are compiled as if every scene had volumes, media, motion and a calibrated camera, to share programs.

    As things far away they would be refused by some integrators.
    """
    of, seen_by = Features.of, Features.seen_by

    def made(*values: Any) -> Features:
        flags: dict[str, Any] = dict.fromkeys(VOLUMES, True)
        return replace(of(*values), **flags)

    def seen(features: Features, *values: Any) -> Features:
        return replace(seen_by(features, *values), calibrated_camera=True, motion=True)

    with patch.object(Features, "of", made), patch.object(Features, "seen_by", seen):
        yield


def _add_surfaces(scene: Json, here: Iterator[list[float]]) -> None:
    """Textures, holes, tables of facets, instances, smooth normals, what is hidden, and a tree that is not small."""
    mask = {"texture": "alpha.png", "channel": "a"}
    scene["materials"]["far mask"] = {"type": "lambert", "reflectance": [1.0, 1.0, 1.0], "opacity": mask}
    scene["materials"]["far white"] = {"type": "lambert", "reflectance": [1.0, 1.0, 1.0]}
    metal = {"type": "conductor", "f0": [1.0, 1.0, 1.0], "roughness": 0.5, "microfacets": "beckmann"}
    scene["materials"]["far metal"] = metal
    box = {"type": "box", "size": [0.1] * 3, "material": "far metal"}
    scene.setdefault("groups", {})["far group"] = {"shapes": [box]}
    quad = {"type": "quad", "origin": next(here), "edge_u": [0.1, 0.0, 0.0], "edge_v": [0.0, 0.1, 0.0]}
    ball = {"type": "mesh", "file": "smooth.obj", "transform": {"translate": next(here), "scale": 0.05}}
    scene["shapes"] += [
        {**quad, "material": "far mask"},
        {**quad, "origin": next(here), "material": "far white", "visible_to_camera": False},
        {**ball, "material": "far white", "shadow_terminator_offset": True},
        {"type": "instance", "group": "far group", "transform": {"translate": next(here)}},
        *({**box, "center": next(here)} for _ in range(8)),
    ]


def _as_map(light: Json) -> Json:
    if light["type"] != "environment" or "file" in light or isinstance(light["radiance"], dict):
        return light
    scale = light.get("scale", 1.0)
    scales = scale if isinstance(scale, list) else [scale] * 3
    return {
        "type": "environment",
        "file": "white.exr",
        "scale": [r * s for r, s in zip(light["radiance"], scales, strict=True)],
    }


def _times_color(color: Any, factor: float) -> Any:
    """A colour or a spectrum of light times a factor."""
    if isinstance(color, dict):
        return {**color, "scale": color.get("scale", 1.0) * factor}
    return _times(color, factor)
