"""The benchmark's scenes: a closed room with a mirror sphere, and in each scene a different load.

The same formulae generate them everywhere, as scene files and meshes that other programs can read, too.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from clrender.bench.crowd import crowd_scene
from clrender.bench.foliage import foliage_scene
from clrender.bench.hard import HARD_SCENES, hard_scene
from clrender.bench.rich import rich_scene
from clrender.bench.shapes import bumpy_body, geodesic, quad, write_ply
from clrender.errors import UsageError

__all__ = ["SCENES", "scene_file", "write_scene"]

SCENES: Final[Mapping[str, str]] = {
    "S1": "a closed room with two lights, a cube, a diffuse and a mirror sphere",
    "S1-tess": "S1, each sphere 5,120 smooth-shaded triangles",
    "S2": "S1 with a glass sphere",
    "S2-tess": "S2, each sphere 5,120 smooth-shaded triangles",
    "S3-10k": "S1 with a mesh of 9,680 triangles in place of the cube",
    "S3-100k": "the same with 100,820 triangles",
    "S3-1M": "the same with 1,003,520 triangles",
    "S3-4M": "the same with 3,996,180 triangles",
    "S4": "S1 lit by a thousand small triangles in place of the two lights",
    "S5": "S1's room, its front open to a sky with a sun, with metals, rough glass, coats, textures and a normal map",
    "S6": "a tree of 20,000 leaves, squares cut out by the alpha of a picture, under a sky with a sun",
    "S7": "ten thousand instances of a mesh of 100,820 triangles",
    **HARD_SCENES,
}
_FREQUENCY: Final = {"S3-10k": 22, "S3-100k": 71, "S3-1M": 224, "S3-4M": 447}
_SPHERE_FREQUENCY: Final = 16
_LOW: Final = (-2.0, 0.0, -2.0)
_HIGH: Final = (2.0, 4.0, 6.0)
_COLORS: Final = {
    "white": (0.75, 0.75, 0.75),
    "red": (0.63, 0.065, 0.05),
    "green": (0.14, 0.45, 0.091),
    "blue": (0.25, 0.35, 0.65),
    "yellow": (0.7, 0.6, 0.25),
    "black": (0.0, 0.0, 0.0),
}


def scene_file(name: str) -> Path:
    """A scene file named in the place of a benchmark scene.

    Raises
    ------
    UsageError
        If `name` is neither a benchmark scene nor a file.
    """
    path = Path(name)
    if not path.is_file():
        raise UsageError(
            f"there is no benchmark scene and no file {name!r}; give a scene file or one of {', '.join(SCENES)}"
        )
    return path


def write_scene(name: str, folder: Path, triangles: bool = False) -> Path:
    """Write a benchmark scene: ``scene.json``, and its meshes as binary PLY files.

    Parameters
    ----------
    name : str
        One of `SCENES`.
    folder : Path
        Output folder; must exist.
    triangles : bool
        Whether to write spheres as triangles, for renderers without analytic spheres.

    Returns
    -------
    Path
        The scene file.

    Raises
    ------
    UsageError
        If there is no such scene.
    """
    if name not in SCENES:
        raise UsageError(f"there is no benchmark scene {name!r}; choose one of {', '.join(SCENES)}")
    path = folder / "scene.json"
    if name == "S5":
        path.write_text(json.dumps(rich_scene(folder, [*_walls(), *_two_lights()])), encoding="utf-8")
        return path
    if name == "S6":
        path.write_text(json.dumps(foliage_scene(folder)), encoding="utf-8")
        return path
    if name in HARD_SCENES:
        path.write_text(json.dumps(hard_scene(name, folder)), encoding="utf-8")
        return path
    if name == "S7":
        path.write_text(json.dumps(crowd_scene(folder)), encoding="utf-8")
        return path
    base, _, variant = name.partition("-")
    shapes = [*_walls(), *(_many_lights() if base == "S4" else _two_lights())]
    if base == "S3":
        write_ply(folder / "body.ply", *bumpy_body(_FREQUENCY[name]))
        shapes.append({"type": "mesh", "file": "body.ply", "material": "blue"})
    else:
        turned = {"rotate_degrees": [0.0, 20.0, 0.0], "translate": [-0.9, 0.9, -0.7]}
        shapes.append({"type": "box", "size": [1.2, 1.8, 1.0], "transform": turned, "material": "blue"})
    first = "glass" if base == "S2" else "yellow"
    for number, (center, radius, material) in enumerate(
        (((0.9, 0.6, 0.9), 0.6, first), ((0.75, 0.8, -1.0), 0.8, "mirror"))
    ):
        if triangles or variant == "tess":
            points, faces = geodesic(_SPHERE_FREQUENCY)
            write_ply(folder / f"sphere{number}.ply", points * radius + center, faces, points)
            shapes.append({"type": "mesh", "file": f"sphere{number}.ply", "material": material})
        else:
            shapes.append({"type": "sphere", "center": center, "radius": radius, "material": material})
    materials: dict[str, Any] = {k: {"type": "lambert", "reflectance": color} for k, color in _COLORS.items()}
    materials["mirror"] = {"type": "mirror", "reflectance": [0.9] * 3}
    materials["glass"] = {"type": "dielectric", "ior": 1.5}
    camera = {"position": [0.0, 2.0, 5.6], "target": [0.0, 2.0, 0.0], "vertical_fov": 45.0}
    path.write_text(json.dumps({"camera": camera, "materials": materials, "shapes": shapes}), encoding="utf-8")
    return path


def _walls() -> list[dict[str, Any]]:
    (x0, y0, z0), (x1, y1, z1) = _LOW, _HIGH
    return [
        quad((x0, y0, z1), (x1, y0, z1), (x0, y0, z0), material="white"),
        quad((x0, y1, z0), (x1, y1, z0), (x0, y1, z1), material="white"),
        quad((x0, y0, z0), (x1, y0, z0), (x0, y1, z0), material="white"),
        quad((x1, y0, z1), (x0, y0, z1), (x1, y1, z1), material="white"),
        quad((x0, y0, z1), (x0, y0, z0), (x0, y1, z1), material="red"),
        quad((x1, y0, z0), (x1, y0, z1), (x1, y1, z0), material="green"),
    ]


def _two_lights() -> list[dict[str, Any]]:
    y, more = _HIGH[1] - 0.01, {"material": "black", "emission": [17.0, 14.0, 10.0]}
    return [quad((x - 0.5, y, -0.3), (x + 0.5, y, -0.3), (x - 0.5, y, 0.5), **more) for x in (-1.0, 1.0)]


def _many_lights() -> list[dict[str, Any]]:
    random, count = np.random.default_rng(7), 1000
    low, high = (-1.8, 2.9, -1.8), (1.8, 3.9, 3.0)
    center = np.stack([random.uniform(a, b, count) for a, b in zip(low, high, strict=True)], 1)
    out = random.normal(size=(count, 3, 3))
    out /= np.linalg.norm(out, axis=2, keepdims=True)
    corners = (center[:, None] + 0.03 * out).astype(np.float32).tolist()
    more = {"material": "black", "emission": [30.0, 26.0, 20.0]}
    return [{"type": "triangle", "vertices": each, **more} for each in corners]
