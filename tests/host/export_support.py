"""Parts of scenes that the tests of all exporters write."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from clrender.image.files import read_image
from clrender.scene import Scene

__all__ = ["BALL", "CAMERA", "GREY", "MIRRORED_MAPS", "QUAD", "described", "near", "texels"]

CAMERA: Final[dict[str, Any]] = {"position": [0.1, 0.2, 5.0], "target": [0.0, 0.0, 0.0]}
GREY: Final[dict[str, Any]] = {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]}
QUAD: Final[dict[str, Any]] = {
    "type": "quad",
    "origin": [0.0, 0.0, 0.0],
    "edge_u": [1.0, 0.0, 0.0],
    "edge_v": [0.3, 1.0, 0.2],
}
BALL: Final[dict[str, Any]] = {"type": "sphere", "center": [0.5, 0.0, 0.0], "radius": 1.0}


_SQUARE: dict[str, Any] = {
    "type": "mesh",
    "vertices": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]],
    "faces": [[0, 1, 2], [0, 2, 3]],
    "uvs": [[0, 0], [1, 0], [1, 1], [0, 1]],
}
_MIRROR: dict[str, Any] = {"scale": [-1.0, 1.0, 1.0], "rotate_degrees": [10.0, 20.0, 30.0]}
MIRRORED_MAPS: list[tuple[dict[str, Any], bool]] = [
    (_SQUARE, False),
    ({**_SQUARE, "uvs": [[1, 0], [0, 0], [0, 1], [1, 1]]}, True),
    ({**_SQUARE, "transform": _MIRROR}, True),
    ({**_SQUARE, "flip_normals": True}, True),
    ({**_SQUARE, "flip_normals": True, "transform": _MIRROR}, False),
    (QUAD, False),
    ({**QUAD, "transform": _MIRROR}, True),
    (BALL, False),
    ({**BALL, "transform": _MIRROR}, True),
]
"""Shapes, and whether green of their normal maps is against front × red."""


def described(**parts: Any) -> Any:
    """A scene of these parts, with a camera and the material `m`."""
    return Scene.model_validate({"camera": CAMERA, "materials": {"m": GREY}, **parts})


def near(found: Any, expected: Any, tolerance: float = 1e-6) -> bool:
    """Whether all numbers agree, relatively or absolutely."""
    return bool(np.allclose(found, expected, rtol=tolerance, atol=tolerance))


def texels(file: Path) -> NDArray[np.floating]:
    """The numbers of a picture, (H, W, 3), undecoded."""
    return np.asarray(Image.open(file))[..., :3] / 255.0 if file.suffix == ".png" else read_image(file)
