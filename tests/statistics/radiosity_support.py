"""Patches on a device for the tests of radiosity, and their radiance by path tracing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from clrender.device.team import DeviceTeam
from clrender.device.worker import DeviceWorker
from clrender.film import Film
from clrender.film.unit import tile_side
from clrender.integrators.descriptor import Pipeline
from clrender.radiosity.patches import Patches, cut_into_patches
from clrender.radiosity.tracer import Tracer
from clrender.scheduling.policy import Plan
from clrender.scheduling.run import run
from clrender.settings import RenderSettings

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

__all__ = ["fronts", "path_traced", "tracer_of"]

Floats = npt.NDArray[np.float64]

_PATHS = Pipeline(str(Path(__file__).resolve().with_name("patch_paths.cl")), "patch_paths")


def fronts(patches: Patches) -> npt.NDArray[np.uint32]:
    """The front sides of all patches."""
    return np.arange(0, 2 * len(patches), 2, dtype=np.uint32)


@contextmanager
def tracer_of(device: Device, scene: Scene, count: int, rays: int, seed: int = 0) -> Iterator[tuple[Patches, Tracer]]:
    """A scene's patches, and a tracer of them."""
    patches = cut_into_patches(scene, count)
    tracer = Tracer(device, patches.flat(4, 4), rays, seed)
    try:
        yield patches, tracer
    finally:
        tracer.release()


def path_traced(device: Device, patches: Patches, spp: int, seed: int) -> Floats:
    """(n, 3): mean radiance of the front of each patch, its own emission left out, by the path tracer.

    Parameters
    ----------
    device : Device
    patches : Patches
        Whose light shadow rays find, without environment.
    spp, seed : int
    """
    side = int(np.ceil(np.sqrt(len(patches))))
    settings = RenderSettings(spp=spp, width=side, height=side, seed=seed)
    tile = tile_side(64, side, side)
    film, flat = Film(side, side), patches.flat(side, side)
    with DeviceTeam([device], lambda each: DeviceWorker(each, flat, settings.struct(tile), _PATHS)) as team:
        run(Plan(side, side, 0, spp, tile), team.candidates, film).raise_failure()
    return film.mean().reshape(-1, 3)[: len(patches)].astype(np.float64) - patches.emission
