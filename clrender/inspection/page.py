"""The page of the light paths of a pixel: one HTML file that needs nothing else."""

from __future__ import annotations

import base64
import json
from html import escape
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from clrender.image.display import png_bytes
from clrender.image.tone_map import to_display
from clrender.inspection.document import plain
from clrender.view.bundle import PAGE, joined

if TYPE_CHECKING:
    from clrender.inspection.surroundings import Surroundings

__all__ = ["paths_page"]

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
    sheets = ((PAGE, "style.css"), (_FOLDER, "paths.css"))
    styles = [(folder / name).read_text(encoding="utf-8") for folder, name in sheets]
    return template.substitute(
        title=escape(title),
        style="\n".join(styles),
        paths=_in_script(paths),
        surroundings=_in_script(json.dumps(None if around is None else _pictured(around))),
        script=joined("paths.js", _FOLDER),
    )


def _in_script(text: str) -> str:
    """JSON that no browser takes for the end of its element."""
    return text.replace("<", "\\u003c")


def _pictured(around: Surroundings) -> dict[str, Any]:
    """Pictures as data URLs, and points as base64 of little-endian numbers."""
    colors = to_display(around.colors[None], around.tone_map, around.stops)[0]
    points = around.points.astype("<f4")
    position = np.asarray(around.camera["position"])
    distances = np.linalg.norm(points - position, axis=1) if len(points) else np.ones(1)
    height, width = around.near.shape[:2]
    return {
        "image": _picture(around.image, around),
        "near": _picture(around.near, around),
        "near_corner": list(around.near_corner),
        "near_size": [width, height],
        "points": base64.b64encode(points.tobytes()).decode(),
        "colors": base64.b64encode(np.ascontiguousarray(colors).tobytes()).decode(),
        "rows": around.point_rows,
        "camera": plain(around.camera),
        # What is turned about, and how far rays that leave the scene are drawn
        "middle": max(float(np.median(distances)), 1e-6),
        "reach": max(float(np.quantile(distances, 0.95)), 1e-6),
    }


def _picture(linear: npt.NDArray[np.float32], around: Surroundings) -> str:
    data = png_bytes(to_display(linear, around.tone_map, around.stops), {})
    return f"data:image/png;base64,{base64.b64encode(data).decode()}"
