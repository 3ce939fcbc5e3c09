"""What is known of one pixel: its radiance with its error, and what its first sample sees."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from clrender.errors import UsageError
from clrender.film.replicates import standard_error_of
from clrender.view.parameters import parameters

if TYPE_CHECKING:
    from clrender.view.progressive import Progressive
    from clrender.view.subject import Subject

__all__ = ["probe"]


def probe(progressive: Progressive, subject: Subject, x: int, y: int) -> dict[str, Any]:
    """The answer to a page that asks for a pixel.

    Parameters
    ----------
    progressive : Progressive
        Which does not render meanwhile.
    subject : Subject
    x, y : int
        Column and row, (0, 0) top left.

    Raises
    ------
    UsageError
        There is no such pixel, or no image.
    """
    shot = progressive.shot
    if shot is None:
        raise UsageError("there is no image yet")
    if x >= shot.width or y >= shot.height:
        raise UsageError(f"there is no pixel ({x}, {y}) in an image of {shot.width} x {shot.height}")
    seen = progressive.probed(x, y)
    film = shot.film
    samples = 0 if film is None else int(film.counts[y, x])
    told: dict[str, Any] = {
        "x": x,
        "y": y,
        "revision": shot.revision,
        "samples": samples,
        "radiance": None,
        "standard_error": None,
        "object": None,
        "material": None,
        "parameters": None,
        "depth": None,
        "position": None,
        "normal": None,
        "focus_distance": None,
    }
    if film is not None and samples:
        told["radiance"] = film.mean_of(slice(y, y + 1), slice(x, x + 1))[0, 0].tolist()
        if film.replicate_spp:
            told["standard_error"] = _finite(standard_error_of(film, slice(y, y + 1))[0, x].tolist())
    if not seen or seen["object"][0] < 0:
        return told
    scene = subject.checked.scene
    number = int(seen["object"][0])
    shape = scene.shapes[number]
    told["object"] = {"index": number, "name": getattr(shape, "name", None), "type": shape.type}
    if (place := int(seen["material"][0])) >= 0:
        name = list(scene.materials)[place]
        told["material"], told["parameters"] = name, parameters(scene.materials[name])
    told["depth"] = _finite(seen["depth"].tolist()[:1])
    told["depth"] = told["depth"][0] if told["depth"] else None
    told["position"] = _finite(seen["position"].tolist())
    told["normal"] = _finite(seen["normal"].tolist())
    if told["position"] is not None:
        camera = subject.camera
        view = np.subtract(camera.target, camera.position)
        along = float(np.dot(np.subtract(told["position"], camera.position), view / np.linalg.norm(view)))
        told["focus_distance"] = along if along > 0.0 else None
    return told


def _finite(numbers: Iterable[float]) -> list[float] | None:
    listed = list(numbers)
    return listed if all(math.isfinite(each) for each in listed) else None
