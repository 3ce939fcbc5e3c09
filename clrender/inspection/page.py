"""The page of the light paths of a pixel: one HTML file that needs nothing else."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from html import escape
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from clrender.drawing.bundle import joined, style_sheet
from clrender.image.display import png_bytes
from clrender.image.tone_map import to_display
from clrender.inspection.document import plain

if TYPE_CHECKING:
    from clrender.inspection.surroundings import Surroundings

__all__ = ["paths_page", "sketched"]

_FOLDER: Final = Path(__file__).parent / "page"


def paths_page(title: str, paths: str, around: Surroundings | None) -> str:
    """HTML of light paths.

    Parameters
    ----------
    title : str
    paths : str
        The JSON of the paths.
    around : Surroundings, optional
        Pictures and points of the scene.
    """
    template = Template((_FOLDER / "paths.html").read_text(encoding="utf-8"))
    return template.substitute(
        title=escape(title),
        style=style_sheet(),
        paths=_in_script(paths),
        surroundings=_in_script(json.dumps(None if around is None else _pictured(around))),
        script=joined("paths.js"),
    )


def _in_script(text: str) -> str:
    """JSON that no browser takes for the end of its element."""
    return text.replace("<", "\\u003c")


def _pictured(around: Surroundings) -> dict[str, Any]:
    """Pictures as data URLs, and points as base64 of little-endian numbers."""
    height, width = around.near.shape[:2]
    colors = to_display(around.colors[None], around.tone_map, around.stops)[0]
    return {
        "image": _picture(around.image, around),
        "near": _picture(around.near, around),
        "near_corner": list(around.near_corner),
        "near_size": [width, height],
        **sketched(around.points, colors, around.point_rows, around.camera),
    }


def sketched(
    points: npt.NDArray[np.float32], colors: npt.NDArray[np.uint8], rows: int, camera: Mapping[str, Any]
) -> dict[str, Any]:
    """What the sketch of a scene in three dimensions is drawn from, as JSON values.

    Parameters
    ----------
    points : (p, 3) float32
        First hits of the camera, world space, metres.
    colors : (p, 3) uint8
        For display.
    rows : int
        Of the grid of rays that found them.
    camera : mapping
        As of `clrender.inspection.surroundings.pose_of`.
    """
    points = points.astype("<f4")
    distances = np.linalg.norm(points - np.asarray(camera["position"]), axis=1) if len(points) else np.ones(1)
    return {
        "points": base64.b64encode(points.tobytes()).decode(),
        "colors": base64.b64encode(np.ascontiguousarray(colors).tobytes()).decode(),
        "rows": rows,
        "camera": plain(camera),
        # What is turned about, and how far rays that leave the scene are drawn
        "middle": max(float(np.median(distances)), 1e-6),
        "reach": max(float(np.quantile(distances, 0.95)), 1e-6),
    }


def _picture(linear: npt.NDArray[np.float32], around: Surroundings) -> str:
    data = png_bytes(to_display(linear, around.tone_map, around.stops), {})
    return f"data:image/png;base64,{base64.b64encode(data).decode()}"
