"""A flat scene in which only the lights of one group shine, while all are sampled as before."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.flatten.environment import without_light
from clrender.flatten.flat_scene import FlatScene
from clrender.flatten.spectral import SpectralPlace

__all__ = ["OTHERS", "group_names", "lit_by"]

OTHERS: Final = "others"
"""Name of the layer of lights without a group, and of media that shine."""
_MEDIUM: Final = {name: slice(first, first + count) for name, first, count, _ in layout.ROWS["MEDIUM"]}
_SUN: Final = {name: slice(first, first + count) for name, first, count, _ in layout.ROWS["SUN"]}


def group_names(flat: FlatScene) -> list[str]:
    """Names of the light groups of a flat scene, sorted; `OTHERS` last, if some lights have none."""
    names = {name or OTHERS for name in flat.light_groups}
    if flat.features.glowing_media:
        names.add(OTHERS)
    return sorted(names - {OTHERS}) + ([OTHERS] if OTHERS in names else [])


def lit_by(flat: FlatScene, group: str) -> FlatScene:
    """A copy of a flat scene in which the lights of all other groups have no radiance.

    Everything that decides about paths stays: which light is sampled, where, and with which density. So each sample is
    the part of the whole scene's sample that this group contributes.

    Parameters
    ----------
    flat : FlatScene
    group : str
        One of `group_names`.

    Returns
    -------
    FlatScene
    """
    dark = np.array([(name or OTHERS) != group for name in flat.light_groups], bool)
    lights = flat.arrays["lights"].copy()
    rows = lights[: len(dark)]
    rows["radiance"][dark, :3] = 0.0
    rows["texture"][dark] = 0
    arrays = {**flat.arrays, "lights": lights}
    if len(flat.arrays["environment_map"]) > 1 and (dark & (rows["kind"] == layout.LIGHT_ENVIRONMENT)).any():
        arrays["environment_map"] = without_light(flat.arrays["environment_map"])
    if (dark & (rows["kind"] == layout.LIGHT_SUN)).any():
        tables = flat.arrays["lamp_tables"].copy()
        for channel in ("RED", "GREEN", "BLUE"):
            tables[_SUN[channel]] = 0.0
        arrays["lamp_tables"] = tables
    if flat.features.glowing_media and group != OTHERS:
        media = flat.arrays["media_rows"].copy()
        glows = (media[:, _MEDIUM["FLAGS"]].view(np.uint32)[:, 0] & layout.MEDIUM_FLAG_GLOWS) != 0
        media[glows, _MEDIUM["EMISSION"]] = 0.0
        arrays["media_rows"] = media
    shining = not flat.features.glowing_media or group == OTHERS
    spectral = tuple(each for place in flat.spectral for each in _of_group(place, dark, shining))
    digest = hashlib.sha256(f"{flat.arrays_sha256} lit by {group}".encode()).hexdigest()
    return dataclasses.replace(flat, arrays=arrays, spectral=spectral, arrays_sha256=digest)


def _of_group(place: SpectralPlace, dark: NDArray[np.bool_], media_shine: bool) -> Iterator[SpectralPlace]:
    """What spectra still say where these lights are dark, and media, too, unless they shine."""
    if place.array == "lights":
        rows = np.atleast_1d(np.arange(len(dark))[place.rows])
        lit = rows[~dark[rows]]
        yield from [place] if len(lit) == len(rows) else (dataclasses.replace(place, rows=int(row)) for row in lit)
    elif media_shine or (place.array, place.column) != ("media_rows", _MEDIUM["EMISSION"].start):
        yield place
