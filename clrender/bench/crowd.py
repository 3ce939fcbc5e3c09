"""The benchmark's crowd, S7: ten thousand instances of a mesh of a hundred thousand triangles."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from clrender.bench.shapes import bumpy_body, quad, write_ply

__all__ = ["crowd_scene"]

_ALONG: Final = 100
_STEP: Final = 1.6
"""Distance between neighbours, metres."""


def crowd_scene(folder: Path, frequency: int = 71) -> dict[str, Any]:
    """Make the description of S7, and write its mesh and the transforms of its instances.

    Parameters
    ----------
    folder : Path
        Output folder.
    frequency : int
        The mesh has 20 `frequency`² triangles.

    Returns
    -------
    dict
        As a scene file.
    """
    points, faces = bumpy_body(frequency)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
    write_ply(folder / "body.ply", points - [middle[0], points[:, 1].min(), middle[2]], faces)
    np.save(folder / "places.npy", _places(np.random.default_rng(7)))
    half = _ALONG * _STEP / 2.0 + 4.0
    return {
        "camera": {"position": [0.0, 6.0, half + 8.0], "target": [0.0, 0.0, half - 30.0], "vertical_fov": 40.0},
        "materials": {
            "ground": {"type": "lambert", "reflectance": [0.3, 0.28, 0.25]},
            "body": {"type": "lambert", "reflectance": [0.6, 0.45, 0.3]},
        },
        "groups": {"body": {"shapes": [{"type": "mesh", "file": "body.ply", "material": "body"}]}},
        "shapes": [
            quad((-half, 0.0, half), (half, 0.0, half), (-half, 0.0, -half), material="ground"),
            quad(
                (-20.0, 40.0, -60.0),
                (20.0, 40.0, -60.0),
                (-20.0, 40.0, 0.0),
                material="ground",
                emission=[12.0, 11.0, 9.0],
            ),
            {"type": "instance", "group": "body", "transforms": "places.npy"},
        ],
        "lights": [{"type": "environment", "radiance": [0.25, 0.35, 0.5]}],
    }


def _places(random: np.random.Generator) -> npt.NDArray[np.float64]:
    """(n, 3, 4) maps: on a jittered grid, rotated about the vertical, of various sizes and slightly tilted."""
    count = _ALONG * _ALONG
    row, column = np.divmod(np.arange(count), _ALONG)
    angle = random.uniform(0.0, 2.0 * np.pi, count)
    size = random.uniform(0.5, 1.0, (count, 1, 1)) * random.uniform(0.8, 1.2, (count, 1, 3))
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros(count), np.ones(count)
    lean = random.uniform(-0.1, 0.1, (2, count))
    turn = np.stack([np.stack([c, lean[0], s], 1), np.stack([zero, one, zero], 1), np.stack([-s, lean[1], c], 1)], 1)
    at = np.stack([column, zero, row], 1) - [(_ALONG - 1) / 2.0, 0.0, (_ALONG - 1) / 2.0]
    at = at * _STEP + random.uniform(-0.4, 0.4, (count, 3)) * [1.0, 0.0, 1.0]
    return np.concatenate([turn * size, at[:, :, None]], axis=2)
