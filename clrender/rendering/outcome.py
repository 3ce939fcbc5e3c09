"""What users are told after a render: of devices that failed, samples that were lost, and images that are black."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import numpy as np

from clrender import layout
from clrender.scheduling.tally import failures_told
from clrender.wording import counted, grouped

if TYPE_CHECKING:
    from clrender.flatten.flat_scene import FlatScene
    from clrender.rendering.job import RenderJob
    from clrender.rendering.rendered_image import RenderedImage
    from clrender.scheduling.run import Tally

__all__ = ["lost_light", "outcome_told"]

_LIGHTS_OF_SHAPES: Final = (layout.LIGHT_AREA_TRIANGLE, layout.LIGHT_AREA_SPHERE, layout.LIGHT_AREA_DISK)


def lost_light(job: RenderJob, flat: FlatScene) -> str:
    """What is to be said of light that the job's integrator does not find; empty if it finds all."""
    return flat.lost_by(job.settings.integrator, job.settings.specular_chains == "on")


def outcome_told(job: RenderJob, flat: FlatScene, tally: Tally, image: RenderedImage) -> Iterator[str]:
    """Lines on which devices failed, which samples were lost, why an image is black, and what alpha does not fit to.

    Parameters
    ----------
    job : RenderJob
    flat : FlatScene
    tally : Tally
        Of the samples' workers.
    image : RenderedImage
    """
    yield from failures_told(tally)
    stats, alpha = image.stats, image.alpha
    if alpha is not None and job.scene.shows_environment and (alpha < 1.0).any():
        yield (
            "note: the colours hold the environment, which alpha leaves out; hide it to put another background there "
            "(--alpha, or hide_environment)"
        )
    if lost := stats["nonfinite_samples"]:
        yield (
            f"warning: {grouped(lost)} of {counted(stats['samples'], 'sample')} "
            f"{'was' if lost == 1 else 'were'} not finite, or brighter than 2^43, and left "
            "out: the image is too dark where they were"
        )
    elif (flat.light_count or flat.environment != layout.NONE) and stats["samples"] and not image.linear.any():
        if lost_light(job, flat) or flat.lost_in_fog:
            return  # that was said when the scene was read, and why
        of_shapes = np.isin(flat.arrays["lights"]["kind"][: flat.light_count], _LIGHTS_OF_SHAPES).any()
        cure = (
            "A shape emits light from its front only, on which its corners are in counter-clockwise order"
            if of_shapes
            else "`clrender view` shows from elsewhere what stands between"
        )
        yield f"warning: every pixel is black: no light reaches the camera. {cure}"
