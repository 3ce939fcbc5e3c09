"""Differences between the requests of two images, as text."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final

from clrender.limits import Region
from clrender.settings import SETTINGS, present

__all__ = ["differences", "film_size", "options_for"]

_HASHES: Final = {
    "scene_sha256": "the scene is another one, or was changed",
    "kernel_sha256": "the kernels are others",
    "sampler_sha256": "the kernels are others",
    "plugins": "the plugins are others, or their texts have changed",
}
_ARRAYS: Final = "the arrays made of the scene are others, as of another version of clrender or NumPy"


def differences(there: Mapping[str, Any], here: Mapping[str, Any]) -> dict[str, str]:
    """Differences between two requests.

    Parameters
    ----------
    there, here : mapping
        `clrender.film.Film.request` of a file, and of another film.

    Returns
    -------
    dict of str to str
        Key of the request, a setting's by its present name, to a clause: ``seed is 0 there and 1 here``. Empty for
        requests of one image.
    """
    a, b = _plain(there), _plain(here)
    keys = [key for key in {**a, **b} if a.get(key) != b.get(key)]
    found = {key: _HASHES.get(key, f"{key} is {a.get(key)} there and {b.get(key)} here") for key in keys}
    found.pop("arrays_sha256", None)
    if keys and not found:
        found = {"arrays_sha256": _ARRAYS}
    if "kernel_sha256" in found:
        found.pop("sampler_sha256", None)
    return found


def film_size(request: Mapping[str, Any]) -> tuple[int, int]:
    """Width and height of a request's film, pixels: of its crop, or of the whole image."""
    crop = request.get("crop")
    return (request["width"], request["height"]) if crop is None else (crop[2], crop[3])


def options_for(request: Mapping[str, Any], keys: Mapping[str, Any]) -> str:
    """Command-line options for those settings of a request that have an option."""
    request, words = present(request), []
    if {"width", "height"} & set(keys):
        words.append(f"--size {request.get('width')}x{request.get('height')}")
    for key in keys:
        option = SETTINGS[key].option if key in SETTINGS else None
        if option is not None and request.get(key) is not None:
            value = Region.text(request[key]) if key == "crop" else request[key]
            words.append(f"{option} {value}")
    return " ".join(words)


def _plain(request: Mapping[str, Any]) -> dict[str, Any]:
    """The request as it is after writing it to a file and reading it, by the present names of settings."""
    return present(json.loads(json.dumps(request)))
