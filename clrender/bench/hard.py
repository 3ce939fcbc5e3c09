"""The benchmark's hard light: scenes whose light a path from the camera seldom finds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from clrender.bench.shapes import quad, torus, write_ply

__all__ = ["HARD_SCENES", "hard_scene"]

_GREY: Final = {"type": "lambert", "reflectance": [0.7, 0.7, 0.7]}
_BLACK: Final = {"type": "lambert", "reflectance": [0.0, 0.0, 0.0]}
_AROUND: Final = 192
_ALONG: Final = 64
"""Segments of a torus around its axis, and around its tube."""


def hard_scene(name: str, folder: Path) -> dict[str, Any]:
    """Make the description of a scene of hard light, and write its meshes.

    Parameters
    ----------
    name : str
        One of `HARD_SCENES`.
    folder : Path
        Output folder.

    Returns
    -------
    dict
        As a scene file.
    """
    return _MAKERS[name](folder)


def _slit_room(_: Path) -> dict[str, Any]:
    """Two rooms with a wall between them. The lamp is in the one behind, the camera in the one before."""
    room = [
        ((-2.0, 0.0, 0.0), (-2.0, 0.0, 8.0), (2.0, 0.0, 0.0)),
        ((-2.0, 2.5, 0.0), (2.0, 2.5, 0.0), (-2.0, 2.5, 8.0)),
        ((-2.0, 0.0, 0.0), (-2.0, 2.5, 0.0), (-2.0, 0.0, 8.0)),
        ((2.0, 0.0, 0.0), (2.0, 0.0, 8.0), (2.0, 2.5, 0.0)),
        ((-2.0, 0.0, 0.0), (2.0, 0.0, 0.0), (-2.0, 2.5, 0.0)),
        ((-2.0, 0.0, 8.0), (-2.0, 2.5, 8.0), (2.0, 0.0, 8.0)),
    ]
    wall = [
        ((-2.0, 0.0, 4.0), (1.3, 0.0, 4.0), (-2.0, 2.5, 4.0)),
        ((1.45, 0.0, 4.0), (2.0, 0.0, 4.0), (1.45, 2.5, 4.0)),
        ((1.3, 2.0, 4.0), (1.45, 2.0, 4.0), (1.3, 2.5, 4.0)),
    ]
    table = [
        ((-1.2, 0.0, 1.2), (-0.4, 0.0, 1.2), (-1.2, 1.0, 1.2)),
        ((-1.2, 1.0, 1.2), (-0.4, 1.0, 1.2), (-1.2, 1.0, 1.8)),
        ((-1.2, 0.0, 1.8), (-0.4, 0.0, 1.8), (-1.2, 1.0, 1.8)),
        ((-1.2, 0.0, 1.2), (-1.2, 1.0, 1.2), (-1.2, 0.0, 1.8)),
        ((-0.4, 0.0, 1.2), (-0.4, 1.0, 1.2), (-0.4, 0.0, 1.8)),
    ]
    lamp = quad((-1.5, 2.49, 6.0), (-0.5, 2.49, 6.0), (-1.5, 2.49, 7.0), material="black", emission=[60.0] * 3)
    return {
        "camera": {"position": [1.5, 1.4, 3.6], "target": [-0.8, 0.9, 0.8], "vertical_fov": 60.0},
        "image": {"width": 128, "height": 96},
        "materials": {"white": _GREY, "black": _BLACK},
        "shapes": [*(quad(*corners, material="white") for corners in (*room, *wall, *table)), lamp],
    }


def _torus_in_glass(folder: Path) -> dict[str, Any]:
    """A matt torus in a cube of glass: every light sample at it is hidden by the glass."""
    points, faces, normals = torus(0.55, (0.2, 0.2), _AROUND, _ALONG)
    write_ply(folder / "torus.ply", points, faces, normals)
    return {
        "camera": {"position": [2.2, 2.4, 4.2], "target": [0.0, 0.7, 0.0], "vertical_fov": 30.0},
        "image": {"width": 128, "height": 96},
        "materials": {
            "glass": {"type": "dielectric", "ior": 1.5},
            "orange": {"type": "lambert", "reflectance": [0.8, 0.4, 0.15]},
            "floor": _GREY,
            "black": _BLACK,
        },
        "shapes": [
            quad((-6.0, 0.0, 6.0), (6.0, 0.0, 6.0), (-6.0, 0.0, -6.0), material="floor"),
            {"type": "box", "center": [0.0, 0.81, 0.0], "size": [1.6, 1.6, 1.6], "material": "glass"},
            {
                "type": "mesh",
                "file": "torus.ply",
                "material": "orange",
                "transform": {"rotate_degrees": [50.0, 0.0, 25.0], "translate": [0.0, 0.81, 0.0]},
            },
            _lamp([-1.5, 4.5, 1.5], 0.12, [260.0, 240.0, 200.0]),
        ],
    }


def _ring(folder: Path) -> dict[str, Any]:
    """A band of metal on a table: inside of it is a caustic with a cusp, which light samples miss."""
    points, faces, normals = torus(0.5, (0.03, 0.18), _AROUND, _ALONG)
    write_ply(folder / "ring.ply", points, faces, normals)
    return {
        "camera": {"position": [0.0, 1.7, 1.9], "target": [0.0, 0.05, 0.0], "vertical_fov": 38.0},
        "image": {"width": 128, "height": 96},
        "materials": {
            "gold": {"type": "conductor", "metal": "Au"},
            "table": {"type": "lambert", "reflectance": [0.6, 0.55, 0.5]},
            "black": _BLACK,
        },
        "shapes": [
            quad((-4.0, 0.0, 4.0), (4.0, 0.0, 4.0), (-4.0, 0.0, -4.0), material="table"),
            {"type": "mesh", "file": "ring.ply", "material": "gold", "transform": {"translate": [0.0, 0.181, 0.0]}},
            _lamp([-2.4, 1.7, 0.6], 0.05, [900.0, 850.0, 760.0]),
        ],
    }


def _lamp(center: list[float], radius: float, emission: list[float]) -> dict[str, Any]:
    return {"type": "sphere", "center": center, "radius": radius, "material": "black", "emission": emission}


_MAKERS: Final[Mapping[str, Callable[[Path], dict[str, Any]]]] = {
    "X1": _slit_room,
    "X8": _torus_in_glass,
    "X9": _ring,
}
HARD_SCENES: Final[Mapping[str, str]] = {
    "X1": "two rooms with a slit in the wall between them: the lamp is in the other one",
    "X8": "a matt torus in a cube of glass under a small lamp: all light at it has passed the glass",
    "X9": "a ring of gold on a table under a small lamp: a caustic with a cusp",
}
"""Descriptions by name. X2 to X7 are the scenes of others that `scripts/hard_bench.py` reads."""
