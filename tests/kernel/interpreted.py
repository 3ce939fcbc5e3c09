"""Renders a scene with everything in it on the first device there is, and prints a hash of each image's sums.

``python interpreted.py RUN …`` with runs as of `RUNS`; test_oclgrind.py starts it inside Oclgrind and, for comparison, calls
`hashes` itself on another device.
"""

from __future__ import annotations

import hashlib
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from clrender import layout
from clrender.device.device import Device, DeviceInfo
from clrender.device.discover import drivers, load_platforms
from clrender.device.worker import Cut, DeviceWorker
from clrender.flatten import flatten
from clrender.scene import Scene
from clrender.work import Unit, slot_count

if TYPE_CHECKING:
    from clrender.flatten import FlatScene

__all__ = ["RUNS", "Run", "hashes", "open_interpreter"]

WIDTH: Final = 7
HEIGHT: Final = 6
TILE: Final = 8


@dataclass(frozen=True)
class Run:
    """One render.

    Attributes
    ----------
    kernel : str
        ``path`` or ``whitted``.
    lanes : int
    traversal : str
    samples : int
    large : bool
        With a mesh whose triangles need more than one chunk of the builder's sort, and a tree of several levels.
    """

    kernel: str
    lanes: int
    traversal: str = "packet"
    samples: int = 1
    large: bool = False


RUNS: Final = {
    "path-1": Run("path", 1),
    "path-4": Run("path", 4),
    "path-4-single": Run("path", 4, "single"),
    "path-16": Run("path", 16, samples=2),
    "path-8-large": Run("path", 8, large=True),
    "path-16-large": Run("path", 16, "single", large=True),
    "path-1-large": Run("path", 1, large=True),
    "whitted-4": Run("whitted", 4),
    "whitted-1-large": Run("whitted", 1, samples=2, large=True),
}


def scene(large: bool) -> FlatScene:
    """Triangles, smooth and flat, spheres, disks; every material; every kind of light, in front and behind and around."""
    from meshes import icosphere

    points, faces = icosphere(3 if large else 0)
    points = points * 0.4 + [-0.8, 0.3, 0.2]
    color = (0.7, 0.6, 0.5)
    shapes = [
        {"type": "quad", "origin": (-3, -0.5, 3), "edge_u": (6, 0, 0), "edge_v": (0, 0, -6), "material": "matt"},
        {"type": "box", "low": (0.5, -0.5, -1), "high": (1.2, 0.2, -0.3), "material": "mirror"},
        {"type": "tetrahedron", "vertices": ((-0.2, -0.5, 0.9), (0.3, -0.5, 1.0), (0.0, -0.5, 1.4), (0.0, 0.0, 1.1))},
        {"type": "sphere", "center": (0.2, 0.1, 0.3), "radius": 0.4, "material": "glass"},
        {"type": "sphere", "center": (1.1, 0.6, 0.5), "radius": 0.2, "emission": (3, 2, 1), "material": "matt"},
        {"type": "sphere", "center": (0, 0, 0), "radius": 8, "flip_normals": True, "emission": (0.1, 0.2, 0.3)},
        {"type": "disk", "center": (-0.5, 1.2, 0.5), "normal": (0.3, -1, 0), "radius": 0.3, "emission": (4, 4, 4)},
        {"type": "disk", "center": (0, 0.5, -1.5), "normal": (0, 0.2, 1), "radius": 0.8, "material": "mirror"},
        {
            "type": "triangle",
            "vertices": ((-1, 1.5, -0.5), (0, 1.5, -0.5), (-0.5, 1.5, 0.5)),
            "emission": (2, 3, 4),
            "flip_normals": True,
        },
        {
            "type": "mesh",
            "vertices": [tuple(p) for p in points.tolist()],
            "faces": [tuple(f) for f in faces.tolist()],
            "material": "matt",
        },
    ]
    return flatten(
        Scene.model_validate(
            {
                "camera": {"position": (0.2, 0.8, 3), "target": (0.1, 0.1, 0), "aperture_radius": 0.01},
                "materials": {
                    "matt": {"type": "lambert", "reflectance": color},
                    "mirror": {"type": "mirror", "reflectance": color},
                    "glass": {"type": "dielectric", "ior": 1.5},
                },
                "shapes": shapes,
                "lights": [
                    {"type": "point", "position": (0.5, 1.8, 1.5), "intensity": (1, 1, 1)},
                    {"type": "directional", "direction": (0.2, -1, -0.3), "irradiance": (0.5, 0.4, 0.3)},
                    {"type": "environment", "radiance": (0.2, 0.2, 0.2)},
                ],
            }
        ),
        WIDTH,
        HEIGHT,
    )
