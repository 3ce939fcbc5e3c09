"""Parts of scenes that the tests of all exporters write."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from clrender.scene import Scene

__all__ = ["BALL", "CAMERA", "GREY", "QUAD", "described", "near"]

CAMERA: Final[dict[str, Any]] = {"position": [0.1, 0.2, 5.0], "target": [0.0, 0.0, 0.0]}
GREY: Final[dict[str, Any]] = {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]}
QUAD: Final[dict[str, Any]] = {
    "type": "quad",
    "origin": [0.0, 0.0, 0.0],
    "edge_u": [1.0, 0.0, 0.0],
    "edge_v": [0.3, 1.0, 0.2],
}
BALL: Final[dict[str, Any]] = {"type": "sphere", "center": [0.5, 0.0, 0.0], "radius": 1.0}


def described(**parts: Any) -> Any:
    """A scene of these parts, with a camera and the material `m`."""
    return Scene.model_validate({"camera": CAMERA, "materials": {"m": GREY}, **parts})


def near(found: Any, expected: Any, tolerance: float = 1e-6) -> bool:
    """Whether all numbers agree, relatively or absolutely."""
    return bool(np.allclose(found, expected, rtol=tolerance, atol=tolerance))
