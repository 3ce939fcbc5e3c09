"""Frames of a scene in which a shape moves, with its radiosity updated from frame to frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from clrender.device.team import DeviceTeam
from clrender.device.worker import DeviceWorker
from clrender.film import Film
from clrender.integrators import INTEGRATORS
from clrender.radiosity.atlas import atlas_of
from clrender.radiosity.corners import Corners
from clrender.radiosity.display import GATHER, Display, Gather, looks_of
from clrender.radiosity.dynamic import DynamicRadiosity, Update
from clrender.scheduling.policy import Plan
from clrender.scheduling.run import run

if TYPE_CHECKING:
    from clrender.device.device import Device
    from clrender.device.preparation import DevicePreparation

__all__ = ["Frame", "Motion", "frames", "picture"]


@dataclass(frozen=True)
class Motion:
    """The displacement from each frame to the next.

    Attributes
    ----------
    shape : int
        Its index among the shapes of the patches' scene; see `DynamicRadiosity.move`.
    by : three floats
        Metres per frame.
    """

    shape: int
    by: tuple[float, float, float]


@dataclass(frozen=True)
class Frame:
    """An image, and the cost of updating its radiosity.

    Attributes
    ----------
    linear : (height, width, 3) float32
        Radiance.
    update : Update
        Cost of the update; for the first frame, of the whole solution.
    """

    linear: NDArray[np.float32]
    update: Update


def frames(
    dynamic: DynamicRadiosity,
    device: Device,
    settings: NDArray[np.void],
    motions: Sequence[Motion],
    count: int,
    spp: int,
    display: str,
) -> Iterator[Frame]:
    """The frames of an animation.

    Parameters
    ----------
    dynamic : DynamicRadiosity
    device : Device
    settings : (1,) `Settings`
    motions : sequence of Motion
    count : int
    spp : int
    display : str
        A value of the setting ``radiosity_display``.

    Raises
    ------
    UsageError
        If there is no such shape.
    RenderError
    """
    corners = Corners(dynamic.patches) if display == "smooth" else None
    update = dynamic.started
    for number in range(count):
        if number:
            updates = [dynamic.move(motion.shape, motion.by) for motion in motions]
            seconds, sweeps = sum(each.seconds for each in updates), sum(each.sweeps for each in updates)
            update = Update(sum(each.rays for each in updates), updates[-1].all_rays, sweeps, seconds)
        yield Frame(picture(dynamic, device, settings, spp, display, corners), update)


def picture(
    dynamic: DynamicRadiosity,
    device: Device,
    settings: NDArray[np.void],
    spp: int,
    display: str,
    corners: Corners | None,
) -> NDArray[np.float32]:
    """The current scene: (height, width, 3) float32, radiance."""
    width, height, tile = (int(settings[name][0]) for name in ("width", "height", "tile"))
    patches, rows = dynamic.patches, dynamic.rows
    show: Callable[[DeviceWorker], DevicePreparation]
    if display == "gather":
        atlas = atlas_of(patches, rows.shown_indirect(patches), dynamic.used, rows.open_share)
        flat = patches.whole(width, height)
        pipeline, show = GATHER, partial(Gather, atlas=atlas)
    else:
        table = looks_of(patches, rows.shown(patches), dynamic.used, corners)
        flat, pipeline, show = dynamic.flat, INTEGRATORS["radiosity"].pipeline, partial(Display, table=table)
    film = Film(width, height)
    with DeviceTeam([device], lambda each: DeviceWorker(each, flat, settings, pipeline, None, show)) as team:
        run(Plan(width, height, 0, spp, tile), team.candidates, film).raise_failure()
    return film.mean()
