"""A small data set of everything, and its scene, as files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

__all__ = ["SCENE", "SPEC", "write_dataset"]

_RED: Final = {"type": "lambert", "reflectance": [0.7, 0.2, 0.1]}
_GOLD: Final = {"type": "conductor", "metal": "Au", "roughness": 0.3}

SCENE: Final[dict[str, Any]] = {
    "camera": {"position": [0.0, 1.5, 4.0], "target": [0.0, 0.4, 0.0], "vertical_fov": 40.0},
    "materials": {"floor": {"type": "lambert", "reflectance": [0.6] * 3}, "red": _RED, "gold": _GOLD},
    "groups": {
        "stool": {
            "shapes": [
                {"type": "box", "size": [0.5, 0.06, 0.5], "center": [0, 0.5, 0], "material": "red", "name": "seat"},
                {"type": "box", "size": [0.06, 0.5, 0.06], "center": [0, 0.25, 0], "material": "red", "name": "leg"},
            ]
        },
        "cube": {"shapes": [{"type": "box", "size": [0.3, 0.3, 0.3], "material": "red"}]},
        "orb": {"shapes": [{"type": "sphere", "radius": 0.2, "material": "gold"}]},
    },
    "shapes": [
        {
            "type": "quad",
            "name": "floor",
            "origin": [-3, 0, 3],
            "edge_u": [6, 0, 0],
            "edge_v": [0, 0, -6],
            "material": "floor",
        },
        {"type": "instance", "name": "stool", "group": "stool", "category": "furniture"},
        {
            "type": "sphere",
            "name": "ball",
            "radius": 0.3,
            "center": [0.7, 0.3, 0],
            "material": "gold",
            "category": "toy",
        },
    ],
    "lights": [
        {"type": "environment", "radiance": [0.4, 0.45, 0.5]},
        {"type": "point", "position": [1.0, 3.0, 2.0], "intensity": [20.0, 20.0, 20.0]},
    ],
}
"""A floor, a stool and a ball."""

SPEC: Final[dict[str, Any]] = {
    "scene": "scene.json",
    "images": 6,
    "seed": 7,
    "size": [36, 28],
    "writers": ["images", "coco", "bop", "transforms", "webdataset"],
    "layers": ["z_depth", "instance", "category", "part"],
    "images_per_shard": 4,
    "render": {"spp": 4},
    "camera": {
        "type": "hemisphere",
        "distance": {"uniform": [3.0, 4.5]},
        "elevation_degrees": [10.0, 70.0],
        "target": {"uniform": [[-0.2, 0.2, -0.2], [0.2, 0.4, 0.2]]},
        "roll_degrees": {"normal": [0.0, 4.0]},
    },
    "vary": {
        "camera.vertical_fov": {"normal": [40.0, 3.0], "within": [30.0, 50.0]},
        "materials.red.reflectance": {"uniform": [[0.1, 0.1, 0.1], [0.9, 0.9, 0.9]]},
        "materials.gold.roughness": {"log_uniform": [0.1, 0.6]},
        "lights[0].radiance": {"temperature": {"uniform": [3000, 9000]}, "power": {"uniform": [0.2, 0.8]}},
        "lights[1].position": {"uniform": [[-2.0, 2.0, -2.0], [2.0, 4.0, 2.0]]},
    },
    "objects": [
        {
            "name": "stool",
            "position": {"uniform": [[-0.8, 0.0, -0.8], [0.8, 0.0, 0.8]]},
            "yaw_degrees": {"uniform": [0, 360]},
        },
        {
            "name": "ball",
            "pivot": [0.7, 0.3, 0.0],
            "position": {"uniform": [[-1.0, 0.3, -1.0], [1.0, 0.3, 1.0]]},
            "present": 0.7,
        },
    ],
    "distractors": [
        {
            "groups": ["cube", "orb"],
            "count": {"integer": [0, 3]},
            "position": {"uniform": [[-1.2, 0.2, -1.2], [1.2, 1.2, 1.2]]},
            "rotation": "any",
            "scale": {"uniform": [0.5, 1.2]},
            "category": "toy",
        }
    ],
}
"""All kinds of variations, and all writers."""


def write_dataset(folder: Path, **changes: Any) -> Path:
    """Write the scene and the data set's file; returns the latter.

    Parameters
    ----------
    folder : Path
    **changes
        Keys of the data set that differ; None takes one away.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene.json").write_text(json.dumps(SCENE))
    content = {key: value for key, value in {**SPEC, **changes}.items() if value is not None}
    path = folder / "set.json"
    path.write_text(json.dumps(content))
    return path
