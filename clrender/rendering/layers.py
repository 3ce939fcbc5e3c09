"""The layers of a job, which its devices render beside the image."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy.typing as npt

from clrender.aov import GUIDE_SAMPLES, GUIDES, LAYER_SAMPLES, first_hits, hit_counts

if TYPE_CHECKING:
    import numpy as np

    from clrender.device.launch import LaunchConfig
    from clrender.flatten.flat_scene import FlatScene
    from clrender.rendering.job import RenderJob
    from clrender.rendering.residency import Residency

__all__ = ["Layers"]

_COLORS: Final = {"spectral": 0}
"""Settings of layers, which show colours."""


class Layers:
    """Renders what the camera's rays meet first.

    Parameters
    ----------
    residency : Residency
        Its devices render them.
    job : RenderJob
    tile : int
        Side of tiles, pixels.
    launch : LaunchConfig
    should_stop : callable
        If it returns True, the layers have fewer samples.

    Attributes
    ----------
    areas : dict of str to dict of int to float
        Pixels that each number of a layer of labels covers; filled in by `rendered`.
    """

    def __init__(
        self, residency: Residency, job: RenderJob, tile: int, launch: LaunchConfig, should_stop: Callable[[], bool]
    ) -> None:
        self._residency, self._job, self._tile = residency, job, tile
        self._launch, self._should_stop = launch, should_stop
        self.areas: dict[str, dict[int, float]] = {}

    def rendered(self, flat: FlatScene) -> dict[str, npt.NDArray[np.float32]]:
        """Those of the job and of its denoiser, rendered before the image: complete even if that stops early."""
        job = self._job
        names = [*job.aov, *(GUIDES if job.denoise else ())]
        if not names:
            return {}  # with a cluster, this machine needs no device
        most = LAYER_SAMPLES if job.aov else GUIDE_SAMPLES
        return first_hits(
            self._residency.devices,
            self._worker(flat, most),
            job.scene,
            flat,
            job.settings,
            names,
            most,
            self._should_stop,
            self._residency.tell,
            self.areas,
        )

    def hit_counts(self, flat: FlatScene, samples: int) -> npt.NDArray[np.uint32]:
        """Number of the first `samples` of each pixel that hit anything, (height, width) uint32."""
        residency = self._residency
        make = self._worker(flat, samples)
        return hit_counts(residency.devices, make, self._job.settings, samples, self._should_stop, residency.tell)

    def _worker(self, flat: FlatScene, samples: int) -> Callable[..., Any]:
        """Makes a device's worker that takes so many samples of each pixel."""
        settings = self._job.settings
        launch = dataclasses.replace(self._launch, samples=samples * math.prod(settings.film_size))
        struct = settings.struct(self._tile, _COLORS)
        return partial(self._residency.worker, flat=flat, settings=struct, launch=launch)
