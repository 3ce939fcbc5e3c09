"""Which cameras of a scene are rendered together."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from clrender.rendering.job import RenderJob
from clrender.scene import Camera

__all__ = ["batches"]

_ROWS: Final = 65536
_PIXELS: Final = 1 << 22
"""Most rows, and pixels, of a film of several images."""
_BLOCK: Final = 4
"""Rows of a block of pixels, which must not be in two images."""


def batches(job: RenderJob, cameras: Sequence[Camera]) -> Iterator[tuple[Camera, ...]]:
    """Parts of a sequence of cameras whose images fit into one film.

    Parameters
    ----------
    job : RenderJob
        With the settings of each image.
    cameras : sequence of Camera

    Yields
    ------
    tuple of Camera
        One alone where images cannot be rendered together: of integrators that share light between pixels or prepare
        something for the image, with layers, standard errors or a crop, and of cameras that see different wavelengths.
    """
    settings, pipeline = job.settings, job.integrator.pipeline
    width, height = settings.film_size
    alone = bool(job.preparation or job.integrator.shares or pipeline.splats or pipeline.sample_by_sample)
    alone |= bool(job.aov or job.denoise or job.light_groups or settings.crop or height % _BLOCK)
    alone |= settings.replicate_spp is not None or settings.time_limit is not None
    alone |= any(camera.response != cameras[0].response for camera in cameras)
    most = 1 if alone else max(1, min(_ROWS // height, _PIXELS // (width * height)))
    for first in range(0, len(cameras), most):
        yield tuple(cameras[first : first + most])
