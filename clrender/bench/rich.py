"""The benchmark's rich scene, S5: materials, textures and an environment map, where S1 to S4 have plain walls."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image

from clrender.bench.shapes import bumpy_body, write_ply
from clrender.image.radiance_hdr import write_hdr

__all__ = ["rich_scene"]

_MATERIALS: Final[dict[str, Any]] = {
    "gold": {"type": "conductor", "metal": "Au", "roughness": math.sqrt(0.2)},
    # An index similar to chromium's, which looks like polished steel; both renderers get the same numbers.
    "steel": {"type": "conductor", "eta": [3.18, 3.18, 1.99], "k": [3.31, 3.33, 2.86], "roughness": math.sqrt(0.05)},
    "plastic": {
        "type": "principled",
        "base_color": [0.2, 0.3, 0.7],
        "roughness": 0.4,
        "coat": 1.0,
        "coat_roughness": 0.1,
    },
    "rough_glass": {"type": "dielectric", "ior": 1.5, "roughness": math.sqrt(0.1)},
    "poster": {"type": "lambert", "reflectance": {"texture": "poster.png", "color_space": "srgb"}},
    "floor": {
        "type": "principled",
        "base_color": {"texture": "floor.png", "color_space": "srgb"},
        "roughness": 0.5,
        "normal_map": {"texture": "floor_normal.png"},
    },
}
_BODY_FREQUENCY: Final = 71
_SIDE: Final = 2048


def rich_scene(folder: Path, room: list[dict[str, Any]]) -> dict[str, Any]:
    """Make the description of S5, and write its mesh and images.

    Parameters
    ----------
    folder : Path
        Output folder.
    room : list of dict
        Floor, ceiling, back, front, left and right wall, and lights. The front is omitted, to let in the sky.

    Returns
    -------
    dict
        As a scene file, for renderers that have analytic spheres.
    """
    floor, ceiling, back, _, *others = room
    write_ply(folder / "body.ply", *bumpy_body(_BODY_FREQUENCY))
    _write_images(folder)
    shapes = [{**floor, "material": "floor"}, ceiling, {**back, "material": "poster"}, *others]
    shapes.append({"type": "mesh", "file": "body.ply", "material": "gold"})
    kinds = ("gold", "steel", "plastic", "rough_glass")
    for number in range(12):
        center = [-1.6 + (number % 4) * 1.05, 0.4, 1.8 - (number // 4) * 1.1]
        shapes.append({"type": "sphere", "center": center, "radius": 0.35, "material": kinds[number % 4]})
    plain = {
        "white": [0.75, 0.75, 0.75],
        "red": [0.63, 0.065, 0.05],
        "green": [0.14, 0.45, 0.091],
        "black": [0.0, 0.0, 0.0],
    }
    return {
        "camera": {"position": [0.0, 2.0, 5.6], "target": [0.0, 2.0, 0.0], "vertical_fov": 45.0},
        "materials": {**{k: {"type": "lambert", "reflectance": color} for k, color in plain.items()}, **_MATERIALS},
        "shapes": shapes,
        "lights": [{"type": "environment", "file": "sky.hdr"}],
    }


def _write_images(folder: Path) -> None:
    """Two colour textures, a normal map, and a sky with a small sun: noise, so that all texels differ."""
    random = np.random.default_rng(5)
    for name in ("poster.png", "floor.png"):
        Image.fromarray(random.integers(40, 220, (_SIDE, _SIDE, 3), dtype=np.uint8)).save(
            folder / name, compress_level=1
        )
    normals = random.normal(size=(_SIDE // 2, _SIDE // 2, 3)) * [8.0, 8.0, 0.0] + [127.5, 127.5, 245.0]
    Image.fromarray(normals.round().clip(0, 255).astype(np.uint8)).save(folder / "floor_normal.png", compress_level=1)
    sky = np.full((256, 512, 3), 0.5, np.float32)
    sky[100:108, 250:258] = 200.0
    with (folder / "sky.hdr").open("wb") as file:
        write_hdr(file, sky)
