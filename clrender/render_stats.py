"""The numbers about a render that go into its statistics and its files."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from clrender.device.source import kernels_sha256
from clrender.image.files import image_sha256
from clrender.version import __version__

if TYPE_CHECKING:
    from clrender.device.worker import DeviceWorker
    from clrender.film import Film
    from clrender.flatten import FlatScene
    from clrender.scene import Scene
    from clrender.scheduling.run import Tally
    from clrender.settings import RenderSettings

__all__ = ["render_stats"]


def render_stats(
    scene: Scene,
    flat: FlatScene,
    wanted: RenderSettings,
    film: Film,
    linear: npt.NDArray[np.float32],
    tally: Tally,
    workers: Sequence[DeviceWorker],
    times: Mapping[str, float],
) -> dict[str, Any]:
    """What ``--stats`` writes of a render.

    Parameters
    ----------
    scene, flat, wanted, film, tally, workers
        Of the render.
    linear : (height, width, 3) float32
        The image.
    times : mapping
        The keys that end in ``_seconds``.
    """
    seconds = max(times["render_seconds"], 1e-9)
    return {
        "image_sha256": image_sha256(linear),
        "denoised": False,
        "scene_sha256": scene.sha256(),
        "kernel_sha256": kernels_sha256(),
        "version": __version__,
        "width": wanted.width,
        "height": wanted.height,
        "spp": wanted.spp,
        "seed": wanted.seed,
        "integrator": wanted.integrator,
        "settings": {**wanted.request(), "spp": wanted.spp},
        "samples": tally.samples,
        "rays": tally.rays,
        "shadow_rays": tally.shadow_rays,
        "max_depth": tally.deepest,
        "nonfinite_samples": tally.samples - film.samples,
        **times,
        "msamples_per_second": tally.samples / seconds / 1e6,
        "mrays_per_second": tally.rays / seconds / 1e6,
        "peak_rss_bytes": _peak_rss(),
        "device_bytes": sum(worker.device.allocated_bytes for worker in workers),
        "triangles": flat.triangle_count,
        "devices": [
            {
                "name": worker.device.info.name,
                "driver": f"{worker.device.info.platform} {worker.device.info.driver}",
                "type": worker.device.info.type,
                "units": done.units,
                "samples": done.samples,
                "seconds": worker.busy_seconds,
                "requeued": done.requeued,
            }
            for worker, done in zip(workers, tally.workers, strict=True)
        ],
    }


def _peak_rss() -> int:
    """Most memory this process ever held, bytes; 0 where the system does not tell."""
    try:
        import resource
    except ImportError:
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
