"""The pixel probe: radiance with its error, and the first hit of the pixel."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from clrender.errors import UsageError
from clrender.film.replicates import standard_error_of
from clrender.view.parameters import parameters

if TYPE_CHECKING:
    from clrender.view.edited_scene import EditedScene
    from clrender.view.progressive import Progressive

__all__ = ["probe"]


def probe(progressive: Progressive, edited: EditedScene, x: int, y: int) -> dict[str, Any]:
    """The answer to a page that asks for a pixel.

    Parameters
    ----------
    progressive : Progressive
        Which does not render meanwhile.
    edited : EditedScene
    x, y : int
        Column and row, (0, 0) top left.

    Raises
    ------
    UsageError
        There is no such pixel, or no image.
    """
    state = progressive.image_state
    if state is None:
        raise UsageError("there is no image yet")
    if x >= state.width or y >= state.height:
        raise UsageError(f"there is no pixel ({x}, {y}) in an image of {state.width} x {state.height}")
    seen = progressive.probed(x, y)
    film = state.film
    samples = 0 if film is None else int(film.counts[y, x])
    reply: dict[str, Any] = {
        "x": x,
        "y": y,
        "revision": state.revision,
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
        reply["radiance"] = film.mean_of(slice(y, y + 1), slice(x, x + 1))[0, 0].tolist()
        if film.replicate_spp:
            reply["standard_error"] = _finite(standard_error_of(film, slice(y, y + 1))[0, x].tolist())
    if not seen or seen["object"][0] < 0:
        return reply
    scene = edited.checked.scene
    number = int(seen["object"][0])
    shape = scene.shapes[number]
    name = getattr(shape, "name", None)
    reply["object"] = {"index": number, "name": name, "type": shape.type, "place": edited.place_of_shape(number)}
    if (place := int(seen["material"][0])) >= 0:
        name = list(scene.materials)[place]
        reply["material"], reply["parameters"] = name, parameters(scene.materials[name])
    reply["depth"] = _finite(seen["depth"].tolist()[:1])
    reply["depth"] = reply["depth"][0] if reply["depth"] else None
    reply["position"] = _finite(seen["position"].tolist())
    reply["normal"] = _finite(seen["normal"].tolist())
    if reply["position"] is not None:
        camera = edited.camera.opened  # as the layers are rendered
        view = np.subtract(camera.target, camera.position)
        along = float(np.dot(np.subtract(reply["position"], camera.position), view / np.linalg.norm(view)))
        reply["focus_distance"] = along if along > 0.0 else None
    return reply


def _finite(numbers: Iterable[float]) -> list[float] | None:
    listed = list(numbers)
    return listed if all(math.isfinite(each) for each in listed) else None
